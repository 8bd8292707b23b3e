"""A study that is killed again and again comes to the table of one that never was."""

import random
import secrets
import signal
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import killed
import softpinch as sp
from killed import BLOCKS, GIVEN, SCENE
from softpinch.study.sampling import BLOCK
from stores import require_same

DRIVER = Path(killed.__file__)


@cache
def uninterrupted() -> tuple[sp.Ensemble, float]:
    """The table, and what a block takes, s."""
    begin = time.monotonic()
    ensemble = sp.monte_carlo(SCENE, progress=False, **GIVEN)
    return ensemble, (time.monotonic() - begin) / BLOCKS


def listed(path: Path) -> int:
    """How many runs a reader finds."""
    return sp.Study.open(path).runs if (path / "manifest.toml").exists() else 0


def attempt(path: Path, sent: signal.Signals, anywhere: bool, draw: random.Random) -> str:
    """Sends a signal at some instant to a driver; what that said last."""
    block = uninterrupted()[1]
    command = [sys.executable, str(DRIVER), str(path)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as driver:
        assert driver.stdout is not None
        assert driver.stdout.readline() == "here\n"
        # From its begin on, or after a block or two.
        for _ in range(0 if anywhere else draw.randrange(1, 3)):
            driver.stdout.readline()
        time.sleep(draw.uniform(0.0, (5 if anywhere else 2) * block))
        driver.send_signal(sent)
        said, _ = driver.communicate(timeout=120)
    return said.rstrip().rpartition("\n")[2]


def interrupt(path: Path, sent: signal.Signals, times: int) -> None:
    """Again and again; what was written once stays written."""
    seed = secrets.randbits(32)
    print(f"the instants of seed {seed}")
    draw = random.Random(seed)
    kept, partly = 0, 0
    for number in range(times):
        attempt(path, sent, number % 3 == 2, draw)
        now = listed(path)
        assert now >= kept
        kept = now
        partly += 0 < kept < GIVEN["runs"]
    print(f"{partly} of {times} found it partly done; {kept} of {GIVEN['runs']} in the end")
    assert partly >= times // 2
    study = sp.Study.open(path)
    study.verify()
    require_same(study.resume(progress=False).to_dict(), uninterrupted()[0].to_dict())
    sp.Study.open(path).verify()


def test_a_study_that_is_killed_ten_times(tmp_path: Path) -> None:
    interrupt(tmp_path / "study", signal.SIGKILL, 10)


def test_a_study_that_ctrl_c_ends_several_times(tmp_path: Path) -> None:
    interrupt(tmp_path / "study", signal.SIGINT, 4)


def test_ctrl_c_keeps_the_runs_that_were_done(tmp_path: Path) -> None:
    said = attempt(tmp_path, signal.SIGINT, False, random.Random(1))
    assert said == "interrupted"
    study = sp.Study.open(tmp_path)
    assert BLOCK <= study.runs < GIVEN["runs"] and not study.complete
    rows = uninterrupted()[0].to_dict()
    require_same(study.to_dict(), {n: v[study.run.astype(int)] for n, v in rows.items()})
