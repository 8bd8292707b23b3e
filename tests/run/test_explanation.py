"""What `explain` says, beside what runs do and what can be counted by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from scenes import SCENES, uneven
from softpinch import _core

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
    assert more.flops_per_evaluation > found.flops_per_evaluation
    assert "energy ledger" in more.kept
    assert "energy ledger" in found.left_out
    if formulation == "nullspace" and fingers == "pid":
        start = scene.start()
        state = (start.q[None], start.p[None], np.array([start.integral]))
        modes = sp.modes(scene, [0.0], *state, formulation=formulation)
        assert modes.jacobian.shape[-1] == found.states


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("method", ["rk4", "radau5"])
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


def test_what_is_there_and_what_is_not() -> None:
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
    assert bare.flops_per_step is not None
    assert full.flops_per_step is not None
    assert bare.flops_per_step < full.flops_per_step
    zero = next(term for term in bare.terms if term.name == "gravity")
    assert zero.kept
    assert "no measurable time" in zero.reason
    assert bare.bytes_in_ensemble + 8 == full.bytes_in_ensemble


def test_a_sine_costs_a_sine() -> None:
    """Five fused multiply-adds and few others more (see the core's own test)."""
    scene = sp.Scene()
    more = replace(scene, disturbances=[sp.Sine(frequency_hz=9.0, force=(1.0, 0.0))])
    found = [sp.explain(s, measure=False) for s in (scene, more)]
    fused = [one.operations["fused multiply-add"] for one in found]
    assert 5 <= fused[1] - fused[0] <= 10
    assert found[0].operations["divide"] == found[1].operations["divide"]


def test_each_further_sine_costs_the_same_and_many_are_waited_for() -> None:
    sines = [sp.Sine(frequency_hz=9.0 + k, force=(1.0, 0.0)) for k in range(40)]

    def found(count: int, formulation: str) -> sp.Explanation:
        scene = sp.Scene(disturbances=sines[:count])
        return sp.explain(scene, formulation=formulation, measure=False)

    for formulation in _core.FORMULATIONS:
        counts = [found(count, formulation) for count in (1, 2, 3, 4, 40)]
        flops = [one.flops_per_evaluation for one in counts]
        steps = [one.flops_per_step or 0 for one in counts]
        for numbers in (flops, steps):
            each = numbers[1] - numbers[0]
            assert np.diff(numbers[:4]).tolist() == 3 * [each]
            assert numbers[4] - numbers[3] == 36 * each
        waits = [one.latency_per_step or 0 for one in counts]
        assert waits[0] == waits[3] < waits[4]


@pytest.mark.parametrize("method", ["rk4", "dop853"])
def test_only_inputs_that_hold_at_the_start_count(method: str) -> None:
    def flops(**changes: Any) -> tuple[int, int]:
        found = sp.explain(sp.Scene(**changes), method=method, measure=False)
        return found.flops_per_evaluation, found.flops_per_step or 0

    constant = flops()
    assert flops(disturbances=[sp.Sine(frequency_hz=9.0, time=0.1)]) == constant
    assert flops(disturbances=[sp.Sine(frequency_hz=9.0, time=-1.0, duration=1.0)]) == constant
    assert flops(disturbances=[sp.Sine(frequency_hz=9.0, time=-1.0)]) > constant
    assert flops(disturbances=[sp.Step(time=0.0, force=(1.0, 0.0))]) == constant
    angles = np.deg2rad([[6, 6], [8, 7]])
    later, now, over = (
        flops(schedule=sp.Schedule.minimum_jerk([begin - 1.0, begin], angles, move_time=0.1))
        for begin in (0.1, 0.0, -0.1)
    )
    assert later == over == constant < now
    line = flops(schedule=sp.Schedule.ramps([-1.0, 1.0], angles))
    # Four more powers in each of five polynomials, a fused multiply-add each.
    assert now[0] - line[0] == 4 * 5 * 2
    # Limited friction is watched: a product for each tip, at each step.
    assert flops(friction=0.5) == (constant[0], constant[1] + 2)
    assert flops(friction=math.inf) == constant


def test_it_reads_well_and_measures() -> None:
    found = sp.explain(sp.Scene(schedule=SMOOTH), dt=1e-4)
    text = str(found)
    for words in (
        "csm, rk4, pid fingers",
        "9 velocities, 20 states",
        "left out:",
        "a step there: ",
    ):
        assert words in text
    assert found.seconds_per_step is not None
    assert 1e-9 < found.seconds_per_step < 1e-3
    free = sp.explain(sp.Scene(), method="radau5", tolerance=1e-6)
    assert free.steps is None
    assert free.flops_per_step is None
    assert free.bytes_recorded is None
    assert "chosen by the error control" in str(free)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"summaries": "peak"}, "summaries = 'peak': must be"),
        ({"method": "euler"}, "method = 'euler'"),
        ({"record": "q"}, "record"),
        ({"dt": 0.0}, "dt"),
    ],
    ids=str,
)
def test_bad_input_is_named(how: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sp.explain(sp.Scene(), **how)


def test_terms_name_each_thing_once() -> None:
    found = sp.explain(sp.Scene(), measure=False)
    names = [term.name for term in found.terms]
    assert len(set(names)) == len(names)
    assert found.simd == _core.simd_level()


@pytest.mark.parametrize(
    ("name", "disturbance"),
    [
        ("sines", {"kind": sp.Sine, "frequency_hz": 9.0, "force": (1.0, 0.0)}),
        ("forces", {"kind": sp.Step, "force": (1.0, 0.0)}),
        ("impulses", {"kind": sp.Impulse, "impulse": (0.01, 0.0)}),
        (
            "noise",
            {"kind": sp.Noise, "force_std": (1.0, 0.0), "moment_std": 0.0, "rate_hz": 100.0},
        ),
    ],
)
def test_what_comes_after_the_end_is_left_out(name: str, disturbance: dict[str, Any]) -> None:
    values = dict(disturbance)
    kind = values.pop("kind")
    for time, kept in ((0.0, True), (0.05, True), (0.1, False), (9.0, False)):
        scene = sp.Scene(duration=0.1, disturbances=[kind(time=time, **values)])
        assert (name in sp.explain(scene, measure=False).kept) == kept, time
    later = sp.Schedule.minimum_jerk([0.0, 0.2], np.deg2rad([[6, 6], [8, 7]]), move_time=0.1)
    for duration, kept in ((0.1, False), (0.25, True)):
        scene = sp.Scene(duration=duration, schedule=later)
        assert ("schedule" in sp.explain(scene, measure=False).kept) == kept


def test_bytes_of_rows_asked_for_count_the_end() -> None:
    how: dict[str, Any] = {"method": "dop853", "tolerance": 1e-6}
    for times in ([0.01, 0.02], [0.01, 0.1]):
        found = sp.explain(sp.Scene(duration=0.1), times=times, measure=False, **how)
        run = sp.simulate(sp.Scene(duration=0.1), times=times, **how)
        arrays = [run.t, *run.arrays().values()]
        assert found.bytes_recorded == sum(a.nbytes for a in arrays) + 8 * 2 * len(run)
