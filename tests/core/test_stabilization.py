"""Residuals that start off zero decay as the exact solutions of (19) and (20)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp

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


@pytest.mark.parametrize(("name", "value"), [("alpha", 4e4), ("beta", 4e4)])
def test_a_gain_beyond_the_step_warns_and_says_what_would_do(name: str, value: float) -> None:
    stabilization = sp.Stabilization(**{name: value})
    scene = sp.Scene(duration=0.01)
    with pytest.warns(
        sp.StabilityWarning, match=rf"{name} \* dt = 4.*dt <= 6\.963e-5 s, or {name} <="
    ):
        sp.simulate(scene, dt=1e-4, stabilization=stabilization)


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
    with pytest.warns(sp.StabilityWarning):
        assert final(1.03 * 2.7853 / beta) > 1e-5
