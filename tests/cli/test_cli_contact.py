"""Unilateral contact in the shell: scene files, what is printed, pictures, and exit codes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from softpinch import paper
from softpinch.run import measures

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
from cli_calls import call
from softpinch.cli import commands

EXAMPLE = Path(__file__).parents[2] / "examples" / "scenes" / "slipping_pinch.toml"
CARRIED = EXAMPLE.with_name("carried_pinch.toml")
SCENE = paper.manipulation(
    duration=1.2, contact="unilateral", friction=0.5, grasped=sp.GraspedObject(height=0.049)
)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A file with two of the paper's operations, the second of which opens the left tip."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    return path


def test_run_prints_contact_and_times_of_free_and_slipping_tips(scene: Path) -> None:
    code, out, err = call("run", scene, "--every", "1")
    assert (code, err) == (0, "")
    run = sp.simulate(SCENE, record=("state", "multipliers", "residuals", "energy", "contact"))
    lines = out.splitlines()
    assert lines == commands.summary(run)
    assert "unilateral contact, friction 0.5: the grasp holds" in lines
    opened, closed, stuck = (change.time for change in run.contact_changes)
    assert (
        "3 changes of contact: the right tip is free for 0 ms and slips for 0 ms, the left tip is "
        f"free for {1e3 * (closed - opened):.4g} ms and slips for {1e3 * (stuck - closed):.4g} ms"
    ) in lines
    assert "violations: slipping first at 1.00172 s, opened first at 1 s" in lines
    assert f"friction takes {run.energy.friction_loss[-1]:.3g} J" in out
    # The gap of the free tip, 0.1 mm, is no error.
    assert np.abs(run.residuals[:, :2]).max() > 1e-4
    (line,) = [line for line in lines if line.startswith("residuals")]
    holonomic = np.abs(run.residuals[:, :2])[measures.active_constraints(run)[:, :2]].max()
    assert f"|C^H| <= {holonomic:.1e} m" in line and holonomic < 1e-8


def test_the_example_of_a_hand_that_moves_runs(tmp_path: Path) -> None:
    code, out, err = call("run", CARRIED, "--dt", "2e-4", "--plot", tmp_path / "carried.png",
                          "--out", tmp_path / "run.csv")  # fmt: skip
    assert (code, err) == (0, "")
    # 0.5 m in 0.25 s: the peak of a move by minimum jerk is 10 / sqrt(3) D / T^2.
    peak = 10.0 / np.sqrt(3.0) * 0.5 / 0.25**2
    (line,) = [line for line in out.splitlines() if line.startswith("the hand moves")]
    found = float(line.removesuffix(" m/s^2").rpartition(" ")[2])
    assert 0.99 * peak < found < 1.0001 * peak
    assert "unilateral contact, friction 0.5: the grasp holds" in out
    assert (tmp_path / "carried.png").stat().st_size > 1000
    # Twice as fast the object is lost; a hand at rest has no such line, and a kind is checked.
    code, out, _ = call("run", CARRIED, "--dt", "2e-4", "--set", "motion.times.1=0.53")
    assert code == 1 and out.startswith("lost: the object was lost at t = 0.")
    code, out, _ = call("run", EXAMPLE, "--dt", "1e-3", "--set", "duration=0.01")
    assert "the hand moves" not in out
    bad = tmp_path / "bad.toml"
    bad.write_text(CARRIED.read_text("utf-8").replace('"minimum_jerk"', '"minimal_jerk"'), "utf-8")
    code, out, err = call("run", bad)
    assert code == 2 and "HandMotion.kind" in err and 'did you mean "minimum_jerk"' in err


def test_a_pair_of_frictions_and_a_lost_object(tmp_path: Path) -> None:
    lost = paper.disturbance(
        "i", contact="unilateral", friction=(0.3, 0.4), grasped=sp.GraspedObject(height=0.049)
    )
    path = tmp_path / "lost.toml"
    path.write_text(lost.to_toml(), encoding="utf-8")
    code, out, err = call("run", path, "--plot", tmp_path / "lost.png")
    assert (code, err) == (1, "")
    assert out.startswith("lost: the object was lost at t = 1.0")
    assert "unilateral contact, friction 0.3 right and 0.4 left: the grasp does not hold" in out
    assert (tmp_path / "lost.png").stat().st_size > 1000


def test_a_run_that_ends_with_a_free_tip_completes_but_does_not_hold(tmp_path: Path) -> None:
    path = tmp_path / "open.toml"
    path.write_text(replace(SCENE, duration=1.001).to_toml(), encoding="utf-8")
    code, out, _ = call("run", path)
    assert code == 0
    assert out.startswith("completed") and "the grasp does not hold" in out


def test_the_example_slips_opens_and_holds(tmp_path: Path) -> None:
    code, out, err = call("run", EXAMPLE, "--plot", tmp_path / "p.png")
    assert (code, err) == (0, "")
    assert "unilateral contact, friction 0.5: the grasp holds" in out
    run = sp.simulate(sp.Scene.from_toml(EXAMPLE))
    # As the comments of the file say: the swing opens the left tip, the blow makes both slip.
    opened = [c for c in run.contact_changes if c.after is sp.ContactMode.FREE]
    assert {c.finger for c in opened} == {"left"} and all(0.8 <= c.time < 0.81 for c in opened)
    blow = [c for c in run.contact_changes if c.time >= 1.3]
    for finger in ("right", "left"):
        after = [change.after for change in blow if change.finger == finger]
        assert after[0] is sp.ContactMode.SLIP and after[-1] is sp.ContactMode.STICK
