"""What a worker of an executor does: one block of runs at a time, of setups that it knows."""

from __future__ import annotations

import pickle
import threading
from collections import OrderedDict

from . import _core
from ._engine import Piece, compute, how_many_threads
from ._interrupt import CtrlC
from ._rows import Rows
from ._setup import Setup
from ._vary import Varied

# Setups by their keys, the last few that were used.
_KNOWN: OrderedDict[str, tuple[Setup, Varied]] = OrderedDict()
_MOST_KNOWN = 8
_LOCK = threading.Lock()


class VersionMismatchError(RuntimeError):
    """A worker has another softpinch than the process that sent it work."""


def work(
    ticket: str,
    version: int,
    key: str,
    setup: bytes | None,
    piece: Piece,
    threads: int,
) -> Rows | None:
    """Computes a piece.

    Args:
        ticket: Differs from call to call. Dask takes calls with the same arguments for one.
        version: `_core.RESULTS_VERSION` of whoever asks.
        key: Of the setup.
        setup: Pickled; None where the worker should know it.
        piece: What to compute.
        threads: At most; no more than the cores that this worker may use.

    Returns:
        The rows, without what each run had of its own; fewer where Ctrl-C came. None where the
        setup is not known.

    Raises:
        VersionMismatchError: The bits of this worker's results would be others.
    """
    if version != _core.RESULTS_VERSION:
        raise VersionMismatchError(
            f"a worker has softpinch {_core.__version__} with results version "
            f"{_core.RESULTS_VERSION}; the study is made with results version {version}"
        )
    found = _known(key, setup)
    if found is None:
        return None
    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        cores = how_many_threads(None)
        return compute(*found, piece, min(threads, cores), lambda done: ctrl_c.pending)


def _known(key: str, setup: bytes | None) -> tuple[Setup, Varied] | None:
    """The setup of a key, where it is known or given."""
    with _LOCK:
        if key not in _KNOWN:
            if setup is None:
                return None
            given: Setup = pickle.loads(setup)
            _KNOWN[key] = given, given.varied()
            if len(_KNOWN) > _MOST_KNOWN:
                _KNOWN.popitem(last=False)
        _KNOWN.move_to_end(key)
        return _KNOWN[key]
