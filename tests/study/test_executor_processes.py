"""Studies on processes of this machine: forked, spawned, killed."""

import multiprocessing
import os
import signal
import struct
import sys
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
    return ProcessPoolExecutor(workers, multiprocessing.get_context(context), **how)


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


@pytest.mark.parametrize("workers", [1, 2])
def test_a_fork_server_gives_the_bits_of_one_thread(workers: int) -> None:
    with pool("forkserver", workers) as executor:
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


@pytest.mark.parametrize("context", CONTEXTS)
def test_a_killed_worker_costs_nothing_where_a_function_makes_executors(
    context: str, tmp_path: Path
) -> None:
    made: list[ProcessPoolExecutor] = []

    def make() -> ProcessPoolExecutor:
        made.append(pool(context))
        return made[-1]

    killer = Once(lambda: kill_one(made[0]))
    require_same(study(runs=MANY, executor=make, progress=killer), runs=MANY)
    assert 0 < killer.done < MANY and len(made) == 2
    # Nothing is left of them.
    assert all(executor._processes is None for executor in made)


def test_a_killed_worker_ends_an_instance_with_what_there_is_and_a_store_goes_on(
    tmp_path: Path,
) -> None:
    with pool() as executor:
        killer = Once(lambda: kill_one(executor))
        with pytest.warns(LostRunsWarning, match="the executor is broken: Broken"):
            some = study(
                "failures", runs=MANY, executor=executor, store=tmp_path / "s", progress=killer
            )
    assert killer.done <= some.runs < MANY and not some.interrupted
    assert sum(one.runs for one in some.lost) == MANY - some.runs
    require_rows(some, some.run, "failures", MANY)
    # No block in part.
    assert (np.diff(some.missing) % BLOCK == 0).all()
    with pool() as executor:
        again = sp.Study.open(tmp_path / "s").resume(executor=executor, progress=False)
    require_same(again, "failures", MANY)


def deadly(block: int) -> Callable[..., Any]:
    compute = worker.compute

    def die(setup: Any, piece: Any, *others: Any) -> Any:
        if piece.numbers[0] // BLOCK == block:
            os.kill(os.getpid(), signal.SIGKILL)
        return compute(setup, piece, *others)

    return die


def mute(block: int, done: Path) -> Callable[..., Any]:
    """As a kill in the middle of sending does it: half a message, under a lock that nobody frees.

    The rest of it never comes, and a pool of Python's waits for it for ever.
    """
    compute = worker.compute

    def die(setup: Any, piece: Any, *others: Any) -> Any:
        if piece.numbers[0] // BLOCK == block and not done.exists():
            done.touch()
            frame: Any = sys._getframe()
            while "result_queue" not in frame.f_locals:
                frame = frame.f_back
            queue = frame.f_locals["result_queue"]
            queue._wlock.acquire()
            queue._writer._send(struct.pack("!i", 100_000) + b"half")
            os.kill(os.getpid(), signal.SIGKILL)
        return compute(setup, piece, *others)

    return die


@needs_fork
def test_a_worker_that_is_killed_while_it_sends_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "compute", mute(1, tmp_path / "done"))
    require_same(study(executor=pool))
    assert (tmp_path / "done").exists()


@needs_fork
def test_an_instance_whose_worker_is_killed_while_it_sends_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "compute", mute(1, tmp_path / "done"))
    with pool() as executor, pytest.warns(LostRunsWarning, match="died while it sent its rows"):
        some = study(executor=executor)
    assert some.runs + sum(one.runs for one in some.lost) == some.requested


@needs_fork
@pytest.mark.parametrize("kind", ["noise", "stop_when"])
def test_a_block_that_kills_every_worker_is_lost_alone(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "compute", deadly(1))
    with pytest.warns(LostRunsWarning) as said:
        some = study(kind, executor=pool)
    monkeypatch.undo()
    (lost,) = some.lost
    assert (lost.first, lost.last, lost.runs) == (BLOCK, 2 * BLOCK - 1, BLOCK)
    assert "failed 3 times: BrokenProcessPool" in lost.reason and len(said) == 1
    numbers = np.arange(RUNS)
    whole = study(kind.replace("stop_when", "failures"), threads=1)
    np.testing.assert_array_equal(some.run, numbers[numbers // BLOCK != 1])
    assert some["final_state"].tobytes() == whole["final_state"][some.run].tobytes()


@needs_fork
def test_workers_that_cannot_begin_end_it() -> None:
    with pytest.warns(LostRunsWarning, match="BrokenProcessPool"):
        some = study(runs=300 * BLOCK, executor=lambda: pool(initializer=os._exit, initargs=(1,)))
    assert some.runs == 0 and sum(one.runs for one in some.lost) == 300 * BLOCK


def spying(compute: Callable[..., Any], path: Path) -> Callable[..., Any]:
    def spy(setup: Any, piece: Any, threads: int, watch: Any) -> Any:
        with path.open("a") as file:
            file.write(f"{threads}\n")
        return compute(setup, piece, threads, watch)

    return spy


@needs_fork
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no cores can be given")
def test_a_worker_uses_the_cores_that_it_has_been_given(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    cores = sorted(os.sched_getaffinity(0))
    cases: list[tuple[int, dict[str, Any], dict[str, Any], int]] = [
        (1, {}, {}, len(cores)),
        (2, {}, {}, max(1, len(cores) // 2)),
        (1, {}, {"threads": 1}, 1),
        (1, {"initializer": os.sched_setaffinity, "initargs": (0, cores[:1])}, {}, 1),
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
