"""The example of computed torque follows its path far better than the PID does."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

EXAMPLE = Path(__file__).parents[2] / "examples" / "06_computed_torque.py"


def test_a_true_model_leaves_the_smallest_errors(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    command = [sys.executable, "-W", "error", str(EXAMPLE), str(picture), "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert picture.stat().st_size > 1000
    # Largest error after the start, degrees.
    rows = re.findall(
        r"^    (.+?) +[\d.]+ +([\d.]+) +[\d.]+ +[\d.]+ N  completed$", done.stdout, re.M
    )
    assert [name for name, _ in rows] == [
        "PID",
        "computed torque, model 20 % too soft",
        "computed torque, true model",
    ]
    pid, wrong, true = (float(error) for _, error in rows)
    assert true < 1e-3
    assert 5 * true < wrong < pid / 50
