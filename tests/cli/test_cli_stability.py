"""`softpinch stability`: what it prints, what it leaves, and its exit codes."""

import csv
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from softpinch.accuracy.stability_maps import MapPlan, StabilityMap

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
from cli_calls import call
from unilateral_scenes import regripped

SCENE = sp.Scene(duration=0.02)
FAST = ("--pairs", "csm+rk4, nullspace+radau5")
GRID = ("--dt", "5e-4", "5e-3", "3")


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    return path


def test_without_an_axis_it_prints_the_longest_steps_and_leaves_nothing(
    scene: Path, tmp_path: Path
) -> None:
    code, said, err = call("stability", scene, "--out", tmp_path / "out")
    assert (code, err) == (0, "") and not (tmp_path / "out").exists()
    header, *lines = said.splitlines()
    assert header.split() == ["longest", "step", "[s]", "predicted", "measured"]
    assert len(lines) == 15
    for line in lines:
        formulation, plus, method, predicted, measured, *_ = line.split()
        assert plus == "+"
        found = sp.max_stable_dt(SCENE, method, formulation)
        assert float(predicted) == pytest.approx(found.predicted, rel=1e-3)
        assert measured == f"{found.measured:.4g}" and line.endswith(found.message)


def test_gains_reach_csm(scene: Path) -> None:
    code, said, err = call("stability", scene, "--pairs", "csm+rk4", "--alpha", "5e4")
    assert (code, err) == (0, "")
    gains = sp.Stabilization(alpha=5e4)
    assert sp.max_stable_dt(SCENE, stabilization=gains).message in said


def test_each_axis_leaves_tables_and_a_figure(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "dir"
    code, said, err = call("stability", scene, *FAST, *GRID, "--axis", "tilt", "--axis", "impulse",
                           "--out", out, "--format", "svg", "--threads", 2)  # fmt: skip
    assert (code, err) == (0, "")
    names = {f"stability_{a}.{s}" for a in ("tilt", "impulse") for s in ("csv", "npz", "svg")}
    assert {file.name for file in out.iterdir()} == names
    assert all(name in said for name in names)
    steps = np.geomspace(5e-4, 5e-3, 3)
    pairs = [("csm", "rk4"), ("nullspace", "radau5")]
    found = sp.stability_map(SCENE, "tilt", dt=steps, pairs=pairs, progress=False)
    with np.load(out / "stability_tilt.npz") as saved:
        np.testing.assert_array_equal(saved["error"], found.error)
    assert all(line in said.splitlines() for line in found.summary())


def test_values_and_a_path(scene: Path, tmp_path: Path) -> None:
    code, _, err = call("stability", scene, *FAST, *GRID, "--axis", "control.kd",
                        "--values", "0.5, 2", "--max-steps", 30, "--out", tmp_path)  # fmt: skip
    assert (code, err) == (0, "")
    with (tmp_path / "stability_control_kd.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    assert header[2] == "control.kd [N m s/rad]"
    assert {float(row[2]) for row in rows} == {0.5, 2.0}
    assert [row[4] == "not_run" for row in rows] == [float(row[3]) < 0.02 / 30 for row in rows]
    assert (tmp_path / "stability_control_kd.png").stat().st_size > 5_000


BAD = [
    (("--axis", "tlit"), "axis = 'tlit': must be one of \"youngs_modulus\""),
    (("--axis", "tilt", "--values", "1,x"), "--values: 'x' must be a number"),
    (("--values", "1"), "--values needs exactly one --axis, not 0"),
    (("--dt", "1e-5", "1e-3", "4"), "--dt needs --axis"),
    (("--axis", "tilt", "--dt", "1e-3", "1e-5", "4"), "--dt HIGH = 1e-05: must be greater"),
    (("--pairs", "csm-rk4"), "--pairs: 'csm-rk4' must be FORMULATION+METHOD"),
    (("--format", "gif"), "--format = 'gif': must be one of"),
]


@pytest.mark.parametrize(("options", "named"), BAD)
def test_a_bad_option_is_one_line_and_exit_code_2(
    scene: Path, tmp_path: Path, options: tuple[str, ...], named: str
) -> None:
    code, said, err = call("stability", scene, "--out", tmp_path / "out", *options)
    assert (code, said) == (2, "")
    assert err.startswith("error: ") and err.count("\n") == 1
    assert named in err


def test_nullspace_is_left_out_of_unilateral_contact(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(regripped(duration=0.025).to_toml(), encoding="utf-8")
    code, said, err = call("stability", scene)
    assert (code, err) == (0, "")
    assert "csm" in said and "projected" in said and "nullspace" not in said
    code, said, err = call("stability", scene, "--pairs", "nullspace+rk4")
    assert (code, said) == (2, "")
    assert '--pairs = "nullspace": must be one of "csm" or "projected" where contact' in err


def test_ctrl_c_keeps_the_maps_made_so_far(
    scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = MapPlan.run

    def pressed(plan: MapPlan) -> StabilityMap:
        if plan.axis.name == "object_mass":
            raise KeyboardInterrupt
        return run(plan)

    monkeypatch.setattr(MapPlan, "run", pressed)
    code, _, err = call("stability", scene, *FAST, *GRID, "--axis", "gains", "--axis",
                        "object_mass", "--out", tmp_path / "out")  # fmt: skip
    assert code == 130 and "interrupted" in err
    kept = {file.name for file in (tmp_path / "out").iterdir()}
    assert kept == {f"stability_gains.{suffix}" for suffix in ("csv", "npz", "png")}
