"""The constraints in each formulation, and that all formulations give the same physics."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from scenes import pushed
from softpinch import _core, strategies

EVERYTHING = ("state", "multipliers", "residuals", "energy")
EXACT = [name for name in _core.FORMULATIONS if name != "csm"]


@pytest.mark.parametrize("formulation", EXACT)
@given(scene=strategies.scenes(duration=0.05))
def test_the_exact_formulations_do_not_drift(formulation: str, scene: sp.Scene) -> None:
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
def test_a_csm_run_goes_on_with_the_exact_formulations(formulation: str) -> None:
    grasp = sp.simulate(sp.Scene(duration=0.5)).state(-1)
    scene = sp.Scene(initial=grasp, duration=0.1)
    csm = sp.simulate(scene, dt=5e-5)
    other = sp.simulate(scene, dt=5e-5, formulation=formulation)
    np.testing.assert_allclose(other.q[-1], csm.q[-1], rtol=0, atol=1e-9)


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


# Residuals that start off zero decay as the exact solutions of (19) and (20).


gains = st.floats(100.0, 2000.0)
offsets = st.floats(-1.0, 1.0)


@given(gains, gains, st.tuples(*[offsets] * 4), st.tuples(*[offsets] * 4))
def test_residuals_decay_as_the_stabilisation_says(
    alpha: float, beta: float, place: tuple[float, ...], speed: tuple[float, ...]
) -> None:
    scene = sp.Scene(duration=0.02)
    pressed = sp.State.consistent(scene, fingers=np.deg2rad([6.0, 6.0]))
    q, p = np.array(pressed.q), np.array(pressed.p)
    q[[0, 1, 5, 6]] += 1e-5 * np.array(place)
    p[5:9] += 1e-3 * np.array(speed)
    scene = sp.Scene(duration=0.02, initial=sp.State(q, p, check=False))
    stabilization = sp.Stabilization(alpha=alpha, beta=beta)
    start = sp.evaluate(scene, 0.0, q, p)
    run = sp.simulate(scene, dt=2e-5, record=("residuals",), stabilization=stabilization)
    t = run.t[:, None]
    c, rate = start.residuals[:2], start.residual_rates
    holonomic = (c + (rate + alpha * c) * t) * np.exp(-alpha * t)
    nonholonomic = start.residuals[2:] * np.exp(-beta * t)
    scale_h = np.abs(holonomic).max() + 1e-9
    scale_n = np.abs(nonholonomic).max() + 1e-6
    assert np.abs(run.residuals[:, :2] - holonomic).max() <= 1e-4 * scale_h
    assert np.abs(run.residuals[:, 2:] - nonholonomic).max() <= 1e-4 * scale_n


def test_a_start_off_the_constraints_needs_to_be_asked_for() -> None:
    scene = sp.Scene(duration=0.01)
    q = np.array(sp.State.consistent(scene).q)
    q[5] += 1e-4
    with pytest.raises(ValueError, match=r"inconsistent.*C_1\^H = 1\.000e-4 m.*check=False"):
        sp.simulate(sp.Scene(duration=0.01, initial=sp.State(q, np.zeros(9))))
    p = np.zeros(9)
    p[7] = 1e-3
    q[5] -= 1e-4
    with pytest.raises(ValueError, match=r"C_1\^N"):
        sp.simulate(sp.Scene(duration=0.01, initial=sp.State(q, p)))


def test_the_advised_dt_is_where_the_method_turns_stable() -> None:
    """The limit is RK4's, and it is sharp: below it residuals die out, above they grow."""
    scene = sp.Scene(duration=0.05)
    pressed = sp.State.consistent(scene, fingers=np.deg2rad([6.0, 6.0]))
    p = np.array(pressed.p)
    p[7:9] += 1e-6
    scene = sp.Scene(duration=0.05, initial=sp.State(pressed.q, p, check=False))
    beta = 1e5

    def final(dt: float) -> float:
        run = sp.simulate(
            scene, dt=dt, record=("residuals",), stabilization=sp.Stabilization(beta=beta)
        )
        return float(np.abs(run.residuals[-1, 2:]).max())

    assert final(0.97 * 2.7853 / beta) < 1e-7
    with pytest.warns(sp.StabilityWarning, match=r"beta \* dt = 2\.8.*, or beta <="):
        assert final(1.03 * 2.7853 / beta) > 1e-5
