"""The function that an executor's worker runs: it computes one block of runs."""

from __future__ import annotations

import pickle
from functools import lru_cache

from .. import _core
from ..support.errors import VersionMismatchError
from ..support.interrupt import CtrlC
from .engine import RunBlock, compute, how_many_threads
from .rows import Rows
from .setup import Setup

# The last call of `monte_carlo` during which Ctrl-C reached this worker.
_interrupted_call = ""


@lru_cache(maxsize=8)
def unpickled(setup: bytes) -> Setup:
    """Unpickles a setup; cached, so that later blocks reuse its cached properties."""
    found: Setup = pickle.loads(setup)
    return found


def work(
    call: str, attempt: int, version: int, setup: bytes, block: RunBlock, threads: int
) -> Rows:
    """Computes a block of runs.

    Args:
        call: Unique name of the call of `monte_carlo` to which the block belongs.
        attempt: The number of this attempt, from 1.
        version: `_core.RESULTS_VERSION` of the submitting process.
        setup: The pickled setup.
        block: The runs to compute.
        threads: The largest number of threads; a worker uses at most one for each available core.

    Returns:
        The rows, without the varied values. After Ctrl-C they lack the unfinished runs, and further
        blocks of the interrupted call give no rows.

    Raises:
        VersionMismatchError: This worker has another results version, so bits could differ.
    """
    global _interrupted_call
    if version != _core.RESULTS_VERSION:
        raise VersionMismatchError(
            f"a worker has softpinch {_core.__version__} with results version "
            f"{_core.RESULTS_VERSION}; the study is made with results version {version}"
        )
    known = unpickled(setup)
    # A second attempt means that only this worker was interrupted, and not the whole study.
    if call == _interrupted_call and attempt == 1:
        return known.empty()
    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        cores = how_many_threads(None)
        rows = compute(known, block, min(threads, cores), lambda done: ctrl_c.pending)
    if ctrl_c.pending:
        _interrupted_call = call
    return rows
