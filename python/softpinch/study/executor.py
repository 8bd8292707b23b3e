"""Computing the runs of a study on the workers of an executor.

Any `concurrent.futures.Executor` will do. Blocks of runs are submitted, a bounded number at a time.
A block that fails is submitted again, three times in all, and is then reported as lost. An executor
that breaks ends the call with the rows that have arrived: its owner repairs it, and the study goes
on from there.
"""

from __future__ import annotations

import pickle
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias

import numpy as np

from .. import _core
from ..support import checks
from ..support.errors import VersionMismatchError
from ..support.interrupt import CtrlC, by_handler
from ..support.progress import Report
from .engine import Accept, RunBlock
from .outcome import Lost, Outcome
from .rows import Rows
from .setup import Setup
from .spans import Spans
from .worker import work

# An executor, or a function that makes one.
Engine: TypeAlias = Executor | Callable[[], Executor]

# Two blocks for each of 256 workers, about as many as one driver can feed. An executor does not
# say how many workers it has, and Dask's come and go. With the rows of a block (some 100 kB) that
# is at most some 50 MB in the driver, also where rows wait for those of earlier blocks.
MOST_UNDER_WAY = 512
_ATTEMPTS = 3
# Lost blocks in a row after which the call ends. Where no worker can import softpinch, say, every
# block fails three times, and a study of a million blocks would report a million losses.
_MOST_LOST_IN_A_ROW = 8
# Time between two looks at whether Ctrl-C has come, s.
_POLL_SECONDS = 0.1
# Time that rows are waited for after Ctrl-C, s. Workers on this machine may have heard it, too.
_GRACE_SECONDS = 1.0

_HOW_TO_GO_ON = (
    "to compute the rest, call Study.resume or repeat the call if the study has a store, else "
    "repeat the call with only=; a Dask cluster replaces workers that die"
)


def check(executor: object) -> None:
    """Refuses what is neither an executor nor a function.

    Raises:
        TypeError: It is neither.
    """
    if hasattr(executor, "get_executor"):
        raise TypeError(
            f"executor = {checks.shown(executor)}: is a Dask client; pass its get_executor()"
        )
    if not hasattr(executor, "submit") and not callable(executor):
        raise TypeError(
            f"executor = {checks.shown(executor)}: must be a concurrent.futures.Executor or a "
            "function that makes one"
        )


@dataclass(eq=False)
class _Task:
    """A block, its place in the order of all blocks, and the number of the current attempt."""

    place: int
    block: RunBlock
    attempt: int = 1


class BlockScheduler:
    """Submits the blocks of one call to an executor, and passes their rows on."""

    def __init__(
        self,
        submit: Callable[[_Task], Future[Rows]],
        blocks: Iterable[RunBlock],
        accept: Accept,
        in_order: bool,
        ctrl_c: CtrlC,
    ) -> None:
        """Submits nothing yet; `on_executor` says what `accept` and `in_order` are."""
        self._submit = submit
        self._accept = accept
        self._in_order = in_order
        self._ctrl_c = ctrl_c
        self._tasks = (_Task(place, block) for place, block in enumerate(blocks))
        self._exhausted = False
        # One past the last run that was drawn.
        self._drawn = 0
        # Blocks that were drawn and are neither accepted nor lost, by their place.
        self._open: dict[int, _Task] = {}
        self._retries: deque[_Task] = deque()
        self._under_way: dict[Future[Rows], _Task] = {}
        self._finished: SimpleQueue[Future[Rows]] = SimpleQueue()
        # In order: rows which arrived before those of an earlier place; None for a lost block.
        self._waiting: dict[int, Rows | None] = {}
        self._next_place = 0
        self._lost: list[Lost] = []
        self._lost_in_a_row = 0
        # Why no more blocks are submitted although some are left.
        self._stopped = ""
        self._executor_broken = False
        self.done = 0
        self._enough = False

    @property
    def over(self) -> bool:
        """Whether nothing more has to be submitted or waited for."""
        exhausted = self._exhausted and not self._open
        return exhausted or self._enough or bool(self._stopped) or self._ctrl_c.pending

    @property
    def idle(self) -> bool:
        """Whether no block is under way."""
        return not self._under_way

    def advance(self) -> bool:
        """Submits a block if there is room for one, and takes one that has finished.

        By turns, so that rows are accepted while the first blocks are still being submitted. Where
        there is no room it waits for a moment; it returns whether a block had finished.
        """
        return self._collect(0.0 if self._submit_next() else _POLL_SECONDS)

    def end(self) -> None:
        """Cancels what has not begun, and takes what has arrived.

        After Ctrl-C it waits a moment for the blocks that have begun.
        """
        self.cancel()
        end = time.monotonic() + (_GRACE_SECONDS if self._ctrl_c.pending else 0.0)
        while not self._finished.empty() or (self._under_way and time.monotonic() < end):
            self._collect(_POLL_SECONDS)

    def cancel(self) -> None:
        """Cancels the blocks that have not begun.

        An executor that is broken ends them itself. The ProcessPoolExecutor of Python 3.11 stops
        doing so at a cancelled future, and leaves its processes behind (python/cpython, gh-107219).
        """
        if not self._executor_broken:
            for future in list(self._under_way):
                future.cancel()

    def lost(self, asked: Spans) -> tuple[Lost, ...]:
        """The runs that will not arrive, out of those that were asked for, in their order."""
        found = list(self._lost)
        if self._stopped:
            drawn = [Spans.of(task.block.numbers).edges for task in self._open.values()]
            rest = asked.within(self._drawn, np.iinfo(np.int64).max)
            spans = Spans.joined([*drawn, rest.edges])
            if spans.count:
                found.append(Lost.of(spans, self._stopped))
        return tuple(sorted(found))

    def _submit_next(self) -> bool:
        """Whether there was a block to submit, and room for it."""
        if self._retries:
            task = self._retries.popleft()
        elif len(self._open) >= MOST_UNDER_WAY:
            return False
        else:
            fresh = next(self._tasks, None)
            if fresh is None:
                self._exhausted = True
                return False
            task = self._open[fresh.place] = fresh
            self._drawn = int(task.block.numbers[-1]) + 1
        try:
            future = self._submit(task)
        except Exception as error:
            if by_handler(error):
                raise
            self._executor_failed(error)
            return False
        self._under_way[future] = task
        future.add_done_callback(self._finished.put)
        return True

    def _collect(self, seconds: float) -> bool:
        """Takes a block that has finished; whether there was one within so many seconds."""
        try:
            future = self._finished.get(timeout=seconds)
        except Empty:
            return False
        task = self._under_way.pop(future)
        # Asked for, not raised: the KeyboardInterrupt of a worker is not one of this process.
        error = CancelledError() if future.cancelled() else future.exception()
        rows = future.result() if error is None else None
        if rows is not None and len(rows) < len(task.block.numbers):
            error = RuntimeError("the worker was interrupted")
        if error is None or (rows is not None and self._ctrl_c.pending and not self._in_order):
            self._lost_in_a_row = 0
            self._settle(task, rows)
        elif by_handler(error):  # it met a block that an executor computes on this thread
            raise error
        elif not self.over:
            self._failed(task, error)
        return True

    def _failed(self, task: _Task, error: BaseException) -> None:
        """Puts a block back in line, or gives it up."""
        if isinstance(error, VersionMismatchError):
            raise error
        if isinstance(error, BrokenExecutor):
            self._executor_failed(error)
        elif task.attempt < _ATTEMPTS:
            task.attempt += 1
            self._retries.append(task)
        else:
            reason = f"failed {_ATTEMPTS} times: {_error_text(error)}"
            self._lost.append(Lost.of(Spans.of(task.block.numbers), reason))
            self._settle(task, None)
            self._lost_in_a_row += 1
            if self._lost_in_a_row == _MOST_LOST_IN_A_ROW:
                self._stop(f"{_MOST_LOST_IN_A_ROW} blocks in a row were lost", error)

    def _executor_failed(self, error: BaseException) -> None:
        self._executor_broken = isinstance(error, BrokenExecutor)
        why = "is broken" if self._executor_broken else "takes no more blocks"
        self._stop(f"the executor {why}", error)

    def _stop(self, why: str, error: BaseException) -> None:
        self._stopped = f"{why}: {_error_text(error)}; {_HOW_TO_GO_ON}"

    def _settle(self, task: _Task, rows: Rows | None) -> None:
        """Accepts the rows of a block, or none where it is lost, as soon as their turn has come."""
        if not self._in_order:
            self._next_place = task.place  # its turn is now
        self._waiting[task.place] = rows
        while self._next_place in self._waiting and not self._enough:
            block, rows = (
                self._open.pop(self._next_place).block,
                self._waiting.pop(self._next_place),
            )
            self._next_place += 1
            if rows is not None:
                self.done += len(rows)
                self._enough = self._accept(rows.with_values(block.numbers, block.values))


def _error_text(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def on_executor(
    setup: Setup,
    blocks: Iterable[RunBlock],
    asked: Spans,
    given: Engine,
    threads: int,
    report: Report,
    accept: Accept,
    in_order: bool,
) -> Outcome:
    """Computes runs on the workers of an executor.

    Args:
        setup: What the runs have in common.
        blocks: The runs, with increasing numbers.
        asked: All their runs.
        given: The executor, or a function that makes one, which is shut down at the end.
        threads: For each block.
        report: Is told how many runs are done.
        accept: Keeps rows.
        in_order: Whether rows are accepted in the order of `blocks`, and not as they arrive. Then
            Ctrl-C leaves out a block that is not complete, as those after it would not count.

    Raises:
        TypeError: The function makes something else than an executor.
        VersionMismatchError: A worker has a softpinch whose results have other bits.
    """
    # A class of executors has `submit`, too, and makes one when it is called.
    made = isinstance(given, type) or not hasattr(given, "submit")
    executor: Any = given() if made else given  # type: ignore[operator]
    if not hasattr(executor, "submit"):
        raise TypeError(
            f"executor: the function gave {checks.shown(executor)}; must give a "
            "concurrent.futures.Executor"
        )
    # Dask gives calls with equal arguments one result: that of an attempt which failed, say, or
    # that of another study which was cancelled. So no two are equal.
    call, version, pickled = uuid.uuid4().hex, _core.RESULTS_VERSION, pickle.dumps(setup)

    def submit(task: _Task) -> Future[Rows]:
        future: Future[Rows] = executor.submit(
            work, call, task.attempt, version, pickled, task.block, threads
        )
        return future

    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        scheduler = BlockScheduler(submit, blocks, accept, in_order, ctrl_c)
        try:
            try:
                report(0, asked.count)
                while not scheduler.over:
                    if not scheduler.advance():
                        accept(setup.empty())
                    report(scheduler.done, asked.count)
            except KeyboardInterrupt:  # a progress function may raise it
                ctrl_c.pending = True
            scheduler.end()
        finally:
            scheduler.cancel()
            if made:
                executor.shutdown(wait=scheduler.idle)
    return Outcome(ctrl_c.pending, scheduler.lost(asked), "at most 1024 a worker")
