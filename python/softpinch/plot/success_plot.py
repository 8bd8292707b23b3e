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

# A bin is marked if its 95 % confidence interval is wider.
_WIDE = 0.4


def success_map(
    ensemble: Results,
    x: str,
    y: str,
    what: str | NDArray[np.bool_] = "completed",
    bins: int | None = None,
    ax: Axes | None = None,
) -> Figure:
    """The share of runs in which something happened, over two parameters; empty bins stay blank.

    A dot marks a bin with so few runs that the share's 95 % confidence interval is wider than 0.4.
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
        vague = _vague(some, all_runs)
        _dots(each, left, bottom, vague, magnitude)
        bar = figure.colorbar(mesh, ax=each, pad=0.02)
        bar.set_label(share_of)
        bar.outline.set_linewidth(0.6)
        filled = all_runs[all_runs > 0]
        blank = int((all_runs == 0).sum())
        text = f"{ensemble.model}\n{len(u)} runs, {np.median(filled):.0f} in the median bin"
        text += f"; {blank} bins empty" if blank else ""
        if vague.any():
            text += f"\ndots: 95 % interval wider than {_WIDE:g}"
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


def _vague(some: Floats, runs: Floats) -> NDArray[np.bool_]:
    """Whether each bin has runs, but too few."""
    pairs, which = np.unique(
        np.column_stack([some.ravel(), runs.ravel()]), axis=0, return_inverse=True
    )
    wide = [n > 0 and 2.0 * Estimate.counted(int(k), int(n)).half_width > _WIDE for k, n in pairs]
    return np.array(wide)[which.ravel()].reshape(runs.shape)


def _dots(
    axes: Axes, left: Floats, bottom: Floats, vague: NDArray[np.bool_], magnitude: Sequence[bool]
) -> None:
    """Draws a dot in the middle of some bins."""
    middles = []
    for edges, log in zip((left, bottom), magnitude, strict=True):
        low, high = edges[:-1], edges[1:]
        middles.append(np.sqrt(low * high) if log else 0.5 * (low + high))
    k, m = np.nonzero(vague)
    axes.plot(
        middles[0][k], middles[1][m], "o", markersize=2.0, markerfacecolor="white",
        markeredgecolor=BLACK, markeredgewidth=0.4,
    )  # fmt: skip
