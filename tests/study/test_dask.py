"""Studies on a Dask cluster: two workers, killed, joined by others, or not there yet."""

import logging
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from executors import BLOCK, KINDS, RUNS, Call, Inline, require_rows, require_same, study, until
from softpinch.study import pool as pools
from softpinch.study.pool import Pool
from softpinch.support.errors import LostRunsWarning

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

SILENT = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL + 1}
MANY = 60 * BLOCK


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **SILENT) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.fixture
def executor(client: Any) -> Any:
    client.wait_for_workers(2, timeout=60)
    return client.get_executor()


class Spy:
    """An executor that notes what it passes on."""

    def __init__(self, executor: Any) -> None:
        self._executor = executor
        self._client = executor._client
        self.calls: list[Call] = []

    def submit(self, function: Callable[..., Any], /, *args: Any) -> Future[Any]:
        self.calls.append(Call(*args))
        future: Future[Any] = self._executor.submit(function, *args)
        return future


def idle(client: Any) -> bool:
    """Whether nothing is under way or kept; errors Dask itself holds on to."""
    left = client.run_on_scheduler(
        lambda dask_scheduler: [task.state for task in dask_scheduler.tasks.values()]
    )
    return not any(client.processing().values()) and set(left) <= {"erred"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_cluster_gives_the_bits_of_one_thread(executor: Any, kind: str) -> None:
    require_same(study(kind, executor=executor), kind)


def test_the_same_study_twice_is_computed_twice_and_leaves_nothing(
    client: Any, executor: Any
) -> None:
    for _ in range(2):
        spy = Spy(executor)
        require_same(study(executor=spy))
        assert len(spy.calls) >= 6
    until(lambda: idle(client))


def test_each_worker_takes_one_block_at_a_time_on_one_thread(executor: Any) -> None:
    spy = Spy(executor)
    require_same(study(runs=20 * BLOCK, executor=spy), runs=20 * BLOCK)
    assert {call.threads for call in spy.calls} == {1}
    assert Pool(executor).workers == 2


def test_the_scene_goes_once_to_each_worker_however_large(client: Any, executor: Any) -> None:
    times = np.linspace(0.0, 20.0, 20_000)
    push = sp.Sampled(times=times, force=np.ones((len(times), 2)), moment=0.0 * times, hold="zero")
    scene = sp.Scene(duration=0.02, disturbances=[push])
    spy = Spy(executor)
    how: dict[str, Any] = {"vary": {"gravity": sp.Uniform(9, 10)}, "dt": 1e-3, "progress": False}
    # Dask warns of what is larger than 10 MB; here it is less, to be quick.
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "500kB"}):
        some = sp.monte_carlo(scene, 6 * BLOCK, executor=spy, **how)
    sizes = sorted(len(pickle.dumps(tuple(call))) for call in spy.calls)
    large = [size for size in sizes if size > 1e5]
    assert large and large[0] > 6e5
    # One to each; a block that reached a worker before its first is sent again with it.
    assert len(large) == 2 + len(spy.calls) - 6
    assert sizes[-len(large) - 1] < 8 * 2 * BLOCK + 1500
    few = np.arange(0, 6 * BLOCK, 1000)
    again = sp.monte_carlo(scene, 6 * BLOCK, only=few, **how)
    assert some["final_state"][few].tobytes() == again["final_state"].tobytes()


def test_a_store_filled_by_a_cluster_is_the_same_study(executor: Any, tmp_path: Path) -> None:
    half = study("failures", runs=RUNS // 2, executor=executor, store=tmp_path / "study")
    require_same(half.extend(RUNS, executor=executor, progress=False), "failures")


def test_a_killed_worker_costs_nothing(client: Any, executor: Any, tmp_path: Path) -> None:
    before = set(client.run(os.getpid).values())
    assert len(before) == 2
    killed: list[int] = []

    def report(done: int, runs: int) -> None:
        if done and not killed:
            killed.append(done)
            os.kill(min(before), signal.SIGKILL)

    some = study(runs=MANY, executor=executor, store=tmp_path / "study", progress=report)
    assert killed[0] < MANY
    require_same(some, runs=MANY)
    # Its nanny makes another, which learns what it needs.
    client.wait_for_workers(2, timeout=60)
    after = set(client.run(os.getpid).values())
    assert min(before) not in after and len(after) == 2
    require_same(study("failures", executor=executor), "failures")


def test_another_softpinch_in_one_worker_is_an_error(client: Any, executor: Any) -> None:
    def change(version: int) -> None:
        from softpinch import _core

        _core.RESULTS_VERSION = version  # type: ignore[misc]

    (one, _) = client.run(os.getpid)
    client.run(change, 999, workers=[one])
    try:
        with pytest.raises(sp.VersionMismatchError, match="results version 999; the study"):
            study(runs=MANY, executor=executor)
    finally:
        client.run(change, sp._core.RESULTS_VERSION, workers=[one])
    until(lambda: idle(client))
    require_same(study(executor=executor))


def test_ctrl_c_frees_the_cluster_in_the_middle_of_long_blocks(client: Any, executor: Any) -> None:
    def report(done: int, runs: int) -> None:
        # Two short blocks have come, so both workers are at long ones, of a minute each.
        if done >= 2 * BLOCK and sum(map(bool, client.processing().values())) == 2:
            ticks.append(done)
            if len(ticks) > 8:
                raise KeyboardInterrupt

    ticks: list[int] = []
    duration = np.full(40 * BLOCK, 2.0)
    duration[: 2 * BLOCK] = 0.001
    how: dict[str, Any] = {"vary": {"duration": duration}, "dt": 1e-5}
    some = study("sobol", sampler="random", executor=executor, progress=report, **how, runs=None)
    assert some.interrupted and not some.lost
    assert 2 * BLOCK < some.runs < 4 * BLOCK
    few = some.run[[0, -1]]
    again = study("sobol", sampler="random", only=few, **how, runs=None)
    assert some["final_state"][[0, -1]].tobytes() == again["final_state"].tobytes()
    until(lambda: idle(client))


def test_workers_are_counted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    class Growing:
        threads = 1

        def nthreads(self) -> dict[str, int]:
            return {"a": self.threads, "b": 1}

    executor = Inline()
    executor._client = Growing()  # type: ignore[attr-defined]
    pool = Pool(executor)
    assert pool.workers == 2
    executor._client.threads = 6  # type: ignore[attr-defined]
    # Not each time: it takes a message.
    assert pool.workers == 2
    monkeypatch.setattr(pools, "_COUNTED", 0.0)
    assert pool.workers == 7


def test_workers_that_come_later_are_used(tmp_path: Path) -> None:
    with (
        distributed.LocalCluster(
            n_workers=0, threads_per_worker=1, processes=False, **SILENT
        ) as cluster,
        distributed.Client(cluster) as client,
    ):

        def report(done: int, runs: int) -> None:
            if not ticks:
                cluster.scale(3)
            ticks.append(done)

        ticks: list[int] = []
        executor = client.get_executor()
        assert Pool(executor).workers == 1
        require_same(study("failures", executor=executor, progress=report), "failures")
        assert Pool(executor).workers == 3


def test_a_client_that_is_closed_keeps_what_came() -> None:
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, **SILENT
        ) as cluster,
        distributed.Client(cluster) as client,
        pytest.warns(LostRunsWarning),
    ):
        closed: list[int] = []

        def report(done: int, runs: int) -> None:
            if done and not closed:
                closed.append(done)
                client.close()

        some = study(runs=MANY, executor=client.get_executor(), progress=report)
    assert closed[0] <= some.runs < MANY
    assert sum(one.runs for one in some.lost) == MANY - some.runs
    require_rows(some, some.run, runs=MANY)


def test_the_shell_says_that_it_waits_for_workers(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("typer")
    from softpinch.cli.montecarlo import _executor

    with distributed.LocalCluster(n_workers=0, processes=False, **SILENT) as cluster:
        address = cluster.scheduler_address
        with _executor(address):
            assert capsys.readouterr().err == f"{address} has no workers yet: waiting for them\n"
        cluster.scale(1)
        cluster.wait_for_workers(1, timeout=60)
        with _executor(address):
            assert capsys.readouterr().err == ""
