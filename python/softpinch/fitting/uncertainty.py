"""The uncertainty of fitted parameters, and the profile likelihood of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.arrays import Floats
from ..support.extras import require
from ..support.result import Result
from .experiment import FailedRun
from .problem import Parameter, Problem, influence

if TYPE_CHECKING:
    from .result import Fit

# Singular values below this share of the largest are round-off, as are smaller entries of the
# directions.
_ROUND_OFF = 1e-9
_DUST = 1e-6
# A parameter takes part in a direction if its entry has at least this share of the largest.
_SHARE = 0.1
# The first step, in standard errors, and the largest one, in spans.
_FIRST, _LARGEST = 0.5, 0.125
_MOST_STEPS = 60
# Shortest step that is tried after a failed run, as a share of the first one.
_SHORTEST = 1e-3
# The ends of the interval are exact to this share of their distance from the minimum.
_PRECISION = 1e-4


class Uncertainty(NamedTuple):
    """Uncertainty of the coordinates u in the linearised problem.

    Attributes:
        covariance: Covariance of u (p, p); large but finite where the data determine nothing.
        singular_values: Singular values of the weighted Jacobian by u (p,), the largest first: the
            change of the data, in standard deviations of the noise, along a step of one.
        directions: The singular directions, one a row (p, p).
        determined: Whether the interval of each parameter has less than its `room` (p,).
    """

    covariance: Floats
    singular_values: Floats
    directions: Floats
    determined: NDArray[np.bool_]


def uncertainty(
    jacobian: Floats, parameters: Sequence[Parameter], inflation: float, reach: float
) -> Uncertainty:
    """Evaluates the Jacobian (N, p).

    Args:
        jacobian: The derivatives of the weighted residuals by u.
        parameters: The parameters.
        inflation: The factor of the covariance that a robust loss needs.
        reach: Half the width of the interval in standard errors.
    """
    p = jacobian.shape[1]
    # Rows of zeros let fewer measurements than parameters have all p directions.
    padded = np.vstack([jacobian, np.zeros((max(0, p - len(jacobian)), p))])
    _, sizes, directions = np.linalg.svd(padded, full_matrices=False)
    # The largest entry of a direction is positive.
    signs = np.sign(directions[np.arange(p), np.abs(directions).argmax(axis=1)])
    directions = directions * signs[:, None]
    clean = np.where(np.abs(directions) < _DUST, 0.0, directions)
    least = max(_ROUND_OFF * sizes[0], 1e-150)
    covariance = inflation * (clean.T / np.maximum(sizes, least) ** 2) @ clean
    known = sizes > least
    exact = np.array([not clean[~known, k].any() for k in range(p)])
    room = np.array([each.room for each in parameters])
    determined = exact & (2.0 * reach * np.sqrt(np.diag(covariance)) < room)
    return Uncertainty(covariance, sizes, directions, determined)


def sandwich(psi: Floats, slope: Floats) -> float:
    """Returns the factor of the covariance of an M-estimate: E[psi^2] / E[psi']^2.

    See Huber and Ronchetti, Robust Statistics, 2nd edition, section 7.6.
    """
    return float(np.mean(psi * psi) / np.mean(slope) ** 2)


def correlations(covariance: Floats) -> Floats:
    """Returns the correlations (p, p) of a covariance."""
    sizes = np.sqrt(np.diag(covariance))
    return np.asarray(np.clip(covariance / np.outer(sizes, sizes), -1.0, 1.0))


def sentences(found: Uncertainty, parameters: Sequence[Parameter]) -> Iterator[str]:
    """Says which combinations of parameters the data do not determine.

    They are the singular directions from which the parameters that are not determined, and that
    take part in them, have most of their variance.
    """
    least = _ROUND_OFF * max(float(found.singular_values[0]), 1e-150)
    entries = np.abs(found.directions)
    shares = entries / np.maximum(found.singular_values, least)[:, None]
    shares[entries < _SHARE * entries.max(axis=1, keepdims=True)] = 0.0
    weak = {int(shares[:, k].argmax()) for k in np.flatnonzero(~found.determined)}
    for which in sorted(weak):
        size, direction = found.singular_values[which], found.directions[which]
        largest = np.abs(direction).max()
        # The step along the direction that takes the foremost parameter through its whole span.
        change = float(size / largest)
        part = np.abs(direction) >= _SHARE * largest
        names = [each.path for each, one in zip(parameters, part, strict=True) if one]
        noise = f"changes the data by {change:.2g} standard deviations of the noise in all"
        if len(names) == 1:
            whole = _full_range(parameters[int(np.flatnonzero(part)[0])])
            yield f"the data do not determine {names[0]}: {whole} {noise}, by the slope at the fit"
            continue
        joined = f"{', '.join(names[:-1])} and {names[-1]}"
        moves = _moves(parameters, np.where(part, direction, 0.0))
        yield (
            f"the data do not determine {joined} separately: {moves} together change the data by "
            f"{_moved(parameters, direction) * float(size):.2g} standard deviations of the noise "
            "in all"
        )


def _full_range(parameter: Parameter) -> str:
    if np.isfinite(parameter.high - parameter.low) and parameter.low > -np.inf:
        return f"its whole range, {parameter.low:g} to {parameter.high:g}{parameter.shown_unit},"
    if parameter.log:
        return "a factor of ten"
    return f"a change by {parameter.span:g}{parameter.shown_unit}"


def _moved(parameters: Sequence[Parameter], direction: Floats) -> float:
    """The step along a direction after which the foremost parameter has changed by a tenth.

    A tenth is of its value for `log`, and of its span otherwise.
    """
    index = int(np.abs(direction).argmax())
    share = np.log(1.1) / parameters[index].span if parameters[index].log else 0.1
    return float(share / abs(direction[index]))


def _moves(parameters: Sequence[Parameter], direction: Floats) -> str:
    """The changes of the parameters along a direction, in words."""
    step = _moved(parameters, direction) * direction
    texts = []
    for each, by in zip(parameters, step.tolist(), strict=True):
        if by == 0.0:
            continue
        if each.log:
            texts.append(f"{each.path} {100.0 * np.expm1(by * each.span):+.2g} %")
        else:
            texts.append(f"{each.path} {by * each.span:+.2g}{each.shown_unit}")
    return " and ".join(texts)


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


def followed(fit: Fit, index: int, level: float, reach: float) -> Profile:
    """Follows the profile of a parameter from the minimum to both sides.

    Args:
        fit: The fit.
        index: The parameter.
        level: The level of the interval.
        reach: Half the width of the linearised interval, in standard errors.
    """
    problem, u = Problem(fit.experiments, fit.parameters, fit.options, fit.loss), fit.estimate
    motions = problem.motions(u)
    psi, slope = influence(problem.residuals(motions), fit.loss)
    # A robust loss grows less than the sum of squares of its residuals.
    scale = 2.0
    if fit.loss != "linear":
        scale /= sandwich(psi, slope) * float(np.mean(slope))
    least = problem.minimum(u, held=index).cost
    step = min(_FIRST * float(fit.scaled_errors[index]), _LARGEST)
    found = [
        _side(problem, u, index, sign * step, scale, least, reach * reach) for sign in (-1.0, 1.0)
    ]
    points = sorted({(u[index], 0.0), *(point for side in found for point in side[2])})
    parameter = fit.parameters[index]
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
