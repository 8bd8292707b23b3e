"""Computing the runs of a study on threads of this process.

An engine takes blocks of runs and gives their rows to `accept`, which keeps them and says whether
they are enough. The module `executor` has the engine for workers elsewhere.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple, TypeAlias

from .. import _core
from ..support import checks
from ..support.arrays import Floats
from ..support.interrupt import CtrlC
from ..support.progress import Report
from .outcome import Outcome
from .rows import Rows
from .setup import Setup
from .spans import Numbers

# Runs that one thread has under way at a time, at most.
MOST_LANES = 8


class RunBlock(NamedTuple):
    """Runs to compute.

    Attributes:
        numbers: Numbers of the runs (k,), increasing.
        values: Path -> (k, ...), the varied values of each run.
        refine: Factor by which steps or tolerance are smaller than the study's.
        batch: The core's batch of these runs, if it has been made; it is not sent to workers.
    """

    numbers: Numbers
    values: dict[str, Floats]
    refine: int = 1
    batch: _core.Batch | None = None


# Keeps rows, and says whether they are enough. The engine for executors calls it without rows now
# and then, so that rows which have gathered are written while a block takes minutes.
Accept: TypeAlias = Callable[[Rows], bool]


def how_many_threads(threads: int | None) -> int:
    """How many threads; a worker of a cluster has fewer cores than its machine."""
    if threads is not None:
        return checks.integer("threads", threads, 1, 4096)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def compute(setup: Setup, block: RunBlock, threads: int, watch: Callable[[int], bool]) -> Rows:
    """The rows of a block, without the values that were varied.

    `watch` hears how many are done, and says whether to stop.
    """
    batch = block.batch or setup.batch(block.numbers, block.values, block.refine)
    # Threads cost something, so there are no more than runs.
    result = batch.run(min(threads, len(block.numbers)), watch)
    return Rows.of(result, block.numbers, setup.summaries)


def on_threads(
    setup: Setup,
    blocks: Iterable[RunBlock],
    total: int,
    threads: int,
    report: Report,
    accept: Accept,
) -> Outcome:
    """Computes runs block by block.

    Ctrl-C stops within a fraction of a second. All rows that are done then are accepted.
    """
    done, under_way = 0, f"at most {MOST_LANES} a thread"
    with CtrlC() as ctrl_c:
        try:
            report(0, total)
            for block in blocks:
                # From the first run until its row is accepted nothing may be lost.
                ctrl_c.held = True
                watch = partial(_watch, ctrl_c, report, done, total)
                rows = compute(setup, block, threads, watch)
                enough = accept(rows.with_values(block.numbers, block.values))
                ctrl_c.held = False
                done += len(rows)
                report(done, total)
                if ctrl_c.pending or rows.interrupted:
                    return Outcome(True, under_way=under_way)
                if enough:
                    break
        except KeyboardInterrupt:
            return Outcome(True, under_way=under_way)
    return Outcome(under_way=under_way)


def _watch(ctrl_c: CtrlC, report: Report, before: int, total: int, done: int) -> bool:
    """Says how far the runs are; whether to stop."""
    report(before + done, total)
    return ctrl_c.pending
