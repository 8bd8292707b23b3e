"""The executor of a study: made anew where it breaks, and asked how many workers it has."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from multiprocessing import connection
from typing import Any

from ..support import checks
from ..support.interrupt import by_handler, ignoring_system
from .engine import how_many_threads

# How often a cluster is asked how many workers it has, s.
_COUNTED = 2.0


class Pool:
    """An executor, made anew where it breaks and there is a function that makes it."""

    def __init__(self, given: Any) -> None:
        """Takes an executor, or a function that makes one.

        Raises:
            TypeError: The function makes something else.
        """
        # A class of executors has `submit` too, and makes one when it is called.
        made = hasattr(given, "submit") and not isinstance(given, type)
        self._make: Callable[[], Any] | None = None if made else given
        self.executor = given if made else self._new()
        self._workers, self._asked = 0, -math.inf

    def _new(self) -> Any:
        assert self._make is not None
        executor = self._make()
        if not hasattr(executor, "submit"):
            raise TypeError(
                f"executor: the function gave {checks.shown(executor)}; must give a "
                "concurrent.futures.Executor"
            )
        return executor

    def renew(self) -> bool:
        """Makes another one; whether there is a way to.

        Raises:
            Exception: The function fails this time.
        """
        if self._make is None:
            return False
        self.executor.shutdown(wait=False)
        self.executor = self._new()
        self._asked = -math.inf
        return True

    def stuck(self) -> str:
        """Why nothing will come any more, although nobody says so; empty where something may.

        A worker of Python's pool that is killed while it sends its rows leaves half a message, for
        the rest of which the pool waits for ever. What a Dask client that was closed had asked for
        stays pending.
        """
        if isinstance(self.executor, ProcessPoolExecutor):
            processes = list((self.executor._processes or {}).values())
            dead = connection.wait([process.sentinel for process in processes], 0)
            return "a worker died while it sent its rows" if dead else ""
        closed = getattr(_client(self.executor), "status", None) in ("closing", "closed")
        return "its Dask client is closed" if closed else ""

    def bury(self) -> None:
        """Kills the workers of Python's pool, so that its own threads find an end, too."""
        executor = self.executor
        if not isinstance(executor, ProcessPoolExecutor):
            return
        ends: Any = executor
        for process in list((executor._processes or {}).values()):
            process.kill()
        # The pool holds the other ends itself; the interpreter waits for its threads when it ends.
        with suppress(AttributeError), ignoring_system():
            ends._result_queue._writer.close()
            ends._call_queue._reader.close()

    def close(self, quick: bool) -> None:
        """Ends what it has made itself; `quick` waits for nothing."""
        if self._make is not None:
            self.executor.shutdown(wait=not quick)

    @property
    def workers(self) -> int:
        """How many blocks it works at, at a time; that of a cluster changes."""
        if time.monotonic() - self._asked > _COUNTED:
            self._workers, self._asked = max(1, self._count()), time.monotonic()
        return self._workers

    def _count(self) -> int:
        executor = self.executor
        client = _client(executor)
        if client is not None:
            try:
                return sum(client.nthreads().values())
            except Exception as error:
                if by_handler(error):
                    raise
                # Its scheduler is gone: the blocks will say so.
                return self._workers
        for name in ("num_workers", "_max_workers"):  # mpi4py's; those of the standard library
            count = getattr(executor, name, None)
            if isinstance(count, int):
                return count
        return os.cpu_count() or 1

    def threads(self, threads: int | None) -> int:
        """For each block: those asked for, or the cores that each worker has of this machine.

        Of workers elsewhere, Dask's or MPI's, nothing is known but that each takes one block at a
        time; there are as many as there are cores.
        """
        if threads is not None:
            return threads
        if isinstance(self.executor, ProcessPoolExecutor | ThreadPoolExecutor):
            return max(1, how_many_threads(None) // self.workers)
        return 1


def _client(executor: Any) -> Any:
    """That of Dask's executor; None of another."""
    client = getattr(executor, "_client", None)
    return client if hasattr(client, "nthreads") else None
