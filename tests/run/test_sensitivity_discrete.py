"""Derivatives beside those of RK4 on complex numbers, which is the same map: equal to round-off.

The other map shares nothing with the core: Python equations, start and inputs.
"""

import numpy as np
import pytest

import softpinch as sp
from complex_rk4 import derivatives
from derivative_differences import difference, worst
from derivative_scenes import SHARED, SIDED, SMOOTH_INPUTS, entries, moving, shared, uneven

# 50 steps and more, none of which the ends of the segments divide.
DT = 4.1e-4
PRESSED = sp.GraspedObject(width=0.047, com_offset=0.002)
SCENES = {
    "in contact": (uneven(), SIDED),
    "touching": (uneven(initial="touching", grasped=PRESSED), SIDED),
    "with a state": (moving(uneven()), SIDED),
    "shared": (shared(), SHARED),
    "shared, touching": (shared(initial="touching"), SHARED),
    "inputs": (uneven(), SMOOTH_INPUTS),
    "jumping targets": (
        uneven(schedule=sp.Schedule.steps([0.0, 0.0113], np.deg2rad([[4, 5], [8, 3]]))),
        ("schedule.angles",),
    ),
    "smooth targets": (
        uneven(
            schedule=sp.Schedule.minimum_jerk(
                [0.0, 0.0043], np.deg2rad([[4, 5], [8, 3]]), move_time=0.0111
            )
        ),
        ("schedule.angles",),
    ),
    "start": (moving(uneven()), ("initial.q", "initial.p", "initial.integral")),
}
# The other coordinates follow from these.
FREE = {"initial.q": (0, 1, 2, 3, 4, 7, 8), "initial.p": (0, 1, 2, 3, 4)}


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_are_those_of_the_same_steps_on_complex_numbers(name: str) -> None:
    scene, paths = SCENES[name]
    run = sp.simulate(
        scene,
        dt=DT,
        formulation="nullspace",
        record=("state", "multipliers", "torque"),
        sensitivities=paths,
    )
    assert run.success
    assert len(run.t) > 50
    for path in paths:
        for index in entries(scene, path):
            if path in FREE and index[0] not in FREE[path]:
                continue
            expected = derivatives(scene, DT, path, index)
            np.testing.assert_allclose(run.t, expected.pop("t"), rtol=1e-14)
            assert worst(run, expected, path, index) <= 1e-12, (path, index)


def test_a_tips_mass_that_is_the_objects_is_part_of_its_derivative_unless_it_has_a_path() -> None:
    tips = ("hand.tip.normal_mass", "hand.tip.tangential_mass")
    of_all, of_each = (
        sp.simulate(shared(), dt=1e-3, sensitivities=("grasped.mass", *more)).sensitivity
        for more in ((), tips)
    )
    together = sum(of_each.values())
    assert difference(of_all["grasped.mass"], together) <= 1e-12
    assert difference(of_each["grasped.mass"], together) > 1e-2
