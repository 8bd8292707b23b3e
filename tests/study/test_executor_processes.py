"""Studies on processes of this machine: forked, spawned, killed."""

import fcntl
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from executors import BLOCK, KINDS, RUNS, on_threads, require_rows, require_same, study
from softpinch.study import worker
from softpinch.support.errors import LostRunsWarning

# Python 3.12 and later say that a fork of a process with threads may hang; ours must not.
pytestmark = pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
CONTEXTS = [name for name in ("fork", "spawn") if name in multiprocessing.get_all_start_methods()]
needs_fork = pytest.mark.skipif("fork" not in CONTEXTS, reason="patches must reach the workers")


def pool(context: str = CONTEXTS[0], workers: int = 2, **how: Any) -> ProcessPoolExecutor:
    executor = ProcessPoolExecutor(workers, multiprocessing.get_context(context), **how)
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


@pytest.mark.parametrize("kind", ["noise", "stop_when", "only"])
def test_threads_of_an_executor_give_the_bits_of_one_thread(kind: str) -> None:
    with ThreadPoolExecutor(3) as threads:
        require_same(study(kind, executor=threads), kind)


def test_a_fork_server_gives_the_bits_of_one_thread() -> None:
    with pool("forkserver") as executor:
        require_same(study("failures", executor=executor), "failures")


def test_a_store_filled_by_processes_is_the_same_study(
    two: ProcessPoolExecutor, tmp_path: Path
) -> None:
    half = study("failures", runs=RUNS // 2, executor=two, store=tmp_path / "study")
    require_same(half, "failures", RUNS // 2)
    require_same(half.extend(RUNS, executor=two, progress=False), "failures")
    assert [run.replay().status for run in half.failures()[:2]] == ["separated"] * 2


class Once:
    """As a progress function: does something when the first rows have come."""

    def __init__(self, do: Callable[[], object]) -> None:
        self._do = do
        self.done = 0

    def __call__(self, done: int, runs: int) -> None:
        if done and not self.done:
            self.done = done
            self._do()


def kill_one(executor: ProcessPoolExecutor) -> None:
    os.kill(next(iter(executor._processes)), signal.SIGKILL)


MANY = 60 * BLOCK


@pytest.mark.parametrize("made", [False, True], ids=["instance", "function"])
@pytest.mark.parametrize("context", CONTEXTS)
def test_a_killed_worker_ends_a_study_with_what_there_is_and_a_store_goes_on(
    context: str, made: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Some blocks are still to be submitted when the worker dies, however fast the others are.
    monkeypatch.setattr("softpinch.study.executor.MOST_UNDER_WAY", 8)
    pools: list[ProcessPoolExecutor] = []

    def make() -> ProcessPoolExecutor:
        pools.append(pool(context))
        return pools[-1]

    killer = Once(lambda: kill_one(pools[0]))
    with pytest.warns(LostRunsWarning, match="the executor is broken: Broken"):
        some = study(
            "failures",
            runs=MANY,
            executor=make if made else make(),
            store=tmp_path / "s",
            progress=killer,
        )
    assert killer.done <= some.runs < MANY and not some.interrupted
    assert sum(one.runs for one in some.lost) == MANY - some.runs
    require_rows(some, some.run, "failures", MANY)
    # No block in part, and no second pool.
    assert (np.diff(some.missing) % BLOCK == 0).all() and len(pools) == 1
    pools[0].shutdown()
    with pool() as executor:
        again = sp.Study.open(tmp_path / "s").resume(executor=executor, progress=False)
    require_same(again, "failures", MANY)


@needs_fork
def test_workers_that_cannot_begin_end_it() -> None:
    with pytest.warns(LostRunsWarning, match="BrokenProcessPool"):
        some = study(runs=300 * BLOCK, executor=lambda: pool(initializer=os._exit, initargs=(1,)))
    assert some.runs == 0 and sum(one.runs for one in some.lost) == 300 * BLOCK


def spying(compute: Callable[..., Any], path: Path) -> Callable[..., Any]:
    def spy(setup: Any, block: Any, threads: int, watch: Any) -> Any:
        with path.open("a") as file:
            file.write(f"{threads}\n")
        return compute(setup, block, threads, watch)

    return spy


@needs_fork
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no cores can be given")
def test_a_worker_uses_the_cores_that_it_has_been_given(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    cores = sorted(os.sched_getaffinity(0))
    cases: list[tuple[int, dict[str, Any], dict[str, Any], int]] = [
        (1, {}, {}, 1),
        (1, {}, {"threads": len(cores)}, len(cores)),
        (1, {"initializer": os.sched_setaffinity, "initargs": (0, cores[:1])}, {"threads": 2}, 1),
        (2, {}, {"threads": 64}, len(cores)),
    ]
    for k, (workers, how, asked, expected) in enumerate(cases):
        seen = tmp_path / str(k)
        with monkeypatch.context() as patch:
            patch.setattr(worker, "compute", spying(worker.compute, seen))
            with pool(workers=workers, **how) as executor:
                require_same(study(executor=executor, **asked))
        assert set(seen.read_text().split()) == {str(expected)}, cases[k]


@needs_fork
def test_another_softpinch_in_a_worker_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    expected = on_threads()
    with pool(initializer=setattr, initargs=(sp._core, "RESULTS_VERSION", 999)) as executor:
        with pytest.raises(sp.VersionMismatchError, match="with results version 999; the study"):
            study(executor=executor)
        assert sp._core.RESULTS_VERSION != 999 and expected.runs == RUNS
