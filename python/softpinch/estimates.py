"""Estimates from many runs: probabilities with intervals, and what the steps put off."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ._record import Floats, integer, read, read_only, share, shown
from ._result import Result

# Of one study: as many as intervals of their numbers can be.
_MOST = 2**62


class Estimate(NamedTuple):
    """A probability, estimated from independent runs.

    Points of Sobol or of a Latin hypercube are not independent: their interval is that of as many
    random draws, most often too wide, and nothing promises 95 %.

    Attributes:
        value: The share of the runs.
        low: Lower end of its interval (Wilson, "Probable inference", 1927).
        high: Upper end.
        happened: How many runs it happened in.
        runs: Out of how many.
        confidence: Of the interval.
    """

    value: float
    low: float
    high: float
    happened: int
    runs: int
    confidence: float

    @classmethod
    def of(cls, happened: NDArray[np.bool_], confidence: float = 0.95) -> Self:
        """From whether it happened in each run (runs,).

        Raises:
            TypeError: `happened` holds something else than booleans.
            ValueError: It has another shape, or `confidence` is not within 0 and 1.
        """
        given = read("happened", happened)
        if given.ndim != 1:
            raise ValueError(f"happened has shape {given.shape}: must have shape (runs,)")
        if given.dtype != bool and given.size:
            raise TypeError(f"happened = {shown(happened)}: must hold booleans")
        return cls.counted(int(np.count_nonzero(given)), len(given), confidence)

    @classmethod
    def counted(cls, count: int, n: int, confidence: float = 0.95) -> Self:
        """From how many of `n` runs it happened in.

        Raises:
            TypeError: One is of the wrong kind.
            ValueError: `count` is not from 0 to `n`, or `confidence` not within 0 and 1.
        """
        n = integer("n", n, 0, _MOST)
        count = integer("count", count, 0, n)
        confidence = share("confidence", confidence)
        if n == 0:
            return cls(math.nan, 0.0, 1.0, 0, 0, confidence)
        # From the tail: what is near 1 has no digits left for it.
        z = -NormalDist().inv_cdf(0.5 * (1.0 - confidence))
        part, square = count / n, z * z
        middle = (part + square / (2 * n)) / (1 + square / n)
        reach = z / (1 + square / n) * math.sqrt(part * (1 - part) / n + square / (4 * n * n))
        low = 0.0 if count == 0 else max(0.0, middle - reach)
        high = 1.0 if count == n else min(1.0, middle + reach)
        return cls(part, low, high, count, n, confidence)

    @property
    def half_width(self) -> float:
        """Half the interval's width."""
        return 0.5 * (self.high - self.low)

    def __str__(self) -> str:
        """Share, interval and counts."""
        interval = f"{100 * self.confidence:g} %: {self.low:.5g} to {self.high:.5g}"
        return f"{self.value:.5g} ({interval}), {self.happened} of {self.runs} runs"

    def __float__(self) -> float:
        """The share."""
        return self.value


@dataclass(frozen=True, kw_only=True, eq=False)
class Discretisation(Result):
    """How far the steps put a summary off, beside what sampling leaves open.

    Over the runs that were computed again with smaller steps and gave finite numbers both times;
    of a summary with several columns each is (columns,). Standard errors are those of independent
    draws, also where the sampler is another: then those of a mean are most often too large.

    Attributes:
        bias: Mean of (value - value with smaller steps).
        bias_error: Standard error of that mean.
        worst: Largest |value - value with smaller steps|.
        sampling_error: Standard error of the summary's mean over all runs.
        runs: How many runs were compared.
    """

    bias: Any
    bias_error: Any
    worst: Any
    sampling_error: Any
    runs: int

    @classmethod
    def of(cls, coarse: Floats, fine: Floats, every: Iterable[Floats]) -> Self:
        """From the values of the same runs with larger and smaller steps, and of all, in parts."""
        with np.errstate(invalid="ignore"):
            difference = coarse - fine
        kept = _finite(difference)
        difference = difference[kept]
        nothing = np.full(coarse.shape[1:], np.nan)
        return cls(
            bias=plain(difference.mean(axis=0) if len(difference) else nothing),
            bias_error=plain(_standard_error([difference])),
            worst=plain(np.abs(difference).max(axis=0) if len(difference) else nothing),
            sampling_error=plain(_standard_error(every)),
            runs=int(np.count_nonzero(kept)),
        )


def _standard_error(parts: Iterable[Floats]) -> Floats:
    """Of the mean of values (runs, ...) that come in parts; rows that are not finite are left out.

    Sums of squares about the means of two parts combine as in Chan, Golub and LeVeque, 1979.
    """
    runs = 0
    mean: Any = 0.0
    squares: Any = 0.0
    for part in parts:
        values = part[_finite(part)]
        if not len(values):
            mean = mean + np.zeros(values.shape[1:])
            continue
        own = values.mean(axis=0)
        apart = own - mean
        total = runs + len(values)
        squares = (
            squares + ((values - own) ** 2).sum(axis=0) + apart**2 * (runs * len(values) / total)
        )
        mean = mean + apart * (len(values) / total)
        runs = total
    if runs < 2:
        return np.full(np.shape(mean), np.nan)
    error: Floats = np.sqrt(squares / (runs - 1) / runs)
    return error


def _finite(values: Floats) -> NDArray[np.bool_]:
    """Which rows are finite throughout; there may be no row."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))), dtype=bool)


def plain(value: Any) -> Any:
    """A number as a float, an array read-only."""
    return float(value) if np.ndim(value) == 0 else read_only(np.asarray(value))
