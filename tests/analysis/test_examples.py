"""Examples print what the physics explains, or what is found without derivatives, too."""

import re
from pathlib import Path

import numpy as np
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


def test_the_loop_predicts_the_gain_of_the_camera(tmp_path: Path) -> None:
    printed = run_example("16_camera_and_servo.py", tmp_path, "--quick")
    predicted, found = map(float, re.findall(r": +([\d.]+) 1/s", printed))
    assert found == pytest.approx(predicted, rel=0.0081)
    with_camera, without = map(float, re.findall(r"camera: ([\d.]+)%", printed))
    assert with_camera > without + 3.0


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


def test_the_smooth_move_is_what_finite_differences_find_too(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    printed = run_example("11_smooth_move.py", tmp_path)
    rows = {
        name: list(map(float, re.findall(r"-?[\d.]+", line)))
        for name, line in re.findall(r"^(tips [a-z, ]+?)  +(.*)$", printed, re.MULTILINE)
    }
    pulls, exact, differences = rows.values()
    assert next(iter(rows)) == "tips may pull" and pulls[1] < 0.0
    # The cost of a tip that may not pull is higher, its force meets the limit, and both agree.
    assert exact[0] > pulls[0] and exact[1] == 0.5
    assert exact[:2] == pytest.approx(differences[:2], rel=1e-3)
    assert 10 * exact[3] < differences[3]
    fine = re.findall(r"with dt = 2e-05 s: (\w+), violations (.*)", printed)
    assert fine[1] == ("completed", "{}") and "pulling" in fine[0][1]


def test_the_softest_tip_holds_as_often_as_it_should(tmp_path: Path) -> None:
    """By ensembles that the search has not seen, with half the step."""
    pytest.importorskip("scipy")
    printed = run_example("12_softest_tip.py", tmp_path, "--quick")
    found = [
        list(map(float, odds))
        for odds in re.findall(r"^E = +(\d+) Pa.*?([\d.]+)%, ([\d.]+)% to ([\d.]+)%", printed, re.M)
    ]
    moduli, shares, lows, highs = zip(*found, strict=True)
    middle = len(found) // 2
    assert str(int(moduli[middle])) in printed.partition("softest tip has E = ")[2][:10]
    assert lows[middle] < 99.9 < highs[middle]
    # With softer tips too few hold, with stiffer ones more than needed.
    assert highs[middle - 2] < 99.9 < lows[middle + 2]
    assert shares[0] == min(shares)


# Fewer draws tell whether 99 % hold than whether 99.9 % do.
@pytest.mark.parametrize("percent", [99.0, pytest.param(99.9, marks=pytest.mark.slow)])
def test_a_move_is_as_long_as_it_has_to_be(percent: float, tmp_path: Path) -> None:
    """By draws that the search has not seen, with half the step."""
    fewer = {"SHARE = 0.999": "SHARE = 0.99", "4_000 if": "800 if"} if percent < 99.9 else None
    printed = run_example("13_carried_by_an_arm.py", tmp_path, "--quick", changes=fewer)
    peak, known = map(float, re.findall(r"fastest move: ([\d.]+) m/s\^2.*: ([\d.]+) s", printed)[0])
    # The peak of a move by minimum jerk over 0.5 m.
    assert peak == pytest.approx(10.0 / 3.0**0.5 * 0.5 / known**2, rel=0.01)
    safe, soonest, latest = map(
        float, re.findall(rf"{percent:g} %: ([\d.]+) s, .* ([\d.]+) to ([\d.]+) s", printed)[0]
    )
    assert known < 0.2 < soonest <= safe <= latest < 0.36
    (others,) = re.findall(r"half the step: ([\d.]+) \(95 %: ([\d.]+) to ([\d.]+)\)", printed)
    share, low, high = map(float, others)
    assert low <= percent / 100.0 <= high and 0.99 * percent < 100.0 * share < 100.0
    shares = dict(re.findall(r"^  (\S+) +share +([\d.]+)", printed, re.MULTILINE))
    assert max(shares, key=lambda path: float(shares[path])) == "motion.times.1"


def test_a_gripper_carries_a_bottle_as_fast_as_friction_lets_it(tmp_path: Path) -> None:
    printed = run_example("14_a_bottle_in_jaws.py", tmp_path, "--quick")
    assert float(re.findall(r"misfit ([\d.]+)%", printed)[0]) < 1.0
    # A tip of 20 mm on a bottle of 35 mm.
    softer = float(re.findall(r"arcs soften the tips to ([\d.]+)", printed)[0])
    assert softer == pytest.approx((1.0 + 20.0 / 35.0) ** -0.5, abs=1e-3)
    duration, peak = map(
        float, re.findall(r"numbers known: ([\d.]+) s, .* ([\d.]+) m/s", printed)[0]
    )
    # Friction of 0.5 on 15 N in each tip bears 15 N upwards, of 0.5 kg, but for the tips' couples.
    assert peak == pytest.approx(2.0 * 0.5 * 15.0 / 0.5 - 9.81, rel=0.05)
    parts = re.findall(
        r"^tips ([\d.]+) times as stiff: +([\d.]+) N, ([\d.]+)", printed, re.MULTILINE
    )
    factors, forces, holds = np.array(parts, float).T
    # The jaws travel equally far, so that stiffer tips press harder and lose fewer bottles.
    assert forces / forces.mean() == pytest.approx(factors / factors.mean(), rel=0.05)
    assert np.corrcoef(factors, holds)[0, 1] > 0.7
    shares = dict(re.findall(r"^  (\S+): share ([\d.]+)", printed, re.MULTILINE))
    assert max(shares, key=lambda path: float(shares[path])) == "motion.times.2"
    rows = re.findall(r"^ +([\d.]+) +[\d.]+ +([\d.]+) to ([\d.]+) +([\d.]+)", printed, re.MULTILINE)
    at, low, high, slips = np.array(rows, float).T
    assert low[0] > 0.6 and high[-1] < 0.1 and low[at < duration].min() > high[at > 0.75].max()
    assert (slips >= low).all()


def test_how_rarely_it_fails(tmp_path: Path) -> None:
    printed = run_example("15_how_rarely_it_fails.py", tmp_path, "--quick")
    assert "lost with a probability of" in printed
    assert "the object was lost at" in printed
