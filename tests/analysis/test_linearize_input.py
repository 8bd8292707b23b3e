"""What `linearize` refuses, and how it takes an equilibrium."""

import re
import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

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
        ("targets", [], ValueError, f"outputs = []: must be names out of {HINT}"),
        (None, "pose", TypeError, "inputs = None: must be names out of"),
        ("targets", 3, TypeError, f"outputs = 3: must be names out of {HINT}"),
        ("target", "pose", ValueError, 'did you mean "targets"?'),
        (("force", "forces"), "pose", ValueError, "inputs[1] = 'forces': must be one of"),
        (("force", 1), "pose", TypeError, "inputs[1] = 1: must be one of"),
        (("force", "force"), "pose", ValueError, 'inputs: "force" is there more than once'),
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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((3, STATE), "scene = 3: must be a Scene"),
        ((SCENE, "start"), "state = 'start': must be a State"),
        ((SCENE, sp.simulate(sp.Scene(duration=1e-3), dt=1e-3)), "must be a State"),
    ],
)
def test_arguments_of_the_wrong_kind(arguments: Any, message: str) -> None:
    with pytest.raises(TypeError, match=re.escape(message)):
        sp.linearize(*arguments)
    with pytest.raises(TypeError, match="reduced = 1"):
        sp.linearize(SCENE, STATE, reduced=1)  # type: ignore[arg-type]


def found(monkeypatch: pytest.MonkeyPatch, state: sp.State | None) -> None:
    """Makes this the equilibrium of every scene."""
    module: Any = ModuleType("softpinch.analysis.equilibrium")
    module.equilibrium = lambda scene: SimpleNamespace(state=state, message="it is too heavy")
    monkeypatch.setitem(sys.modules, module.__name__, module)


def test_without_a_state_it_is_the_equilibrium_under_frozen_inputs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, state = resting("driven")
    angles = state.q[3:5]
    moving = sp.Schedule.minimum_jerk([0.0, 1.0], [angles - 0.1, angles], 0.5)
    sine = sp.Sine(frequency_hz=3.0, force=(1.0, 2.0), moment=0.1, phase=1.0)
    shaken = replace(scene, schedule=moving, disturbances=[sine], duration=2.0)
    at_end = replace(state, time=1.5)
    found(monkeypatch, at_end)
    model = sp.linearize(shaken, None, ("targets", "force"), "multipliers")
    assert model == sp.linearize(scene, at_end, ("targets", "force"), "multipliers")
    own = sp.linearize(shaken, at_end, ("targets", "force"), "multipliers")
    assert own.input_values[6:].all() and not model.input_values[6:].any()


def test_a_scene_without_equilibrium_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    found(monkeypatch, None)
    with pytest.raises(ValueError, match=r"^linearize: the scene has no equilibrium: it is too "):
        sp.linearize(SCENE)
