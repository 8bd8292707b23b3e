"""The shell's commands of accuracy on a scene with unilateral contact leave nullspace out."""

from pathlib import Path

import pytest

from cli_calls import call
from unilateral_scenes import regripped


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(regripped(duration=0.025).to_toml(), encoding="utf-8")
    return path


def test_stability(scene: Path, tmp_path: Path) -> None:
    code, said, err = call("stability", scene, "--out", tmp_path)
    assert (code, err) == (0, "")
    assert "csm" in said and "projected" in said and "nullspace" not in said
    code, said, err = call("stability", scene, "--pairs", "nullspace+rk4", "--out", tmp_path)
    assert (code, said) == (2, "")
    assert '--pairs = "nullspace": must be one of "csm" or "projected" where contact' in err
    assert err.count("\n") == 1


def test_work_precision(scene: Path, tmp_path: Path) -> None:
    options = ("--methods", "rk4", "--dt", "1e-4", "2e-4", "2", "--out", tmp_path)
    code, said, err = call("work-precision", scene, *options)
    assert (code, err) == (0, "")
    table = (tmp_path / "work_precision.csv").read_text(encoding="utf-8")
    assert "projected" in table and "nullspace" not in table
    assert "the core's own runs" in said + table
    code, said, err = call("work-precision", scene, "--formulations", "nullspace", *options)
    assert (code, said) == (2, "")
    assert 'formulations = "nullspace": must be one of' in err
