"""How the runs of a study are computed by the workers of an executor.

Any `concurrent.futures.Executor` will do. The setup goes to each worker once: the first blocks
bring it along, and a worker that does not know it says so and is sent it. A block that fails is
tried again, three times in all. Where a worker that is killed breaks the whole executor, the last
time is alone: a block that kills its worker takes no other along.
"""

from __future__ import annotations

import atexit
import hashlib
import pickle
import tempfile
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias

from .. import _core
from ..support import checks
from ..support.errors import VersionMismatchError
from ..support.interrupt import CtrlC, by_handler, ignoring_system
from ..support.progress import Report
from .engine import Accept, Ended, Piece
from .pool import Pool
from .rows import Rows
from .setup import Setup
from .spans import Numbers
from .worker import work

# An executor, or a function that makes one.
Engine: TypeAlias = Executor | Callable[[], Executor]

# How often a block is tried.
_ATTEMPTS = 3
# Blocks in a row that failed for good, with none that came back between: then no other will.
_HOPELESS = 8
# Blocks under way for each worker: one at work, the others on their way to it.
_AHEAD = 3
# How often Ctrl-C is asked for, s.
_TICK = 0.1
# How long no block comes back before the pool is asked whether it is stuck, s.
_SILENCE = 2.0
# How long rows are waited for after Ctrl-C, s: workers on this machine hear of it, others do not.
_GRACE = 1.0


@dataclass(eq=False)
class _Block:
    """A piece on its way."""

    place: int
    piece: Piece
    attempts: int = 0
    # Whether it brings the setup along.
    introduced: bool = False
    # Whether its executor broke with it under way.
    suspect: bool = False

    @property
    def alone(self) -> bool:
        """Whether it flies alone: the last attempt of one that may take others along."""
        return self.suspect and self.attempts == _ATTEMPTS - 1


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


class _Flight:
    """Blocks on their way to workers and back."""

    def __init__(
        self,
        setup: Setup,
        pieces: Iterable[Piece],
        pool: Pool,
        threads: int | None,
        ctrl_c: CtrlC,
    ) -> None:
        self._pool = pool
        self._threads = threads
        self._ctrl_c = ctrl_c
        self._blocks = (_Block(place, piece) for place, piece in enumerate(pieces))
        # To be tried again.
        self._again: deque[_Block] = deque()
        self._flying: dict[Future[Rows | None], _Block] = {}
        # Came back, but not all those before them.
        self._early: dict[int, tuple[_Block, Rows]] = {}
        self._settled: set[int] = set()
        self._next = 0
        self._payload = pickle.dumps(setup, protocol=pickle.HIGHEST_PROTOCOL)
        self._key = hashlib.blake2b(self._payload, digest_size=16).hexdigest()
        self._ticket = uuid.uuid4().hex
        self._end = Path(tempfile.gettempdir()) / f"softpinch-{self._ticket}.end"
        self._sent = 0
        self._introduced = 0
        # Given up since the last block that came back.
        self._in_a_row = 0
        # Turns in a row in which no block came back, and in which the pool was stuck.
        self._silent = 0
        self._stuck = 0
        self._exhausted = False
        self.failed: list[tuple[Numbers, str]] = []
        self.gave_up = ""
        # What a worker says that would give other bits.
        self.refused = ""
        self.most = 0

    @property
    def over(self) -> bool:
        """Whether nothing more will come."""
        done = self._exhausted and not self._again and not self._flying and not self._early
        return done or bool(self.gave_up or self.refused)

    def turn(self, in_order: bool) -> list[tuple[_Block, Rows]]:
        """Sends what there is room for, waits a little, and gives what came back."""
        self._fill()
        came = self._landed()
        if self._in_a_row >= _HOPELESS:
            self.gave_up = f"no block comes back any more: {self.failed[-1][1]}"
        if not in_order:
            return came
        self._early.update({block.place: (block, rows) for block, rows in came})
        released = []
        while self._next in self._early or self._next in self._settled:
            if self._next in self._early:
                released.append(self._early.pop(self._next))
            self._settled.discard(self._next)
            self._next += 1
        return released

    def _fill(self) -> None:
        """Submits blocks, not more than are wanted at a time."""
        workers = self._pool.workers
        # What waits for those before it takes room, too.
        room = min(_AHEAD * workers, max(1, 4 * _AHEAD * workers - len(self._early)))
        while len(self._flying) < room and not any(b.alone for b in self._flying.values()):
            if self._again and self._again[0].alone and self._flying:
                return
            block = self._again.popleft() if self._again else next(self._blocks, None)
            if block is None:
                self._exhausted = True
                return
            if not self._submit(block):
                return

    def _submit(self, block: _Block) -> bool:
        """Whether the executor took it."""
        if self._introduced < self._pool.workers:
            block.introduced = True
        self._sent += 1
        send = partial(
            self._pool.executor.submit,
            work,
            f"{self._ticket}-{self._sent}",
            _core.RESULTS_VERSION,
            self._key,
            self._payload if block.introduced else None,
            block.piece,
            self._pool.threads(self._threads),
            str(self._end),
        )
        try:
            future = _quietly(send) if block.introduced else send()
        except Exception as error:
            if by_handler(error):
                raise
            if self._flying:  # they will say so themselves
                self._again.appendleft(block)
            else:
                self._failed(block, error)
                self._broken(error)
            return False
        self._introduced += block.introduced
        self._flying[future] = block
        self.most = max(self.most, len(self._flying))
        return True

    def _landed(self) -> list[tuple[_Block, Rows]]:
        """Blocks that came back; those that failed are put back in line, or given up."""
        came = []
        broken: BaseException | None = None
        done, _ = wait(self._flying, timeout=_TICK, return_when=FIRST_COMPLETED)
        if done:
            self._silent = 0
        elif self._flying:
            self._silent += 1
            reason = self._pool.stuck() if self._silent * _TICK > _SILENCE else ""
            # Twice: a worker that ends as it should is also dead for a moment.
            self._stuck = self._stuck + 1 if reason else 0
            if self._stuck > 1:
                self._stuck = 0
                self._pool.bury()
                broken = BrokenExecutor(reason)
        for future in done:
            block = self._flying.pop(future)
            # Asked for, not raised: the KeyboardInterrupt of a worker is not this process's.
            error = CancelledError() if future.cancelled() else future.exception()
            if error is not None:
                # An executor that works at once, on this thread, keeps it in its future.
                if by_handler(error):
                    raise error
                if isinstance(error, VersionMismatchError):
                    self.refused = str(error)
                broken = error if isinstance(error, BrokenExecutor) else broken
                self._failed(block, error)
                continue
            rows = future.result()
            if rows is None:
                block.introduced = True
                self._again.appendleft(block)
            elif len(rows) < len(block.piece.numbers) and not self._ctrl_c.pending:
                self._failed(block, RuntimeError("the worker was interrupted"))
            else:
                self._in_a_row = 0
                came.append((block, rows))
        if broken is not None:
            for block in self._flying.values():
                self._failed(block, broken)
            self._flying.clear()
            self._broken(broken)
        return came

    def _failed(self, block: _Block, error: BaseException) -> None:
        """Puts a block back in line, or gives it up."""
        block.attempts += 1
        block.suspect |= isinstance(error, BrokenExecutor)
        if block.attempts < _ATTEMPTS:
            self._again.append(block)
            return
        self.failed.append((block.piece.numbers, f"failed {block.attempts} times: {_words(error)}"))
        self._settled.add(block.place)
        self._in_a_row += 1

    def _broken(self, error: BaseException) -> None:
        """Replaces the executor, or gives up."""
        self._introduced = 0
        self.gave_up = f"the executor is broken: {_words(error)}"
        try:
            if self._pool.renew():
                self.gave_up = ""
        except Exception as other:
            if by_handler(other):
                raise
            self.gave_up += f"; the function that makes another one: {_words(other)}"

    def rest(self) -> list[tuple[_Block, Rows]]:
        """After Ctrl-C: what comes soon, in part where its worker has heard of it."""
        self._call_off()
        done, _ = wait(self._flying, timeout=_GRACE)
        came = []
        for future in done:
            block = self._flying.pop(future)
            if not future.cancelled() and future.exception() is None:
                rows = future.result()
                if rows is not None:
                    came.append((block, rows))
        return came

    def end(self) -> None:
        """Takes back what has not come; workers on this machine stop at once."""
        if self._flying:
            self._call_off()
        for future in self._flying:
            future.cancel()
        # A cluster keeps a result as long as its future lives, and an error keeps this object.
        self._flying.clear()

    def _call_off(self) -> None:
        # As long as this process: workers may take blocks up after it has done with them.
        with ignoring_system():
            self._end.touch()
            atexit.register(self._end.unlink, missing_ok=True)


def _quietly(send: Callable[[], Future[Rows | None]]) -> Future[Rows | None]:
    """Sends a setup, however large its scene."""
    with warnings.catch_warnings():
        # Dask's advice is to send once what is large, as is done.
        warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
        return send()


def _words(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def on_executor(
    setup: Setup,
    pieces: Iterable[Piece],
    total: int,
    executor: Engine,
    threads: int | None,
    report: Report,
    accept: Accept,
    in_order: bool,
) -> Ended:
    """Computes runs on the workers of an executor.

    Args:
        setup: What all share.
        pieces: Blocks of 1024 runs.
        total: How many runs that makes.
        executor: It, or a function that makes one and, where it breaks, another.
        threads: Of each worker; None is its share of the machine's cores.
        report: Hears how many are done.
        accept: Keeps rows.
        in_order: Whether rows are accepted in the order of `pieces`, and not as they come.

    Raises:
        VersionMismatchError: A worker has another softpinch.
    """
    pool = Pool(executor)
    done, enough, quick = 0, False, True
    nothing = setup.empty()
    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        flight = _Flight(setup, pieces, pool, threads, ctrl_c)

        def keep(came: list[tuple[_Block, Rows]]) -> None:
            nonlocal done, enough
            for block, rows in came:
                if not enough:
                    done += len(rows)
                    enough = accept(rows.beside(block.piece.numbers, block.piece.values))
            if not came:
                accept(nothing)

        def rest() -> list[tuple[_Block, Rows]]:
            # Where the order matters, later blocks are of no use.
            return [] if in_order else flight.rest()

        try:
            report(0, total)
            while not (flight.over or enough or ctrl_c.pending):
                keep(flight.turn(in_order))
                report(done, total)
            if flight.refused:
                raise VersionMismatchError(flight.refused)
            quick = ctrl_c.pending
            if ctrl_c.pending:
                keep(rest())
                report(done, total)
        except KeyboardInterrupt:  # a progress function may raise it
            ctrl_c.pending = True
            keep(rest())
        finally:
            flight.end()
            pool.close(quick)
    under_way = f"at most {flight.most} blocks of 1024"
    failed = sorted(flight.failed, key=lambda one: int(one[0][0]))
    return Ended(ctrl_c.pending, failed, flight.gave_up, under_way)
