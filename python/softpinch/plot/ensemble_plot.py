"""Figures of ensembles and studies: histograms, failure times, importance and shares as a map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..scene.fields import label, words
from ..scene.scene import State
from ..study import Effect, Estimate, Results, sensitivity
from ..study.tables import drawn_by_magnitude, event, number, shown
from ..support import Bools, Floats
from ..support.checks import instance, integer
from . import style as s

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# `importance` shows at most this many parameters, the most important ones.
_MOST_BARS = 12
# No printer resolves more bins.
_MOST_BINS = 10_000
# A bin is marked if half of its 95 % confidence interval is larger.
_WIDE = 0.2
_DOTS: dict[str, Any] = {
    "linestyle": "none", "marker": "o", "markersize": 2.0, "markerfacecolor": "white",
    "markeredgecolor": s.BLACK, "markeredgewidth": 0.4,
}  # fmt: skip


def histogram(
    ensemble: Results, name: str, bins: int | None = None, ax: Axes | None = None
) -> Figure:
    """Histogram of a number over the runs: completed runs, and runs that ended early on top.

    The axis is logarithmic if all numbers are positive and span more than two decades, or if the
    number was drawn by a LogUniform or LogNormal. Numbers that are not finite are left out, and the
    figure says how many.

    Args:
        name: A summary, a component of one ("final_state.theta"), a path or "failure_time".
        bins: Number of bins; None chooses it by the number of runs.
    """
    instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    column = shown(number(ensemble, name))
    values, kept = column.values, np.isfinite(column.values)
    completed = (ensemble.status == "completed")[kept]
    values = values[kept]
    if bins is None:
        # Rice's rule, within the resolution of a narrow figure.
        bins = int(np.clip(np.ceil(2.0 * len(values) ** (1 / 3)), 5, 60))
    bins = integer("bins", bins, 1, _MOST_BINS)
    with s.one_panel(ax, s.COLUMN, 2.5) as (figure, each):
        each.set(xlabel=label(name, column.unit), ylabel="runs in the bin")
        if not len(values):
            _write_message(each, "no run has a finite value")
            return figure
        least = 1.0 if drawn_by_magnitude(ensemble, name) else 100.0
        if values.min() > 0.0 and values.max() > least * values.min():
            edges = np.geomspace(values.min(), values.max(), bins + 1)
            s.by_magnitude(each, "x", edges[0], edges[-1])
        else:
            edges = np.histogram_bin_edges(values, bins)
        highest = _bars(each, edges, values, completed)
        low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
        each.axvline(middle, color=s.BLACK, linewidth=1.0, label="median")
        style: dict[str, Any] = {"color": s.BLACK, "linewidth": 0.8, "linestyle": (0, (3, 2))}
        each.axvline(low, **style, label="5 % and 95 %")
        each.axvline(high, **style)
        each.set(xlim=(edges[0], edges[-1]), ylim=(0.0, 1.08 * highest))
        _legend(figure, each, ax)
        if left_out := ensemble.runs - len(values):
            text = f"{left_out} of {ensemble.runs} runs without a finite value"
            each.set_title(text, fontsize=8.0, loc="right", pad=3.0)
        return figure


def _bars(axes: Axes, edges: Floats, values: Floats, completed: Bools) -> float:
    """Draws stacked bars of completed and other runs, and returns the height of the highest."""
    done = np.histogram(values[completed], edges)[0]
    all_runs = np.histogram(values, edges)[0]
    if completed.any():
        name = f"completed ({np.count_nonzero(completed)})"
        axes.stairs(done, edges, fill=True, color=s.BLUE, alpha=0.55, linewidth=0.0, label=name)
    if not completed.all():
        name = f"ended early ({np.count_nonzero(~completed)})"
        hatched: dict[str, Any] = {"facecolor": "white", "edgecolor": s.RED, "hatch": "//////"}
        axes.stairs(all_runs, edges, baseline=done, fill=True, linewidth=0.0, label=name, **hatched)
    axes.stairs(all_runs, edges, color=s.BLACK, linewidth=0.6)
    return float(all_runs.max())


def failure_times(ensemble: Results, ax: Axes | None = None) -> Figure:
    """The share of runs that had ended early by each instant, for each status and in total."""
    instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    counts = {name: n for name, n in ensemble.counts().items() if name != "completed"}
    lost = sum(counts.values())
    never = ensemble.runs - lost
    with s.one_panel(ax, s.COLUMN, 2.5) as (figure, each):
        each.set(xlabel="time [s]", ylabel="share of runs ended early [1]")
        # The scene that all runs share may have no valid start.
        initial = ensemble.scene.initial
        start = initial.time if isinstance(initial, State) else 0.0
        end = start + ensemble.scene.duration
        if ensemble.runs:
            start = float(np.min(ensemble.parameters.get("initial.time", start)))
            end = float(ensemble.end_time.max())
        if lost:
            # Runs usually end soon after a disturbance, so the axis shows only that time.
            first, last = np.nanmin(ensemble.failure_time), np.nanmax(ensemble.failure_time)
            margin = 0.08 * (last - first) or 0.05 * (end - start) or 0.05 * ensemble.scene.duration
            start = max(start, first - margin)
            # Without a completed run the end of the time axis is unknown.
            end = min(end, last + margin) if never else last + margin
        each.set_xlim(start, end)
        if not lost:
            most = Estimate.of(np.zeros(ensemble.runs, bool)).high
            text = f"none of {ensemble.runs} runs ended early:\nthe probability is below {most:.2g}"
            _write_message(each, f"{text} (95 %)")
            each.set_ylim(0.0, 1.0)
            return figure
        entries = list(counts) if len(counts) == 1 else [*counts, "all"]
        for k, status in enumerate(entries):
            some, style = ensemble.status == status, s.LINES[k % len(s.LINES)]
            if status == "all":
                some, style = ensemble.status != "completed", {"color": s.BLACK, "linewidth": 0.7}
            times = np.sort(ensemble.failure_time[some])
            share = np.arange(len(times) + 1) / ensemble.runs
            steps = [start, *times, end], [*share, share[-1]]
            each.step(*steps, where="post", label=f"{words(status)} ({len(times)})", **style)
        each.set_ylim(0.0, 1.1 * lost / ensemble.runs)
        each.plot([], [], " ", label=f"never ({never} of {ensemble.runs})")
        _legend(figure, each, ax)
        return figure


@s.styled()
def importance(
    ensemble: Results, name: str | Bools = "completed", found: Mapping[str, Effect] | None = None
) -> Figure:
    """The importance of each parameter: the share of a result's variance that it explains alone.

    The left panel has the first-order shares of `sensitivity`; grey bars are the noise level, below
    which 95 % of randomly shuffled results stay. The right panel has the rank correlation, whose
    sign is the direction of the effect. The twelve largest shares are shown.

    Args:
        name: A summary or a component of one, a status ("completed"), a violation, "holds", or
            whether something happened in each run, booleans (runs,).
        found: The result of `sensitivity` for this name, if it has been computed already.
    """
    instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    found = sensitivity(ensemble, name) if found is None else found
    instance("found", found, Mapping, "a dictionary of effects, as sensitivity() gives it")
    for path, effect in found.items():
        instance(f"found[{path!r}]", effect, Effect)
    if not found:
        raise ValueError("found is empty: must have an effect")
    effects = dict(list(found.items())[:_MOST_BARS])
    height = 1.15 + 0.24 * max(len(effects), 2)
    figure, axes = s.panels(1, 2, s.COLUMN, height, sharey=True, width_ratios=(1.7, 1.0))
    share, sign = axes[0]
    figure.suptitle(_title(name, found), fontsize=8.0)
    rows = np.arange(len(effects))
    share.set_yticks(rows, [label(path) for path in effects])
    share.set_ylim(len(effects) - 0.4, -0.6)
    share.set_xlabel("share of variance [1]")
    sign.set_xlabel("rank corr. [1]")
    _shares(share, rows, list(effects.values()))
    values = [effect.rank_correlation for effect in effects.values()]
    sign.barh(rows, values, height=0.08, color=s.RED, linewidth=0.0)
    sign.plot(values, rows, color=s.RED, marker="o", linestyle="")
    sign.axvline(0.0, color=s.BLACK, linewidth=0.6)
    sign.set_xlim(-1.05, 1.05)
    sign.set_xticks([-1, 0, 1])
    for each, letter in ((share, "a"), (sign, "b")):
        each.tick_params(axis="y", length=0.0)
        s.tag(each, letter)
    s.shared_legend(figure, [share], "outside lower center")
    return figure


def _shares(axes: Axes, rows: np.ndarray, effects: list[Effect]) -> None:
    values = np.clip(np.nan_to_num([effect.share for effect in effects]), 0.0, 1.0)
    noise = np.nan_to_num([effect.noise for effect in effects])
    bars: dict[str, Any] = {"linewidth": 0.0}
    axes.barh(rows, values, height=0.62, color=s.BLUE, alpha=0.75, label="first order", **bars)
    axes.barh(rows, noise, height=0.86, color=s.GREY, alpha=0.6, label="by chance (95 %)", **bars)
    top = max(float(values.max()), float(noise.max()), 0.05)
    # Leave room for the numbers to the right of the bars.
    axes.set_xlim(0.0, 1.32 * top)
    for row, value, chance in zip(rows, values, noise, strict=True):
        text = f"{value:.2f}" if value > chance else "noise" if chance > 0.0 else ""
        at, color = max(value, chance) + 0.02 * top, s.BLACK if value > chance else "0.4"
        axes.text(at, row, text, va="center", fontsize=8.0, color=color)


def _title(name: str | Bools, found: Mapping[str, Effect]) -> str:
    runs = next(iter(found.values())).runs
    result = label(name) if isinstance(name, str) else "the given event"
    text = f"what explains: {result} ({runs} runs)"
    if all(np.isnan(effect.share) for effect in found.values()):
        return f"{text}\nit is the same in all runs"
    together = sum(effect.share for effect in found.values() if effect.share > effect.noise)
    rest = "the rest only together, or by chance"
    return f"{text}\nfirst-order shares: {together:.2f} in all; {rest}"


def _legend(figure: Figure, axes: Axes, ax: Axes | None) -> None:
    """Draws the legend above a figure of its own, or inside the user's axes."""
    if ax is not None:
        axes.legend(fontsize="small")
        return
    narrow = {"ncols": 2, "columnspacing": 1.0, "handlelength": 1.8}
    s.shared_legend(figure, [axes], "outside upper left", **narrow)


def _write_message(axes: Axes, text: str) -> None:
    """Writes a text into empty axes that have nothing to draw."""
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, fontsize=8.0)


def success_map(
    ensemble: Results,
    x: str,
    y: str,
    what: str | Bools = "completed",
    bins: int | None = None,
    ax: Axes | None = None,
) -> Figure:
    """The share of runs in which something happened, over two parameters; empty bins stay blank.

    A dot marks each bin of so few runs that the share's 95 % confidence interval (Wilson) is wider
    than 0.4. The axis of a number that was drawn by a LogUniform or LogNormal is logarithmic. The
    title names the contact model and the friction, as `Results.model` does.

    Args:
        x, y: Paths of the parameters on both axes; with an index if the value has several numbers:
            "disturbances.0.force.0".
        what: A status, a violation, "holds", or whether it happened in each run, booleans (runs,).
        bins: Number of bins along each axis; None chooses it by the number of runs.
        ax: The axes to draw on, with the scale of the colours beside them.
    """
    instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    across = shown(number(ensemble, x, "x"))
    up = shown(number(ensemble, y, "y"))
    name = f": {words(what)}" if isinstance(what, str) else ""
    kept = np.isfinite(across.values) & np.isfinite(up.values)
    u, v, happened = across.values[kept], up.values[kept], event(ensemble, what)[kept]
    if bins is None:
        bins = int(np.clip(np.sqrt(len(u) / 12), 3, 30))
    bins = integer("bins", bins, 1, _MOST_BINS)
    magnitude = [drawn_by_magnitude(ensemble, path) for path in (x, y)]
    with s.one_panel(ax, s.COLUMN, 2.9) as (figure, each):
        each.set(xlabel=label(x, across.unit), ylabel=label(y, up.unit))
        if not len(u):
            each.set_title(ensemble.model, fontsize=8.0, pad=3.0)
            _write_message(each, "no run has finite values")
            return figure
        all_runs, some, edges, middles = _counts(u, v, happened, bins, magnitude)
        blank = np.full(some.shape, np.nan)
        share = np.ma.masked_invalid(np.divide(some, all_runs, out=blank, where=all_runs > 0))
        # Colour limits are multiples of 0.1, so that a single run does not change all colours.
        low, high = np.floor(10 * share.min()) / 10, np.ceil(10 * share.max()) / 10
        if high - low < 0.1:
            low, high = max(0.0, low - 0.1), min(1.0, high + 0.1)
        each.set_facecolor("white")
        for which, logarithmic, ends in zip("xy", magnitude, edges, strict=True):
            if logarithmic:
                s.by_magnitude(each, which, ends[0], ends[-1])
        mesh = s.color_cells(each, edges, share, low, high)
        vague = (all_runs > 0) & (_reach(some, all_runs) > _WIDE)
        k, m = np.nonzero(vague)
        each.plot(middles[0][k], middles[1][m], **_DOTS)
        s.colorbar(figure, mesh, each, f"share of runs{name} [1]")
        filled = all_runs[all_runs > 0]
        empty = int((all_runs == 0).sum())
        text = f"{ensemble.model}\n{len(u)} runs, {np.median(filled):.0f} in the median bin"
        text += f"; {empty} bins empty" if empty else ""
        if vague.any():
            text += f"\n95 % interval: wider than {2.0 * _WIDE:g} at dots"
        each.set_title(text, fontsize=8.0, pad=3.0)
        return figure


def _counts(
    u: Floats, v: Floats, happened: Bools, bins: int, magnitude: Sequence[bool]
) -> tuple[Floats, Floats, list[Floats], list[Floats]]:
    """Runs and events in each bin (bins, bins), and edges and middles along each axis."""
    u, v = (np.log10(w) if log else w for w, log in zip((u, v), magnitude, strict=True))
    runs, *edges = np.histogram2d(u, v, bins)
    some = np.histogram2d(u[happened], v[happened], edges)[0]
    middles = [0.5 * (each[:-1] + each[1:]) for each in edges]
    edges, middles = (
        [10.0**w if log else w for w, log in zip(values, magnitude, strict=True)]
        for values in (edges, middles)
    )
    return runs, some, edges, middles


def _reach(some: Floats, runs: Floats) -> Floats:
    """Half of the 95 % confidence interval's width in each bin (k, m)."""
    bins = np.column_stack([some.ravel(), runs.ravel()])
    pairs, which = np.unique(bins, axis=0, return_inverse=True)
    halves = [Estimate.counted(int(k), int(n)).half_width for k, n in pairs]
    return np.array(halves)[which.ravel()].reshape(runs.shape)
