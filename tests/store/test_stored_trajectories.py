"""Trajectories of a study: their rows and quantities, in memory, in a folder and in other tools."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import softpinch as sp

EQUAL = {"dt": 1e-3}
ADAPTIVE = {"tolerance": 1e-7, "formulation": "nullspace", "method": "dop853"}


@pytest.mark.parametrize("steps", [EQUAL, ADAPTIVE], ids=["equal steps", "adaptive steps"])
def test_trajectories_have_the_rows_and_quantities_that_were_asked_for(
    steps: dict[str, Any], tmp_path: Path
) -> None:
    how = {**steps, "vary": {"grasped.mass": sp.Uniform(0.09, 0.11)}, "progress": False}
    scene = sp.Scene(duration=0.02)
    times = np.linspace(0.0, 0.02, 7)
    rows: dict[str, Any] = {"every": 4} if steps is EQUAL else {"times": [*times, 0.05]}
    asked = {"trajectories": (1, 2), "record": ("state", "torque"), **rows}
    memory = sp.monte_carlo(scene, 3, **how, **asked)

    def stop(done: int, runs: int) -> None:
        raise KeyboardInterrupt

    # A study that is stopped keeps what was asked for; so does a call that asks for no more.
    sp.monte_carlo(scene, 3, store=tmp_path, **{**how, "progress": stop}, **asked)
    sp.monte_carlo(scene, 3, store=tmp_path, only=[0], **how)
    study = sp.Study.open(tmp_path).resume(progress=False)
    assert list(study.trajectories) == [1, 2]
    for run in (1, 2):
        read, kept = study.trajectories[run], memory.trajectories[run]
        full = memory.replay(run)
        if steps is EQUAL:
            wanted = sorted({*range(0, len(full), 4), len(full) - 1})
            np.testing.assert_array_equal(kept.q, full.q[wanted])
            np.testing.assert_array_equal(kept.torque, full.torque[wanted])
        else:
            # The instant beyond the run's end is left out.
            np.testing.assert_array_equal(kept.t, times)
            assert kept.q[-1] == pytest.approx(full.q[-1], rel=1e-12)
        assert list(read.arrays()) == ["q", "p", "integral", "torque"] == list(kept.arrays())
        for name, values in read.arrays().items():
            np.testing.assert_array_equal(values, kept.arrays()[name])
        assert read.provenance() == kept.provenance()
        with pytest.raises(sp.NotRecordedError, match="multipliers"):
            read.multipliers  # noqa: B018
    there = pd.read_parquet(tmp_path / "trajectories", columns=["run", "t", "theta", "torque_2"])
    one = there[there["run"] == 2].sort_values("t")
    np.testing.assert_array_equal(one["theta"], memory.trajectories[2].q[:, 2])
    np.testing.assert_array_equal(one["torque_2"], memory.trajectories[2].torque[:, 1])
    study.verify()
