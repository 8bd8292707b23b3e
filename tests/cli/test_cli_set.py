"""The option --set: numbers of a scene, changed in the shell at dotted paths."""

from pathlib import Path

import pytest

import softpinch as sp
from softpinch import paper

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
from cli_calls import call
from softpinch.cli import commands

SCENE = sp.Scene(
    duration=0.05,
    contact="unilateral",
    friction=0.5,
    disturbances=[sp.Step(time=0.01, force=(0.0, 1.0))],
)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    return path


def test_run_changes_numbers_pairs_names_and_optional_values(scene: Path) -> None:
    changes = ("friction=0.3", "hand.tip.youngs_modulus=4e5", "disturbances.0.force=[5, 0]",
               " duration = 0.02", "friction.left=0.4", 'contact="unilateral"')  # fmt: skip
    values = {"hand.tip.youngs_modulus": 4e5, "disturbances.0.force": (5, 0), "duration": 0.02}
    record = ("state", "multipliers", "residuals", "energy", "contact")
    for friction, left_out in ((0.3, 4), ((0.5, 0.4), 0)):
        given = [text for k, text in enumerate(changes) if k != left_out]
        code, out, err = call("run", scene, *(word for text in given for word in ("--set", text)))
        assert (code, err) == (0, "")
        path = "friction" if left_out else "friction.left"
        expected = SCENE.with_({**values, path: 0.3 if left_out else 0.4})
        assert expected.friction == friction
        run = sp.simulate(expected, every=10, record=record)
        assert out.splitlines() == commands.summary(run)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["friction"], "error: --set 'friction': must be PATH=VALUE, such as grasped.mass=0.2"),
        (["friction=0.3\nx=2"], r"--set 'friction=0.3\nx=2': the value must be written as in TOML"),
        (["friction=0.3", "friction=0.4"], "--set 'friction=0.4': friction is given twice"),
        (["fricton=0.3"], 'error: --set: \'fricton\': Scene has no field \'fricton\''),
        (["grasped.mass=-1"], "error: --set: GraspedObject.mass = -1"),
    ],
)  # fmt: skip
def test_bad_changes_are_refused_in_one_line(scene: Path, changes: list[str], message: str) -> None:
    code, out, err = call("run", scene, *(word for text in changes for word in ("--set", text)))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_the_commands_of_accuracy_take_it_too(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Reached(ValueError):
        pass

    seen: list[sp.Scene] = []

    def note(scene: sp.Scene, *_: object, **__: object) -> None:
        seen.append(scene)
        raise Reached

    monkeypatch.setattr("softpinch.cli.accuracy.find_advice", note)
    monkeypatch.setattr("softpinch.cli.accuracy.measure_precision", note)
    monkeypatch.setattr("softpinch.cli.accuracy.max_stable_dt", note)
    for command in ("advise", "work-precision", "stability"):
        out = () if command == "advise" else ("--out", tmp_path)
        call(command, scene, "--set", "grasped.mass=0.2", *out)
    assert seen == [SCENE.with_({"grasped.mass": 0.2})] * 3


def test_a_changed_capsule_is_another_scene_than_that_of_its_study(tmp_path: Path) -> None:
    (capsule,) = sp.monte_carlo(
        paper.disturbance("ii", duration=1.1), 1, dt=1e-3, summaries=(), progress=False,
        vary={"disturbances.0.force": sp.Uniform((900.0, 900.0), (950.0, 950.0))},
    ).failures()  # fmt: skip
    path = tmp_path / "capsule.toml"
    path.write_text(capsule.to_toml(), encoding="utf-8")
    code, out, err = call("run", path)
    assert (code, err) == (1, "") and "as in the study: run 0" in out
    code, out, _ = call("run", path, "--set", "disturbances.0.force=[1, 0]")
    assert code == 0
    assert f"another scene than in the study, where run 0 {capsule.status} at" in out


def test_a_study_takes_changes_but_not_of_what_it_varies(tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text(
        "[scene]\nduration = 0.02\n[study]\nruns = 8\n"
        '[vary]\n"grasped.mass" = {kind = "uniform", low = 0.05, high = 0.1}\n'
        '[rare]\nevent = ["peak_rotation", ">", 100.0]\n',
        encoding="utf-8",
    )
    changes = ("--set", "hand.tip.youngs_modulus=4e5")
    code, _, err = call("montecarlo", study, *changes, "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    stored = sp.Study.open(tmp_path / "out")
    assert stored.scene.hand.tip.youngs_modulus == 4e5
    for command in ("montecarlo", "rare"):
        code, out, err = call(command, study, "--set", "grasped.mass=0.2", "--out", tmp_path / "b")
        assert (code, out) == (2, "")
        assert err == "error: --set grasped.mass: the study varies it; change its [vary] instead\n"
