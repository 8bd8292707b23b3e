"""A writer that ends, and its machine with it, at every single step of writing."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

import softpinch as sp
from softpinch.study.sampling import BLOCK
from stores import require_same, require_whole, tiny

# Forks children that begin a study, or go on with one, and are killed at their n-th step: before a
# file or a folder comes to the disk, when half of what was not there yet is lost; or before one
# takes another's place. For each it prints the folder, the last step, and whether it was killed.
SCRIPT = """
import json, os, signal, stat, sys
import numpy as np
import pandas, pyarrow.parquet
import tomli_w
import stores
from softpinch.store import driver, folder, manifest

# What children would do each for itself.
manifest.made_by()
folder.GATHER_SECONDS = 0
HOW = {"threads": 1}
if sys.argv[2] == "arrays":
    HOW |= {"runs": None, "vary": {"grasped.mass": np.linspace(0.09, 0.11, 1500)}}
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

def killed(path, at):
    global left, pipe
    ours, pipe = os.pipe()
    left = at
    child = os.fork()
    if not child:
        os.fsync, os.replace = fsync, replace
        stores.tiny(path, **HOW)
        os._exit(0)
    os.close(pipe)
    found = os.waitpid(child, 0)[1]
    with open(ours) as file:
        text = file.read()
    print(json.dumps([str(path), text and json.loads(text), os.WIFSIGNALED(found)]), flush=True)
    return os.WIFSIGNALED(found)

if sys.argv[3] == "apart":
    at = 1
    while killed(f"{sys.argv[1]}/{at}", at):
        at += 1
else:
    # One folder, again and again: those that go on are killed, too.
    for at in [1, 2, 3, 4, 5, 2, 4, 6, 8, 1, 5, 9, 7, 3, 10, 2, 100]:
        killed(f"{sys.argv[1]}/again", at)
"""


def crash(path: Path, vary: str, where: str) -> list[tuple[Path, str, bool]]:
    command = [sys.executable, "-c", SCRIPT, str(path), vary, where]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    return [(Path(folder), step, killed) for folder, step, killed in found]


def test_nothing_is_lost_at_any_step(tmp_path: Path) -> None:
    *killed, (last, _, finished) = crash(tmp_path, "ours", "apart")
    assert not finished
    require_whole(last)
    seen = {step for _, step, _ in killed}
    parts = {f"00000{k}.parquet" for k in range(3)}
    assert seen == {"file", "folder", "manifest.toml", *parts}
    assert len(killed) >= 12 and all(each for *_, each in killed)
    runs = []
    for path, _, _ in killed:
        if (path / "manifest.toml").exists():
            study = sp.Study.open(path)
            study.verify()
            runs.append(study.runs)
        tiny(path)
        require_whole(path)
    # The later a writer is killed, the more is there.
    assert runs == sorted(runs) and {0, BLOCK, 2 * BLOCK} <= set(runs)


def test_nor_where_arrays_are_kept(tmp_path: Path) -> None:
    mass = np.linspace(0.09, 0.11, 1500)
    *killed, _ = crash(tmp_path, "arrays", "apart")
    assert any(step.endswith(".npy") for _, step, _ in killed)
    expected = tiny(runs=None, vary={"grasped.mass": mass})
    for path, _, _ in killed:
        tiny(path, None, vary={"grasped.mass": mass})
        study = sp.Study.open(path).resume(progress=False)
        require_same(study.to_dict(), expected.to_dict())


def test_nor_where_those_that_go_on_are_killed_too(tmp_path: Path) -> None:
    steps = crash(tmp_path, "ours", "again")
    assert sum(killed for *_, killed in steps) >= 6
    assert not steps[-1][2]
    require_whole(tmp_path / "again")
