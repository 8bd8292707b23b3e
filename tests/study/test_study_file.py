"""Study files: what they may say, and what is wrong with them in one message."""

import hashlib
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from ensembles import computed
from softpinch import paper
from softpinch.study import study_file

pytest.importorskip("tomli_w")
EXAMPLE = Path(__file__).parents[2] / "examples" / "studies" / "disturbance_ii.toml"
MASS = '\n[vary]\n"grasped.mass" = {kind = "normal", mean = 0.1, std = 0.01}\n'


@pytest.fixture
def write(tmp_path: Path):  # type: ignore[no-untyped-def]
    def to(text: str, name: str = "study.toml") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return to


def same(a: sp.Ensemble, b: sp.Ensemble) -> None:
    assert a.to_dict().keys() == b.to_dict().keys()
    for name, values in a.to_dict().items():
        np.testing.assert_array_equal(values, b.to_dict()[name])


def test_the_example_is_the_papers_disturbance_with_changes() -> None:
    study = study_file.read(EXAMPLE)
    assert study.scene == paper.disturbance("ii", duration=1.5)
    assert (
        study.draws.runs,
        study.draws.seed,
        study.options.dt,
        study.options.summaries_after,
    ) == (
        1000,
        7,
        1e-4,
        1.0,
    )
    assert study.draws.sources["grasped.mass"].value == sp.Normal(0.1, 0.01)
    assert study.draws.sources["disturbances.0.force"].value == sp.Uniform(
        (-300.0, -300.0), (300.0, 300.0)
    )


def test_a_study_file_gives_the_rows_of_monte_carlo(write) -> None:  # type: ignore[no-untyped-def]
    text = "[scene]\nduration = 0.05\n[study]\nruns = 20\nseed = 3\ndt = 1e-3\n"
    study = study_file.read(write(text + 'summaries = ["peak_rotation"]' + MASS))
    direct = sp.monte_carlo(
        sp.Scene(duration=0.05), 20, 3, {"grasped.mass": sp.Normal(0.1, 0.01)}, dt=1e-3,
        summaries="peak_rotation", progress=False,
    )  # fmt: skip
    same(computed(study), direct)


def test_a_manifest_is_a_complete_study_and_gives_the_same_again(write, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    text = (
        "paper = 'iii'\n[scene]\nduration = 1.05\n[scene.hand.tip]\nradius = 0.021\n"
        "[study]\ndt = 1e-3\nformulation = 'nullspace'\nsummaries = ['peak_rotation']\n"
        "stop_when = {completed = 0.2}\nruns = 30\n"
    )
    study = study_file.read(write(text + MASS + '"disturbances.0.moment, gravity" = '
        '{kind = "choice", values = [[0.1, 9.7], [0.2, 9.9]], weights = [1, 3]}'))  # fmt: skip
    tip = study.scene.hand.tip
    assert isinstance(tip, sp.Fingertip)
    assert (tip.radius, tip.youngs_modulus) == (0.021, 0.3e6)
    assert ("disturbances.0.moment", "gravity") in study.draws.sources
    kept = computed(study, store=tmp_path / "out")
    manifest = kept.path / "manifest.toml"
    again = study_file.read(manifest)
    assert again.to_dict() == study.to_dict()
    same(computed(study), computed(again))
    written = tomllib.loads(manifest.read_text(encoding="utf-8"))
    assert written["study"]["method"] == "rk4" and written["study"]["alpha"] == 1000.0
    assert written["scene"]["grasped"]["width"] == 0.049


def test_a_scene_file_beside_it_and_arrays(write, monkeypatch, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    write(sp.Scene(duration=0.07).to_toml(), "pinch.toml")
    path = write('scene = "pinch.toml"\n[vary]\n"grasped.mass" = [0.1, 0.11]\n'
                 '"schedule.angles" = [[[0.1, 0.1]], [[0.11, 0.1]]]')  # fmt: skip
    monkeypatch.chdir("/")
    study = study_file.read(path)
    assert study.scene == sp.Scene(duration=0.07)
    assert study.draws.runs == 2
    ensemble = computed(study_file.read(path, dt=1e-3, summaries=()))
    assert ensemble.runs == 2 and ensemble["schedule.angles"][1, 0, 0] == 0.11
    kept = computed(study_file.read(path, dt=1e-3), store=tmp_path / "out")
    again = study_file.read(kept.path / "manifest.toml")
    np.testing.assert_array_equal(
        again.draws.sources["schedule.angles"].value, study.draws.sources["schedule.angles"].value
    )


def test_options_take_the_files_place_and_a_step_that_of_a_tolerance(write) -> None:  # type: ignore[no-untyped-def]
    path = write("[scene]\n[study]\ntolerance = 1e-6\nmethod = 'radau5'\n")
    study = study_file.read(path)
    assert study_file.read(path, dt=None, seed=None, runs=None).to_dict() == study.to_dict()
    assert (study.options.dt, study.draws.runs) == (None, 1000)
    changed = study_file.read(path, dt=1e-3).options
    assert (changed.dt, changed.tolerance) == (1e-3, None)
    steps = write("[scene]\n[study]\nmethod = 'radau5'\n", "steps.toml")
    assert study_file.read(steps).options.dt == 1e-4
    assert study_file.read(steps, tolerance=1e-5).options.dt is None
    assert study_file.read(path, runs=5, dt=1e-3, method="rk4").draws.runs == 5
    with pytest.raises(ValueError, match="give one of them"):
        study_file.read(path, dt=1e-3, tolerance=1e-6, runs=1)


def test_a_table_of_another_kind_does_not_inherit(write) -> None:  # type: ignore[no-untyped-def]
    text = '[scene.schedule]\nkind = "minimum_jerk"\ntimes = [0.0, 0.2]\nmove_time = 0.1\n'
    study = study_file.read(write(f'paper = "ii"\n{text}angles_deg = [[3, 3], [6, 6]]'))
    assert study.scene.schedule == sp.Schedule.minimum_jerk(
        [0.0, 0.2], np.deg2rad([[3, 3], [6, 6]]), move_time=0.1
    )
    study = study_file.read(write('paper = "ii"\n[scene.schedule]\nangles_deg = [[3, 3]]'))
    assert study.scene.schedule.angles[0, 0] == np.deg2rad(3)


BAD = [
    ("duration = 1\n[study]", 'study file.duration: unknown name; must be one of "scene", "paper"'),
    ("duration = 1", "is a scene, not a study"),
    ("[studdy]", 'did you mean "study"'),
    ("[scene]\ndurration = 1", 'Scene.durration (in scene): unknown name'),
    ("[scene.grasped]\nmass = -1",
     "GraspedObject.mass = -1.0: must be finite and > 0 (in scene.grasped)"),
    ('scene = "nowhere.toml"', "nowhere.toml"),
    ('scene = "bad.toml"', "bad.toml: Scene.gravity = '1'"),
    ('scene = "pinch.toml"\npaper = "ii"', "give one of them"),
    ("vary = 3", "[vary] = 3: must be a table"),
    ("[vary]\ngrasped.mass = {kind = 'normal', mean = 1, std = 1}",
     "must be one path in quotes"),
    ('[vary]\n"grasped.mas" = {kind = "normal", mean = 1, std = 1}', 'did you mean "grasped.mass"'),
    ('[vary]\n"grasped.mass" = {kind = "normale", mean = 1}', 'did you mean "normal"'),
    ('[vary]\n"grasped.mass" = {kind = "normal", mean = 1}',
     'Normal.std (in [vary]."grasped.mass"): is missing'),
    ('[vary]\n"grasped.mass" = {kind = "uniform", low = [1, 2], high = 3}',
     "draws of Uniform have shape (2,)"),
    ("[study", "study.toml: "),
]  # fmt: skip


@pytest.mark.parametrize(("text", "named"), BAD, ids=range(len(BAD)))
def test_a_bad_file_is_one_message_with_file_place_and_rule(  # type: ignore[no-untyped-def]
    write, text: str, named: str
) -> None:
    write("gravity = '1'", "bad.toml")
    path = write(text)
    with pytest.raises((ValueError, OSError)) as error:
        study_file.read(path)
    assert named in str(error.value), str(error.value)
    assert isinstance(error.value, OSError) or str(error.value).startswith(f"{path}: ")


def of_an_array(write: Any, file: Path, numbers: Any = b"") -> Path:
    """A study file with an array in a file of its own."""
    total = hashlib.sha256(np.asarray(numbers).tobytes()).hexdigest()
    entry = f'{{kind = "array", file = "{file.name}", sha256 = "{total}"}}'
    path: Path = write(f'paper = "i"\n[vary]\n"grasped.mass" = {entry}')
    return path


ARRAYS: dict[str, tuple[Any, str]] = {
    "archive": (b"PK\x03\x04 that is none", "is damaged: "),
    "pickle": (b"\x80\x04N.", "is damaged: "),
    "header": (b"\x93NUMPY\x01\x00" + b"\xff" * 90, "is damaged: "),
    "one number": (np.float64(1.0), "has been altered: its checksum differs"),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_of_a_file_that_is_none_is_a_value_error(
    name: str, write: Any, tmp_path: Path
) -> None:
    data, words = ARRAYS[name]
    file = tmp_path / "a.npy"
    if isinstance(data, bytes):
        file.write_bytes(data)
    else:
        np.save(file, data)
    path = of_an_array(write, file, data)
    with pytest.raises(ValueError, match=f"^{path}: .*: file = 'a.npy': {words}"):
        study_file.read(path)
