"""Studies on processes of this machine: forked, spawned, of loky, killed."""

import fcntl
import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from executors import BLOCK, KINDS, require_rows, require_same, study
from softpinch.support.errors import LostRunsWarning

# Python 3.12 and later say that a fork of a process with threads may hang; ours must not.
pytestmark = pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
CONTEXTS = [name for name in ("fork", "spawn") if name in multiprocessing.get_all_start_methods()]


def pool(context: str = CONTEXTS[0]) -> Any:
    if context == "loky":
        # Another one, if the one before is broken.
        return pytest.importorskip("loky").get_reusable_executor(max_workers=2)
    executor = ProcessPoolExecutor(2, multiprocessing.get_context(context))
    # A worker that is killed while it writes a result makes the pool hang for ever (Python's issue
    # 94777). A block of results does not fit into a pipe's usual 64 KiB, so that a worker waits in
    # the middle of it most of the time.
    fcntl.fcntl(executor._result_queue._writer, fcntl.F_SETPIPE_SZ, 1 << 20)
    return executor


@pytest.fixture(scope="module", params=CONTEXTS)
def two(request: pytest.FixtureRequest, tmp_path_factory: Any) -> Iterator[ProcessPoolExecutor]:
    # Threads of the core and of pyarrow have run before the fork.
    study(threads=2, store=tmp_path_factory.mktemp("before") / "study").ensemble().to_pandas()
    with pool(request.param) as executor:
        yield executor


@pytest.mark.parametrize("kind", KINDS)
def test_two_processes_give_the_bits_of_one_thread(two: ProcessPoolExecutor, kind: str) -> None:
    require_same(study(kind, executor=two), kind)


MANY = 20 * BLOCK


# Whether a function makes the executor or it is given is the same for all kinds.
@pytest.mark.parametrize(
    ("context", "made"), [*zip(CONTEXTS, [True, False], strict=False), ("loky", True)]
)
def test_a_killed_worker_ends_a_study_with_what_there_is_and_a_store_goes_on(
    context: str, made: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Some blocks are still to be submitted when the worker dies, however fast the others are.
    monkeypatch.setattr("softpinch.study.engine.MOST_UNDER_WAY", 8)
    pools: list[Any] = []

    def make() -> Any:
        pools.append(pool(context))
        return pools[-1]

    def report(done: int, runs: int) -> None:
        if done and not killed:
            killed.append(done)
            os.kill(next(iter(pools[0]._processes)), signal.SIGKILL)

    killed: list[int] = []
    remedy = "the executor is broken: (Broken|Terminated).*; to compute the rest, call"
    with pytest.warns(LostRunsWarning, match=remedy):
        some = study(
            "failures",
            runs=MANY,
            executor=make if made else make(),
            store=tmp_path / "s",
            progress=report,
        )
    assert killed[0] <= some.runs < MANY and not some.interrupted
    assert sum(one.runs for one in some.lost) == MANY - some.runs
    require_rows(some, some.run, "failures", MANY)
    # No block in part, and no second pool.
    assert (np.diff(some.missing) % BLOCK == 0).all() and len(pools) == 1
    pools[0].shutdown()
    with pool(context) as executor:
        again = sp.Study.open(tmp_path / "s").resume(executor=executor, progress=False)
    require_same(again, "failures", MANY)
