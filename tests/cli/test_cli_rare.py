"""`softpinch rare`: files, messages and exit codes."""

from pathlib import Path

import pytest

import softpinch as sp
from cli_calls import call

pytest.importorskip("scipy")

STUDY = """
[scene]
duration = 0.1

[[scene.disturbances]]
kind = "pulse"
time = 0.02
duration = 0.01

[study]
dt = 1e-3
seed = 4

[vary]
"grasped.mass" = {kind = "normal", mean = 0.1, std = 0.01}
"disturbances.0.force" = {kind = "normal", mean = [0.0, 0.0], std = [20.0, 10.0]}

[rare]
event = ["peak_rotation", ">", 0.018]
runs = 3000
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def test_the_command_finds_what_the_function_finds(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, text, _ = call("rare", study, "--out", out, "--format", "svg")
    assert code == 0
    scene = sp.Scene(duration=0.1, disturbances=[sp.Pulse(time=0.02, duration=0.01)])
    vary = {
        "grasped.mass": sp.Normal(0.1, 0.01),
        "disturbances.0.force": sp.Normal((0.0, 0.0), (20.0, 10.0)),
    }
    found = sp.rare_event(scene, vary, ("peak_rotation", ">", 0.018), 3000, 4, dt=1e-3)
    assert str(found) in text
    assert f"design point: grasped.mass = {found.design_point['grasped.mass']}" in text
    assert "<svg" in (out / "rare.svg").read_text("utf-8")
    capsules = sorted((out / "failures").iterdir())
    assert len(capsules) == 10
    run = sp.Capsule.from_toml(capsules[0]).replay()
    assert abs(run.q[:, 2]).max() >= 0.018
    # An option takes the place of the file's entry.
    code, text, _ = call("rare", study, "--out", out, "--runs", 1000, "--method", "subset")
    assert code == 0 and str(found) not in text


def test_plain_runs_of_the_same_file_leave_the_event_out(study: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    assert call("montecarlo", study, "--out", tmp_path / "plain", "--runs", 10)[0] == 0


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('["peak_rotation", ">", 0.018]', '["peak_turn", ">", 0.1]', "'peak_turn' is unknown"),
        ("runs = 3000", "runs = 10", "runs = 10"),
        ("runs = 3000", "walks = 3", "walks"),
        ("std = 0.01", "std = 0.1", "7 standard deviations off"),
        ("dt = 1e-3", "dt = 0.0", "dt = 0.0"),
    ],
)
def test_bad_files_are_refused_in_one_line(
    study: Path, tmp_path: Path, old: str, new: str, text: str
) -> None:
    study.write_text(STUDY.replace(old, new), encoding="utf-8")
    code, _, error = call("rare", study, "--out", tmp_path / "out")
    assert code == 2 and text in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_directory_that_cannot_be_made_is_refused_before_any_run(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*given: object, **named: object) -> None:
        raise AssertionError("runs were computed")

    monkeypatch.setattr("softpinch.cli.rare.rare_event", never)
    (tmp_path / "file").write_text("", encoding="utf-8")
    code, _, error = call("rare", study, "--out", tmp_path / "file" / "out")
    assert code == 2 and "no folder that can be written" in error


def test_a_store_goes_on(study: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    given = ("rare", study, "--out", tmp_path / "out", "--store", tmp_path / "runs")
    code, first, _ = call(*given)
    assert code == 0 and any((tmp_path / "runs" / "parts").iterdir())
    assert call(*given)[1] == first
