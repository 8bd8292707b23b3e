"""Sets of runs as half-open intervals: few numbers for many runs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Self

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.uint64]
Edges = NDArray[np.int64]


class Spans:
    """A set of runs.

    Attributes:
        edges: (k, 2), first and one past the last of each interval; apart, in order.
    """

    def __init__(self, edges: Edges) -> None:
        """Takes intervals that are apart and in order."""
        self.edges = edges

    @classmethod
    def upto(cls, runs: int) -> Self:
        """The first so many runs."""
        return cls(np.array([[0, runs]], np.int64)[: min(runs, 1)])

    @classmethod
    def of(cls, numbers: Numbers) -> Self:
        """Of increasing numbers (k,)."""
        given = numbers.astype(np.int64)
        where = np.flatnonzero(np.diff(given) != 1)
        first = given[np.concatenate([[0], where + 1])] if len(given) else given
        last = given[np.concatenate([where, [-1]])] if len(given) else given
        return cls(np.stack([first, last + 1], axis=1))

    @classmethod
    def joined(cls, parts: Iterable[Edges]) -> Self:
        """Of intervals in any order.

        Raises:
            ValueError: Two overlap; the message has a run that stands twice.
        """
        found = [np.empty((0, 2), np.int64), *parts]
        edges = np.concatenate(found)
        edges = edges[np.argsort(edges[:, 0], kind="stable")]
        twice = np.flatnonzero(edges[1:, 0] < edges[:-1, 1])
        if twice.size:
            raise ValueError(f"run {edges[twice[0] + 1, 0]} stands twice")
        # Neighbours that touch are one.
        apart = np.flatnonzero(edges[1:, 0] != edges[:-1, 1]) + 1
        begins = np.concatenate([[0], apart])[: len(edges)]
        ends = np.concatenate([apart - 1, [len(edges) - 1]])[: len(begins)]
        return cls(np.stack([edges[begins, 0], edges[ends, 1]], axis=1))

    @property
    def count(self) -> int:
        """How many runs."""
        return int((self.edges[:, 1] - self.edges[:, 0]).sum())

    def without(self, other: Self) -> Self:
        """Those of its runs that the other does not have."""
        cuts = np.unique(np.concatenate([self.edges.ravel(), other.edges.ravel()]))
        # From one cut to the next all runs are alike.
        kept = self._contains(cuts[:-1]) & ~other._contains(cuts[:-1])
        return self.joined([np.stack([cuts[:-1], cuts[1:]], axis=1)[kept]])

    def within(self, first: int, last: int) -> Self:
        """Those of its runs from `first` to before `last`."""
        low = int(np.searchsorted(self.edges[:, 1], first, side="right"))
        high = int(np.searchsorted(self.edges[:, 0], last, side="left"))
        edges = np.clip(self.edges[low:high], first, last)
        return type(self)(edges[edges[:, 0] < edges[:, 1]])

    def contains(self, runs: Numbers) -> NDArray[np.bool_]:
        """Which of some runs are among them, (k,)."""
        return self._contains(runs.astype(np.int64))

    def _contains(self, given: NDArray[np.int64]) -> NDArray[np.bool_]:
        if not len(self.edges):
            return np.zeros(len(given), bool)
        span = np.searchsorted(self.edges[:, 0], given, side="right") - 1
        among: NDArray[np.bool_] = (span >= 0) & (given < self.edges[span, 1])
        return among

    def numbers(self) -> Numbers:
        """All of them, (count,), increasing."""
        parts = [np.arange(first, last, dtype=np.uint64) for first, last in self.edges]
        return np.concatenate([np.empty(0, np.uint64), *parts])

    def aligned_chunks(self, size: Callable[[], int]) -> Iterator[Numbers]:
        """Its runs in their order, cut at multiples of `size`, which is asked each time."""
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
