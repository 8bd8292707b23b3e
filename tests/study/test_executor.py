"""Any executor gives the bits of threads, in any order; little travels, and little is under way."""

import math
import os
import pickle
import random
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

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
    Worker,
    on_threads,
    require_same,
    study,
)
from softpinch.study import worker
from softpinch.study.engine import Piece
from softpinch.study.executor import on_executor
from softpinch.study.pool import Pool
from softpinch.study.results import Ensemble
from softpinch.study.rows import Rows

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


@settings(max_examples=60)
@given(
    kind=st.sampled_from(sorted(KINDS)),
    seed=st.integers(0, 2**32),
    workers=st.integers(1, 5),
)
def test_any_order_of_completion_gives_the_bits_of_threads(
    kind: str, seed: int, workers: int
) -> None:
    with Shuffled.by_chance(seed, workers) as executor:
        require_same(study(kind, executor=executor), kind)


@pytest.mark.parametrize("choose", [lambda waiting: 0, lambda waiting: -1], ids=["first", "last"])
@pytest.mark.parametrize("kind", ["noise", "stop_when"])
def test_the_first_and_the_last_that_waits_come_first(
    kind: str, choose: Callable[[list[Call]], int]
) -> None:
    with Shuffled(choose, workers=2) as executor:
        require_same(study(kind, executor=executor), kind)
    if choose([]) == -1:
        assert executor.order != sorted(executor.order)


@pytest.mark.parametrize("kind", ["noise", "only", "stop_when"])
def test_a_store_filled_by_an_executor_has_the_same_rows(tmp_path: Path, kind: str) -> None:
    with Shuffled.by_chance(3, 3) as executor:
        stored = study(kind, executor=executor, store=tmp_path / "study")
    require_same(stored, kind)
    assert stored.complete == (kind != "only" and kind != "stop_when")


def test_blocks_hold_the_runs_between_multiples_of_1024() -> None:
    executor = Inline()
    study(executor=executor)
    sent = [call.piece.numbers for call in executor.calls]
    assert [len(numbers) for numbers in sent] == [BLOCK] * (BLOCKS - 1) + [RUNS % BLOCK]
    np.testing.assert_array_equal(np.concatenate(sent), np.arange(RUNS))
    some = Inline()
    study("only", executor=some)
    sent = [call.piece.numbers for call in some.calls]
    np.testing.assert_array_equal(np.concatenate(sent), np.arange(0, RUNS, 3))
    assert all(len(set((numbers // BLOCK).tolist())) == 1 for numbers in sent)


def test_blocks_of_a_store_are_no_larger_however_fast_they_come(tmp_path: Path) -> None:
    executor = Inline()
    study(runs=40 * BLOCK, executor=executor, store=tmp_path / "study")
    assert {len(call.piece.numbers) for call in executor.calls} == {BLOCK}


class Drawn:
    """Pieces that count how many of them were asked for, and rows how many came."""

    def __init__(self, blocks: int) -> None:
        self.blocks = blocks
        self.drawn = self.accepted = self.ahead = 0

    def __iter__(self) -> Iterator[Piece]:
        for k in range(self.blocks):
            self.drawn += 1
            self.ahead = max(self.ahead, self.drawn - self.accepted)
            yield Piece(np.arange(k * BLOCK, k * BLOCK + 2, dtype=np.uint64), {})

    def accept(self, rows: Rows) -> bool:
        self.accepted += bool(len(rows))
        return False


@pytest.mark.parametrize("in_order", [False, True])
@pytest.mark.parametrize("workers", [1, 4])
def test_not_all_is_sent_or_drawn_at_once(in_order: bool, workers: int) -> None:
    blocks = 100 * workers
    setup = on_threads("check_dt")._setup
    pieces = Drawn(blocks)

    def first_block_last(waiting: list[Call]) -> int:
        late = pieces.drawn < blocks - 1 and len(waiting) > 1
        return 1 if late and waiting[0].block == 0 else 0

    with Shuffled(first_block_last, workers) as executor:
        on_executor(
            setup,
            pieces,
            2 * blocks,
            executor,
            None,
            lambda *_: None,
            pieces.accept,
            in_order,
        )
    assert pieces.accepted == pieces.drawn == blocks
    assert workers < executor.most <= 3 * workers
    assert pieces.ahead <= (16 if in_order else 4) * workers
    if in_order:
        # What came had to wait for the first one, and took the room of others.
        assert executor.order.index(0) > 3 * workers


def large_scene() -> sp.Scene:
    times = np.linspace(0.0, 20.0, 20_000)
    push = sp.Sampled(times=times, force=np.ones((len(times), 2)), moment=0.0 * times, hold="zero")
    return sp.Scene(duration=0.02, disturbances=[push])


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_the_scene_goes_once_to_each_worker_and_a_block_adds_its_numbers(workers: int) -> None:
    scene = large_scene()
    executor = Inline(workers)
    some = sp.monte_carlo(
        scene,
        9 * BLOCK,
        vary={"grasped.mass": sp.Normal(0.1, 0.01), "control.kp": sp.Normal(100, 1)},
        dt=1e-3,
        executor=executor,
        progress=False,
    )
    assert some.runs == 9 * BLOCK
    sizes = [len(pickle.dumps(tuple(call))) for call in executor.calls]
    scene_size = len(pickle.dumps(scene))
    assert scene_size > 500_000
    large = [size for size in sizes if size > scene_size / 2]
    assert len(large) == workers and max(large) < 1.1 * scene_size
    # The number of each run and its two values, and some words.
    assert sorted(sizes)[-workers - 1] < 8 * 3 * BLOCK + 1500


def test_a_worker_that_does_not_know_the_scene_is_sent_it() -> None:
    class Forgetful(Inline):
        def do(self, function: Callable[..., Any], call: Call) -> Any:
            if len(self.calls) in (3, 4, 7):
                self.workers = [Worker(), Worker()]
            return super().do(function, call)

    executor = Forgetful()
    require_same(study(executor=executor))
    assert len(executor.calls) > BLOCKS
    assert (
        sum(call.setup is not None for call in executor.calls) == 2 + len(executor.calls) - BLOCKS
    )


def test_a_worker_keeps_the_scenes_of_several_studies_apart() -> None:
    executor = Inline(1)
    for kind in ("noise", "failures", "noise", "dop853", "failures"):
        require_same(study(kind, executor=executor), kind)
    # Of more than it keeps it forgets the first.
    for gravity in np.linspace(9.0, 10.0, 12):
        sp.monte_carlo(sp.Scene(duration=0.001, gravity=gravity), 2, executor=executor)
    assert len(executor.workers[0].known) == 8
    executor.calls.clear()
    require_same(study(executor=executor))


def test_what_travels_is_small() -> None:
    some = on_threads()
    assert len(pickle.dumps(SHAKEN)) < 1500
    assert len(pickle.dumps(some._setup)) < 3000
    columns = sum(values.nbytes for values in some._rows.columns.values())
    pickled = pickle.dumps(some)
    # The words of each run's end beside them.
    assert len(pickled) < 1.2 * columns
    again = pickle.loads(pickled)
    assert isinstance(again, Ensemble)
    require_same(again)


def test_calls_differ_also_where_all_they_compute_is_the_same() -> None:
    executor = Inline()
    study(executor=executor)
    study(executor=executor)
    assert len({call.ticket for call in executor.calls}) == len(executor.calls)


def cores(count: int) -> Callable[[int], set[int]]:
    return lambda pid: set(range(count))


def test_workers_share_the_cores_of_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", cores(8))
    with (
        ProcessPoolExecutor(1) as one,
        ProcessPoolExecutor(3) as three,
        ThreadPoolExecutor(4) as four,
        ProcessPoolExecutor(20) as twenty,
    ):
        assert [Pool(pool).threads(None) for pool in (one, three, four, twenty)] == [8, 2, 2, 1]
        assert Pool(three).threads(5) == 5
    # Nothing is known of how many workers share a machine elsewhere.
    assert Pool(Inline(1)).threads(None) == 1


def test_a_worker_uses_no_more_threads_than_it_has_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    used = []
    compute = worker.compute

    def spy(setup: Any, piece: Any, threads: int, watch: Any) -> Rows:
        used.append(threads)
        return compute(setup, piece, threads, watch)

    monkeypatch.setattr(worker, "compute", spy)
    monkeypatch.setattr(os, "sched_getaffinity", cores(1))
    require_same(study(executor=Inline(), threads=7))
    monkeypatch.setattr(os, "sched_getaffinity", cores(3))
    require_same(study(executor=Inline(), threads=2))
    require_same(study(executor=Inline(), threads=7))
    assert used == [1] * BLOCKS + [2] * BLOCKS + [3] * BLOCKS


@pytest.mark.parametrize("kind", ["noise", "stop_when"])
def test_progress_hears_the_truth(kind: str) -> None:
    told: list[tuple[int, int]] = []
    with Shuffled.by_chance(6, 3) as executor:
        some = study(kind, executor=executor, progress=lambda *now: told.append(now))
    assert told[0] == (0, RUNS) and told[-1] == (some.runs, RUNS)
    assert told == sorted(told) and {done % BLOCK for done, _ in told} <= {0, RUNS % BLOCK}


def test_another_thread_than_the_main_one_may_ask() -> None:
    found = []
    with ThreadPoolExecutor(2) as pool:
        thread = threading.Thread(target=lambda: found.append(study(executor=pool)))
        thread.start()
        thread.join()
    require_same(found[0])


def test_two_studies_at_once_on_one_executor() -> None:
    found: dict[str, Any] = {}
    with ThreadPoolExecutor(3) as pool:

        def ask(kind: str) -> None:
            found[kind] = study(kind, executor=pool)

        threads = [threading.Thread(target=ask, args=(kind,)) for kind in ("noise", "failures")]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    for kind, some in found.items():
        require_same(some, kind)
    assert len(found) == 2


def test_a_function_or_a_class_makes_executors_and_they_are_shut_down() -> None:
    made: list[Inline] = []

    def make() -> Inline:
        made.append(Inline(3))
        return made[-1]

    require_same(study(executor=make))
    assert [executor.shut for executor in made] == [1]
    require_same(study(executor=Inline))
    # What is given is its owner's.
    mine = Inline()
    require_same(study(executor=mine))
    assert mine.shut == 0


def test_runs_that_are_enough_end_it_and_what_was_on_its_way_is_taken_back() -> None:
    draw = random.Random(4)
    with Shuffled(lambda waiting: draw.randrange(len(waiting)), 4) as executor:
        some = study("stop_when", executor=executor, runs=200 * BLOCK)
        assert all(future.cancelled() for future, _, _ in list(executor._waiting))
    assert some.runs == on_threads("stop_when").runs
    assert len(executor.calls) < 100
    # Whoever takes a block up after that stops at once, however long it is.
    long = replace(some._setup, options=replace(some._setup.options, dt=1e-9))
    late = executor.calls[-1]._replace(setup=pickle.dumps(long), key="long")
    assert os.path.exists(late.end)
    assert len(Worker().do(worker.work, late)) == 0


def test_a_study_that_ends_by_itself_leaves_no_sign() -> None:
    executor = Inline()
    study(executor=executor)
    assert not os.path.exists(executor.calls[0].end)


@pytest.mark.parametrize("given", [5, "processes", [Inline()]], ids=["number", "text", "list"])
def test_what_is_no_executor_is_refused_before_anything_is_drawn(given: object) -> None:
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


def test_threads_are_checked_with_an_executor_too() -> None:
    with pytest.raises(ValueError, match="threads = 0"):
        study(executor=Inline(), threads=0)
