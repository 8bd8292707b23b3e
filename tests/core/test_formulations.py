"""What each formulation promises of the constraints, and that all give the same physics."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import softpinch as sp
from scenes import SCENES, pushed
from softpinch import _core, paper, strategies

EVERYTHING = ("state", "multipliers", "residuals", "energy")
EXACT = [name for name in _core.FORMULATIONS if name != "csm"]


@pytest.mark.parametrize("formulation", EXACT)
@given(scene=strategies.scenes(duration=0.05))
def test_no_drift(formulation: str, scene: sp.Scene) -> None:
    run = sp.simulate(scene, dt=3e-4, formulation=formulation, record=EVERYTHING)
    size = np.abs(run.q[:, [0, 1]]).max() + 0.1
    speed = np.abs(run.p).max() + 1e-3
    assert np.abs(run.residuals[:, :2]).max() <= 1e-14 * size
    assert np.abs(run.residuals[:, 2:]).max() <= 1e-12 * speed
    rates = [
        sp.evaluate(scene, t, q, p).residual_rates
        for t, q, p in zip(run.t[::40], run.q[::40], run.p[::40], strict=True)
    ]
    assert np.abs(rates).max() <= 1e-12 * speed


@pytest.mark.parametrize("formulation", EXACT)
def test_only_csm_starts_off_the_constraints(formulation: str) -> None:
    start = sp.State.consistent(sp.Scene(), fingers=np.deg2rad([6, 6]))
    q = np.array(start.q)
    q[5] += 1e-4
    scene = sp.Scene(initial=sp.State(q, start.p, check=False), duration=0.01)
    assert sp.simulate(scene).success
    with pytest.raises(ValueError, match="inconsistent"):
        sp.simulate(scene, formulation=formulation)


@pytest.mark.parametrize("formulation", EXACT)
def test_they_go_on_from_a_csm_run(formulation: str) -> None:
    grasp = sp.simulate(sp.Scene(duration=0.5)).state(-1)
    scene = sp.Scene(initial=grasp, duration=0.1)
    csm = sp.simulate(scene, dt=5e-5)
    other = sp.simulate(scene, dt=5e-5, formulation=formulation)
    np.testing.assert_allclose(other.q[-1], csm.q[-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("formulation", EXACT)
@pytest.mark.parametrize("case", ["i", "ii", "iii", "iv"])
def test_the_same_physics(formulation: str, case: str) -> None:
    scene = paper.disturbance(case)
    csm = sp.simulate(scene, record=EVERYTHING)
    other = sp.simulate(scene, formulation=formulation, record=EVERYTHING)
    assert other.status == csm.status
    assert other.violations == csm.violations
    np.testing.assert_allclose(other.q[-1], csm.q[-1], rtol=0, atol=1e-7)
    force = np.abs(csm.multipliers).max()
    np.testing.assert_allclose(other.multipliers, csm.multipliers, rtol=0, atol=1e-4 * force)


def test_a_lost_grasp_is_lost_in_each() -> None:
    scene = replace(
        paper.disturbance("i"),
        disturbances=[sp.Step(time=1.0, force=(130.0, 130.0), moment=0.0)],
    )
    ends = {name: sp.simulate(scene, formulation=name) for name in _core.FORMULATIONS}
    assert {run.status for run in ends.values()} == {"separated"}
    assert len({run.t[-1] for run in ends.values()}) == 1


@pytest.mark.parametrize("formulation", EXACT)
@pytest.mark.parametrize("name", SCENES)
def test_the_ledger_closes_in_each(formulation: str, name: str) -> None:
    scene = SCENES[name]
    gaps = []
    for dt in (1e-4, 5e-5):
        run = sp.simulate(scene, dt=dt, formulation=formulation, record=("energy",))
        gaps.append(np.abs(run.energy.closure).max() / run.energy.exchanged)
    assert gaps[1] <= max(gaps[0] / 8, 1e-11), gaps


def test_the_null_space_needs_no_work_of_the_constraints() -> None:
    energy = sp.simulate(pushed(), formulation="nullspace", record=("energy",)).energy
    assert np.abs(energy.constraint_work).max() <= 1e-15


def test_a_projection_does_work_that_shows_and_vanishes_with_dt() -> None:
    works = [
        np.abs(
            sp.simulate(
                pushed(), dt=dt, formulation="projected", record=("energy",)
            ).energy.constraint_work
        ).max()
        for dt in (4e-4, 2e-4, 1e-4)
    ]
    assert works[0] > 1e-12
    assert works[1] < works[0] / 8
    assert works[2] < works[1] / 8


@pytest.mark.parametrize("formulation", EXACT)
def test_evaluate_gives_the_accelerations_without_stabilisation(formulation: str) -> None:
    scene = pushed()
    state = sp.State.consistent(
        scene, fingers=np.deg2rad([6, 5]), rotation=0.1, velocity=(0.1, 0.2, 1.0)
    )
    q = np.array(state.q)
    plain = sp.evaluate(scene, 0.03, q, state.p, formulation=formulation)
    bare = sp.evaluate(scene, 0.03, q, state.p, stabilization=sp.Stabilization(alpha=0.0, beta=0.0))
    np.testing.assert_array_equal(plain.accelerations, bare.accelerations)
    # And the run's own multipliers are these.
    run = sp.simulate(
        replace(scene, initial=replace(state, time=0.03), duration=0.01),
        formulation=formulation,
        record=("multipliers",),
    )
    np.testing.assert_allclose(run.multipliers[0], plain.multipliers, rtol=1e-11)
