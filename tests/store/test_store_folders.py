"""Folders that hold no study or something else: named, and left as they were."""

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.study.sampling import BLOCK
from stores import TINY, files, require_same, require_whole, tiny, tiny_in_memory

pytestmark = pytest.mark.usefixtures("small_parts")


@pytest.mark.parametrize(
    "error",
    [
        (lambda: tiny(5), TypeError, "store = 5: must be the path of a folder"),  # type: ignore[arg-type]
        (lambda: tiny(""), ValueError, "store is empty: must be the path of a folder"),  # type: ignore[arg-type]
        (lambda: sp.Study.open(5), TypeError, "PathLike"),  # type: ignore[arg-type]
        (lambda: sp.Study.open(""), ValueError, "path is empty: must be the path of a folder"),
        (lambda: sp.Study.open("."), sp.StoreError, "is not a study"),
    ],
)
def test_a_store_is_a_path(
    error: tuple[Any, type[Exception], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error[1], match=error[2]):
        error[0]()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    for path in (tmp_path / "file", tmp_path / "file" / "below", Path("/proc/softpinch")):
        with pytest.raises(sp.StoreError, match=f"{path}: cannot be written: "):
            tiny(path, 5)
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only to root")
def test_a_folder_that_cannot_be_written(study: Path) -> None:
    for path in (study, study / "parts"):
        path.chmod(0o500)
        try:
            with pytest.raises(sp.StoreError, match=f"{study}.*: Permission denied") as caught:
                tiny(study, TINY + 1)
            assert "cannot be written" in str(caught.value)
            require_same(sp.Study.open(study).to_dict(), tiny_in_memory().to_dict())
        finally:
            path.chmod(0o700)


BAD: dict[str, dict[str, Any]] = {
    "a value": {"vary": {"grasped.mass": [0.1, 0.1, -0.1]}, "runs": 3},
    "a value drawn late": {"vary": {"grasped.mass": lambda rng: rng.normal(0.1, 0.04)}},
    "a function that raises": {"vary": {"grasped.mass": lambda rng: 1 / 0}},
    "threads": {"threads": 0},
    "smaller steps": {
        "dt": None, "tolerance": 5e-14, "method": "dop853", "formulation": "nullspace",
        "check_dt": True,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_leaves_no_folder(name: str, tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError if name == "a function that raises" else ValueError):
        tiny(tmp_path / "study", **{"runs": TINY, **BAD[name]})
    assert list(tmp_path.iterdir()) == []


def test_bad_input_in_an_extension_leaves_the_folder_as_it_was(tmp_path: Path) -> None:
    def mass(rng: np.random.Generator) -> float:
        return 0.1 if rng.uniform() < 0.999 else -1.0

    tiny(tmp_path, 20, vary={"grasped.mass": mass})
    before = files(tmp_path)
    with pytest.raises(ValueError, match=r"grasped\.mass.*run \d{2,}|run \d{2,}.*mass"):
        tiny(tmp_path, 8 * BLOCK, vary={"grasped.mass": mass})
    assert files(tmp_path) == before


@pytest.mark.parametrize("left", ["parts", "trajectories"])
def test_rows_without_their_manifest_are_no_other_studys(left: str, study: Path) -> None:
    tiny(study, trajectories=(5,))
    (study / "manifest.toml").unlink()
    shutil.rmtree(study / ({"parts", "trajectories"} - {left}).pop())
    before = files(study)
    with pytest.raises(sp.StoreError, match=r"belongs to a study whose manifest\.toml is missing"):
        tiny(study, seed=4)
    assert files(study) == before


@pytest.mark.parametrize("name", ["notes.txt", "results/table.csv", "parts.jsonl"])
def test_a_folder_with_something_else_is_refused_and_left_as_it_was(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    first = name.split("/")[0]
    with pytest.raises(
        sp.StoreError, match=f"^{tmp_path}: is not empty and not a study: it contains {first}; give"
    ):
        tiny(tmp_path)
    assert list(tmp_path.iterdir()) == [tmp_path / first]
    assert (tmp_path / name).read_text() == "mine"


def test_a_folder_with_hidden_files_only_is_empty(tmp_path: Path) -> None:
    (tmp_path / ".DS_Store").write_bytes(b"desktop")
    tiny(tmp_path)
    require_whole(tmp_path)
