"""`softpinch fit`: files, messages and exit codes."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from cli_calls import call
from example_runs import EXAMPLES, run_example
from measured_motions import BOUNDS, DT, SCENE, TIMES, TRUTH, C, E, columns, motion

pytest.importorskip("scipy")

STUDY = f"""
scene = "scene.toml"

[fit]
dt = {DT}
noise = 1e-5

[vary]
"{E}" = {list(BOUNDS[E])}
"{C}" = {list(BOUNDS[C])}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    (tmp_path / "scene.toml").write_text(SCENE.to_toml(), encoding="utf-8")
    path = tmp_path / "study.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """With a missing measurement in line 4, the third of them."""
    path = tmp_path / "data.csv"
    values = columns(motion(), "rotation", "y")
    lines = ["t [s], theta [rad], y"]
    for k, (t, theta, y) in enumerate(zip(TIMES, *values.values(), strict=True)):
        lines.append(f"{float(t)!r},{'' if k == 2 else repr(float(theta))},{float(y)!r}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_the_truth_comes_back(study: Path, data: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, text, _ = call("fit", study, data, "--out", out, "--profile")
    assert code == 0
    assert sorted(file.name for file in out.iterdir()) == [
        *("fit.csv", "fit.json", "fit.png", "scene.toml")
    ]
    found = json.loads((out / "fit.json").read_text(encoding="utf-8"))
    values = {row["path"]: row["value"] for row in found["parameters"]}
    assert values == pytest.approx(TRUTH, rel=1e-6)
    assert found["degrees_of_freedom"] == 2 * len(TIMES) - 1 - 2
    scene = sp.Scene.from_toml(out / "scene.toml")
    assert scene.hand.tips[0].youngs_modulus == values[E]
    assert scene.hand.tips[1].normal_viscosity == values[C]
    assert text.count("95 % by its profile") == 2 and E in text
    # The same as from Python.
    measured = columns(motion(), "theta", "y")
    measured["theta"][2] = np.nan
    fit = sp.fit(SCENE, TIMES, measured, BOUNDS, dt=DT, noise=1e-5)
    assert fit.to_dict() == found
    assert (out / "fit.csv").read_text() == fit.save(tmp_path / "own.csv").read_text()


def test_files_of_runs_are_read(study: Path, tmp_path: Path) -> None:
    """Of all that `Run.save` writes, `measured` chooses."""
    path = motion().save(tmp_path / "run.csv")
    code, _, error = call("fit", study, path, "--out", tmp_path / "out")
    assert code == 2 and "name the columns to use in [fit] as measured" in error
    text = STUDY.replace("[fit]", '[fit]\nmeasured = ["pose", "lambda_1H"]')
    study.write_text(text, encoding="utf-8")
    code, _, error = call("fit", study, path, "--out", tmp_path / "out", "--loss", "soft_l1")
    assert code == 0, error
    found = json.loads((tmp_path / "out" / "fit.json").read_text(encoding="utf-8"))
    assert list(found["noise"][0]) == ["x", "y", "theta", "lambda_1H"]
    assert found["loss"] == "soft_l1"
    values = {row["path"]: row["value"] for row in found["parameters"]}
    assert values == pytest.approx(TRUTH, rel=1e-6)


def test_infinite_numbers_are_text(study: Path, data: Path, tmp_path: Path) -> None:
    late = '"disturbances.0.moment" = "unbounded"\n'
    scene = sp.Scene(duration=0.2, disturbances=[sp.Pulse(time=0.15, duration=0.01, moment=0.1)])
    (tmp_path / "scene.toml").write_text(scene.to_toml(), encoding="utf-8")
    study.write_text(STUDY.partition(f'"{E}"')[0] + late, encoding="utf-8")
    code, text, _ = call("fit", study, data, "--out", tmp_path / "out")
    assert code == 0
    assert "not determined within -inf to inf N m" in text
    (row,) = json.loads((tmp_path / "out" / "fit.json").read_text())["parameters"]
    assert row["standard_error"] == "inf" and (row["low"], row["high"]) == ("-inf", "inf")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[fit]", "[fit]\nspeed = 3", "[fit].speed: unknown name"),
        ("[fit]", '[fit]\nmeasured = ["thet"]', 'did you mean "theta"'),
        (f'"{E}" = ', f"{E} = ", "must be one path in quotes"),
        (f'"{E}" = [10000.0, 10000000.0]', f'"{E}" = [2.0, 1.0]', "high = 1: must be above low"),
        ('"scene.toml"', '"nowhere.toml"', "No such file"),
    ],
)
def test_a_bad_study_is_one_line(
    study: Path, data: Path, tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in STUDY
    study.write_text(STUDY.replace(old, new), encoding="utf-8")
    code, text, error = call("fit", study, data, "--out", tmp_path / "out")
    assert (code, text) == (2, "")
    assert error.startswith("error: ") and error.count("\n") == 1 and message in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "must have a line of names and lines of numbers"),
        ("theta\n0.1\n", 'has no column "t [s]"'),
        ("time,theta\n0.1,2\n", 'has no column "t [s]"'),
        ("t [s];theta [rad]\n0,01;2\n", "columns must be separated by commas"),
        ("t [s]\ttheta [rad]\n0.01\t2\n", "columns must be separated by commas"),
        ("t [ms],theta\n1,2\n", 'column "t": unit = \'ms\': must be "s"'),
        ("t,theta [deg]\n0.01,2\n", 'column "theta": unit = \'deg\': must be "rad"'),
        ("t,theta,theta\n0.01,2,3\n", 'has the column "theta" more than once'),
        ("t,theta\n0.01\n", "line 2 has 1 entries: must have one for each of the 2 names"),
        ("t,theta\n0.01,2\n\n0.02,x\n", "line 4, column \"theta\": 'x': must be a number"),
        ("t,theta\n0.02,2\n0.01,2\n", "times[1] = 0.01: must be greater than the time before"),
    ],
)
def test_bad_data_are_one_line(study: Path, tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "data.csv"
    path.write_text(content, encoding="utf-8")
    code, text, error = call("fit", study, path, "--out", tmp_path / "out")
    assert (code, text) == (2, "")
    assert error.startswith("error: ") and error.count("\n") == 1 and message in error


def test_other_commands_name_the_file_s_kind(study: Path, data: Path, tmp_path: Path) -> None:
    assert "softpinch montecarlo" in call("run", study)[2]
    assert call("fit", study, tmp_path / "nowhere.csv")[0] == 2
    assert "unknown name" in call("montecarlo", study, "--out", tmp_path / "out")[2]


def test_the_example_and_its_study_file_agree(tmp_path: Path) -> None:
    """The command fits the motion that the example measures, to the example's truth."""
    path = tmp_path / "motion.csv"
    printed = run_example("10_fit.py", tmp_path, "--data", str(path))
    assert printed.count("the truth is") == 3
    off = [float(each) for each in re.findall(r"([\d.]+) standard errors away", printed)]
    assert len(off) == 3 and max(off) < 4.0
    assert "do not determine hand.tip.normal_viscosity" in printed
    out = tmp_path / "out"
    code, text, _ = call("fit", EXAMPLES / "studies" / "fit.toml", path, "--out", out)
    assert code == 0
    rows = json.loads((out / "fit.json").read_text(encoding="utf-8"))["parameters"]
    for row, truth in zip(rows, (4.3e5, 60.0, 1.0), strict=True):
        assert abs(row["value"] - truth) < 4.0 * row["standard_error"]
    # The values of the example's first fit, to the digits that it prints.
    assert [line for line in text.splitlines() if " ± " in line] == [
        line.strip().rstrip(">") for line in printed.splitlines() if " ± " in line
    ][:3]
