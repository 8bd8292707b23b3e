"""Blocks that fail are tried again; what is lost is said, and nothing else is lost with it."""

import pickle
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from executors import (
    BLOCK,
    RUNS,
    Call,
    Inline,
    Shuffled,
    on_threads,
    require_rows,
    require_same,
    study,
)
from softpinch import _core
from softpinch.study import engine as executors
from softpinch.study.engine import Lost
from softpinch.support.errors import LostRunsWarning, StoreError

BLOCKS = -(-RUNS // BLOCK)


def without(*blocks: int) -> np.ndarray:
    numbers = np.arange(RUNS)
    return numbers[~np.isin(numbers // BLOCK, blocks)]


def lost_in(block: int, reason: str) -> Lost:
    first, last = BLOCK * block, min(BLOCK * (block + 1), RUNS) - 1
    return Lost(first, last, last + 1 - first, reason)


class Failing(Inline):
    """Some attempts at some blocks raise."""

    def __init__(
        self, fails: Callable[[int, int], bool], error: type[BaseException] = OSError
    ) -> None:
        super().__init__()
        self._fails, self._error = fails, error

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        if self._fails(call.block, self.attempts(call.block)):
            raise self._error("no memory")
        return super().do(function, call)


@pytest.mark.parametrize(
    "error", [OSError, MemoryError, CancelledError, KeyboardInterrupt, SystemExit], ids=str
)
def test_a_block_that_fails_twice_is_not_lost(error: type[BaseException]) -> None:
    executor = Failing(lambda block, attempt: block == 2 and attempt <= 2, error)
    require_same(study(executor=executor))
    assert [executor.attempts(k) for k in range(BLOCKS)] == [1, 1, 3, 1, 1, 1]


@pytest.mark.parametrize("block", [0, 3, BLOCKS - 1])
def test_a_block_that_fails_three_times_is_reported_and_the_rest_kept(block: int) -> None:
    executor = Failing(lambda which, attempt: which == block)
    with pytest.warns(LostRunsWarning) as said:
        some = study(executor=executor)
    assert some.lost == (lost_in(block, "failed 3 times: OSError: no memory"),)
    assert [str(one.message) for one in said] == [f"lost {some.lost[0]}"]
    assert executor.attempts(block) == 3
    assert not some.interrupted and some.requested == RUNS
    require_rows(some, without(block))


def test_with_a_store_what_was_lost_is_computed_when_it_is_resumed(tmp_path: Path) -> None:
    with pytest.warns(LostRunsWarning):
        some = study(
            "failures",
            executor=Failing(lambda block, attempt: block in (1, 4)),
            store=tmp_path / "study",
        )
    assert [one.first for one in some.lost] == [BLOCK, 4 * BLOCK]
    np.testing.assert_array_equal(some.missing, [[1024, 2048], [4096, 5120]])
    require_rows(some, without(1, 4), "failures")
    again = Inline()
    require_same(some.resume(executor=again, progress=False), "failures")
    assert [call.block for call in again.calls] == [1, 4]


@settings(max_examples=25)
@given(
    deadly=st.sets(st.integers(0, BLOCKS - 1), min_size=1, max_size=3),
    seed=st.integers(0, 2**32),
    most=st.integers(1, 8),
)
def test_an_executor_that_breaks_ends_the_study_with_what_there_is(
    deadly: set[int], seed: int, most: int
) -> None:
    made: list[Shuffled] = []

    def make() -> Shuffled:
        made.append(Shuffled.by_chance(seed, deadly))
        return made[-1]

    with mock.patch.object(executors, "MOST_UNDER_WAY", most), warnings.catch_warnings():
        warnings.simplefilter("ignore", LostRunsWarning)
        some = study(executor=make)
    (executor,) = made
    assert executor.shut == 1 and not some.interrupted
    # Python's pool would be stopped by that while it ends its processes.
    assert not any(future.cancelled() for future, _, _ in executor.waiting)
    require_rows(some, np.flatnonzero(np.isin(np.arange(RUNS) // BLOCK, executor.order)))
    (lost,) = some.lost
    missing = np.setdiff1d(np.arange(RUNS), some.run)
    assert lost[:3] == (missing[0], missing[-1], len(missing))
    assert lost.reason.startswith("the executor is broken: BrokenExecutor: ")


def test_after_a_break_only_goes_on_in_memory_as_the_warning_says() -> None:
    with (
        Shuffled(lambda waiting: 0, deadly={2}) as executor,
        pytest.warns(LostRunsWarning, match="else repeat the call with only="),
    ):
        some = study("only", executor=executor)
    wanted = np.arange(0, RUNS, 3)
    # It counts the runs that were asked for, not those between them.
    (lost,) = some.lost
    assert lost[:3] == (2049, wanted[-1], (wanted >= 2048).sum())
    rest = study("only", only=np.setdiff1d(wanted, some.run), executor=Inline())
    assert np.r_[some.run, rest.run].tolist() == wanted.tolist()
    both = np.concatenate([some["final_state"], rest["final_state"]])
    assert both.tobytes() == on_threads("only")["final_state"].tobytes()


@pytest.mark.parametrize("given", ["instance", "function"])
@pytest.mark.parametrize("how", ["raises", "breaks", "submit raises"])
def test_where_all_fails_it_ends_soon(how: str, given: str) -> None:
    class Hopeless(Inline):
        def submit(self, function: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
            submitted.append(1)
            if how == "submit raises":
                raise RuntimeError("no way")
            return super().submit(function, *args)

        def do(self, function: Callable[..., Any], call: Call) -> Any:
            raise BrokenExecutor("no way") if how == "breaks" else OSError("no way")

    submitted: list[int] = []
    with pytest.warns(LostRunsWarning) as said:
        executor = Hopeless() if given == "instance" else Hopeless
        some = study("failures", runs=40 * BLOCK, executor=executor)
    assert some.runs == 0 and some.requested == 40 * BLOCK
    assert sum(one.runs for one in some.lost) == 40 * BLOCK
    # Eight blocks, three times each, and no more.
    assert len(submitted) == (24 if how == "raises" else 1)
    assert all("no way" in str(one.message) for one in said)
    assert np.isnan(some.probability().value)


def test_an_executor_that_is_shut_down_in_the_middle_keeps_what_came(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(executors, "MOST_UNDER_WAY", 4)
    pool = ThreadPoolExecutor(1)
    with pytest.warns(LostRunsWarning, match="cannot schedule new futures after shutdown"):
        some = study(
            runs=20 * BLOCK,
            executor=pool,
            progress=lambda done, runs: pool.shutdown(wait=False) if done else None,
        )
    assert 0 < some.runs < 20 * BLOCK
    require_rows(some, some.run, runs=20 * BLOCK)


@pytest.mark.parametrize("nothing", [lambda: None, lambda: 3, dict], ids=["None", "3", "dict"])
def test_a_function_that_gives_no_executor_is_an_error(nothing: Callable[[], Any]) -> None:
    with pytest.raises(TypeError, match=r"executor: the function gave .*must give a concurrent"):
        study(executor=nothing)


class Elsewhere(Inline):
    """From its third block on, a worker has other bits."""

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        if len(self.calls) > 2:
            call = call._replace(version=call.version + 1)
        return super().do(function, call)


def test_another_softpinch_is_an_error_at_once_and_a_store_keeps_what_came(tmp_path: Path) -> None:
    executor = Elsewhere()
    theirs = _core.RESULTS_VERSION + 1
    with pytest.raises(
        sp.VersionMismatchError,
        match=rf"softpinch .* with results version {_core.RESULTS_VERSION}; .*version {theirs}",
    ):
        study(executor=executor, store=tmp_path / "study")
    assert len(executor.calls) == 3
    assert sp.Study.open(tmp_path / "study").runs == 2 * BLOCK
    require_same(study(executor=Inline(), store=tmp_path / "study"))


class Coarse(Inline):
    """Its workers fail at smaller steps."""

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        if pickle.loads(call.spec).options.dt < 1e-3:
            raise RuntimeError("too small")
        return super().do(function, call)


def test_lost_blocks_of_check_dt_are_reported() -> None:
    with pytest.warns(
        sp.LostRunsWarning, match=r"^check_dt: lost runs 0 to .*\(256\): .*too small"
    ):
        found = study("check_dt", executor=Coarse())
    # No row is.
    assert not found.lost and found.runs == RUNS
    assert {said.runs for said in found.discretisation.values()} == {0}


def test_rows_that_cannot_be_kept_end_it_and_take_the_others_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from softpinch.store.folder import Writer

    def full(self: Writer, rows: object) -> None:
        raise StoreError("no space left")

    monkeypatch.setattr(Writer, "add", full)
    with (
        Shuffled(lambda waiting: 0) as executor,
        pytest.raises(StoreError, match="no space left"),
    ):
        study(executor=executor, store=tmp_path / "study")
    assert all(future.cancelled() for future, _, _ in list(executor.waiting))
    monkeypatch.undo()
    require_same(study(executor=Inline(), store=tmp_path / "study"))
