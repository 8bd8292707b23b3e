"""The figure of a map of equilibria, public as `softpinch.plot.equilibria`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..analysis.equilibrium_maps import EquilibriumMap
from ..scene.contact import coefficients
from ..scene.fields import label, words
from ..study.rows import Column
from ..study.tables import shown
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
    cell_edges,
    cell_patch,
    colorbar,
    constant_limits,
    fill_cells,
    legend,
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
_ONLY: Line = {"color": BLACK}
# The right line is wider, so that it shows below the left one where both are equal.
_RIGHT: Line = {"color": BLUE, "linewidth": 1.8}
_POINTS: Line = {"marker": "o", "markersize": 2.4}
_LEFT: Line = {"color": RED, "linewidth": 0.8, "markeredgewidth": 0.0, **_POINTS}


@styled()
def equilibria(map: EquilibriumMap) -> Figure:
    """Rest of the grasp over the axes of a map: pose, stiffness, friction and stability.

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
    """
    checks.instance("map", map, EquilibriumMap, "an EquilibriumMap")
    return _curves(map) if len(map.axes) == 1 else _maps(map)


def _axis(map: EquilibriumMap, k: int) -> tuple[Floats, str]:
    """The values of an axis in the unit of figures, and its label."""
    column = shown(Column(map.values[k], map.units[k]))
    return np.asarray(column.values), label(map.axes[k], column.unit)


# One axis.


def _curves(map: EquilibriumMap) -> Figure:
    figure, axes = panels(3, 2, PAGE, 5.2, sharex=True)
    values, name = _axis(map, 0)
    stiffness = map.stiffness
    force, friction = stiffness / MM.per_si, map.friction_needed
    # Name of each panel -> its lines: values, style, and a name if there are several.
    plans: dict[str, list[tuple[Floats, Line, str]]] = {
        "rotation [deg]": [(map.rotation * DEG.per_si, _ONLY, "")],
        "height $y$ [mm]": [(map.position[:, 1] * MM.per_si, _ONLY, "")],
        "stiffness [N/mm]": [
            (force[:, 0, 0], {"color": BLUE}, "$K_{xx}$"),
            (force[:, 1, 1], {**_LEFT, "color": GREEN}, "$K_{yy}$"),
        ],
        r"$K_{\theta\theta}$ [N m/rad]": [(stiffness[:, 2, 2], _ONLY, "")],
        "friction needed [1]": [(friction[:, 0], _RIGHT, "right"), (friction[:, 1], _LEFT, "left")],
        "growth [1/s]": [(map.growth, _ONLY, "")],
    }
    for k, (each, (what, curves)) in enumerate(zip(axes.flat, plans.items(), strict=True)):
        for curve in curves:
            _curve(each, map, values, *curve)
        each.set_ylabel(what)
        drawn = np.concatenate([curve[0] for curve in curves])
        if (limits := constant_limits(drawn, _ROUND_OFF)) is not None:
            each.set_ylim(*limits)
        tag(each, "abcdef"[k])
        if len(curves) > 1:
            legend(each)
        _spans(each, map, values)
    _friction(axes[2, 0], map, values)
    axes[2, 1].axhline(0.0, color=GREY, linewidth=0.6, zorder=0.8)
    for each in axes[-1]:
        each.set_xlabel(name)
        edges = cell_edges(values)
        each.set_xlim(edges[0], edges[-1])
    _legend(figure, map, [])
    return figure


def _curve(
    axes: Axes, map: EquilibriumMap, x: Floats, values: Floats, usual: Line, name: str
) -> None:
    """Draws a line for each stretch of one branch that is stable, or is not."""
    y = np.where(np.isfinite(values), values, np.nan)
    marks = {"markevery": max(1, len(x) // 16)} if "marker" in usual else {}
    for k, (first, end, stable) in enumerate(_stretches(map)):
        style = {**usual, **marks, "linestyle": "-" if stable else _UNSTABLE}
        if end - first == 1 and not _joined(map, first):
            # A lone cell would not show as a line.
            style |= {**_POINTS, "markerfacecolor": style["color"] if stable else "white"}
        # The legend has one entry for all stretches.
        axes.plot(x[first:end], y[first:end], **style, label="" if k else name)


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
    edges = cell_edges(values)
    for k, status in enumerate(map.status.tolist()):
        if status != "at_rest":
            face, hatch = _FACES[status]
            axes.axvspan(edges[k], edges[k + 1], facecolor=face, edgecolor="0.3", hatch=hatch,
                         linewidth=0.0, zorder=0.3)  # fmt: skip


def _friction(axes: Axes, map: EquilibriumMap, values: Floats) -> None:
    """Draws the friction of both contacts, where the panel has room for it."""
    limits = [coefficients(cell.scene.friction) for cell in map.cells]
    for tip in (0, 1):
        mu = np.array([pair[tip] for pair in limits])
        if np.isfinite(mu).any():
            axes.plot(values, np.where(np.isfinite(mu), mu, np.nan), color=GREY, linewidth=0.8)
    axes.set_ylim(bottom=0.0)


# Two axes.


def _maps(map: EquilibriumMap) -> Figure:
    figure, axes = panels(2, 2, PAGE, 5.4, sharex=True, sharey=True)
    (x, across), (y, up) = _axis(map, 0), _axis(map, 1)
    left, bottom = cell_edges(x), cell_edges(y)
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
        pulls = np.ma.getmaskarray(drawn) & (map.status == "at_rest")
        kinds = np.where(pulls, "pulling", map.status)
        fill_cells(each, kinds, np.column_stack([left[:-1], left[1:]]), bottom, _FACES)
        if drawn.count():
            low, high = constant_limits(values, _ROUND_OFF) or (drawn.min(), drawn.max())
            if signed:
                high = max(abs(low), abs(high))
                low = -high
            colors = _SIGNED if signed else _COLORS
            mesh = each.pcolormesh(
                left, bottom, drawn.T, cmap=colors, vmin=low, vmax=high, rasterized=True
            )
            colorbar(figure, mesh, each, name)
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
    """Values and name of the panel of friction."""
    if np.isfinite(map.friction_margin).any():
        return map.friction_margin, _MARGIN
    return map.friction_needed.max(axis=-1), "friction needed [1]"


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
    # A single side of stability hardly shows; the dots of unstable cells show where it is.
    stability = stability if len(stability) > 1 else []
    for sides, name, layers in (
        (friction, "limit of friction", {"white": 0.9, BLACK: 0.4}),
        (stability, "boundary of stability", {"white": 2.4, BLACK: 1.1}),
        (branches, "fold between neighbours", {RED: 1.4}),
    ):
        if sides:
            for color, width in layers.items():
                lines = LineCollection(sides, colors=color, linewidths=width, zorder=2.0)
                axes.add_collection(lines)
            entries.append(Line2D([], [], color=color, linewidth=width, label=name))
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

    if len(map.axes) == 1:
        if map.stable.any():
            handles.append(Line2D([], [], color=BLACK, label="stable"))
        if ((map.status == "at_rest") & ~map.stable).any():
            handles.append(Line2D([], [], color=BLACK, linestyle=_UNSTABLE, label="unstable"))
        mu = [mu for cell in map.cells for mu in coefficients(cell.scene.friction)]
        if np.isfinite(mu).any():
            handles.append(Line2D([], [], color=GREY, linewidth=0.8, label="friction of the scene"))
    pulls = bool(np.isinf(map.friction_needed).any()) and len(map.axes) == 2
    for status, face in _FACES.items():
        if (map.status == status).any() or (status == "pulling" and pulls):
            name = f"no equilibrium: {words(status)}"
            if status == "pulling" and pulls and not (map.status == status).any():
                name = "a tip pulls"
            handles.append(cell_patch(face, name))
    if handles:
        figure.legend(handles=handles, loc="outside upper center", ncols=4, columnspacing=1.4)
