"""Numbers that come in chunks and do not fit into memory: sum, mean and spread, quantiles.

Nothing here depends on how the numbers are cut into chunks or on their order, to the bit: what is
added up is added up exactly, and what is counted is counted. A chunk has any shape.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._record import Floats

# What gives the same numbers again for every pass.
Chunks: TypeAlias = Callable[[], Iterable[Floats]]
Keys: TypeAlias = NDArray[np.uint64]
Integers: TypeAlias = NDArray[np.int64]

# Numbers that are added up at a time: few enough to stay in the cache, and at most 2**27.
_BLOCK = 2**16
# The exact sum's unit is 2**-_POINT: below the last bit of the smallest double, which frexp
# writes as 0.5 * 2**-_LEAST_EXPONENT with 53 bits behind the point.
_LEAST_EXPONENT = 1073
_POINT = _LEAST_EXPONENT + 53
# Bits of a key that one pass over the chunks looks at: four passes see all 64.
_DIGIT = 16
# So many keys are gathered and sorted rather than narrowed down by another pass.
_GATHERED = 2**20
_SIGN = np.uint64(1 << 63)


class ExactSum:
    """The sum of doubles without any rounding, as one long integer.

    The integer spans all exponents, so nothing overflows on the way. Numbers of the same exponent
    are first added up in doubles, which is exact as their significands are cut in two. After Neal,
    "Fast exact summation using small and large superaccumulators", arXiv:1505.05571, 2015.
    """

    def __init__(self) -> None:
        """The sum of nothing, 0."""
        self._total = 0

    def add(self, values: Floats) -> None:
        """Adds values, of any shape, all of them finite: leaving others out is up to the caller."""
        flat = values.reshape(-1)
        for start in range(0, flat.size, _BLOCK):
            self._total += _exactly(flat[start : start + _BLOCK])

    @property
    def value(self) -> float:
        """The sum, rounded once; infinite only if that is what the whole sum rounds to."""
        return self.over(1)

    def over(self, count: int) -> float:
        """The sum divided by a positive integer, rounded once."""
        try:
            return self._total / (count << _POINT)
        except OverflowError:
            return math.inf if self._total > 0 else -math.inf


def _exactly(values: Floats) -> int:
    """The sum of a block (n,) in units of 2**-_POINT."""
    low, exponent = np.frexp(values)
    exponent += _LEAST_EXPONENT
    # The 53 bits as high * 2**27 + low, both at most 2**26: 2**27 of them add up within 53 bits.
    low *= 2.0**26
    high = np.rint(low)
    low -= high
    low *= 2.0**27
    highs, lows = np.bincount(exponent, high), np.bincount(exponent, low)
    places = np.flatnonzero((highs != 0.0) | (lows != 0.0))
    return sum(
        ((int(high) << 27) + int(low)) << place
        for place, high, low in zip(
            places.tolist(), highs[places].tolist(), lows[places].tolist(), strict=True
        )
    )


class Mean(NamedTuple):
    """The mean of the finite ones among many values, and how they scatter.

    Standard errors are those of independent draws, also where the sampler is another: then they
    are most often too large.

    Attributes:
        value: The mean, correctly rounded; NaN without a finite value.
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
    def of(cls, chunks: Chunks) -> Self:
        """In two passes: the mean, then the deviations from it.

        Raises:
            ValueError: The second pass has another number of finite values.
        """
        total, runs, left_out = ExactSum(), 0, 0
        least, greatest = math.inf, -math.inf
        for values in chunks():
            kept = values[np.isfinite(values)]
            left_out += values.size - kept.size
            if kept.size:
                total.add(kept)
                runs += kept.size
                least, greatest = min(least, float(kept.min())), max(greatest, float(kept.max()))
        if runs == 0:
            return cls(math.nan, math.nan, math.nan, math.nan, math.nan, 0, left_out)
        mean = total.over(runs)
        spread = _spread(chunks, runs, mean, max(-least, greatest)) if runs > 1 else math.nan
        # Adding 0.0 takes the sign off a zero: which of 0.0 and -0.0 comes out is chance.
        return cls(
            mean, spread / math.sqrt(runs), spread, least + 0.0, greatest + 0.0, runs, left_out
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


def _spread(chunks: Chunks, runs: int, mean: float, largest: float) -> float:
    """Sample standard deviation of two or more values.

    The deviations are from a rounded mean, which their own sum makes good: the corrected two-pass
    algorithm of Chan, Golub and LeVeque, "Algorithms for computing the sample variance", 1983.

    Args:
        chunks: The values.
        runs: How many are finite.
        mean: Their mean.
        largest: The largest magnitude among them.
    """
    # A power of two as the unit, so that no square overflows or vanishes.
    exponent = max(math.frexp(largest)[1] - 1, -1022)
    scale = math.ldexp(1.0, -exponent)
    deviations, squares = ExactSum(), ExactSum()
    for values in _finite(chunks, runs):
        deviation = values * scale - mean * scale
        deviations.add(deviation)
        squares.add(deviation * deviation)
    rest = deviations.value
    variance = (squares.value - rest * rest / runs) / (runs - 1)
    return math.sqrt(variance) * math.ldexp(1.0, exponent)


def quantiles(chunks: Chunks, q: Sequence[float]) -> list[float]:
    """Quantiles of the finite values: `np.quantile` over all of them at once, to the bit.

    That is its method "linear", also in this: between neighbours further apart than the largest
    double it gives infinity or NaN. A zero has no sign here.

    Two passes over the chunks where few values lie near the quantiles, at most four. Beside a chunk
    the memory is up to 16 MB, and 1 MB for each quantile, however many values there are.

    Args:
        chunks: The values.
        q: Between 0 and 1, in any order.

    Returns:
        One for each of `q`; NaN without a finite value.

    Raises:
        ValueError: One of `q` is out of bounds, or passes have different numbers of finite values.
    """
    for each in q:
        if not 0.0 <= each <= 1.0:
            raise ValueError(f"q = {each}: must lie between 0 and 1")
    counts = _first_digits(chunks)
    n = int(counts.sum())
    if n == 0 or len(q) == 0:
        return [math.nan] * len(q)
    places = [(n - 1) * float(each) for each in q]
    floors = [math.floor(place) for place in places]
    ranks = np.array([*floors, *(min(floor + 1, n - 1) for floor in floors)], dtype=np.int64)
    sorted_values = _order_statistics(chunks, counts, ranks).tolist()
    return [
        _between(low, high, place - floor)
        for low, high, place, floor in zip(
            sorted_values[: len(q)], sorted_values[len(q) :], places, floors, strict=True
        )
    ]


def _between(low: float, high: float, weight: float) -> float:
    """Linear interpolation, rounded as NumPy's is: from the nearer end."""
    difference = high - low
    return high - difference * (1.0 - weight) if weight >= 0.5 else low + difference * weight


def _order_statistics(chunks: Chunks, counts: Integers, ranks: Integers) -> Floats:
    """The values at `ranks` (m,) among the sorted finite ones, found by their keys' digits.

    Each pass narrows the brackets, which are the values whose keys begin alike, by a digit. All
    ranks go together.

    Args:
        chunks: The values.
        counts: (1, 2**_DIGIT): how many keys begin with each first digit.
        ranks: From 0.
    """
    n = int(counts.sum())
    # Brackets by how their keys begin, in order; for each rank its bracket and its place in there.
    brackets, own, within = np.zeros(1, np.uint64), np.zeros_like(ranks), ranks
    shift = 64
    while True:
        shift -= _DIGIT
        digits, below = np.empty_like(ranks), np.empty_like(ranks)
        for k, row in enumerate(own):
            ends = counts[row].cumsum()
            digits[k] = np.searchsorted(ends, within[k], side="right")
            below[k] = ends[digits[k]] - counts[row, digits[k]]
        sizes, within = counts[own, digits], within - below
        found = (brackets[own] << np.uint64(_DIGIT)) | digits.astype(np.uint64)
        if shift == 0:
            return _values(found)
        brackets, first, own = np.unique(found, return_index=True, return_inverse=True)
        sizes = sizes[first]
        if sizes.sum() <= _GATHERED:
            break
        counts = _next_digits(chunks, n, brackets, shift)
    kept = [_inside(keys, brackets, shift)[0] for keys in map(_keys, _finite(chunks, n))]
    candidates = np.concatenate(kept)
    candidates.sort()
    starts = sizes.cumsum() - sizes
    return _values(candidates[starts[own] + within])


def _first_digits(chunks: Chunks) -> Integers:
    """How many keys begin with each digit (1, 2**_DIGIT)."""
    counts = np.zeros((1, 2**_DIGIT), dtype=np.int64)
    for keys in map(_keys, _finite(chunks)):
        np.add.at(counts[0], (keys >> np.uint64(64 - _DIGIT)).astype(np.intp), 1)
    return counts


def _next_digits(chunks: Chunks, n: int, brackets: Keys, shift: int) -> Integers:
    """How many keys of each bracket go on with each digit (brackets, 2**_DIGIT)."""
    counts = np.zeros((len(brackets), 2**_DIGIT), dtype=np.int64)
    for values in _finite(chunks, n):
        keys, bracket = _inside(_keys(values), brackets, shift)
        digits = (keys >> np.uint64(shift - _DIGIT)) & np.uint64(2**_DIGIT - 1)
        np.add.at(counts.reshape(-1), (bracket << _DIGIT) | digits.astype(np.intp), 1)
    return counts


def _inside(keys: Keys, brackets: Keys, shift: int) -> tuple[Keys, NDArray[np.intp]]:
    """The keys that lie in one of the brackets, and in which."""
    begins = keys >> np.uint64(shift)
    bracket = np.searchsorted(brackets[:-1], begins)
    kept = brackets[bracket] == begins
    return keys[kept], bracket[kept]


def _keys(values: Floats) -> Keys:
    """Integers in the order of the finite values: equal for equal values, also for 0.0 and -0.0."""
    bits = (values + 0.0).view(np.uint64)
    # Bits grow with the magnitude: those of negative values are turned round, all of them.
    flipped = (bits.view(np.int64) >> np.int64(63)).view(np.uint64) | _SIGN
    return bits ^ flipped


def _values(keys: Keys) -> Floats:
    """The values that have these keys."""
    return np.where(keys & _SIGN, keys ^ _SIGN, ~keys).view(np.float64)


def _finite(chunks: Chunks, expected: int | None = None) -> Iterator[Floats]:
    """The finite values (n,) of each chunk.

    Raises:
        ValueError: At the end, if they are not as many as expected: an iterator that is used up,
            say, would otherwise pass for no values.
    """
    count = 0
    for values in chunks():
        kept = values[np.isfinite(values)]
        count += kept.size
        yield kept
    if expected not in (None, count):
        raise ValueError(
            f"chunks() must give the same values in every pass: {expected} were finite, now {count}"
        )
