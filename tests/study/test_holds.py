"""Whether grasps hold: the column of an ensemble, and what can be asked of it."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from ensembles import require_alone
from scenes import jerked
from softpinch import paper

FORCE = "disturbances.0.force"
VARY: dict[Any, Any] = {
    FORCE: sp.Uniform((-300.0, -300.0), (300.0, 300.0)),
    "grasped.mass": sp.Normal(0.1, 0.01),
}
PUSHED = replace(paper.disturbance("ii", duration=1.1), friction=0.9)


def study(runs: int = 200, scene: sp.Scene = PUSHED, **how: Any) -> Any:
    return sp.monte_carlo(
        scene,
        runs,
        seed=5,
        vary=VARY | how.pop("vary", {}),
        summaries=("final_state", "peak_friction_ratio"),
        summaries_after=0.9,
        progress=False,
        **{"dt": 5e-4, **how},
    )


@cache
def some() -> sp.Ensemble:
    found: sp.Ensemble = study()
    return found


def test_a_grasp_holds_if_it_completes_and_needs_no_more_friction_than_there_is() -> None:
    held = (some().status == "completed") & (some()["peak_friction_ratio"] <= 0.9)
    assert 0 < held.sum() < (some().status == "completed").sum() < 200
    assert held.tolist() == some().holds.tolist()
    assert some().holds.dtype == bool
    with pytest.raises(ValueError, match="read-only"):
        some().holds[0] = True


def test_without_friction_only_a_pull_counts_and_each_run_has_its_own() -> None:
    endless = study(100, replace(PUSHED, friction=None))
    pulled = np.isinf(endless["peak_friction_ratio"])
    assert ((endless.status == "completed") & ~pulled).tolist() == endless.holds.tolist()
    assert endless.model == "bilateral contact, any friction"
    own = study(100, vary={"friction": sp.Uniform(0.2, 2.0)})
    enough = own["peak_friction_ratio"] <= own["friction"]
    assert ((own.status == "completed") & enough).tolist() == own.holds.tolist()
    assert 0 < own.holds.sum() < endless.holds.sum()
    assert own.model == "bilateral contact, varied friction"


def test_holds_can_be_used_like_a_status_or_booleans() -> None:
    ensemble = some()
    held = ensemble.holds
    assert ensemble.probability("holds") == ensemble.probability(held)
    assert ensemble.probability("holds").happened == held.sum()
    assert ensemble.happened("holds").tolist() == held.tolist()
    assert ensemble.mean("holds") == ensemble.mean(held)
    assert float(ensemble.mean("holds")) == pytest.approx(held.mean())
    assert sp.sensitivity(ensemble, "holds") == sp.sensitivity(ensemble, held)
    assert sp.sensitivity(ensemble, "holds") != sp.sensitivity(ensemble, "completed")
    assert ensemble.model == "bilateral contact, friction 0.9"
    for wrong in (held[1:], held.astype(float)):
        with pytest.raises(ValueError, match=r"must be a name or booleans \(200,\)"):
            ensemble.mean(wrong)
        with pytest.raises(ValueError, match=r"must be a name or booleans \(200,\)"):
            sp.sensitivity(ensemble, wrong)
        with pytest.raises(ValueError, match=r"must be a name or booleans \(200,\)"):
            sp.plot.success_map(ensemble, f"{FORCE}.0", f"{FORCE}.1", wrong)


def jerked_grasps(after: float | None, **how: Any) -> Any:
    """Forty grasps that pull or slip for a millisecond or two after a jump at 10 ms."""
    return sp.monte_carlo(
        jerked(),
        40,
        seed=5,
        vary={
            "friction": sp.Uniform(0.2, 2.0),
            "grasped.mass": sp.Normal(0.1, 0.01),
            "hand.tip.youngs_modulus": sp.LogNormal(0.30e6, 0.2),
        },
        summaries=("final_state",),
        summaries_after=after,
        progress=False,
        **how,
    )


@pytest.mark.parametrize(
    "how",
    [{"dt": 1e-3}, {"tolerance": 1e-5, "method": "dop853"}, {"method": "implicit_midpoint"}],
    ids=str,
)
@pytest.mark.usefixtures("simd_level")
def test_violations_before_summaries_after_do_not_count_for_holds(how: dict[str, Any]) -> None:
    for after, least, most in ((None, 0, 0), (0.0, 0, 0), (0.011, 1, 39), (0.02, 40, 40)):
        many = jerked_grasps(after, **how)
        assert least <= many.holds.sum() <= most
        for run, holds in enumerate(many.holds):
            # Its intervals are of the whole run.
            seen = require_alone(many, run).violation_intervals
            last = max(seen[name][-1, 1] for name in ("pulling", "slipping") if name in seen)
            assert 0.01 <= last < 0.012
            assert holds == (after is not None and last < after)
