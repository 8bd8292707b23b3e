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


@pytest.mark.parametrize(("seed", "dt"), [(12326, 2e-5), (13773, 1e-4)])
def test_friction_never_gives_energy_where_a_slip_ends_within_a_step(seed: int, dt: float) -> None:
    """The slip stops, and its tip lets go or slips back, all within one step.

    At the end of the step only the last of these events is due. Much shorter steps see each.
    """
    scene, _ = wild_contact(seed, 0.4)
    run, fine = (sp.simulate(scene, h, record=EVERYTHING) for h in (dt, dt / 100))
    assert np.diff(run.energy.friction_loss).min() >= -1e-9 * run.energy.exchanged
    begun, refined = (
        [change[1:] for change in one.contact_changes if change.time < dt] for one in (run, fine)
    )
    assert begun == refined


def test_a_tip_that_lets_go_does_not_pull_the_object_out_of_the_hand() -> None:
    """One step in which lambda^H is negative pulls with 4e7 N, and the object is lost."""
    scene, _ = wild_contact(20725, 0.3)
    run = sp.simulate(scene, 3e-4, formulation="projected", record=EVERYTHING)
    fine = sp.simulate(scene, 1e-5, formulation="projected", record=EVERYTHING)
    assert run.status == fine.status == "completed"
    assert run.multipliers[:, :2].min() >= 0.0
    assert abs(run.energy.closure).max() < 1e-3 * run.energy.exchanged


@pytest.mark.parametrize(("seed", "status"), [(60409, "completed"), (60560, "lost")])
def test_an_event_at_the_start_of_an_implicit_step_is_found(seed: int, status: str) -> None:
    """Steps of 1e-24 s, in search of an event before that one, could not be solved."""
    assert ends_well(seed, 0.3) == status


@pytest.mark.parametrize(("seed", "decades"), [(11578, 0.3), (3265, 3.0), (9021, 3.0)])
def test_a_run_without_modes_at_its_start_still_has_a_row(seed: int, decades: float) -> None:
    assert ends_well(seed, decades) == "no_mode"


@pytest.mark.parametrize("decades", [0.3, 1.0, 3.0])
@pytest.mark.parametrize(
    ("first", "count"),
    [(0, 120), *(pytest.param(k, 2000, marks=pytest.mark.slow) for k in range(1000, 21_000, 2000))],
)
def test_wild_scenes_end_in_a_status(first: int, count: int, decades: float) -> None:
    seen = Counter(ends_well(first + k, decades) for k in range(count))
    if decades <= 1.0:
        # They are not all lost at once.
        assert seen["completed"] > 20
    if decades < 1.0:
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


@pytest.mark.parametrize(
    ("method", "runs", "dt"),
    [
        ("rk4", 2000, 5e-5),
        ("dop853", 2000, 5e-5),
        pytest.param("rk4", 110_000, 1e-4, marks=pytest.mark.slow),
        pytest.param("rosenbrock", 110_000, 1e-4, marks=pytest.mark.slow),
    ],
)
def test_ensembles_of_wild_scenes_end_in_statuses(method: str, runs: int, dt: float) -> None:
    ensemble = wild_ensemble(runs, 1, method, dt=dt)
    assert set(ensemble.status.tolist()) <= STATUSES
    assert ensemble.counts()["completed"] > 500
    fine = ensemble.status != "not_finite"
    assert np.isfinite(ensemble["final_state"][fine]).all()
    assert np.isfinite(ensemble.end_time).all()
