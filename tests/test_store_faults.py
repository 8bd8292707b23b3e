"""What goes wrong with a study's folder is named, and nothing that was written before is lost."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.sampling import BLOCK
from stores import (
    TINY,
    edit,
    files,
    parts,
    require_same,
    require_whole,
    resume,
    tiny,
    tiny_in_memory,
)

pytestmark = pytest.mark.usefixtures("small_parts")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def alter(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 4
    path.write_bytes(data)


DAMAGE: dict[str, tuple[Callable[[Path], Any], str]] = {
    "cut": (cut, "has been cut or altered: it has .* bytes, and the list of parts says"),
    "empty": (lambda path: path.write_bytes(b""), "has been cut or altered: it has 0 bytes"),
    "altered": (alter, "has been altered: its SHA-256 is not that of the list"),
    "deleted": (Path.unlink, "is gone: put it back, or"),
}
ASK: dict[str, Callable[[sp.Study], Any]] = {
    "column": lambda study: study.status,
    "mean": lambda study: study.mean("grasped.mass"),
    "ensemble": lambda study: study.ensemble(),
    "chunks": lambda study: list(study.chunks()),
    "failures": lambda study: study.failures(),
    "replay": lambda study: study.replay(TINY - 1),
    "verify": lambda study: study.verify(),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("number", [0, 2])
def test_a_damaged_part_is_named_and_not_read(damage: str, number: int, study: Path) -> None:
    part = parts(study)[number]
    does, words = DAMAGE[damage]
    does(part)
    for name, ask in ASK.items():
        if name == "replay" and number == 0:
            assert ask(sp.Study.open(study)).status
            continue
        with pytest.raises(sp.StoreError, match=f"{part}: {words}.*resume the study"):
            ask(sp.Study.open(study))
    # It is as the message says.
    part.unlink(missing_ok=True)
    told: list[tuple[int, int]] = []
    sp.Study.open(study).resume(progress=lambda *how: told.append(how))
    assert told[-1] == (BLOCK, BLOCK)
    require_whole(study)


def test_damage_after_it_was_opened_is_seen(study: Path) -> None:
    opened = sp.Study.open(study)
    before = opened.mean("grasped.mass")
    part = parts(study)[1]
    whole = part.read_bytes()
    alter(part)
    with pytest.raises(sp.StoreError, match="has been altered"):
        opened.mean("grasped.mass")
    part.write_bytes(whole)
    assert opened.mean("grasped.mass") == before


def test_a_part_altered_behind_its_times_is_found_by_verify(study: Path) -> None:
    opened = sp.Study.open(study)
    opened.verify()
    for part in parts(study):
        found = part.stat()
        alter(part)
        os.utime(part, ns=(found.st_atime_ns, found.st_mtime_ns))
    with pytest.raises(sp.StoreError) as caught:
        opened.verify()
    lines = str(caught.value).splitlines()
    assert [line.split(": ")[0] for line in lines] == [str(part) for part in parts(study)]


@pytest.mark.parametrize("damage", ["cut", "empty"])
def test_nothing_is_written_beside_a_part_that_was_cut(damage: str, study: Path) -> None:
    DAMAGE[damage][0](parts(study)[1])
    before = files(study)
    with pytest.raises(sp.StoreError, match=r"000001\.parquet: has been cut"):
        tiny(study, TINY + 5)
    assert {**files(study), "manifest.toml": b""} == {**before, "manifest.toml": b""}


def test_a_list_that_is_gone_is_made_again(study: Path) -> None:
    before = (study / "parts.jsonl").read_text()
    (study / "parts.jsonl").unlink()
    resume(study)
    assert (study / "parts.jsonl").read_text() == before
    require_whole(study)


def test_a_torn_last_line_is_no_part_yet(study: Path) -> None:
    lines = (study / "parts.jsonl").read_text().splitlines(keepends=True)
    for torn in (lines[2][:1], lines[2][:40], lines[2][:-1]):
        (study / "parts.jsonl").write_text("".join(lines[:2]) + torn)
        assert sp.Study.open(study).runs == 2 * BLOCK
        told: list[tuple[int, int]] = []
        sp.Study.open(study).resume(progress=lambda *how, told=told: told.append(how))
        # Its part is there: nothing is computed.
        assert set(told) == {(0, 0)}
        assert (study / "parts.jsonl").read_text() == "".join(lines)
        require_whole(study)


@pytest.mark.parametrize(
    "line",
    [
        "nonsense\n",
        "two\x0clines\n",
        "{}\n",
        "[]\n",
        '{"name": 3',
        "\n",
        '{"name":"000000.parquet","size":1,"sha256":"","edges":[[50,20]]}\n',
        '{"name":"../0.parquet","size":1,"sha256":"","edges":[[0,1024]]}\n',
    ],
)
def test_a_damaged_middle_line_is_named(line: str, study: Path) -> None:
    lines = (study / "parts.jsonl").read_text().splitlines(keepends=True)
    line = line if line.endswith("\n") else line + lines[1]
    (study / "parts.jsonl").write_text("".join([line, *lines[1:]]))
    for ask in (sp.Study.open, resume, lambda path: tiny(path)):
        with pytest.raises(sp.StoreError, match=r"parts\.jsonl: line 1 is damaged: .*; delete"):
            ask(study)
    # It is as the message says.
    (study / "parts.jsonl").unlink()
    resume(study)
    require_whole(study)


def test_a_part_that_stands_twice_in_the_list_is_named(study: Path) -> None:
    lines = (study / "parts.jsonl").read_text().splitlines(keepends=True)
    (study / "parts.jsonl").write_text("".join([*lines, lines[0]]))
    with pytest.raises(sp.StoreError, match=r"parts\.jsonl: run 0 stands twice"):
        sp.Study.open(study)


def test_a_list_that_is_no_text_says_what_to_do(study: Path) -> None:
    (study / "parts.jsonl").write_bytes(b"\xff\xfe\n")
    with pytest.raises(sp.StoreError, match=r"parts\.jsonl: is damaged: .*; delete the file"):
        sp.Study.open(study)


def test_a_list_with_runs_that_its_parts_lack_is_found_by_verify(study: Path) -> None:
    edit(study / "parts.jsonl", f"[[{2 * BLOCK},{TINY}]]", f"[[{2 * BLOCK},{TINY + 5}]]")
    with pytest.raises(sp.StoreError, match=r"parts\.jsonl: has other runs than 000002\.parquet"):
        sp.Study.open(study).verify()


def test_a_part_that_was_renamed_and_not_listed_is_adopted(study: Path) -> None:
    # As one is left that was killed between the two.
    lines = (study / "parts.jsonl").read_text().splitlines(keepends=True)
    (study / "parts.jsonl").write_text("".join(lines[:2]))
    (study / ".begun").write_bytes(b"half a part")
    assert sp.Study.open(study).runs == 2 * BLOCK
    assert resume(study).complete and not (study / ".begun").exists()
    tiny(study, TINY + 10)
    assert len(parts(study)) == 4
    require_same(sp.Study.open(study).to_dict(), tiny(runs=TINY + 10).to_dict())
    kept = (study / "parts.jsonl").read_text().splitlines(keepends=True)
    assert kept[:3] == lines


def foreign(study: Path, name: str, data: bytes) -> Path:
    path = study / "parts" / name
    path.write_bytes(data)
    return path


def test_what_is_no_part_is_named_and_spoils_nothing(study: Path, tmp_path: Path) -> None:
    first = parts(study)[0].read_bytes()
    columns = tiny(tmp_path / "columns", 5 * BLOCK, summaries=("peak_rotation",))
    numbers = tiny(tmp_path / "numbers", 5 * BLOCK, seed=4)
    for name, data, why in (
        ("notes.txt", b"remember", "not called as one"),
        ("000007.parquet", b"nonsense", "Parquet"),
        ("000007.parquet", first[:-50], "Parquet"),
        ("000000 (copy).parquet", first, "not called as one"),
        ("000007.parquet", first, "run 0 stands twice"),
        ("000007.parquet", parts(columns.path)[-1].read_bytes(), "it is of another one"),
        ("000007.parquet", parts(numbers.path)[-1].read_bytes(), "it is of another one"),
    ):
        path = foreign(study, name, data)
        before = files(study)
        with pytest.raises(sp.StoreError, match="is no part of this study: ") as caught:
            tiny(study)
        assert str(path) in str(caught.value) and why in str(caught.value)
        assert files(study) == before
        # It is still read, and gone on with where that is moved elsewhere.
        require_whole(study)
        path.unlink()
        tiny(study)


def test_hidden_files_are_left_alone(study: Path) -> None:
    path = foreign(study, ".DS_Store", b"desktop")
    tiny(study)
    assert path.read_bytes() == b"desktop"


@pytest.mark.parametrize(
    "error",
    [
        (lambda: tiny(5), TypeError, "store = 5: must be the path of a folder"),  # type: ignore[arg-type]
        (lambda: tiny(b"study"), TypeError, "must be the path of a folder"),  # type: ignore[arg-type]
        (lambda: tiny(""), ValueError, "store is empty: must be the path of a folder"),  # type: ignore[arg-type]
        (lambda: sp.Study.open(5), TypeError, "PathLike"),  # type: ignore[arg-type]
        (lambda: sp.Study.open(""), sp.StoreError, "is no study"),
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


@pytest.mark.parametrize("taken", ["manifest.toml", "parts.jsonl", "parts", "lock"])
def test_something_else_in_the_place_of_a_file(taken: str, tmp_path: Path) -> None:
    if taken == "parts":
        (tmp_path / taken).write_text("")
    else:
        (tmp_path / taken / "x").mkdir(parents=True)
    with pytest.raises(sp.StoreError, match=str(tmp_path)):
        tiny(tmp_path, 5)


BAD: dict[str, dict[str, Any]] = {
    "a value": {"vary": {"grasped.mass": [0.1, 0.1, -0.1]}, "runs": 3},
    "a value drawn late": {"vary": {"grasped.mass": lambda rng: rng.normal(0.1, 0.04)}},
    "a path": {"vary": {"grasped.mas": sp.Normal(0.1, 0.01)}},
    "a length": {"vary": {"grasped.mass": [0.1]}, "runs": 3},
    "a method": {"method": "euler"},
    "runs": {"runs": 0},
    "a function that raises": {"vary": {"grasped.mass": lambda rng: 1 / 0}},
    "trajectories": {"trajectories": (TINY + 5,)},
    "check_dt": {"check_dt": 1},
    "executor": {"executor": 3},
    "threads": {"threads": 0},
    "smaller steps": {
        "dt": None, "tolerance": 5e-14, "method": "dop853", "formulation": "nullspace",
        "check_dt": True,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_leaves_no_folder(name: str, tmp_path: Path) -> None:
    with pytest.raises((ValueError, TypeError, ZeroDivisionError)):
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


@pytest.mark.parametrize("gone", [["manifest.toml"], ["manifest.toml", "parts.jsonl"]])
def test_rows_without_their_manifest_are_no_other_studys(gone: list[str], study: Path) -> None:
    for name in gone:
        (study / name).unlink()
    before = files(study)
    with pytest.raises(sp.StoreError, match=r"belongs to a study whose manifest\.toml is gone"):
        tiny(study, seed=4)
    assert files(study) == before
