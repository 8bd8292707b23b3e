"""What a worker of an executor does: it computes one block of runs at a time."""

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
    """A setup, with all that it has prepared for the blocks before; the last few are kept."""
    found: Setup = pickle.loads(setup)
    return found


def work(
    call: str, attempt: int, version: int, setup: bytes, block: RunBlock, threads: int
) -> Rows:
    """Computes a block of runs.

    Args:
        call: Name of the call of `monte_carlo` that the block belongs to.
        attempt: How often the block has been submitted, this time included.
        version: `_core.RESULTS_VERSION` of the process that asks.
        setup: Pickled.
        block: The runs to compute.
        threads: At most; a worker takes no more than the cores that it may use.

    Returns:
        The rows, without what each run had of its own. Ctrl-C leaves out those that are not done,
        and all of the blocks that had been sent to this worker already.

    Raises:
        VersionMismatchError: This worker's results would have other bits.
    """
    global _interrupted_call
    if version != _core.RESULTS_VERSION:
        raise VersionMismatchError(
            f"a worker has softpinch {_core.__version__} with results version "
            f"{_core.RESULTS_VERSION}; the study is made with results version {version}"
        )
    known = unpickled(setup)
    # A second attempt says that only this worker was interrupted, and not the whole study.
    if call == _interrupted_call and attempt == 1:
        return known.empty()
    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        cores = how_many_threads(None)
        rows = compute(known, block, min(threads, cores), lambda done: ctrl_c.pending)
    if ctrl_c.pending:
        _interrupted_call = call
    return rows
