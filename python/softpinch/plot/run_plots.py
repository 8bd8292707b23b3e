"""Figures over time, of one run and of several."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from ..run import ContactMode, Run, measures
from ..scene import jaws, outline
from ..scene.fields import QUANTITIES, label
from ..support import NotRecordedError, checks
from .style import BLACK, COLUMN, DEG, GREY, LETTERS, LINES, MM, PAGE, RED, TARGET, Unit, styled
from .timeline import COMPRESSIONS, POSE, Column, Curve, Panel, draw, fingers, lines, recorded

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FINGERS = ("finger 1 (right)", "finger 2 (left)")
# The orders of magnitude of the residuals that the paper states for its Fig. 6, m and m/s.
_ORDERS = (1e-8, 1e-8, 1e-6, 1e-6)
_PAPER = {"color": BLACK, "linewidth": 0.7, "linestyle": (0, (4, 2)), "zorder": 1.0}
# Residuals below this, m or m/s, are round-off; they are drawn here, as zero has no logarithm.
_ROUND_OFF = 1e-16
# The residual axis extends at least to this value, which is above the paper's orders of magnitude.
_RESIDUAL_TOP = 5e-4
# Time of `forces` before and after the smallest pressing force, s.
_BEFORE, _AFTER = 2.5e-3, 10e-3
# The place on the friction axis that stands for infinity, and the axis limits.
_INFINITE, _FRICTION_RANGE = 1e2, (1e-4, 3e2)
# Changes of mode that follow each other within this time, s, belong together.
_TOGETHER = 0.02
# The shortest window around such changes, s, and the room before and after them, as its share.
_WINDOW, _ROOM = 1e-3, (0.15, 0.35)
# Start of the time axis of a disturbed run, relative to the onset, s.
_EARLIER = -0.02
_SINCE = "time from the onset [s]"


@styled()
def motion(run: Run) -> Figure:
    """Finger angles, their targets and the object's pose (the paper's Fig. 5); needs "state"."""
    checks.instance("run", run, Run)
    target = measures.target_angles(run)
    drawn = []
    for index, symbol, unit in fingers(run.scene) + POSE:
        curves = [Curve(run.t, run.q[:, index] * unit.per_si, {"color": BLACK}, "simulated")]
        if index >= 3 and target is not None:
            curves.append(Curve(run.t, target[:, index - 3] * unit.per_si, TARGET, "target"))
        drawn.append(Panel.of(symbol, unit, curves))
    return draw([Column.of(run, drawn)], COLUMN, 6.2, numbered=run)[0]


@styled()
def residuals(run: Run) -> Figure:
    """The constraint residuals (9, 12) over time, on logarithmic axes (the paper's Fig. 6).

    The run has "residuals" recorded. Values below 1e-16 are round-off and are drawn at 1e-16.
    Dashed lines are the orders of magnitude that the paper states. In unilateral contact the
    residuals of constraints that do not act are left out: C^H of a free tip, C^N of a tip that does
    not stick.
    """
    checks.instance("run", run, Run)
    drawn = []
    quantity = QUANTITIES["residuals"]
    for k, (column, unit) in enumerate(zip(quantity.columns, quantity.units, strict=True)):
        size = _residual(run, [k], LINES[k % 2]["color"])
        paper = Curve(run.t, np.full(len(run), _ORDERS[k]), _PAPER)
        name = f"$|{label(column).strip('$')}|$ [{unit}]"
        drawn.append(Panel(name, [size, paper], decades=4))
    figure, axes = draw([Column.of(run, drawn)], COLUMN, 5.2, "none", numbered=run)
    first = axes[0, 0]
    for each, order in zip(axes[:, 0], _ORDERS, strict=True):
        if each is not first:
            each.sharey(first)
        place = (0.995, order), (0.0, 1.5), each.get_yaxis_transform(), "offset points"
        text = f"paper: $10^{{{round(np.log10(order))}}}$"
        each.annotate(text, *place, ha="right", va="bottom", fontsize=8.0)
    first.set_ylim(_ROUND_OFF, max(_RESIDUAL_TOP, first.get_ylim()[1]))
    return figure


@styled()
def forces(run: Run) -> Figure:
    """Contact forces, required friction and energy ledger, which the paper does not show.

    The run has "multipliers" and "energy" recorded. The left column has the whole run, the right
    column the time around the smallest pressing force. While a tip would have to pull (lambda^H <
    0), the right column is shaded, and the friction that no-slip requires is infinite: triangles
    mark these times, which may be too short to be seen.
    """
    checks.instance("run", run, Run)
    start = float(run.t[int(np.argmin(run.multipliers[:, :2].min(axis=1)))])
    pressing, ledger = _pressing(run), _ledger(run)
    closure = _closure(run)._replace(title="error of the ledger")
    whole = Column.of(run, [pressing, _friction(run), ledger, closure])
    zoom = whole.zoomed(start - _BEFORE, start + _AFTER, "around the smallest force")
    figure, axes = draw([whole, zoom], PAGE, 6.2, "panels", sharey="row", width_ratios=(1.35, 1.0))
    _mark_pulls(axes[0, 0], axes[:2, 1], run)
    labels = {1e-4: "$10^{-4}$", 1e-2: "$10^{-2}$", 1e0: "$10^{0}$", _INFINITE: r"$\infty$"}
    for each in axes[1]:
        each.axhline(_INFINITE, color=GREY, linewidth=0.6, linestyle=":", zorder=0.8)
        # Limits come before the scale, which would otherwise choose its own.
        each.set_ylim(*_FRICTION_RANGE)
        each.set_yscale("log", nonpositive="mask")
        each.set_yticks(list(labels), labels=list(labels.values()))
        each.set_yticks([], minor=True)
    return figure


def _mark_pulls(whole: Axes, zooms: Iterable[Axes], run: Run) -> None:
    """Marks the intervals in which a tip pulls, by triangles and in zooms by shades."""
    for side in (0, 1):
        pulls = np.reshape(measures.pulling_intervals(run, side), (-1, 2))
        color = LINES[side]["color"]
        style: dict[str, Any] = {"color": color, "marker": "v", "linestyle": "none", "zorder": 3.0}
        top = whole.get_xaxis_transform()
        whole.plot(pulls[:, 0], np.full(len(pulls), 0.95), transform=top, **style)
        for each, (begin, end) in itertools.product(zooms, pulls.tolist()):
            each.axvspan(begin, end, facecolor=color, alpha=0.15, linewidth=0.0, zorder=0.4)


def _friction(run: Run) -> Panel:
    """|lambda^N| / lambda^H of both tips, with the friction of the scene."""
    demand = measures.friction_demand(run)
    curves, infinite = [], []
    for k in (0, 1):
        # Values above the place of infinity on the axis are drawn as infinite.
        unbounded = ~(demand[:, k] < _INFINITE)
        needed = np.where(unbounded | (demand[:, k] == 0.0), np.nan, demand[:, k])
        label = rf"$|\lambda_{k + 1}^N| / \lambda_{k + 1}^H$"
        curves.append(Curve(run.t, needed, LINES[k], label))
        style = {"color": LINES[k]["color"], "marker": "v", "linestyle": "none", "zorder": 3.0}
        infinite.append(Curve(run.t, np.where(unbounded, _INFINITE, np.nan), style))
    if run.scene.friction is not None:
        style = {"color": BLACK, "linewidth": 0.7}
        for friction in np.unique(run.scene.friction):
            curves.append(Curve(run.t, np.full(len(run), friction), style, r"$\mu$"))
    name = r"$|\lambda^N| / \lambda^H$ [1]"
    return Panel(name, curves + infinite, "friction that no-slip needs")


@styled()
def contact(run: Run) -> Figure:
    """Gaps and slip of both tips, their pressing forces if recorded, and the modes as bands.

    The run has unilateral contact and "residuals" recorded, best at every step. The left column has
    the whole run, the right column the time around the instant with the most changes of mode. A run
    without a change has only the left column. C^H of (9) is the gap of a free tip, C^N of (12) the
    velocity of slip: that of the object's face over a tip that touches.
    """
    checks.instance("run", run, Run)
    if run.scene.contact != "unilateral":
        rule = "must be 'unilateral'; tips in bilateral contact neither slip nor open"
        raise ValueError(f"run.scene.contact = {run.scene.contact!r}: {rule}")
    drawn = [_gap(run), _slip(run)]
    drawn += [_pressing(run)] if "multipliers" in run.record else []
    drawn = [panel.named(FINGERS)._replace(title="") for panel in drawn]
    # The curves of all panels are those of the fingers, so one legend names them.
    columns = [Column.of(run, drawn)]
    if (window := _busiest(run)) is not None:
        columns.append(columns[0].zoomed(*window))
    width, height = PAGE if window else COLUMN, 1.35 * len(drawn) + 0.5
    return draw(columns, width, height, sharey="row")[0]


def _busiest(run: Run) -> tuple[float, float] | None:
    """A window around the instant with the most changes of mode, s; None if there are none."""
    times = np.array([change.time for change in run.contact_changes])
    if not times.size or run.t[-1] <= run.t[0]:
        return None
    groups = np.split(times, np.flatnonzero(np.diff(times) > _TOGETHER) + 1)
    most = max(groups, key=len)
    length = max(most[-1] - most[0], _WINDOW)
    begin, end = most[0] - _ROOM[0] * length, most[-1] + _ROOM[1] * length
    return max(begin, run.t[0]), min(end, run.t[-1])


@styled()
def run(run: Run) -> Figure:
    """An overview of everything that a run recorded; dotted lines are first violations.

    Of a hand that moves, the last panels have the acceleration of its frame along the hand's own
    axes, without gravity, and its tilt unless it is zero.
    """
    checks.instance("run", run, Run)
    drawn = list(_overview(run))
    if not drawn:
        raise NotRecordedError("no quantity to plot was recorded: pass record=('state',)")
    drawn += _carried(run)
    # The violation that ended the run needs no line: the curves end there.
    noted = {name: time for name, time in run.violations.items() if name != run.status}
    count = min(2, len(drawn))
    columns = [Column.of(run, drawn[k::count], LETTERS[k::count]) for k in range(count)]
    height = 1.4 * len(columns[0].panels) + 0.7
    figure, axes = draw(columns, PAGE if count > 1 else COLUMN, height, "panels")
    for each in axes.flat:
        for time in noted.values():
            mark = each.axvline(time, color=RED, linewidth=0.7, linestyle=":", zorder=0.6)
    first = ", ".join(f"{name} first at {time:.4g} s" for name, time in noted.items())
    figure.legend(
        [mark] if noted else [],
        [fill(first, 60)] if noted else [],
        title=f"{run.status} at {run.t[-1]:.4g} s",
        title_fontsize=9.0,
        loc="outside upper center",
    )
    return figure


def _overview(run: Run) -> Iterator[Panel]:
    unilateral = run.scene.contact == "unilateral"
    if "state" in run.record:
        angles, target = recorded(run, "q", (3, 4)), measures.target_angles(run)
        if target is not None:
            dotted = {**TARGET, "color": BLACK, "linestyle": ":"}
            for (k, _, unit), name in zip(fingers(run.scene), ("target", ""), strict=True):
                angles.append(Curve(run.t, target[:, k - 3] * unit.per_si, dotted, name))
        yield Panel(_of_fingers(run, "angle [deg]", "travel [mm]"), angles, "fingers")
        moved = recorded(run, "q", (0, 1), since_start=True)
        yield Panel("displacement [mm]", moved, "object")
        (tilt,) = recorded(run, "q", (2,))
        yield Panel("angle [deg]", [tilt._replace(style={"color": BLACK})], "object")
        yield Panel("$d_n$ [mm]", recorded(run, "q", (5, 6)), "compression")
    if "multipliers" in run.record:
        yield Panel("force [N]", recorded(run, "multipliers"), "forces", zero=True)
    if "torque" in run.record:
        name = _of_fingers(run, "torque [N m]", "force [N]")
        title = "drives" if any(jaws(run.scene)) else "torques"
        yield Panel(name, recorded(run, "torque"), title, zero=True)
    if "residuals" in run.record:
        sizes = [
            _residual(run, [0, 1], LINES[0]["color"], "$|C^H|$ [m]"),
            _residual(run, [2, 3], LINES[1]["color"], "$|C^N|$ [m/s]"),
        ]
        yield Panel("residual", sizes, "residuals", decades=6)
    if "energy" in run.record:
        yield _ledger(run)
        yield _closure(run)._replace(title="its error")
    if "residuals" in run.record and unilateral:
        yield _gap(run)
        yield _slip(run)
    if "energy" in run.record and unilateral:
        energy = run.energy
        taken = [energy.friction_loss, energy.impact_loss, energy.relaxation_work]
        curves = lines(run.t, np.stack(taken, axis=1), ["friction", "impacts", "relaxation"])
        yield Panel("energy [J]", curves, "by contact")


def _of_fingers(run: Run, link: str, jaw: str) -> str:
    """The name of an axis for links, for jaws, or for one of each."""
    return " or ".join(dict.fromkeys(jaw if each else link for each in jaws(run.scene)))


def _carried(run: Run) -> Iterator[Panel]:
    """Acceleration and tilt of a hand that moves, also between the rows."""
    if run.scene.motion is None:
        return
    begin, end = run.t[[0, -1]]
    # A jump is drawn upright: just before it, and after it.
    jumps = run.scene.motion.breakpoints(begin, end)
    t = np.sort([*np.linspace(begin, end, 1001), *jumps, *np.nextafter(jumps, -np.inf)])
    hand = run.scene.motion.at(t)
    axes = outline.object_axes(hand.tilt)
    along = [(axis * hand.acceleration.T).sum(axis=0) for axis in axes]
    names = ["along its $x$", "along its $y$"]
    yield Panel("acceleration [m/s$^2$]", lines(t, np.array(along).T, names), "hand", zero=True)
    if hand.tilt.any():
        yield Panel("tilt [deg]", [Curve(t, hand.tilt * DEG.per_si, {"color": BLACK})], "hand")


def _pressing(run: Run) -> Panel:
    forces = recorded(run, "multipliers", (0, 1))
    return Panel(r"$\lambda^H$ [N]", forces, "pressing force", zero=True).named(FINGERS)


def _residual(run: Run, columns: Sequence[int], color: str, label: str = "") -> Curve:
    """The largest magnitude, at least `_ROUND_OFF`, of some residuals of acting constraints."""
    sizes = np.where(measures.active_constraints(run), np.abs(run.residuals), np.nan)
    # Unlike the maximum, fmax ignores nan.
    size = np.fmax.reduce(sizes[:, list(columns)], axis=1)
    return Curve(run.t, np.maximum(size, _ROUND_OFF), {"color": color, "linewidth": 0.6}, label)


def _gap(run: Run) -> Panel:
    """C^H of both tips: of a free tip its gap, else about zero."""
    unit = MM.finer(float(np.abs(run.residuals[:, :2]).max()))
    curves = lines(run.t, run.residuals[:, :2] * unit.per_si, [label("C_1H"), label("C_2H")])
    return Panel(f"gap [{unit.name}]", curves, "gaps")


def _slip(run: Run) -> Panel:
    """C^N of both tips, the velocity of slip; not of a tip that is free."""
    touches = measures.contact_modes(run) != ContactMode.FREE
    speed = np.where(touches, run.residuals[:, 2:], np.nan)
    return Panel("slip [m/s]", lines(run.t, speed, [label("C_1N"), label("C_2N")]), "slip", True)


def _ledger(run: Run) -> Panel:
    """Stored energy, works and losses since the start."""
    energy = run.energy
    lost = energy.viscous_loss + (energy.friction_loss + energy.impact_loss)
    curves = [
        Curve(run.t, energy.total - sum(energy.start), LINES[3], "stored"),
        Curve(run.t, energy.controller_work, LINES[0], "torques"),
        Curve(run.t, lost, LINES[1], "lost"),
    ]
    # Many scenes have no disturbance and no motion; a line at zero would be useless.
    others = (energy.external_work, "loads"), (energy.motion_work, "motion")
    for (work, name), style in zip(others, (LINES[2], LINES[4]), strict=True):
        if work.any():
            curves.append(Curve(run.t, work, style, name))
    return Panel("energy [J]", curves, "ledger")


def _closure(run: Run) -> Panel:
    curve = Curve(run.t, np.abs(run.energy.closure), {"color": BLACK})
    return Panel("|closure| [J]", [curve], decades=6)


@styled()
def disturbances(runs: Mapping[str, Run], undisturbed: Mapping[str, Run] | None = None) -> Figure:
    """Changes of finger angles and object pose after disturbances (the paper's Fig. 7).

    Time counts from the onset; a cross marks the end of a run that ended early. Lasting forces have
    a column of their own, left of transient ones, because their effects are larger by one or two
    orders of magnitude.

    Args:
        runs: Name of each case -> run with "state" recorded.
        undisturbed: Name of each case -> run without the disturbance, which the plotted change is
            relative to. Cases without such a run show the change since the onset, which includes
            any motion that had not settled by then.
    """
    undisturbed = {} if undisturbed is None else undisturbed
    _require_runs("runs", runs, 1)
    _require_runs("undisturbed", undisturbed)
    named = {f"({case})": run for case, run in runs.items()}
    twins = {f"({case})": run for case, run in undisturbed.items()}
    styles = _styles(named)
    stays = {name: run for name, run in named.items() if measures.lasting(run)}
    passes = {name: run for name, run in named.items() if name not in stays}
    columns: list[Column] = []
    coordinates = fingers(next(iter(runs.values())).scene) + POSE
    for title, group in (("forces that stay", stays), ("forces that pass", passes)):
        if not group:
            continue
        title = f"{title}: {', '.join(group)}"
        columns.append(_changes(title, group, twins, styles, coordinates, len(columns)))
    width = PAGE if len(columns) > 1 else COLUMN
    return draw(columns, width, 1.28 * len(columns[0].panels))[0]


def _require_runs(field: str, runs: Mapping[str, object], least: int = 0) -> None:
    checks.instance(field, runs, Mapping, "a dictionary of runs")
    for name, each in runs.items():
        checks.instance(f"{field}[{checks.shown(name)}]", each, Run)
    if len(runs) < least:
        raise ValueError(f"{field} is empty: must have a run")


def _styles(names: Sequence[str] | Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    return {name: LINES[k % len(LINES)] for k, name in enumerate(names)}


def _changes(
    title: str,
    runs: Mapping[str, Run],
    undisturbed: Mapping[str, Run],
    styles: Mapping[str, Any],
    coordinates: Sequence[tuple[int, str, Unit]],
    place: int,
) -> Column:
    """The changes of coordinates in several runs; a cross marks the end of one that ended early."""
    changes = {name: measures.response(run, undisturbed.get(name)) for name, run in runs.items()}
    drawn = []
    for index, symbol, unit in coordinates:
        # A unit that fits the largest change.
        unit = unit.finer(max(float(np.abs(q[:, index]).max()) for _, q in changes.values()))
        curves = [
            Curve(t, q[:, index] * unit.per_si, styles[name], name)
            for name, (t, q) in changes.items()
        ]
        curves += [_cross(curve) for curve in curves if not runs[curve.label].success]
        drawn.append(Panel.of(symbol, unit, curves, change=True))
    disturbed = any(run.scene.disturbances for run in runs.values())
    last = max(measures.busy(t, q) if disturbed else float(t[-1]) for t, q in changes.values())
    letters, time = LETTERS[len(drawn) * place :], _SINCE if disturbed else "time [s]"
    onsets = {name: measures.onset(run) for name, run in runs.items()}
    return Column(drawn, runs, (0.0, last or None), time, letters, title, onsets)


def _cross(curve: Curve, name: str = "") -> Curve:
    """A cross at the end of a curve, where the run ended early."""
    style = {"color": curve.style["color"], "marker": "x", "markersize": 5.0, "linestyle": "none"}
    return Curve(curve.t[-1:], curve.values[-1:], style, name)


@styled()
def contact_models(columns: Mapping[str, Mapping[str, Run]]) -> Figure:
    """The object's motion in scenes with bilateral contact and with several frictions.

    Each column is a scene. Time and change of pose count from the onset of its first disturbance,
    or from the start of the run without one; a column with a disturbance ends when the pose stays.
    A cross marks the end of a run that ended early. Below are two bands for each run with
    unilateral contact: the modes of its right tip above those of its left tip.

    Args:
        columns: Name of each scene -> name of each contact -> run with "state" recorded. The names
            of the contacts are those of the lines, and of the bands.
    """
    checks.instance("columns", columns, Mapping, "a dictionary of dictionaries of runs")
    for title, runs in columns.items():
        _require_runs(f"columns[{checks.shown(title)}]", runs, 1)
    if not columns:
        raise ValueError("columns is empty: must have a scene")
    styles = _styles(list(dict.fromkeys(name for runs in columns.values() for name in runs)))
    scenes = [
        _changes(title, runs, {}, styles, POSE, k)
        for k, (title, runs) in enumerate(columns.items())
    ]
    return draw(scenes, PAGE, 4.2)[0]


@styled()
def tilt_coupling(
    run_plus: Run,
    run_minus: Run,
    pushed_plus: Run | None = None,
    pushed_minus: Run | None = None,
    disturbance: str = "the disturbance",
) -> Figure:
    """The effect of the sign of the shear in (4): kappa = +1, as printed, and kappa = -1.

    Args:
        run_plus, run_minus: Runs of a scene with `tilt_coupling` = 1 and -1, "state" recorded.
        pushed_plus, pushed_minus: Such runs under a disturbance. They add a second column with tilt
            and compressions.
        disturbance: Name of the disturbance, for the second column's title.
    """
    pushed = {"pushed_plus": pushed_plus, "pushed_minus": pushed_minus}
    given = {field: each for field, each in pushed.items() if each is not None}
    for field, each in {"run_plus": run_plus, "run_minus": run_minus, **given}.items():
        checks.instance(field, each, Run)
    if len(given) == 1:
        missing = next(field for field in pushed if field not in given)
        raise ValueError(f"{missing} is missing: give both pushed runs, or none")
    checks.instance("disturbance", disturbance, str, "text")
    poses, both = [], ((run_plus, LINES[0]), (run_minus, LINES[1]))
    for k, symbol, unit in reversed(POSE):
        curves = [Curve(run.t, run.q[:, k] * unit.per_si, line, _kappa(run)) for run, line in both]
        poses.append(Panel.of(symbol, unit, curves))
    columns = [Column.of(run_plus, poses)._replace(runs={})]
    if pushed_plus is not None and pushed_minus is not None:
        columns.append(_pushed(pushed_plus, pushed_minus, disturbance))
    figure, axes = draw(columns, PAGE if len(columns) > 1 else COLUMN, 4.4, numbered=run_plus)
    for panel in axes[0, 1:]:
        # This margin keeps tick labels away from the title.
        panel.margins(y=0.25)
    return figure


def _kappa(run: Run) -> str:
    return rf"$\kappa = {run.scene.hand.tips[0].tilt_coupling:+g}$"


def _pushed(plus: Run, minus: Run, disturbance: str) -> Column:
    """Tilt and both compressions after a disturbance; a cross marks the loss of the grasp."""
    onset = measures.onset(plus)
    drawn = []
    for index, symbol, unit in (POSE[2], *COMPRESSIONS):
        curves = []
        for run, style in ((plus, LINES[0]), (minus, LINES[1])):
            since = run.t - onset
            # A run that ended before the onset shows its last row.
            rows = since >= min(1.2 * _EARLIER, since[-1])
            curve = Curve(since[rows], run.q[rows, index] * unit.per_si, style, _kappa(run))
            curves += [curve] if run.success else [curve, _cross(curve, run.status)]
        drawn.append(Panel.of(symbol, unit, curves))
    end = max(measures.busy(*measures.response(plus)), 0.05)
    return Column(drawn, {}, (_EARLIER, end), _SINCE, LETTERS[3:], f"under {disturbance}")
