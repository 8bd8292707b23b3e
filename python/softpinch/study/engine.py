"""Computing the runs of a study on threads of this process.

An engine computes blocks of runs and passes their rows to `accept`, which stores them and returns
whether they are enough. The module `executor` has the engine that uses the workers of an executor.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeAlias

from ..support import checks
from ..support.interrupt import CtrlC
from ..support.progress import Report
from .rows import Rows, Spans
from .spec import StudySpec

# The largest number of runs that one thread computes at a time.
MOST_LANES = 8


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
        return f"runs {self.first} to {self.last} ({self.runs}): {self.reason}"


# Stores rows, possibly none so that buffered ones are written, and returns whether they are enough.
Accept: TypeAlias = Callable[[Rows], bool]


def how_many_threads(threads: int | None) -> int:
    """The number of threads: the given one, or the number of cores that this process may use."""
    if threads is not None:
        return checks.integer("threads", threads, 1, 4096)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def compute(spec: StudySpec, block: Rows, threads: int, watch: Callable[[int], bool]) -> Rows:
    """Computes a block; `watch` takes the number of completed runs, and returns whether to stop."""
    # More threads than runs would only cost time.
    result = spec.batch(block).run(min(threads, len(block)), watch)
    return Rows.of(result, block.run, spec.summaries)


def on_threads(
    spec: StudySpec,
    blocks: Iterable[Rows],
    total: int,
    threads: int,
    report: Report,
    accept: Accept,
) -> bool:
    """Computes blocks with `total` runs on threads, and returns whether Ctrl-C ended it."""
    done = 0

    def watch(computed: int) -> bool:
        report(done + computed, total)
        return ctrl_c.pending

    with CtrlC() as ctrl_c:
        try:
            report(0, total)
            for block in blocks:
                # Hold Ctrl-C back until the rows are accepted, so that no computed row is lost.
                ctrl_c.held = True
                rows = compute(spec, block, threads, watch)
                enough = accept(rows.with_values(block))
                ctrl_c.held = False
                done += len(rows)
                report(done, total)
                if ctrl_c.pending or rows.interrupted:
                    return True
                if enough:
                    break
        except KeyboardInterrupt:
            return True
    return False
