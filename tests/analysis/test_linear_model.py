"""The model itself: its neutral states, its reduction, its names, and what it converts to."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp
from linear_reference import EVERY_OUTPUT
from resting import resting

LAWS = ("pid", "torque", "driven")
FREQUENCIES = (0.3, 5.0, 40.0, 300.0, 5000.0)


def every(law: str, reduced: bool = False) -> sp.LinearModel:
    scene, state = resting(law)
    return sp.linearize(scene, state, ("targets", "force"), EVERY_OUTPUT, reduced=reduced)


def response(model: sp.LinearModel, omega: float) -> np.ndarray:
    """Transfer function at i omega. The columns of driven fingers' rates and accelerations go to
    those of their angles."""
    n = len(model.states)
    s = 1j * omega
    found = model.C @ np.linalg.solve(s * np.eye(n) - model.A, model.B) + model.D
    if "acceleration of target_1" not in model.inputs:
        return found
    return np.hstack([found[:, :2] + s * found[:, 2:4] + s**2 * found[:, 4:6], found[:, 6:]])


@pytest.mark.parametrize(("law", "states"), [("pid", 14), ("torque", 12), ("driven", 8)])
def test_states_have_names_units_and_values(law: str, states: int) -> None:
    model = every(law)
    _, state = resting(law)
    assert model.A.shape == (states, states)
    assert len(model.states) == len(model.state_units) == len(model.state_values) == states
    assert len(model.inputs) == len(model.input_units) == model.B.shape[1] == model.D.shape[1]
    assert len(model.outputs) == len(model.output_units) == model.C.shape[0] == 20
    assert len({*model.states}) == states and len({*model.outputs}) == 20
    assert model.states[2] == "theta" and model.state_values[2] == state.q[2]
    values = dict(zip(model.outputs, model.output_values, strict=True))
    np.testing.assert_allclose(values["d_n1"], state.q[5], rtol=1e-13)
    assert dict(zip(model.outputs, model.output_units, strict=True))["lambda_2^N"] == "N"
    assert dict(zip(model.states, model.state_units, strict=True))["rate of theta"] == "rad/s"
    assert model.state == state


def test_groups_are_ordered_as_asked_and_may_be_given_alone() -> None:
    scene, state = resting("pid")
    alone = sp.linearize(scene, state, "force", "shears")
    assert alone.inputs == ("force_x", "force_y", "moment") and alone.outputs == ("d_t1", "d_t2")
    both = sp.linearize(scene, state, ["force", "targets"], ("shears", "pose"))
    assert both.inputs == (*alone.inputs, "target_1", "target_2")
    assert both.outputs == ("d_t1", "d_t2", "x", "y", "theta")
    np.testing.assert_array_equal(both.B[:, :3], alone.B)
    np.testing.assert_array_equal(both.D[:2, :3], alone.D)
    default = sp.linearize(scene, state)
    assert default.inputs == ("target_1", "target_2") and default.outputs == ("x", "y", "theta")


@pytest.mark.parametrize("reduced", [False, True])
def test_values_and_units_belong_to_the_names(reduced: bool) -> None:
    scene, state = resting("pid")
    load = sp.Step(time=0.0, force=(3.0, -2.0), moment=0.1)
    angles = sp.Schedule.steps([0.0], scene.schedule.angles + 0.01)
    pushed = replace(scene, disturbances=[load], schedule=angles)
    whole = sp.linearize(pushed, state, ("targets", "force"), EVERY_OUTPUT)
    part = sp.linearize(pushed, state, "force", ("shears", "pose", "torque"), reduced=reduced)
    for kind, fields in {
        "state": ("units", "values", "rates"),
        "input": ("units", "values"),
        "output": ("units", "values"),
    }.items():
        for field in fields:
            names = (getattr(model, f"{kind}s") for model in (whole, part))
            ours, theirs = (getattr(model, f"{kind}_{field}") for model in (whole, part))
            known = dict(zip(next(names), ours, strict=True))
            assert [known[name] for name in next(names)] == list(theirs)
    np.testing.assert_array_equal(part.input_values, [3.0, -2.0, 0.1])
    assert part.state_rates.any()


@pytest.mark.parametrize("law", LAWS)
def test_neutral_combinations_do_not_change(law: str) -> None:
    model = every(law)
    scene, state = resting(law)
    phi = sp.evaluate(scene, 0.0, state.q, state.p).constraint_matrix
    degrees = 3 if law == "driven" else 5
    np.testing.assert_allclose(model.neutral[:, :degrees], phi[2:, :degrees], atol=1e-15)
    np.testing.assert_array_equal(model.neutral @ model.A, np.zeros((2, len(model.states))))
    changed = model.neutral @ model.B
    if law == "driven":
        np.testing.assert_allclose(changed[:, 2:4], -phi[2:, 3:5], rtol=1e-14)
        changed = np.delete(changed, [2, 3], axis=1)
    assert not changed.any()
    # Where the object moves, slip can change them.
    assert not len(sp.linearize(scene, replace(state, p=np.full(9, 1e-3))).neutral)


@pytest.mark.parametrize("law", LAWS)
def test_the_reduced_model_has_the_same_transfer_function(law: str) -> None:
    model, reduced = every(law), every(law, reduced=True)
    assert len(reduced.states) == len(model.states) - 2
    assert not {"d_t1", "d_t2"} & {*reduced.states}
    assert reduced.neutral.shape == (0, len(reduced.states))
    for omega in FREQUENCIES:
        ours, theirs = response(reduced, omega), response(model, omega)
        scale = np.abs(theirs).max(axis=1, keepdims=True)
        assert np.max(np.abs(ours - theirs) / scale) <= 1e-8


@pytest.mark.parametrize("reduced", [False, True])
def test_control_and_scipy_have_the_matrices(reduced: bool) -> None:
    control = pytest.importorskip("control")
    model = every("pid", reduced)
    system = model.to_control()
    assert isinstance(system, control.StateSpace) and system.dt == 0
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(system, name), getattr(model, name))
    assert tuple(system.state_labels) == model.states
    assert tuple(system.input_labels) == model.inputs
    assert tuple(system.output_labels) == model.outputs
    one = control.frequency_response(system, [5.0]).complex[:, :, 0]
    np.testing.assert_allclose(one, response(model, 5.0), rtol=1e-8, atol=1e-12)
    system.A[:] = 0.0
    assert model.A.any()
    plain = model.to_scipy()
    for name in "BCD":
        np.testing.assert_array_equal(getattr(plain, name), getattr(model, name))


@pytest.mark.parametrize("gains", [(0.0, 0.0), (0.0, 1000.0)])
def test_an_integral_that_drives_nothing_has_a_zero_and_decides_nothing(
    gains: tuple[float, float],
) -> None:
    """It stays a state of the model, also of the reduced one, but not at rest."""
    idle = gains.count(0.0)
    pids = tuple(sp.Pid(ki=ki) for ki in gains)
    scene = sp.Scene(control=pids)
    rest = sp.equilibrium(scene)
    assert rest.stable and len(rest.eigenvalues) == 14 - idle
    whole, reduced = (sp.linearize(scene, rest, reduced=cut) for cut in (False, True))
    for model, neutral in ((whole, 2), (reduced, 0)):
        places = [model.states.index(f"integral_{k + 1}") for k in range(2) if not gains[k]]
        assert not model.A[:, places].any() and model.A[places].any(axis=1).all()
        zeros = np.abs(model.poles) < 1e-7 * np.abs(model.poles).max()
        assert zeros.sum() == neutral + idle
        assert (model.poles[~zeros].real < 0.0).all()
    others = np.sort_complex(rest.eigenvalues[2:])
    poles = np.sort_complex(reduced.poles[~zeros])
    np.testing.assert_allclose(poles, others, rtol=1e-6)
