"""Figures of rest: `equilibria` of a map; `wrench_limits` and `carry_limits` of a grasp."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..analysis import CarryLimits, EquilibriumMap, WrenchLimits
from ..scene.contact import coefficients
from ..scene.fields import label, words
from ..scene.parts import width
from ..study.results import Results
from ..study.rows import Column
from ..study.tables import event, number, shown
from ..support import Floats, checks
from . import style as s

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

# The colour map of values with a sign, for every colour vision; its middle, white, is zero.
_SIGNED = "PRGn"
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
# Smaller differences, in the units of the panels or as a share of the values, are round-off.
_ROUND_OFF = 1e-7
Line = dict[str, Any]
_ONLY: Line = {"color": s.BLACK}
# The right line is wider, so that it shows below the left one where both are equal.
_RIGHT: Line = {"color": s.BLUE, "linewidth": 1.8}
_POINTS: Line = {"marker": "o", "markersize": 2.4}
_LEFT: Line = {"color": s.RED, "linewidth": 0.8, "markeredgewidth": 0.0, **_POINTS}


@s.styled()
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
    """
    checks.instance("map", map, EquilibriumMap, "an EquilibriumMap")
    return _curves(map) if len(map.axes) == 1 else _maps(map)


def _axis(map: EquilibriumMap, k: int) -> tuple[Floats, str]:
    """The values of an axis in the unit of figures, and its label."""
    column = shown(Column(map.values[k], map.units[k]))
    return np.asarray(column.values), label(map.axes[k], column.unit)


def _curves(map: EquilibriumMap) -> Figure:
    """The figure over one axis."""
    figure, axes = s.panels(3, 2, s.PAGE, 5.2, sharex=True)
    values, name = _axis(map, 0)
    stiffness, friction = map.stiffness, map.friction_needed
    # Name of each panel -> its lines: values, style, and a name if there are several.
    plans: dict[str, list[tuple[Floats, Line, str]]] = {
        "rotation [deg]": [(map.rotation * s.DEG.per_si, _ONLY, "")],
        "height $y$ [mm]": [(map.position[:, 1] * s.MM.per_si, _ONLY, "")],
        "stiffness [N/mm]": [
            (stiffness[:, 0, 0] / s.MM.per_si, {"color": s.BLUE}, "$K_{xx}$"),
            (stiffness[:, 1, 1] / s.MM.per_si, {**_LEFT, "color": s.GREEN}, "$K_{yy}$"),
        ],
        r"$K_{\theta\theta}$ [N m/rad]": [(stiffness[:, 2, 2], _ONLY, "")],
        "friction needed [1]": [(friction[:, 0], _RIGHT, "right"), (friction[:, 1], _LEFT, "left")],
        "growth [1/s]": [(map.growth, _ONLY, "")],
    }
    for k, (each, (title, curves)) in enumerate(zip(axes.flat, plans.items(), strict=True)):
        for curve in curves:
            _curve(each, map, values, *curve)
        each.set_ylabel(title)
        s.tag(each, "abcdef"[k])
        if len(curves) > 1:
            s.legend(each)
        edges = s.cell_edges(values)
        # Cells without equilibrium are marked over the whole height.
        for cell, status in enumerate(map.status.tolist()):
            if status != "at_rest":
                face, hatch = _FACES[status]
                each.axvspan(edges[cell], edges[cell + 1], facecolor=face, edgecolor="0.3",
                             hatch=hatch, linewidth=0.0, zorder=0.3)  # fmt: skip
    s.least_range(axes.flat, _ROUND_OFF)
    for mu in np.transpose([coefficients(cell.scene.friction) for cell in map.cells]):
        if (known := np.isfinite(mu)).any():
            axes[2, 0].plot(values, np.where(known, mu, np.nan), color=s.GREY, linewidth=0.8)
    axes[2, 0].set_ylim(bottom=0.0)
    axes[2, 1].axhline(0.0, color=s.GREY, linewidth=0.6, zorder=0.8)
    for each in axes[-1]:
        each.set(xlabel=name, xlim=edges[[0, -1]])
    _legend(figure, map, [])
    return figure


def _curve(
    axes: Axes, map: EquilibriumMap, x: Floats, values: Floats, usual: Line, name: str
) -> None:
    """Draws a line for the stable and one for the unstable part of each branch."""
    marks = {"markevery": max(1, len(x) // 16)} if "marker" in usual else {}
    for branch in np.unique(map.branch[map.status == "at_rest"]):
        own = (map.status == "at_rest") & (map.branch == branch)
        stable, unstable = own & map.stable, own & ~map.stable
        # The unstable part reaches to its neighbours, so that no gap remains between the parts.
        joined = own & _among_neighbours(unstable)
        alone = own & ~_among_neighbours(own, itself=False)
        for cells, linestyle, face in ((stable, "-", "auto"), (joined, _UNSTABLE, "white")):
            if cells.any():
                style = {**usual, **marks, "linestyle": linestyle}
                if (cells & alone).any():
                    # A lone cell would not show as a line.
                    style |= {**_POINTS, "markerfacecolor": face}
                axes.plot(x, np.where(cells, values, np.nan), **style, label=name)
                # The legend has one entry for all branches.
                name = ""


def _among_neighbours(cells: NDArray[np.bool_], itself: bool = True) -> NDArray[np.bool_]:
    """Marks the cells (n,) that are, or have a neighbour, among some cells (n,)."""
    return np.convolve(cells, [1, int(itself), 1])[1:-1] > 0


def _maps(map: EquilibriumMap) -> Figure:
    """The figure over two axes."""
    figure, axes = s.panels(2, 2, s.PAGE, 5.4, sharex=True, sharey=True)
    (x, across), (y, up) = _axis(map, 0), _axis(map, 1)
    left, bottom = s.cell_edges(x), s.cell_edges(y)
    friction, title = map.friction_margin, "margin of friction [1]"
    signed = bool(np.isfinite(friction).any())
    if not signed:
        friction, title = map.friction_needed.max(axis=-1), "friction needed [1]"
    plans = (
        (map.rotation * s.DEG.per_si, "rotation [deg]", True),
        (map.position[..., 1] * s.MM.per_si, "height $y$ [mm]", False),
        (_smallest(map) / s.MM.per_si, "smallest stiffness [N/mm]", False),
        (friction, title, signed),
    )
    extra: list[Any] = []
    for k, (each, (values, name, signed)) in enumerate(zip(axes.flat, plans, strict=True)):
        drawn = np.ma.masked_invalid(values)
        pulls = np.ma.getmaskarray(drawn) & (map.status == "at_rest")
        kinds = np.where(pulls, "pulling", map.status)
        s.fill_cells(each, kinds, left, bottom, _FACES)
        if drawn.count():
            low, high = s.constant_limits(values, _ROUND_OFF) or (drawn.min(), drawn.max())
            if signed:
                high = max(abs(low), abs(high))
                low = -high
            colors = _SIGNED if signed else s.HEAT
            mesh = s.color_cells(each, (left, bottom), drawn, low, high, colors)
            s.colorbar(figure, mesh, each, name)
        else:
            each.set_title(name)
        extra = _boundaries(each, map, left, bottom)
        each.set(xlim=left[[0, -1]], ylim=bottom[[0, -1]], xlabel=across, ylabel=up)
        each.label_outer()
        s.tag(each, "abcd"[k])
    _legend(figure, map, extra)
    return figure


def _smallest(map: EquilibriumMap) -> Floats:
    """The least eigenvalue of the stiffness' symmetric part (m, n), N/m; angles as lengths."""
    lengths = np.reshape([0.5 * width(cell.scene) for cell in map.cells], map.shape)
    scale = np.ones((*map.shape, 3))
    scale[..., 2] = 1.0 / lengths
    stiffness = map.stiffness * scale[..., :, None] * scale[..., None, :]
    symmetric = 0.5 * (stiffness + np.swapaxes(stiffness, -1, -2))
    found = np.full(map.shape, np.nan)
    known = np.isfinite(symmetric).all(axis=(-2, -1))
    found[known] = np.linalg.eigvalsh(symmetric[known])[:, 0]
    return found


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
            side = [(left[k], bottom[m]), (left[i + 1], bottom[j + 1])]
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
        (friction, "limit of friction", {"white": 0.9, s.BLACK: 0.4}),
        (stability, "boundary of stability", {"white": 2.4, s.BLACK: 1.1}),
        (branches, "fold between neighbours", {s.RED: 1.4}),
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
                       "markeredgecolor": s.BLACK, "markeredgewidth": 0.25}  # fmt: skip
        middles = 0.5 * (left[1:] + left[:-1]), 0.5 * (bottom[1:] + bottom[:-1])
        axes.plot(middles[0][i], middles[1][j], **style, zorder=1.8)
        entries.append(Line2D([], [], **{**style, "markersize": 4.0}, label="unstable"))
    return entries


def _legend(figure: Figure, map: EquilibriumMap, handles: list[Any]) -> None:
    from matplotlib.lines import Line2D

    if len(map.axes) == 1:
        if map.stable.any():
            handles.append(Line2D([], [], color=s.BLACK, label="stable"))
        if ((map.status == "at_rest") & ~map.stable).any():
            handles.append(Line2D([], [], color=s.BLACK, linestyle=_UNSTABLE, label="unstable"))
        mu = [mu for cell in map.cells for mu in coefficients(cell.scene.friction)]
        if np.isfinite(mu).any():
            line = Line2D([], [], color=s.GREY, linewidth=0.8, label="friction of the scene")
            handles.append(line)
    pulls = bool(np.isinf(map.friction_needed).any()) and len(map.axes) == 2
    for status, face in _FACES.items():
        if (lost := (map.status == status).any()) or (status == "pulling" and pulls):
            name = f"no equilibrium: {words(status)}" if lost else "a tip pulls"
            handles.append(s.cell_patch(face, name))
    if handles:
        figure.legend(handles=handles, loc="outside upper center", ncols=4, columnspacing=1.4)


# Limit of a wrench -> marker, distinct in grey too; `_OTHER` is that of other limits.
_MARKS: dict[str, dict[str, Any]] = {
    "slipping": {"marker": "o", "color": s.BLUE},
    "pulling": {"marker": "s", "color": s.RED},
    "off_face": {"marker": "^", "color": s.GREEN},
    "unstable": {"marker": "D", "color": s.PURPLE},
    "separated": {"marker": "P", "color": "#E69F00"},
    "crushed": {"marker": "X", "color": "#56B4E9"},
    "folded": {"marker": "v", "color": "#8C6D31"},
}
_OTHER: dict[str, Any] = {"marker": "*", "color": s.BLACK}
_HELD: dict[str, Any] = {"marker": ".", "markersize": 3.0, "color": s.BLUE, "markeredgewidth": 0.0}
_LOST: dict[str, Any] = {"marker": "x", "markersize": 3.0, "color": s.RED, "markeredgewidth": 0.7}
# Angles at which the radial axis has room for its name, between the angles that are labelled, rad.
_RADIAL = np.deg2rad([67.5, 22.5, 112.5, 157.5, 202.5, 247.5, 292.5, 337.5])
# Directions further apart than this are not joined by a line, rad.
_GAP = 0.6


def wrench_limits(
    limits: WrenchLimits,
    ensemble: Results | None = None,
    force: str = "disturbances.0.force",
    what: str | NDArray[np.bool_] = "holds",
    ax: Axes | None = None,
) -> Figure:
    """The largest forces that a grasp bears, by direction, and the limit that each reaches.

    The figure has the directions without moment; both smallest moments without force are in the
    title. With an ensemble, a second panel of the same scale has its forces: dots where the grasp
    held, crosses where it did not, and the limits of the first panel as a line.

    Args:
        ensemble: Runs in which a force acts on the object, of random direction and size.
        force: Path of the force that differs between the runs (runs, 2).
        what: What counts as held: "holds", a status or a violation, or booleans (runs,).
        ax: The axes to draw on, with projection="polar"; None makes a figure.
    """
    checks.instance("limits", limits, WrenchLimits)
    # Forces whose moment is zero.
    plain = limits.directions[:, 2] == 0.0
    if not plain.any():
        raise ValueError("limits: must have a direction without moment")
    angle = np.arctan2(limits.directions[plain, 1], limits.directions[plain, 0])
    size = limits.magnitude[plain] * np.hypot(*limits.directions[plain, :2].T)
    # The forces that are drawn, as complex numbers, N.
    shown = size[np.isfinite(size)] * np.exp(1j * angle[np.isfinite(size)])
    points = None if ensemble is None else _points(ensemble, force, what)
    if points is not None:
        shown = np.append(shown, points[1] * np.exp(1j * points[0]))
    columns, width, height = (1, s.COLUMN, 3.7) if points is None else (2, s.PAGE, 3.9)
    with _polar(ax, columns, width, height) as (figure, axes):
        first = axes[0, 0]
        _marked(first, angle, size, limits.limit[plain])
        first.set_title(_title(limits, plain), fontsize=9.0, pad=8.0)
        if points is not None and ensemble is not None:
            second = axes[0, 1]
            turned, sizes, held = points
            _outline(second, angle, size, {"color": "white", "linewidth": 2.4, "zorder": 2.0})
            style = {"color": s.BLACK, "linewidth": 1.1, "zorder": 2.1}
            _outline(second, angle, size, {**style, "label": "limit of slow forces"})
            for some, mark, name in ((held, _HELD, "held"), (~held, _LOST, "not held")):
                named = {**mark, "label": f"{name} ({int(some.sum())})"}
                # Grid and labels, whose zorder is 1.5, are above the points.
                second.plot(turned[some], sizes[some], linestyle="", zorder=1.2, **named)
            second.set_title(f"in runs\n{ensemble.model}", fontsize=9.0, pad=8.0)
        for each in axes.flat:
            _frame(each, shown)
        return figure


def carry_limits(limits: CarryLimits, ax: Axes | None = None) -> Figure:
    """The largest accelerations of the hand that a grasp bears, by direction, and what gives way.

    The dashed circle is the size of gravity. Of several tilts, each has a curve of its own, without
    what gives way. The axes `ax` have projection="polar".
    """
    from matplotlib import colormaps

    checks.instance("limits", limits, CarryLimits)
    angle, sizes = np.arctan2(*limits.direction.T[::-1]), np.atleast_2d(limits.limit)
    rests = limits.equilibrium if isinstance(limits.equilibrium, tuple) else (limits.equilibrium,)
    finite, gravity = np.isfinite(sizes), rests[0].scene.gravity
    shown = np.append((sizes * np.exp(1j * angle))[finite], gravity)
    with _polar(ax, 1, s.COLUMN, 3.7) as (figure, axes):
        (each,) = axes.flat
        if limits.limit.ndim == 1:
            _marked(each, angle, limits.limit, limits.cause)
        else:
            colors = colormaps["viridis"](np.linspace(0.0, 0.85, len(sizes)))
            for size, tilt, color in zip(sizes, np.degrees(limits.tilt), colors, strict=True):
                style = {"color": color, "linewidth": 1.2, "label": f"tilt {tilt:.4g}$^\\circ$"}
                _outline(each, angle, size, style)
        around = np.linspace(0.0, 2.0 * np.pi, 181)
        each.plot(around, np.full(181, gravity), color=s.BLACK, linewidth=0.8, linestyle="--",
                  label="gravity")  # fmt: skip
        how = "growing slowly" if limits.profile is None else words(f"{limits.profile} moves")
        free = f"\n{int((~finite).sum())} directions without limit" if not finite.all() else ""
        each.set_title(f"acceleration of the hand, {how}{free}", fontsize=9.0, pad=8.0)
        _frame(each, shown, "acceleration [m/s$^2$]")
        return figure


@contextmanager
def _polar(
    ax: Axes | None, columns: int, width: float, height: float
) -> Iterator[tuple[Figure, NDArray[Any]]]:
    """Polar panels in a row, or the given polar axes."""
    polar = {"projection": "polar"}
    with s.panels_or_given(ax, 1, columns, width, height, subplot_kw=polar) as (figure, axes):
        if axes[0, 0].name != "polar":
            raise ValueError(f'ax: must have projection="polar", not {axes[0, 0].name!r}')
        yield figure, axes


def _points(
    ensemble: Results, force: str, what: str | NDArray[np.bool_]
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Angles, sizes and whether the grasp held (runs,), of the forces of an ensemble."""
    checks.instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    checks.instance("force", force, str, "a path")
    x, y = (number(ensemble, f"{force}.{k}", "force").values for k in (0, 1))
    return np.arctan2(y, x), np.hypot(x, y), event(ensemble, what)


def _outline(axes: PolarAxes, angle: Floats, size: Floats, style: dict[str, Any]) -> None:
    """Joins the limits of neighbouring directions."""
    order = np.argsort(angle)
    turned, sizes = angle[order], np.where(np.isfinite(size), size, np.nan)[order]
    turned, sizes = np.append(turned, turned[0] + 2.0 * np.pi), np.append(sizes, sizes[0])
    far = np.flatnonzero(np.diff(turned) > _GAP) + 1
    axes.plot(np.insert(turned, far, np.nan), np.insert(sizes, far, np.nan), **style)


def _marked(axes: PolarAxes, angle: Floats, size: Floats, limit: NDArray[np.str_]) -> None:
    _outline(axes, angle, size, {"color": s.GREY, "linewidth": 0.8})
    for name in dict.fromkeys([*_MARKS, *limit.tolist()]):
        some = (limit == name) & np.isfinite(size)
        if some.any():
            mark = _MARKS.get(name, _OTHER)
            axes.plot(angle[some], size[some], linestyle="", markersize=3.2, markeredgewidth=0.0,
                      **mark, label=words(name))  # fmt: skip


def _title(limits: WrenchLimits, plain: NDArray[np.bool_]) -> str:
    """The limits in both senses of a pure moment, if they are known."""
    text = "slowly applied"
    pure = ~plain & (limits.directions[:, :2] == 0.0).all(axis=1)
    parts = []
    for sign in (1.0, -1.0):
        some = np.flatnonzero(pure & (np.sign(limits.directions[:, 2]) == sign))
        if some.size:
            k = some[np.argmin(np.abs(limits.wrench[some, 2]))]
            parts.append(f"{limits.wrench[k, 2]:+.3g} N m ({words(str(limits.limit[k]))})")
    # The minus sign of figures is longer than a hyphen.
    text += "\n" + ("moments: " + ", ".join(parts).replace("-", "\u2212") if parts else "")
    free = int((plain & ~np.isfinite(limits.magnitude)).sum())
    return text + (f"\n{free} directions without limit" if free else "")


def _frame(axes: PolarAxes, shown: NDArray[np.complex128], unit: str = "force [N]") -> None:
    """Sets the scale, and its radial axis with a unit far from what is `shown` (n,); a legend."""
    from matplotlib.ticker import MaxNLocator

    largest = float(np.abs(shown).max(initial=0.0))
    top = 1.08 * largest if largest > 0.0 else 1.0
    axes.set_ylim(0.0, top)
    axes.set_xticks(np.deg2rad(np.arange(0.0, 360.0, 45.0)))
    ticks = np.array(MaxNLocator(3, steps=[1, 2, 5, 10]).tick_values(0.0, top))
    ticks = ticks[(ticks > 0.0) & (ticks <= top)]
    axes.set_yticks(ticks, labels=[])
    # The angle at which the nearest point is farthest from the labels.
    labels = ticks[:, None] * np.exp(1j * _RADIAL)
    apart = np.abs(labels[..., None] - shown)
    radial = _RADIAL[np.argmax(apart.min(axis=(0, 2), initial=10.0 * top))]
    # matplotlib's own labels would be beside their circles, where the points are.
    for tick in ticks:
        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.4}
        axes.text(radial, tick, f"{tick:g}", fontsize=8.0, ha="center", va="center", bbox=box)
    across, up = np.cos(radial), np.sin(radial)
    ha, va = "left" if across > 0.0 else "right", "bottom" if up > 0.0 else "top"
    axes.text(radial, 1.05 * top, unit, ha=ha, va=va)
    axes.grid(linewidth=0.4, color="0.8")
    axes.tick_params(pad=1.0)
    if count := len(axes.get_legend_handles_labels()[1]):
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=min(count, 3))
