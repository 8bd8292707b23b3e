"""Linear models beside the motion: steps, open loops, other units."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import softpinch as sp
from linear_reference import EVERY_OUTPUT, off, sizes, whole
from resting import UNEVEN, resting
from softpinch import strategies
from transforms import Units

Floats = np.ndarray
ALL = ("targets", "force")
exponents = st.integers(-8, 8)


def test_the_open_loop_does_not_depend_on_the_law() -> None:
    models = [
        sp.linearize(*resting(law), ("torque", "force"), EVERY_OUTPUT)
        for law in ("pid", "torque", "driven")
    ]
    weights = sizes(UNEVEN, models[0].state_units + models[0].input_units)
    for model in models[1:]:
        assert off(whole(model), whole(models[0]), weights) <= 1e-9
        np.testing.assert_allclose(model.input_values, models[0].input_values, rtol=1e-9)


def test_a_sampled_controller_is_opened_at_its_torques_in_force() -> None:
    scene, state = resting("pid")
    law = sp.SampledController.pid(1e-3, 4.0, 0.05, 20.0, initial_torque=(4.0, 4.5))
    sampled = replace(scene, control=law, initial=state, duration=0.01)
    run = sp.simulate(sampled, dt=1e-4, record=("state", "torque"))
    for row in (0, 57, -1):
        model = sp.linearize(sampled, run.state(row), "torque")
        if row:
            np.testing.assert_allclose(model.input_values, run.torque[row], rtol=1e-12)
        torques = sp.Schedule.steps([0.0], [model.input_values])
        fed = replace(sampled, control=sp.Torque(), schedule=torques, initial=None)
        bare = replace(run.state(row), controller=None)
        assert replace(model, state=bare) == sp.linearize(fed, bare)


def step_error(law: str, size: float) -> float:
    """Distance of the outputs' change from the linear one 20 ms after a step in every input."""
    scene, state = resting(law)
    wanted = ("force",) if law == "driven" else ALL
    model = sp.linearize(scene, state, wanted, EVERY_OUTPUT)
    amounts = {"rad": 1e-2, "N m": 5e-2, "N": 1.0}
    step = size * np.array([amounts[unit] for unit in model.input_units])
    step *= np.linspace(0.4, 1.0, len(step))
    n, m = model.B.shape
    held = expm(0.02 * np.block([[model.A, model.B], [np.zeros((m, n + m))]]))
    linear = model.C @ held[:n, n:] @ step + model.D @ step

    def ends(change: Floats) -> Floats:
        schedule = scene.schedule
        if law != "driven":
            schedule = sp.Schedule.steps([0.0], schedule.angles[-1:] + change[:2])
        load = sp.Step(time=0.0, force=tuple(change[-3:-1]), moment=float(change[-1]))
        moved = replace(scene, schedule=schedule, disturbances=[load], initial=state, duration=0.02)
        run = sp.simulate(
            moved, method="dop853", tolerance=1e-12, formulation="nullspace",
            record=("state", "multipliers", "torque"),
        )  # fmt: skip
        assert run.status == "completed"
        return np.concatenate([run.q[-1], run.multipliers[-1], run.torque[-1], run.p[-1, :5]])

    change = ends(step) - ends(0.0 * step)
    scale = sizes(scene, model.output_units)
    return float(np.abs((change - linear) / scale).max())


@pytest.mark.parametrize("law", ["pid", "torque", "driven"])
def test_step_responses_differ_from_the_motion_by_the_square_of_the_step(law: str) -> None:
    errors = [step_error(law, size) for size in (1.0, 0.5, 0.25)]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert (np.abs(orders - 2.0) < 0.25).all(), (errors, orders)


@settings(max_examples=20)
@given(strategies.scenes(duration=0.5), st.data(), exponents, exponents, exponents)
def test_powers_of_two_of_length_mass_and_time_scale_a_model_to_the_bit(
    scene: sp.Scene, data: Any, length: int, mass: int, time: int
) -> None:
    units = Units(length, mass, time)
    state = replace(data.draw(strategies.consistent_states(scene)), time=0.2)
    scaled = units.scene(replace(scene, initial=state))
    for inputs in (ALL, ("torque", "force")):
        ours = sp.linearize(scene, state, inputs, EVERY_OUTPUT)
        theirs = sp.linearize(scaled, scaled.start(), inputs, EVERY_OUTPUT)
        states, ins, outs = (
            np.array([_factor(unit, units) for unit in own])
            for own in (ours.state_units, ours.input_units, ours.output_units)
        )
        rows = np.concatenate([states / units.time, outs])
        factors = rows[:, None] / np.concatenate([states, ins])
        np.testing.assert_array_equal(whole(theirs), whole(ours) * factors)
        for name, own in (("state", states), ("input", ins), ("output", outs)):
            values = getattr(ours, f"{name}_values") * own
            np.testing.assert_array_equal(getattr(theirs, f"{name}_values"), values)


def _factor(unit: str, units: Units) -> float:
    dimensions = {
        **{"m": (1, 0, 0), "rad": (0, 0, 0), "rad s": (0, 0, 1), "N": (1, 1, -2)},
        **{"N m": (2, 1, -2), "m/s": (1, 0, -1), "rad/s": (0, 0, -1)},
    }
    return units.of(*dimensions[unit])
