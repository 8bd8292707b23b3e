"""Intervals cover the truth, outliers are survived, and what the data leave open is said."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp
from measured_motions import BOUNDS, DT, SCENE, TIMES, TRUTH, E, columns, motion

pytest.importorskip("scipy")


@pytest.fixture(autouse=True)
def unwarned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether a scene's numbers are usual, for which a fifth of a fit's time goes, is not asked."""
    monkeypatch.setattr("softpinch.scene.usual.warn", lambda scene: None)


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
