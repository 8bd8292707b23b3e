"""A, B, C and D beside derivatives that share no code with the core's, and the operating point."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import scenes as shared
import softpinch as sp
from linear_reference import EVERY_OUTPUT, inputs_of, linearized, off, sizes, whole
from resting import resting
from softpinch import strategies

# Law of the scene, and whether torques feed the fingers in the model.
LAWS = [("pid", False), ("torque", False), ("driven", False), ("pid", True), ("driven", True)]


@st.composite
def operating_points(draw: Any, law: str) -> tuple[sp.Scene, sp.State]:
    """A scene and a state of it, at rest or moving, under forces that may act by then."""
    fingers = "driven" if law == "driven" else "pid"
    scene = draw(strategies.scenes(duration=0.5, fingers=fingers))
    time = draw(st.sampled_from([0.0, 0.1, 0.25, 0.4]))
    if law == "driven":
        angles = scene.schedule.target(time)
        state = sp.State.consistent(
            scene,
            fingers=angles,
            rotation=draw(st.floats(-0.1, 0.1)),
            shear=[draw(st.floats(-1e-3, 1e-3)), draw(st.floats(-1e-3, 1e-3))],
            velocity=[draw(st.floats(-0.1, 0.1)), 0.05, draw(st.floats(-3.0, 3.0))],
        )
    else:
        state = draw(strategies.consistent_states(scene))
    if law == "torque":
        torques = sp.Schedule.steps([0.0], [[draw(st.floats(-5.0, 5.0)), 2.0]])
        scene = replace(scene, control=sp.Torque(), schedule=torques, initial=None)
    integral = (draw(st.floats(-0.01, 0.01)), 0.003) if law == "pid" else (0.0, 0.0)
    if draw(st.booleans()):
        state = replace(state, p=np.zeros(9))
    return scene, replace(state, time=time, integral=integral)


@pytest.mark.parametrize(("law", "open_loop"), LAWS)
@settings(max_examples=10)
@given(data=st.data())
def test_matrices_are_the_derivatives_of_independent_equations(
    law: str, open_loop: bool, data: Any
) -> None:
    scene, state = data.draw(operating_points(law))
    own = "torque" if open_loop else law
    model = sp.linearize(scene, state, inputs_of(own, scene), EVERY_OUTPUT)
    rates, outputs, expected = linearized(scene, own, model.state_values, model.input_values)
    columns = sizes(scene, model.state_units + model.input_units)
    assert off(whole(model), expected, columns) <= 1e-9
    np.testing.assert_allclose(model.state_rates, rates, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(model.output_values, outputs, rtol=1e-9, atol=1e-9)
    inputs = dict(zip(model.inputs, model.input_values, strict=True))
    # Driven fingers move at the rates of the schedule.
    moving = np.array(outputs[-5:])
    q, at_rest = model.output_values[:9], np.zeros(9)
    phi = sp.evaluate(scene, state.time, q, at_rest).constraint_matrix[:, :5]
    p = [*moving, *(-phi @ moving)]
    terms = sp.evaluate(scene, state.time, q, p, state.integral, formulation="nullspace")
    name, value = (
        ("torque", terms.forces.control[3:5]) if own == "torque" else ("target", terms.target)
    )
    np.testing.assert_allclose([inputs[f"{name}_{i}"] for i in (1, 2)], value, rtol=1e-9, atol=1e-9)
    external = [inputs[name] for name in ("force_x", "force_y", "moment")]
    np.testing.assert_array_equal(external, terms.forces.external[:3])


def test_driven_inputs_are_angle_rate_and_acceleration_of_the_schedule() -> None:
    scene = shared.driven()
    t, h = 0.08, 1e-4
    angles = [scene.schedule.target(t + k * h) for k in (-1, 0, 1)]
    state = sp.State.consistent(scene, fingers=angles[1], time=t)
    model = sp.linearize(replace(scene, fingers="driven", initial=None), state, outputs="fingers")
    rate, acceleration = (angles[2] - angles[0]) / (2 * h), np.diff(angles, 2, axis=0)[0] / h**2
    np.testing.assert_allclose(model.input_values[2:4], rate, rtol=1e-4)
    np.testing.assert_allclose(model.input_values[4:], acceleration, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(model.D, np.eye(6)[:2])
    np.testing.assert_array_equal(model.C, np.zeros((2, 8)))


def test_without_a_state_it_is_the_equilibrium_under_frozen_inputs() -> None:
    scene, state = resting("driven")
    angles = state.q[3:5]
    moving = sp.Schedule.minimum_jerk([0.0, 1.0], [angles - 0.1, angles], 0.5)
    sine = sp.Sine(frequency_hz=3.0, force=(1.0, 2.0), moment=0.1, phase=1.0)
    shaken = replace(scene, schedule=moving, disturbances=[sine], duration=2.0)
    choice = (("targets", "force"), "multipliers")
    model = sp.linearize(shaken, None, *choice)
    assert model.state == sp.equilibrium(shaken).state and model.state.time == 2.0
    assert model == sp.linearize(scene, model.state, *choice)
    own = sp.linearize(shaken, model.state, *choice)
    assert own.input_values[6:].all() and not model.input_values[6:].any()


@pytest.mark.parametrize("law", ["pid", "torque", "driven"])
def test_an_equilibrium_is_at_rest_and_has_the_same_eigenvalues(law: str) -> None:
    scene, _ = resting(law)
    model = sp.linearize(scene, reduced=True)
    assert np.abs(model.state_rates).max() <= 1e-9 * np.abs(model.poles).max()
    expected = np.sort_complex(sp.equilibrium(scene).eigenvalues[2:])
    np.testing.assert_allclose(np.sort_complex(model.poles), expected, rtol=1e-6)


def test_an_equal_scene_is_that_of_the_equilibrium() -> None:
    scene = sp.Scene()
    found = sp.equilibrium(scene)
    assert sp.linearize(replace(scene), found) == sp.linearize(scene, found)
    # A state may be linearised under any.
    heavier = scene.with_({"grasped.mass": 0.2})
    assert np.abs(sp.linearize(heavier, found.state).state_rates).max() > 1.0


def test_an_equilibrium_with_unilateral_contact_has_the_model_of_sticking_tips() -> None:
    real = replace(sp.Scene(), contact="unilateral", friction=0.5)
    sticking = replace(real, contact="bilateral")
    found = sp.equilibrium(real)
    model = sp.linearize(real, found, ("targets", "force"))
    assert model == sp.linearize(sticking, sp.equilibrium(sticking), ("targets", "force"))
    # The contact is no other scene, in either direction.
    assert model == sp.linearize(sticking, found, ("targets", "force"))
    assert model == sp.linearize(real, sp.equilibrium(sticking), ("targets", "force"))


def tilted(scene: sp.Scene, tilt: float, acceleration: Any) -> sp.Scene:
    """The scene in a hand with this tilt and with this acceleration along its own axes, m/s^2."""
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    return replace(scene, motion=sp.HandMotion.constant(turn @ acceleration, tilt))


@pytest.mark.parametrize(("law", "open_loop"), LAWS)
@pytest.mark.parametrize("carried", [False, True])
@settings(max_examples=5)
@given(data=st.data())
def test_the_acceleration_of_the_hand_acts_as_forces_on_object_and_fingers(
    law: str, open_loop: bool, carried: bool, data: Any
) -> None:
    """By (M1), (M2) and (M4) of its motion, and by the rates under two accelerations beside it."""
    scene, state = data.draw(operating_points(law))
    tilt, own = (0.4, np.array([3.0, -2.0])) if carried else (0.0, np.zeros(2))
    moved = tilted(scene, tilt, own) if carried else scene
    groups = (*inputs_of("torque" if open_loop else law, scene), "acceleration")
    model = sp.linearize(moved, state, groups, EVERY_OUTPUT)
    assert model.inputs[-2:] == ("acceleration_x", "acceleration_y")
    assert model.input_units[-2:] == ("m/s^2", "m/s^2")
    np.testing.assert_allclose(model.input_values[-2:], own, rtol=1e-14, atol=1e-15)
    found = whole(model)[:, -2:]
    near = {"rtol": 0.0, "atol": 1e-9 * np.abs(found).max()}
    for k, direction in enumerate(np.eye(2)):
        if law == "driven" and open_loop:
            break  # The torques that hold the fingers depend on the acceleration.
        values = []
        for step in (0.5, -0.5):
            beside = tilted(scene, tilt, own + step * direction)
            other = sp.linearize(beside, state, groups, EVERY_OUTPUT)
            values.append(np.concatenate([other.state_rates, other.output_values]))
        np.testing.assert_allclose(found[:, k], values[0] - values[1], **near)
    if law == "driven" and not open_loop:
        return
    fed = sp.linearize(moved, state, ("torque", "force", "acceleration"), EVERY_OUTPUT)
    torques, forces, accelerations = np.split(whole(fed)[:, -7:], [2, 5], axis=1)
    sides = zip((-1.0, 1.0), (scene.hand.right, scene.hand.left), state.q[3:5], strict=True)
    levers = np.array([
        [-f.mass * f.length * s * np.cos(angle), f.mass * f.length * np.sin(angle)]
        for s, f, angle in sides
    ])  # fmt: skip
    turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
    along = forces[:, :2] @ turn  # Forces are given along fixed axes.
    expected = -scene.grasped.mass * along + torques @ levers
    expected[-7:-5] = 0.0  # Torques that are inputs are outputs too.
    np.testing.assert_allclose(accelerations, expected, **near)


def test_the_grasp_follows_a_slow_acceleration_as_the_linear_model_says() -> None:
    scene = tilted(sp.Scene(), 0.3, np.array([1.0, 2.0]))
    model = sp.linearize(scene, None, "acceleration", ("pose", "shears", "torque"), reduced=True)
    slow = model.D - model.C @ np.linalg.solve(model.A, model.B)
    for k, direction in enumerate(np.eye(2)):
        beside = []
        for step in (1e-3, -1e-3):
            moved = tilted(sp.Scene(), 0.3, np.array([1.0, 2.0]) + step * direction)
            found = sp.equilibrium(moved, near=model.state)
            assert found.state is not None
            beside.append([*found.state.q[:3], *found.state.q[7:], *found.torque])
        np.testing.assert_allclose(
            (np.array(beside[0]) - beside[1]) / 2e-3, slow[:, k], rtol=1e-6, atol=1e-9
        )


def test_the_torques_of_a_sampled_controller_leave_the_motion_of_the_hand() -> None:
    law = sp.SampledController.pid(1e-3, 4.0, 0.05, 20.0, initial_torque=(0.4, 0.4))
    scene = tilted(sp.Scene(control=law, duration=0.01), 0.3, np.array([1.0, 2.0]))
    run = sp.simulate(scene, record=("state", "torque"))
    held = sp.Schedule.steps([0.0], [run.torque[-1]])
    state = replace(run.state(-1), controller=None)
    fed = replace(scene, control=sp.Torque(), schedule=held, initial=None)
    own, expected = (
        sp.linearize(each, at, ("torque", "acceleration"))
        for each, at in ((scene, run.state(-1)), (fed, state))
    )
    for name in ("A", "B", "state_rates", "input_values"):
        np.testing.assert_array_equal(getattr(own, name), getattr(expected, name))
