"""Derivatives beside the variational equations of the SymPy oracle, integrated by SciPy.

Their difference has the errors of both integrations, of which each is far below 1e-8.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

import softpinch as sp
from derivative_differences import difference, of
from derivative_scenes import (
    LOADS,
    SHARED,
    SIDED,
    SMOOTH_INPUTS,
    TIMES,
    entries,
    moving,
    shared,
    uneven,
)
from softpinch import _core
from variational import Variations

DT = 5e-5
# Method, tolerance, and what the derivatives may be off.
FREE = (("dop853", 1e-11, 1e-9), ("radau5", 1e-9, 1e-9), ("rosenbrock", 1e-8, 1e-6))
RECORD = ("state", "multipliers", "torque")
STEPS = sp.Schedule.steps([0.0, 0.0083], np.deg2rad([[4, 5], [8, 3]]))
SMOOTH = sp.Schedule.minimum_jerk([0.0, 0.0043], np.deg2rad([[4, 5], [8, 3]]), move_time=0.0111)
IMPULSE = sp.Impulse(time=0.0057, impulse=(0.02, -0.01), angular_impulse=3e-4)


class Case(NamedTuple):
    scene: sp.Scene
    paths: tuple[str, ...]
    formulations: tuple[str, ...] = tuple(_core.FORMULATIONS)


CASES = {
    "in contact": Case(uneven(), (*SIDED, *SMOOTH_INPUTS, *TIMES)),
    "pressed, with jumps": Case(
        shared(
            disturbances=(IMPULSE, LOADS[1], sp.Step(time=0.0157, force=(1.0, 2.0))), schedule=STEPS
        ),
        (
            *SHARED,
            "grasped.width",
            "schedule.times",
            "schedule.angles",
            *(f"disturbances.0.{name}" for name in ("time", "impulse", "angular_impulse")),
            "disturbances.1.time",
            "disturbances.1.duration",
            "disturbances.2.time",
        ),
    ),
    "touching": Case(
        shared(initial="touching", schedule=SMOOTH),
        (
            *SHARED,
            "hand.right.length",
            "hand.left.root_offset",
            "hand.right.half_thickness",
            "grasped.width",
            "schedule.move_time",
            "schedule.times",
        ),
    ),
    # Off the constraints as only this formulation can be.
    "with a state": Case(
        moving(uneven()), ("initial.q", "initial.p", "initial.integral", *SIDED), ("csm",)
    ),
}


@cache
def expected(name: str) -> tuple[Any, Variations]:
    """Some ends of steps, one at least in each segment, and the derivatives there."""
    scene = CASES[name].scene
    run = sp.simulate(scene, dt=DT)
    times = run.t[[0, len(run.t) // 7, len(run.t) // 3, 2 * len(run.t) // 3, -2, -1]]
    numbers = [(path, index) for path in CASES[name].paths for index in entries(scene, path)]
    return times, Variations(scene, numbers, times)


@pytest.mark.parametrize(
    ("name", "formulation"),
    [(name, one) for name, case in CASES.items() for one in case.formulations],
)
def test_derivatives_obey_the_variational_equations(name: str, formulation: str) -> None:
    scene, paths, _ = CASES[name]
    times, variations = expected(name)
    run = sp.simulate(
        scene,
        dt=DT,
        method="dop853",
        formulation=formulation,
        record=RECORD,
        sensitivities=paths,
    )
    rows = np.searchsorted(run.t, times)
    np.testing.assert_array_equal(run.t[rows], times)
    for quantity, slopes in variations.slopes.items():
        numbers = [(path, index) for path in paths for index in entries(scene, path)]
        for k, (path, index) in enumerate(numbers):
            ours = of(run, quantity, path, index)[rows]
            off = difference(ours, slopes[:, :, k], quantity)
            assert off <= 1e-8, (quantity, path, index)


def test_free_steps_have_derivatives_as_accurate_as_their_motion() -> None:
    name = "in contact"
    scene, paths, _ = CASES[name]
    times, variations = expected(name)
    for method, tolerance, bound in FREE:
        run = sp.simulate(
            scene,
            method=method,
            tolerance=tolerance,
            times=times,
            formulation="nullspace",
            record=RECORD,
            sensitivities=paths,
        )
        numbers = [(path, index) for path in paths for index in entries(scene, path)]
        for k, (path, index) in enumerate(numbers):
            ours = of(run, "state", path, index)
            off = difference(ours, variations.slopes["state"][:, :, k])
            assert off <= bound, (method, path, index, off)
