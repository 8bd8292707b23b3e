"""A study whose writer is killed, interrupted or out of disk goes on to the same table."""

import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import killed
import softpinch as sp
from killed import GIVEN, SCENE
from softpinch.study.sampling import BLOCK
from softpinch.support import files as support_files
from stores import TINY, files, require_same, require_whole, tiny

# Forks children that begin a study, or go on with one, and are killed at their n-th step: before a
# file or a folder comes to the disk, when half of what was not there yet is lost; or before one
# takes another's place. For each it prints the folder, the last step, and whether it was killed.
SCRIPT = """
import json, os, signal, stat, sys
import numpy as np
import pandas, pyarrow.parquet
import stores
from softpinch.store import folder, manifest, study

# What children would do each for itself.
manifest.made_by()
folder.GATHER_SECONDS = 0
HOW = {"runs": None, "vary": {"grasped.mass": np.linspace(0.09, 0.11, 1500)}, "threads": 1}
real_fsync, real_replace = os.fsync, os.replace
synced, left, steps = {}, 0, []

def step(name):
    global left
    steps.append(name)
    left -= 1
    return left == 0

def die():
    os.write(pipe, json.dumps(steps[-1]).encode())
    os.kill(os.getpid(), signal.SIGKILL)

def fsync(fd):
    found = os.fstat(fd)
    whole = synced.get(found.st_ino, 0)
    folder = stat.S_ISDIR(found.st_mode)
    if step("folder" if folder else "file"):
        if not folder:
            os.ftruncate(fd, whole + (found.st_size - whole) // 2)
        die()
    real_fsync(fd)
    synced[found.st_ino] = found.st_size

def replace(old, new):
    if step(os.path.basename(new)):
        die()
    real_replace(old, new)

at, ended = 1, False
while not ended:
    path = f"{sys.argv[1]}/{at}"
    ours, pipe = os.pipe()
    left = at
    child = os.fork()
    if not child:
        os.fsync, os.replace = fsync, replace
        stores.tiny(path, **HOW)
        os._exit(0)
    os.close(pipe)
    ended = not os.WIFSIGNALED(os.waitpid(child, 0)[1])
    with open(ours) as file:
        text = file.read()
    print(json.dumps([path, text and json.loads(text)]), flush=True)
    at += 1
"""


def test_nothing_that_was_written_is_lost_at_any_step(tmp_path: Path) -> None:
    command = [sys.executable, "-c", SCRIPT, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    *steps, _ = [json.loads(line) for line in done.stdout.splitlines()]
    names = {step for _, step in steps if not step.endswith((".npy", ".sha256"))}
    assert names == {"file", "folder", "manifest.toml", "000000.parquet", "000001.parquet"}
    how = {"runs": None, "vary": {"grasped.mass": np.linspace(0.09, 0.11, 1500)}}
    expected = tiny(**how).to_dict()
    runs = []
    for path in [Path(path) for path, _ in steps]:
        if (path / "manifest.toml").exists():
            study = sp.Study.open(path)
            study.verify()
            runs.append(study.runs)
        require_same(tiny(path, **how).to_dict(), expected)
        sp.Study.open(path).verify()
    # The later a writer is killed, the more is there.
    assert runs == sorted(runs) and {0, BLOCK} <= set(runs)


def attempt(path: Path, sent: signal.Signals, blocks: int, wait: float) -> str:
    """Sends a signal to a writer some time after some blocks; returns its last line."""
    command = [sys.executable, str(Path(killed.__file__)), str(path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as driver:
        assert driver.stdout is not None
        assert driver.stdout.readline() == "here\n"
        for _ in range(blocks):
            driver.stdout.readline()
        time.sleep(wait)
        driver.send_signal(sent)
        said, _ = driver.communicate(timeout=120)
    return said.rstrip().rpartition("\n")[2]


@pytest.mark.parametrize(
    ("sent", "times"),
    [
        (signal.SIGKILL, 3),
        pytest.param(signal.SIGKILL, 5, marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, 3, marks=pytest.mark.slow),
    ],
)
def test_a_study_that_is_ended_again_and_again_comes_to_the_same_table(
    sent: signal.Signals, times: int, tmp_path: Path
) -> None:
    rng = np.random.default_rng(4)
    expected = sp.monte_carlo(SCENE, progress=False, **GIVEN)
    kept = []
    for number in range(times):
        blocks = 0 if number % 3 == 2 else int(rng.integers(1, 3))
        attempt(tmp_path, sent, blocks, rng.uniform(0.0, 0.1))
        there = (tmp_path / "manifest.toml").exists()
        kept.append(sp.Study.open(tmp_path).runs if there else 0)
    assert kept == sorted(kept)
    assert sum(0 < runs < GIVEN["runs"] for runs in kept) >= times // 2
    study = sp.Study.open(tmp_path)
    study.verify()
    require_same(study.resume(progress=False).to_dict(), expected.to_dict())


def test_ctrl_c_keeps_the_runs_that_were_done(tmp_path: Path) -> None:
    assert attempt(tmp_path, signal.SIGINT, 2, 0.0) == "interrupted"
    study = sp.Study.open(tmp_path)
    assert BLOCK <= study.runs < GIVEN["runs"] and not study.complete


def test_a_study_is_written_where_sigint_is_ignored(tmp_path: Path) -> None:
    """As in a job in a shell's background."""
    script = "import sys, stores; print(stores.tiny(sys.argv[1]).complete)"
    ignoring = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", sys.executable, "-c", script]
    done = subprocess.run([*ignoring, str(tmp_path)], capture_output=True, text=True, timeout=100)
    assert done.stdout == "True\n", done.stderr


@contextmanager
def full(size: int, parts: int = 0) -> Iterator[None]:
    """A disk without room for more than so many bytes of a file, once it has so many parts.

    Python ignores the signal that comes with the limit, so that writing raises EFBIG.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    real = support_files.flush_folder

    def flush(folder: Path) -> None:
        real(folder)
        if folder.name == "parts" and len(list(folder.iterdir())) == parts:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(support_files, "flush_folder", flush)
        if not parts:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.usefixtures("small_parts")
@pytest.mark.parametrize(("size", "before"), [(30, 0), (20_000, 0), (1_000, 2), (60_000, 2)])
def test_a_full_disk_keeps_the_parts_before(size: int, before: int, tmp_path: Path) -> None:
    with full(size, before), pytest.raises(sp.StoreError) as caught:
        tiny(tmp_path)
    if (tmp_path / "manifest.toml").exists():
        place = "digests/parts-" if size < 100 else "parts/"
        assert re.fullmatch(
            rf"{tmp_path}/{place}{before:06}\.parquet(\.sha256)?: cannot be written: "
            rf"File too large: the last {BLOCK} runs are lost; the {before * BLOCK} runs before "
            "them are stored, and resume continues there",
            str(caught.value),
        )
        assert sp.Study.open(tmp_path).runs == before * BLOCK
        sp.Study.open(tmp_path).verify()
    else:
        assert str(caught.value) == f"{tmp_path}/manifest.toml: cannot be written: File too large"
    assert not [name for name in files(tmp_path) if Path(name).name.startswith(".")]
    tiny(tmp_path)
    require_whole(tmp_path)


def test_no_room_for_the_manifest_of_an_extension_or_a_trajectory(study: Path) -> None:
    before = files(study)
    with full(60), pytest.raises(sp.StoreError, match=r"manifest\.toml: cannot be written: File t"):
        tiny(study, TINY + 9)
    assert files(study) == before
    with full(4000), pytest.raises(sp.StoreError) as caught:
        tiny(study, trajectories=(5,))
    assert str(caught.value) == f"{study}/trajectories/5.parquet: cannot be written: File too large"
    path = tiny(study, trajectories=(5,)).trajectories[5]
    np.testing.assert_array_equal(path.q, tiny(trajectories=(5,)).trajectories[5].q)
    require_whole(study)


def test_what_a_signal_handler_raises_while_runs_are_computed_is_raised(tmp_path: Path) -> None:
    """The rows that had come are kept, and the lock is free."""

    def handle(*_: object) -> None:
        raise TimeoutError("late")

    def report(done: int, runs: int) -> None:
        if done > BLOCK:
            os.kill(os.getpid(), signal.SIGALRM)

    before = signal.signal(signal.SIGALRM, handle)
    try:
        with pytest.raises(TimeoutError, match="late"):
            tiny(tmp_path, threads=1, progress=report)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert BLOCK <= sp.Study.open(tmp_path).runs < TINY
    tiny(tmp_path)
    require_whole(tmp_path)
