"""The figure of the wrenches that a grasp bears, public as `softpinch.plot.wrench_limits`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..analysis.wrench import WrenchLimits
from ..scene.fields import words
from ..study.results import Results
from ..study.tables import booleans, number
from ..support import checks
from ..support.arrays import Floats
from .style import BLACK, BLUE, COLUMN, GREEN, GREY, PAGE, PURPLE, RED, panels_or_given

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

# Limit -> marker, distinct in grey too. What is not listed has the last one.
_MARKS: dict[str, dict[str, Any]] = {
    "slipping": {"marker": "o", "color": BLUE},
    "pulling": {"marker": "s", "color": RED},
    "off_face": {"marker": "^", "color": GREEN},
    "unstable": {"marker": "D", "color": PURPLE},
    "separated": {"marker": "P", "color": "#E69F00"},
    "crushed": {"marker": "X", "color": "#56B4E9"},
    "folded": {"marker": "v", "color": "#8C6D31"},
}
_OTHER: dict[str, Any] = {"marker": "*", "color": BLACK}
_HELD: dict[str, Any] = {"marker": ".", "markersize": 3.0, "color": BLUE, "markeredgewidth": 0.0}
_LOST: dict[str, Any] = {"marker": "x", "markersize": 3.0, "color": RED, "markeredgewidth": 0.7}
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
    """The largest forces that a grasp bears, by direction, and what gives way.

    The figure has the directions without moment; both smallest moments without force are in the
    title. With an ensemble, a second panel of the same scale has its forces: dots where the grasp
    held, crosses where it did not, and the limits of the first panel as a line.

    Args:
        limits: The limits.
        ensemble: Runs in which a force acts on the object, of random direction and size.
        force: Path of the force that differs between the runs (runs, 2).
        what: What counts as held: "holds", a status or a violation, or booleans (runs,).
        ax: The axes to draw on, with projection="polar"; None makes a figure.

    Raises:
        ValueError: No direction is without moment, the ensemble does not vary `force`, `ax` is
            given with an ensemble, whose forces need a second panel, or `ax` is not polar.
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
    columns, width, height = (1, COLUMN, 3.7) if points is None else (2, PAGE, 3.9)
    polar = {"projection": "polar"}
    with panels_or_given(ax, 1, columns, width, height, subplot_kw=polar) as (figure, axes):
        first = axes[0, 0]
        if first.name != "polar":
            raise ValueError(f'ax: must have projection="polar", not {first.name!r}')
        _outline(first, angle, size, {"color": GREY, "linewidth": 0.8})
        _marked(first, angle, size, limits.limit[plain])
        first.set_title(_title(limits, plain), fontsize=9.0, pad=8.0)
        if points is not None and ensemble is not None:
            second = axes[0, 1]
            turned, sizes, held = points
            _outline(second, angle, size, {"color": "white", "linewidth": 2.4, "zorder": 2.0})
            style = {"color": BLACK, "linewidth": 1.1, "zorder": 2.1}
            _outline(second, angle, size, {**style, "label": "limit of slow forces"})
            for some, mark, name in ((held, _HELD, "held"), (~held, _LOST, "not held")):
                label = f"{name} ({int(some.sum())})"
                # Grid and labels, whose zorder is 1.5, are above the points.
                second.plot(
                    turned[some], sizes[some], linestyle="", label=label, zorder=1.2, **mark
                )
            second.set_title(f"in runs\n{ensemble.model}", fontsize=9.0, pad=8.0)
        for each in axes.flat:
            _frame(each, shown)
            count = len(each.get_legend_handles_labels()[1])
            if count:
                each.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=min(count, 3))
        return figure


def _points(
    ensemble: Results, force: str, what: str | NDArray[np.bool_]
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Angles, sizes and whether the grasp held (runs,), of the forces of an ensemble."""
    checks.instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    checks.instance("force", force, str, "a path")
    x, y = (number(ensemble, f"{force}.{k}", "force").values for k in (0, 1))
    if isinstance(what, str):
        held = ensemble.happened(what)
    else:
        held = booleans("what", what, ensemble.runs)
    return np.arctan2(y, x), np.hypot(x, y), held


def _outline(axes: PolarAxes, angle: Floats, size: Floats, style: dict[str, Any]) -> None:
    """Joins the limits of neighbouring directions."""
    order = np.argsort(angle)
    turned, sizes = angle[order], np.where(np.isfinite(size), size, np.nan)[order]
    turned, sizes = np.append(turned, turned[0] + 2.0 * np.pi), np.append(sizes, sizes[0])
    far = np.flatnonzero(np.diff(turned) > _GAP) + 1
    axes.plot(np.insert(turned, far, np.nan), np.insert(sizes, far, np.nan), **style)


def _marked(axes: PolarAxes, angle: Floats, size: Floats, limit: NDArray[np.str_]) -> None:
    """Draws a mark for each limit."""
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


def _frame(axes: PolarAxes, shown: NDArray[np.complex128]) -> None:
    """Sets the scale, and names its unit at the radial axis, which is where the fewest points are.

    `shown` are the forces that are drawn, as complex numbers (n,), N.
    """
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
    axes.text(radial, 1.05 * top, "force [N]", ha=ha, va=va)
    axes.grid(linewidth=0.4, color="0.8")
    axes.tick_params(pad=1.0)
