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

from ._engine import how_many_threads

# How often a cluster is asked how many workers it has, s.
_COUNTED = 2.0


class Pool:
    """An executor, made anew where it breaks and there is a function that makes it."""

    def __init__(self, given: Any) -> None:
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
                f"executor: the function gave {executor!r}; must give a concurrent.futures.Executor"
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

    def stuck(self) -> bool:
        """Whether a worker is dead, and Python's pool may be waiting for it.

        One that is killed while it sends its rows leaves half a message, for the rest of which the
        pool waits for ever.
        """
        if not isinstance(self.executor, ProcessPoolExecutor):
            return False
        processes = list((self.executor._processes or {}).values())
        return bool(connection.wait([process.sentinel for process in processes], 0))

    def bury(self) -> None:
        """Kills the workers of a pool that is stuck, so that its own threads find an end, too."""
        for process in list((self.executor._processes or {}).values()):
            process.kill()
        # The pool holds the other ends itself; the interpreter waits for its threads when it ends.
        with suppress(AttributeError, OSError):
            self.executor._result_queue._writer.close()
            self.executor._call_queue._reader.close()

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
        client = getattr(executor, "_client", None)
        if client is not None and hasattr(client, "nthreads"):  # Dask's
            try:
                return sum(client.nthreads().values())
            except Exception:  # its scheduler is gone: the blocks will say so
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
