"""Studies with unilateral contact in a folder: the same bits, modes and friction, also later."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from ensembles import require_same
from softpinch import paper

pytest.importorskip("pyarrow")
pytest.importorskip("tomli_w")

PUSHED = replace(
    paper.disturbance("ii", duration=1.02),
    contact="unilateral",
    friction=(0.5, 0.8),
    grasped=replace(paper.disturbance("ii").grasped, height=0.049),
)
VARY: dict[Any, Any] = {
    "disturbances.0.force": sp.Uniform((-300.0, -300.0), (300.0, 300.0)),
    "friction.left": sp.Uniform(0.1, 1.2),
}


def study(runs: int, scene: sp.Scene = PUSHED, **how: Any) -> Any:
    summaries = ("final_state", "slip_distance", "free_time")
    return sp.monte_carlo(scene, runs, 5, VARY, 1e-3, summaries=summaries, progress=False, **how)


def test_a_folder_is_resumed_and_extended_to_the_bits_of_memory(tmp_path: Path) -> None:
    memory = study(1100)
    assert {"completed", "lost"} <= set(memory.counts())
    kept = study(1100, store=tmp_path / "study", only=np.arange(0, 1100, 7))
    assert not kept.complete
    require_same(study(1100, only=np.arange(0, 1100, 7)), kept.ensemble())
    whole = sp.Study.open(tmp_path / "study").resume(progress=False)
    whole.verify()
    require_same(memory, whole.ensemble())
    assert whole.scene == PUSHED
    assert whole.model == memory.model == "unilateral contact, varied friction"
    more = whole.extend(1300, progress=False)
    require_same(study(1300), more.ensemble())
    for name in ("holds", "opened", "slipping", "lost"):
        assert more.probability(name) == study(1300).probability(name)
    assert more.replay(1200).contact_changes == study(1300).replay(1200).contact_changes
    capsule = more.failures()[0]
    again = sp.Capsule.from_toml(capsule.to_toml())
    assert again == capsule and again.agrees(again.replay())


def test_a_kept_trajectory_has_modes_changes_and_intervals(tmp_path: Path) -> None:
    kept = study(4, store=tmp_path / "study", trajectories=(0, 1, 2, 3))
    events = 0
    for run, path in sp.Study.open(tmp_path / "study").trajectories.items():
        alone = kept.replay(run)
        events += len(alone.contact_changes)
        assert path.contact_changes == alone.contact_changes
        assert path.contact.dtype == alone.contact.dtype
        np.testing.assert_array_equal(path.contact, alone.contact)
        for k in (0, len(alone) // 2, -1):
            assert path.state(k) == alone.state(k)
        assert path.holds == alone.holds
        assert path.violation_intervals.keys() == alone.violation_intervals.keys()
        for name, intervals in path.violation_intervals.items():
            assert not intervals.flags.writeable
            np.testing.assert_array_equal(intervals, alone.violation_intervals[name])
        np.testing.assert_array_equal(path.energy.friction_loss, alone.energy.friction_loss)
    assert events > 0
