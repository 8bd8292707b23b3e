"""One process at a time writes a folder; a writer that ends gives it back, however it ends."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

import softpinch as sp
from softpinch.store import folder
from stores import TINY, require_whole, tiny

REFUSED = "is being written by another process or thread$"
# Begins a study, forks a child once it has the lock, and stops there until a line comes.
WRITER = """
import os, sys, time
import stores, softpinch as sp
from softpinch.store import folder

folder.GATHER_SECONDS = 0
def wait(done, runs):
    if done > 1024:
        child = os.fork()
        if not child:
            try:
                stores.tiny(sys.argv[1])
            except sp.StoreError as error:
                print(os.getpid(), error, flush=True)
            time.sleep(600)
            os._exit(0)
        sys.stdin.readline()

stores.tiny(sys.argv[1], threads=1, progress=wait)
"""


def test_a_killed_writer_frees_the_lock_at_once(tmp_path: Path) -> None:
    """Although a child that it forked lives on, with all the files that it had open."""
    command, pipe = [sys.executable, "-c", WRITER, str(tmp_path)], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        number, said = process.stdout.readline().split(" ", 1)
        try:
            # The child, and another process, while the writer lives.
            assert "is being written by another process" in said
            before = (tmp_path / "manifest.toml").read_bytes()
            for _ in range(2):
                with pytest.raises(sp.StoreError, match=f"^{tmp_path}: {REFUSED}"):
                    tiny(tmp_path, TINY + 5)
            assert (tmp_path / "manifest.toml").read_bytes() == before
            assert 0 < sp.Study.open(tmp_path).runs < TINY
            process.kill()
            process.wait(timeout=60)
            tiny(tmp_path)
            os.kill(int(number), 0)
        finally:
            process.kill()
            os.kill(int(number), signal.SIGKILL)
    require_whole(tmp_path)


@pytest.mark.parametrize("apart", [False, True], ids=["this thread", "another thread"])
def test_a_second_study_of_the_same_process_is_refused(apart: bool, tmp_path: Path) -> None:
    found: list[str] = []

    def other() -> None:
        try:
            tiny(tmp_path / ".." / tmp_path.name)
        except sp.StoreError as error:
            found.append(str(error))

    def report(done: int, runs: int) -> None:
        if not apart:
            other()
        elif not found:
            thread = threading.Thread(target=other)
            thread.start()
            thread.join(60)

    tiny(tmp_path, progress=report)
    assert found and all(said.endswith(REFUSED[:-1]) for said in found)
    require_whole(tmp_path)


@pytest.mark.parametrize("seconds", [0.0, 1e9])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_ended_writer_keeps_its_rows_and_gives_the_lock_back(
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
    ["manifest.write", "study.Writer", "study._verify_same_bits", "study._events"],
)
def test_an_error_before_the_first_run_gives_the_lock_back(
    where: str, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*given: Any, **how: Any) -> None:
        raise RuntimeError("now")

    with monkeypatch.context() as patch:
        patch.setattr(f"softpinch.store.{where}", fail)
        with pytest.raises(RuntimeError, match="now"):
            tiny(study, TINY + 1, stop_when={"separated": 0.001})
    assert tiny(study, TINY + 1).runs == TINY + 1
