"""The example of admittance control: its predicted limit is the one that the simulation shows."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("scipy")

EXAMPLE = Path(__file__).parents[2] / "examples" / "07_admittance.py"


def test_the_linear_model_predicts_the_limit_of_the_gain(tmp_path: Path) -> None:
    picture = tmp_path / "picture.png"
    command = [sys.executable, "-W", "error", str(EXAMPLE), str(picture), "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert picture.stat().st_size > 1000
    predicted, found = map(float, re.findall(r": +([\d.]+) rad", done.stdout))
    # The ensemble looks within 1 % of the prediction, at eleven gains.
    assert found == pytest.approx(predicted, rel=0.0081)
