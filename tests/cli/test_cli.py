"""The command line: what it prints, what it leaves, and its exit codes."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from softpinch import paper

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
from cli_calls import call
from example_runs import EXAMPLES, run_example
from softpinch.cli import commands


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A file with two of the paper's operations."""
    path = tmp_path / "scene.toml"
    path.write_text(paper.manipulation(duration=1.2).to_toml(), encoding="utf-8")
    return path


def test_run_says_how_it_ended_and_how_wrong_it_may_be(scene: Path) -> None:
    code, out, err = call("run", scene, "--dt", "2e-4")
    assert (code, err) == (0, "")
    run = sp.simulate(paper.manipulation(duration=1.2), dt=2e-4, every=10,
                      record=("state", "multipliers", "residuals", "energy"))  # fmt: skip
    lines = out.splitlines()
    assert lines == commands.summary(run)
    assert lines[0].startswith("completed: ")
    x, y, theta = run.q[-1, :3] * [1e3, 1e3, np.rad2deg(1.0)]
    assert f"x = {x:.3f} mm, y = {y:.3f} mm, theta = {theta:.3f} deg" in lines[1]
    assert "violations: pulling first at 1 s" in lines
    assert any("|C^H| <=" in line and "|C^N| <=" in line for line in lines)
    assert any("closes within" in line for line in lines)


def test_run_takes_a_tolerance_instead_of_a_step(scene: Path) -> None:
    how = ("--method", "radau5", "--formulation", "nullspace")
    code, out, err = call("run", scene, "--tolerance", "1e-7", *how)
    assert (code, err) == (0, "")
    run = sp.simulate(paper.manipulation(duration=1.2), tolerance=1e-7, method="radau5",
                      formulation="nullspace", record=("state", "multipliers", "residuals",
                      "energy"))  # fmt: skip
    assert out.splitlines() == commands.summary(run)
    code, out, _ = call("run", scene, "--tolerance", "1e-7", *how, "--max-steps", "50")
    assert code == 1
    assert out.startswith("too_many_steps: 50 steps, rejected ones too, were not enough")


def test_run_estimates_its_error(scene: Path) -> None:
    code, out, err = call("run", scene, "--dt", "1e-3", "--estimate-error")
    assert (code, err) == (0, "")
    run = sp.simulate(paper.manipulation(duration=1.2), dt=1e-3, every=10, estimate_error=True,
                      record=("state", "multipliers", "residuals", "energy"))  # fmt: skip
    assert run.error_estimate is not None
    assert run.error_estimate.message in out.splitlines() == commands.summary(run)
    code, out, _ = call("run", scene, "--dt", "1e-3")
    assert code == 0 and "estimated error" not in out
    code, out, err = call("run", scene, "--tolerance", "1e-7", "--method", "dop853",
                          "--estimate-error")  # fmt: skip
    assert (code, err) == (0, "") and "of its steps" in out


def test_run_saves_npz_csv_and_a_plot(scene: Path, tmp_path: Path) -> None:
    options = ("--dt", "1e-3", "--alpha", "500", "--beta", "400", "--every", "20")
    code, _, err = call("run", scene, *options, "--out", tmp_path / "run.npz",
                        "--plot", tmp_path / "run.svg")  # fmt: skip
    assert (code, err) == (0, "")
    assert (tmp_path / "run.svg").read_text(encoding="utf-8").startswith("<?xml")
    run = sp.simulate(paper.manipulation(duration=1.2), dt=1e-3, every=20,
                      stabilization=sp.Stabilization(500.0, 400.0))  # fmt: skip
    with np.load(tmp_path / "run.npz") as saved:
        np.testing.assert_array_equal(saved["t"], run.t)
        np.testing.assert_array_equal(saved["q"], run.q)
        how = json.loads(str(saved["provenance"]))
    assert how["stabilization"] == {"alpha": 500.0, "beta": 400.0}
    code, _, _ = call("run", scene, *options, "--record", "state, residuals",
                      "--out", tmp_path / "run.csv")  # fmt: skip
    assert code == 0
    with (tmp_path / "run.csv").open(newline="", encoding="utf-8") as file:
        header, *rows = list(csv.reader(file))
    assert header[:2] == ["t [s]", "x [m]"] and header[-1] == "C_2N [m/s]"
    np.testing.assert_array_equal([float(row[1]) for row in rows], run.q[:, 0])


def test_a_lost_grasp_is_exit_code_1(tmp_path: Path) -> None:
    path = tmp_path / "lost.toml"
    hand = sp.Hand(tip=sp.Fingertip(tilt_coupling=-1.0))
    path.write_text(paper.disturbance("i", hand=hand).to_toml(), encoding="utf-8")
    code, out, err = call("run", path, "--plot", tmp_path / "lost.png")
    assert (code, err) == (1, "")
    assert out.startswith("separated: the left fingertip left the object at t = 1.0")
    assert (tmp_path / "lost.png").stat().st_size > 1000


BAD_SCENES = [
    ("durration = 1", "Scene.durration"),
    ("duration = ", "scene.toml"),
    ("[hand.tip.left]\nradius = -1", "(in hand.tip.left)"),
    ("[initial]\nq = [0,0,0,0,0,1e-3,0,0,0]", "C_1^H"),
]
BAD_OPTIONS = [
    (("--formulation", "cms"), 'did you mean "csm"'),
    (("--record", "state,energi"), 'did you mean "energy"'),
    (("--alpha", "500", "--formulation", "nullspace"), "'nullspace' has no gains"),
    (("--max-steps", "50"), "max_steps = 50: goes with tolerance"),
    (("--tolerance", "1e-7"), "method = 'rk4' has no error estimate"),
    (("--tolerance", "1e-7", "--dt", "1e-3", "--method", "radau5"), "give one of them"),
    (("--estimate-error", "--record", "energy"), "needs 'state' or 'multipliers' in record"),
    (("--out", "run.txt"), "--out = 'run.txt': must end in .npz, .csv"),
    (("--plot", "nowhere/run.png"), "there is no directory 'nowhere'"),
]


@pytest.mark.parametrize(
    ("text", "options", "named"),
    [*((text, (), named) for text, named in BAD_SCENES), *(("", *each) for each in BAD_OPTIONS)],
)
def test_bad_input_is_one_line_that_names_it(
    tmp_path: Path, text: str, options: tuple[str, ...], named: str
) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    code, out, err = call("run", path, *options)
    assert (code, out) == (2, "")
    assert err.startswith("error: ") and err.count("\n") == 1
    assert named in err


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "no.toml"
    assert call("run", path) == (2, "", f"error: {path}: No such file or directory\n")


def test_errors_found_by_typer_have_exit_code_2(scene: Path) -> None:
    assert call("run", scene, "--dt", "soon")[0] == 2
    assert call("run")[0] == 2
    assert call("walk")[0] == 2


def test_a_step_too_long_is_warned_of_in_one_line(scene: Path) -> None:
    code, _, err = call("run", scene, "--dt", "4e-3")
    assert code == 1
    assert err.startswith("warning: alpha * dt = 4") and err.count("\n") == 1


def test_ctrl_c_is_exit_code_130(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(described: sp.Scene, **options: object) -> sp.Run:
        run = sp.simulate(described, dt=1e-3)
        run.status, run.message = "interrupted", "interrupted at t = 0.1 s"
        return run

    monkeypatch.setattr(commands, "simulate", interrupted)
    code, out, _ = call("run", scene)
    assert code == 130
    assert out.startswith("interrupted: ")

    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(commands, "reproduce_paper", stopped)
    assert call("reproduce")[0] == 130


def test_with_an_unstable_step_reproduce_leaves_its_files_and_no_claim_holds(
    tmp_path: Path,
) -> None:
    code, out, err = call("reproduce", "--out", tmp_path / "new", "--format", "pdf", "--dt", "5e-3")
    assert code == 0 and err.count("\n") == 2
    assert all(line.startswith("warning: alpha * dt = ") for line in err.splitlines())
    suffixes = [file.suffix for file in (tmp_path / "new").iterdir()]
    assert sorted(suffixes) == [".csv"] * 6 + [".pdf"] * 9
    assert out.count("does not hold: ") == 11 and "\nholds: " not in out
    assert "Take a smaller step" in " ".join(out.split()) and "the parameters" in out
    assert call("reproduce", "--format", "gif")[0] == 2
    assert "dt = 0.0" in call("reproduce", "--dt", "0")[2]


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)


def test_the_module_is_a_command() -> None:
    done = python("-m", "softpinch", "--version")
    assert (done.returncode, done.stdout) == (0, f"softpinch {sp.__version__}\n")


@pytest.mark.parametrize("missing", ["typer", "rich"])
def test_without_the_extra_one_line_says_which(missing: str) -> None:
    block = f"import sys; sys.modules[{missing!r}] = None; sys.argv = ['softpinch', '--version']; "
    done = python("-c", block + "from softpinch.__main__ import main; main()")
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == (
        "softpinch's extra cli is needed for the command line: pip install '.[cli]' in a checkout\n"
    )


# Others are run, and what they print is checked, by tests of what they show.
CHECKED = {
    name
    for file in Path(__file__).parents[1].rglob("test_*.py")
    for name in re.findall(r"\brun_example\(\s*\"(\w+\.py)\"", file.read_text(encoding="utf-8"))
}


@pytest.mark.parametrize("script", sorted({file.name for file in EXAMPLES.glob("*.py")} - CHECKED))
def test_the_examples_run_and_save_their_picture(script: str, tmp_path: Path) -> None:
    # Training takes a minute; a few generations show that it runs.
    quick = ("--quick",) if "--quick" in (EXAMPLES / script).read_text(encoding="utf-8") else ()
    run_example(script, tmp_path, *quick)


def test_the_examples_scene_runs(tmp_path: Path) -> None:
    code, out, err = call("run", EXAMPLES / "scenes" / "pinch.toml", "--plot", tmp_path / "p.png")
    assert (code, err) == (0, "")
    assert "violations: none" in out


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="has no /dev/full")
def test_output_that_goes_nowhere_is_no_bad_input(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text("duration = 0.01\n")
    command = [sys.executable, "-m", "softpinch", "run", str(file)]
    with open("/dev/full", "w") as out:
        done = subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (1, "error: No space left on device\n")
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (1, "")
