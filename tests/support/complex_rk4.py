"""RK4 on complex numbers, with the package's NumPy equations of the null-space form.

It is the same map from step to step as the core's, so that its derivatives are the core's but for
round-off.
"""

from __future__ import annotations

import cmath
import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from complex_numbers import STEP, Numbers
from softpinch.accuracy import null_space

Floats = NDArray[np.float64]
_EQUATIONS = null_space.right_hand_side(cmath.sin, cmath.cos)
_STATE = [0, 1, 2, 3, 4, 7, 8, 18, 19, 9, 10, 11, 12, 13]


def derivatives(
    scene: sp.Scene, dt: float, path: str, index: tuple[int, ...] = ()
) -> dict[str, Floats]:
    """The derivatives of t, q and p ("state"), integral, multipliers and torque, row by row."""
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
