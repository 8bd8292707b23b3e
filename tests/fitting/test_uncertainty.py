"""Intervals cover the truth, outliers are survived, and what the data leave open is said."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp
from measured_motions import BOUNDS, DT, SCENE, TIMES, TRUTH, C, E, changed, columns, motion

pytest.importorskip("scipy")
FORCE = "disturbances.0.force.0"


@pytest.fixture(autouse=True)
def unwarned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether a scene's numbers are usual, for which a fifth of a fit's time goes, is not asked."""
    monkeypatch.setattr("softpinch.scene.usual.warn", lambda scene: None)


def noisy(rng: np.random.Generator, noise: float) -> dict[str, np.ndarray]:
    return {
        name: value + rng.normal(0.0, noise, value.shape)
        for name, value in columns(motion(), "rotation", "y").items()
    }


def with_outliers(seed: int) -> dict[str, np.ndarray]:
    """5 % of the measurements are off by up to a hundred standard deviations, to one side."""
    rng = np.random.default_rng(seed)
    data = noisy(rng, 2e-5)
    for value in data.values():
        value[rng.choice(len(value), 3)] += rng.uniform(1e-3, 2e-3, 3)
    return data


@pytest.mark.parametrize("noise", [2e-5, None], ids=["known noise", "estimated noise"])
def test_a_robust_loss_survives_outliers(noise: float | None) -> None:
    """Its errors stay below twice those without outliers, and cover the truth."""
    clean = sp.fit(SCENE, TIMES, noisy(np.random.default_rng(0), 2e-5), BOUNDS, dt=DT, noise=2e-5)
    off, spoilt = [], []
    for seed in range(4):
        data = with_outliers(seed)
        robust = sp.fit(SCENE, TIMES, data, BOUNDS, dt=DT, noise=noise, loss="soft_l1")
        plain = sp.fit(SCENE, TIMES, data, BOUNDS, dt=DT, noise=noise)
        for path, truth in TRUTH.items():
            error = robust.standard_errors[path]
            assert error < 2.0 * clean.standard_errors[path]
            off.append(abs(robust.values[path] - truth) / error)
            spoilt.append(abs(plain.values[path] - truth) / clean.standard_errors[path])
    assert max(off) < 4.0 and np.sqrt(np.mean(np.square(off))) < 2.0
    assert max(spoilt) > 10.0


def test_a_number_without_effect_on_the_data_is_not_determined() -> None:
    """A push after the last measurement, whose force is a parameter."""
    late = sp.Step(time=0.09, force=(1.0, 0.0))
    scene = replace(SCENE, disturbances=[*SCENE.disturbances, late])
    times = TIMES[TIMES < 0.085]
    force = "disturbances.1.force.0"
    rng = np.random.default_rng(2)
    data = columns(motion(scene), "rotation", times=times)["rotation"]
    data = {"rotation": data + rng.normal(0.0, 2e-6, len(times))}
    fit = sp.fit(scene, times, data, BOUNDS | {force: (-5.0, 5.0)}, dt=DT, noise=2e-6)
    assert fit.standard_errors[force] == np.inf and fit.intervals[force] == (-5.0, 5.0)
    (sentence,) = fit.undetermined
    assert sentence.startswith(f"the data do not determine {force}: its whole range, -5 to 5 N,")
    assert sentence in repr(fit) and sentence in fit.messages
    assert "not determined within -5 to 5 N" in repr(fit)
    assert fit.covariance[2, 2] == np.inf and np.isnan(fit.covariance[2, :2]).all()
    # The others are what they are without it.
    alone = sp.fit(scene, times, data, BOUNDS, dt=DT, noise=2e-6)
    for path in TRUTH:
        assert fit.values[path] == pytest.approx(alone.values[path], rel=1e-5)
        assert fit.standard_errors[path] == pytest.approx(alone.standard_errors[path], rel=1e-4)
    unbounded = sp.fit(scene, times, data, {force: None}, dt=DT)
    assert unbounded.intervals[force] == (-np.inf, np.inf)
    assert "a change by 1 N" in unbounded.undetermined[0]
    profile = sp.fit(scene, times, data, {force: (-5.0, 5.0)}, dt=DT, noise=2e-6).profile(force)
    assert profile.closed == (False, False) and profile.interval == (-5.0, 5.0)


def test_a_value_at_its_bound_is_named() -> None:
    fit = sp.fit(SCENE, TIMES, columns(motion(), "rotation"), {E: (1e5, 3e5)}, dt=DT, noise=1e-5)
    assert fit.at_bound == (E,) and f"{E} is at its bound" in fit.messages
    assert fit.values[E] == pytest.approx(3e5, rel=1e-5)
    assert any("times as large as the noise that was given" in each for each in fit.messages)


def test_a_profile_is_a_likelihood_ratio() -> None:
    """Beyond linearity: at its ends the sum of squares, fitted anew, exceeds the least by chi^2."""
    rng = np.random.default_rng(5)
    data = {"rotation": noisy(rng, 2e-4)["rotation"]}
    fit = sp.fit(SCENE, TIMES, data, BOUNDS, dt=DT, noise=2e-4)
    profile = fit.profile(E)
    assert profile.limit == pytest.approx(3.841, abs=1e-3)
    for end in profile.interval:
        held = sp.fit(changed(SCENE, {E: end}), TIMES, data, {C: BOUNDS[C]}, dt=DT, noise=2e-4)
        assert held.chi_squared - fit.chi_squared == pytest.approx(3.841, abs=0.02)
