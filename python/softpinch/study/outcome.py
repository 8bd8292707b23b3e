"""How the computing of runs ended."""

from __future__ import annotations

from typing import NamedTuple

from .spans import Spans


class Lost(NamedTuple):
    """Runs that no worker brought back.

    Attributes:
        first: The first of them.
        last: The last of them.
        runs: How many of those between are lost.
        reason: What the last attempt met, or why the executor computes no more.
    """

    first: int
    last: int
    runs: int
    reason: str

    @classmethod
    def of(cls, spans: Spans, reason: str) -> Lost:
        """Of some runs."""
        return cls(int(spans.edges[0, 0]), int(spans.edges[-1, 1]) - 1, spans.count, reason)

    def __str__(self) -> str:
        """Which, and why."""
        return f"runs {self.first} to {self.last} ({self.runs}): {self.reason}"


class Outcome(NamedTuple):
    """How the computing ended.

    Attributes:
        interrupted: By Ctrl-C.
        lost: What no worker brought back.
        under_way: What Ctrl-C leaves out, in words.
    """

    interrupted: bool = False
    lost: tuple[Lost, ...] = ()
    under_way: str = ""
