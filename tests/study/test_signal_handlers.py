"""What a user's signal handler raises reaches the user, and passes for nothing else."""

import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from executors import BLOCK, Call, Inline, require_rows, study
from softpinch.study import array_files
from softpinch.support import extras
from softpinch.support.interrupt import handlers_waiting
from stores import TINY, require_whole, tiny

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="has no SIGALRM")


class Deadline(OSError):
    """A user's own."""


KINDS: list[type[BaseException]] = [TimeoutError, Deadline, RuntimeError, SystemExit]


@contextmanager
def raising(kind: type[BaseException]) -> Iterator[type[BaseException]]:
    """The handler of SIGALRM raises this exception."""

    def handle(number: int, frame: object) -> None:
        raise kind("deadline")

    before = signal.signal(signal.SIGALRM, handle)
    try:
        yield kind
    finally:
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(params=KINDS, ids=lambda one: one.__name__)
def late(request: pytest.FixtureRequest) -> Iterator[type[BaseException]]:
    """What the handler of SIGALRM raises, which is installed."""
    with raising(request.param) as kind:
        yield kind


def alarm() -> None:
    os.kill(os.getpid(), signal.SIGALRM)


class Interrupted(Inline):
    """A signal comes in the middle of the second time that it is asked for something."""

    def __init__(self, place: str) -> None:
        super().__init__()
        self.place = place

    def submit(self, function: Callable[..., Any], /, *args: Any, **how: Any) -> Future[Any]:
        if self.place == "submit" and len(self.calls) == 1:
            alarm()
        return super().submit(function, *args, **how)

    def do(self, function: Callable[..., Any], call: Call) -> Any:
        if self.place == "work" and len(self.calls) == 2:
            alarm()
        return super().do(function, call)


@pytest.mark.parametrize("place", ["submit", "work"])
def test_it_is_no_failure_of_an_executor(late: type[BaseException], place: str) -> None:
    executor = Interrupted(place)
    with pytest.raises(late, match="deadline"):
        study(executor=executor, runs=4 * BLOCK)
    assert len(executor.calls) <= 4


def test_it_is_no_failure_of_the_function_that_makes_executors(late: type[BaseException]) -> None:
    with pytest.raises(late, match="deadline"):
        study(executor=alarm)


def test_it_ends_the_waiting_for_a_block_and_keeps_what_was_accepted(
    late: type[BaseException], tmp_path: Path
) -> None:
    class Slow(Inline):
        """Its second block never comes."""

        def submit(self, function: Callable[..., Any], /, *args: Any, **how: Any) -> Future[Any]:
            if not self.calls:
                return super().submit(function, *args, **how)
            threading.Timer(0.2, alarm).start()
            return Future()

    with pytest.raises(late, match="deadline"):
        study("failures", executor=Slow(), runs=2 * BLOCK, store=tmp_path / "study")
    require_rows(sp.Study.open(tmp_path / "study"), np.arange(BLOCK), "failures")


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


def interrupt_at(
    late: type[BaseException],
    name: str,
    at: int,
    begun: Path,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> bool:
    """Goes on with a copy of a study, with a signal in one call; whether there were as many."""
    shutil.copytree(begun, folder)
    came = True
    with monkeypatch.context() as patch, raising(late):
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
            came = False
    # Nothing was lost but what had not been written yet, and nobody has the lock.
    tiny(folder, trajectories=(1,)).verify()
    require_whole(folder)
    return came


OS_CALLS = ["fsync", "replace", "open", "listdir", "lstat", "fstat", "truncate", "write", "close"]


@pytest.mark.usefixtures("small_parts")
@pytest.mark.parametrize("name", OS_CALLS)
def test_it_is_no_fault_of_a_study_s_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At every call in turn, with one exception after the other; with all at each it is slow."""
    tiny(tmp_path / "begun", TINY - BLOCK, trajectories=(1,))
    for at in count(1):
        # Next to each other: calls often come in pairs.
        late = KINDS[(at + at // len(KINDS)) % len(KINDS)]
        folder = tmp_path / f"{at}"
        if not interrupt_at(late, name, at, tmp_path / "begun", folder, monkeypatch):
            break
    assert at > 1


@pytest.mark.slow
@pytest.mark.usefixtures("small_parts")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", OS_CALLS)
def test_it_is_no_fault_of_a_study_s_folder_whatever_is_raised(
    kind: type[BaseException], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny(tmp_path / "begun", TINY - BLOCK, trajectories=(1,))
    for at in count(1):
        folder = tmp_path / f"{at}"
        if not interrupt_at(kind, name, at, tmp_path / "begun", folder, monkeypatch):
            break
    assert at > 1


def test_it_is_no_damage_of_an_array_or_a_link(
    late: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.save(tmp_path / "array.npy", np.ones(3))

    def interrupted(*args: Any, **how: Any) -> None:
        alarm()

    monkeypatch.setattr(np, "load", interrupted)
    with pytest.raises(late, match="deadline"):
        array_files.load(tmp_path / "array.npy", "0" * 64)


@pytest.mark.parametrize("importing", ["require", "load"])
def test_it_is_not_lost_in_an_import(
    late: type[BaseException], importing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in compiled modules, some of which pass over whatever is raised in them."""
    (tmp_path / "swallowing.py").write_text(
        "import os, signal\n"
        "try:\n"
        "    os.kill(os.getpid(), signal.SIGALRM)\n"
        "except BaseException:\n"
        "    pass\n"
        "whole = True\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    imports: dict[str, Callable[[], Any]] = {
        "require": lambda: extras.require("swallowing", extra="study"),
        "load": lambda: extras.load("swallowing"),
    }
    before = signal.getsignal(signal.SIGALRM)
    try:
        with pytest.raises(late, match="deadline"):
            imports[importing]()
        assert signal.getsignal(signal.SIGALRM) is before
        # It is there, and nobody has to wait for it again.
        assert imports[importing]().whole
    finally:
        sys.modules.pop("swallowing", None)


def test_each_of_several_signals_reaches_its_handler() -> None:
    came: list[int] = []

    def handle(number: int, frame: object) -> None:
        came.append(number)
        raise TimeoutError(f"{number}")

    numbers = {signal.SIGALRM, signal.SIGUSR1, signal.SIGINT}
    before = {number: signal.signal(number, handle) for number in numbers}
    try:
        with pytest.raises(TimeoutError), handlers_waiting():
            for number in numbers:
                signal.raise_signal(number)
            assert not came
        assert set(came) == numbers and len(came) == len(numbers)
        assert all(signal.getsignal(number) is handle for number in numbers)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# Each child is as far as `import softpinch`, and its signal comes somewhere in what follows.
IMPORTING = """
import os, signal, sys, time
import softpinch as sp

scene = sp.Scene(duration=0.01)
vary = {"gravity": sp.Normal(9.8, 0.1)}
work = {
    "scipy": lambda: sp.stabilization_sweep(scene, 1e-3, products=[0.1]),
    "sobol": lambda: sp.monte_carlo(scene, 8, vary=vary, sampler="sobol", progress=False),
    "store": lambda: sp.monte_carlo(
        scene, 8, vary=vary, progress=False, store=f"{sys.argv[2]}/{os.getpid()} {time.time()}"
    ),
}[sys.argv[1]]
signal.signal(signal.SIGALRM, lambda number, frame: sys.exit(7))
codes = []
for k in range(int(sys.argv[3])):
    child = os.fork()
    if not child:
        signal.setitimer(signal.ITIMER_REAL, 0.001 + 0.192 / int(sys.argv[3]) * k)
        end = time.monotonic() + 2.0
        try:
            while time.monotonic() < end:
                work()
            print("lost", flush=True)
        except SystemExit as error:
            os._exit(error.code)
        except BaseException as error:
            print(repr(error), flush=True)
        os._exit(1)
    codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(codes)
"""


# How many instants are tried.
@pytest.mark.parametrize("instants", [4, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.parametrize("work", ["scipy", "sobol", "store"])
def test_a_deadline_ends_whatever_is_being_imported(
    work: str, instants: int, tmp_path: Path
) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", IMPORTING, work, f"{tmp_path}", f"{instants}"],
        capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert done.stdout == f"{[7] * instants}\n", done.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="has other locks")
def test_it_leaves_no_lock_behind_that_nobody_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fcntl

    lockf = fcntl.lockf
    there = "import sys, stores; [stores.tiny(folder) for folder in sys.argv[1:]]"
    folders = [tmp_path / kind.__name__ for kind in KINDS]

    def taken(*args: Any) -> None:
        lockf(*args)
        alarm()

    for kind, folder in zip(KINDS, folders, strict=True):
        with monkeypatch.context() as patch, raising(kind):
            patch.setattr(fcntl, "lockf", taken)
            with pytest.raises(kind, match="deadline"):
                tiny(folder)
    # Another process may have them at once, though this one goes on.
    subprocess.run(
        [sys.executable, "-c", there, *map(str, folders)],
        check=True, timeout=100, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
