"""The map of a study's shares over two parameters, public as `softpinch.plot.success_map`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..study.columns import finite
from ..study.estimates import Estimate
from ..study.labels import label, shown, words
from ..study.results import Results
from ..study.run_table import booleans, drawn_by_magnitude, number
from ..support.arrays import Floats
from ..support.checks import integer
from .ensemble_plot import MOST_BINS, refuse_other_results, write_message
from .style import BLACK, COLUMN, by_magnitude, one_panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# A bin is marked if half of its 95 % confidence interval is larger; lines are at all of these.
_LEVELS = (0.05, 0.1, 0.2)
_WIDE = _LEVELS[-1]


def success_map(
    ensemble: Results,
    x: str,
    y: str,
    what: str | NDArray[np.bool_] = "completed",
    bins: int | None = None,
    ax: Axes | None = None,
) -> Figure:
    """The share of runs in which something happened, over two parameters; empty bins stay blank.

    Lines show where few runs are: along them the share's 95 % confidence interval (Wilson) reaches
    0.05, 0.1 and 0.2 to both sides. They are drawn over at least 2 x 2 bins, where the map has such
    values, through averages over adjacent bins; without a run the interval is from 0 to 1. A dot
    marks each bin whose own interval is wider than 0.4, also where no line can be drawn.
    The axis of a number that was drawn by a LogUniform or LogNormal is logarithmic. The title names
    the contact model and the friction, as `Results.model` does.

    Args:
        ensemble: The ensemble or study.
        x: Path of the parameter on the horizontal axis; with an index if the value has several
            numbers: "disturbances.0.force.0".
        y: Path of the parameter on the vertical axis.
        what: A status, a violation, "holds", or whether it happened in each run, booleans (runs,).
        bins: Number of bins along each axis; None chooses it by the number of runs.
        ax: The axes to draw on, beside which the scale of the colours is placed; None makes a
            figure.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: A summary was not computed, a name is unknown or stands for several numbers,
            `what` is "slipping" and no run has a coefficient of friction, or `bins` is not from 1
            to 10 000.
        ImportError: matplotlib is not installed.
    """
    refuse_other_results(ensemble)
    across = shown(number(ensemble, x, "x"))
    up = shown(number(ensemble, y, "y"))
    if isinstance(what, str):
        happened, share_of = ensemble.happened(what), f"share of runs: {words(what)} [1]"
    else:
        happened, share_of = booleans("what", what, ensemble.runs), "share of runs [1]"
    kept = finite(across.values, up.values)
    u, v, happened = across.values[kept], up.values[kept], happened[kept]
    if bins is None:
        bins = int(np.clip(np.sqrt(len(u) / 12), 3, 30))
    bins = integer("bins", bins, 1, MOST_BINS)
    magnitude = [drawn_by_magnitude(ensemble, name) for name in (x, y)]
    with one_panel(ax, COLUMN, 2.9) as (figure, each):
        each.set_xlabel(label(x, across.unit))
        each.set_ylabel(label(y, up.unit))
        if not len(u):
            each.set_title(ensemble.model, fontsize=8.0, pad=3.0)
            write_message(each, "no run has finite values")
            return figure
        all_runs, some, left, bottom = _counts(u, v, happened, bins, magnitude)
        share = np.ma.masked_invalid(
            np.divide(some, all_runs, out=np.full(some.shape, np.nan), where=all_runs > 0)
        )
        # Colour limits are multiples of 0.1, so that a single run does not change all colours.
        low, high = np.floor(10 * share.min()) / 10, np.ceil(10 * share.max()) / 10
        if high - low < 0.1:
            low, high = max(0.0, low - 0.1), min(1.0, high + 0.1)
        mesh = each.pcolormesh(
            left, bottom, share.T, cmap="cividis", vmin=low, vmax=high, rasterized=True
        )
        each.set_facecolor("white")
        for which, logarithmic, edges in zip("xy", magnitude, (left, bottom), strict=True):
            if logarithmic:
                by_magnitude(each, which, edges[0], edges[-1])
        each.set_xlim(left[0], left[-1])
        each.set_ylim(bottom[0], bottom[-1])
        reach = _reach(some, all_runs)
        middles = _middles((left, bottom), magnitude)
        lines = _lines(each, middles, reach)
        vague = (all_runs > 0) & (reach > _WIDE)
        _dots(each, middles, vague)
        bar = figure.colorbar(mesh, ax=each, pad=0.02)
        bar.set_label(share_of)
        bar.outline.set_linewidth(0.6)
        filled = all_runs[all_runs > 0]
        blank = int((all_runs == 0).sum())
        text = f"{ensemble.model}\n{len(u)} runs, {np.median(filled):.0f} in the median bin"
        text += f"; {blank} bins empty" if blank else ""
        keys = ["\u00b1 at lines"] if lines else []
        keys += [f"wider than {2.0 * _WIDE:g} at dots"] if vague.any() else []
        if keys:
            text += f"\n95 % interval: {', '.join(keys)}"
        each.set_title(text, fontsize=8.0, pad=3.0)
        return figure


def _counts(
    u: Floats, v: Floats, happened: NDArray[np.bool_], bins: int, magnitude: Sequence[bool]
) -> tuple[Floats, Floats, Floats, Floats]:
    """Runs and events in each bin (bins, bins), and the edges of the bins along each axis.

    Bins of a logarithmic axis have equal ratios.
    """
    u, v = (np.log10(w) if log else w for w, log in zip((u, v), magnitude, strict=True))
    runs, left, bottom = np.histogram2d(u, v, bins)
    some = np.histogram2d(u[happened], v[happened], (left, bottom))[0]
    edges = [10.0**w if log else w for w, log in zip((left, bottom), magnitude, strict=True)]
    return runs, some, edges[0], edges[1]


def _reach(some: Floats, runs: Floats) -> Floats:
    """Half of the 95 % confidence interval's width in each bin (k, m)."""
    pairs, which = np.unique(
        np.column_stack([some.ravel(), runs.ravel()]), axis=0, return_inverse=True
    )
    halves = [Estimate.counted(int(k), int(n)).half_width for k, n in pairs]
    return np.array(halves)[which.ravel()].reshape(runs.shape)


def _middles(edges: Sequence[Floats], magnitude: Sequence[bool]) -> list[Floats]:
    """The middles of the bins along each axis, geometric ones on a logarithmic axis."""
    return [
        np.sqrt(each[:-1] * each[1:]) if log else 0.5 * (each[:-1] + each[1:])
        for each, log in zip(edges, magnitude, strict=True)
    ]


def _averaged(values: Floats) -> Floats:
    """Averages over adjacent bins, weighted 1, 2, 1 along each axis; a border repeats its bins.

    A line through the bins' own values would follow their random counts.
    """
    for _ in values.shape:
        padded = np.pad(values, ((1, 1), (0, 0)), "edge")
        values = (0.25 * (padded[:-2] + padded[2:]) + 0.5 * values).T
    return values


def _lines(axes: Axes, middles: Sequence[Floats], reach: Floats) -> bool:
    """Draws lines of equal half width, one label for each level; returns whether there are any."""
    from matplotlib.patheffects import withStroke

    smooth = _averaged(reach)
    levels = [level for level in _LEVELS if smooth.min() < level < smooth.max()]
    if min(reach.shape) < 2 or not levels:
        return False
    drawn = axes.contour(*middles, smooth.T, levels, colors="white", linewidths=0.9)
    # White on black is visible on every colour of the map, and in grey.
    drawn.set_path_effects([withStroke(linewidth=1.9, foreground=BLACK)])
    # One label for each level, at different shares of the lines, so that they keep apart.
    longest = [max(parts, key=len) for parts in drawn.allsegs]
    places = [part[len(part) * (k + 1) // 4] for k, part in enumerate(longest)]
    for text in drawn.clabel(fmt="\u00b1%g", fontsize=7.0, colors=BLACK, manual=places):
        text.set_path_effects([withStroke(linewidth=1.8, foreground="white")])
        text.set_clip_on(False)
    return True


def _dots(axes: Axes, middles: Sequence[Floats], vague: NDArray[np.bool_]) -> None:
    """Draws a dot in the middle of some bins."""
    k, m = np.nonzero(vague)
    axes.plot(
        middles[0][k], middles[1][m], "o", markersize=2.0, markerfacecolor="white",
        markeredgecolor=BLACK, markeredgewidth=0.4,
    )  # fmt: skip
