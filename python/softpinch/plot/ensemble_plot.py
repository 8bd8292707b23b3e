"""Figures of ensembles and studies, public as `softpinch.plot.histogram` and so on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..scene.scene import State
from ..study.columns import finite
from ..study.effects import Effect, sensitivity
from ..study.estimates import Estimate
from ..study.labels import label, shown, words
from ..study.results import Results
from ..study.run_table import drawn_by_magnitude, number
from ..support.arrays import Floats
from ..support.checks import instance, integer
from .style import BLACK, BLUE, COLUMN, GREY, LINES, RED, by_magnitude, new, one_panel, styled, tag

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# `importance` shows at most this many parameters, the most important ones.
_MOST_BARS = 12
# No printer resolves more bins.
MOST_BINS = 10_000


def histogram(
    ensemble: Results, name: str, bins: int | None = None, ax: Axes | None = None
) -> Figure:
    """Histogram of a number over the runs: completed runs, and runs that ended early on top.

    The axis is logarithmic if all numbers are positive and span more than two decades, or if the
    number was drawn by a LogUniform or LogNormal. Numbers that are not finite are left out, and the
    figure says how many.

    Args:
        ensemble: The ensemble or study.
        name: A summary, a component of one ("final_state.theta"), a path or "failure_time".
        bins: Number of bins; None chooses it by the number of runs.
        ax: The axes to draw on; None makes a figure.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: The summary was not computed, the name is unknown or stands for several numbers,
            or `bins` is not from 1 to 10 000.
        ImportError: matplotlib is not installed.
    """
    refuse_other_results(ensemble)
    column = shown(number(ensemble, name))
    values, kept = column.values, finite(column.values)
    completed = (ensemble.status == "completed")[kept]
    values = values[kept]
    count = _bins(len(values)) if bins is None else integer("bins", bins, 1, MOST_BINS)
    with one_panel(ax, COLUMN, 2.5) as (figure, each):
        each.set_xlabel(label(name, column.unit))
        each.set_ylabel("runs in the bin")
        if len(values):
            least = 1.0 if drawn_by_magnitude(ensemble, name) else 100.0
            if values.min() > 0.0 and values.max() > least * values.min():
                edges = np.geomspace(values.min(), values.max(), count + 1)
                by_magnitude(each, "x", edges[0], edges[-1])
            else:
                edges = np.histogram_bin_edges(values, count)
            heights = _bars(each, edges, values, completed)
            _quantiles(each, values)
            each.set_xlim(edges[0], edges[-1])
            each.set_ylim(0.0, 1.08 * max(heights))
            _legend(figure, each, ax)
        else:
            write_message(each, "no run has a finite value")
        left_out = ensemble.runs - len(values)
        if left_out and len(values):
            _corner(each, f"{left_out} of {ensemble.runs} runs without a finite value")
        return figure


def refuse_other_results(ensemble: object) -> None:
    """Refuses anything but the results of many runs."""
    instance("ensemble", ensemble, Results, "an Ensemble or a Study")


def _bins(n: int) -> int:
    """The number of bins for n values: Rice's rule, within the resolution of a narrow figure."""
    return int(np.clip(np.ceil(2.0 * n ** (1 / 3)), 5, 60))


def _bars(axes: Axes, edges: Floats, values: Floats, completed: np.ndarray) -> list[float]:
    """Draws stacked bars of completed and other runs, and returns their total heights."""
    done = np.histogram(values[completed], edges)[0]
    lost = np.histogram(values[~completed], edges)[0]
    if completed.any():
        name = f"completed ({np.count_nonzero(completed)})"
        axes.stairs(done, edges, fill=True, color=BLUE, alpha=0.55, linewidth=0.0, label=name)
    if not completed.all():
        name = f"ended early ({np.count_nonzero(~completed)})"
        hatched: dict[str, Any] = {
            "facecolor": "white",
            "edgecolor": RED,
            "hatch": "//////",
            "linewidth": 0.0,
        }
        axes.stairs(done + lost, edges, baseline=done, fill=True, label=name, **hatched)
    axes.stairs(done + lost, edges, color=BLACK, linewidth=0.6)
    return [float(height) for height in done + lost]


def _quantiles(axes: Axes, values: Floats) -> None:
    """Draws the median, and the 5 % and 95 % quantiles, as lines."""
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    axes.axvline(middle, color=BLACK, linewidth=1.0, label="median")
    style: dict[str, Any] = {"color": BLACK, "linewidth": 0.8, "linestyle": (0, (3, 2))}
    axes.axvline(low, **style, label="5 % and 95 %")
    axes.axvline(high, **style)


def failure_times(ensemble: Results, ax: Axes | None = None) -> Figure:
    """The share of runs that had ended early by each instant, for each status and in total.

    Args:
        ensemble: The ensemble or study.
        ax: The axes to draw on; None makes a figure.

    Raises:
        TypeError: `ensemble` is neither an Ensemble nor a Study, or `ax` are no axes.
        ImportError: matplotlib is not installed.
    """
    refuse_other_results(ensemble)
    counts = {name: n for name, n in ensemble.counts().items() if name != "completed"}
    lost = sum(counts.values())
    never = ensemble.runs - lost
    with one_panel(ax, COLUMN, 2.5) as (figure, each):
        each.set_xlabel("time [s]")
        each.set_ylabel("share of runs ended early [1]")
        start, end = _spanned(ensemble)
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
            write_message(
                each,
                f"none of {ensemble.runs} runs ended early:\n"
                f"the probability is below {most:.2g} (95 %)",
            )
            each.set_ylim(0.0, 1.0)
            return figure
        entries = list(counts) if len(counts) == 1 else [*counts, "all"]
        for k, status in enumerate(entries):
            some = np.isfinite(ensemble.failure_time)
            if status != "all":
                some &= ensemble.status == status
            times = np.sort(ensemble.failure_time[some])
            share = np.arange(1, len(times) + 1) / ensemble.runs
            style = {"color": BLACK, "linewidth": 0.7} if status == "all" else LINES[k % len(LINES)]
            each.step(
                np.concatenate([[start], times, [end]]),
                np.concatenate([[0.0], share, share[-1:]]),
                where="post",
                label=f"{words(status)} ({len(times)})",
                **style,
            )
        each.set_ylim(0.0, 1.1 * lost / ensemble.runs)
        each.plot([], [], " ", label=f"never ({never} of {ensemble.runs})")
        _legend(figure, each, ax)
        return figure


def _spanned(ensemble: Results) -> tuple[float, float]:
    """The first and the last instant of any run, s.

    They come from the runs' values, because the shared scene may not have a valid start: for
    example, its width may be a placeholder that every run replaces.
    """
    initial = ensemble.scene.initial
    shared = initial.time if isinstance(initial, State) else 0.0
    if not ensemble.runs:
        return shared, shared + ensemble.scene.duration
    start = np.min(ensemble.parameters.get("initial.time", shared))
    return float(start), float(ensemble.end_time.max())


def importance(
    ensemble: Results,
    name: str | NDArray[np.bool_] = "completed",
    found: Mapping[str, Effect] | None = None,
) -> Figure:
    """The importance of each parameter: the share of a result's variance that it explains alone.

    The left panel has the first-order shares of `sensitivity`; grey bars are the noise level, below
    which 95 % of randomly shuffled results stay. The right panel has the rank correlation, whose
    sign is the direction of the effect. The twelve largest shares are shown.

    Args:
        ensemble: The ensemble or study.
        name: A summary or a component of one, a status ("completed"), a violation, "holds", or
            whether something happened in each run, booleans (runs,).
        found: The result of `sensitivity` for this name, if it has been computed already.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: The summary was not computed, the name is unknown or stands for several numbers,
            or nothing was varied.
        ImportError: matplotlib is not installed.
    """
    refuse_other_results(ensemble)
    found = sensitivity(ensemble, name) if found is None else found
    instance("found", found, Mapping, "a dictionary of effects, as sensitivity() gives it")
    for path, effect in found.items():
        instance(f"found[{path!r}]", effect, Effect)
    if not found:
        raise ValueError("found is empty: must have an effect")
    effects = dict(list(found.items())[:_MOST_BARS])
    with styled():
        height = 1.15 + 0.24 * max(len(effects), 2)
        figure = new(COLUMN, height)
        share, sign = figure.subplots(1, 2, sharey=True, width_ratios=(1.7, 1.0))
        figure.suptitle(_title(name, found), fontsize=8.0)
        rows = np.arange(len(effects))
        share.set_yticks(rows, [label(path) for path in effects])
        share.set_ylim(len(effects) - 0.4, -0.6)
        share.tick_params(axis="y", length=0.0)
        sign.tick_params(axis="y", length=0.0)
        share.set_xlabel("share of variance [1]")
        sign.set_xlabel("rank corr. [1]")
        _shares(share, rows, list(effects.values()))
        values = [effect.rank_correlation for effect in effects.values()]
        sign.barh(rows, values, height=0.08, color=RED, linewidth=0.0)
        sign.plot(values, rows, color=RED, marker="o", linestyle="")
        sign.axvline(0.0, color=BLACK, linewidth=0.6)
        sign.set_xlim(-1.05, 1.05)
        sign.set_xticks([-1, 0, 1])
        tag(share, "a")
        tag(sign, "b")
        figure.legend(*share.get_legend_handles_labels(), loc="outside lower center", ncols=2)
        return figure


def _shares(axes: Axes, rows: np.ndarray, effects: list[Effect]) -> None:
    """Draws bars of the shares, and grey bars of the noise level."""
    values = np.clip(np.nan_to_num([effect.share for effect in effects]), 0.0, 1.0)
    noise = np.nan_to_num([effect.noise for effect in effects])
    blue: dict[str, Any] = {"color": BLUE, "alpha": 0.75}
    grey: dict[str, Any] = {"color": GREY, "alpha": 0.6}
    axes.barh(rows, values, height=0.62, linewidth=0.0, label="first order", **blue)
    axes.barh(rows, noise, height=0.86, linewidth=0.0, label="by chance (95 %)", **grey)
    top = max(float(values.max()), float(noise.max()), 0.05)
    # Leave room for the numbers to the right of the bars.
    axes.set_xlim(0.0, 1.32 * top)
    for row, value, chance in zip(rows, values, noise, strict=True):
        text = f"{value:.2f}" if value > chance else "noise" if chance > 0.0 else ""
        at = max(value, chance) + 0.02 * top
        axes.text(
            at, row, text, va="center", fontsize=8.0, color=BLACK if value > chance else "0.4"
        )


def _title(name: str | NDArray[np.bool_], found: Mapping[str, Effect]) -> str:
    runs = next(iter(found.values())).runs
    result = label(name) if isinstance(name, str) else "the given event"
    text = f"what explains: {result} ({runs} runs)"
    if all(np.isnan(effect.share) for effect in found.values()):
        return f"{text}\nit is the same in all runs"
    together = sum(effect.share for effect in found.values() if effect.share > effect.noise)
    return (
        f"{text}\nfirst-order shares: {together:.2f} in all; the rest only together, or by chance"
    )


def _legend(figure: Figure, axes: Axes, ax: Axes | None) -> None:
    """Draws the legend above a figure of its own, or inside the user's axes."""
    if ax is not None:
        axes.legend(fontsize="small")
        return
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=2, columnspacing=1.0, handlelength=1.8
    )


def write_message(axes: Axes, text: str) -> None:
    """Writes a text into empty axes that have nothing to draw."""
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, fontsize=8.0)


def _corner(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=8.0, loc="right", pad=3.0)
