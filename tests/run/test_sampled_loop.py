"""The spectral radius of a sampled loop, and the warning of a run that it ruined."""

import warnings
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.analysis.states import OUTPUTS, output_ports
from softpinch.run.stiffness import MEASURED, radius

# With this gain the damping takes a free finger's whole rate away within a period.
DEADBEAT = sp.Finger().inertia / 1e-3
TARGETS = sp.Schedule.steps([0.0], [[0.1, 0.1]])


def said(scene: sp.Scene, **how: Any) -> tuple[sp.Run, list[str]]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", sp.StabilityWarning)
        run = sp.simulate(scene, **how)
    return run, [str(one.message) for one in caught if one.category is sp.StabilityWarning]


@cache
def rest() -> sp.Run:
    """A grasp that has come to rest under a continuous PID."""
    scene = sp.Scene(control=sp.Pid(kp=20.0, kd=0.2, ki=100.0), schedule=TARGETS, duration=5.0)
    return sp.simulate(
        scene, method="radau5", tolerance=1e-13, record=("state", "torque", "multipliers")
    )


def resting(control: sp.SampledController, **changes: Any) -> sp.Scene:
    """A scene that begins at that rest, with the torques that hold it."""
    run = rest()
    state = sp.State.consistent(
        run.scene, x=run.q[-1, 0], y=run.q[-1, 1], rotation=run.q[-1, 2], fingers=run.q[-1, 3:5],
        shear=run.q[-1, 7:],
    )  # fmt: skip
    torque = run.torque[-1]
    q, zero = run.q[-1], np.zeros(2)
    measured = {
        "angle": q[3:5],
        "target": [0.1, 0.1],
        "position": q[:2],
        "rotation": q[2:3],
        "rotation_rate": [0.0],
        "compression": q[5:7],
        "shear": q[7:],
        "multipliers": run.multipliers[-1],
    }
    y = np.hstack([measured.get(name, zero) for name in control.measures])
    begin = np.linalg.solve(control.C, torque - control.D @ y)
    control = replace(control, initial_torque=tuple(torque), initial_state=begin)
    return sp.Scene(control=control, schedule=TARGETS, initial=state, **changes)


def pid(**changes: Any) -> sp.SampledController:
    return sp.SampledController.pid(**{"period": 1e-3, "kp": 4.0, "kd": 0.05, "ki": 20.0} | changes)


def of_everything() -> sp.SampledController:
    """A PID that also feels pose, rates, tips, contact forces and targets, 1.3 ms late."""
    one = np.eye(2)
    sides = np.array([[1.0], [-1.0]])
    measures = ("angle", "target", "angle_rate", "multipliers", "position", "rotation")
    measures = (*measures, "velocity", "rotation_rate", "compression", "shear", "target_rate")
    gains = [-6.0 * one, 6.0 * one, -2.0 * DEADBEAT * one, 0.2 * one, 0.1 * one]
    gains += [3.0 * one, 2.0 * sides, 0.1 * one, 0.02 * sides, 40.0 * one, 20.0 * one, one]
    d = np.hstack(gains)
    b = np.hstack([1e-3 * one, -1e-3 * one, np.zeros((2, d.shape[1] - 4))])
    return sp.SampledController(
        1e-3, A=one, B=b, C=-20.0 * one, D=d, measures=measures, delay=1.3e-3
    )


UNSTABLE = {
    "no delay": pid(kd=4.0 * DEADBEAT),
    "a part of a period": pid(kd=2.5 * DEADBEAT, delay=0.6e-3),
    "one period": pid(kd=2.0 * DEADBEAT, delay=1e-3),
    "a period and a part": pid(kd=2.0 * DEADBEAT, delay=1.4e-3),
    "three periods": pid(kd=1.2 * DEADBEAT, delay=3e-3),
    "every measure": of_everything(),
}


@pytest.mark.parametrize("name", UNSTABLE)
def test_the_radius_is_the_growth_of_the_distance_of_two_runs(name: str) -> None:
    """Two runs of the nonlinear motion, one of which begins with a push of a billionth."""
    control = UNSTABLE[name]
    push = sp.Impulse(time=2e-4, impulse=(2e-9, 1e-9), angular_impulse=1e-11)
    scene = resting(control, duration=0.4)
    how: dict[str, Any] = {"dt": 1e-3, "method": "dop853", "formulation": "nullspace"}
    calm, pushed = (sp.simulate(replace(scene, disturbances=some), **how) for some in ((), (push,)))
    apart, swings = [], []
    for k in range(int(min(calm.t[-1], pushed.t[-1]) / control.period)):
        one, two = (
            run.p[np.argmin(np.abs(run.t - k * control.period)), 3:5] for run in (calm, pushed)
        )
        apart.append(float(np.abs(two - one).max()))
        swings.append(float(np.abs(one).max()))
    # The distance swings; what counts is its envelope, while the motion is close to rest. At first
    # modes that grow less have their share.
    envelope = np.maximum.accumulate(apart)
    close = np.flatnonzero(np.maximum(np.maximum.accumulate(swings), envelope) < 0.02)
    late = close[len(close) // 2 :]
    assert len(late) > 8
    slope = np.polyfit(late, np.log(envelope[late]), 1)[0]
    state, torque = scene.start(), np.array(scene.control.initial_torque)
    predicted = radius(scene, 0.0, state.q, state.p, torque)
    assert predicted > 1.01
    assert np.log(predicted) == pytest.approx(slope, rel=0.1)


def test_measures_are_the_outputs_of_the_linear_model_with_their_names() -> None:
    """The outputs have theirs from tests/analysis/test_linearize.py."""
    names = output_ports(OUTPUTS).names
    assert {measure: [names[k] for k in rows] for measure, rows in MEASURED.items()} == {
        "angle": ["theta_1", "theta_2"],
        "angle_error": ["theta_1", "theta_2"],
        "angle_rate": ["rate of theta_1", "rate of theta_2"],
        "position": ["x", "y"],
        "velocity": ["rate of x", "rate of y"],
        "rotation": ["theta"],
        "rotation_rate": ["rate of theta"],
        "compression": ["d_n1", "d_n2"],
        "shear": ["d_t1", "d_t2"],
        "multipliers": ["lambda_1^H", "lambda_2^H", "lambda_1^N", "lambda_2^N"],
    }


@pytest.mark.parametrize(
    ("share", "delay", "holds"),
    [(4.0, 0.0, False), (0.5, 0.0, True), (2.0, 1.4e-3, False), (0.5, 1.4e-3, True)],
)
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_a_run_that_its_loop_ruins_says_so(
    share: float, delay: float, holds: bool, contact: Any
) -> None:
    control = pid(kd=share * DEADBEAT, delay=delay)
    scene = sp.Scene(control=control, schedule=TARGETS, duration=1.0, contact=contact, friction=0.9)
    run, texts = said(scene)
    if contact == "unilateral" and run.success:
        # It may fall back into the grasp again and again, which is no failure.
        assert not texts
        return
    assert run.success == holds
    assert len(texts) == (not holds)
    if not holds:
        assert f'ended as "{run.status}" at t = ' in texts[0]
        assert "SampledController, whose loop is unstable" in texts[0]
        grows = float(texts[0].split("by a factor of ")[1].split(" in each")[0])
        state, torque = resting(control).start(), rest().torque[-1]
        at_rest = radius(resting(control), 0.0, state.q, state.p, torque)
        assert np.log(grows) == pytest.approx(np.log(at_rest), rel=0.3)


def test_a_shorter_step_or_another_method_does_not_silence_it() -> None:
    scene = sp.Scene(control=pid(kd=4.0 * DEADBEAT), schedule=TARGETS, duration=1.0)
    for how in ({"dt": 2e-5}, {"method": "radau5", "tolerance": 1e-7, "times": [0.0, 1.0]}):
        run, texts = said(scene, **how)
        assert not run.success and "whose loop is unstable" in texts[0]


def test_other_ends_are_no_fault_of_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = resting(pid(), duration=0.2)
    blow = sp.Impulse(time=0.05, impulse=(20.0, 0.0))
    run, texts = said(replace(scene, disturbances=[blow]))
    assert run.status == "separated" and not texts
    # So is the end of a run before the loop can have done anything.
    early = replace(
        resting(pid(kd=2.0 * DEADBEAT, delay=1.4e-3)),
        disturbances=[replace(blow, time=1e-3)],
        duration=0.2,
    )
    run, texts = said(early)
    assert run.status == "separated" and not texts
    monkeypatch.setattr("softpinch.run.stiffness.radius", lambda *_: pytest.fail())
    assert sp.simulate(scene).success


def test_the_loop_is_that_of_the_gains_that_act() -> None:
    wild = pid(kd=4.0 * DEADBEAT)
    switched = replace(pid(), switch=sp.GainSwitch(D=wild.D, at=0.1))
    state, torque = resting(pid()).start(), rest().torque[-1]
    for time, alone in ((0.05, pid()), (0.1, replace(pid(), D=wild.D))):
        scenes = [sp.Scene(control=control, schedule=TARGETS) for control in (switched, alone)]
        one, two = (radius(scene, time, state.q, state.p, torque) for scene in scenes)
        assert one == two
    # Where a measure decides, a run that fails has no loop to name.
    switch = sp.GainSwitch(D=wild.D, measure="angle_rate", above=1e-3)
    scene = sp.Scene(control=replace(pid(), switch=switch), schedule=TARGETS, duration=1.0)
    run, texts = said(scene)
    assert not run.success and not any("whose loop" in text for text in texts)
