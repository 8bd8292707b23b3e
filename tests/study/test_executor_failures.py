"""Blocks that fail are tried again; what is lost is said, and nothing else is lost with it."""

import os
import signal
import warnings
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

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
from softpinch.study import job
from softpinch.study.outcome import Lost
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
    workers=st.integers(1, 4),
    seed=st.integers(0, 2**32),
    kind=st.sampled_from(["noise", "stop_when"]),
)
def test_a_block_that_breaks_its_executor_condemns_no_other(
    deadly: set[int], workers: int, seed: int, kind: str
) -> None:
    made: list[Shuffled] = []

    def make() -> Shuffled:
        made.append(Shuffled.by_chance(seed, workers, deadly))
        return made[-1]

    if kind == "stop_when":
        # What comes after it was enough does not matter.
        needed = on_threads(kind).runs // BLOCK
        some = quiet(kind, make)
        if min(deadly) >= needed:
            require_rows(some, without(*range(needed, BLOCKS)), kind)
        return
    some = quiet("noise", make)
    require_rows(some, without(*deadly))
    reason = "failed 3 times: BrokenExecutor: a worker died"
    assert sorted(some.lost) == [lost_in(k, reason) for k in sorted(deadly)]
    # Alone the last time.
    company = [beside for executor in made for beside in executor.company]
    assert company.count(0) >= len(deadly)
    assert all(executor.shut >= 1 for executor in made)
    # Each new one is sent the scene with its first blocks.
    assert all(call.setup for executor in made for call in executor.calls[:workers])


class Stumbling(Shuffled):
    """Takes a block that raises as soon as it is there, and notes what waits beside it."""

    def __init__(self, block: int) -> None:
        self.beside: list[int] = []
        self._block = block
        super().__init__(
            lambda waiting: next((k for k, c in enumerate(waiting) if self.is_it(c)), 0)
        )

    def is_it(self, call: Call) -> bool:
        return call.block == self._block

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        if self.is_it(call):
            self.beside.append(len(self._waiting))
            raise OSError("no memory")
        return super().do(function, call)


def test_a_block_that_only_fails_does_not_keep_others_waiting() -> None:
    made: list[Stumbling] = []

    def make() -> Stumbling:
        made.append(Stumbling(1))
        return made[-1]

    some = quiet("noise", make)
    require_rows(some, without(1))
    (executor,) = made
    assert len(executor.beside) == 3 and min(executor.beside) > 0


def quiet(kind: str, make: Callable[[], Any]) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LostRunsWarning)
        return study(kind, executor=make)


def test_an_instance_that_breaks_ends_the_study_with_what_there_is(tmp_path: Path) -> None:
    with (
        Shuffled(lambda waiting: 0, 1, deadly={2}) as executor,
        pytest.warns(LostRunsWarning, match="the executor is broken: BrokenExecutor: a worker"),
    ):
        some = study(executor=executor, store=tmp_path / "study")
    require_rows(some, np.arange(2 * BLOCK))
    reason = "the executor is broken: BrokenExecutor: a worker died"
    assert some.lost == (Lost(2 * BLOCK, RUNS - 1, RUNS - 2 * BLOCK, reason),)
    np.testing.assert_array_equal(some.missing, [[2 * BLOCK, RUNS]])
    require_same(sp.Study.open(tmp_path / "study").ensemble(), runs=2 * BLOCK)
    # `vary` has a function, so all arguments are given again.
    require_same(study(executor=Inline(), store=tmp_path / "study"))


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
        some = study(runs=300 * BLOCK, executor=Hopeless() if given == "instance" else Hopeless)
    assert some.runs == 0 and some.requested == 300 * BLOCK
    assert sum(one.runs for one in some.lost) == 300 * BLOCK
    assert len(submitted) < 50
    assert all("no way" in str(one.message) for one in said)
    assert np.isnan(some.probability().value)


def test_blocks_that_fail_here_and_there_do_not_end_it() -> None:
    executor = Failing(lambda block, attempt: block % 2 == 1)
    with pytest.warns(LostRunsWarning):
        some = study("check_dt", runs=80 * BLOCK, executor=executor)
    assert some.runs == 40 * BLOCK
    # In their order, though several fail in one turn.
    assert [one.first for one in some.lost] == list(range(BLOCK, 80 * BLOCK, 2 * BLOCK))
    assert some.discretisation is not None and some.discretisation["final_state"].runs == 256


def test_an_executor_that_was_shut_down_computes_nothing_and_says_so() -> None:
    pool = ThreadPoolExecutor(2)
    pool.shutdown()
    with pytest.warns(LostRunsWarning, match="cannot schedule new futures after shutdown"):
        some = study(executor=pool)
    assert some.runs == 0
    # A class and a function come back to life.
    require_same(study(executor=lambda: ThreadPoolExecutor(2)))


def test_an_executor_that_is_shut_down_in_the_middle_keeps_what_came() -> None:
    pool = ThreadPoolExecutor(1)
    with pytest.warns(LostRunsWarning, match="cannot schedule new futures after shutdown"):
        some = study(
            runs=40 * BLOCK,
            executor=pool,
            progress=lambda done, runs: pool.shutdown(wait=False) if done else None,
        )
    assert 0 < some.runs < 40 * BLOCK
    require_rows(some, some.run, runs=40 * BLOCK)


class Closed(Inline):
    """Dask's, of a client that is closed after some blocks: those that it has stay pending."""

    def __init__(self, blocks: int) -> None:
        super().__init__()
        self.blocks = blocks
        self._client = self
        self.status = "running"

    def nthreads(self) -> dict[str, int]:
        return {"tcp://worker": 2}

    def submit(self, function: Callable[..., Any], /, *args: Any, **how: Any) -> Future[Any]:
        if len(self.calls) < self.blocks:
            return super().submit(function, *args, **how)
        self.status = "closed"
        return Future()


def test_blocks_of_a_closed_client_are_not_waited_for() -> None:
    with pytest.warns(LostRunsWarning, match="its Dask client is closed"):
        some = study(executor=Closed(1))
    require_rows(some, np.arange(BLOCK))


def test_a_submit_that_raises_now_and_then_while_others_fly_costs_nothing() -> None:
    class Full(Shuffled):
        def submit(self, function: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:
            if len(self._waiting) >= 2:
                raise RuntimeError("the queue is full")
            return super().submit(function, *args)

    with Full(lambda waiting: 0, 2) as executor:
        require_same(study(executor=executor))


@pytest.mark.parametrize("nothing", [lambda: None, lambda: 3, dict], ids=["None", "3", "dict"])
def test_a_function_that_gives_no_executor_is_an_error(nothing: Callable[[], Any]) -> None:
    with pytest.raises(TypeError, match=r"executor: the function gave .*must give a concurrent"):
        study(executor=nothing)


@pytest.mark.parametrize("second", ["raises", "gives nothing", "interrupts"])
def test_a_function_that_fails_the_second_time_keeps_what_came(second: str) -> None:
    made: list[Shuffled] = []

    def make() -> Any:
        if made:
            if second == "raises":
                raise OSError("no more nodes")
            if second == "gives nothing":
                return None
        made.append(Shuffled(lambda waiting: 0, 1, deadly={1}))
        if second == "interrupts" and len(made) > 1:
            os.kill(os.getpid(), signal.SIGINT)
        return made[-1]

    if second == "interrupts":
        some = study(executor=make)
        assert some.interrupted and not some.lost
    else:
        with pytest.warns(LostRunsWarning, match="the executor is broken: .*died; the function"):
            some = study(executor=make)
        expected = "no more nodes" if second == "raises" else "gave None"
        assert expected in some.lost[0].reason
    require_rows(some, np.arange(BLOCK))


def test_a_function_that_fails_at_once_says_so() -> None:
    def make() -> Any:
        raise OSError("no nodes")

    with pytest.raises(OSError, match="no nodes"):
        study(executor=make)


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
    assert len(executor.calls) <= 6
    assert sp.Study.open(tmp_path / "study").runs == 2 * BLOCK
    require_same(study(executor=Inline(), store=tmp_path / "study"))


def test_what_came_is_known_also_where_it_was_too_much_to_note_one_by_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Broken(Inline):
        def do(self, function: Callable[..., Any], call: Call) -> Any:
            if call.block >= 3:
                raise BrokenExecutor("over")
            return super().do(function, call)

    monkeypatch.setattr(job, "_APART", 1)
    with pytest.warns(LostRunsWarning, match="the executor is broken: BrokenExecutor: over"):
        some = study(executor=Broken())
    assert some.runs == 3 * BLOCK
    assert [(one.first, one.last) for one in some.lost] == [(3 * BLOCK, RUNS - 1)]


class Coarse(Inline):
    """Its workers fail at smaller steps."""

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        if call.piece.refine > 1:
            raise RuntimeError("too small")
        return super().do(function, call)


def test_that_check_dt_has_come_to_nothing_is_said() -> None:
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
        Shuffled(lambda waiting: 0, 1) as executor,
        pytest.raises(StoreError, match="no space left"),
    ):
        study(executor=executor, store=tmp_path / "study")
    assert len(executor.order) < BLOCKS
    assert os.path.exists(executor.calls[0].end)
    monkeypatch.undo()
    require_same(study(executor=Inline(), store=tmp_path / "study"))
