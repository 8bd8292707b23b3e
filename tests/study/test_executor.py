"""Any executor gives the bits of threads, in any order; little travels, and little is under way."""

import math
import os
import pickle
import random
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from executors import (
    BLOCK,
    KINDS,
    RUNS,
    SHAKEN,
    SHOVED,
    Call,
    Inline,
    Shuffled,
    on_threads,
    require_same,
    study,
)
from softpinch.study import engine as executors
from softpinch.study import engine as worker
from softpinch.study.results import Ensemble
from softpinch.study.rows import Rows, Spans

BLOCKS = math.ceil(RUNS / BLOCK)


@pytest.mark.parametrize("kind", KINDS)
def test_the_kinds_of_studies_say_something(kind: str) -> None:
    some = on_threads(kind)
    assert some.runs > 0
    if kind == "failures":
        assert set(some.counts()) == {"completed", "separated"}
    if kind == "stop_when":
        # In the middle: neither the first block nor the last decides.
        assert BLOCK < some.runs < RUNS - BLOCK


@settings(max_examples=15)
@given(
    kind=st.sampled_from(sorted(KINDS)),
    seed=st.integers(0, 2**32),
    most=st.integers(1, 8),
)
def test_any_order_of_completion_gives_the_bits_of_threads(kind: str, seed: int, most: int) -> None:
    with mock.patch.object(executors, "MOST_UNDER_WAY", most), Shuffled.by_chance(seed) as executor:
        require_same(study(kind, executor=executor), kind)


@pytest.mark.parametrize("kind", ["noise", "only", "stop_when"])
def test_a_store_filled_by_an_executor_has_the_same_rows(tmp_path: Path, kind: str) -> None:
    with Shuffled.by_chance(3) as executor:
        stored = study(kind, executor=executor, store=tmp_path / "study")
    require_same(stored, kind)
    assert stored.complete == (kind != "only" and kind != "stop_when")


def test_blocks_hold_the_runs_between_multiples_of_1024() -> None:
    executor = Inline()
    study(executor=executor)
    sent = [call.runs.run for call in executor.calls]
    assert [len(numbers) for numbers in sent] == [BLOCK] * (BLOCKS - 1) + [RUNS % BLOCK]
    np.testing.assert_array_equal(np.concatenate(sent), np.arange(RUNS))
    some = Inline()
    study("only", executor=some)
    sent = [call.runs.run for call in some.calls]
    np.testing.assert_array_equal(np.concatenate(sent), np.arange(0, RUNS, 3))
    assert all(len(set((numbers // BLOCK).tolist())) == 1 for numbers in sent)


class Drawn:
    """Pieces that count how many of them were asked for, and rows how many came."""

    def __init__(self, blocks: int) -> None:
        self.blocks = blocks
        self.drawn = self.accepted = self.ahead = 0

    def __iter__(self) -> Iterator[Rows]:
        for k in range(self.blocks):
            self.drawn += 1
            self.ahead = max(self.ahead, self.drawn - self.accepted)
            yield Rows(columns={"run": np.arange(k * BLOCK, k * BLOCK + 2, dtype=np.uint64)})

    def accept(self, rows: Rows) -> bool:
        self.accepted += bool(len(rows))
        return False


@pytest.mark.parametrize("in_order", [False, True])
@pytest.mark.parametrize("most", [1, 7, executors.MOST_UNDER_WAY])
def test_a_bounded_number_of_blocks_is_drawn_sent_and_kept_waiting(
    in_order: bool, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocks = most + 50
    pieces = Drawn(blocks)
    monkeypatch.setattr(executors, "MOST_UNDER_WAY", most)

    def first_block_last(waiting: list[Call]) -> int:
        return 1 if waiting[0].block == 0 and len(waiting) > 1 else 0

    # A study that may stop early accepts its blocks in their order.
    spec = replace(on_threads("check_dt")._spec, stop_when={"holds": 1e-9} if in_order else {})
    asked = Spans.upto(blocks * BLOCK)
    with Shuffled(first_block_last) as executor:
        _, lost = executors.on_executor(
            spec, pieces, asked, executor, 1, lambda *_: None, pieces.accept
        )
    assert not lost and pieces.accepted == pieces.drawn == blocks
    assert pieces.ahead == most >= executor.most


def test_rows_are_accepted_while_the_first_blocks_are_still_being_submitted() -> None:
    pieces = Drawn(20)
    spec, asked = on_threads("check_dt")._spec, Spans.upto(20 * BLOCK)
    executors.on_executor(spec, pieces, asked, Inline(), 1, lambda *_: None, pieces.accept)
    assert pieces.accepted == 20 and pieces.ahead == 1


def test_pickles_are_small() -> None:
    some = on_threads()
    assert len(pickle.dumps(SHAKEN)) < 1500
    assert len(pickle.dumps(some._spec)) < 3000
    columns = sum(values.nbytes for values in some._rows.columns.values())
    pickled = pickle.dumps(some)
    # The words of each run's end beside them.
    assert len(pickled) < 1.2 * columns
    again = pickle.loads(pickled)
    assert isinstance(again, Ensemble)
    require_same(again)


def test_no_two_calls_are_equal_not_even_a_second_attempt_or_another_study() -> None:
    class Stumbling(Inline):
        def do(self, function: Callable[..., Any], call: Call) -> Any:
            if len(self.calls) == 3:
                raise OSError("no memory")
            return super().do(function, call)

    executor = Stumbling()
    for _ in range(2):
        require_same(study(executor=executor))
    assert len(executor.calls) == 2 * BLOCKS + 1
    assert len({pickle.dumps(tuple(call)) for call in executor.calls}) == len(executor.calls)


def cores(count: int) -> Callable[[int], set[int]]:
    return lambda pid: set(range(count))


def test_a_worker_uses_no_more_threads_than_it_has_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    used = []
    compute = worker.compute

    def spy(spec: Any, block: Any, threads: int, watch: Any) -> Rows:
        used.append(threads)
        return compute(spec, block, threads, watch)

    monkeypatch.setattr(worker, "compute", spy)
    monkeypatch.setattr(os, "sched_getaffinity", cores(1))
    require_same(study(executor=Inline(), threads=7))
    monkeypatch.setattr(os, "sched_getaffinity", cores(3))
    require_same(study(executor=Inline(), threads=2))
    require_same(study(executor=Inline(), threads=7))
    require_same(study(executor=Inline()))
    assert used == [1] * BLOCKS + [2] * BLOCKS + [3] * BLOCKS + [1] * BLOCKS


@pytest.mark.parametrize("kind", ["noise", "stop_when"])
def test_progress_reports_the_accepted_runs(kind: str) -> None:
    told: list[tuple[int, int]] = []
    with Shuffled.by_chance(6) as executor:
        some = study(kind, executor=executor, progress=lambda *now: told.append(now))
    assert told[0] == (0, RUNS) and told[-1] == (some.runs, RUNS)
    assert told == sorted(told) and {done % BLOCK for done, _ in told} <= {0, RUNS % BLOCK}


def test_a_study_can_be_started_from_another_thread() -> None:
    found = []
    with ThreadPoolExecutor(2) as pool:
        thread = threading.Thread(target=lambda: found.append(study(executor=pool)))
        thread.start()
        thread.join()
    require_same(found[0])


def test_a_function_or_a_class_makes_executors_and_they_are_shut_down() -> None:
    made: list[Inline] = []

    def make() -> Inline:
        made.append(Inline())
        return made[-1]

    require_same(study(executor=make))
    assert [executor.shut for executor in made] == [1]
    require_same(study(executor=Inline))
    # What is given is its owner's.
    mine = Inline()
    require_same(study(executor=mine))
    assert mine.shut == 0


def test_runs_that_are_enough_end_it_and_blocks_that_have_not_begun_are_cancelled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(executors, "MOST_UNDER_WAY", 24)
    draw = random.Random(4)
    with Shuffled(lambda waiting: draw.randrange(len(waiting))) as executor:
        some = study("stop_when", executor=executor, runs=200 * BLOCK)
        assert all(future.cancelled() for future, _, _ in list(executor.waiting))
    assert some.runs == on_threads("stop_when").runs and not some.lost
    assert len(executor.calls) < 100


@pytest.mark.parametrize("given", [5, "processes", [Inline()]], ids=["number", "text", "list"])
def test_a_wrong_executor_is_refused_before_anything_is_drawn(given: object) -> None:
    drawn = []

    def draw(generator: np.random.Generator) -> float:
        drawn.append(1)
        return 9.81

    with pytest.raises(TypeError, match=r"^executor = .*must be a concurrent.futures.Executor or"):
        sp.monte_carlo(SHOVED, 3, vary={"gravity": draw}, executor=given)  # type: ignore[arg-type]
    # One is drawn to know its shape.
    assert len(drawn) <= 1


def test_a_client_of_dask_is_told_from_its_executor() -> None:
    client = SimpleNamespace(submit=None, get_executor=None)
    with pytest.raises(TypeError, match=r"is a Dask client; pass its get_executor\(\)"):
        sp.monte_carlo(SHOVED, 3, executor=client)  # type: ignore[call-overload]
