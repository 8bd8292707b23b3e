"""Bad arguments are refused in one line that names the argument, its value and the rule."""

import math
from collections.abc import Callable
from typing import Any

import pytest

import softpinch as sp
from refusals import check_refusal
from softpinch import reference

raw: Any = sp  # wrong types on purpose
SCENE = sp.Scene(duration=0.05)
PUSHED = sp.Scene(disturbances=[sp.Step(time=0.01, force=(1.0, 0.0))])
REAL = sp.Scene(duration=0.05, contact="unilateral", friction=0.5)


def precision(scene: sp.Scene = SCENE, **how: Any) -> sp.WorkPrecision:
    return sp.work_precision(scene, progress=False, **how)


def modes(scene: sp.Scene = SCENE, coordinates: int = 9) -> sp.Modes:
    state = SCENE.start()
    return sp.modes(scene, [0.0], [state.q[:coordinates]], [state.p], [state.integral])


def computed(done: int, total: int) -> None:
    raise AssertionError("a run was computed")


def mapped(axis: Any, values: Any = None, scene: sp.Scene = SCENE, **how: Any) -> sp.StabilityMap:
    return sp.stability_map(scene, axis, values, **{"progress": computed, "dt": [1e-4], **how})


BAD_VALUES: list[tuple[Callable[[], object], str]] = [
    (lambda: sp.advise(SCENE, 0.0), "tolerance = 0.0: must be from 1e-11 to 0.1"),
    (lambda: sp.advise(SCENE, budget=math.nan), "budget = nan: must be > 0"),
    (lambda: sp.advise(SCENE, methods="euler"), "euler"),
    (lambda: sp.advise(SCENE, methods=()), "methods = (): must have at least one"),
    (lambda: sp.advise(SCENE, formulations=("csm", "lagrange")), "lagrange"),
    (lambda: precision(dt=[0.0]), "dt = 0.0: must be > 0"),
    (lambda: precision(tolerances=[-1.0]), "tolerances = -1.0: must be > 0"),
    (lambda: precision(tolerances=[2.0]), "tolerances = 2.0: must be from 1e-14 to below 1"),
    (lambda: precision(longest=0.0), "longest = 0.0"),
    (lambda: precision(formulations=()), "formulations = (): must have at least one"),
    (lambda: precision(REAL, formulations="nullspace"), 'formulations = "nullspace": must be one'),
    (lambda: sp.max_stable_dt(SCENE, "rk5"), 'did you mean "rk4"'),
    (lambda: sp.max_stable_dt(SCENE, formulation="cms"), "formulation = 'cms'"),
    (lambda: sp.max_stable_dt(SCENE, max_steps=0), "max_steps = 0: must be at least 1"),
    (
        lambda: sp.max_stable_dt(REAL, formulation="nullspace"),
        'formulation = "nullspace": must be one of "csm" or "projected" where contact =',
    ),
    (
        lambda: mapped("tilt", scene=REAL, pairs=[("nullspace", "rk4")]),
        '= "nullspace": must be one',
    ),
    (lambda: mapped("youngs_modulos"), 'did you mean "youngs_modulus"'),
    (lambda: mapped("disturbances.0.force", [1.0], PUSHED), " must be one number, such as"),
    (lambda: mapped("grasped.mass"), "values: must be given for axis = 'grasped.mass'"),
    (lambda: mapped("object_mass", [1.0, 1.0]), "values[1] = 1.0: must be greater"),
    (lambda: mapped("object_mass", [-1.0]), "object_mass = -1: GraspedObject.mass = -1.0"),
    (lambda: mapped("grasp_depth", [0.5, 1.0]), "grasp_depth = 1: must be > 0 and < 1"),
    (lambda: mapped("tilt", [0.0, 90.0]), "tilt = 90: must be >= 0 and < 90"),
    (lambda: mapped("hand.right.root_offset", [0.06]), "hand.right.root_offset = 0.06: "),
    (lambda: mapped("tilt", dt=[0.0, 1e-4]), "dt[0] = 0.0: must be finite and > 0"),
    (lambda: mapped("tilt", pairs=[]), "pairs is empty"),
    (lambda: mapped("tilt", pairs=[("csm", "rk5")]), "pairs[0][1] = 'rk5'"),
    (lambda: mapped("tilt", pairs=[("csm", "rk4")] * 2), "be repeated"),
    (lambda: mapped("tilt", max_steps=0), "max_steps = 0"),
    (lambda: mapped("tilt", threads=0), "threads = 0"),
    (lambda: modes(coordinates=8), "q has shape"),
    (lambda: modes().stable_step("euler"), "method = 'euler'"),
    (lambda: modes(REAL), "must be given in unilateral contact"),
    (lambda: reference.solve(REAL), "the reference has the equations of bilateral"),
    (lambda: reference.solve(SCENE, [0.0, 0.06]), "times: must be from 0.0 to 0.05 s"),
    (lambda: reference.solve(SCENE, rtol=0.0), "rtol = 0.0: must be finite and > 0"),
    (lambda: reference.solve(SCENE, method="Euler"), "method = 'Euler': must be one of \"DOP853\""),
]
BAD_TYPES: list[tuple[Callable[[], object], str]] = [
    (lambda: mapped(3.0), "axis = 3.0: must be a name"),
    (lambda: mapped(lambda value: value, [1.0]), "axis(1) = 1.0: must be a Scene"),
    (lambda: raw.max_stable_dt("scene"), "scene = 'scene': must be a Scene"),
    (lambda: raw.reference.solve(SCENE, "x"), "times = 'x': must hold numbers"),
    (lambda: raw.reference.solve(None), "scene = None: must be a Scene"),
]


@pytest.mark.parametrize(("call", "message"), BAD_VALUES, ids=range(len(BAD_VALUES)))
def test_bad_values_are_value_errors_in_one_line(call: Callable[[], object], message: str) -> None:
    check_refusal(call, ValueError, message)


@pytest.mark.parametrize(("call", "message"), BAD_TYPES, ids=range(len(BAD_TYPES)))
def test_bad_types_are_type_errors_in_one_line(call: Callable[[], object], message: str) -> None:
    check_refusal(call, TypeError, message)
