"""The tools of accuracy on scenes with unilateral contact: right, or refused in one line."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from oracle import unilateral
from random_pinches import random_pinch
from softpinch.accuracy.reference import of_any_contact
from softpinch.accuracy.stability import StepSearch, along_run
from softpinch.run.options import Options
from unilateral_scenes import gripped, regripped, thrown

SCENE = regripped()


def light(scene: sp.Scene) -> sp.Scene:
    """With tips whose surfaces weigh 10 g, and relax at 1e4 1/s while they are free."""
    tip = sp.Fingertip(
        normal_mass=0.01, tangential_mass=0.01, normal_viscosity=100.0, tangential_viscosity=50.0
    )
    return replace(scene, hand=sp.Hand(tip=tip))


def test_the_reference_agrees_with_an_independent_simulation() -> None:
    times = np.array([0.005, 0.0199, 0.02, 0.021, 0.0235, 0.03, 0.04])
    found = of_any_contact(SCENE, times)
    exact = unilateral(SCENE, times)
    assert [tuple(change[1:4]) for change in exact.changes] == [
        ("left", "stick", "free"),
        ("left", "free", "slip-"),
        ("left", "slip-", "stick"),
    ]
    for name, right in (("q", exact.q), ("p", exact.p)):
        apart = np.abs(getattr(found, name) - right) / found.scales[name]
        assert apart.max() < 1e-8, name
    assert found.own_error is not None and max(found.own_error.values()) < 1e-8
    assert "the core's own runs, because the independent reference has no" in found.method
    bilateral = of_any_contact(replace(SCENE, contact="bilateral"), times)
    assert bilateral.method.startswith("SciPy")
    with pytest.raises(RuntimeError, match=r"^reference: .* ended as lost at t = 0\.056"):
        of_any_contact(thrown(), np.array([0.06]))


def test_work_precision_measures_the_error_of_the_unilateral_motion() -> None:
    found = sp.work_precision(
        SCENE, methods=("rk4", "dop853"), dt=[2e-4, 1e-4], tolerances=[1e-7], progress=False
    )
    assert {row.formulation for row in found.rows} == {"csm", "projected"}
    assert "the core's own runs" in found.reference
    exact = sp.simulate(SCENE, dt=2e-5, method="dop853", formulation="projected")
    for row in found.rows:
        assert row.status == "completed"
        run = sp.simulate(
            SCENE, method=row.method, formulation=row.formulation, **{row.setting: row.value}
        )
        size = np.abs(exact.q).max(axis=0)
        error = float((np.abs(run.q[-1] - exact.q[-1]) / size).max())
        assert row.end["q"] == pytest.approx(error, rel=0.05, abs=1e-10)
        # Along the run too: across the opening, the impact and the slip.
        assert row.along < (1e-4 if row.method == "rk4" else 1e-5)
        # A free tip is no drift.
        assert row.holonomic < 1e-7 and row.nonholonomic < 1e-4


def test_gains_of_a_grasp_that_opens() -> None:
    found = sp.stabilization_sweep(SCENE, products=[1e-3, 0.1])
    assert found.status == ("completed", "completed")
    assert found.error.max() < 1e-4 and found.without["q and p"] < 1e-4
    assert found.holonomic.max() < 1e-6 and found.without["holonomic"] < 1e-12


def test_the_longest_stable_step_is_that_of_a_free_surface() -> None:
    found = sp.max_stable_dt(light(SCENE))
    # RK4 is stable for real rates to -2.785; the left tip opens at 20 ms, and the spring of what
    # is left of its compression slows its decay at c / m by a percent.
    assert found.predicted == pytest.approx(2.785e-4, rel=0.02)
    assert (found.rate, found.mode) == (pytest.approx(-1e4, rel=0.02), "d_n2")
    assert 0.02 <= found.t < 0.024
    assert found.measured is not None and found.measured > 0.9 * found.predicted
    held = sp.max_stable_dt(light(gripped()), measure=False)
    both = sp.max_stable_dt(light(replace(gripped(), contact="bilateral")), measure=False)
    # While both tips stick the motion is the bilateral one.
    assert held.predicted == pytest.approx(both.predicted, rel=1e-3) and held.mode == both.mode


def decay(mass: float, viscosity: float, stiffness: float) -> list[complex]:
    """The rates of a surface that moves by itself."""
    return np.roots([mass, viscosity, stiffness]).tolist()


def test_rows_have_the_rates_of_their_modes() -> None:
    run = sp.simulate(light(thrown()), formulation="projected", record=("state", "contact"))
    found = along_run(run, "projected", sp.Stabilization())
    rows = np.searchsorted(run.t, found.t)
    modes = run.contact[rows]
    free = modes == sp.ContactMode.FREE
    assert (modes == sp.ContactMode.STICK).all(axis=1).any() and free.any()
    modulus = run.scene.hand.tips[0].youngs_modulus
    for k, tip in zip(*np.nonzero(free), strict=True):
        # The second derivative of (5) by d_n, but for the frozen tilt, which is small here.
        stiffness = 2.0 * np.pi * modulus * run.q[rows[k], 5 + tip]
        fastest = min(decay(0.01, 100.0, stiffness), key=lambda rate: rate.real)
        assert np.abs(found.rates[k] - fastest).min() < 0.02 * abs(fastest)


@pytest.mark.parametrize("seed", [1, 2, 3, 6])
def test_the_predicted_step_is_the_measured_one_while_tips_slip(seed: int) -> None:
    scene = random_pinch(np.random.default_rng(seed), "unilateral", 0.05)
    scene = replace(scene, friction=0.05, disturbances=())
    with warnings.catch_warnings(action="ignore", category=sp.SuspiciousValueWarning):
        found = sp.max_stable_dt(scene)
        run = sp.simulate(scene, record=("contact",))
    assert (run.contact == sp.ContactMode.SLIP).any(axis=1).mean() > 0.3
    assert found.measured == pytest.approx(found.predicted, rel=0.1), found.message


@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize(("viscosity", "mass"), [(1e3, 0.01), (5.0, 1e-4), (0.0, 1e-4)])
def test_the_longest_stable_step_of_a_grasp_that_slips(
    viscosity: float, mass: float, formulation: str
) -> None:
    tip = sp.Fingertip(tangential_viscosity=viscosity, tangential_mass=mass)
    scene = sp.Scene(hand=sp.Hand(tip=tip), contact="unilateral", friction=0.01, duration=0.03)
    how: dict[str, Any] = {"formulation": formulation}
    found = sp.max_stable_dt(scene, measure=False, **how)
    assert found.mode in ("d_t1", "d_t2")
    exact = sp.simulate(scene, method="radau5", tolerance=1e-8, record=("state", "contact"), **how)
    assert (exact.contact[1:-1] == sp.ContactMode.SLIP).mean() > 0.5

    def ends_well(dt: float) -> bool:
        run = sp.simulate(scene, dt=dt, **how)
        if run.status != exact.status:
            return False
        largest = np.abs(exact.q[:, 7:]).max(axis=0)
        near = np.abs(run.q[-1, 7:] - exact.q[-1, 7:]) < 0.5 * largest
        return bool(near.all() and (np.abs(run.q[:, 7:]) < 1.5 * largest).all())

    assert ends_well(0.95 * found.predicted)
    assert not ends_well(2.0 * found.predicted)


def test_a_grasp_at_rest_is_displaced_on_its_constraints() -> None:
    rest = sp.simulate(gripped(duration=3.0), formulation="projected", dt=1e-3, method="radau5")
    state = replace(rest.state(-1), grid=None, linearized=None)
    scene = gripped(initial=state, duration=0.05)
    for formulation in ("csm", "projected"):
        trial = Options.checked(formulation=formulation)
        nudged = StepSearch(sp.simulate(scene), trial, 1e-3).scene
        assert nudged.start() != state
        moved = sp.simulate(nudged, dt=1e-3, method="radau5", formulation=formulation)
        assert not moved.violations and not moved.contact_changes
        found = sp.max_stable_dt(scene, formulation=formulation)
        assert found.measured == pytest.approx(found.predicted, rel=0.1), found.message


def test_maps_have_the_unilateral_runs_and_their_starts() -> None:
    run = sp.simulate(thrown(), formulation="projected")
    opened = int(np.searchsorted(run.t, run.violations["opened"])) + 5
    state = replace(run.state(opened), grid=None)
    assert state.contact is not None and state.contact[1] == 0
    left = thrown(initial=state)

    def scene(height: float) -> sp.Scene:
        grasped = replace(left.grasped, height=height)
        return replace(left, grasped=grasped, duration=float(0.055 - run.t[opened]))

    found = sp.stability_map(left, scene, [0.03, 0.049], dt=[2e-5, 1e-4], progress=False)
    assert len(found.pairs) == 10 and {pair[0] for pair in found.pairs} == {"csm", "projected"}
    assert found.expected.tolist() == ["lost", "completed"]
    assert found.agrees.all()
    exact = sp.simulate(scene(0.049), dt=1e-5, method="dop853", formulation="projected")
    for k, (formulation, method) in enumerate(found.pairs):
        alone = sp.simulate(scene(0.049), dt=1e-4, method=method, formulation=formulation)
        sizes = np.abs(exact.q).max(axis=0), np.abs(exact.p).max(axis=0)
        apart = max(
            float((np.abs(alone.q[-1] - exact.q[-1]) / sizes[0]).max()),
            float((np.abs(alone.p[-1] - exact.p[-1]) / sizes[1]).max()),
        )
        assert found.error[k, 1, 1] == pytest.approx(apart, rel=0.1, abs=1e-9)


def test_advice_for_a_grasp_that_opens() -> None:
    found = sp.advise(SCENE, 1e-5, methods=("rk4", "dop853"))
    assert found.met and found.confirmed < 1e-5
    assert {trial.formulation for trial in found.trials} == {"csm", "projected"}
    run = found.simulate(record=("state",))
    exact = sp.simulate(SCENE, tolerance=1e-12, method="dop853", formulation="projected")
    assert (np.abs(run.q[-1] - exact.q[-1]) / np.abs(exact.q).max(axis=0)).max() < 1e-5


def test_advice_for_an_object_that_is_lost() -> None:
    found = sp.advise(thrown(), 1e-4, methods="rk4", formulations="csm")
    assert found.met, found.message
    assert found.simulate().status == "lost"
