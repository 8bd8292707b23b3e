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
SCENE = paper.manipulation(
    duration=1.2, contact="unilateral", friction=0.5, grasped=sp.GraspedObject(height=0.049)
)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A file with two of the paper's operations, the second of which opens the left tip."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    return path


def test_run_says_which_contact_and_what_its_tips_did(scene: Path) -> None:
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


def test_what_unilateral_contact_refuses_is_one_line(scene: Path, tmp_path: Path) -> None:
    code, out, err = call("run", scene, "--formulation", "nullspace")
    assert (code, out) == (2, "") and err.count("\n") == 1
    assert 'contact = "unilateral"' in err
    path = tmp_path / "smooth.toml"
    path.write_text('contact = "unilateral"', encoding="utf-8")
    code, out, err = call("run", path)
    assert (code, out) == (2, "") and err.count("\n") == 1
    assert "Scene.friction = None: must be finite where" in err


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


STUDY = """
paper = "ii"
[scene]
duration = 1.06
contact = "unilateral"
friction = 0.5
grasped.height = 0.049
[study]
runs = 24
seed = 7
dt = 2e-4
summaries = ["slip_distance", "free_time"]
summaries_after = 1.0
[vary]
"disturbances.0.force" = {kind = "uniform", low = [-400.0, -400.0], high = [400.0, 400.0]}
"""


def test_a_study_counts_what_is_lost_and_says_what_holding_means(tmp_path: Path) -> None:
    file, out = tmp_path / "study.toml", tmp_path / "out"
    file.write_text(STUDY, encoding="utf-8")
    code, said, err = call("montecarlo", file, "--out", out)
    assert (code, err) == (0, "")
    study = sp.Study.open(out)
    assert study.counts()["lost"] == (study.status == "lost").sum() > 0
    lines = said.splitlines()
    assert "24 runs in" in lines[0] and f"{study.counts()['lost']} lost" in lines[0]
    assert lines[2] == f"probability of holding: {study.probability('holds')}"
    assert lines[3] == (
        f"(both are of {study.model}; to hold is to complete, with both tips touching the object "
        "at the end)"
    )
    assert any(line.startswith("slip_distance") and " m " in line for line in lines)
    assert any(line.startswith("free_time") and " s " in line for line in lines)
    table = (out / "summary.csv").read_text(encoding="utf-8")
    for name in ("lost", "opened", "slipping"):
        assert f"probability of {name},1,24,{study.probability(name).value!r}" in table
    assert (out / "failure_times.png").stat().st_size > 1000
    lost = int(np.flatnonzero(study.status == "lost")[0])
    code, said, _ = call("run", out / "failures" / f"{lost}.toml")
    assert code == 1
    assert said.startswith("lost: the object was lost at t = 1.0")
    assert said.splitlines()[-1].startswith(f"as in the study: run {lost} lost at t = 1.0")
