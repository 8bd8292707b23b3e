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
    assert list(rows)[0] == "tips may pull" and pulls[1] < 0.0
    # The cost of a tip that may not pull is higher, its force meets the limit, and both agree.
    assert exact[0] > pulls[0] and exact[1] == 0.5
    assert exact[:2] == pytest.approx(differences[:2], rel=1e-3)
    assert 10 * exact[3] < differences[3]
    fine = re.findall(r"with dt = 2e-05 s: (\w+), violations (.*)", printed)
    assert fine[1] == ("completed", "{}") and "pulling" in fine[0][1]
