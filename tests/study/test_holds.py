"""Whether grasps hold: the column of an ensemble, and what can be asked of it."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import softpinch as sp
from ensembles import require_alone, require_same
from scenes import jerked
from softpinch import _core, paper

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


@pytest.mark.parametrize(
    "how",
    [
        {"dt": 5e-4},
        {"dt": None, "tolerance": 1e-5, "method": "dop853"},
        {"dt": 1e-3, "method": "implicit_midpoint"},
    ],
    ids=str,
)
@pytest.mark.usefixtures("simd_level")
def test_a_row_is_what_the_run_alone_says(how: dict[str, Any]) -> None:
    many = study(24, **how)
    assert 0 < many.holds.sum() < 24
    for run in range(24):
        require_alone(many, run)


def test_it_stands_wherever_a_status_or_booleans_may_stand() -> None:
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


def test_the_map_of_a_name_and_of_its_booleans_is_the_same() -> None:
    maps = []
    for what in ("holds", some().holds, "completed"):
        figure = sp.plot.success_map(some(), f"{FORCE}.0", f"{FORCE}.1", what)
        maps.append(np.ma.filled(figure.axes[0].collections[0].get_array(), -1.0))
        assert ("holds" in figure.axes[1].get_ylabel()) == (
            isinstance(what, str) and what == "holds"
        )
    np.testing.assert_array_equal(maps[0], maps[1])
    assert (maps[0] != maps[2]).any()


@pytest.mark.parametrize("what", ["holds", "completed", "booleans"])
def test_a_map_says_of_which_contact_and_friction_it_is(what: str) -> None:
    for scene, said in ((PUSHED, "friction 0.9"), (replace(PUSHED, friction=None), "any friction")):
        few = study(12, scene, dt=1e-3)
        figure = sp.plot.success_map(
            few, f"{FORCE}.0", f"{FORCE}.1", few.holds if what == "booleans" else what
        )
        title = figure.axes[0].get_title()
        assert title.splitlines()[0] == few.model == f"bilateral contact, {said}"


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
def test_what_an_ensemble_saw_before_summaries_after_does_not_count(how: dict[str, Any]) -> None:
    for after, least, most in ((None, 0, 0), (0.0, 0, 0), (0.011, 1, 39), (0.02, 40, 40)):
        many = jerked_grasps(after, **how)
        assert least <= many.holds.sum() <= most
        for run, holds in enumerate(many.holds):
            # Its intervals are of the whole run.
            seen = require_alone(many, run).violation_intervals
            last = max(seen[name][-1, 1] for name in ("pulling", "slipping") if name in seen)
            assert 0.01 <= last < 0.012
            assert holds == (after is not None and last < after)


@pytest.mark.parametrize(
    ("how", "finer"),
    [
        ({"dt": 2e-3}, {"dt": 1e-3}),
        ({"tolerance": 1e-3, "method": "dop853"}, {"tolerance": 1e-4, "method": "dop853"}),
    ],
    ids=["steps", "tolerance"],
)
def test_that_other_steps_change_who_holds_is_an_error_of_the_steps(
    how: dict[str, Any], finer: dict[str, Any]
) -> None:
    checked = jerked_grasps(0.011, **how, check_dt=True)
    held, then = (each.holds.astype(float) for each in (checked, jerked_grasps(0.011, **finer)))
    assert held.sum() != then.sum()
    assert checked.discretisation is not None
    assert checked.discretisation["completed"].worst == 0.0
    said = checked.discretisation["holds"]
    assert said.bias == pytest.approx(held.mean() - then.mean(), abs=1e-15)
    assert (said.worst, said.runs) == (1.0, 40)
    assert said.bias_error == pytest.approx(stats.sem(held - then))
    assert said.sampling_error == pytest.approx(stats.sem(held))


def test_a_folder_keeps_it_and_other_libraries_read_it(tmp_path: Path) -> None:
    kept = study(store=tmp_path / "study")
    require_same(some(), next(kept.chunks()))
    again = sp.Study.open(tmp_path / "study")
    assert again.probability("holds") == some().probability("holds")
    assert again.mean("holds") == some().mean("holds")
    assert again.holds.tolist() == some().holds.tolist()
    frame = again.to_pandas()
    assert frame["holds"].dtype == bool and frame["holds"].tolist() == some().holds.tolist()
    assert frame.attrs["units"]["holds"] == "1"
    assert again.to_xarray()["holds"].values.tolist() == some().holds.tolist()
    parquet = pytest.importorskip("pyarrow.parquet")
    column = parquet.read_table(next((tmp_path / "study").rglob("*.parquet"))).column("holds")
    assert str(column.type) == "bool" and column.to_pylist() == some().holds.tolist()


def test_runs_are_enough_when_its_probability_is_known_well(tmp_path: Path) -> None:
    how: dict[str, Any] = {"dt": 1e-3, "stop_when": {"holds": 0.05}}
    enough = study(4000, **how)
    assert enough.runs == 1024 and enough.requested == 4000
    stored = study(4000, **how, store=tmp_path / "study")
    assert stored.runs == 1024
    assert sp.Study.open(tmp_path / "study").resume().runs == 1024


def test_names_of_events_are_suggested() -> None:
    with pytest.raises(ValueError, match="holds"):
        some().probability("hold")
    assert "holds" not in (*_core.STATUSES, *_core.VIOLATIONS)
