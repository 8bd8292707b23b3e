"""A study in a folder has what the ensemble in memory has, to the bit."""

import copy
import pickle
import subprocess
import sys
import threading
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from executors import Inline, until
from softpinch.store import folder
from softpinch.study.sampling import BLOCK
from stores import (
    KINDS,
    RUNS,
    TINY,
    compute,
    in_memory,
    parts,
    require_same,
    require_whole,
    resume,
    tiny,
)


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A part for every piece."""
    monkeypatch.setattr(folder, "GATHER_SECONDS", 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_every_column_has_the_bits_of_the_ensemble(kind: str, tmp_path: Path) -> None:
    study = compute(kind, store=tmp_path / "deep" / "study")
    assert isinstance(study, sp.Study)
    assert len(parts(study.path)) > 1
    expected = in_memory(kind)
    assert kind == "nothing" or not np.isnan(expected["first_separated"]).all()
    for found in (study, sp.Study.open(study.path), sp.Study.open(str(study.path))):
        assert (found.runs, len(found), found.requested) == (RUNS, RUNS, RUNS)
        assert found.complete and found.missing.shape == (0, 2)
        require_same(found.to_dict(), expected.to_dict())
        require_same(found.ensemble().to_dict(), expected.to_dict())
    assert not any(values.flags.writeable for values in study.to_dict().values())


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"functions", "latin", "arrays"}))
def test_a_study_is_resumed_and_extended_from_its_file_alone(kind: str, tmp_path: Path) -> None:
    # The last block is there in part, and a hole is in the middle.
    some = np.delete(np.arange(1500), np.arange(900, 1100))
    study = compute(kind, 1500, only=some, store=tmp_path)
    assert (study.runs, study.complete, study.requested) == (1300, False, 1500)
    assert study.missing.tolist() == [[900, 1100]]
    written = {path: path.read_bytes() for path in parts(tmp_path)}
    study = sp.Study.open(tmp_path).resume(progress=False)
    assert study.complete and study.runs == 1500
    study = study.extend(RUNS, threads=1, progress=False)
    require_same(study.to_dict(), in_memory(kind).to_dict())
    # What was there is as it was.
    assert all(path.read_bytes() == data for path, data in written.items())


def test_a_study_with_functions_continues_by_another_call_of_monte_carlo(tmp_path: Path) -> None:
    compute("functions", 1500, store=tmp_path)
    study = sp.Study.open(tmp_path)
    for go_on in (study.resume, lambda: study.extend(RUNS)):
        with pytest.raises(
            ValueError, match=r"grasped\.mass.*is the function or .*cannot be written"
        ):
            go_on()
    study = compute("functions", store=tmp_path)
    require_same(study.to_dict(), in_memory("functions").to_dict())


def test_a_function_that_gives_other_numbers_when_asked_again_is_refused(tmp_path: Path) -> None:
    calls = 0

    def counting(rng: np.random.Generator) -> float:
        nonlocal calls
        calls += 1
        return 0.1 + 1e-9 * calls

    with pytest.raises(ValueError, match=r"'grasped\.mass': a second draw gave other numbers"):
        tiny(tmp_path / "study", vary={"control.kp": sp.Normal(100, 1), "grasped.mass": counting})
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize("kind", ["latin", "arrays"])
def test_latin_hypercubes_and_arrays_are_resumed_but_not_extended(
    kind: str, tmp_path: Path
) -> None:
    compute(kind, only=np.arange(5, 1200), store=tmp_path)
    study = sp.Study.open(tmp_path)
    with pytest.raises(ValueError, match=r"cannot be extended|must have one for each run"):
        study.extend(RUNS + 1, progress=False)
    require_same(study.resume(progress=False).to_dict(), in_memory(kind).to_dict())


def test_only_some_runs(tmp_path: Path) -> None:
    only = np.array([0, 3, 1023, 1024, 2000, RUNS - 1])
    expected = compute("ours", only=only)
    study = compute("ours", only=only, store=tmp_path)
    require_same(study.to_dict(), expected.to_dict())
    assert (study.runs, study.requested, study.complete) == (6, RUNS, False)
    # Those that are there are not computed again.
    told: list[tuple[int, int]] = []
    again = np.array([0, 4, 1024])
    study = compute("ours", only=again, store=tmp_path, progress=lambda *how: told.append(how))
    assert told[-1] == (1, 1)
    require_same(study.to_dict(), compute("ours", only=np.union1d(only, again)).to_dict())


def test_rows_gather_into_parts_by_time_and_by_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = compute("ours", check_dt=True, trajectories=(3,))
    monkeypatch.setattr(folder, "GATHER_SECONDS", 1e9)
    for most, count in ((2**23, 1), (1000, 3)):
        monkeypatch.setattr(folder, "MOST_NUMBERS", most)
        study = compute("ours", check_dt=True, trajectories=(3,), store=tmp_path / str(most))
        assert len(parts(study.path)) == count
        require_same(study.to_dict(), expected.to_dict())
        require_discretisation(study.discretisation, expected.discretisation)
        assert flat(study.trajectories[3]._result) == flat(expected.trajectories[3]._result)


def test_rows_are_written_while_a_worker_is_long_at_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder, "GATHER_SECONDS", 0.5)

    class Slow(Inline):
        """Its last block comes when the first ones are in the folder."""

        def submit(self, function: Any, /, *args: Any, **how: Any) -> Future[Any]:
            future = super().submit(function, *args, **how)
            if self.calls[-1].block < 2:
                return future
            late: Future[Any] = Future()

            def come() -> None:
                with suppress(AssertionError):
                    until(lambda: bool(parts(tmp_path)))
                seen.append(len(parts(tmp_path)))
                late.set_result(future.result())

            threading.Thread(target=come).start()
            return late

    seen: list[int] = []
    tiny(tmp_path, executor=Slow())
    assert seen[0] >= 1
    require_whole(tmp_path)


def coin(store: Path | None = None, **how: Any) -> Any:
    return tiny(store, 9 * BLOCK, **how)


NARROW = {"separated": 0.0251, "completed": 0.03}


def test_stop_when_stops_where_the_ensemble_does_however_it_came_there(tmp_path: Path) -> None:
    expected = coin(stop_when=NARROW)
    assert 2 * BLOCK < expected.runs < 7 * BLOCK
    study = coin(tmp_path / "at once", stop_when=NARROW)
    require_same(study.to_dict(), expected.to_dict())
    assert study.requested == 9 * BLOCK and not study.complete
    # It is enough: nothing is computed any more.
    assert study.resume(progress=False).runs == expected.runs
    # Later blocks are there, that which decides but for its first runs: none counts before its turn
    # and before it is whole.
    path = tmp_path / "later"
    decides = expected.runs - BLOCK
    there = np.r_[decides + 7 : decides + BLOCK, 8 * BLOCK : 9 * BLOCK]
    coin(path, only=there)
    study = coin(path, stop_when=NARROW)
    wanted = np.union1d(there, expected.run.astype(int))
    require_same(study.to_dict(), coin(only=wanted).to_dict())
    # Without it, all that is missing is.
    require_same(coin(path).to_dict(), coin().to_dict())


def require_discretisation(ours: Any, theirs: Any) -> None:
    """To the bit."""
    assert ours.keys() == theirs.keys() != set()
    for name, each in ours.items():
        for field, value in vars(each).items():
            np.testing.assert_array_equal(value, getattr(theirs[name], field))


def test_check_dt_says_what_it_says_of_the_ensemble(tmp_path: Path) -> None:
    expected = compute("ours", check_dt=True)
    study = compute("ours", check_dt=True, store=tmp_path)
    require_discretisation(study.discretisation, expected.discretisation)
    # It is of the call, not of the folder; a resumed one has it again.
    assert sp.Study.open(tmp_path).discretisation is None
    again = sp.Study.open(tmp_path).resume(progress=False)
    require_discretisation(again.discretisation, study.discretisation)


PATHS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "csm": ({}, {"dt": 1e-3}),
    "nullspace": ({}, {"dt": 1e-3, "formulation": "nullspace", "method": "implicit_midpoint"}),
    "dop853": ({}, {"tolerance": 1e-7, "formulation": "nullspace", "method": "dop853"}),
    "driven": ({"fingers": "driven"}, {"dt": 1e-3, "formulation": "nullspace"}),
    "adaptive and driven": (
        {"fingers": "driven"},
        {"tolerance": 1e-7, "formulation": "nullspace", "method": "dop853"},
    ),
    "not finite": (
        {"hand": sp.Hand(tip=sp.Fingertip(youngs_modulus=1e300))},
        {"dt": 1e-3, "stop_on": ()},
    ),
}


def flat(value: Any) -> Any:
    """Numbers of a run's result as bytes, which NaN has too."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, dict):
        return {name: flat(item) for name, item in value.items()}
    return (type(value), repr(value))


def test_paths_that_a_stopped_study_was_to_keep_are_kept_by_the_one_that_goes_on(
    tmp_path: Path,
) -> None:
    def stop(done: int, runs: int) -> None:
        raise KeyboardInterrupt

    assert tiny(tmp_path, trajectories=(TINY - 1, 3), progress=stop).interrupted
    assert not sp.Study.open(tmp_path).trajectories
    # Nor does one that asks for others forget them.
    assert list(tiny(tmp_path, runs=100, trajectories=[5]).trajectories) == [5]
    study = resume(tmp_path)
    assert list(study.trajectories) == [3, 5, TINY - 1]
    again = tiny(trajectories=(TINY - 1,)).trajectories[TINY - 1]
    assert flat(study.trajectories[TINY - 1]._result) == flat(again._result)


@pytest.mark.parametrize("name", PATHS)
def test_kept_paths_are_replays(name: str, tmp_path: Path) -> None:
    fields, how = PATHS[name]
    scene = sp.Scene(
        **{
            "schedule": sp.Schedule.minimum_jerk([0.0], [[0.105, 0.105]], move_time=0.02),
            "disturbances": [sp.Step(time=0.003, force=(2.0, -1.0), moment=0.01)],
            "duration": 0.02,
            **fields,
        }
    )
    vary = {"disturbances.0.force": sp.Uniform((-5.0, -5.0), (5.0, 5.0))}
    given: dict[str, Any] = {"runs": 9, "vary": vary, "progress": False, **how}
    memory = sp.monte_carlo(scene, trajectories=(2, 7), **given)
    study = sp.monte_carlo(scene, store=tmp_path, trajectories=[2], **given)
    # Another call adds to them.
    study = sp.monte_carlo(scene, store=tmp_path, trajectories=[7], **given)
    study = sp.Study.open(tmp_path)
    assert list(study.trajectories) == [2, 7] and len(study.trajectories) == 2
    assert 2 in study.trajectories and np.int64(7) in study.trajectories
    for no in (3, "2", -1):
        assert no not in study.trajectories
    with pytest.raises(KeyError, match=r"run 3 is not kept: pass trajectories=\(3,\)"):
        study.trajectories[3]
    for run in (2, 7):
        read = study.trajectories[run]
        for other in (memory.trajectories[run], study.replay(run)):
            assert flat(read._result) == flat(other._result)
            assert (read.scene, read._options) == (other.scene, other._options)
        assert read.provenance() == study.replay(run).provenance()
        assert not read.q.flags.writeable
    if name == "not finite":
        assert read.status == "not_finite"
        return
    # A run goes on from it as from the other.
    ends = [one.state() for one in (read, memory.trajectories[7])]
    assert repr(ends[0]) == repr(ends[1]) and ends[0] == ends[1]


def test_a_study_is_read_while_another_process_writes(tmp_path: Path) -> None:
    tiny(tmp_path, 2 * BLOCK)
    script = (
        "import sys; from pathlib import Path; import stores\n"
        "def wait(done, runs):\n"
        "    if done > 1024:\n"
        "        print('locked', flush=True); sys.stdin.readline()\n"
        "from softpinch.store import folder; folder.GATHER_SECONDS = 0\n"
        "import softpinch as sp\n"
        "sp.Study.open(sys.argv[1]).extend(9 * 1024, threads=1, progress=wait)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as writer:
        assert writer.stdin is not None and writer.stdout is not None
        assert writer.stdout.readline() == "locked\n"
        with pytest.raises(sp.StoreError, match="is being written by another process"):
            tiny(tmp_path, 9 * BLOCK)
        study = sp.Study.open(tmp_path)
        assert 2 * BLOCK < study.runs < 9 * BLOCK == study.requested
        assert f"{study.runs} of {9 * BLOCK} runs" in repr(study)
        seen = study.to_dict()
        study.verify()
        assert study.failures()[0].replay().status == "separated"
        writer.communicate("\n" * 100, timeout=60)
    assert writer.returncode == 0
    # What was opened shows what it showed; what is opened again all.
    require_same(study.to_dict(), seen)
    require_same(seen, tiny(only=study.run, runs=9 * BLOCK).to_dict())
    require_same(sp.Study.open(tmp_path).to_dict(), tiny(runs=9 * BLOCK).to_dict())


def test_a_study_pickles_as_its_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    study = tiny(Path("here"), 2000, check_dt=True, trajectories=(3,))
    data = pickle.dumps(study)
    assert len(data) < 1500
    monkeypatch.chdir("/")
    for again in (pickle.loads(data), copy.deepcopy(pickle.loads(data))):
        require_same(again.to_dict(), tiny(runs=2000).to_dict())
        require_discretisation(again.discretisation, study.discretisation)
        assert list(again.trajectories) == [3]


def test_a_study_stays_where_it_is_when_the_process_goes_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    studies = [tiny("study", BLOCK), sp.Study.open("study")]
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    for study in [*studies, pickle.loads(pickle.dumps(studies[0]))]:
        assert study.status.tolist() == studies[0].status.tolist()
        assert study.resume(progress=False).complete
        assert len(study.failures()) and study.failures()[0].run == study.failures()[0].run
    assert not any(Path().iterdir())


def test_a_study_whose_folder_is_gone_says_so(tmp_path: Path) -> None:
    study = tiny(tmp_path / "study", BLOCK)
    study.path.rename(tmp_path / "moved")
    with pytest.raises(sp.StoreError, match=r"study: is not a study: there is no manifest"):
        study.resume()
    with pytest.raises(sp.StoreError, match=r"000000\.parquet: is missing: restore it"):
        study.mean("grasped.mass")
    assert not study.path.exists()


@pytest.mark.slow
def test_parts_that_are_as_large_as_they_become_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Runs of one step arrive faster than any clock makes parts of them."""
    monkeypatch.setattr(folder, "GATHER_SECONDS", 3600.0)
    runs = 900_000
    study = sp.monte_carlo(
        sp.Scene(duration=1e-4), runs=runs, seed=1, dt=1e-4, summaries=(), progress=False,
        vary={"grasped.mass": sp.Uniform(0.07, 0.09)}, store=tmp_path / "study",
    )  # fmt: skip
    assert len(list((tmp_path / "study" / "parts").iterdir())) == 2
    assert study.counts() == {"completed": runs}
    assert sp.Study.open(tmp_path / "study").complete
