"""What a worker of an executor does: one block of runs at a time, of setups that it knows."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from functools import cache
from multiprocessing.process import BaseProcess

from .. import _core
from ..support.errors import VersionMismatchError
from ..support.interrupt import CtrlC
from .engine import Piece, compute, how_many_threads
from .rows import Rows
from .setup import Setup

# Setups by their keys, the last few that came. No lock guards it: a process that is forked from
# one with threads would inherit it as it is.
_KNOWN: dict[str, Setup] = {}
_MOST_KNOWN = 8


def work(
    ticket: str,
    version: int,
    key: str,
    setup: bytes | None,
    piece: Piece,
    threads: int,
    end: str,
) -> Rows | None:
    """Computes a piece.

    Args:
        ticket: Differs from call to call. Dask takes calls with the same arguments for one.
        version: `_core.RESULTS_VERSION` of whoever asks.
        key: Of the setup.
        setup: Pickled; None where the worker should know it.
        piece: What to compute.
        threads: At most; no more than the cores that this worker may use.
        end: A file that is there as soon as nobody waits for the rows any more.

    Returns:
        The rows, without what each run had of its own; fewer where Ctrl-C or `end` came. None
        where the setup is not known.

    Raises:
        VersionMismatchError: The bits of this worker's results would be others.
    """
    if version != _core.RESULTS_VERSION:
        raise VersionMismatchError(
            f"a worker has softpinch {_core.__version__} with results version "
            f"{_core.RESULTS_VERSION}; the study is made with results version {version}"
        )
    _die_with(multiprocessing.parent_process())
    found = _known(key, setup)
    if found is None:
        return None
    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        cores = how_many_threads(None)
        return compute(
            found, piece, min(threads, cores), lambda done: ctrl_c.pending or os.path.exists(end)
        )


def _known(key: str, setup: bytes | None) -> Setup | None:
    """The setup of a key, where it is known or given."""
    found = _KNOWN.get(key)
    if found is None and setup is not None:
        found = _KNOWN[key] = pickle.loads(setup)
        for old in list(_KNOWN)[:-_MOST_KNOWN]:
            _KNOWN.pop(old, None)
    return found


@cache
def _die_with(parent: BaseProcess | None) -> None:
    """Ends a worker when whoever made it is killed: Python's pools would wait for work for ever.

    Only where work is what the process is for, so not in a thread: Dask's workers see to it
    themselves.
    """
    if parent is None or threading.current_thread() is not threading.main_thread():
        return

    def die() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=die, daemon=True).start()
