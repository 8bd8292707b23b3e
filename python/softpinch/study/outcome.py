"""How the computation of runs ended."""

from __future__ import annotations

from typing import NamedTuple

from .spans import Spans


class Lost(NamedTuple):
    """Runs that the workers failed to compute.

    Attributes:
        first: Number of the first lost run.
        last: Number of the last lost run.
        runs: Number of lost runs from `first` to `last`.
        reason: The error of the last attempt, or the reason why the executor stopped.
    """

    first: int
    last: int
    runs: int
    reason: str

    @classmethod
    def of(cls, spans: Spans, reason: str) -> Lost:
        """The loss of these runs."""
        return cls(int(spans.edges[0, 0]), int(spans.edges[-1, 1]) - 1, spans.count, reason)

    def __str__(self) -> str:
        """The runs and the reason, in words."""
        return f"runs {self.first} to {self.last} ({self.runs}): {self.reason}"


class Outcome(NamedTuple):
    """How the computation ended.

    Attributes:
        interrupted: Whether Ctrl-C ended it.
        lost: Runs that the workers failed to compute.
        under_way: How many runs Ctrl-C leaves out, in words.
    """

    interrupted: bool = False
    lost: tuple[Lost, ...] = ()
    under_way: str = ""
