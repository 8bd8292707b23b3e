"""What goes wrong with a study's folder is named, and nothing that was written before is lost."""

import errno
import hashlib
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest

import softpinch as sp
from softpinch.study.sampling import BLOCK
from stores import TINY, files, parts, require_same, require_whole, resume, tiny, tiny_in_memory

pytestmark = pytest.mark.usefixtures("small_parts")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


DAMAGE: dict[str, Callable[[Path], Any]] = {
    "cut": cut,
    "empty": lambda path: path.write_bytes(b""),
    "nonsense": lambda path: path.write_bytes(b"nonsense" * 40),
    "no file": lambda path: (path.unlink(), path.mkdir()),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
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
REPAIR = "delete it and resume the study, which computes its runs again"


def require_repaired_by_deleting(part: Path, study: Path) -> None:
    """It is as the message says."""
    if part.is_dir():
        part.rmdir()
    part.unlink(missing_ok=True)
    told: list[tuple[int, int]] = []
    sp.Study.open(study).resume(progress=lambda *how: told.append(how))
    assert told[-1] == (BLOCK, BLOCK)
    require_whole(study)


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("number", [0, 2])
def test_a_part_without_its_footer_is_named_and_nothing_is_read(
    damage: str, number: int, study: Path
) -> None:
    part = parts(study)[number]
    opened = sp.Study.open(study)
    DAMAGE[damage](part)
    before = files(study)
    for ask in (sp.Study.open, lambda path: tiny(path, TINY + 5)):
        with pytest.raises(sp.StoreError, match=f"^{part}: is damaged: [^\n]*; {REPAIR}$"):
            ask(study)
    for name, reading in ASK.items():
        if name != "replay" or number == 2:
            with pytest.raises(sp.StoreError, match=f"^{part}: is damaged: [^\n]*; {REPAIR}$"):
                reading(opened)
    assert files(study) == before
    require_repaired_by_deleting(part, study)


def in_column(part: Path, name: str) -> int:
    """Where the last byte of a column's data is."""
    group = parquet.read_metadata(part).row_group(0)
    columns = [group.column(k) for k in range(group.num_columns)]
    (chunk,) = [column for column in columns if column.path_in_schema == name]
    return int(chunk.data_page_offset + chunk.total_compressed_size - 1)


def flip(part: Path, place: int) -> None:
    data = bytearray(part.read_bytes())
    data[place] ^= 4
    part.write_bytes(data)


@pytest.mark.parametrize("number", [0, 2])
def test_altered_data_is_named_by_all_that_read_it(number: int, study: Path) -> None:
    part = parts(study)[number]
    flip(part, in_column(part, "grasped.mass"))
    opened = sp.Study.open(study)
    for name in ("mean", "ensemble", "chunks", "verify"):
        with pytest.raises(sp.StoreError, match=f"^{part}: is damaged: [^\n]*CRC.*; {REPAIR}$"):
            ASK[name](opened)
    # Other columns are whole.
    np.testing.assert_array_equal(opened.status, tiny_in_memory().status)
    require_repaired_by_deleting(part, study)


def test_data_altered_with_its_page_checksum_is_found_by_the_contents(study: Path) -> None:
    """As by a faulty tool that writes Parquet again: all of it is valid but our numbers."""
    part = parts(study)[1]
    table = parquet.read_table(part)
    k = table.schema.get_field_index("steps")
    changed = pa.array(table["steps"].to_numpy() + 1)
    parquet.write_table(table.set_column(k, table.schema.field(k), changed), part)
    opened = sp.Study.open(study)
    with pytest.raises(
        sp.StoreError, match=f"{part}: is damaged: the checksum of its column steps"
    ):
        opened.steps  # noqa: B018
    assert opened.mean("grasped.mass") == tiny_in_memory().mean("grasped.mass")
    # Another writer's file with the same numbers is as good.
    parquet.write_table(table, part, compression="snappy", row_group_size=100)
    require_whole(study)


STRANGE: list[dict[str, Any]] = [
    {"rows": 10**12, "runs": [[0, 10**12]]},
    {"rows": BLOCK - 1},
    {"rows": BLOCK - 1, "runs": [[0, BLOCK - 1]]},
    {"rows": None},
    {"rows": True},
    {"runs": [[5, 3]]},
    {"runs": [[0, BLOCK, 2 * BLOCK]]},
    {"runs": [[-BLOCK, 0]]},
    {"runs": [[0, 2**70]]},
    {"runs": [[2**63 - BLOCK, 2**63]]},
    {"runs": [[0.0, float(BLOCK)]]},
    {"runs": []},
    {"runs": "all"},
    {"runs": {"x": 1}},
    {"columns": {}},
    {"columns": None},
    {"columns": {"run": 3}},
    {"study": 3},
]


@pytest.mark.parametrize("change", STRANGE, ids=range(len(STRANGE)))
def test_a_record_is_not_believed_because_its_checksum_is_right(
    change: dict[str, Any], study: Path
) -> None:
    """As in a stranger's part; what it says decides how much is read, and where."""
    part = parts(study)[0]
    table = parquet.read_table(part)
    record = json.loads(table.schema.metadata[b"softpinch"].split(b" ", 2)[2])
    text = json.dumps({**record, **change})
    digest = hashlib.sha256(text.encode()).hexdigest()
    entry = f"softpinch-record {digest} {text}\n"
    parquet.write_table(table.replace_schema_metadata({"softpinch": entry}), part)
    with pytest.raises(sp.StoreError, match=f"^{part}: [^\n]*$"):
        sp.Study.open(study).verify()


def test_a_small_part_of_gigantic_contents_is_refused_before_it_is_read(study: Path) -> None:
    """The limit is what a study writes: 2**23 numbers and, at most, 2**15 rows more."""
    part = parts(study)[0]
    table = parquet.read_table(part)
    record = json.loads(table.schema.metadata[b"softpinch"].split(b" ", 2)[2])
    last = 2**15 + 2**23 // len(record["columns"])
    for rows in (last, last + 1):
        text = json.dumps({**record, "rows": rows, "runs": [[10**6, 10**6 + rows]]})
        digest = hashlib.sha256(text.encode()).hexdigest()
        entry = f"softpinch-record {digest} {text}\n"
        parquet.write_table(table.replace_schema_metadata({"softpinch": entry}), part)
        if rows > last:
            with pytest.raises(
                sp.StoreError, match=f"^{part}: .*{rows} rows, more than a study writes"
            ):
                sp.Study.open(study)
        else:
            assert sp.Study.open(study).runs == rows + 2 * BLOCK


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (MemoryError("malloc of 5 bytes failed"), "out of memory: malloc of 5 bytes failed; if "),
        (OSError(errno.EMFILE, "Too many open files"), "Too many open files$"),
    ],
)
def test_a_part_is_not_called_damaged_for_want_of_something(
    error: Exception, words: str, study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wanting(column: Any) -> str:
        raise error

    opened = sp.Study.open(study)
    monkeypatch.setattr("softpinch.store.table._checksum", wanting)
    with pytest.raises(sp.StoreError, match=f"^{parts(study)[0]}: cannot be read: {words}"):
        opened.status  # noqa: B018


def test_a_part_that_is_deleted_is_missing_runs(study: Path) -> None:
    opened = sp.Study.open(study)
    part = parts(study)[1]
    part.unlink()
    for name in ("column", "ensemble", "verify"):
        with pytest.raises(sp.StoreError, match=f"^{part}: is missing: restore it, or resume"):
            ASK[name](opened)
    again = sp.Study.open(study)
    assert again.missing.tolist() == [[BLOCK, 2 * BLOCK]] and again.runs == 2 * BLOCK
    again.verify()
    require_repaired_by_deleting(part, study)


def test_damage_after_it_was_opened_is_seen(study: Path) -> None:
    opened = sp.Study.open(study)
    before = opened.mean("grasped.mass")
    part = parts(study)[1]
    whole = part.read_bytes()
    found = part.stat()
    flip(part, in_column(part, "grasped.mass"))
    # Also where the file's times hide it.
    os.utime(part, ns=(found.st_atime_ns, found.st_mtime_ns))
    with pytest.raises(sp.StoreError, match="is damaged"):
        opened.mean("grasped.mass")
    with pytest.raises(sp.StoreError) as caught:
        opened.verify()
    assert str(caught.value).startswith(f"{part}: ") and "\n" not in str(caught.value)
    # Another part in its place is not read either.
    part.write_bytes(parts(study)[0].read_bytes())
    with pytest.raises(sp.StoreError, match="it was replaced by another file"):
        opened.mean("grasped.mass")
    part.write_bytes(whole)
    assert opened.mean("grasped.mass") == before


def test_verify_names_all_that_is_damaged(study: Path) -> None:
    tiny(study, trajectories=(5, 6))
    opened = sp.Study.open(study)
    opened.verify()
    damaged = [*parts(study), study / "trajectories" / "5.parquet"]
    for file in damaged:
        flip(file, in_column(file, "steps" if file.parent.name == "parts" else "q.3"))
    with pytest.raises(sp.StoreError) as caught:
        opened.verify()
    lines = str(caught.value).splitlines()
    assert [line.split(": ")[0] for line in lines] == [str(file) for file in damaged]


def test_a_kept_path_is_checked_like_a_part(study: Path) -> None:
    expected = tiny(study, trajectories=(5, 6)).trajectories[5]
    file = study / "trajectories" / "5.parquet"
    whole = file.read_bytes()
    for damage in (
        lambda: flip(file, in_column(file, "q.3")),
        lambda: cut(file),
        lambda: file.write_bytes((study / "trajectories" / "6.parquet").read_bytes()),
        lambda: file.write_bytes(parts(study)[0].read_bytes()),
    ):
        damage()
        opened = resume(study)
        assert list(opened.trajectories) == [5, 6]
        with pytest.raises(
            sp.StoreError, match=f"^{file}: is damaged: [^\n]*; delete it and resume"
        ):
            opened.trajectories[5]
        file.unlink()
        again = resume(study).trajectories[5]
        np.testing.assert_array_equal(again.q, expected.q)
        assert file.read_bytes() == whole
    # Without its run's row it is not shown.
    parts(study)[0].unlink()
    opened = sp.Study.open(study)
    assert list(opened.trajectories) == [] and 5 not in opened.trajectories
    assert list(resume(study).trajectories) == [5, 6]


def test_what_a_killed_writer_left_is_removed_by_the_next(study: Path) -> None:
    left = [study / ".manifest.toml.partial", study / "parts" / ".000003.parquet.partial"]
    for file in left:
        file.write_bytes(b"half a part")
    require_whole(study)
    assert all(file.exists() for file in left)
    tiny(study, TINY + 10)
    assert not any(file.exists() for file in left)
    assert len(parts(study)) == 4
    require_same(sp.Study.open(study).to_dict(), tiny(runs=TINY + 10).to_dict())


def foreign(study: Path, name: str, data: bytes) -> Path:
    path = study / "parts" / name
    path.write_bytes(data)
    return path


def test_what_is_no_part_is_named_and_spoils_nothing(study: Path, tmp_path: Path) -> None:
    first = parts(study)[0].read_bytes()
    columns = tiny(tmp_path / "columns", 5 * BLOCK, summaries=("peak_rotation",))
    numbers = tiny(tmp_path / "numbers", 5 * BLOCK, seed=4)
    for name, data, why in (
        ("notes.txt", b"remember", "is not a part of a study"),
        ("000000 (copy).parquet", first, "is not a part of a study"),
        ("000007.parquet", b"nonsense", "does not end like a Parquet file"),
        ("000007.parquet", first[:-50], "does not end like a Parquet file"),
        ("000007.parquet", first, r"has runs that are in other parts too \(run 0 occurs twice\)"),
        ("000007.parquet", parts(columns.path)[-1].read_bytes(), "it belongs to another study"),
        ("000007.parquet", parts(numbers.path)[-1].read_bytes(), "it belongs to another study"),
    ):
        path = foreign(study, name, data)
        before = files(study)
        for ask in (sp.Study.open, lambda path: tiny(path)):
            with pytest.raises(sp.StoreError, match=f"^{re.escape(str(path))}: [^\n]*{why}"):
                ask(study)
        assert files(study) == before
        path.unlink()
        require_whole(study)


def test_hidden_files_are_left_alone(study: Path) -> None:
    path = foreign(study, ".DS_Store", b"desktop")
    tiny(study)
    assert path.read_bytes() == b"desktop"
