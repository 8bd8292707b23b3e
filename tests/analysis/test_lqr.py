"""The LQR example: a design on the linear model holds on the nonlinear grasp."""

import re
from pathlib import Path

import pytest

from example_runs import run_example

pytest.importorskip("control")
pytest.importorskip("matplotlib")


def test_lqr_on_the_linear_model_controls_the_grasp(tmp_path: Path) -> None:
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
