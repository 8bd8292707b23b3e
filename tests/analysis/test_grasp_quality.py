"""The example of grasp quality: slow forces find the limit, sudden ones less."""

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
