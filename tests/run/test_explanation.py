"""`sp.explain` beside what runs do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from scenes import SCENES, uneven
from softpinch import _core
from unilateral_scenes import RECORD, regripped

SMOOTH = sp.Schedule.minimum_jerk([0.0, 0.01], np.deg2rad([[6, 6], [8, 7]]), move_time=0.02)
STATES = {
    ("csm", "pid"): (9, 20),
    ("projected", "pid"): (9, 20),
    ("nullspace", "pid"): (5, 14),
    ("csm", "driven"): (7, 14),
    ("projected", "driven"): (7, 14),
    ("nullspace", "driven"): (3, 8),
}


@pytest.mark.parametrize(("formulation", "fingers"), STATES)
def test_states_and_velocities(formulation: str, fingers: str) -> None:
    scene = sp.Scene(schedule=SMOOTH, fingers=fingers)
    found = sp.explain(scene, formulation=formulation, measure=False)
    assert (found.degrees, found.states) == STATES[formulation, fingers]
    more = sp.explain(scene, formulation=formulation, record="energy", measure=False)
    assert more.states == found.states + 4
    assert "energy ledger" in more.kept and "energy ledger" in found.left_out
    if formulation == "nullspace" and fingers == "pid":
        start = scene.start()
        state = (start.q[None], start.p[None], np.array([start.integral]))
        modes = sp.modes(scene, [0.0], *state, formulation=formulation)
        assert modes.jacobian.shape[-1] == found.states


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize(("every", "method"), [(1, "radau5"), (7, "rk4")])
def test_steps_and_bytes_are_those_of_the_run(name: str, every: int, method: str) -> None:
    scene = replace(SCENES[name], duration=0.05)
    how: dict[str, Any] = {"dt": 3e-4, "every": every, "method": method}
    record = ("state", "residuals", "torque")
    found = sp.explain(scene, record=record, measure=False, **how)
    run = sp.simulate(scene, record=record, stop_on=(), **how)
    assert found.steps == run.stats["steps"]
    assert found.segments == run.stats["segments"]
    # What else a row has lets a run go on from it: the grid's two numbers, a Jacobian's place.
    hidden = 2 + (21 if method == "radau5" else 0)
    arrays = [run.t, *run.arrays().values()]
    assert found.bytes_recorded == sum(a.nbytes for a in arrays) + 8 * hidden * len(run)


def test_the_motion_of_the_hand_is_named() -> None:
    scene = sp.Scene(motion=sp.HandMotion.sine(0.01, 5.0, "x"))
    moving, still = (sp.explain(each, record="energy", measure=False)
                     for each in (scene, replace(scene, motion=None)))  # fmt: skip
    (reason,) = [term.reason for term in moving.terms if term.name == "motion of the hand"]
    assert "motion of the hand" in moving.kept and reason.startswith("HandMotion.sine: ")
    assert "turns" not in reason
    assert "motion of the hand" in still.left_out and moving.states == still.states + 1
    assert reason in str(moving)


def test_controllers_are_named_with_their_periods() -> None:
    blocks = [sp.SampledController.pid(period, kp=20.0, kd=0.2, ki=0.0) for period in (0.04, 1e-3)]
    for control, periods in ((blocks[1], "0.001 s"), (blocks, "0.04 s and every 0.001 s")):
        if isinstance(control, list):
            control = sp.SampledController.cascade(control)
        terms = sp.explain(sp.Scene(control=control), measure=False).terms
        (reason,) = [one.reason for one in terms if one.name == "finger angles and controllers"]
        assert reason == f"a sample every {periods} turns the fingers"
    two = replace(blocks[1], switch=sp.GainSwitch(D=2.0 * blocks[1].D, at=0.1))
    names = [one.name for one in sp.explain(sp.Scene(control=two), measure=False).terms]
    assert "finger angles and controllers with two sets of gains" in names


def test_bytes_of_chosen_rows_include_the_end() -> None:
    how: dict[str, Any] = {"method": "dop853", "tolerance": 1e-6}
    for times in ([0.01, 0.02], [0.01, 0.1]):
        found = sp.explain(sp.Scene(duration=0.1), times=times, measure=False, **how)
        run = sp.simulate(sp.Scene(duration=0.1), times=times, **how)
        arrays = [run.t, *run.arrays().values()]
        assert found.bytes_recorded == sum(a.nbytes for a in arrays) + 8 * 2 * len(run)


def test_parts_are_computed_or_left_out() -> None:
    full = sp.explain(
        replace(uneven(), disturbances=[sp.Sine(frequency_hz=9.0), sp.Impulse(time=0.01)]),
        summaries=("peak_rotation", "final_state"),
        measure=False,
    )
    assert {"sines", "impulses", "schedule", "stabilisation", "summaries"} <= set(full.kept)
    assert {"forces", "noise", "projection", "energy ledger"} <= set(full.left_out)
    bare = sp.explain(
        sp.Scene(schedule=SMOOTH, fingers="driven", gravity=0.0),
        formulation="nullspace",
        record=(),
        measure=False,
    )
    assert {"finger angles and PID", "integral state", "sines", "impulses", "forces", "noise",
            "stabilisation", "recording", "summaries"} <= set(bare.left_out)  # fmt: skip
    zero = next(term for term in bare.terms if term.name == "gravity")
    assert zero.kept and "no measurable time" in zero.reason
    assert bare.bytes_in_ensemble + 8 == full.bytes_in_ensemble
    for found in (full, bare):
        assert len({term.name for term in found.terms}) == len(found.terms)


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("sines", lambda time: sp.Sine(time=time, frequency_hz=9.0, force=(1.0, 0.0))),
        ("forces", lambda time: sp.Step(time=time, force=(1.0, 0.0))),
        ("impulses", lambda time: sp.Impulse(time=time, impulse=(0.01, 0.0))),
        ("noise", lambda time: sp.Noise(time=time, force_std=1.0, moment_std=0.0, rate_hz=100.0)),
    ],
)
def test_inputs_after_the_end_are_left_out(name: str, make: Any) -> None:
    for time, kept in ((0.0, True), (0.05, True), (0.1, False), (9.0, False)):
        scene = sp.Scene(duration=0.1, disturbances=[make(time)])
        assert (name in sp.explain(scene, measure=False).kept) == kept, time


def test_unilateral_contact_has_modes_and_three_more_works() -> None:
    scene = regripped()
    found = sp.explain(scene, record=RECORD, measure=False)
    both = sp.explain(replace(scene, contact="bilateral"), record=RECORD, measure=False)
    assert "contact modes" in found.kept and "contact modes" in both.left_out
    assert found.states == both.states + 3 == 27
    assert sp.explain(scene, measure=False).states == 20
    assert found.steps == sp.simulate(scene).stats["steps"]


def test_the_report_has_the_measured_time_of_a_step() -> None:
    found = sp.explain(sp.Scene(schedule=SMOOTH), dt=1e-4)
    text = str(found)
    for words in ("csm, rk4, pid fingers", "9 velocities, 20 states", "left out:", "measured time"):
        assert words in text
    assert found.seconds_per_step is not None
    assert 1e-9 < found.seconds_per_step < 1e-3
    assert found.simd == _core.simd_level()
    free = sp.explain(sp.Scene(), method="radau5", tolerance=1e-6)
    assert free.steps is None and free.bytes_recorded is None
    assert "chosen by the error control" in str(free)


@pytest.mark.parametrize(
    ("how", "message"),
    [({"summaries": "peak"}, "summaries = 'peak': must be"), ({"record": "q"}, "record = 'q'")],
    ids=str,
)
def test_wrong_arguments_are_named(how: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sp.explain(sp.Scene(), **how)
