"""Estimates from many runs: probabilities with intervals, and what the steps put off."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..support.arrays import Floats, read_only
from ..support.checks import integer, numbers, read, share, shown
from ..support.result import Result

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


class Mean(NamedTuple):
    """The mean of the finite ones among many values, and how they scatter.

    Standard errors are those of independent draws, also where the sampler is another: then they
    are most often too large.

    Attributes:
        value: The mean; NaN without a finite value.
        error: Its standard error, spread / sqrt(runs); NaN for fewer than two.
        spread: Sample standard deviation, with runs - 1; NaN for fewer than two.
        least: The smallest; NaN without a finite value.
        greatest: The largest; NaN without a finite value.
        runs: How many values were finite.
        left_out: How many were not.
    """

    value: float
    error: float
    spread: float
    least: float
    greatest: float
    runs: int
    left_out: int

    @classmethod
    def of(cls, values: Floats) -> Self:
        """Of values (n,). Sums are rounded once, so their order does not matter, to the bit.

        Raises:
            TypeError: They are no numbers.
            ValueError: They have another shape.
        """
        values = numbers("values", values)
        if values.ndim != 1:
            raise ValueError(f"values has shape {values.shape}: must have shape (n,)")
        kept = values[np.isfinite(values)]
        runs, left_out = len(kept), len(values) - len(kept)
        if runs == 0:
            return cls(math.nan, math.nan, math.nan, math.nan, math.nan, 0, left_out)
        least, greatest = float(kept.min()), float(kept.max())
        mean = _mean(kept)
        spread = _spread(kept, mean, max(-least, greatest)) if runs > 1 else math.nan
        # Adding 0.0 takes the sign off a zero: which of 0.0 and -0.0 comes out is chance.
        return cls(
            mean + 0.0,
            spread / math.sqrt(runs),
            spread,
            least + 0.0,
            greatest + 0.0,
            runs,
            left_out,
        )

    def __str__(self) -> str:
        """The mean to two digits of its error, and the counts."""
        digits = 5
        if self.value != 0.0 and 0.0 < self.error < math.inf:
            known = math.floor(math.log10(abs(self.value))) - math.floor(math.log10(self.error))
            digits = min(max(known + 2, 1), 17)
        left_out = f", {self.left_out} left out" if self.left_out else ""
        return f"{self.value:.{digits}g} ± {self.error:.2g} ({self.runs} runs){left_out}"

    def __float__(self) -> float:
        """The mean."""
        return self.value


# Sums of fewer than 2**64 doubles do not overflow when the doubles are divided by this.
_OVERFLOW_SCALE = 2.0**64


def _mean(values: Floats) -> float:
    """Of finite values (n,), at least one."""
    try:
        return _sum(values) / len(values)
    except OverflowError:
        return _sum(values / _OVERFLOW_SCALE) / len(values) * _OVERFLOW_SCALE


def _spread(values: Floats, mean: float, largest: float) -> float:
    """Sample standard deviation of two or more finite values.

    The deviations are from a rounded mean, and their own sum corrects for that: the corrected
    two-pass algorithm of Chan, Golub and LeVeque, "Algorithms for computing the sample variance",
    1983.

    Args:
        values: (n,).
        mean: Theirs.
        largest: The largest magnitude among them.
    """
    # A power of two as the unit, so that no square overflows or vanishes.
    exponent = max(math.frexp(largest)[1] - 1, -1022)
    scale = math.ldexp(1.0, -exponent)
    deviations = values * scale - mean * scale
    rest, squares = _sum(deviations), _sum(deviations * deviations)
    variance = (squares - rest * rest / len(values)) / (len(values) - 1)
    return math.sqrt(variance) * math.ldexp(1.0, exponent)


def _sum(values: Floats) -> float:
    """The sum, rounded once."""
    # A memory view gives Python's floats one by one; a list of them would take 32 bytes each.
    return math.fsum(np.ascontiguousarray(values).data)


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
