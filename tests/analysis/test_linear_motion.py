"""Linear models beside the motion: loops that are closed around them, steps, symmetries, SymPy."""

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
from transforms import Units, mirrored

Floats = np.ndarray
ALL = ("targets", "force")
exponents = st.integers(-8, 8)


def open_and_closed(law: str, state: sp.State | None = None) -> tuple[sp.LinearModel, ...]:
    scene, rest = resting(law)
    state = rest if state is None else state
    return (
        sp.linearize(scene, state, ("torque", "force"), EVERY_OUTPUT),
        sp.linearize(scene, state, ALL, EVERY_OUTPUT),
    )


def same_poles(ours: Floats, theirs: Floats) -> float:
    """The largest distance of a pole from its partner, as a share of the fastest."""
    left, worst = list(theirs), 0.0
    for pole in ours:
        near = int(np.argmin(np.abs(np.array(left) - pole)))
        worst = max(worst, abs(left.pop(near) - pole))
    return worst / float(np.abs(theirs).max())


def moving() -> sp.State:
    """A state of the uneven grasp that is far from rest."""
    return sp.State.consistent(
        UNEVEN, fingers=(0.12, 0.09), rotation=0.05, y=0.0735, shear=(4e-4, -3e-4),
        velocity=(0.2, -0.1, 1.5), finger_rates=(-2.0, 1.2), integral=(2e-3, -1e-3),
    )  # fmt: skip


@pytest.mark.parametrize("state", [None, moving()], ids=["rest", "moving"])
def test_a_pid_around_the_open_loop_is_the_closed_loop(state: sp.State | None) -> None:
    plant, closed = open_and_closed("pid", state)
    gains = [UNEVEN.control[k] for k in range(2)]  # type: ignore[index]
    kp, kd, ki = (np.diag([getattr(pid, name) for pid in gains]) for name in ("kp", "kd", "ki"))
    angle, rate = np.eye(12)[3:5], np.eye(12)[8:10]
    feedback = np.hstack([-kp @ angle - kd @ rate, -ki])  # of the states and the integrals
    a, b, c, d = plant.A, plant.B[:, :2], plant.C, plant.D[:, :2]
    widened = np.hstack([c, np.zeros((20, 2))])
    a = np.block([[a, np.zeros((12, 2))], [angle, np.zeros((2, 2))]])
    a[:12] += b @ feedback
    assert same_poles(np.linalg.eigvals(a), closed.poles) <= 1e-11
    inputs = np.block([[b @ kp, plant.B[:, 2:]], [-np.eye(2), np.zeros((2, 3))]])
    loop = np.block([[a, inputs], [widened + d @ feedback, np.hstack([d @ kp, plant.D[:, 2:]])]])
    columns = sizes(UNEVEN, closed.state_units + closed.input_units)
    assert off(loop, whole(closed), columns) <= 1e-11


def test_driven_fingers_are_the_open_loop_with_the_fingers_eliminated() -> None:
    """The torques follow from the wanted accelerations, which the open loop has as rows."""
    plant, driven = open_and_closed("driven")
    kept, angles, rates = [0, 1, 2, 5, 6, 7, 10, 11], [3, 4], [8, 9]
    inverse = np.linalg.inv(plant.B[rates, :2])
    full = whole(plant)
    torque = np.hstack([-inverse @ plant.A[rates], np.zeros((2, 5))])
    torque[:, 14:] = -inverse @ plant.B[rates, 2:]
    by = full.copy()
    by[:, 12:14] = 0.0
    by += full[:, 12:14] @ torque
    acceleration = full[:, 12:14] @ inverse
    rows = [*kept, *range(12, 32)]
    columns = [by[:, kept], by[:, angles], by[:, rates], acceleration, by[:, 14:]]
    eliminated = np.hstack(columns)[rows]
    weights = sizes(UNEVEN, driven.state_units + driven.input_units)
    assert off(eliminated, whole(driven), weights) <= 1e-10


def test_the_open_loop_does_not_depend_on_the_law() -> None:
    models = [open_and_closed(law)[0] for law in ("pid", "torque", "driven")]
    weights = sizes(UNEVEN, models[0].state_units + models[0].input_units)
    for model in models[1:]:
        assert off(whole(model), whole(models[0]), weights) <= 1e-9
        np.testing.assert_allclose(model.input_values, models[0].input_values, rtol=1e-9)
    assert models[1] == open_and_closed("torque")[1]


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


def step_error(law: str, size: float, reduced: bool) -> float:
    """Distance of the outputs' change from the linear one 20 ms after a step in every input."""
    scene, state = resting(law)
    wanted = ("force",) if law == "driven" else ALL
    model = sp.linearize(scene, state, wanted, EVERY_OUTPUT, reduced=reduced)
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
@pytest.mark.parametrize("reduced", [False, True])
def test_step_responses_differ_from_the_motion_by_the_square_of_the_step(
    law: str, reduced: bool
) -> None:
    errors = [step_error(law, size, reduced) for size in (1.0, 0.5, 0.25)]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert (np.abs(orders - 2.0) < 0.25).all(), (errors, orders)


@settings(max_examples=20)
@given(data=st.data(), law=st.sampled_from(["pid", "driven"]))
def test_mirrored_scenes_have_mirrored_models(data: Any, law: str) -> None:
    scene = data.draw(strategies.scenes(duration=0.5, fingers=law))
    if law == "driven":
        drawn = {"shear": (1e-4, -3e-4), "velocity": (0.1, 0.2, 1.0), "rotation": 0.05}
        angles = scene.schedule.target(0.2)
        state = sp.State.consistent(scene, fingers=angles, time=0.2, **drawn)
    else:
        state = replace(data.draw(strategies.consistent_states(scene)), time=0.2)
    image = mirrored(replace(scene, initial=state))
    ours = sp.linearize(scene, state, ALL, EVERY_OUTPUT)
    theirs = sp.linearize(image, image.start(), ALL, EVERY_OUTPUT)
    rows, row_signs = _reflection(ours.states, ours.outputs)
    columns, signs = _reflection(ours.states, ours.inputs)
    reflected = whole(theirs)[np.ix_(rows, columns)] * row_signs[:, None] * signs
    assert off(reflected, whole(ours), sizes(scene, ours.state_units + ours.input_units)) <= 1e-9


def _reflection(*parts: tuple[str, ...]) -> tuple[list[int], Floats]:
    """The index of each quantity in the mirror image, and its sign there."""
    places: list[int] = []
    for names in parts:
        swapped = [name.translate(str.maketrans("12", "21")) for name in names]
        places += [len(places) + names.index(name) for name in swapped]
    plain = [name.removeprefix("rate of ") for names in parts for name in names]
    signs = [-1.0 if name in ("x", "theta", "force_x", "moment") else 1.0 for name in plain]
    return places, np.array(signs)


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
