"""Rests of sampled laws: beside the continuous laws of the same gains, and beside runs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp

EYE, SWAY = np.eye(2), np.array([[1.0], [-1.0]])
TARGETS = sp.Schedule.steps([0.0], [[0.09, 0.11]])
SCENE = sp.Scene(schedule=TARGETS, disturbances=[sp.Step(time=0.0, force=(0.4, 0.0), moment=0.02)])
SERVO = sp.SampledController.pid(1e-3, 20.0, 0.2, 0.0, delay=0.4e-3, jitter=1e-4)
FRAME = 1 / 30
CAMERA = sp.SampledController(
    FRAME,
    [[1.0]],
    [[FRAME, 0.0, 0.0]],
    8.0 * SWAY,
    np.hstack([np.zeros((2, 1)), EYE]),
    measures=("rotation", "target"),
    measure_delay=0.03,
    initial_torque=(0.09, 0.11),
)


@pytest.mark.parametrize(("kp", "ki"), [(20.0, 0.0), (20.0, 100.0), (7.0, (0.0, 30.0))])
def test_the_rest_of_a_sampled_pid_is_that_of_the_pid(kp: float, ki: Any) -> None:
    right, left = np.broadcast_to(ki, 2)
    law = sp.SampledController.pid(1e-3, kp, 0.2, 1.0)
    law = replace(law, C=np.asarray(law.C) * np.diag([right, left]))
    sampled = replace(SCENE, control=law)
    pid = replace(SCENE, control=tuple(sp.Pid(kp=kp, kd=0.2, ki=k) for k in (right, left)))
    for how in ({}, {"grip": (1e-3, -5e-4)}, {"time": 0.3}):
        found, expected = sp.equilibrium(sampled, **how), sp.equilibrium(pid, **how)
        assert found.state is not None and expected.state is not None
        np.testing.assert_allclose(found.state.q, expected.state.q, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(found.torque, expected.torque, rtol=1e-10)
        assert found.stable and expected.stable
        assert found.growth == pytest.approx(expected.growth, rel=0.01)


BLOCKS = {
    "servo": [SERVO],
    "camera": [CAMERA, SERVO],
    "lost pictures": [
        replace(CAMERA, loss=0.3, limits=(0.02, 0.18), initial_torque=(0.1, 0.1)),
        SERVO,
    ],
    # Proportional to places, compressions, forces, and gravity, and a filter as state.
    "all measures": [
        sp.SampledController(
            5e-3,
            [[0.5]],
            [[*np.linspace(1e-3, 9e-3, 20), 0.01, 0.02, 0.03]],
            [[0.01], [0.02]],
            np.hstack([np.full((2, 20), 2e-5) * np.arange(20), 1e-3 * SWAY, EYE]),
            measures=(
                *("angle", "angle_rate", "position", "velocity", "rotation", "rotation_rate"),
                *("compression", "shear", "multipliers", "accelerometer", "gyroscope", "target"),
            ),
        ),
        SERVO,
    ],
}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_run_stays_at_the_rest(name: str) -> None:
    motion = sp.HandMotion.constant((0.3, 0.2), 0.1) if name == "all measures" else None
    control = sp.SampledController.cascade(BLOCKS[name])
    scene = replace(SCENE, control=control, motion=motion, duration=0.4)
    rest = sp.equilibrium(scene, 0.0)
    assert rest.state is not None and rest.stable, rest
    run = sp.simulate(replace(scene, initial=rest.state), 1e-3, record=("state", "torque"))
    assert run.success
    np.testing.assert_allclose(run.q, np.tile(rest.state.q, (len(run), 1)), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(run.torque, np.tile(rest.torque, (len(run), 1)), rtol=1e-9)
    if "camera" in name:
        assert abs(rest.state.q[2]) < 1e-14
        assert sp.loop(scene).period == pytest.approx(0.1)
        grows = np.log(sp.loop(scene).spectral_radius) / 0.1
        assert sp.equilibrium(scene).growth == pytest.approx(grows)


def test_a_run_settles_at_the_rest_that_is_near_it() -> None:
    scene = replace(SCENE, control=sp.SampledController.cascade(BLOCKS["camera"]), duration=3.0)
    upright = sp.equilibrium(replace(scene, disturbances=()), 0.0)
    run = sp.simulate(replace(scene, initial=upright.state), 1e-3)
    assert np.abs(run.q[-1] - run.q[0]).max() > 1e-3
    rest = sp.equilibrium(scene, near=run)
    assert rest.state is not None
    np.testing.assert_allclose(run.q[-1], rest.state.q, rtol=0.0, atol=1e-8)


def test_laws_without_one_rest_are_refused() -> None:
    def of(*blocks: sp.SampledController) -> sp.Scene:
        return replace(SCENE, control=sp.SampledController.cascade(blocks))

    damper = sp.SampledController.pid(1e-3, 0.0, 0.2, 0.0)
    doubled = replace(
        CAMERA, A=EYE, B=np.tile(CAMERA.B, (2, 1)), C=np.tile(CAMERA.C, 2), initial_state=None
    )
    assert sp.equilibrium(of(damper)).state is None
    for call in (sp.equilibrium, sp.loop):
        with pytest.raises(ValueError, match=r"control=Sampled.*no unique rest.*integrate alike"):
            call(of(doubled, SERVO))
    narrow = of(replace(CAMERA, limits=(0.099, 0.101), initial_torque=(0.1, 0.1)), SERVO)
    found = sp.equilibrium(narrow)
    assert (found.state, found.status, found.stable) == (None, "not_found", False)
    assert "control.outer.limits do not allow its outputs at rest" in found.message
    apart = sp.equilibrium(replace(of(SERVO), schedule=sp.Schedule.steps([0.0], [[-0.5, -0.5]])))
    assert apart.state is None and "apart" in apart.status
    never = of(replace(CAMERA, period=np.pi / 100, B=[[np.pi / 100, 0.0, 0.0]]), SERVO)
    unknown = sp.equilibrium(never)
    assert unknown.state is not None and not unknown.stable and np.isnan(unknown.growth)
    assert "is not known" in unknown.message
    unstable = sp.equilibrium(of(replace(SERVO, delay=12e-3, jitter=0.0)))
    assert not unstable.stable and "a deviation grows with" in unstable.message


def test_a_rest_leaves_a_sine_of_the_motion_out_of_the_accelerometer_too() -> None:
    gains = [[-20.0, 0.0, -0.2, 0.0, 0.01, 0.0], [0.0, -20.0, 0.0, -0.2, 0.01, 0.0]]
    measures = ("angle_error", "angle_rate", "accelerometer")
    control = sp.SampledController(1e-3, D=gains, measures=measures)
    # At the peak of the sine, and beside a constant acceleration, which counts.
    still, shaken, accelerated = (
        sp.equilibrium(replace(SCENE, control=control, motion=motion), time=0.0)
        for motion in (
            sp.HandMotion.constant(),
            sp.HandMotion.sine(0.01, 5.0, "x", phase=np.pi / 2),
            sp.HandMotion.constant((-1.0, 0.0)),
        )
    )
    assert still.state and shaken.state and accelerated.state
    np.testing.assert_array_equal(shaken.state.q, still.state.q)
    np.testing.assert_array_equal(shaken.torque, still.torque)
    assert abs(accelerated.torque - still.torque).max() > 1e-3
