"""Figures that compare runs over time: `disturbances`, `contact_models` and `tilt_coupling`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..run import measures as measures
from ..run.run import Run
from ..support.arrays import Floats
from ..support.checks import instance, shown
from .style import COLUMN, LETTERS, LINES, PAGE, Unit, styled
from .timeline import (
    COMPRESSIONS,
    POSE,
    Column,
    Curve,
    Panel,
    axis_name,
    draw,
    fingers,
    number_operations,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Start of the time axis of a disturbed run, relative to the onset, s.
_BEFORE = -0.02
_SINCE = "time from the onset [s]"
# Times since the onset (k,), s, and changes of q (k, 9): see `measures.response`.
_Response = tuple[Floats, Floats]


@styled()
def disturbances(runs: Mapping[str, Run], undisturbed: Mapping[str, Run] | None = None) -> Figure:
    """Changes of finger angles and object pose after disturbances (the paper's Fig. 7).

    Time counts from the onset. Lasting forces have a column of their own, left of transient ones,
    because their effects are larger by one or two orders of magnitude.

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
    responses = {name: measures.response(run, twins.get(name)) for name, run in named.items()}
    styles = _styles(named)
    stays = {name: run for name, run in named.items() if measures.lasting(run)}
    passes = {name: run for name, run in named.items() if name not in stays}
    columns: list[Column] = []
    coordinates = fingers(next(iter(runs.values())).scene) + POSE
    for title, group in (("forces that stay", stays), ("forces that pass", passes)):
        if not group:
            continue
        some = {name: responses[name] for name in group}
        drawn = [_change(some, styles, *quantity) for quantity in coordinates]
        until = max(measures.busy(*each) for each in some.values())
        letters = LETTERS[len(columns) * len(drawn) :]
        title, onsets = f"{title}: {', '.join(group)}", _onsets(group)
        columns.append(Column(drawn, group, (0.0, until or None), _SINCE, letters, title, onsets))
    width = PAGE if len(columns) > 1 else COLUMN
    return draw(columns, width, 1.28 * len(columns[0].panels))[0]


def _require_runs(field: str, runs: object, least: int = 0) -> None:
    """Refuses anything but a dictionary of runs."""
    instance(field, runs, Mapping, "a dictionary of runs")
    assert isinstance(runs, Mapping)
    for name, each in runs.items():
        instance(f"{field}[{shown(name)}]", each, Run)
    if len(runs) < least:
        raise ValueError(f"{field} is empty: must have a run")


def _styles(names: Sequence[str] | Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    return {name: LINES[k % len(LINES)] for k, name in enumerate(names)}


def _onsets(runs: Mapping[str, Run]) -> dict[str, float]:
    return {name: measures.onset(run) for name, run in runs.items()}


def _change(
    responses: Mapping[str, _Response],
    styles: Mapping[str, Any],
    index: int,
    symbol: str,
    unit: Unit,
) -> Panel:
    """The changes of one column of q in several runs, in a unit that fits the largest."""
    peak = max(float(np.abs(change[:, index]).max()) for _, change in responses.values())
    unit = unit.finer(peak)
    curves = [
        Curve(t, change[:, index] * unit.per_si, styles[name], name)
        for name, (t, change) in responses.items()
    ]
    return Panel(axis_name(symbol, unit, change=True), curves, zero=True)


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
    instance("columns", columns, Mapping, "a dictionary of dictionaries of runs")
    for title, runs in columns.items():
        _require_runs(f"columns[{shown(title)}]", runs, 1)
    if not columns:
        raise ValueError("columns is empty: must have a scene")
    styles = _styles(list(dict.fromkeys(name for runs in columns.values() for name in runs)))
    scenes = []
    for k, (title, runs) in enumerate(columns.items()):
        responses = {name: measures.response(run) for name, run in runs.items()}
        drawn = []
        for quantity in POSE:
            panel = _change(responses, styles, *quantity)
            ends = [_cross(curve) for curve in panel.curves if not runs[curve.label].success]
            drawn.append(panel._replace(curves=[*panel.curves, *ends]))
        disturbed = any(run.scene.disturbances for run in runs.values())
        last = max(
            measures.busy(*each) if disturbed else float(each[0][-1]) for each in responses.values()
        )
        letters, time = LETTERS[len(POSE) * k :], _SINCE if disturbed else "time [s]"
        scenes.append(Column(drawn, runs, (0.0, last or None), time, letters, title, _onsets(runs)))
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
        run_plus: A run with `tilt_coupling` = 1 and "state" recorded.
        run_minus: A run of this scene with `tilt_coupling` = -1 and "state" recorded.
        pushed_plus: A run with `tilt_coupling` = 1 under a disturbance. With `pushed_minus` it adds
            a second column with tilt and compressions.
        pushed_minus: A run of that scene with `tilt_coupling` = -1.
        disturbance: Name of the disturbance, for the second column's title.
    """
    pushed = {"pushed_plus": pushed_plus, "pushed_minus": pushed_minus}
    given = {field: each for field, each in pushed.items() if each is not None}
    for field, each in {"run_plus": run_plus, "run_minus": run_minus, **given}.items():
        instance(field, each, Run)
    if len(given) == 1:
        missing = next(field for field in pushed if field not in given)
        raise ValueError(f"{missing} is missing: give both pushed runs, or none")
    instance("disturbance", disturbance, str, "text")
    poses = [
        Panel(
            axis_name(symbol, unit),
            [
                Curve(run.t, run.q[:, index] * unit.per_si, style, _kappa(run))
                for run, style in zip((run_plus, run_minus), LINES, strict=False)
            ],
        )
        for index, symbol, unit in reversed(POSE)
    ]
    columns = [Column.of(run_plus, poses)._replace(runs={})]
    if pushed_plus is not None and pushed_minus is not None:
        columns.append(_pushed(pushed_plus, pushed_minus, disturbance))
    figure, axes = draw(columns, PAGE if len(columns) > 1 else COLUMN, 4.4)
    number_operations(axes[0, 0], run_plus)
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
            rows = since >= min(1.2 * _BEFORE, since[-1])
            curve = Curve(since[rows], run.q[rows, index] * unit.per_si, style, _kappa(run))
            curves += [curve] if run.success else [curve, _cross(curve, run.status)]
        drawn.append(Panel(axis_name(symbol, unit), curves))
    end = max(measures.busy(*measures.response(plus)), 0.05)
    return Column(drawn, {}, (_BEFORE, end), _SINCE, LETTERS[3:], f"under {disturbance}")
