"""Wild scenes with unilateral contact end, with a legal status and without silent NaN."""

import warnings
from collections import Counter

import numpy as np
import pytest

import softpinch as sp
from contact_scenes import EVERYTHING, FREE, GRAZE
from wild_contacts import STATUSES, wild_contact


def ends_well(seed: int, decades: float) -> str:
    """Simulates a wild scene and returns its status. An assertion names the scene."""
    scene, options = wild_contact(seed, decades)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = sp.simulate(scene, record=EVERYTHING, **options)
    which = (seed, decades, run.status)
    assert run.status in STATUSES and run.message, which
    assert len(run.t) >= 1 and np.isfinite(run.t).all(), which
    assert run.t[-1] <= scene.duration * (1 + 1e-12), which
    if run.status != "not_finite":
        for name, values in run.arrays().items():
            assert np.isfinite(values).all(), (*which, name)
    assert np.isfinite(list(run.violations.values())).all(), which
    loose = (run.contact == FREE) | (run.contact == GRAZE)
    assert not run.multipliers[:, :2][loose].any(), which
    assert not run.multipliers[:, 2:][loose].any(), which
    times = [change.time for change in run.contact_changes]
    assert times == sorted(times) and np.isfinite(times).all(), which
    return run.status


@pytest.mark.parametrize(("seed", "decades"), [(65, 3.0)])
def test_a_tip_that_meets_the_face_and_leaves_it_at_once_is_free(seed: int, decades: float) -> None:
    scene, options = wild_contact(seed, decades)
    run = sp.simulate(scene, record=EVERYTHING, **options)
    assert run.status == "completed" and not run.contact[-1].any()
    assert not run.holds
    assert run.state(-1).contact is not None and not np.signbit(run.state(-1).contact[:2]).any()


@pytest.mark.parametrize(("seed", "decades"), [(11578, 0.3), (3265, 3.0), (9021, 3.0)])
def test_a_run_without_modes_at_its_start_still_has_a_row(seed: int, decades: float) -> None:
    assert ends_well(seed, decades) == "no_mode"


@pytest.mark.parametrize("decades", [0.3, 1.0, 3.0])
def test_wild_scenes_end_in_a_status(decades: float) -> None:
    seen = Counter(ends_well(seed, decades) for seed in range(120))
    # They are not all lost at once.
    assert decades > 1 or seen["completed"] > 20


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
@pytest.mark.parametrize("decades", [0.3, 1.0, 3.0])
def test_very_many_wild_scenes_end_in_a_status(decades: float, block: int) -> None:
    seen = Counter(ends_well(1000 + 2000 * block + k, decades) for k in range(2000))
    if decades < 1:
        # Most of the few that fail have steps that are far too long for them.
        assert seen["no_mode"] + seen["chattering"] <= 20


def wild_ensemble(runs: int, seed: int, method: str, **steps: float) -> sp.Ensemble:
    """Pushes, kicks, light and heavy tips, and friction from none to ten, in all lanes."""
    scene = sp.Scene(
        grasped=sp.GraspedObject(height=0.049),
        disturbances=[
            sp.Pulse(time=0.002, duration=0.004, force=(0.0, 0.0), moment=0.0),
            sp.Impulse(time=0.008, impulse=(0.0, 0.0), angular_impulse=0.0),
        ],
        hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.05, tangential_mass=0.05)),
        duration=0.012,
        contact="unilateral",
        friction=0.5,
    )
    return sp.monte_carlo(
        scene,
        runs,
        seed=seed,
        vary={
            "disturbances.0.force": sp.Normal(0.0, (300.0, 300.0)),
            "disturbances.0.moment": sp.Normal(0.0, 5.0),
            "disturbances.1.impulse": sp.Normal(0.0, (0.3, 0.3)),
            "disturbances.1.angular_impulse": sp.Normal(0.0, 2e-3),
            "friction": sp.Uniform(0.0, 10.0),
            "hand.tip.normal_mass": sp.LogUniform(0.005, 0.5),
            "hand.tip.tangential_mass": sp.LogUniform(0.005, 0.5),
            "hand.tip.youngs_modulus": sp.LogUniform(3e4, 3e6),
            "grasped.inertia": sp.LogUniform(4e-6, 4e-4),
            "grasped.com_offset": sp.Uniform(-0.01, 0.01),
        },
        method=method,
        summaries=("final_state",),
        progress=False,
        **steps,
    )


def all_end_well(ensemble: sp.Ensemble) -> Counter[str]:
    seen = Counter(ensemble.status.tolist())
    assert set(seen) <= STATUSES
    fine = ensemble.status != "not_finite"
    assert np.isfinite(ensemble["final_state"][fine]).all()
    assert np.isfinite(ensemble.end_time).all()
    return seen


@pytest.mark.parametrize("method", ["rk4", "dop853"])
def test_ensembles_of_wild_scenes_end_in_statuses(method: str) -> None:
    assert all_end_well(wild_ensemble(2000, 1, method, dt=5e-5))["completed"] > 500


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "dop853", "rosenbrock"])
@pytest.mark.parametrize("seed", range(3))
def test_very_large_ensembles_of_wild_scenes_end_in_statuses(method: str, seed: int) -> None:
    all_end_well(wild_ensemble(110_000, 2 + seed, method, dt=1e-4))
