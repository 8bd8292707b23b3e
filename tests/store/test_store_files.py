"""A file that is altered, cut, foreign or missing is named in one line, and no number differs."""

import hashlib
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest

import softpinch as sp
from softpinch.study.sampling import BLOCK
from stores import PUSH, TINY, files, parts, require_same, require_whole, resume, tiny

pytestmark = pytest.mark.usefixtures("small_parts")

RUNS = 2 * BLOCK + 200
KEPT = (3, 1700)
MASSES = np.random.default_rng(5).uniform(0.09, 0.11, RUNS)
VARY = {
    PUSH: sp.Choice([0.0, 50.0], weights=[0.98, 0.02]),
    "grasped.mass": MASSES,
    "control.kp": 1e3 * MASSES,
}
REMEDY = "delete it and resume the study, which computes it again"


def begin_or_continue(path: Path | None) -> Any:
    return tiny(path, None, vary=VARY, trajectories=KEPT)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two arrays, three parts and two trajectories."""
    path = tmp_path_factory.mktemp("alterations") / "study"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softpinch.store.folder.GATHER_SECONDS", 0.0)
        begin_or_continue(path)
    return path


@pytest.fixture(scope="module")
def expected() -> sp.Ensemble:
    ensemble: sp.Ensemble = begin_or_continue(None)
    return ensemble


def flip(file: Path, place: int = -100) -> None:
    data = bytearray(file.read_bytes())
    data[place] ^= 4
    file.write_bytes(data)


def alter(path: Path, rng: np.random.Generator) -> str:
    """Changes a file at random; returns a description."""
    there = sorted(file for file in path.rglob("*") if file.is_file() and file.name != "lock")
    file, other = (there[int(k)] for k in rng.choice(len(there), 2, replace=False))
    kind = str(rng.choice(["flip", "cut", "garble", "append", "swap", "copy", "delete", "rename"]))
    data = file.read_bytes()
    match kind:
        case "flip":
            flip(file, int(rng.integers(len(data))))
        case "cut":
            file.write_bytes(data[: rng.integers(len(data))])
        case "garble":
            file.write_bytes(rng.bytes(len(data)))
        case "append":
            file.write_bytes(data + rng.bytes(9))
        case "swap":
            file.write_bytes(other.read_bytes())
            other.write_bytes(data)
        case "copy":
            shutil.copy(file, other)
        case "delete":
            file.unlink()
        case "rename":
            file.rename(file.with_name(f"{rng.integers(3000):06}.parquet"))
    return f"{kind} {file.relative_to(path)} ({other.relative_to(path)})"


def refused(path: Path, ask: Callable[[], Any]) -> Path | None:
    """The file that an error names; None if asking raises no `StoreError`."""
    try:
        ask()
    except sp.StoreError as error:
        for line in str(error).splitlines():
            assert line.startswith(f"{path}"), line
        return Path(str(error).split(": ")[0])
    return None


def read_all(path: Path, expected: sp.Ensemble) -> Path | None:
    """Reads all rows and trajectories; returns the file that is refused, if there is one."""

    def ask() -> None:
        study = sp.Study.open(path)
        there = np.ones(RUNS, bool)
        for first, end in study.missing.tolist():
            there[first:end] = False
        require_same(study.to_dict(), {n: v[there] for n, v in expected.to_dict().items()})
        for run, found in study.trajectories.items():
            np.testing.assert_array_equal(found.q, expected.trajectories[run].q)
        study.verify()

    return refused(path, ask)


@pytest.mark.parametrize(
    "ten", [0, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in range(2, 50))]
)
def test_no_alteration_gives_other_numbers(
    ten: int, whole: Path, expected: sp.Ensemble, tmp_path: Path
) -> None:
    for number in range(10 * ten, 10 * ten + 10):
        path = Path(shutil.copytree(whole, tmp_path / str(number)))
        print(number, alter(path, np.random.default_rng([20261124, number])))
        for _ in range(8):
            wrong = read_all(path, expected)
            if wrong is None:
                break
            # As the messages say.
            if wrong.name == "manifest.toml" or wrong == path:
                shutil.copy(whole / "manifest.toml", path)
            else:
                wrong.unlink(missing_ok=True)
                refused(path, lambda path=path: begin_or_continue(path))  # type: ignore[misc]
        study = begin_or_continue(path)
        assert study.complete and list(study.trajectories) == list(KEPT)
        require_same(study.to_dict(), expected.to_dict())


ASK: dict[str, Callable[[sp.Study], Any]] = {
    "column": lambda study: study.status,
    "mean": lambda study: study.mean("grasped.mass"),
    "ensemble": lambda study: study.ensemble(),
    "chunks": lambda study: list(study.chunks()),
    "failures": lambda study: study.failures(),
    "replay": lambda study: study.replay(TINY - 1),
    "verify": lambda study: study.verify(),
}


def test_every_question_refuses_an_altered_part_which_resume_replaces(study: Path) -> None:
    opened = sp.Study.open(study)
    part = parts(study)[2]
    whole = part.read_bytes()
    flip(part, len(whole) // 2)
    for ask in ASK.values():
        with pytest.raises(sp.StoreError, match=f"^{part}: is damaged: its SHA-256 .*; {REMEDY}$"):
            ask(opened)
    # A whole part of other runs in its place is refused, too.
    part.write_bytes(parts(study)[0].read_bytes())
    with pytest.raises(sp.StoreError, match=f"^{part}: is damaged: its SHA-256 differs"):
        opened.mean("grasped.mass")
    part.unlink()
    with pytest.raises(sp.StoreError, match=f"^{part}: is missing: restore it, or resume"):
        opened.mean("grasped.mass")
    told: list[tuple[int, int]] = []
    sp.Study.open(study).resume(progress=lambda *how: told.append(how))
    assert told[-1] == (BLOCK, BLOCK)
    require_whole(study)
    assert part.read_bytes() == whole


@pytest.mark.parametrize("content", [b"", b"nonsense" * 40, None], ids=["empty", "text", "cut"])
def test_a_part_without_its_footer_is_named_when_the_study_is_opened(
    content: bytes | None, study: Path
) -> None:
    part = parts(study)[1]
    part.write_bytes(part.read_bytes()[:-50] if content is None else content)
    before = files(study)
    for ask in (sp.Study.open, lambda path: tiny(path, TINY + 5)):
        with pytest.raises(sp.StoreError, match=f"^{part}: is damaged: [^\n]*; {REMEDY}$"):
            ask(study)
    assert files(study) == before


def test_digests_are_those_of_sha256sum(study: Path) -> None:
    tiny(study, trajectories=(5,))
    digests = sorted((study / "digests").iterdir())
    assert len(digests) == 4
    for file in digests:
        found, name = file.read_text().split()
        assert found == hashlib.sha256((study / name).read_bytes()).hexdigest()
    if shutil.which("sha256sum"):
        subprocess.run(["sha256sum", "--check", "--quiet", *digests], cwd=study, check=True)
    digests[1].unlink()
    with pytest.raises(sp.StoreError, match=f"^{parts(study)[1]}: has no digest in digests; "):
        sp.Study.open(study)


def test_a_part_that_is_deleted_is_missing_runs_of_which_opening_warns(study: Path) -> None:
    parts(study)[1].unlink()
    text = f"{study}: runs {BLOCK} to {2 * BLOCK - 1} of {TINY} are missing; `resume()` computes"
    with pytest.warns(sp.LostRunsWarning, match=f"^{re.escape(text)} them") as seen:
        again = sp.Study.open(study)
    assert [warning.filename for warning in seen] == [__file__]
    assert again.missing.tolist() == [[BLOCK, 2 * BLOCK]] and again.runs == 2 * BLOCK
    again.verify()
    share = again.probability("completed")
    assert (share.runs, share.missing) == (2 * BLOCK, BLOCK)
    assert str(share).endswith(f" of {2 * BLOCK} runs, {TINY} requested")
    found = again.resume(progress=False)
    assert found.complete and found.probability("completed").missing == 0
    require_whole(study)


def test_a_study_that_stop_when_ended_is_opened_without_a_warning(tmp_path: Path) -> None:
    tiny(tmp_path, stop_when={"separated": 0.5})
    assert sp.Study.open(tmp_path).runs == BLOCK


def test_verify_names_every_damaged_file(study: Path) -> None:
    tiny(study, trajectories=(5, 6))
    opened = sp.Study.open(study)
    opened.verify()
    damaged = [*parts(study), study / "trajectories" / "5.parquet"]
    for file in damaged:
        flip(file)
    with pytest.raises(sp.StoreError) as caught:
        opened.verify()
    lines = str(caught.value).splitlines()
    assert [line.split(": ")[0] for line in lines] == [str(file) for file in damaged]


def test_a_damaged_trajectory_is_named_and_computed_again(study: Path) -> None:
    expected = tiny(study, trajectories=(5, 6)).trajectories[5]
    file = study / "trajectories" / "5.parquet"
    whole = file.read_bytes()
    file.write_bytes((study / "trajectories" / "6.parquet").read_bytes())
    opened = resume(study)
    assert list(opened.trajectories) == [5, 6]
    with pytest.raises(sp.StoreError, match=f"^{file}: is damaged: [^\n]*; {REMEDY}$"):
        opened.trajectories[5]
    file.unlink()
    with pytest.warns(sp.LostRunsWarning, match="trajectories of runs 5 are missing; `resume"):
        opened = sp.Study.open(study)
    assert list(opened.trajectories) == [6]
    with pytest.raises(KeyError, match=f"{file} is missing"):
        opened.trajectories[5]
    with pytest.raises(sp.StoreError, match=f"^{file}: is missing"):
        opened.verify()
    np.testing.assert_array_equal(resume(study).trajectories[5].q, expected.q)
    assert file.read_bytes() == whole
    # Without its run's row it is not shown.
    parts(study)[0].unlink()
    opened = sp.Study.open(study)
    assert list(opened.trajectories) == [] and 5 not in opened.trajectories


def test_a_foreign_file_among_the_parts_is_named(study: Path, tmp_path: Path) -> None:
    first = parts(study)[0]
    other = parts(tiny(tmp_path / "other", 5 * BLOCK, seed=4).path)[-1]
    for name, source, why in (
        ("notes.txt", first, "is not a part of a study"),
        ("000007.parquet", first, r"has runs that are in other parts too \(run 0 occurs twice\)"),
        ("000007.parquet", other, "is damaged: it belongs to another study than manifest"),
    ):
        path = study / "parts" / name
        shutil.copy(source, path)
        digest = source.parents[1] / "digests" / f"parts-{source.name}.sha256"
        shutil.copy(digest, study / "digests" / f"parts-{name}.sha256")
        for ask in (sp.Study.open, lambda path: tiny(path)):
            with pytest.raises(sp.StoreError, match=f"^{re.escape(str(path))}: [^\n]*{why}"):
                ask(study)
        path.unlink()
    (study / "parts" / ".DS_Store").write_bytes(b"a desktop's")
    require_whole(study)


@pytest.mark.parametrize("rows", [10, 2**15 + 2**23 // 5 + 1])
def test_a_part_with_other_rows_than_a_study_writes_is_refused_unread(
    rows: int, study: Path
) -> None:
    """A stranger's small file may decompress to more than the memory."""
    part = parts(study)[0]
    table = pa.table({f"column {k}": np.zeros(rows) for k in range(5)})
    facts = (
        parquet.read_schema(part)
        .metadata[b"softpinch"]
        .replace(b"[[0, 1024]]", b"[[0, %d]]" % rows)
    )
    if rows == 10:
        facts = facts.replace(b"10", b"11")
    parquet.write_table(table.replace_schema_metadata({"softpinch": facts}), part)
    with pytest.raises(sp.StoreError, match=f"^{part}: is damaged: "):
        sp.Study.open(study)


def test_half_written_files_of_a_killed_writer_are_removed_by_the_next(study: Path) -> None:
    left = [study / ".manifest.toml.partial", study / "parts" / ".000003.parquet.partial"]
    for file in left:
        file.write_bytes(b"half a part")
    require_whole(study)
    assert all(file.exists() for file in left)
    tiny(study, TINY + 10)
    assert not any(file.exists() for file in left)
    require_same(sp.Study.open(study).to_dict(), tiny(runs=TINY + 10).to_dict())


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda path: flip(path, -1), r"has been altered: its checksum differs"),
        (lambda path: np.save(path, np.arange(7)), "has been altered: its checksum"),
        (lambda path: path.write_bytes(b""), "is damaged: "),
        (lambda path: np.save(path, np.array([{}]), allow_pickle=True), "is damaged: "),
        (Path.unlink, "is missing"),
    ],
)
def test_a_damaged_array_is_named_and_written_again(
    damage: Any, words: str, tmp_path: Path
) -> None:
    vary: Any = {"grasped.mass": MASSES[:100]}
    tiny(tmp_path, None, vary=vary)
    (file,) = (tmp_path / "arrays").iterdir()
    damage(file)
    study = sp.Study.open(tmp_path)
    np.testing.assert_array_equal(study["grasped.mass"], MASSES[:100])
    for ask in (study.resume, study.verify):
        with pytest.raises(sp.StoreError, match=f"^{file}: {words}[^\n]*, which writes it again$"):
            ask()
    tiny(tmp_path, None, vary=vary)
    sp.Study.open(tmp_path).verify()


def test_other_arrays_are_another_study_and_another_order_is_not(tmp_path: Path) -> None:
    mass = MASSES[:100]
    vary: dict[Any, Any] = {"grasped.mass": mass, "control.kp": 1e3 * mass}
    tiny(tmp_path, None, vary=vary)
    changed = mass.copy()
    changed[7] = np.nextafter(changed[7], 1.0)
    with pytest.raises(ValueError, match=r"vary\.grasped\.mass\.sha256 is '.*' there, and ") as e:
        tiny(tmp_path, None, vary={**vary, "grasped.mass": changed})
    assert "control" not in str(e.value)
    turned: dict[Any, Any] = {"control.kp": vary["control.kp"], "grasped.mass": mass.tolist()}
    assert tiny(tmp_path, None, vary=turned).complete


READER = """
import os, sys
import softpinch as sp

study = sp.Study.open(sys.argv[1])
before = len(os.listdir("/proc/self/task"))
study.verify()
print(len(os.listdir("/proc/self/task")) - before)
"""


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="the system does not list threads")
def test_reading_starts_no_threads_that_outlive_it(whole: Path) -> None:
    # A process that ended while Arrow's threads held what was read could abort.
    command = [sys.executable, "-c", READER, str(whole)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(done.stdout) == 0
