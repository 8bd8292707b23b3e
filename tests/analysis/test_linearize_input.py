"""Refusals of `linearize`, and its results at an equilibrium."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import softpinch as sp
from resting import resting

SCENE = sp.Scene()
STATE = SCENE.start()
CONTROLLED = replace(SCENE, control=sp.SampledController.pid(1e-3))
HINT = '"pose", "fingers", "compressions", "shears", "multipliers", "torque", "rates"'


@pytest.mark.parametrize(
    ("inputs", "outputs", "error", "message"),
    [
        ((), "pose", ValueError, 'inputs = (): must be names out of "targets", "torque", "force"'),
        ("targets", 3, TypeError, f"outputs = 3: must be names out of {HINT}"),
        ("target", "pose", ValueError, 'did you mean "targets"?'),
        ("force", ("pose", "pose"), ValueError, 'outputs: "pose" is there more than once'),
        (("targets", "torque"), "pose", ValueError, '"targets" and "torque" exclude each other'),
    ],
)
def test_groups_that_do_not_exist(
    inputs: Any, outputs: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=re.escape(message)) as raised:
        sp.linearize(SCENE, STATE, inputs, outputs)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("scene", "state", "message"),
    [
        (
            sp.Scene(contact="unilateral", friction=0.5),
            STATE,
            'Scene.contact = "unilateral": linearize linearises bilateral contact only',
        ),
        (CONTROLLED, STATE, "linearize without inputs"),
        (
            SCENE,
            replace(STATE, contact=[1.0, 1.0, 0.0, 0.0]),
            "state.contact = array([1., 1., 0., 0.]): must be None",
        ),
        (SCENE, replace(STATE, controller=np.zeros(5)), "state.controller: must be None"),
        (
            SCENE,
            replace(STATE, q=STATE.q + 1e-3 * np.eye(9)[5]),
            "compressions must satisfy C^H = 0 (9), which gives [",
        ),
        (
            replace(SCENE, fingers="driven", schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]])),
            STATE,
            'with fingers="driven" must be what the schedule has at 0.0 s, [0.1, 0.1]',
        ),
        (
            SCENE,
            sp.State.consistent(SCENE, fingers=(0.1, 0.1), velocity=(1e200, 0.0, 1e200)),
            "the motion has no finite derivatives there",
        ),
    ],
)
def test_states_and_scenes_that_do_not_fit(scene: sp.Scene, state: sp.State, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)) as raised:
        sp.linearize(scene, state)
    assert "\n" not in str(raised.value)


def test_a_sampled_controller_needs_a_state_of_its_run() -> None:
    with pytest.raises(ValueError, match=r"this state has controller = None"):
        sp.linearize(CONTROLLED, STATE, "torque")


def test_arguments_of_the_wrong_kind() -> None:
    with pytest.raises(TypeError, match="state = 'start': must be a State"):
        sp.linearize(SCENE, "start")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="reduced = 1"):
        sp.linearize(SCENE, STATE, reduced=1)  # type: ignore[arg-type]


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


def test_a_scene_without_equilibrium_says_why() -> None:
    apart = replace(SCENE, schedule=sp.Schedule.steps([0.0], [[-0.5, -0.5]]))
    why = re.escape(sp.equilibrium(apart).message)
    with pytest.raises(ValueError, match=f"^linearize: {why}$"):
        sp.linearize(apart)


def test_an_equilibrium_of_another_scene_is_refused() -> None:
    found = sp.equilibrium(SCENE)
    heavier = replace(SCENE, grasped=replace(SCENE.grasped, mass=0.2))
    rule = "state: is an equilibrium of another scene; pass scene = state.scene, or state.state"
    with pytest.raises(ValueError, match=f"^{re.escape(rule)}"):
        sp.linearize(heavier, found)
    # An equal scene is the same one, and a state may be linearised under any.
    assert sp.linearize(replace(SCENE), found) == sp.linearize(SCENE, found)
    assert np.abs(sp.linearize(heavier, found.state).state_rates).max() > 1.0


def test_an_equilibrium_with_unilateral_contact_has_the_model_of_sticking_tips() -> None:
    real = replace(SCENE, contact="unilateral", friction=0.5)
    sticking = replace(real, contact="bilateral")
    found = sp.equilibrium(real)
    model = sp.linearize(real, found, ("targets", "force"))
    assert model == sp.linearize(sticking, sp.equilibrium(sticking), ("targets", "force"))
    # The contact is no other scene, in either direction.
    assert model == sp.linearize(sticking, found, ("targets", "force"))
    assert model == sp.linearize(real, sp.equilibrium(sticking), ("targets", "force"))
    # The motion of the real contact after a small push is that of the model.
    push, end = 1e-3, 0.02
    assert found.state is not None
    step = sp.Step(time=0.0, force=(0.6 * push, 0.8 * push), moment=1e-2 * push)
    pushed = replace(
        real, initial=replace(found.state, time=0.0), disturbances=(step,), duration=end
    )
    run = sp.simulate(pushed, method="dop853", tolerance=1e-13)
    assert run.status == "completed" and not run.contact_changes
    by_force = model.B[:, 2:] @ np.array([*step.force, step.moment])
    n = len(model.A)
    held = expm(end * np.block([[model.A, by_force[:, None]], [np.zeros((1, n + 1))]]))
    moved = run.q[-1, :3] - found.state.q[:3]
    np.testing.assert_allclose(moved, model.C @ held[:n, n], rtol=1e-3)


def test_no_equilibrium_with_unilateral_contact_says_why() -> None:
    heavy = sp.GraspedObject(mass=10.0)
    found = sp.equilibrium(sp.Scene(contact="unilateral", friction=0.3, grasped=heavy))
    with pytest.raises(ValueError, match=r"^linearize: no equilibrium .*: with sticking tips a"):
        sp.linearize(found.scene, found)
