"""What a user's signal handler raises reaches the user, wherever the signal comes."""

import os
import shutil
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from executors import BLOCK, Call, Inline, study
from softpinch.store import arrays
from stores import TINY, require_whole, tiny

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="has no SIGALRM")


class Deadline(OSError):
    """A user's own."""


@pytest.fixture(
    params=[TimeoutError, Deadline, RuntimeError, SystemExit], ids=lambda one: one.__name__
)
def late(request: pytest.FixtureRequest) -> Iterator[type[BaseException]]:
    """What the handler of SIGALRM raises, which is installed."""
    kind: type[BaseException] = request.param

    def handle(number: int, frame: object) -> None:
        raise kind("deadline")

    before = signal.signal(signal.SIGALRM, handle)
    yield kind
    signal.signal(signal.SIGALRM, before)


def alarm() -> None:
    os.kill(os.getpid(), signal.SIGALRM)


class Interrupted(Inline):
    """A signal comes in the middle of the second time that it is asked for something."""

    def __init__(self, place: str) -> None:
        super().__init__()
        self.place = place
        self._client = self

    def nthreads(self) -> dict[str, int]:
        if self.place == "nthreads":
            alarm()
        return {"worker": 2}

    def submit(self, function: Callable[..., Any], /, *args: Any, **how: Any) -> Future[Any]:
        if self.place == "submit" and len(self.calls) == 1:
            alarm()
        return super().submit(function, *args, **how)

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        if self.place == "work" and len(self.calls) == 2:
            alarm()
        return super().do(function, call)


@pytest.mark.parametrize("place", ["submit", "work", "nthreads"])
def test_it_is_no_failure_of_an_executor(late: type[BaseException], place: str) -> None:
    executor = Interrupted(place)
    with pytest.raises(late, match="deadline"):
        study(executor=executor, runs=4 * BLOCK)
    assert len(executor.calls) <= 4


def test_it_is_no_failure_of_the_function_that_makes_executors(late: type[BaseException]) -> None:
    class Broken(Inline):
        def do(self, function: Callable[..., Any], call: Call) -> Any:
            raise BrokenExecutor("over")

    def make() -> Broken:
        made.append(1)
        if len(made) > 1:
            alarm()
        return Broken()

    made: list[int] = []
    with pytest.raises(late, match="deadline"):
        study(executor=make)
    assert len(made) == 2


class Handler:
    def __call__(self, number: int, frame: object) -> None:
        raise TimeoutError("deadline")

    def method(self, number: int, frame: object) -> None:
        self(number, frame)

    def partial(self, more: str, number: int, frame: object) -> None:
        self(number, frame)


@pytest.mark.parametrize(
    "handler",
    [Handler(), Handler().method, partial(Handler().partial, "more")],
    ids=lambda one: type(one).__name__,
)
def test_any_kind_of_handler_is_known(handler: Callable[[int, object], None]) -> None:
    before = signal.signal(signal.SIGALRM, handler)
    try:
        with pytest.raises(TimeoutError, match="deadline"):
            study(executor=Interrupted("submit"), runs=4 * BLOCK)
    finally:
        signal.signal(signal.SIGALRM, before)


def signalling(monkeypatch: pytest.MonkeyPatch, name: str, at: int) -> list[int]:
    """A signal comes with a call of `os`, the given one; returns what counts these calls."""
    real, calls = getattr(os, name), []

    def call(*args: Any, **how: Any) -> Any:
        calls.append(at)
        if len(calls) == at:
            alarm()
        return real(*args, **how)

    monkeypatch.setattr(os, name, call)
    return calls


@pytest.mark.usefixtures("small_parts")
@pytest.mark.parametrize(
    "name", ["fsync", "replace", "open", "listdir", "lstat", "fstat", "truncate", "write", "close"]
)
def test_it_is_no_fault_of_a_study_s_folder(
    late: type[BaseException], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny(tmp_path / "begun", TINY - BLOCK, trajectories=(1,))
    for at in count(1):
        folder = tmp_path / f"{at}"
        shutil.copytree(tmp_path / "begun", folder)
        with monkeypatch.context() as patch:
            calls = signalling(patch, name, at)
            try:
                study = tiny(folder, trajectories=(1,))
                study.verify()
                assert study.trajectories[1].status == study.status[1]
            except late as error:
                assert str(error) == "deadline"
                assert not isinstance(error, sp.StoreError)
            else:
                assert len(calls) < at
                break
        # Nothing was lost but what had not been written yet, and nobody has the lock.
        tiny(folder, trajectories=(1,)).verify()
        require_whole(folder)
    assert at > 1


def test_it_is_no_damage_of_an_array_or_a_link(
    late: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.save(tmp_path / "array.npy", np.ones(3))

    def interrupted(*args: Any, **how: Any) -> None:
        alarm()

    monkeypatch.setattr(np, "load", interrupted)
    with pytest.raises(late, match="deadline"):
        arrays.load(tmp_path / "array.npy", "0" * 64)
