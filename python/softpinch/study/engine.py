"""Computing the runs of a study, on threads of this process or on the workers of an executor.

An engine computes blocks of runs and passes their rows to `accept`, which stores them and returns
whether they are enough. An executor may be any `concurrent.futures.Executor`: the scheduler submits
blocks of runs, with an upper limit on the number of unfinished blocks. A block is attempted three
times before it is reported as lost. If the executor breaks, the call ends with the rows received so
far; when its owner has repaired it, another call computes the missing runs.
"""

from __future__ import annotations

import os
import pickle
import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import InitVar, dataclass
from functools import lru_cache
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from .. import _core
from ..support import Report, VersionMismatchError, checks
from ..support.interrupt import CtrlC
from .rows import Rows, Spans
from .spec import StudySpec

# An executor, or a function that makes one.
Engine: TypeAlias = Executor | Callable[[], Executor]

# The largest number of blocks that are submitted, or have rows waiting for those of earlier blocks:
# two for each of 256 workers, about as many as one process can supply. Executors do not report how
# many they have. At 100 kB of rows for each block, this process holds at most about 50 MB.
MOST_UNDER_WAY = 512
_ATTEMPTS = 3
# The call ends after this many consecutive lost blocks. If, for example, no worker can import
# softpinch, every block fails, and a study of a million blocks would report a million losses.
_MOST_LOST_IN_A_ROW = 8
# The interval between two checks for Ctrl-C, s.
_POLL_SECONDS = 0.1
# After Ctrl-C, which workers may receive too, the time to wait for their completed runs, s.
_GRACE_SECONDS = 1.0

_HOW_TO_GO_ON = (
    "to compute the rest, call Study.resume or repeat the call if the study has a store, else "
    "repeat the call with only=; a Dask cluster replaces workers that die"
)

# On a worker: the last call of `monte_carlo` during which Ctrl-C reached it.
_interrupted_call = ""
# Cached, so that later blocks of a study reuse its cached properties.
_unpickled = lru_cache(maxsize=8)(pickle.loads)

# The largest number of runs that one thread computes at a time.
MOST_LANES = 8


class Lost(NamedTuple):
    """Runs that the workers failed to compute.

    Attributes:
        first: Number of the first lost run, as `last` is that of the last one.
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


# A block and its batch.
Checked: TypeAlias = tuple[Rows, _core.Batch]


def compute(
    spec: StudySpec,
    block: Rows,
    threads: int,
    watch: Callable[[int], bool],
    checked: Checked | None = None,
) -> Rows:
    """Computes a block; `watch` takes the number of completed runs, and returns whether to stop."""
    batch = checked[1] if checked and checked[0] is block else spec.batch(block)
    # More threads than runs would only cost time.
    result = batch.run(min(threads, len(block)), watch)
    return Rows.of(result, block.run, spec.summaries)


def on_threads(
    spec: StudySpec,
    blocks: Iterable[Rows],
    runs: int,
    threads: int,
    report: Report,
    accept: Accept,
    checked: Checked | None = None,
) -> bool:
    """Computes blocks with so many `runs` on threads, and returns whether Ctrl-C ended it."""
    done = 0

    def watch(computed: int) -> bool:
        report(done + computed, runs)
        return ctrl_c.pending

    with CtrlC() as ctrl_c:
        try:
            report(0, runs)
            for block in blocks:
                # Hold Ctrl-C back until the rows are accepted, so that no computed row is lost.
                ctrl_c.held = True
                rows = compute(spec, block, threads, watch, checked)
                enough = accept(rows.with_values(block))
                ctrl_c.held = False
                done += len(rows)
                report(done, runs)
                if ctrl_c.pending or rows.interrupted:
                    return True
                if enough:
                    break
        except KeyboardInterrupt:
            return True
    return False


def work(call: str, attempt: int, version: int, spec: bytes, block: Rows, threads: int) -> Rows:
    """Computes a block of runs on a worker, with at most one thread for each available core.

    `call` names the call of `monte_carlo` to which the block belongs. The rows lack the varied
    values. After Ctrl-C they lack the unfinished runs, and further blocks of this call have none.
    """
    global _interrupted_call
    if version != _core.RESULTS_VERSION:
        own = f"softpinch {_core.__version__} with results version {_core.RESULTS_VERSION}"
        wanted = f"the study is made with results version {version}"
        raise VersionMismatchError(f"a worker has {own}; {wanted}")
    study: StudySpec = _unpickled(spec)
    # A second attempt means that only this worker was interrupted, and not the whole study.
    if call == _interrupted_call and attempt == 1:
        return study.empty()
    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        threads = min(threads, how_many_threads(None))
        rows = compute(study, block, threads, lambda done: ctrl_c.pending)
    if ctrl_c.pending:
        _interrupted_call = call
    return rows


def check_executor(executor: object) -> None:
    """Refuses an argument that is neither an executor nor a function."""
    if hasattr(executor, "get_executor"):
        rule = "is a Dask client; pass its get_executor()"
        raise TypeError(f"executor = {checks.shown(executor)}: {rule}")
    if not hasattr(executor, "submit") and not callable(executor):
        rule = "must be a concurrent.futures.Executor or a function that makes one"
        raise TypeError(f"executor = {checks.shown(executor)}: {rule}")


@dataclass(eq=False)
class _Task:
    """A block, its index in the order of all blocks, and the number of the current attempt."""

    place: int
    block: Rows
    attempt: int = 1


@dataclass(eq=False)
class BlockScheduler:
    """Submits the blocks of one call to an executor, and hands their rows to `accept`."""

    submit: Callable[[_Task], Future[Rows]]
    blocks: InitVar[Iterable[Rows]]
    accept: Accept
    in_order: bool
    ctrl_c: CtrlC

    def __post_init__(self, blocks: Iterable[Rows]) -> None:
        self._tasks = (_Task(place, block) for place, block in enumerate(blocks))
        self._exhausted = False
        self._retries: deque[_Task] = deque()
        self.under_way: dict[Future[Rows], _Task] = {}
        self._finished: SimpleQueue[Future[Rows]] = SimpleQueue()
        # Blocks whose rows wait for those of earlier blocks, by their place; None of a lost block.
        self._waiting: dict[int, tuple[Rows, Rows | None]] = {}
        self._next_place = 0
        # The runs from the first to the last of each block that is accepted or lost.
        self._settled = Spans.upto(0)
        self._lost: list[Lost] = []
        self._lost_in_a_row = 0
        # The reason for which no more blocks are submitted although some remain; empty if none.
        self._stopped = ""
        self._executor_broken = False
        self.done = 0
        self._enough = False

    @property
    def over(self) -> bool:
        """Whether the scheduler need not submit or wait for any more blocks."""
        exhausted = self._exhausted and not self.under_way and not self._retries
        return exhausted or self._enough or bool(self._stopped) or self.ctrl_c.pending

    def end(self) -> None:
        """Cancels blocks that have not started; processes the finished ones, after Ctrl-C more."""
        self.cancel()
        end = time.monotonic() + (_GRACE_SECONDS if self.ctrl_c.pending else 0.0)
        while not self._finished.empty() or (self.under_way and time.monotonic() < end):
            self.collect(_POLL_SECONDS)

    def cancel(self) -> None:
        """Cancels blocks that have not started; a broken pool would leak processes (gh-107219)."""
        if not self._executor_broken:
            for future in list(self.under_way):
                future.cancel()

    def lost(self, asked: Spans) -> tuple[Lost, ...]:
        """The requested runs `asked` that could not be computed, sorted by their numbers."""
        rest = asked.without(self._settled)
        stopped = [Lost.of(rest, self._stopped)] if self._stopped and rest.count else []
        return tuple(sorted([*self._lost, *stopped]))

    def submit_next(self) -> bool:
        """Submits a block; returns False if there is none, or too many are unfinished."""
        if not self._retries and len(self.under_way) + len(self._waiting) >= MOST_UNDER_WAY:
            return False
        task = self._retries.popleft() if self._retries else next(self._tasks, None)
        if task is None:
            self._exhausted = True
            return False
        try:
            future = self.submit(task)
        except Exception as error:
            self._stop("the executor takes no more blocks", error)
            return False
        self.under_way[future] = task
        future.add_done_callback(self._finished.put)
        return True

    def collect(self, seconds: float) -> bool:
        """Processes a finished block; returns whether one finished within `seconds`."""
        try:
            future = self._finished.get(timeout=seconds)
        except Empty:
            return False
        over, task = self.over, self.under_way.pop(future)
        # Not raised here, because a worker's KeyboardInterrupt must not interrupt this process.
        error = CancelledError() if future.cancelled() else future.exception()
        rows = future.result() if error is None else None
        if rows is not None and len(rows) < len(task.block):
            error = RuntimeError("the worker was interrupted")
        if error is None or (rows is not None and self.ctrl_c.pending and not self.in_order):
            self._lost_in_a_row = 0
            self._settle(task, rows)
        elif not over:
            self._failed(task, error)
        return True

    def _failed(self, task: _Task, error: BaseException) -> None:
        """Schedules a failed block for another attempt, or reports it as lost."""
        if isinstance(error, VersionMismatchError):
            raise error
        if isinstance(error, BrokenExecutor):
            self._stop("", error)
        elif task.attempt < _ATTEMPTS:
            task.attempt += 1
            self._retries.append(task)
        else:
            reason = f"failed {_ATTEMPTS} times: {_error_text(error)}"
            self._lost.append(Lost.of(Spans.of(task.block.run), reason))
            self._settle(task, None)
            self._lost_in_a_row += 1
            if self._lost_in_a_row == _MOST_LOST_IN_A_ROW:
                self._stop(f"{_MOST_LOST_IN_A_ROW} blocks in a row were lost", error)

    def _stop(self, why: str, error: BaseException) -> None:
        self._executor_broken = isinstance(error, BrokenExecutor)
        why = "the executor is broken" if self._executor_broken else why
        self._stopped = f"{why}: {_error_text(error)}; {_HOW_TO_GO_ON}"

    def _settle(self, task: _Task, rows: Rows | None) -> None:
        """Accepts the rows of a block, or None of a lost one; with `in_order` in their order."""
        if not self.in_order:
            self._next_place = task.place  # without an order, accept these rows now
        self._waiting[task.place] = task.block, rows
        while self._next_place in self._waiting and not self._enough:
            block, rows = self._waiting.pop(self._next_place)
            self._next_place += 1
            span = np.array([[block.run[0], block.run[-1] + 1]], np.int64)
            self._settled = Spans.joined([self._settled.edges, span])
            if rows is not None:
                self.done += len(rows)
                self._enough = self.accept(rows.with_values(block))


def _error_text(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def on_executor(
    spec: StudySpec,
    blocks: Iterable[Rows],
    asked: Spans,
    given: Engine,
    threads: int,
    report: Report,
    accept: Accept,
) -> tuple[bool, tuple[Lost, ...]]:
    """Computes `blocks`, which have the runs `asked`, on the workers of an executor.

    Returns whether Ctrl-C ended the computation, and the runs that the workers failed to compute.
    With `stop_when`, rows are accepted in the order of the blocks, and Ctrl-C discards the
    completed runs of an unfinished block.
    """
    # An executor class has `submit` too, but it must be called to make an executor.
    made = isinstance(given, type) or not hasattr(given, "submit")
    executor: Any = given() if made else given  # type: ignore[operator]
    if not hasattr(executor, "submit"):
        rule = "must give a concurrent.futures.Executor"
        raise TypeError(f"executor: the function gave {checks.shown(executor)}; {rule}")
    # Dask gives calls with equal arguments a common result, even that of a failed attempt or of a
    # cancelled study. A unique name for the call and the attempt's number make arguments distinct.
    call, version = os.urandom(16).hex(), _core.RESULTS_VERSION
    pickled = pickle.dumps(spec.described())

    def submit(task: _Task) -> Any:
        return executor.submit(work, call, task.attempt, version, pickled, task.block, threads)

    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        scheduler = BlockScheduler(submit, blocks, accept, bool(spec.stop_when), ctrl_c)
        try:
            try:
                report(0, asked.count)
                while not scheduler.over:
                    wait = 0.0 if scheduler.submit_next() else _POLL_SECONDS
                    if not scheduler.collect(wait):
                        accept(spec.empty())
                    report(scheduler.done, asked.count)
            except KeyboardInterrupt:  # the user's progress function may raise it
                ctrl_c.pending = True
            scheduler.end()
        finally:
            scheduler.cancel()
            if made:
                executor.shutdown(wait=not scheduler.under_way)
    return ctrl_c.pending, scheduler.lost(asked)
