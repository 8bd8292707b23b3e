"""Torques as inputs: `control=Torque()`."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from softpinch import reference
from softpinch.run import measures
from softpinch.scene import usual

STEPS = sp.Schedule.steps([0.0, 0.02, 0.05], [[1.2, 1.2], [1.5, 0.9], [1.0, 1.1]])
PUSH = sp.Pulse(time=0.03, duration=0.01, force=(4.0, -1.0), moment=0.01)
SCENE = sp.Scene(control=sp.Torque(), schedule=STEPS, disturbances=[PUSH], duration=0.08)
EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque")
FORMULATIONS = ("csm", "nullspace", "projected")


def by_weak_pid(scene: sp.Scene, kp: float) -> sp.Scene:
    """Nearly the same torques by a PID: K_P (tau / K_P - theta) = tau - K_P theta."""
    far = replace(scene.schedule, angles=scene.schedule.angles / kp)
    return replace(scene, control=sp.Pid(kp=kp, kd=0.0, ki=0.0), schedule=far)


def test_the_motion_is_that_of_scipy_under_the_same_torques() -> None:
    times = np.array([0.01, 0.02, 0.035, 0.05, 0.08])
    theirs = reference.solve(by_weak_pid(SCENE, 1e-9), times, tolerance=1e-12)
    ours = sp.simulate(
        SCENE, method="dop853", formulation="nullspace", tolerance=1e-12, times=times
    )
    assert ours.success
    for name in ("q", "p"):
        got, expected = getattr(ours, name)[-len(times) :], getattr(theirs, name)
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("method", ["rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock"])
def test_every_method_takes_torques(formulation: str, method: str) -> None:
    exact = sp.simulate(SCENE, 1e-5, "dop853", "nullspace").q[-1]
    run = sp.simulate(SCENE, 5e-5, method, formulation, record=EVERYTHING)
    assert run.success
    np.testing.assert_allclose(run.q[-1], exact, rtol=0.0, atol=1e-6)
    run.check()
    assert not run.integral.any()
    # The multipliers' rule: the value at a row is that of the segment which begins there.
    after = np.searchsorted(STEPS.times, run.t[:-1] + 1e-12, side="right") - 1
    np.testing.assert_array_equal(run.torque[:-1], STEPS.angles[after])


def test_the_ledger_has_the_work_of_the_torques() -> None:
    run = sp.simulate(SCENE, 2e-5, record=EVERYTHING)
    edges = np.searchsorted(run.t, [0.0, 0.02, 0.05, 0.08])
    turns = np.diff(run.q[edges, 3:5], axis=0)
    work = float((STEPS.angles * turns).sum())
    assert run.energy.controller_work[-1] == pytest.approx(work, rel=1e-9)


@settings(max_examples=10, deadline=None)
@given(
    ends=st.tuples(st.floats(3.0, 12.0), st.floats(3.0, 12.0)),
    mass=st.floats(0.03, 0.3),
    push=st.floats(-3.0, 3.0),
)
def test_random_driven_motions_come_back_from_their_torques(
    ends: tuple[float, float], mass: float, push: float
) -> None:
    """Interpolated linearly at every step, so that the rest is the square of the step."""
    moves = sp.Schedule.minimum_jerk([0.0, 0.005], np.deg2rad([[6.0, 6.0], ends]), move_time=0.02)
    driven = sp.Scene(
        schedule=moves,
        fingers="driven",
        duration=0.03,
        grasped=replace(sp.GraspedObject(), mass=mass),
        disturbances=[sp.Sine(frequency_hz=20.0, force=(push, 0.0))],
    )
    first = sp.simulate(driven, 5e-5, formulation="nullspace", record=("state", "torque"))
    torques = sp.Schedule.sampled(first.t, first.torque, hold="linear")
    scene = replace(
        driven, fingers="pid", control=sp.Torque(), schedule=torques, initial=driven.start()
    )
    run = sp.simulate(scene, 5e-5, formulation="nullspace")
    size = np.abs(first.q - first.q[0]).max()
    assert np.abs(run.q[-1] - first.q[-1]).max() < 1e-4 * size


def test_torques_that_open_the_hand_free_the_tips_in_unilateral_contact() -> None:
    pull = sp.Schedule.steps([0.0, 0.01], [[1.2, 1.2], [-0.5, -0.5]])
    scene = sp.Scene(
        control=sp.Torque(), schedule=pull, duration=0.03, contact="unilateral", friction=0.8
    )
    run = sp.simulate(scene, 1e-4, record=(*EVERYTHING, "contact"))
    assert run.success and not run.contact[-1].any() and not run.holds
    run.check()


def test_the_linearisation_has_no_memories() -> None:
    state = sp.simulate(SCENE).state(-1)
    found = sp.modes(
        SCENE, [state.time], state.q[None], state.p[None], [(0.0, 0.0)], formulation="nullspace"
    )
    assert found.jacobian.shape == (1, 12, 12) and len(found.states) == 12


def test_files_have_torques() -> None:
    text = SCENE.to_toml()
    assert '[control]\nkind = "torque"' in text
    assert sp.Scene.from_toml(text) == SCENE
    assert sp.Scene(control=sp.Torque()) != sp.Scene()
    with pytest.raises(ValueError, match=r"Law\.kind \(in control\) = 'torques': must be one of"):
        sp.Scene.from_dict({"control": {"kind": "torques"}})
    with pytest.raises(ValueError, match="kp"):
        sp.Scene.from_dict({"control": {"kind": "torque", "kp": 1.0}})


def test_functions_of_a_pid_refuse_torques_by_name() -> None:
    with pytest.raises(ValueError, match=r"Torque\(\): with fingers=\"driven\""):
        sp.Scene(control=sp.Torque(), fingers="driven")
    with pytest.raises(
        TypeError,
        match=r"a Pid or a pair of them, \(right, left\), Torque\(\) or SampledController",
    ):
        sp.Scene(control=(sp.Torque(), sp.Pid()))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"with control=Torque\(\) there is no PID"):
        sp.monte_carlo(SCENE, 2, vary={"control.kp": sp.Uniform(1.0, 2.0)})
    with pytest.raises(ValueError, match=r"no PID gains, because of control=Torque\(\)"):
        sp.stability_map(SCENE, "gains", [0.5, 1.0])
    with pytest.raises(ValueError, match="the reference has the equations of a PID only"):
        reference.solve(SCENE, [0.01])
    with pytest.raises(ValueError, match="the schedule has no angles"):
        measures.finger_errors(sp.simulate(SCENE))


def test_figures_of_torques_have_no_target_angles() -> None:
    plot = pytest.importorskip("softpinch.plot")
    run = sp.simulate(SCENE, record=EVERYTHING)
    for figure in (plot.motion(run), plot.run(run)):
        figure.set_layout_engine("none")  # a third of the time
        figure.draw_without_rendering()
        labels = [line.get_label() for axes in figure.axes for line in axes.get_lines()]
        assert "target" not in labels


def test_a_torque_is_no_angle_that_is_unusually_large() -> None:
    firm = replace(SCENE, schedule=sp.Schedule.steps([0.0], [[40.0, 40.0]]))
    assert not usual.suspicions(firm)
