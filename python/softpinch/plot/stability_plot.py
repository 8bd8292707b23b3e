"""The figure of a stability map, public as `softpinch.plot.stability_map`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import _core
from ..accuracy.stability_maps import NO_REFERENCE, NOT_RUN, StabilityMap
from ..scene.fields import words
from ..support import checks
from ..support.arrays import Floats
from .style import (
    BLACK,
    COLUMN,
    PAGE,
    RED,
    cell_edges,
    cell_patch,
    colorbar,
    fill_cells,
    panels_or_given,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colour range of errors, as powers of ten: from round-off to a coordinate's whole magnitude.
_BEST, _WORST = -12, 0
# A perceptually uniform colour map, for every colour vision and in grey.
_COLORS = "cividis"
# Gap between zero and the smallest other value on a logarithmic axis, as a share of the other
# cells' width.
_TO_ZERO = 0.06
# Face colour and hatch of each kind of cell without an error, distinct in grey too.
_ENDED = "ends early, as it should"
_MISSED = "completes, should not"
_KINDS: dict[str, tuple[str, str]] = {
    _ENDED: ("#A6D5BC", ""),
    _MISSED: ("#E69F00", "xxxx"),
    "separated": ("#F6D5C3", "////"),
    "crushed": ("#E4C3DA", "\\\\\\\\"),
    "folded": ("#BFDDF0", "----"),
    "not_finite": ("#606060", ""),
    "unstable": ("#606060", "...."),
    "newton_failed": ("#B4B4B4", "||||"),
    "step_too_small": ("#B4B4B4", "++"),
    NO_REFERENCE: ("#FFFFFF", "xx"),
    NOT_RUN: ("#FFFFFF", ""),
}


class _Grid(NamedTuple):
    """Positions of the cells: horizontally on the axis' scale, vertically in powers of ten.

    They are the horizontal centres (v,), left and right edges (v, 2), and vertical edges (d + 1,).
    """

    across: Floats
    left: Floats
    up: Floats


def stability_map(map: StabilityMap, ax: Axes | None = None) -> Figure:
    """Panels of steps over the map's axis, one for each formulation (row) and method (column).

    The colour of a cell is the error at the end. Cells without an error show by face colour and
    hatch how the run ended. Dots mark runs that complete with an error above 0.1. The line is the
    longest stable step that the eigenvalues predict.

    Args:
        map: The map.
        ax: The axes to draw a single pair on, with the scale of colours beside it and the legend
            below it; None makes a figure.

    Raises:
        ValueError: `ax` is given, and the map has several formulations or methods.
    """
    checks.instance("map", map, StabilityMap)
    rows = [name for name in _core.FORMULATIONS if name in {pair[0] for pair in map.pairs}]
    columns = [name for name in _core.METHODS if name in {pair[1] for pair in map.pairs}]
    grid = _grid(map)
    kinds = _kinds(map)
    width = PAGE if len(columns) > 2 else COLUMN
    height = 1.25 * len(rows) + 1.25
    grid_of = panels_or_given(ax, len(rows), len(columns), width, height, sharex=True, sharey=True)
    with grid_of as (figure, axes):
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        if ax is None:
            # The panels share their scales, so they need little space between them.
            spaces = {"w_pad": 0.02, "h_pad": 0.02, "wspace": 0.02, "hspace": 0.02}
            figure.set_layout_engine("constrained", **spaces)
        for (i, row), (j, column) in itertools.product(enumerate(rows), enumerate(columns)):
            each: Axes = axes[i, j]
            if i == 0:
                each.set_title(words(column), pad=3.0)
            if j == len(columns) - 1:
                each.annotate(
                    words(row), (1.0, 0.5), (4.0, 0.0), "axes fraction", "offset points",
                    rotation=-90, ha="left", va="center",
                )  # fmt: skip
            if (row, column) not in map.pairs:
                each.text(0.5, 0.5, "not asked for", ha="center", va="center", fontsize=8.0,
                          transform=each.transAxes)  # fmt: skip
                continue
            k = map.pairs.index((row, column))
            _errors(each, map, k, grid)
            fill_cells(each, kinds[k], grid.left, grid.up, _KINDS)
            _marks(each, map, k, grid)
            _boundary(each, map.predicted[k], grid)
        _scales(axes[0, 0], map, grid)
        across, up = f"{map.label} [{map.unit}]", "step $dt$ [s]"
        if axes.size > 1:
            figure.supxlabel(across, fontsize=9.0)
            figure.supylabel(up, fontsize=9.0)
        else:
            axes[0, 0].set_xlabel(across)
            axes[0, 0].set_ylabel(up)
        colors = ScalarMappable(Normalize(_BEST, _WORST), _COLORS)
        options = {"pad": 0.01, "aspect": 40, "extend": "both", "fraction": 0.04}
        bar = colorbar(figure, colors, axes, "error at the end [1]", **options)
        ticks = range(_BEST, _WORST + 1, 3)
        bar.set_ticks(list(ticks), labels=[_power(k) for k in ticks])
        entries = {"handles": list(_legend(kinds, map)), "handlelength": 1.8, "columnspacing": 1.4}
        if ax is None:
            columns_of_it = 5 if width == PAGE else 2
            figure.legend(**entries, loc="outside upper center", ncols=columns_of_it)
        else:
            # A legend inside would hide cells.
            ax.legend(**entries, loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize="small")
        return figure


def _grid(map: StabilityMap) -> _Grid:
    across = _position(map.scale, map.values)
    halves = np.diff(across) / 2
    if map.scale == "log" and map.values[0] == 0.0:
        # Zero has no logarithm, so its cell is placed to the left, separated by a gap.
        wide = halves[1] if len(halves) > 1 else 0.5
        gap = _TO_ZERO * (across[-1] - across[1] + wide) if len(across) > 1 else 0.0
        across[0] = across[1] - 2 * wide - gap if len(across) > 1 else 0.0
        halves[:1] = wide
    ends = halves if len(halves) else np.array([0.5])
    left = across - np.concatenate([ends[:1], halves])
    right = across + np.concatenate([halves, ends[-1:]])
    up = cell_edges(np.log10(map.dt))
    return _Grid(across, np.column_stack([left, right]), up)


def _position(scale: str, values: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        if scale == "log":
            return np.asarray(np.log10(values))
        if scale == "logit":
            return np.asarray(np.log10(values / (1.0 - values)))
        if scale == "right_angle":
            return np.asarray(-np.log10(90.0 - values))
    return np.array(values)


def _kinds(map: StabilityMap) -> np.ndarray:
    """Kind of each cell (pairs, v, d): a key of `_KINDS`, or "" if it shows an error's colour."""
    kinds = map.status.astype("U40")
    expected = np.broadcast_to(map.expected[:, None], map.status.shape)
    completed = map.status == "completed"
    kinds[completed & (expected == "completed")] = ""
    kinds[completed & (expected != "completed")] = _MISSED
    kinds[map.agrees & ~completed] = _ENDED
    kinds[(expected == NO_REFERENCE) & (map.status != NOT_RUN)] = NO_REFERENCE
    return kinds


def _errors(axes: Axes, map: StabilityMap, k: int, grid: _Grid) -> None:
    """Draws the colours of one pair's errors."""
    with np.errstate(divide="ignore"):
        powers = np.log10(map.error[k])
    powers = np.ma.masked_invalid(np.where(map.error[k] == 0.0, _BEST, powers))
    for v in range(len(map.values)):
        axes.pcolormesh(
            grid.left[v], grid.up, powers[v : v + 1].T, cmap=_COLORS, vmin=_BEST, vmax=_WORST,
            rasterized=True,
        )  # fmt: skip


def _marks(axes: Axes, map: StabilityMap, k: int, grid: _Grid) -> None:
    """Marks the runs of one pair that complete with an error above 0.1."""
    middles = 0.5 * (grid.up[1:] + grid.up[:-1])
    v, d = np.nonzero(map.misleading()[k] & (map.expected == "completed")[:, None])
    axes.plot(grid.across[v], middles[d], linestyle="", **_DOT)


def _boundary(axes: Axes, predicted: Floats, grid: _Grid) -> None:
    """Draws the predicted longest step through the cells' centres, as white on black line."""
    steps = np.log10(np.where((predicted > 0.0) & np.isfinite(predicted), predicted, np.nan))
    across = grid.across
    if len(across) == 1 or grid.left[0, 1] < grid.left[1, 0] - 1e-9 * np.ptp(across):
        # An isolated cell, such as that of zero on a logarithmic axis, has its own line.
        across = np.concatenate([grid.left[0], [np.nan], across[1:]])
        steps = np.concatenate([steps[[0, 0]], [np.nan], steps[1:]])
    for style in _LINES:
        axes.plot(across, steps, **style)


# Candidate ticks of the nonlinear scales.
_TICKS = {"logit": (1e-4, 1e-2, 0.5, 0.99), "right_angle": (0.0, 80.0, 89.0)}
_DOT: dict[str, Any] = {"marker": "o", "markersize": 2.2, "color": RED, "markeredgewidth": 0.0}
_LINES: tuple[dict[str, Any], ...] = (
    {"color": BLACK, "linewidth": 2.2, "zorder": 3.0, "solid_capstyle": "butt"},
    {"color": "white", "linewidth": 1.0, "zorder": 3.1, "solid_capstyle": "butt"},
)


def _scales(axes: Axes, map: StabilityMap, grid: _Grid) -> None:
    """Sets ticks and limits, which all panels share."""
    axes.set_xlim(grid.left.min(), grid.left.max())
    axes.set_ylim(grid.up[0], grid.up[-1])
    powers = _whole(grid.up[0], grid.up[-1], 4)
    axes.set_yticks(powers, [_power(k) for k in powers])
    if map.scale == "linear":
        axes.locator_params(axis="x", nbins=3)
        return
    zero = map.scale == "log" and map.values[0] == 0.0
    low, high = grid.across[int(zero)] if len(grid.across) > int(zero) else 0.0, grid.across[-1]
    places = _whole(low, high, 3)
    labels = [_power(k) for k in places]
    if map.scale in _TICKS:
        ticks = [tick for tick in _TICKS[map.scale] if map.values[0] <= tick <= map.values[-1]]
        places = _position(map.scale, np.array(ticks)).tolist()
        plain = [tick == 0.0 or tick > 0.1 for tick in ticks]
        labels = [
            f"{tick:g}" if short else _power(math.log10(tick))
            for tick, short in zip(ticks, plain, strict=True)
        ]
    if zero:
        # The tick next to zero is left out, as there is no room for it.
        places, labels = [float(grid.across[0]), *places[1:]], ["0", *labels[1:]]
    axes.set_xticks(places, labels)


def _whole(low: float, high: float, most: int) -> list[float]:
    """Evenly spaced whole numbers from `low` to `high`, at most `most`; their middle if none."""
    first, last = math.ceil(low - 1e-9), math.floor(high + 1e-9)
    stride = max(1, math.ceil((last - first + 1) / most))
    return [float(k) for k in range(first, last + 1, stride)] or [0.5 * (low + high)]


def _power(k: float) -> str:
    return f"$10^{{{k:g}}}$"


def _legend(kinds: np.ndarray, map: StabilityMap) -> Iterator[Any]:
    from matplotlib.lines import Line2D

    if np.isfinite(map.predicted).any():
        yield Line2D([], [], **{**_LINES[1], "color": BLACK}, label="predicted longest step")
    if map.misleading().any():
        yield Line2D([], [], linestyle="", **_DOT, label="completes, error above 0.1")
    seen = set(kinds.ravel().tolist())
    for kind, face in _KINDS.items():
        if kind in seen:
            yield cell_patch(face, words(kind))
