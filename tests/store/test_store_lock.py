"""One writes a folder at a time; whoever is killed gives it back."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import softpinch as sp
from softpinch.store import folder
from stores import TINY, require_whole, tiny

# Begins a study, forks a child once it has the lock, and stops there until a line comes.
WRITER = """
import os, sys, time
import stores
from softpinch.store import folder

folder.GATHER_SECONDS = 0
def wait(done, runs):
    if done > 1024:
        child = os.fork()
        if not child:
            time.sleep(600)
            os._exit(0)
        print(child, flush=True)
        sys.stdin.readline()

stores.tiny(sys.argv[1], threads=1, progress=wait)
"""


@contextmanager
def writer(path: Path) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    """A process that writes, and its child's number."""
    command = [sys.executable, "-c", WRITER, str(path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        try:
            yield process, child
        finally:
            process.kill()
            os.kill(child, signal.SIGKILL)


def test_a_second_process_is_refused_and_a_killed_one_frees_the_lock(tmp_path: Path) -> None:
    with writer(tmp_path) as (process, child):
        before = (tmp_path / "manifest.toml").read_bytes()
        for _ in range(2):
            with pytest.raises(
                sp.StoreError, match=f"{tmp_path}: is being written by process {process.pid} on "
            ):
                tiny(tmp_path, TINY + 5)
        assert (tmp_path / "manifest.toml").read_bytes() == before
        assert 0 < sp.Study.open(tmp_path).runs < TINY
        process.kill()
        process.wait(timeout=60)
        # At once, while what it forked lives on, with all the files that it had open.
        tiny(tmp_path)
        os.kill(child, 0)
    require_whole(tmp_path)


def test_a_second_study_of_the_same_process_is_refused(tmp_path: Path) -> None:
    given: dict[str, Any] = {"scene": sp.Scene(duration=2e-3), "dt": 1e-3}
    sp.monte_carlo(runs=5, store=tmp_path / "a", progress=False, **given)
    (tmp_path / "link").symlink_to(tmp_path / "a")
    refused = []

    def report(done: int, runs: int) -> None:
        for path in (tmp_path / "a", tmp_path / "a" / ".." / "a", tmp_path / "link"):
            with pytest.raises(sp.StoreError, match="is being written by this process"):
                sp.monte_carlo(runs=9, store=path, progress=False, **given)
            refused.append(path)

    sp.monte_carlo(runs=9, store=tmp_path / "a", progress=report, **given)
    assert len(refused) >= 6
    assert sp.Study.open(tmp_path / "a").complete


def test_a_refused_second_study_does_not_open_the_folder_to_a_third(tmp_path: Path) -> None:
    """POSIX frees a process's locks of a file with any of its descriptors that is closed."""
    script = (
        "import sys, stores, softpinch as sp\n"
        "try: stores.tiny(sys.argv[1])\n"
        "except sp.StoreError as error: print(error)\n"
    )
    said = []

    def report(done: int, runs: int) -> None:
        if said:
            return
        with pytest.raises(sp.StoreError):
            tiny(tmp_path)
        sp.Study.open(tmp_path)
        command = [sys.executable, "-c", script, str(tmp_path)]
        said.append(subprocess.run(command, capture_output=True, text=True, timeout=60).stdout)

    tiny(tmp_path, progress=report)
    assert f"is being written by process {os.getpid()} on " in said[0]


def test_of_two_threads_one_is_refused(tmp_path: Path) -> None:
    tried = threading.Event()
    found: list[str] = []

    def other() -> None:
        try:
            tiny(tmp_path)
        except sp.StoreError as error:
            found.append(str(error))
        tried.set()

    def report(done: int, runs: int) -> None:
        if not tried.is_set():
            thread.start()
            assert tried.wait(60)

    thread = threading.Thread(target=other)
    tiny(tmp_path, progress=report)
    thread.join()
    assert len(found) == 1 and "is being written by this process" in found[0]
    require_whole(tmp_path)


def test_a_forked_child_of_the_writer_is_refused(tmp_path: Path) -> None:
    script = """
import os, sys
import softpinch as sp, stores
def report(done, runs):
    if done == 0:
        child = os.fork()
        if not child:
            try:
                stores.tiny(sys.argv[1])
            except sp.StoreError as error:
                print(error, flush=True)
            os._exit(0)
        os.waitpid(child, 0)
stores.tiny(sys.argv[1], threads=1, progress=report)
print(os.getpid())
"""
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    message, pid = done.stdout.splitlines()
    assert f"is being written by process {pid} on " in message
    require_whole(tmp_path)


@pytest.mark.parametrize("seconds", [0.0, 1e9])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_whatever_ends_a_writer_it_keeps_its_rows_and_gives_the_lock_back(
    error: type[BaseException], seconds: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder, "GATHER_SECONDS", seconds)

    def report(done: int, runs: int) -> None:
        if done > 1024:
            raise error("enough")

    try:
        study = tiny(tmp_path, threads=1, progress=report)
        assert study.interrupted
    except RuntimeError:
        assert error is RuntimeError
    study = sp.Study.open(tmp_path)
    assert 1024 <= study.runs < TINY
    tiny(tmp_path)
    require_whole(tmp_path)


@pytest.mark.parametrize(
    "where",
    [
        "driver.manifest.write",
        "driver.Writer",
        "driver._verify_same_bits",
        "study.Study",
        "driver._events",
    ],
)
def test_an_error_anywhere_gives_the_lock_back(
    where: str, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: Any, **how: Any) -> None:
        raise RuntimeError("now")

    with monkeypatch.context() as patch:
        patch.setattr(f"softpinch.store.{where}", fail)
        with pytest.raises(RuntimeError, match="now"):
            tiny(study, TINY + 1, stop_when={"separated": 0.001})
    assert tiny(study, TINY + 1).runs == TINY + 1


def test_ctrl_c_while_it_is_taken_frees_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*given: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("os.truncate", interrupt)
        with pytest.raises(KeyboardInterrupt):
            tiny(tmp_path)
    tiny(tmp_path)
    require_whole(tmp_path)
