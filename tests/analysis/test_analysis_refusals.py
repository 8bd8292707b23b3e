"""Bad arguments are refused in one line that names the argument, its value and the rule."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from refusals import check_refusal
from resting import held

raw: Any = sp  # wrong types on purpose
SCENE = sp.Scene()
STATE = SCENE.start()
SAMPLED = replace(SCENE, control=sp.SampledController.pid(1e-3))
UNILATERAL = replace(SCENE, contact="unilateral", friction=0.6)
HINT = '"pose", "fingers", "compressions", "shears", "multipliers", "torque", "rates"'


def computed(done: int, total: int) -> None:
    raise AssertionError("a cell was computed")


def mapped(axes: Any, scene: sp.Scene = SCENE, **options: Any) -> Any:
    return sp.equilibrium_map(scene, axes, progress=computed, **options)


def one_cell() -> sp.EquilibriumMap:
    return sp.equilibrium_map(SCENE, {"grip": [0.0]}, progress=False)


def at(state: Any, scene: sp.Scene = SCENE) -> sp.LinearModel:
    return sp.linearize(scene, state)


def fast(speed: float = 1e200) -> sp.State:
    return sp.State.consistent(SCENE, fingers=(0.1, 0.1), velocity=(speed, 0.0, speed))


REST = sp.equilibrium(SCENE)
SLIPS = sp.equilibrium(UNILATERAL.with_({"grasped.mass": 40.0}))
BAD_VALUES: list[tuple[Callable[[], object], str]] = [
    (lambda: sp.equilibrium(SCENE, np.nan), "time = nan"),
    (lambda: sp.equilibrium(SCENE, shear=(0.0,)), "shear has shape (1,)"),
    (lambda: sp.equilibrium(SCENE, grip=(0, 0), shear=(0, 0)), "shear and grip: give one of them"),
    (lambda: mapped({}), "axes has 0 entries: must have one or two"),
    (lambda: mapped({"grasped.mas": [1.0]}), 'did you mean "grasped.mass"'),
    (lambda: mapped({"grasped.mass": [2.0, 1.0]}), "mass'][1] = 1.0: must be greater than the"),
    (lambda: mapped({"grasped.mass": [-1.0, 1.0]}), "axes: grasped.mass = -1: "),
    (lambda: mapped({"schedule.angles": [1.0]}), "has shape (1, 2): must be one number"),
    (lambda: mapped({"initial.q.0": [1.0]}), "has no effect on where the scene rests"),
    (lambda: mapped({"grip.top": [1.0]}), 'or one of "grip"'),
    (lambda: mapped({"grip": [0.0], "grip.left": [0.0]}), "set the same number"),
    (lambda: mapped({"grip": [0.0], "shear.left": [0.0]}), "grip and shear: give one of them"),
    (lambda: mapped({"grip": [0.0]}, grip=(0.0, 0.0)), "the axes set it already"),
    (lambda: mapped({"grip.left": [0.0]}, grip=(0.0, 0.0, 0.0)), "grip has shape (3,)"),
    (lambda: mapped({"grip": np.arange(4e2), "friction": np.arange(4e2)}), "160000 cells: at most"),
    (lambda: mapped({"grip": [0.0]}, SAMPLED), "equilibrium_map needs the torques"),
    (lambda: one_cell().equilibrium(1), "i = 1: must be at most 0"),
    (lambda: one_cell().equilibrium(0, 0), "j = 0: the map has one axis"),
    (lambda: sp.wrench_limits(SCENE, [[0.0, 1.0]]), "directions has shape (1, 2)"),
    (
        lambda: sp.wrench_limits(SCENE, [[0.0, 1.0, 0.0], [0.0] * 3]),
        "directions[1] = (0, 0, 0): must",
    ),
    (lambda: sp.wrench_limits(SCENE, length=0.0), "length = 0.0: must be finite and > 0"),
    (lambda: sp.wrench_limits(REST, time=0.0), "time = 0.0: the equilibrium has it already"),
    (lambda: sp.wrench_limits(REST, near=REST.state), "the equilibrium has it already"),
    (lambda: sp.wrench_limits(REST, grip=(0.0, 0.0)), "grip = (0.0, 0.0): the equilibrium has it"),
    (
        lambda: sp.wrench_limits(REST, shear=(0.0, 0.0)),
        "shear = (0.0, 0.0): the equilibrium has it",
    ),
    (
        lambda: sp.wrench_limits(SCENE, grip=(0, 0), shear=(0, 0)),
        "shear and grip: give one of them",
    ),
    (lambda: sp.grip(SCENE), "force and compression: give one of them"),
    (lambda: sp.grip(SCENE, 1.0, compression=1e-3), "force and compression: give one of them"),
    (lambda: sp.grip(SCENE, 0.0), "force = 0.0: must be finite and > 0"),
    (lambda: sp.grip(SCENE, compression=np.nan), "compression = nan: must be finite"),
    # Half the weight is carried by each tip, whose shear presses it on the object.
    (lambda: sp.grip(SCENE, 0.3), "so little force; the least is 0.49"),
    (lambda: sp.grip(SCENE, 1e4), "at 15.34 degrees it is 38"),
    (lambda: sp.grip(SCENE, compression=0.03), "at 15.34 degrees it is 0.02 m"),
    # A friction of 0.6 needs M g / (2 * 0.6) = 0.8175 N.
    (lambda: sp.grip(UNILATERAL, 0.8), "the least is 0.8175 N"),
    (lambda: sp.grip(UNILATERAL, 0.8), "a tip would slip"),
    (lambda: sp.grip(SCENE.with_({"control": sp.Torque()}), 5.0), "grip finds target angles"),
    (
        lambda: sp.grip(SCENE.with_({"control": sp.Pid(kp=0.0, ki=0.0)}), 5.0),
        "control.right: kp",
    ),
    (lambda: sp.grip(SCENE.with_({"hand.right.root_offset": 1.0}), 5.0), "no angle of the fingers"),
    (lambda: sp.linearize(SCENE, STATE, ()), 'inputs = (): must be names out of "targets", "to'),
    (lambda: sp.linearize(SCENE, STATE, "target"), 'did you mean "targets"?'),
    (lambda: sp.linearize(SCENE, STATE, ("targets", "torque")), '"torque" exclude each other'),
    (
        lambda: sp.linearize(SCENE, STATE, outputs=("pose", "pose")),
        '"pose" is there more than once',
    ),
    (lambda: sp.linearize(SAMPLED, STATE), "linearize without inputs"),
    (lambda: sp.linearize(SAMPLED, STATE, "torque"), "this state has controller = None"),
    (lambda: at(replace(STATE, contact=[1, 1, 0, 0])), "0.]): must be None"),
    (lambda: at(replace(STATE, controller=np.zeros(5))), "state.controller: must be None"),
    (
        lambda: at(replace(STATE, q=STATE.q + 1e-3 * np.eye(9)[5])),
        "must satisfy C^H = 0 (9), which",
    ),
    (lambda: at(STATE, held(5.0, fingers="driven")), "be what the schedule has at 0.0 s, [0.087"),
    (lambda: at(fast()), "the motion has no finite derivatives there"),
    (lambda: sp.linearize(held(-28.0)), f"linearize: {sp.equilibrium(held(-28.0)).message}"),
    (lambda: at(REST, held(5.0)), "state: is an equilibrium of another scene; pass scene = "),
    (lambda: sp.linearize(SLIPS.scene, SLIPS), "linearize: no equilibrium"),
    (
        lambda: sp.linearize(SCENE, fast(1e-3), reduced=True),
        "reduced = True: the operating point m",
    ),
]
BAD_TYPES: list[tuple[Callable[[], object], str]] = [
    (lambda: raw.equilibrium(1), "scene = 1: must be a Scene"),
    (lambda: raw.equilibrium(SCENE, near=np.zeros(9)), "near = array([0., 0., 0., 0., 0., 0., 0."),
    (lambda: mapped([("grip", [0.0])]), "axes = [('grip', [0.0])]: must be a mapping of names to"),
    (lambda: raw.wrench_limits(3), "grasp = 3: must be a Scene or an Equilibrium"),
    (lambda: at("start"), "state = 'start': must be a State"),
    (lambda: raw.linearize(SCENE, STATE, outputs=3), f"outputs = 3: must be names out of {HINT}"),
    (lambda: raw.linearize(SCENE, STATE, reduced=1), "reduced = 1: must be"),
]


@pytest.mark.parametrize(("call", "message"), BAD_VALUES, ids=range(len(BAD_VALUES)))
def test_bad_values_are_value_errors_in_one_line(call: Callable[[], object], message: str) -> None:
    check_refusal(call, ValueError, message)


@pytest.mark.parametrize(("call", "message"), BAD_TYPES, ids=range(len(BAD_TYPES)))
def test_bad_types_are_type_errors_in_one_line(call: Callable[[], object], message: str) -> None:
    check_refusal(call, TypeError, message)
