"""Random damage to any file of a study: it is refused in one line, or the numbers are the same."""

import re
import shutil
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.study.sampling import BLOCK
from stores import PUSH, files, require_same, tiny

RUNS = 2 * BLOCK + 200
KEPT = (3, 1700)
VARY = {
    PUSH: sp.Choice([0.0, 50.0], weights=[0.98, 0.02]),
    "grasped.mass": np.random.default_rng(5).uniform(0.09, 0.11, RUNS),
    "control.kp": np.random.default_rng(6).uniform(90.0, 110.0, RUNS),
}
Rng = np.random.Generator


def begin_or_continue(path: Path | None) -> Any:
    return tiny(path, None, vary=VARY, trajectories=KEPT)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two arrays, three parts and two kept paths."""
    path = tmp_path_factory.mktemp("alterations") / "study"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softpinch.store.folder.GATHER_SECONDS", 0.0)
        begin_or_continue(path)
    assert [len(list(path.glob(f"{name}/*"))) for name in ("parts", "arrays", "trajectories")] == [
        3,
        2,
        2,
    ]
    return path


@pytest.fixture(scope="module")
def expected() -> sp.Ensemble:
    ensemble: sp.Ensemble = begin_or_continue(None)
    return ensemble


def span(rng: Rng, size: int) -> slice:
    """Some bytes of a file."""
    begin = int(rng.integers(0, max(size, 1)))
    return slice(begin, begin + int(rng.integers(1, 200)))


def flip(data: bytearray, rng: Rng) -> None:
    if data:
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))


def overwrite(data: bytearray, rng: Rng) -> None:
    where = span(rng, len(data))
    data[where] = rng.bytes(len(data[where]))


def zero(data: bytearray, rng: Rng) -> None:
    where = span(rng, len(data))
    data[where] = bytes(len(data[where]))


def cut(data: bytearray, rng: Rng) -> None:
    del data[int(rng.integers(0, len(data) + 1)) :]


def cut_out(data: bytearray, rng: Rng) -> None:
    del data[span(rng, len(data))]


def repeat(data: bytearray, rng: Rng) -> None:
    where = span(rng, len(data))
    data[where.start : where.start] = data[where]


def append(data: bytearray, rng: Rng) -> None:
    data += rng.bytes(int(rng.integers(1, 200)))


def garble(data: bytearray, rng: Rng) -> None:
    data[:] = rng.bytes(len(data))


def change_a_number(data: bytearray, rng: Rng) -> None:
    """As an editor would: in the manifest, or in the JSON of a footer."""
    places = [match.span() for match in re.finditer(rb"(?<=[ \[:,])\d+", data)]
    if places:
        first, last = places[int(rng.integers(len(places)))]
        data[first:last] = b"%d" % rng.integers(10 ** (last - first))


IN_PLACE = (flip, overwrite, zero, cut, cut_out, repeat, append, garble, change_a_number)


def edit(file: Path, rng: Rng) -> str:
    change: Callable[[bytearray, Rng], None] = IN_PLACE[int(rng.integers(len(IN_PLACE)))]
    data = bytearray(file.read_bytes())
    change(data, rng)
    file.write_bytes(data)
    return change.__name__


def exchange(file: Path, other: Path) -> None:
    data = file.read_bytes()
    file.write_bytes(other.read_bytes())
    other.write_bytes(data)


def alter(path: Path, rng: Rng) -> str:
    """Changes one file or two at random; what was done."""
    there = sorted(file for file in path.rglob("*") if file.is_file())
    file, other = (there[int(k)] for k in rng.choice(len(there), 2, replace=False))
    kind = rng.choice(
        ["edit", "swap", "copy", "copy over", "delete", "rename"], p=[0.7] + [0.06] * 5
    )
    name = f"{rng.integers(3000):06}.parquet" if rng.random() < 0.7 else f"copy of {file.name}"
    match kind:
        case "edit":
            kind = edit(file, rng)
        case "swap":
            exchange(file, other)
        case "copy":
            shutil.copy(file, other.with_name(name))
        case "copy over":
            shutil.copy(file, other)
        case "delete":
            file.unlink()
        case "rename":
            file.rename(file.with_name(name))
    return f"{kind} {file.relative_to(path)} ({other.relative_to(path)}, {name})"


def refused(path: Path, ask: Callable[[], Any]) -> Path | None:
    """The file that an error names, where asking raises one, and then it is a `StoreError`."""
    try:
        ask()
    except sp.StoreError as error:
        for line in str(error).splitlines():
            assert line.startswith(f"{path}"), line
        named = re.match(rf"{path}/[^:]*", str(error))
        return Path(named[0]) if named else path
    return None


def readings(study: sp.Study, expected: sp.Ensemble) -> list[Callable[[], None]]:
    """What can be asked, each of which compares with the original numbers; first all columns."""
    missing = np.zeros(RUNS, bool)
    for first, last in study.missing.tolist():
        missing[first:last] = True
    there = np.flatnonzero(~missing)
    assert (study.requested, study.runs) == (RUNS, len(there))
    rows = {name: values[there] for name, values in expected.to_dict().items()}
    failed = there[expected.status[there] != "completed"].tolist()

    def columns() -> None:
        require_same(study.to_dict(), rows)

    def mean() -> None:
        found = study.mean("grasped.mass")
        assert not study.complete or found == expected.mean("grasped.mass")

    def chunks() -> None:
        runs = [run for chunk in study.chunks() for run in chunk.run.tolist()]
        assert sorted(runs) == there.tolist()

    def failures() -> None:
        assert [each.run for each in study.failures()] == failed

    def one_row() -> None:
        for run in there[-1:].tolist():
            assert study.scene_of(run) == expected.scene_of(run)

    return [columns, mean, chunks, failures, one_row]


def read_path(study: sp.Study, run: int, expected: sp.Ensemble) -> None:
    ours, theirs = study.trajectories[run]._result, expected.trajectories[run]._result
    assert ours.keys() == theirs.keys()
    for name, values in theirs.items():
        if isinstance(values, np.ndarray):
            assert (ours[name].shape, ours[name].tobytes()) == (values.shape, values.tobytes())
    assert (ours["status"], ours["message"]) == (theirs["status"], theirs["message"])


def read_all(path: Path, expected: sp.Ensemble, rng: Rng) -> Path | None:
    """All columns, all paths, and one of the other questions; the first file that is refused."""
    found: list[Path | None] = []

    def look() -> None:
        study = sp.Study.open(path)
        columns, *others = readings(study, expected)
        asked = [columns, others[int(rng.integers(len(others)))], study.verify]
        asked += [partial(read_path, study, run, expected) for run in study.trajectories]
        found.extend(refused(path, ask) for ask in asked)

    found.append(refused(path, look))
    return next(filter(None, found), None)


def attack(number: int, path: Path, whole: Path, expected: sp.Ensemble) -> None:
    rng = np.random.default_rng([20261122, number])
    shutil.copytree(whole, path)
    done = [alter(path, rng) for _ in range(1 + int(rng.random() < 0.3))]
    print(number, done)
    read_all(path, expected, rng)
    # Whoever continues it is refused, or what is there then is as good as before.
    if rng.random() < 0.5:
        refused(path, lambda: sp.Study.open(path).resume(progress=False))
    else:
        refused(path, lambda: begin_or_continue(path))
    # What is named is put right as the message says, until nothing is wrong.
    for _ in range(8):
        wrong = read_all(path, expected, rng)
        if wrong is None:
            study = begin_or_continue(path)
            assert study.complete and list(study.trajectories) == list(KEPT)
            require_same(study.to_dict(), expected.to_dict())
            return
        if wrong.parent.name == "arrays":
            wrong.unlink(missing_ok=True)
            begin_or_continue(path)
        elif wrong.parent.name in ("parts", "trajectories"):
            wrong.unlink(missing_ok=True)
            refused(path, lambda: sp.Study.open(path).resume(progress=False))
        else:
            shutil.copy(whole / "manifest.toml", path)
    raise AssertionError("it was not put right")


# The first forty of them; those of all numbers are slow.
@pytest.mark.parametrize(
    "forty", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 50))]
)
def test_no_alteration_gives_other_numbers(
    forty: int, whole: Path, expected: sp.Ensemble, tmp_path: Path
) -> None:
    before = files(whole)
    for number in range(40 * forty, 40 * forty + 40):
        attack(number, tmp_path / str(number), whole, expected)
        shutil.rmtree(tmp_path / str(number))
    assert files(whole) == before


def test_every_byte_of_a_record_counts(whole: Path, tmp_path: Path) -> None:
    """A record is what no page checksum covers."""
    part = next((whole / "parts").iterdir())
    data = part.read_bytes()
    entry = re.search(rb"softpinch-record [0-9a-f]{64} \{[^\n]*\}\n", data)
    assert entry is not None
    path = Path(shutil.copytree(whole, tmp_path / "study"))
    place = path / "parts" / part.name
    for at in range(entry.start(), entry.end(), 11):
        altered = bytearray(data)
        altered[at] ^= 1 << (zlib.crc32(b"%d" % at) % 8)
        place.write_bytes(altered)
        with pytest.raises(sp.StoreError, match=f"^{place}: is damaged: .*; delete it and resume"):
            sp.Study.open(path)
