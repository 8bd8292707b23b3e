"""The profile likelihood of one fitted number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..run.options import Options
from ..support.arrays import Floats
from ..support.extras import require
from ..support.result import Result
from .experiment import Experiment, FailedRun
from .parameters import Parameter
from .problem import Problem, influence, quiet
from .uncertainty import sandwich

# The first step, in standard errors, and the largest one, in spans.
_FIRST, _LARGEST = 0.5, 0.125
_MOST_STEPS = 60
# Shortest step that is tried after a failed run, as a share of the first one.
_SHORTEST = 1e-3
# The ends of the interval are exact to this share of their distance from the minimum.
_PRECISION = 1e-4


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Profile(Result):
    """The profile likelihood of one fitted number.

    Attributes:
        path: Its path.
        level: The level of the interval.
        interval: (low, high) of the number. An end may be its bound, which may be infinite; see
            `closed`.
        closed: Whether the interval ends before the bound, or before a value with failed runs, on
            either side.
        values: Values of the number along the profile (m,), increasing.
        increase: How far the sum of the squared residuals, over their noise, exceeds its minimum
            there, with all other numbers fitted (m,).
        limit: The increase at the ends of the interval.
    """

    path: str
    level: float
    interval: tuple[float, float]
    closed: tuple[bool, bool]
    values: Floats
    increase: Floats
    limit: float


def followed(
    experiments: Sequence[Experiment],
    parameters: Sequence[Parameter],
    options: Options,
    loss: str,
    *,
    u: Floats,
    error: float,
    index: int,
    level: float,
    reach: float,
) -> Profile:
    """Follows the profile of a parameter from the minimum to both sides.

    Args:
        experiments: The experiments, with their noise.
        parameters: All parameters.
        options: How to simulate.
        loss: The loss.
        u: The coordinates of the minimum (p,).
        error: The standard error of the parameter's coordinate, which may be inf.
        index: The parameter.
        level: The level of the interval.
        reach: Half the width of the linearised interval, in standard errors.
    """
    problem = Problem(experiments, parameters, options, loss)
    with quiet():
        motions = problem.motions(u)
        psi, slope = influence(problem.residuals(motions), loss)
        # A robust loss grows less than the sum of squares of its residuals.
        scale = 2.0 / (sandwich(psi, slope) * float(np.mean(slope))) if loss != "linear" else 2.0
        least = problem.minimum(u, held=index).cost
        step = min(_FIRST * error, _LARGEST)
        found = [
            _side(problem, u, index, sign * step, scale, least, reach * reach)
            for sign in (-1.0, 1.0)
        ]
    points = sorted({(u[index], 0.0), *(point for side in found for point in side[2])})
    parameter = parameters[index]
    return Profile(
        path=parameter.path,
        level=level,
        interval=(parameter.value(found[0][0]), parameter.value(found[1][0])),
        closed=(found[0][1], found[1][1]),
        values=np.array([parameter.value(float(at)) for at, _ in points]),
        increase=np.array([increase for _, increase in points]),
        limit=reach * reach,
    )


def _side(
    problem: Problem, u: Floats, index: int, step: float, scale: float, least: float, limit: float
) -> tuple[float, bool, list[tuple[float, float]]]:
    """Returns the end of the interval on one side, whether it is closed, and the profile."""
    optimize = require("scipy.optimize", extra="study", purpose="fit")
    bound = float(problem.bounds[0 if step < 0.0 else 1, index])
    warm, points, first = u.copy(), [(float(u[index]), 0.0)], abs(step)

    def increase(at: float) -> float:
        start = warm.copy()
        start[index] = at
        end = problem.minimum(start, held=index)
        warm[:] = end.u
        found = scale * (end.cost - least)
        points.append((at, found))
        return found

    for _ in range(_MOST_STEPS):
        before = points[-1]
        at = before[0] + step
        at = max(at, bound) if step < 0.0 else min(at, bound)
        if at == before[0]:
            return bound, False, points
        try:
            now = increase(at)
        except FailedRun:
            step *= 0.5
            if abs(step) < _SHORTEST * first:
                return before[0], False, points
            continue
        if now >= limit:
            ends = {before[0]: before[1], at: now}

            def excess(x: float, ends: dict[float, float] = ends) -> float:
                """Nearly linear in u, because the increase is nearly a parabola."""
                found = ends[x] if x in ends else increase(x)
                return float(np.sqrt(max(found, 0.0)) - np.sqrt(limit))

            near = _PRECISION * abs(at - float(u[index]))
            root = optimize.brentq(excess, before[0], at, xtol=near)
            return float(root), True, points
        step = float(np.copysign(min(1.5 * abs(step), _LARGEST), step))
    return points[-1][0], False, points
