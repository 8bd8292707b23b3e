"""How far the data of a fit determine its parameters, from the Jacobian at the minimum."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..support.arrays import Floats
from .parameters import Parameter

# Singular values below this share of the largest are round-off, as are smaller entries of the
# directions.
_ROUND_OFF = 1e-9
_DUST = 1e-6
# A parameter takes part in a direction if its entry has at least this share of the largest.
_SHARE = 0.1


class Uncertainty(NamedTuple):
    """What the linearised problem says about the coordinates u.

    Attributes:
        covariance: Of u (p, p); large but finite where the data determine nothing.
        singular_values: Of the weighted Jacobian by u (p,), the largest first. They are the change
            of the data, in standard deviations of the noise, along a step of one.
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
            (index,) = np.flatnonzero(part)
            yield (
                f"the data do not determine {names[0]}: {_whole(parameters[int(index)])} {noise}, "
                "by the slope at the fit"
            )
            continue
        joined = f"{', '.join(names[:-1])} and {names[-1]}"
        moves = _moves(parameters, np.where(part, direction, 0.0))
        yield (
            f"the data do not determine {joined} separately: {moves} together change the data by "
            f"{_moved(parameters, direction) * float(size):.2g} standard deviations of the noise "
            "in all"
        )


def _whole(parameter: Parameter) -> str:
    if np.isfinite(parameter.high - parameter.low) and parameter.low > -np.inf:
        return f"its whole range, {parameter.low:g} to {parameter.high:g}{_unit(parameter)},"
    if parameter.log:
        return "a factor of ten"
    return f"a change by {parameter.span:g}{_unit(parameter)}"


def _unit(parameter: Parameter) -> str:
    return "" if parameter.unit == "1" else f" {parameter.unit}"


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
            texts.append(f"{each.path} {by * each.span:+.2g}{_unit(each)}")
    return " and ".join(texts)
