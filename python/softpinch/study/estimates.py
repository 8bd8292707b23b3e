"""Estimates from many runs: probabilities, means, and the error due to the steps."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, NamedTuple, Self

import numpy as np

from ..support import Bools, Floats, Result, ShownTable, read_only
from ..support.checks import integer, numbers, read, share, shown

# The largest number of runs in a study.
_MOST = 2**62


class Estimate(NamedTuple):
    """The probability of an event, estimated from independent runs.

    Sobol points and Latin hypercubes are not independent. Their interval is that of random draws,
    which is usually too wide, and the confidence level does not hold exactly.

    Attributes:
        value: The share of the runs in which the event happened.
        low: Lower end of its confidence interval; `high` is the upper one.
        happened: The number of runs in which the event happened, of all `runs`.
        confidence: The confidence level of the interval.
        missing: The number of runs that were requested and have no result.
        interval: "Wilson" for a number of runs that was fixed before ("Probable inference", 1927);
            or "confidence sequence", which holds at every look, so that the results may decide when
            to stop (`stop_when`).
    """

    value: float
    low: float
    high: float
    happened: int
    runs: int
    confidence: float
    missing: int = 0
    interval: str = "Wilson"

    @classmethod
    def of(cls, happened: Bools, confidence: float = 0.95) -> Self:
        """Estimates from booleans (runs,): whether the event happened in each run."""
        given = read("happened", happened)
        if given.ndim != 1:
            raise ValueError(f"happened has shape {given.shape}: must have shape (runs,)")
        if given.dtype != bool and given.size:
            raise TypeError(f"happened = {shown(happened)}: must hold booleans")
        return cls.counted(int(np.count_nonzero(given)), len(given), confidence)

    @classmethod
    def counted(cls, count: int, n: int, confidence: float = 0.95) -> Self:
        """Estimates from the number of runs, `count` out of `n`, in which the event happened."""
        n = integer("n", n, 0, _MOST)
        count = integer("count", count, 0, n)
        confidence = share("confidence", confidence)
        if n == 0:
            return cls(math.nan, 0.0, 1.0, 0, 0, confidence)
        # Use the lower tail, because a probability near 1 has too few digits.
        z = -NormalDist().inv_cdf(0.5 * (1.0 - confidence))
        part, square = count / n, z * z
        middle = (part + square / (2 * n)) / (1 + square / n)
        reach = z / (1 + square / n) * math.sqrt(part * (1 - part) / n + square / (4 * n * n))
        low = 0.0 if count == 0 else max(0.0, middle - reach)
        high = 1.0 if count == n else min(1.0, middle + reach)
        return cls(part, low, high, count, n, confidence)

    @classmethod
    def at_every_look(cls, count: int, n: int, confidence: float = 0.95) -> Self:
        """Estimates as `counted`, if the results so far decided to stop after `n` runs.

        The interval is one of a confidence sequence: with probability `confidence`, the intervals
        of all n contain the probability. For each p the likelihood ratio that is mixed over a prior
        Beta(m p, m (1 - p)) is a martingale of mean one, which ever exceeds 1 / (1 - confidence)
        with at most the probability 1 - confidence (Robbins, "Statistical methods related to the
        law of the iterated logarithm", 1970; Howard, Ramdas, McAuliffe and Sekhon, "Time-uniform,
        nonparametric, nonasymptotic confidence sequences", 2021, the beta-binomial mixture).
        """
        estimate = cls.counted(count, n, confidence)._replace(interval="confidence sequence")
        if n == 0:
            return estimate
        low, rest = (_least_plausible(k, n, 1.0 - confidence) for k in (count, n - count))
        return estimate._replace(low=low, high=1.0 - rest)

    @property
    def half_width(self) -> float:
        """Half of the interval's width."""
        return 0.5 * (self.high - self.low)

    def texts(self) -> tuple[str, str, str]:
        """Share, low and high end, with digits that tell them from each other and from 0 and 1."""
        exact = {0.0, 1.0, *self[:3]}
        for digits in range(5, 18):
            if len({f"{number:.{digits}g}" for number in exact}) == len(exact):
                break
        return f"{self.value:.{digits}g}", f"{self.low:.{digits}g}", f"{self.high:.{digits}g}"

    def __str__(self) -> str:
        value, low, high = self.texts()
        requested = f", {self.runs + self.missing} requested" if self.missing else ""
        looks = " at every look" if self.interval != "Wilson" else ""
        share = f"{value} ({100 * self.confidence:g} %{looks}: {low} to {high})"
        return f"{share}, {self.happened} of {self.runs} runs{requested}{self._rule_of_three()}"

    def _rule_of_three(self) -> str:
        """What runs that all ended alike say, in words; empty if they did not."""
        if 0 < self.happened < self.runs or self.runs == 0:
            return ""
        most, why = -math.log1p(-self.confidence), "rule of three, one-sided"
        if self.interval != "Wilson":
            most = self.runs * (self.high if self.happened == 0 else 1.0 - self.low)
            why = "at every look"
        event = "it happens" if self.happened == 0 else "it fails to happen"
        return f"; {event} in at most {most:.3g} of {self.runs} runs ({why})"

    def _repr_html_(self) -> str:
        return ShownTable(self._fields, [(*self.texts(), *self[3:])], "probability").html()

    def __float__(self) -> float:
        return self.value


# A confidence sequence is narrowest at about this number of runs, a block: the first look.
_NARROWEST = 1024


def _least_plausible(count: int, n: int, level: float) -> float:
    """The smallest p that `count` of `n` runs do not contradict; see `Estimate.at_every_look`."""
    limit, rest = -math.log(level), n - count
    mass = _NARROWEST / (2.0 * limit + math.log1p(2.0 * limit))  # m, as Howard et al. choose it
    gamma = math.lgamma

    def contradicted(p: float) -> bool:
        a, b = mass * p, mass * (1.0 - p)
        mixed = gamma(a + count) - gamma(a) + gamma(b + rest) - gamma(b)
        ratio = mixed - gamma(mass + n) + gamma(mass)
        return ratio - count * math.log(p) - rest * math.log1p(-p) > limit

    # The ratio is at most one at the share itself, and grows away from it.
    low, high = sys.float_info.min, count / n
    if count == 0 or not contradicted(low):
        return 0.0
    while high - low > 1e-12 * high:
        middle = math.sqrt(low) * math.sqrt(high)
        low, high = (middle, high) if contradicted(middle) else (low, middle)
    return low


class Mean(NamedTuple):
    """The mean of the finite values of a column, and their scatter.

    Standard errors assume independent draws. With the samplers "sobol" and "latin_hypercube" they
    are usually too large.

    Attributes:
        value: The mean; NaN without a finite value.
        error: The standard error of the mean, spread / sqrt(runs); NaN for fewer than two values.
        spread: The sample standard deviation, with runs - 1; NaN for fewer than two values.
        least: The smallest value, as `greatest` is the largest; NaN without a finite value.
        runs: The number of finite values; `left_out` is the number of the others.
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
        """Computes the mean of values (n,), whose order does not matter, because sums are exact."""
        values = numbers("values", values)
        if values.ndim != 1:
            raise ValueError(f"values has shape {values.shape}: must have shape (n,)")
        kept = values[np.isfinite(values)]
        runs, left_out = len(kept), len(values) - len(kept)
        if runs == 0:
            return cls(math.nan, math.nan, math.nan, math.nan, math.nan, 0, left_out)
        least, greatest = float(kept.min()), float(kept.max())
        try:
            mean = _sum(kept) / runs
        except OverflowError:
            # The sum of fewer than 2**64 doubles does not overflow if each is divided by this.
            mean = _sum(kept / 2.0**64) / runs * 2.0**64
        spread = _spread(kept, mean, max(-least, greatest)) if runs > 1 else math.nan
        # Adding 0.0 turns -0.0 into 0.0, because the order of the values decides between them.
        error = spread / math.sqrt(runs)
        return cls(mean + 0.0, error, spread, least + 0.0, greatest + 0.0, runs, left_out)

    def __str__(self) -> str:
        digits = 5
        if self.value != 0.0 and 0.0 < self.error < math.inf:
            known = math.floor(math.log10(abs(self.value))) - math.floor(math.log10(self.error))
            digits = min(max(known + 2, 1), 17)
        left_out = f", {self.left_out} left out" if self.left_out else ""
        return f"{self.value:.{digits}g} ± {self.error:.2g} ({self.runs} runs){left_out}"

    def _repr_html_(self) -> str:
        return ShownTable(self._fields, [self], "mean").html()

    def __float__(self) -> float:
        return self.value


def _spread(values: Floats, mean: float, largest: float) -> float:
    """The sample standard deviation of two or more finite values, none larger than `largest`.

    The sum of the deviations corrects the rounding of the mean (Chan, Golub and LeVeque,
    "Algorithms for computing the sample variance", 1983, corrected two-pass).
    """
    # Scale by a power of two, which is exact, so that squares neither overflow nor underflow.
    exponent = max(math.frexp(largest)[1] - 1, -1022)
    scale = math.ldexp(1.0, -exponent)
    deviations = values * scale - mean * scale
    rest, squares = _sum(deviations), _sum(deviations * deviations)
    variance = (squares - rest * rest / len(values)) / (len(values) - 1)
    return math.sqrt(variance) * math.ldexp(1.0, exponent)


def _sum(values: Floats) -> float:
    """The exact sum, rounded once."""
    # A memory view yields one float at a time; a list of floats would take 32 bytes for each.
    return math.fsum(np.ascontiguousarray(values).data)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Discretisation(Result):
    """The error of a summary due to the steps, beside its sampling error.

    It compares runs with the same runs at smaller steps, where both values are finite. For a
    summary with several columns, each field is an array (columns,). Standard errors assume
    independent draws; with other samplers, those of a mean are usually too large.

    Attributes:
        bias: Mean of (value - value with smaller steps); `bias_error` is its standard error.
        worst: Largest |value - value with smaller steps|.
        sampling_error: Standard error of the summary's mean over all runs.
        runs: The number of compared runs.
    """

    bias: Any
    bias_error: Any
    worst: Any
    sampling_error: Any
    runs: int

    @classmethod
    def of(cls, coarse: Floats, fine: Floats, sampling_error: Any) -> Self:
        """Compares the values of runs (k, ...) with those of smaller steps."""
        with np.errstate(invalid="ignore"):
            difference = coarse - fine
        kept = np.isfinite(difference).all(axis=tuple(range(1, difference.ndim)))
        difference = difference[kept]
        runs = len(difference)
        bias = error = worst = np.full(coarse.shape[1:], np.nan)
        if runs:
            bias, worst = difference.mean(axis=0), np.abs(difference).max(axis=0)
        if runs > 1:
            error = np.sqrt(difference.var(axis=0, ddof=1) / runs)
        found = map(number_or_array, (bias, error, worst, sampling_error))
        names = ("bias", "bias_error", "worst", "sampling_error")
        return cls(**dict(zip(names, found, strict=True)), runs=runs)


def number_or_array(value: Any) -> Any:
    """Converts a number to a float, and makes an array read-only."""
    return float(value) if np.ndim(value) == 0 else read_only(np.asarray(value))
