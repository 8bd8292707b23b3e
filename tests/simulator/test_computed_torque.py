"""The example of computed torque follows its path far better than the PID does."""

import re
from pathlib import Path

import pytest

from example_runs import run_example

pytest.importorskip("matplotlib")


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
