"""Studies on loky, an executor of processes which notices that a worker has died."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from executors import BLOCK, require_rows, require_same, study
from softpinch.support.errors import LostRunsWarning

loky = pytest.importorskip("loky")
MANY = 60 * BLOCK


@pytest.fixture(scope="module", autouse=True)
def pool() -> Iterator[None]:
    yield
    loky.get_reusable_executor().shutdown(kill_workers=True)


def two_workers() -> Any:
    return loky.get_reusable_executor(max_workers=2)


def test_a_killed_worker_ends_a_study_and_the_same_call_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Some blocks are still to be submitted when the worker dies, however fast the others are.
    monkeypatch.setattr("softpinch.study.executor.MOST_UNDER_WAY", 8)
    killed: list[int] = []

    def report(done: int, runs: int) -> None:
        if done and not killed:
            killed.append(done)
            os.kill(executor.submit(os.getpid).result(), signal.SIGKILL)

    executor = two_workers()
    with pytest.warns(LostRunsWarning, match="the executor is broken: TerminatedWorkerError"):
        some = study(
            "failures", runs=MANY, executor=executor, store=tmp_path / "study", progress=report
        )
    assert killed[0] <= some.runs < MANY and not some.interrupted
    assert sum(one.runs for one in some.lost) == MANY - some.runs
    require_rows(some, some.run, "failures", MANY)
    # It gives another executor in the place of the one that broke.
    assert two_workers() is not executor
    again = study("failures", runs=MANY, executor=two_workers, store=tmp_path / "study")
    require_same(again, "failures", MANY)
