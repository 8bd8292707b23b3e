"""Computing the runs of a study on threads of this process.

An engine computes blocks of runs and passes their rows to `accept`, which stores them and returns
whether they are enough. The module `executor` has the engine that uses the workers of an executor.
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

# The largest number of runs that one thread computes at a time.
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


# Function that stores rows and returns whether they are enough. The engine for executors also calls
# it without rows from time to time, so that buffered rows are written even if a block takes long.
Accept: TypeAlias = Callable[[Rows], bool]


def how_many_threads(threads: int | None) -> int:
    """The number of threads: the given one, or the number of cores that this process may use."""
    if threads is not None:
        return checks.integer("threads", threads, 1, 4096)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def compute(setup: Setup, block: RunBlock, threads: int, watch: Callable[[int], bool]) -> Rows:
    """Computes the rows of a block, without the varied values.

    Args:
        setup: The setup that all runs share.
        block: The runs.
        threads: The largest number of threads.
        watch: Receives the number of completed runs, and returns whether to stop.
    """
    batch = block.batch or setup.batch(block.numbers, block.values, block.refine)
    # More threads than runs would only cost time.
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
    """Computes runs block by block on threads.

    Ctrl-C stops the computation within a fraction of a second; all completed rows are accepted.

    Args:
        setup: The setup that all runs share.
        blocks: The blocks of runs.
        total: The number of runs of all blocks.
        threads: The number of threads.
        report: Receives the number of completed runs.
        accept: Stores rows, and returns whether they are enough.
    """
    done, under_way = 0, f"at most {MOST_LANES} a thread"
    with CtrlC() as ctrl_c:
        try:
            report(0, total)
            for block in blocks:
                # Hold Ctrl-C back until the rows are accepted, so that no computed row is lost.
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
    """Reports progress, and returns whether to stop."""
    report(before + done, total)
    return ctrl_c.pending
