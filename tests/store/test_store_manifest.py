"""A folder is continued by the study that it holds, and by no other."""

import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import softpinch as sp
from softpinch import _core
from softpinch.store import manifest
from softpinch.store import study as stored
from softpinch.study.sampling import BLOCK
from stores import (
    PUSH,
    TINY,
    TINY_SCENE,
    TINY_VARY,
    edit,
    files,
    require_same,
    require_whole,
    resume,
    tiny,
)

pytestmark = pytest.mark.usefixtures("small_parts")

# What another study has other -> each field that differs, with what it was and is.
OTHERS: dict[str, tuple[dict[str, Any], str]] = {
    "scene": (
        {"scene": replace(TINY_SCENE, gravity=9.8, friction=0.5)},
        "scene.gravity is 9.81 there, and 9.8 here; "
        "scene.friction is not given there, and 0.5 here",
    ),
    "a distribution's number": (
        {"vary": {**TINY_VARY, "grasped.mass": sp.Normal(0.1, 0.02)}},
        "vary.grasped.mass.std is 0.01 there, and 0.02 here",
    ),
    "a path less": (
        {"vary": {PUSH: TINY_VARY[PUSH]}},
        "vary.grasped.mass.kind is 'normal' there, and not given here; "
        "vary.grasped.mass.mean is 0.1 there, and not given here; "
        "vary.grasped.mass.std is 0.01 there, and not given here",
    ),
    "draws": (
        {"seed": 4, "sampler": "sobol"},
        "study.sampler is 'random' there, and 'sobol' here; study.seed is 3 there, and 4 here",
    ),
    "numerics": (
        {
            "dt": None, "tolerance": 1e-5, "method": "dop853", "formulation": "nullspace",
            "stabilization": sp.Stabilization(900.0, 1000.0), "stop_on": ("separated",),
            "max_steps": 999,
        },
        "study.dt is 0.001 there, and not given here; "
        "study.method is 'rk4' there, and 'dop853' here; "
        "study.formulation is 'csm' there, and 'nullspace' here; "
        "study.stop_on is ['separated', 'crushed', 'folded'] there, and ['separated'] here; "
        "study.alpha is 1000.0 there, and 900.0 here; "
        "study.tolerance is not given there, and 1e-05 here; "
        "study.max_steps is not given there, and 999 here",
    ),
    "summaries": (
        {"summaries": "peak_rotation", "settling_band": 0.01},
        "study.summaries is ['final_state'] there, and ['peak_rotation'] here; "
        "study.settling_band is 0.001 there, and 0.01 here",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_another_study_is_refused_field_by_field(name: str, finished: Path) -> None:
    given, differences = OTHERS[name]
    before = files(finished)
    with pytest.raises(ValueError) as caught:
        tiny(finished, **given)
    assert str(caught.value) == (
        f"{finished}: holds another study: {differences}; give that study, or another folder"
    )
    assert files(finished) == before


def test_settings_on_which_no_row_depends_may_differ(study: Path) -> None:
    tiny(study, stop_when={"separated": 0.5}, check_dt=True)
    require_whole(study)
    assert sp.Study.open(study).made_by == tomllib.loads(
        (study / "manifest.toml").read_text()
    )["made_by"]  # fmt: skip


def test_more_runs_than_are_asked_for_stay(finished: Path) -> None:
    for study in (tiny(finished, TINY - 1), sp.Study.open(finished).extend(TINY - 1)):
        assert (study.runs, study.requested, study.complete) == (TINY, TINY, True)
    require_whole(finished)


def test_fewer_runs_are_asked_for_than_a_function_has_drawn(tmp_path: Path) -> None:
    how = {"vary": {"grasped.mass": lambda rng: rng.normal(0.1, 0.01)}}
    tiny(tmp_path / "whole", runs=TINY, **how)
    assert tiny(tmp_path / "whole", runs=500, **how).runs == TINY
    # Those that are there are all beyond those that are asked for.
    tiny(tmp_path / "end", runs=TINY, only=np.arange(2 * BLOCK, TINY), **how)
    assert tiny(tmp_path / "end", runs=500, **how).runs == BLOCK + 500


def test_a_latin_hypercube_is_not_extended(tmp_path: Path) -> None:
    tiny(tmp_path, 50, sampler="latin_hypercube")
    with pytest.raises(ValueError, match=r"study\.runs is 50 there, and 60 here: a Latin"):
        tiny(tmp_path, 60, sampler="latin_hypercube")


def test_another_results_version_is_refused_and_read(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_core, "RESULTS_VERSION", _core.RESULTS_VERSION + 1)
    with pytest.raises(sp.StoreError, match=r"made with softpinch .*, results version \d+; this "):
        tiny(study, TINY + 1)
    with pytest.raises(sp.StoreError, match="results version"):
        resume(study)
    monkeypatch.undo()
    require_whole(study)


@pytest.mark.parametrize("version", [3, 5])
def test_another_store_format_is_refused_in_one_line(version: int, study: Path) -> None:
    edit(study / "manifest.toml", "format = 4\n", f"format = {version}\n")
    said = f"^{study}: has store format {version}; this softpinch reads 4: [^\n]*$"
    for ask in (sp.Study.open, resume, lambda path: tiny(path)):
        with pytest.raises(sp.StoreError, match=said):
            ask(study)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (f"runs = {TINY}", f"runs = {TINY - 1}"),
        (f"runs = {TINY}", ""),
        ('sampler = "random"', 'sampler = "sobol"'),
        ("gravity = 9.81", "gravity = "),
        ("[[made_by]]", "[made_by]"),
    ],
)
def test_a_manifest_that_was_altered_is_named(old: str, new: str, study: Path) -> None:
    edit(study / "manifest.toml", old, new)
    for ask in (sp.Study.open, lambda path: tiny(path)):
        with pytest.raises(sp.StoreError, match=r"manifest\.toml: is damaged: [^\n]*; restore"):
            ask(study)


def test_a_folder_without_a_study_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (tmp_path, tmp_path / "nowhere", tmp_path / "file"):
        with pytest.raises(sp.StoreError, match=r"is not a study: there is no manifest\.toml"):
            sp.Study.open(path)


def test_numbers_drawn_otherwise_are_refused(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = manifest.made_by()
    monkeypatch.setattr(manifest, "made_by", lambda: {**real, "numpy": "9.9.9"})
    normal = sp.Normal.sample

    def other(self: sp.Normal, rng: np.random.Generator, size: int) -> Any:
        return np.nextafter(normal(self, rng, size), 1.0)

    monkeypatch.setattr(sp.Normal, "sample", other)
    before = files(study)
    with pytest.raises(sp.StoreError, match=r"grasped\.mass: a new draw differs") as caught:
        tiny(study, TINY + 5)
    assert f"numpy {np.__version__} then, 9.9.9 now" in str(caught.value)
    assert files(study) == before


def test_a_changed_function_is_refused(tmp_path: Path) -> None:
    mean = 0.1

    def mass(rng: np.random.Generator) -> float:
        return rng.normal(mean, 0.01)

    tiny(tmp_path, 2000, vary={"grasped.mass": mass})
    mean = 0.11
    with pytest.raises(sp.StoreError, match="versions are the same: was a function of vary chang"):
        tiny(tmp_path, 3000, vary={"grasped.mass": mass})


def test_another_writer_is_noted_where_its_bits_are_the_same(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = manifest.made_by()
    for _ in range(2):
        monkeypatch.setattr(manifest, "made_by", lambda: {**real, "numpy": "9.9.9"})
        tiny(study, TINY + 5)
    made_by = sp.Study.open(study).made_by
    assert made_by == [real, {**real, "numpy": "9.9.9"}]
    monkeypatch.undo()
    assert sp.Study.open(study).provenance()["numpy"] == "9.9.9"


def test_a_writer_whose_runs_have_other_bits_is_refused(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = manifest.made_by()
    monkeypatch.setattr(manifest, "made_by", lambda: {**real, "machine": "abacus"})
    right = stored.compute

    def wrong(*given: Any) -> Any:
        rows = right(*given)
        state = rows.columns["final_state"]
        return replace(rows, columns={**rows.columns, "final_state": np.nextafter(state, 9.0)})

    monkeypatch.setattr(stored, "compute", wrong)
    before = files(study)
    # Asking once more is no way around it.
    for _ in range(2):
        with pytest.raises(sp.StoreError, match="final_state of run 0: computing it again") as e:
            tiny(study, TINY + 5)
        assert f"machine {real['machine']} then, abacus now" in str(e.value)
        assert files(study) == before


def test_rows_of_another_study_than_the_manifests_are_not_read(study: Path, tmp_path: Path) -> None:
    other = tiny(tmp_path / "other", scene=replace(TINY_SCENE, gravity=9.8))
    right = (study / "manifest.toml").read_bytes()
    opened = sp.Study.open(study)
    shutil.copy(other.path / "manifest.toml", study)
    before = files(study)
    for ask in (sp.Study.open, lambda path: tiny(path, scene=other.scene)):
        with pytest.raises(
            sp.StoreError, match=r"000000\.parquet: is damaged: it belongs to another study"
        ):
            ask(study)
    with pytest.raises(sp.StoreError, match=r"manifest\.toml: describes another study than when"):
        opened.verify()
    assert files(study) == before
    (study / "manifest.toml").write_bytes(right)
    require_whole(study)


def test_one_number_written_in_two_ways_is_one_study(tmp_path: Path) -> None:
    for runs, args in ((BLOCK, (1, 0.125)), (2 * BLOCK, (1.0, 0.125))):
        tiny(tmp_path, runs, vary={"grasped.mass": stats.norm(*args)})
    study = resume(tmp_path)
    study.verify()
    expected = tiny(None, 2 * BLOCK, vary={"grasped.mass": stats.norm(1, 0.125)})
    require_same(study.to_dict(), expected.to_dict())


HISTOGRAM = np.histogram(np.linspace(0.09, 0.11, 50), bins=5)


@pytest.mark.parametrize(
    ("ours", "other"),
    [
        (
            stats.rv_discrete(values=([1, 2, 3], [0.25, 0.25, 0.5])),
            # What its first thousands of draws do not show.
            stats.rv_discrete(values=([1, 2, 3, 4], [0.25, 0.25, 0.5 - 1e-9, 1e-9])),
        ),
        (
            stats.rv_histogram(HISTOGRAM),
            stats.rv_histogram((HISTOGRAM[0], HISTOGRAM[1] * (1 + 1e-9))),
        ),
    ],
    ids=["discrete", "histogram"],
)
def test_distributions_of_ones_own_are_told_apart_and_not_made_again(
    ours: Any, other: Any, tmp_path: Path
) -> None:
    tiny(tmp_path, BLOCK, vary={"grasped.mass": ours})
    with pytest.raises(ValueError, match=r"holds another study: .*vary\.grasped\.mass\."):
        tiny(tmp_path, 2 * BLOCK, vary={"grasped.mass": other})
    with pytest.raises(ValueError, match=r"function or distribution .* call monte_carlo again"):
        sp.Study.open(tmp_path).extend(2 * BLOCK)
    study = tiny(tmp_path, 2 * BLOCK, vary={"grasped.mass": ours})
    require_same(study.to_dict(), tiny(None, 2 * BLOCK, vary={"grasped.mass": ours}).to_dict())
