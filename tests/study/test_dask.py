"""Studies on a Dask cluster: two workers, killed, of another version, or not there yet."""

import logging
import os
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executors import BLOCK, KINDS, Call, require_same, study, until

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

SILENT = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL + 1}
MANY = 20 * BLOCK


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
        self.calls: list[Call] = []

    def submit(self, function: Callable[..., Any], /, *args: Any) -> Future[Any]:
        self.calls.append(Call(*args))
        future: Future[Any] = self._executor.submit(function, *args)
        return future


def states(client: Any) -> set[str]:
    """The states of all tasks that the scheduler knows."""
    found: set[str] = client.run_on_scheduler(
        lambda dask_scheduler: {task.state for task in dask_scheduler.tasks.values()}
    )
    return found


def idle(client: Any) -> bool:
    """Whether nothing is under way or waits.

    Dask holds on to errors, and now and then to the rows of a block that finished just when it was
    cancelled.
    """
    return not any(client.processing().values()) and states(client) <= {"erred", "memory"}


@pytest.mark.parametrize("kind", KINDS)
def test_a_cluster_gives_the_bits_of_one_thread(executor: Any, kind: str) -> None:
    require_same(study(kind, executor=executor), kind)


def test_a_block_that_fails_is_computed_again(client: Any, executor: Any) -> None:
    def fail_once() -> None:
        from softpinch.study import engine as worker

        compute = worker.compute

        def fail(*args: Any) -> Any:
            worker.compute = compute
            raise OSError("no memory")

        worker.compute = fail

    spy = Spy(executor)
    client.run(fail_once)
    require_same(study(executor=spy))
    # An equal call would have been given the error of the first one.
    assert [call.attempt for call in spy.calls].count(2) == 2


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


def test_ctrl_c_frees_the_cluster(client: Any, executor: Any) -> None:
    def report(done: int, runs: int) -> None:
        # Two short blocks have come, so both workers are at longer ones, of half a second or so.
        if done >= 2 * BLOCK and sum(map(bool, client.processing().values())) == 2:
            raise KeyboardInterrupt

    duration = np.full(100 * BLOCK, 0.05)
    duration[: 2 * BLOCK] = 0.001
    how: dict[str, Any] = {"vary": {"duration": duration}, "dt": 1e-5, "runs": None}
    begun = time.monotonic()
    some = study("sobol", sampler="random", executor=executor, progress=report, **how)
    assert some.interrupted and not some.lost
    assert some.runs % BLOCK == 0 and 2 * BLOCK <= some.runs < 10 * BLOCK
    assert time.monotonic() - begun < 30
    few = some.run[[0, -1]]
    again = study("sobol", sampler="random", only=few, **how)
    assert some["final_state"][[0, -1]].tobytes() == again["final_state"].tobytes()
    until(lambda: idle(client))
    require_same(study(executor=executor))


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
