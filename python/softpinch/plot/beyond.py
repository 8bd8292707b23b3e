"""Figures beyond the paper: contact forces and energy, the sign of the shear, a run's overview."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..run import measures as measures
from ..run.run import Run
from ..scene import outline
from ..support.checks import instance
from ..support.errors import NotRecordedError
from . import contact_bands
from .panels import (
    ANGLES,
    COMPRESSIONS,
    EVERYTHING,
    LETTERS,
    POSE,
    TILT,
    Floats,
    Rows,
    closure,
    contact_energy,
    gap,
    ledger,
    name,
    number_operations,
    pressing,
    residual,
    slip,
    time_axis,
)
from .style import (
    BLACK,
    COLUMN,
    DEG,
    GREY,
    LINES,
    PAGE,
    RED,
    TARGET,
    least_range,
    legend,
    legend_above,
    line,
    panels,
    styled,
    tag,
    whole_decades,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Time window of `forces` around the smallest pressing force, ms.
_NEAR = (-2.5, 10.0)
# Start of the time axis of a disturbed run, relative to the onset, s.
_BEFORE = -0.02
# The place on the friction axis that stands for infinity, and the axis limits.
_INFINITE, _FRICTION_RANGE = 1e2, (1e-4, 3e2)


def forces(run: Run) -> Figure:
    """Contact forces, required friction and energy ledger, which the paper does not show.

    The left column has the whole run, the right column the time around the smallest pressing force.
    While a tip would have to pull (lambda^H < 0), the right column is shaded, and the friction that
    no-slip requires is infinite. In the left column, where these times are too short to be seen,
    triangles mark them.

    Args:
        run: A run with "multipliers" and "energy" recorded.

    Raises:
        TypeError: `run` is not a Run.
        NotRecordedError: Multipliers or energy were not recorded.
        ImportError: matplotlib is not installed.
    """
    instance("run", run, Run)
    worst = int(np.argmin(run.multipliers[:, :2].min(axis=1)))
    start = float(run.t[worst])
    since = 1e3 * (run.t - start)
    # Select a little more than is shown, so that lines reach the edges.
    window = (since >= 1.2 * _NEAR[0]) & (since <= 1.2 * _NEAR[1])
    views: tuple[tuple[Floats, Rows], ...] = ((run.t, EVERYTHING), (since[window], window))
    with styled():
        figure, axes, strips = contact_bands.panels_over_bands(
            {"": run}, 4, 2, PAGE, 6.2, sharex="col", sharey="row", width_ratios=(1.35, 1.0)
        )
        for column, (t, rows) in enumerate(views):
            pressing(axes[0, column], run, t, rows)
            _friction(axes[1, column], run, t, rows, marked=column == 0)
            ledger(axes[2, column], run, t, rows)
            closure(axes[3, column], run, t, rows)
        # Both columns share this axis, so it is scaled by the whole run.
        whole_decades(axes[3, 0])
        _mark_pulls(axes[0, 0], run)
        _shade_pulls(axes[:2, 1], run, start)
        titles = ("pressing force", "friction that no-slip needs", "ledger", "error of the ledger")
        for row, title in enumerate(titles):
            tag(axes[row, 0], LETTERS[row], title)
            axes[row, 1].set_ylabel("")
            if row < 3:
                legend(axes[row, 0])
        axes[0, 1].set_title(f"around the smallest force, $t$ = {start:g} s", pad=3.0)
        if strips:
            contact_bands.draw_bands(strips[0], {"": run})
            contact_bands.draw_bands(strips[1], {"": run}, since=start, per=1e3)
            contact_bands.legend_below(figure, contact_bands.occurring({"": run}))
        time_axis(run, [*axes[:, 0], *strips[:1]])
        least_range(axes[:, 0])
        axes[0, 1].set_xlim(*_NEAR)
        (strips or axes[-1])[1].set_xlabel(f"time from {start:g} s [ms]")
        figure.align_ylabels(axes[:, 0])
        return figure


def _mark_pulls(axes: Axes, run: Run) -> None:
    """Draws a triangle at the top for each interval in which a tip pulls."""
    for side in (0, 1):
        begins = [begin for begin, _ in measures.pulling_intervals(run, side)]
        axes.plot(
            begins,
            np.full(len(begins), 0.95),
            marker="v",
            color=LINES[side]["color"],
            linestyle="none",
            transform=axes.get_xaxis_transform(),
            zorder=3.0,
        )


def _shade_pulls(axes: Sequence[Axes] | NDArray[Any], run: Run, start: float) -> None:
    """Shades the intervals in which a tip pulls; the axis has ms since `start`, s."""
    for side in (0, 1):
        for begin, end in measures.pulling_intervals(run, side):
            span = 1e3 * (begin - start), 1e3 * (end - start)
            if span[1] < _NEAR[0] or span[0] > _NEAR[1]:
                continue
            for each in axes:
                color = LINES[side]["color"]
                each.axvspan(*span, facecolor=color, alpha=0.15, linewidth=0.0, zorder=0.4)


def _friction(axes: Axes, run: Run, t: Floats, rows: Rows, marked: bool) -> None:
    """Draws |lambda^N| / lambda^H over `t`; infinite values as a line at the place of infinity.

    Args:
        axes: The axes.
        run: The run.
        t: Horizontal positions of the selected rows.
        rows: The selected rows.
        marked: Whether infinite values are triangles instead of a line.
    """
    demand = measures.friction_demand(run)[rows]
    for k in (0, 1):
        # Values above the place of infinity on the axis are drawn as infinite.
        unbounded = ~(demand[:, k] < _INFINITE)
        needed = np.where(unbounded | (demand[:, k] == 0.0), np.nan, demand[:, k])
        label = rf"$|\lambda_{k + 1}^N| / \lambda_{k + 1}^H$"
        line(axes, t, needed, **LINES[k], label=label)
        color = LINES[k]["color"]
        if marked:
            at_infinity = np.full(int(unbounded.sum()), _INFINITE)
            axes.plot(t[unbounded], at_infinity, "v", color=color, zorder=3.0)
        else:
            at_infinity = np.where(unbounded, _INFINITE, np.nan)
            axes.plot(t, at_infinity, color=color, linewidth=2.0, zorder=3.0)
    if run.scene.friction is not None:
        for friction in np.unique(run.scene.friction):
            axes.axhline(friction, color=BLACK, linewidth=0.7, label=r"$\mu$")
    axes.axhline(_INFINITE, color=GREY, linewidth=0.6, linestyle=":", zorder=0.8)
    # Limits come before the scale, which would otherwise choose its own.
    axes.set_ylim(*_FRICTION_RANGE)
    axes.set_yscale("log", nonpositive="mask")
    labels = {1e-4: "$10^{-4}$", 1e-2: "$10^{-2}$", 1e0: "$10^{0}$", _INFINITE: r"$\infty$"}
    axes.set_yticks(list(labels), labels=list(labels.values()))
    axes.set_yticks([], minor=True)
    axes.set_ylabel(r"$|\lambda^N| / \lambda^H$ [1]")


def tilt_coupling(
    run_plus: Run,
    run_minus: Run,
    pushed_plus: Run | None = None,
    pushed_minus: Run | None = None,
    disturbance: str = "the disturbance",
) -> Figure:
    """The effect of the sign of the shear in (4): kappa = +1, as printed, and kappa = -1.

    Args:
        run_plus: A run with `tilt_coupling` = 1 and "state" recorded.
        run_minus: A run of this scene with `tilt_coupling` = -1 and "state" recorded.
        pushed_plus: A run with `tilt_coupling` = 1 under a disturbance. With `pushed_minus` it adds
            a second column with tilt and compressions.
        pushed_minus: A run of that scene with `tilt_coupling` = -1.
        disturbance: Name of the disturbance, for the second column's title.

    Raises:
        ValueError: Only one of the two pushed runs is given.
        TypeError: An argument is of the wrong kind.
        NotRecordedError: A state was not recorded.
        ImportError: matplotlib is not installed.
    """
    for field, each in (("run_plus", run_plus), ("run_minus", run_minus)):
        instance(field, each, Run)
    for field, other in (("pushed_plus", pushed_plus), ("pushed_minus", pushed_minus)):
        if other is not None:
            instance(field, other, Run)
    if (pushed_plus is None) != (pushed_minus is None):
        missing = "pushed_plus" if pushed_plus is None else "pushed_minus"
        raise ValueError(f"{missing} is missing: give both pushed runs, or none")
    instance("disturbance", disturbance, str, "text")
    pushed = None
    if pushed_plus is not None and pushed_minus is not None:
        pushed = (pushed_plus, pushed_minus)
    with styled():
        figure, axes = panels(3, 2 if pushed else 1, PAGE if pushed else COLUMN, 4.4, sharex="col")
        for row, (index, symbol, unit) in enumerate(reversed(POSE)):
            each = axes[row, 0]
            for run, style in zip((run_plus, run_minus), LINES, strict=False):
                line(each, run.t, run.q[:, index] * unit.per_si, **style, label=_kappa(run))
            each.set_ylabel(name(symbol, unit))
            tag(each, LETTERS[row])
        number_operations(axes[0, 0], run_plus)
        time_axis(run_plus, axes[:, 0].tolist())
        legend_above(figure, axes[:1, 0].tolist())
        if pushed:
            _pushed(axes[:, 1], *pushed)
            axes[0, 1].set_title(f"under {disturbance}", pad=3.0)
        least_range(axes.flat)
        figure.align_ylabels()
        return figure


def _kappa(run: Run) -> str:
    return rf"$\kappa = {outline.tip_of(run.scene, 0).tilt_coupling:+g}$"


def _pushed(column: NDArray[Any], plus: Run, minus: Run) -> None:
    """Draws tilt and both compressions after a disturbance; a cross marks the loss of the grasp."""
    onset = measures.onset(plus)
    for row, (index, symbol, unit) in enumerate((POSE[2], *COMPRESSIONS)):
        each = column[row]
        for run, style in ((plus, LINES[0]), (minus, LINES[1])):
            since = run.t - onset
            # A run that ended before the onset shows its last row.
            shown = since >= min(1.2 * _BEFORE, since[-1])
            values = run.q[shown, index] * unit.per_si
            line(each, since[shown], values, **style, label=_kappa(run))
            if run.success:
                continue
            end = float(since[-1])
            color = style["color"]
            each.plot(end, values[-1], marker="x", markersize=5.0, color=color, linestyle="none")
            if row == 0:
                each.annotate(
                    run.status,
                    (end, values[-1]),
                    xytext=(5.0, 0.0),
                    textcoords="offset points",
                    va="center",
                    fontsize=8.0,
                    color=color,
                )
        each.set_ylabel(name(symbol, unit))
        tag(each, LETTERS[3 + row])
    # This margin keeps tick labels away from the title.
    column[0].margins(y=0.25)
    column[0].set_xlim(_BEFORE, max(measures.busy(*measures.response(plus)), 0.05))
    column[-1].set_xlabel("time from the onset [s]")


def run(run: Run) -> Figure:
    """An overview of everything that a run recorded; dotted lines are first violations.

    Args:
        run: A run with something recorded.

    Raises:
        TypeError: `run` is not a Run.
        NotRecordedError: Nothing was recorded.
        ImportError: matplotlib is not installed.
    """
    instance("run", run, Run)
    parts = _OVERVIEW + (_UNILATERAL if run.scene.contact == "unilateral" else ())
    drawn = [(title, draw) for recorded, title, draw in parts if recorded in run.record]
    if not drawn:
        raise NotRecordedError("no quantity to plot was recorded: pass record=('state',)")
    # The violation that ended the run needs no line: the curves end there.
    noted = {name: time for name, time in run.violations.items() if name != run.status}
    columns = min(2, len(drawn))
    rows = -(-len(drawn) // columns)
    width = PAGE if columns > 1 else COLUMN
    with styled():
        figure, axes, strips = contact_bands.panels_over_bands(
            {"": run}, rows, columns, width, 1.4 * rows + 0.7, sharex=True
        )
        for each, letter, (title, draw) in zip(axes.flat, LETTERS, drawn, strict=False):
            draw(each, run)
            tag(each, letter, title)
            legend(each)
            for time in noted.values():
                mark = each.axvline(time, color=RED, linewidth=0.7, linestyle=":", zorder=0.6)
        least_range(axes.flat[: len(drawn)])
        for each in axes.flat[len(drawn) :]:
            each.set_visible(False)
        contact_bands.add_bands(figure, strips, run)
        for k, column in enumerate(axes.T):
            shown = [each for each in column if each.get_visible()]
            time_axis(run, [*shown, *strips[k : k + 1]])
            if not strips:
                shown[-1].tick_params(labelbottom=True)
            figure.align_ylabels(shown)
        first = ", ".join(f"{name} first at {time:.4g} s" for name, time in noted.items())
        figure.legend(
            [mark] if noted else [],
            [fill(first, 60)] if noted else [],
            title=f"{run.status} at {run.t[-1]:.4g} s",
            title_fontsize=9.0,
            loc="outside upper center",
        )
        return figure


def _fingers(axes: Axes, run: Run) -> None:
    target = measures.target_angles(run)
    for k, (index, symbol, unit) in enumerate(ANGLES):
        line(axes, run.t, run.q[:, index] * unit.per_si, **LINES[k], label=f"${symbol}$")
    if target is not None:
        for k in (0, 1):
            style = {**TARGET, "color": BLACK, "linestyle": ":"}
            label = "target" if k == 0 else None
            line(axes, run.t, target[:, k] * DEG.per_si, **style, label=label)
    axes.set_ylabel("angle [deg]")


def _position(axes: Axes, run: Run) -> None:
    for k, (index, symbol, unit) in enumerate(POSE[:2]):
        moved = (run.q[:, index] - run.q[0, index]) * unit.per_si
        line(axes, run.t, moved, **LINES[k], label=rf"$\Delta {symbol}$")
    axes.set_ylabel("displacement [mm]")


def _tilt(axes: Axes, run: Run) -> None:
    line(axes, run.t, run.q[:, 2] * DEG.per_si, color=BLACK, label=f"${TILT}$")
    axes.set_ylabel("angle [deg]")


def _compression(axes: Axes, run: Run) -> None:
    for k, (index, symbol, unit) in enumerate(COMPRESSIONS):
        line(axes, run.t, run.q[:, index] * unit.per_si, **LINES[k], label=f"${symbol}$")
    axes.set_ylabel("$d_n$ [mm]")


def _multipliers(axes: Axes, run: Run) -> None:
    for k, symbol in enumerate(("_1^H", "_2^H", "_1^N", "_2^N")):
        line(axes, run.t, run.multipliers[:, k], **LINES[k], label=rf"$\lambda{symbol}$")
    axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0.8)
    axes.set_ylabel("force [N]")


def _residuals(axes: Axes, run: Run) -> None:
    residual(axes, run, [0, 1], color=LINES[0]["color"], label="$|C^H|$ [m]")
    residual(axes, run, [2, 3], color=LINES[1]["color"], label="$|C^N|$ [m/s]")
    whole_decades(axes)
    axes.set_ylabel("residual")


def _torques(axes: Axes, run: Run) -> None:
    for k in (0, 1):
        line(axes, run.t, run.torque[:, k], **LINES[k], label=rf"$\tau_{k + 1}$")
    axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0.8)
    axes.set_ylabel("torque [N m]")


# The recorded quantity that a panel needs, the panel's title, and the function that draws it.
_OVERVIEW: tuple[tuple[str, str, Callable[[Axes, Run], None]], ...] = (
    ("state", "fingers", _fingers),
    ("state", "object", _position),
    ("state", "object", _tilt),
    ("state", "compression", _compression),
    ("multipliers", "forces", _multipliers),
    ("torque", "torques", _torques),
    ("residuals", "residuals", _residuals),
    ("energy", "ledger", lambda axes, run: ledger(axes, run, run.t, EVERYTHING)),
    ("energy", "its error", lambda axes, run: closure(axes, run, run.t, EVERYTHING)),
)
# More panels of runs with unilateral contact.
_UNILATERAL: tuple[tuple[str, str, Callable[[Axes, Run], None]], ...] = (
    ("residuals", "gaps", lambda axes, run: gap(axes, run, run.t, EVERYTHING)),
    ("residuals", "slip", lambda axes, run: slip(axes, run, run.t, EVERYTHING)),
    ("energy", "by contact", lambda axes, run: contact_energy(axes, run, run.t, EVERYTHING)),
)
