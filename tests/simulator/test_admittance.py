"""The example of admittance control: its predicted limit is the one that the simulation shows."""

import re
from pathlib import Path

import pytest

from example_runs import run_example

pytest.importorskip("matplotlib")
pytest.importorskip("scipy")


def test_the_linear_model_predicts_the_limit_of_the_gain(tmp_path: Path) -> None:
    printed = run_example("07_admittance.py", tmp_path, "--quick")
    predicted, found = map(float, re.findall(r": +([\d.]+) rad", printed))
    # The ensemble looks within 1 % of the prediction, at eleven gains.
    assert found == pytest.approx(predicted, rel=0.0081)
