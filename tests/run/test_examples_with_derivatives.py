"""The examples that optimise with derivatives of runs: what they find is checked without these."""

import re
from pathlib import Path

import pytest

from example_runs import run_example

pytest.importorskip("matplotlib")
pytest.importorskip("scipy")


def test_the_smooth_move_is_what_finite_differences_find_too(tmp_path: Path) -> None:
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
