"""The figure of a map of equilibria, public as `softpinch.plot.equilibria`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..analysis.equilibrium_maps import EquilibriumMap
from ..scene.friction import coefficients
from ..study.columns import Column
from ..study.labels import label, shown, words
from ..support import checks
from ..support.arrays import Floats
from .style import (
    BLACK,
    BLUE,
    DEG,
    GREEN,
    GREY,
    MM,
    PAGE,
    RED,
    constant_limits,
    panels,
    styled,
    tag,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colour maps for every colour vision: a perceptually uniform one, legible in grey too, and for
# values with a sign one whose middle, white, is zero.
_COLORS, _SIGNED = "cividis", "PRGn"
_UNSTABLE = (0, (3.0, 1.6))
# Face colour and hatch of cells without equilibrium, distinct in grey too.
_FACES: dict[str, tuple[str, str]] = {
    "apart": ("#FFFFFF", "///"),
    "overloaded": ("#E4C3DA", "\\\\\\"),
    "separated": ("#F6D5C3", "////"),
    "crushed": ("#D9CFA8", "xxx"),
    "folded": ("#BFDDF0", "---"),
    "pulling": ("#F7F2BF", "|||"),
    "slipping": ("#C9E5D8", "+++"),
    "off_face": ("#CFCFCF", "ooo"),
    "not_found": ("#B4B4B4", "xx"),
}
# The name of a panel whose values have a sign.
_MARGIN = "margin of friction [1]"
# Smaller differences, in the units of the panels or as a share of the values, are round-off.
_ROUND_OFF = 1e-7
Line = dict[str, Any]
# The right line is wider, so that it shows below the left one where both are equal.
_RIGHT: Line = {"color": BLUE, "linewidth": 1.8}
_LEFT: Line = {
    "color": RED,
    "linewidth": 0.8,
    "marker": "o",
    "markersize": 2.4,
    "markeredgewidth": 0.0,
}


class _Curve(NamedTuple):
    """A line of a panel: its values over the axis, its style, and its name if it needs one."""

    values: Floats
    style: Line
    name: str = ""


def equilibria(map: EquilibriumMap) -> Figure:
    """Where the grasp rests over the axes of a map, how stiff it is, and whether it is stable.

    Over one axis: rotation and height of the object, its stiffness with the fingers held, the
    friction that both contacts need (a grey line is the friction of the scene) and the growth of
    the fastest deviation. Unstable equilibria are dashed; lines end where the branch does.

    Over two axes: rotation, height, the smallest stiffness and the friction. The smallest stiffness
    is the least eigenvalue of the symmetric part of the stiffness, with angles times half the
    object's width as lengths. The friction is its margin, or without friction in the scene the
    larger one that a contact needs. Black lines bound stable grasps, thin ones those for which the
    friction suffices. Dots mark unstable cells. Across an orange line, neighbours do not continue
    each other: a fold lies between them.

    In both, cells without equilibrium show the reason by face colour and hatch.

    Args:
        map: The map.

    Raises:
        TypeError: `map` is not an EquilibriumMap.
        ImportError: matplotlib is not installed.
    """
    checks.instance("map", map, EquilibriumMap, "an EquilibriumMap")
    with styled():
        return _curves(map) if len(map.axes) == 1 else _maps(map)


def _axis(map: EquilibriumMap, k: int) -> tuple[Floats, str]:
    """The values of an axis in the unit of figures, and its label."""
    column = shown(Column(map.values[k], map.units[k]))
    return np.asarray(column.values), label(map.axes[k], column.unit)


def _edges(values: Floats) -> Floats:
    """The edges of the cells around the values."""
    halves = 0.5 * np.diff(values)
    halves = halves if len(halves) else np.array([0.5])
    ends = [values[:1] - halves[:1], values[:-1] + 0.5 * np.diff(values), values[-1:] + halves[-1:]]
    return np.concatenate(ends)


# One axis.


def _curves(map: EquilibriumMap) -> Figure:
    figure, axes = panels(3, 2, PAGE, 5.2, sharex=True)
    values, name = _axis(map, 0)
    stiffness = map.stiffness
    plans: tuple[tuple[str, list[_Curve]], ...] = (
        ("rotation [deg]", [_Curve(map.rotation * DEG.per_si, {"color": BLACK})]),
        ("height $y$ [mm]", [_Curve(map.position[:, 1] * MM.per_si, {"color": BLACK})]),
        (
            "stiffness [N/mm]",
            [
                _Curve(stiffness[:, 0, 0] / MM.per_si, {"color": BLUE}, "$K_{xx}$"),
                _Curve(stiffness[:, 1, 1] / MM.per_si, {**_LEFT, "color": GREEN}, "$K_{yy}$"),
            ],
        ),
        (r"$K_{\theta\theta}$ [N m/rad]", [_Curve(stiffness[:, 2, 2], {"color": BLACK})]),
        (
            "friction needed [1]",
            [
                _Curve(map.friction_needed[:, 0], _RIGHT, "right"),
                _Curve(map.friction_needed[:, 1], _LEFT, "left"),
            ],
        ),
        ("growth [1/s]", [_Curve(map.growth, {"color": BLACK})]),
    )
    for k, (each, (what, curves)) in enumerate(zip(axes.flat, plans, strict=True)):
        for curve in curves:
            _curve(each, map, values, curve)
        each.set_ylabel(what)
        drawn = np.concatenate([curve.values for curve in curves])
        if (limits := constant_limits(drawn, _ROUND_OFF)) is not None:
            each.set_ylim(*limits)
        tag(each, "abcdef"[k])
        if len(curves) > 1:
            _names(each, curves)
        _spans(each, map, values)
    _friction(axes[2, 0], map, values)
    axes[2, 1].axhline(0.0, color=GREY, linewidth=0.6, zorder=0.8)
    for each in axes[-1]:
        each.set_xlabel(name)
        edges = _edges(values)
        each.set_xlim(edges[0], edges[-1])
    _legend(figure, map, [])
    return figure


def _curve(axes: Axes, map: EquilibriumMap, values: Floats, curve: _Curve) -> None:
    """Draws a line for each stretch of one branch that is stable, or is not."""
    y = np.where(np.isfinite(curve.values), curve.values, np.nan)
    marks = {"markevery": max(1, len(values) // 16)} if "marker" in curve.style else {}
    for first, end, stable in _stretches(map):
        style = {**curve.style, **marks, "linestyle": "-" if stable else _UNSTABLE}
        if end - first == 1 and not _joined(map, first):
            # A lone cell would not show as a line.
            style |= {"marker": "o", "markersize": 2.4, "markerfacecolor": "white"}
            style |= {"markerfacecolor": style["color"]} if stable else {}
        axes.plot(values[first:end], y[first:end], **style)


def _joined(map: EquilibriumMap, k: int) -> bool:
    """Whether a neighbour of a cell has its branch."""
    return any(
        0 <= n < len(map.branch) and map.branch[n] == map.branch[k] and map.cells[n].state
        for n in (k - 1, k + 1)
    )


def _stretches(map: EquilibriumMap) -> Iterator[tuple[int, int, bool]]:
    """First cell, end, and whether it is stable, of each part of a branch that is drawn alike."""
    at_rest, stable, branch = map.status == "at_rest", map.stable, map.branch
    k, count = 0, len(branch)
    while k < count:
        end = k + 1
        while end < count and at_rest[end] and (branch[end], stable[end]) == (branch[k], stable[k]):
            end += 1
        if at_rest[k]:
            first, last = k, end
            # The unstable part reaches to the neighbours, so that no gap remains between the parts.
            if not stable[k]:
                first -= int(k > 0 and at_rest[k - 1] and branch[k - 1] == branch[k])
                last += int(end < count and at_rest[end] and branch[end] == branch[k])
            yield first, last, bool(stable[k])
        k = end


def _spans(axes: Axes, map: EquilibriumMap, values: Floats) -> None:
    """Marks the cells without equilibrium over the whole height."""
    edges = _edges(values)
    for k, status in enumerate(map.status.tolist()):
        if status != "at_rest":
            face, hatch = _FACES[status]
            axes.axvspan(edges[k], edges[k + 1], facecolor=face, edgecolor="0.4", hatch=hatch,
                         linewidth=0.0, zorder=0.3)  # fmt: skip


def _friction(axes: Axes, map: EquilibriumMap, values: Floats) -> None:
    """Draws the friction of both contacts, where the panel has room for it."""
    limits = [coefficients(cell.scene.friction) for cell in map.cells]
    for tip in (0, 1):
        mu = np.array([pair[tip] for pair in limits])
        if np.isfinite(mu).any():
            axes.plot(values, np.where(np.isfinite(mu), mu, np.nan), color=GREY, linewidth=0.8)
    axes.set_ylim(bottom=0.0)


def _names(axes: Axes, curves: list[_Curve]) -> None:
    """Names the lines of a panel at the right end of the title's line."""
    from matplotlib.lines import Line2D

    axes.legend(
        handles=[Line2D([], [], **curve.style, label=curve.name) for curve in curves],
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(curves), borderaxespad=0.0,
        borderpad=0.15, handlelength=1.7,
    )  # fmt: skip


# Two axes.


def _maps(map: EquilibriumMap) -> Figure:
    figure, axes = panels(2, 2, PAGE, 5.4, sharex=True, sharey=True)
    (x, across), (y, up) = _axis(map, 0), _axis(map, 1)
    left, bottom = _edges(x), _edges(y)
    friction, what = _friction_shown(map)
    plans = (
        (map.rotation * DEG.per_si, "rotation [deg]", True),
        (map.position[..., 1] * MM.per_si, "height $y$ [mm]", False),
        (_smallest(map) / MM.per_si, "smallest stiffness [N/mm]", False),
        (friction, what, what == _MARGIN),
    )
    extra: list[Any] = []
    for k, (each, (values, name, signed)) in enumerate(zip(axes.flat, plans, strict=True)):
        drawn = np.ma.masked_invalid(values)
        _faces(each, map, drawn.mask & (map.status == "at_rest"), left, bottom)
        if drawn.count():
            low, high = constant_limits(values, _ROUND_OFF) or (
                float(drawn.min()),
                float(drawn.max()),
            )
            if signed:
                high = max(abs(low), abs(high))
                low = -high
            colors = _SIGNED if signed else _COLORS
            mesh = each.pcolormesh(
                left, bottom, drawn.T, cmap=colors, vmin=low, vmax=high, rasterized=True
            )
            bar = figure.colorbar(mesh, ax=each, pad=0.02)
            bar.set_label(name)
            bar.outline.set_linewidth(0.6)
        else:
            each.set_title(name)
        extra = _boundaries(each, map, left, bottom)
        each.set_xlim(left[0], left[-1])
        each.set_ylim(bottom[0], bottom[-1])
        tag(each, "abcd"[k])
    for each in axes[-1]:
        each.set_xlabel(across)
    for each in axes[:, 0]:
        each.set_ylabel(up)
    _legend(figure, map, extra)
    return figure


def _smallest(map: EquilibriumMap) -> Floats:
    """The least eigenvalue of the stiffness' symmetric part (m, n), N/m; angles as lengths."""
    lengths = np.reshape([0.5 * cell.scene.grasped.width for cell in map.cells], map.shape)
    scale = np.ones((*map.shape, 3))
    scale[..., 2] = 1.0 / lengths
    stiffness = map.stiffness * scale[..., :, None] * scale[..., None, :]
    symmetric = 0.5 * (stiffness + np.swapaxes(stiffness, -1, -2))
    found = np.full(map.shape, np.nan)
    known = np.isfinite(symmetric).all(axis=(-2, -1))
    found[known] = np.linalg.eigvalsh(symmetric[known])[:, 0]
    return found


def _friction_shown(map: EquilibriumMap) -> tuple[Floats, str]:
    """What the panel of friction shows, and its name."""
    if np.isfinite(map.friction_margin).any():
        return map.friction_margin, _MARGIN
    return map.friction_needed.max(axis=-1), "friction needed [1]"


def _faces(
    axes: Axes, map: EquilibriumMap, pulling: NDArray[np.bool_], left: Floats, bottom: Floats
) -> None:
    """Draws the cells without a colour: joined in columns, with the face of their status."""
    kinds = np.where(pulling, "pulling", map.status)
    for i, column in enumerate(kinds.tolist()):
        places = itertools.groupby(range(len(column)), key=column.__getitem__)
        for kind, cells in places:
            if kind == "at_rest":
                continue
            rows = list(cells)
            face, hatch = _FACES[kind]
            axes.fill_between(
                [left[i], left[i + 1]], bottom[rows[0]], bottom[rows[-1] + 1], facecolor=face,
                edgecolor="0.4", hatch=hatch, linewidth=0.0, zorder=0.5,
            )  # fmt: skip


def _boundaries(axes: Axes, map: EquilibriumMap, left: Floats, bottom: Floats) -> list[Any]:
    """Draws the boundaries of stability and of branches, and returns their legend."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    at_rest = map.status == "at_rest"
    seams = {tuple(pair.ravel().tolist()) for pair in map.seams}
    stability, friction, branches = [], [], []
    for i, j in np.ndindex(map.shape):
        for k, m in ((i + 1, j), (i, j + 1)):
            if k == map.shape[0] or m == map.shape[1] or not (at_rest[i, j] and at_rest[k, m]):
                continue
            upright = [(left[k], bottom[j]), (left[k], bottom[j + 1])]
            level = [(left[i], bottom[m]), (left[i + 1], bottom[m])]
            side = upright if k > i else level
            if map.branch[i, j] != map.branch[k, m] or (i, j, k, m) in seams:
                branches.append(side)
                continue
            if map.stable[i, j] != map.stable[k, m]:
                stability.append(side)
            if (map.friction_margin[i, j] < 0.0) != (map.friction_margin[k, m] < 0.0):
                friction.append(side)
    entries = []
    if friction:
        axes.add_collection(LineCollection(friction, colors="white", linewidths=0.9, zorder=1.9))
        entries.append(Line2D([], [], color=BLACK, linewidth=0.4, label="limit of friction"))
        axes.add_collection(LineCollection(friction, colors=BLACK, linewidths=0.4, zorder=1.95))
    # A single side hardly shows; the dots of unstable cells show where it is.
    if len(stability) > 1:
        axes.add_collection(LineCollection(stability, colors="white", linewidths=2.4, zorder=2.0))
        axes.add_collection(LineCollection(stability, colors=BLACK, linewidths=1.1, zorder=2.1))
        entries.append(Line2D([], [], color=BLACK, linewidth=1.1, label="boundary of stability"))
    if branches:
        axes.add_collection(LineCollection(branches, colors=RED, linewidths=1.4, zorder=2.2))
        entries.append(Line2D([], [], color=RED, linewidth=1.4, label="fold between neighbours"))
    unstable = at_rest & ~map.stable
    if unstable.any():
        i, j = np.nonzero(unstable)
        style: Line = {"marker": ".", "markersize": 1.6, "color": "white", "linestyle": "",
                       "markeredgecolor": BLACK, "markeredgewidth": 0.25}  # fmt: skip
        middles = 0.5 * (left[1:] + left[:-1]), 0.5 * (bottom[1:] + bottom[:-1])
        axes.plot(middles[0][i], middles[1][j], **style, zorder=1.8)
        entries.append(Line2D([], [], **{**style, "markersize": 4.0}, label="unstable"))
    return entries


def _legend(figure: Figure, map: EquilibriumMap, handles: list[Any]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = list(handles)
    if len(map.axes) == 1:
        if map.stable.any():
            handles.append(Line2D([], [], color=BLACK, label="stable"))
        if ((map.status == "at_rest") & ~map.stable).any():
            handles.append(Line2D([], [], color=BLACK, linestyle=_UNSTABLE, label="unstable"))
        mu = [mu for cell in map.cells for mu in coefficients(cell.scene.friction)]
        if np.isfinite(mu).any():
            handles.append(Line2D([], [], color=GREY, linewidth=0.8, label="friction of the scene"))
    pulls = bool(np.isinf(map.friction_needed).any()) and len(map.axes) == 2
    for status, (face, hatch) in _FACES.items():
        if (map.status == status).any() or (status == "pulling" and pulls):
            name = f"no equilibrium: {words(status)}"
            if status == "pulling" and pulls and not (map.status == status).any():
                name = "a tip pulls"
            handles.append(
                Patch(facecolor=face, edgecolor="0.4", hatch=hatch, linewidth=0.4, label=name)
            )
    if handles:
        figure.legend(handles=handles, loc="outside upper center", ncols=4, columnspacing=1.4)
