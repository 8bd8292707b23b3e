"""A, B, C and D beside derivatives that share no code with the core's."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import scenes as shared
import softpinch as sp
from linear_reference import EVERY_OUTPUT, derivatives, inputs_of, off, sizes, whole
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
@settings(max_examples=20)
@given(data=st.data())
def test_matrices_are_the_derivatives_of_independent_equations(
    law: str, open_loop: bool, data: Any
) -> None:
    scene, state = data.draw(operating_points(law))
    own = "torque" if open_loop else law
    model = sp.linearize(scene, state, inputs_of(own, scene), EVERY_OUTPUT)
    expected = derivatives(scene, own, model.state_values, model.input_values)
    columns = sizes(scene, model.state_units + model.input_units)
    assert off(whole(model), expected, columns) <= 1e-9


@pytest.mark.parametrize(("law", "open_loop"), LAWS)
@settings(max_examples=10)
@given(data=st.data())
def test_the_operating_point_is_the_scenes(law: str, open_loop: bool, data: Any) -> None:
    scene, state = data.draw(operating_points(law))
    own = "torque" if open_loop else law
    model = sp.linearize(scene, state, inputs_of(own, scene), EVERY_OUTPUT)
    terms = sp.evaluate(
        scene, state.time, model.output_values[:9], _rates(model, scene), state.integral,
        formulation="nullspace",
    )  # fmt: skip
    found = dict(zip(model.outputs, model.output_values, strict=True))
    inputs = dict(zip(model.inputs, model.input_values, strict=True))
    rates = dict(zip(model.states, model.state_rates, strict=True))
    torque = terms.forces.control[3:5]
    acceleration = terms.accelerations
    for k, name in enumerate(("x", "y", "theta", "theta_1", "theta_2")):
        if f"rate of {name}" in rates:
            limit = 1e-9 * (1.0 + abs(acceleration[k]))
            assert abs(rates[f"rate of {name}"] - acceleration[k]) <= limit
    for i in range(2):
        multiplier = found[f"lambda_{i + 1}^H"]
        assert abs(multiplier - terms.multipliers[i]) <= 1e-9 * (1.0 + abs(multiplier))
        assert abs(found[f"torque_{i + 1}"] - torque[i]) <= 1e-9 * (1.0 + abs(torque[i]))
        name, value = ("torque", torque) if own == "torque" else ("target", terms.target)
        assert abs(inputs[f"{name}_{i + 1}"] - value[i]) <= 1e-9 * (1.0 + abs(value[i]))
    external = [inputs[name] for name in ("force_x", "force_y", "moment")]
    np.testing.assert_array_equal(external, terms.forces.external[:3])


def _rates(model: sp.LinearModel, scene: sp.Scene) -> np.ndarray:
    """The rates of the coordinates at the operating point, which satisfy Phi p = 0."""
    values = model.output_values
    rates = dict(zip(model.outputs, values, strict=True))
    return sp.State.consistent(
        scene,
        x=values[0],
        y=values[1],
        rotation=values[2],
        fingers=values[3:5],
        shear=values[7:9],
        velocity=[rates[f"rate of {name}"] for name in ("x", "y", "theta")],
        finger_rates=[rates[f"rate of {name}"] for name in ("theta_1", "theta_2")],
    ).p


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
