"""A disk that fills: what was written before is kept, and the study goes on where there is room."""

import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from softpinch.study.sampling import BLOCK
from softpinch.support import disk
from stores import TINY, files, require_same, require_whole, tiny

pytestmark = pytest.mark.usefixtures("small_parts")


@contextmanager
def full(size: int, parts: int = 0) -> Iterator[None]:
    """A disk without room for more than so many bytes of a file.

    With `parts` that begins where so many are there. Python ignores the signal that comes with the
    limit, so that writing raises EFBIG.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    real = disk.flush_folder

    def flush(folder: Path) -> None:
        real(folder)
        if folder.name == "parts" and len(list(folder.iterdir())) == parts:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(disk, "flush_folder", flush)
        if not parts:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


def require_no_half_files(path: Path) -> None:
    assert [name for name in files(path) if Path(name).name.startswith(".")] == []


def require_kept(path: Path, runs: int, said: str) -> None:
    """The message names the folder and how many runs there are, which a reader finds."""
    assert said.startswith(f"{path}: File too large: the last {BLOCK} runs cannot be written; ")
    assert f"the {runs} runs before them are stored, and resume continues there" in said
    assert sp.Study.open(path).runs == runs
    sp.Study.open(path).verify()
    require_no_half_files(path)


@pytest.mark.parametrize("size", [0, 5, 700])
def test_no_room_for_the_manifest(size: int, tmp_path: Path) -> None:
    for _ in range(2):
        with full(size), pytest.raises(sp.StoreError) as caught:
            tiny(tmp_path)
        assert str(caught.value) == f"{tmp_path}/manifest.toml: cannot be written: File too large"
        assert files(tmp_path) == {}
    tiny(tmp_path)
    require_whole(tmp_path)


@pytest.mark.parametrize("size", [5_000, 30_000, 60_000])
def test_no_room_for_the_first_part(size: int, tmp_path: Path) -> None:
    with full(size), pytest.raises(sp.StoreError) as caught:
        tiny(tmp_path)
    require_kept(tmp_path, 0, str(caught.value))
    tiny(tmp_path)
    require_whole(tmp_path)


@pytest.mark.parametrize("size", [1_000, 60_000])
def test_no_room_for_another_part(size: int, tmp_path: Path) -> None:
    with full(size, parts=2), pytest.raises(sp.StoreError) as caught:
        tiny(tmp_path)
    require_kept(tmp_path, 2 * BLOCK, str(caught.value))
    before = files(tmp_path)
    with full(size), pytest.raises(sp.StoreError) as caught:
        sp.Study.open(tmp_path).resume(progress=False)
    require_kept(tmp_path, 2 * BLOCK, str(caught.value))
    assert files(tmp_path) == before
    sp.Study.open(tmp_path).resume(progress=False)
    require_whole(tmp_path)


def test_no_room_for_the_manifest_of_an_extension(study: Path) -> None:
    before = files(study)
    with full(60), pytest.raises(sp.StoreError) as caught:
        tiny(study, TINY + 9)
    assert str(caught.value) == f"{study}/manifest.toml: cannot be written: File too large"
    assert files(study) == before
    require_whole(study)
    require_same(tiny(study, TINY + 9).to_dict(), tiny(runs=TINY + 9).to_dict())


@pytest.mark.parametrize("size", [100, 4000])
def test_no_room_for_an_array(size: int, tmp_path: Path) -> None:
    mass = np.linspace(0.09, 0.11, 2000)
    with full(size), pytest.raises(sp.StoreError, match=r"\.npy: cannot be written: File") as e:
        tiny(tmp_path, None, vary={"grasped.mass": mass})
    assert str(e.value).startswith(f"{tmp_path}/arrays/")
    assert files(tmp_path) == {}
    tiny(tmp_path, None, vary={"grasped.mass": mass})
    study = sp.Study.open(tmp_path).resume(progress=False)
    np.testing.assert_array_equal(study["grasped.mass"], mass)


def test_no_room_for_a_path(study: Path) -> None:
    before = files(study)
    with full(4000), pytest.raises(sp.StoreError) as caught:
        tiny(study, trajectories=(5,))
    assert str(caught.value) == f"{study}/trajectories/5.parquet: cannot be written: File too large"
    # That it is to be kept is noted.
    after = files(study)
    assert after.pop("manifest.toml") != before.pop("manifest.toml")
    assert after == before
    path = tiny(study, trajectories=(5,)).trajectories[5]
    np.testing.assert_array_equal(path.q, tiny(trajectories=(5,)).trajectories[5].q)


ALONE = ["unshare", "--user", "--map-root-user", "--mount"]
SMALL = """
import json, shutil, subprocess, sys
from pathlib import Path
import softpinch as sp
import stores
from softpinch.store import folder

folder.GATHER_SECONDS = 0
disk = Path(sys.argv[1]) / "disk"
disk.mkdir()
# For no more than a part or two.
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=250k", "none", disk], check=True)
for _ in range(2):
    try:
        stores.tiny(disk / "study")
    except sp.StoreError as error:
        there = sorted(path.name for path in (disk / "study").iterdir())
        print(json.dumps([str(error), sp.Study.open(disk / "study").runs, there]))
subprocess.run(["mount", "-o", "remount,size=50m", disk], check=True)
sp.Study.open(disk / "study").resume()
# The disk is gone with this process.
shutil.copytree(disk / "study", sys.argv[1] + "/copy")
"""


def test_a_small_disk_that_fills(tmp_path: Path) -> None:
    mount = f'mount -t tmpfs none "{tmp_path}" && "{sys.executable}" -c ""'
    probe = [*ALONE, "sh", "-c", mount]
    if shutil.which("unshare") is None or subprocess.run(probe, capture_output=True).returncode:
        pytest.skip("no file system can be mounted here")
    command = [*ALONE, sys.executable, "-c", SMALL, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    attempts = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(attempts) == 2
    for said, runs, names in attempts:
        assert said.startswith(f"{tmp_path}/disk/study: No space left on device: the last {BLOCK}")
        assert f"the {runs} runs before them are stored" in said and BLOCK <= runs < TINY
        assert names == ["lock", "manifest.toml", "parts"]
    require_whole(tmp_path / "copy")
