"""Scenes as the peers take them: softpinch.reference's equations, and pieces of constant inputs.

The state is the null-space form's (14,). The parameters c (40,) are `reference.PARAMETERS` and,
last, the `INPUTS` of a piece, so a solver has one array to hand on.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import softpinch as sp
from softpinch import reference
from softpinch.accuracy.segments import Inputs

Floats = NDArray[np.float64]
INPUTS = ("target_1", "target_2", "force_x", "force_y", "moment")
NAMES = reference.PARAMETERS + INPUTS
_GIVEN = len(reference.PARAMETERS)
_ALL = len(NAMES)
# How large each state gets: what is negligible of it, for solvers that want to know.
SIZE = np.array([0.02, 0.08, 0.2, 0.2, 0.2, 8e-3, 8e-3, 0.01, 0.01, 0.3, 0.3, 3, 6, 6])


def pieces(scene: sp.Scene) -> list[tuple[float, Floats]]:
    """Duration (s) and `INPUTS` (5,) from switch to switch.

    Raises:
        ValueError: The inputs are not piecewise constant.
    """
    begin = scene.start().time
    inputs = Inputs(scene, begin, begin + scene.duration)
    found = []
    for left, right in pairwise(inputs.edges):
        driven = inputs.between(left, right)
        # Two instants would do for a polynomial, and a sine has no such period.
        here = {driven(left + share * (right - left)) for share in (0.0, 0.1234, math.sqrt(0.5))}
        if len(here) > 1 or inputs.impulses:
            raise ValueError("peers take piecewise constant inputs only")
        found.append((right - left, np.array(here.pop())))
    return found


def parameters(scene: sp.Scene) -> Floats:
    """The numbers of `NAMES` (40,), the inputs those of the first piece."""
    return np.array([*reference.parameters(scene), *pieces(scene)[0][1]])


def start(scene: sp.Scene) -> Floats:
    state = scene.start()
    return np.array([*state.q[:5], *state.q[7:], *state.integral, *state.p[:5]])


def by_pieces(
    scene: sp.Scene, y: Floats, advance: Callable[[Any, Floats, float, Any], Any]
) -> Callable[[Any], Any]:
    """setting -> the state at the end: each piece by `advance(state, c, duration, setting)`.

    So every solver starts anew at each switch, as it must: across one it would lose its order.
    """
    given = reference.parameters(scene)
    rows = [(duration, np.array([*given, *inputs])) for duration, inputs in pieces(scene)]

    def solve(setting: Any) -> Any:
        state: Any = y.copy()
        for duration, c in rows:
            state = advance(state, c, duration, setting)
        return state

    return solve


def scipy_end(
    slope: Any, y: Floats, duration: float, method: str, rtol: float, size: Floats, given: Floats
) -> Floats:
    """The state after a piece by `solve_ivp`, NaN where it gives up; `slope` is of (t, y, given).

    `size` is how large each state gets: the absolute tolerance is `rtol` of it.
    """
    span = (0.0, duration)
    # LSODA and Radau ask for no less than 100 times round-off, and would warn.
    done = solve_ivp(
        *(slope, span, y, method),
        t_eval=span[1:],
        args=(given,),
        rtol=max(rtol, 2.3e-14),
        atol=rtol * size,
    )
    return done.y[:, -1] if done.success else np.full(len(y), np.nan)


def right_hand_side(
    sin: Callable[[Any], Any],
    cos: Callable[[Any], Any],
    compiled: Callable[[Callable[..., Any]], Callable[..., Any]] = lambda f: f,
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Two functions of (state, c): the state's rates (14), and d_n, its rates and d_t's (6)."""
    rates, followers, _ = reference.right_hand_side(sin, cos, compiled)

    @compiled
    def together(y, c):  # type: ignore[no-untyped-def]
        return rates(y, c[0:_GIVEN], c[_GIVEN:_ALL])

    return together, followers


def spread(state: Any, c: Floats) -> tuple[Floats, Floats]:
    """The nine coordinates and their rates from the fourteen states."""
    y = [float(value) for value in state]
    d_n1, d_n2, *tips = _FOLLOWERS(y, c.tolist())
    return np.array([*y[:5], d_n1, d_n2, *y[5:7]]), np.array([*y[9:], *tips])


_FOLLOWERS = right_hand_side(math.sin, math.cos)[1]
