"""Derivatives beside those of RK4 on complex numbers, which is the same map: equal to round-off.

The other map shares nothing with the core: Python equations, start and inputs.
"""

import cmath
import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

import softpinch as sp
from complex_numbers import STEP, Numbers
from derivative_differences import difference, worst
from derivative_scenes import SHARED, SIDED, SMOOTH_INPUTS, entries, moving, shared, uneven
from softpinch.accuracy import null_space

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


Floats = NDArray[np.float64]
_EQUATIONS = null_space.right_hand_side(cmath.sin, cmath.cos)
_STATE = [0, 1, 2, 3, 4, 7, 8, 18, 19, 9, 10, 11, 12, 13]


def derivatives(
    scene: sp.Scene, dt: float, path: str, index: tuple[int, ...] = ()
) -> dict[str, Floats]:
    """The derivatives of t, q and p ("state"), integral, multipliers and torque, row by row.

    It is RK4 on complex numbers, with the package's NumPy equations of the null-space form.
    """
    numbers = Numbers(scene, path, index)
    c = tuple(numbers.parameters[name] for name in null_space.PARAMETERS)
    y = numbers.start[_STATE]
    edges = [edge.real for edge in numbers.edges]
    rows = []
    for left, right in pairwise(edges):
        middle = (left + right) / 2
        steps = math.ceil((right - left) / dt * (1 - 1e-12))
        h = (right - left) / steps

        def rate(since: float, y: np.ndarray, a: float = left, inside: float = middle) -> Floats:
            u = tuple(numbers.inputs(a + since, inside).tolist())
            return np.array(_EQUATIONS.rates(tuple(y.tolist()), c, u))

        for k in range(steps):
            # At a break the inputs of a row are those just after it.
            u = tuple(numbers.inputs(left + k * h, middle).tolist())
            rows.append((left + k * h, *_row(y, c, u)))
            k1 = rate(k * h, y)
            k2 = rate(k * h + h / 2, y + h / 2 * k1)
            k3 = rate(k * h + h / 2, y + h / 2 * k2)
            k4 = rate((k + 1) * h, y + h * k3)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    end = tuple(numbers.inputs(edges[-1], (edges[-2] + edges[-1]) / 2).tolist())
    rows.append((edges[-1], *_row(y, c, end)))
    names = ("t", "state", "integral", "multipliers", "torque")
    columns = dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))
    slopes = {name: column.imag / STEP for name, column in columns.items()}
    return slopes | {"t": columns["t"]}


def _row(y: np.ndarray, c: tuple[complex, ...], u: tuple[complex, ...]) -> list[np.ndarray]:
    state = tuple(y.tolist())
    d_n1, d_n2, *rates = _EQUATIONS.followers(state, c)
    motion = [*state[:5], d_n1, d_n2, *state[5:7], *state[9:], *rates]
    torque = [
        -c[12 + 15 * i] * (state[3 + i] - u[i])
        - c[13 + 15 * i] * state[12 + i]
        - c[14 + 15 * i] * state[7 + i]
        for i in range(2)
    ]
    return [
        np.array(part) for part in (motion, state[7:9], _EQUATIONS.multipliers(state, c, u), torque)
    ]


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
