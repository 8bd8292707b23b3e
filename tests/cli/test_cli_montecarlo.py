"""`softpinch montecarlo`: what it prints, what it leaves, and its exit codes."""

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from ensembles import computed
from softpinch.cli import montecarlo as study_report
from softpinch.study import study_file

pytest.importorskip("typer")
pytest.importorskip("matplotlib")
from cli_calls import call

EXAMPLE = Path(__file__).parents[2] / "examples" / "studies" / "disturbance_ii.toml"
CARRIED = EXAMPLE.with_name("carried_pinch.toml")
TEXT = """
paper = "ii"
[scene]
duration = 1.06
[study]
runs = 60
seed = 7
dt = 1e-3
summaries = ["final_state", "peak_rotation", "settling_time"]
summaries_after = 1.0
[vary]
"grasped.mass" = {kind = "normal", mean = 0.1, std = 0.01}
"disturbances.0.force" = {kind = "uniform", low = [-400.0, -400.0], high = [400.0, 400.0]}
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "given.toml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def rows(path: Path) -> list[list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_it_leaves_tables_arrays_and_figures(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "dir"
    code, said, err = call("montecarlo", study, "--out", out)
    assert (code, err) == (0, "")
    figures = {"histogram_peak_rotation.png", "histogram_settling_time.png", "success_map.png",
               "success_map_holds.png", "failure_times.png", "importance_completed.png",
               "importance_holds.png", "importance_peak_rotation.png"}  # fmt: skip
    data = {"runs.csv", "summary.csv", "ensemble.npz", "manifest.toml", "parts"}
    silent = {"lock", "failures", "digests"}
    assert {file.name for file in out.iterdir()} == figures | data | silent
    assert all(name in said for name in figures | data)
    ensemble = computed(study_file.read(study))
    kept = sp.Study.open(out)
    assert kept.complete and kept.status.tolist() == ensemble.status.tolist()
    failed = [capsule.run for capsule in ensemble.failures()[:10]]
    assert {int(file.stem) for file in (out / "failures").iterdir()} == set(failed)
    assert f"softpinch run {out / 'failures' / str(failed[0])}.toml" in said
    assert 0 < ensemble.probability("completed").value < 1

    assert "independently" not in said
    lines = said.splitlines()
    assert lines[0].startswith("60 runs in ") and "runs/s): " in lines[0]
    assert lines[1] == f"probability of completing: {ensemble.probability('completed')}"
    assert lines[2] == f"probability of holding: {ensemble.probability('holds')}"
    assert lines[3].startswith(f"(both are of {ensemble.model}; to hold is to complete, ")
    turned = ensemble["peak_rotation"]
    mean, error = turned.mean(), turned.std(ddof=1) / np.sqrt(60)
    (line,) = [line for line in lines if line.startswith("peak_rotation")]
    assert f"{mean:.6g} ± {error:.2g} rad" in line
    settled = np.isfinite(ensemble["settling_time"]).sum()
    assert any(line.startswith("settling") and f"({settled} runs)" in line for line in lines)

    header, *body = rows(out / "runs.csv")
    words = ["run", "status", "message", "end_time [s]", "failure_time [s]", "steps"]
    assert header[:6] == words
    column = header.index("disturbances.0.force.1 [N]")
    values = [float(row[column]) for row in body]
    np.testing.assert_array_equal(values, ensemble["disturbances.0.force"][:, 1])
    column = header.index("final_state.rate of theta [rad/s]")
    values = [float(row[column]) for row in body]
    np.testing.assert_array_equal(values, ensemble["final_state"][:, 11])
    assert [row[1] for row in body] == ensemble.status.tolist()
    assert [row[2] for row in body] == ensemble.message.tolist()
    assert any("left the object at t = " in row[2] for row in body)

    table = {row[0]: row[1:] for row in rows(out / "summary.csv")}
    for name in ("completed", "holds"):
        estimate = ensemble.probability(name)
        assert list(map(float, table[f"probability of {name}"][2:5])) == [*estimate[:3]]
    assert f"model: {ensemble.model}" in table
    unit, count, *numbers = table["peak_rotation"]
    assert (unit, count) == ("rad", "60")
    expected = [mean, mean - 1.959963984540054 * error, mean + 1.959963984540054 * error,
                turned.std(ddof=1), *np.quantile(turned, [0, 0.05, 0.5, 0.95, 1])]  # fmt: skip
    np.testing.assert_allclose(list(map(float, numbers)), expected, rtol=1e-14)
    assert table["settling_time"][1] == str(settled)

    with np.load(out / "ensemble.npz") as saved:
        for name, array in ensemble.to_dict().items():
            np.testing.assert_array_equal(saved[name], array)
        assert json.loads(str(saved["provenance"])) == ensemble.provenance()


def test_the_study_that_it_leaves_gives_the_same_again(study: Path, tmp_path: Path) -> None:
    options = ("--runs", 40, "--seed", 5, "--dt", "1e-3", "--formulation", "nullspace",
               "--sampler", "sobol", "--summaries", "max_residual, peak_rotation",
               "--check-dt", "--threads", 1)  # fmt: skip
    pytest.importorskip("scipy")
    code, said, err = call("montecarlo", study, "--out", tmp_path / "a", *options)
    assert (code, err) == (0, "")
    assert "the step puts max_residual off by" in said and "sampling leaves" in said
    # Errors of Sobol points are those of independent draws, and every one says so.
    marked = [line for line in said.splitlines() if "as if drawn independently" in line]
    assert [line.split()[0] for line in marked] == ["probability", "mean", *["the"] * 4]
    for name in ("completed", "holds"):
        assert f"the step puts the probability of {name} off by" in said
    assert (tmp_path / "a" / "success_map.png").exists()
    written = study_file.read(tmp_path / "a" / "manifest.toml")
    assert (written.draws.runs, written.draws.seed, written.options.dt, written.draws.sampler) == (
        40,
        5,
        1e-3,
        "sobol",
    )
    assert written.summaries == ("peak_rotation", "max_residual") and written.check_dt
    code, _, _ = call("montecarlo", tmp_path / "a" / "manifest.toml", "--out", tmp_path / "b")
    assert code == 0
    for name in ("runs.csv", "summary.csv", "manifest.toml", "success_map.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_a_study_that_varies_nothing_and_asks_for_nothing(tmp_path: Path) -> None:
    path = tmp_path / "bare.toml"
    path.write_text("[scene]\nduration = 0.02\n[study]\nruns = 2\ndt = 1e-3", encoding="utf-8")
    code, said, err = call("montecarlo", path, "--out", tmp_path / "out", "--summaries", "",
                           "--format", "svg")  # fmt: skip
    assert (code, err) == (0, "")
    assert said.startswith("2 runs in")
    assert [file.name for file in (tmp_path / "out").glob("*.*g")] == ["failure_times.svg"]


@pytest.mark.parametrize(
    ("text", "options", "named"),
    [
        (TEXT, ("--runs", "0"), "runs = 0: must be at least 1"),
        (TEXT, ("--summaries", "peak_rotatoin"), 'did you mean "peak_rotation"'),
        (TEXT, ("--format", "gif"), "--format = 'gif': must be one of"),
        ("[study]\nruns = 3\ndtt = 1", (), 'did you mean "dt"'),
        ("[capsule]\nrun = 3", (), "is a capsule, one run of a study: replay it"),
        ("duration = 3.0", (), "is a scene, not a study: a study file names the scene, as in"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    tmp_path: Path, text: str, options: tuple[str, ...], named: str
) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    code, out, err = call("montecarlo", path, "--out", tmp_path / "out", *options)
    assert (code, out) == (2, "")
    assert err.startswith("error: ") and err.count("\n") == 1
    assert named in err
    assert not (tmp_path / "out").exists()


def test_ctrl_c_keeps_finished_runs_and_is_exit_code_130(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "softpinch", "montecarlo", str(study), "--out", str(out),
               "--runs", "20000", "--dt", "1e-5", "--summaries", "peak_rotation",
               "--threads", "1"]  # fmt: skip
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        for _ in range(300):
            if out.exists():
                break
            time.sleep(0.05)
        # All runs have been checked by now; then some are simulated.
        time.sleep(0.5)
        running.send_signal(signal.SIGINT)
        said, err = running.communicate(timeout=30)
    finally:
        running.kill()
    assert running.returncode == 130, err
    assert "Traceback" not in err
    if "are kept" not in err:
        # A slow machine: it had not begun to simulate.
        assert err == "interrupted\n"
        return
    done = int(err.split("interrupted: ")[1].split(" of 20000 ")[0])
    if done:
        assert said.startswith(f"{done} runs in ")
        assert err.endswith("; run the same command again to continue\n")
        assert sp.Study.open(out).runs == done
        assert len(rows(out / "runs.csv")) == done + 1


def test_where_all_complete_and_some_hold_the_figures_are_of_holding(tmp_path: Path) -> None:
    path, out = tmp_path / "study.toml", tmp_path / "out"
    path.write_text(TEXT.replace("400.0", "150.0"), encoding="utf-8")
    assert call("montecarlo", path, "--out", out, "--format", "svg")[0] == 0
    study = sp.Study.open(out)
    assert study.counts() == {"completed": 60} and 0 < study.holds.sum() < 60
    assert {file.name for file in out.glob("*.*g")} == {
        "failure_times.svg", "histogram_peak_rotation.svg", "histogram_settling_time.svg",
        "importance_holds.svg", "importance_peak_rotation.svg", "success_map_holds.svg",
    }  # fmt: skip


def test_a_study_is_gone_on_with_and_another_one_refused(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    assert call("montecarlo", study, "--out", out, "--runs", 20)[0] == 0
    for name in ("success_map.svg", "mine.svg"):
        (out / name).write_bytes(b"")
    code, said, err = call("montecarlo", study, "--out", out)
    assert (code, err) == (0, "") and said.startswith("60 runs, 20 of them before, in ")
    # Figures of the study with fewer runs are gone, other files stay.
    assert [file.name for file in out.glob("*.svg")] == ["mine.svg"]
    ensemble = computed(study_file.read(study))
    for name, values in sp.Study.open(out).to_dict().items():
        np.testing.assert_array_equal(values, ensemble.to_dict()[name])
    code, said, err = call("montecarlo", study, "--out", out, "--dt", "2e-3", "--seed", 8)
    assert (code, said) == (2, "")
    assert "study.seed is 7 there, and 8 here; study.dt is 0.001 there, and 0.002 here" in err
    # A study with more runs than the figures show has no table of all runs.
    monkeypatch.setattr(study_report, "LARGEST", 50)
    whole = (out / "summary.csv").read_bytes()
    code, said, _ = call("montecarlo", study, "--out", out, "--runs", 30)
    assert code == 0 and said.startswith("60 runs, 60 of them before, in ")
    assert "(the figures show 50 runs, evenly spread over all)" in said
    assert not (out / "runs.csv").exists() and not (out / "ensemble.npz").exists()
    assert (out / "summary.csv").read_bytes() == whole


def test_nothing_heavy_is_imported_for_help_or_bad_input() -> None:
    code = (
        "import sys; from softpinch.cli import app\n"
        "try: app(['montecarlo', 'no.toml'])\n"
        "except SystemExit: pass\n"
        "print([name for name in ('matplotlib', 'pandas', 'xarray', 'scipy') "
        "if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_the_example_runs(tmp_path: Path) -> None:
    code, said, err = call("montecarlo", EXAMPLE, "--out", tmp_path, "--runs", 100, "--dt", "1e-3")
    assert (code, err) == (0, "")
    assert "separated" in said
    assert (tmp_path / "success_map.png").stat().st_size > 1000


def test_the_example_of_a_hand_that_moves_varies_how_long_it_takes(tmp_path: Path) -> None:
    code, said, err = call("montecarlo", CARRIED, "--out", tmp_path, "--runs", 200)
    assert (code, err) == (0, "")
    kept = sp.Study.open(tmp_path)
    duration, holds = kept.parameters["motion.times.1"] - 0.4, kept.happened("holds")
    assert 0.15 <= duration.min() < 0.16 and 0.34 < duration.max() <= 0.35
    # Short moves lose the object, long ones do not.
    assert holds[duration < 0.17].mean() < 0.5 and holds[duration > 0.3].all()
    assert said.splitlines()[2] == f"probability of holding: {kept.probability('holds')}"
    # A run of the study is that of its scene, with the motion that the study drew.
    lost = kept.failures()[0]
    scene = sp.Scene.from_toml(CARRIED.parents[1] / "scenes" / "carried_pinch.toml")
    alone = sp.simulate(
        scene.with_({path: values[lost.run] for path, values in kept.parameters.items()}), dt=2e-4
    )
    assert (alone.status, float(alone.t[-1])) == ("lost", kept.end_time[lost.run])


def test_the_report_of_unilateral_runs_that_never_settle() -> None:
    scene = sp.Scene(contact="unilateral", friction=0.5, duration=0.02)
    ensemble = sp.monte_carlo(scene, 4, dt=1e-3, summaries="settling_time", settling_band=1e-9,
                              progress=False)  # fmt: skip
    assert not np.isfinite(ensemble["settling_time"]).any()
    table = study_report.summary_table(ensemble)
    assert table.rows[-1][:3] == ("settling_time", "s", 0)
    lines = study_report.lines(ensemble, 0.1)
    assert lines[3].startswith(
        f"(both are of {ensemble.model}; to hold is to complete, with both t"
    )
    assert "settling_time  finite in no run" in lines
