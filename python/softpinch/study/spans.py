"""Sets of run numbers, stored as half-open intervals, because studies have up to 2^62 runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Self

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.uint64]
Edges = NDArray[np.int64]


class Spans:
    """A set of run numbers.

    Attributes:
        edges: The intervals (k, 2): their first number and one past their last number. They are
            sorted, and do not overlap or touch.
    """

    def __init__(self, edges: Edges) -> None:
        """Takes intervals that are sorted and neither overlap nor touch."""
        self.edges = edges

    @classmethod
    def upto(cls, runs: int) -> Self:
        """The set of the runs 0 to `runs` - 1."""
        return cls(np.array([[0, runs]], np.int64)[: min(runs, 1)])

    @classmethod
    def of(cls, numbers: Numbers) -> Self:
        """The set of the runs `numbers` (k,), which must increase."""
        given = numbers.astype(np.int64)
        where = np.flatnonzero(np.diff(given) != 1)
        first = given[np.concatenate([[0], where + 1])] if len(given) else given
        last = given[np.concatenate([where, [-1]])] if len(given) else given
        return cls(np.stack([first, last + 1], axis=1))

    @classmethod
    def joined(cls, parts: Iterable[Edges]) -> Self:
        """The union of disjoint intervals, which may be in any order.

        Raises:
            ValueError: Two intervals overlap; the message names a run that is in both.
        """
        found = [np.empty((0, 2), np.int64), *parts]
        edges = np.concatenate(found)
        edges = edges[np.argsort(edges[:, 0], kind="stable")]
        twice = np.flatnonzero(edges[1:, 0] < edges[:-1, 1])
        if twice.size:
            raise ValueError(f"run {edges[twice[0] + 1, 0]} occurs twice")
        # Merge intervals that touch.
        apart = np.flatnonzero(edges[1:, 0] != edges[:-1, 1]) + 1
        begins = np.concatenate([[0], apart])[: len(edges)]
        ends = np.concatenate([apart - 1, [len(edges) - 1]])[: len(begins)]
        return cls(np.stack([edges[begins, 0], edges[ends, 1]], axis=1))

    @property
    def count(self) -> int:
        """The number of runs in the set."""
        return int((self.edges[:, 1] - self.edges[:, 0]).sum())

    def without(self, other: Self) -> Self:
        """The difference of two sets: the runs of this set that are not in `other`."""
        cuts = np.unique(np.concatenate([self.edges.ravel(), other.edges.ravel()]))
        # Between two cuts, either all runs or no runs are in each set, so the first one decides.
        kept = self._contains(cuts[:-1]) & ~other._contains(cuts[:-1])
        return self.joined([np.stack([cuts[:-1], cuts[1:]], axis=1)[kept]])

    def within(self, first: int, last: int) -> Self:
        """The runs of the set from `first` to `last` - 1."""
        low = int(np.searchsorted(self.edges[:, 1], first, side="right"))
        high = int(np.searchsorted(self.edges[:, 0], last, side="left"))
        edges = np.clip(self.edges[low:high], first, last)
        return type(self)(edges[edges[:, 0] < edges[:, 1]])

    def contains(self, runs: Numbers) -> NDArray[np.bool_]:
        """Whether each of the given runs is in the set, (k,)."""
        return self._contains(runs.astype(np.int64))

    def _contains(self, given: NDArray[np.int64]) -> NDArray[np.bool_]:
        if not len(self.edges):
            return np.zeros(len(given), bool)
        span = np.searchsorted(self.edges[:, 0], given, side="right") - 1
        among: NDArray[np.bool_] = (span >= 0) & (given < self.edges[span, 1])
        return among

    def numbers(self) -> Numbers:
        """The numbers of all runs, increasing, (count,)."""
        parts = [np.arange(first, last, dtype=np.uint64) for first, last in self.edges]
        return np.concatenate([np.empty(0, np.uint64), *parts])

    def aligned_chunks(self, size: Callable[[], int]) -> Iterator[Numbers]:
        """Yields the numbers of all runs, increasing, in arrays that end at multiples of a size.

        Args:
            size: Returns the size; it is called before each array, and may change its answer.
        """
        at, k = 0, 0
        while k < len(self.edges):
            at = max(at, int(self.edges[k, 0]))
            length = size()
            stop = (at // length + 1) * length
            yield self.within(at, stop).numbers()
            at = stop
            k = int(np.searchsorted(self.edges[:, 1], at, side="right"))

    def __repr__(self) -> str:
        """The first few intervals."""
        shown = ", ".join(f"{first} to {last - 1}" for first, last in self.edges[:5])
        more = ", ..." if len(self.edges) > 5 else ""
        return f"<Spans of {self.count} runs: {shown}{more}>"
