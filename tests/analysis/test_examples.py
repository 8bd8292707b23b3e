"""The examples on grasp quality and control print results that the physics explains."""

import re
from pathlib import Path

import pytest

from example_runs import run_example

pytest.importorskip("matplotlib")


def test_sudden_pushes_slip_before_slow_ones_do(tmp_path: Path) -> None:
    printed = run_example("09_grasp_quality.py", tmp_path, "--quick")
    quality = float(re.findall(r"weakest direction: ([\d.]+) N", printed)[0])
    by_angle = [float(size) for size in re.findall(r"degrees: +([\d.]+) N", printed)]
    assert by_angle == sorted(by_angle) and by_angle[2] == quality
    rows = [row.split() for row in printed.splitlines() if re.match(r"  [01]\.\d to", row)]
    lows, sticking, holding = ([float(row[k]) for row in rows] for k in (0, 3, 4))
    assert len(rows) == 10
    for low, sticks, holds in zip(lows, sticking, holding, strict=True):
        assert sticks <= holds
        if low < 0.5:
            assert sticks == holds == 1.0
        if low >= 1.0:
            assert sticks == 0.0


def test_lqr_on_the_linear_model_controls_the_grasp(tmp_path: Path) -> None:
    pytest.importorskip("control")
    printed = run_example("08_lqr.py", tmp_path, "--quick")
    growth, decay = (float(one) for one in re.findall(r"([\d.]+) 1/s", printed))
    assert growth > 1.0 and decay > 10.0  # without the controller the object is lost
    off = re.search(r"within ([\d.]+)% of the linear motion", printed)
    assert off is not None and 0.0 < float(off[1]) < 3.0
    odds = {
        name: [float(one) for one in re.findall(r"from ([\d.]+)%", line)]
        for name, line in re.findall(r"^(PID|LQR): (.*)$", printed, re.MULTILINE)
    }
    # It gives way more, so tips pull less often, but the largest impulses carry it further away.
    assert odds["LQR"][0] > 50.0 and odds["LQR"][1] > odds["PID"][1] + 5.0


def test_the_linear_model_predicts_the_limit_of_the_gain(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    printed = run_example("07_admittance.py", tmp_path, "--quick")
    predicted, found = map(float, re.findall(r": +([\d.]+) rad", printed))
    # The ensemble looks within 1 % of the prediction, at eleven gains.
    assert found == pytest.approx(predicted, rel=0.0081)


def test_a_true_model_leaves_the_smallest_errors(tmp_path: Path) -> None:
    printed = run_example("06_computed_torque.py", tmp_path, "--quick")
    # Largest error after the start, degrees.
    rows = re.findall(r"^    (.+?) +[\d.]+ +([\d.]+) +[\d.]+ +[\d.]+ N  completed$", printed, re.M)
    assert [name for name, _ in rows] == [
        "PID",
        "computed torque, model 20 % too soft",
        "computed torque, true model",
    ]
    pid, wrong, true = (float(error) for _, error in rows)
    assert true < 1e-3
    assert 5 * true < wrong < pid / 50
