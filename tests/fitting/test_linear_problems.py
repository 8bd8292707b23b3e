"""Fits of motions that are linear in the numbers, where least squares has closed forms.

The simulation alone is replaced: search, noise, intervals and profiles are the package's.
"""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import curve_fit, least_squares, lsq_linear
from scipy.stats import norm, t

import softpinch as sp
from measured_motions import DT, SCENE, TIMES
from softpinch.fitting.experiment import Experiment, Motion
from softpinch.fitting.result import correlations

X, Y = "disturbances.0.force.0", "disturbances.0.force.1"
BOUNDS = {X: (-50.0, 50.0), Y: (-50.0, 50.0)}
TRUTH = np.array([7.0, -11.0])
NOISE = 0.3


def design(times: Any) -> np.ndarray:
    """The derivatives of what is measured by both numbers (n, 2)."""
    return np.column_stack([np.cos(40.0 * times), 0.3 + 10.0 * times])


def draws(seed: int, times: Any = TIMES) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0.0, NOISE, len(times))
    return np.asarray(design(times) @ TRUTH + noise)


@pytest.fixture(autouse=True)
def linear(monkeypatch: pytest.MonkeyPatch) -> None:
    def simulated(self: Experiment, given: Any, _: Any, derivatives: bool, *__: Any) -> Motion:
        a = design(self.times)[:, : len(given)]
        rest = design(self.times)[:, len(given) :] @ TRUTH[len(given) :]
        table = a @ np.array(list(given.values())) + rest
        return Motion(table[:, None], a[:, None, :] if derivatives else None, {})

    monkeypatch.setattr(Experiment, "simulated", simulated)


def fit(data: np.ndarray, times: Any = TIMES, **how: Any) -> sp.Fit:
    given = {"vary": BOUNDS, "dt": DT, "progress": False, **how}
    return sp.fit(SCENE, times, {"y": data}, **given)


@pytest.mark.parametrize("known", [True, False], ids=["known noise", "estimated noise"])
def test_estimates_and_covariance_are_those_of_curve_fit(known: bool) -> None:
    data = draws(1)
    found = fit(data, noise=NOISE if known else None)
    best, covariance = curve_fit(
        lambda times, x, y: design(times) @ [x, y],
        TIMES,
        data,
        sigma=np.full(len(TIMES), NOISE),
        absolute_sigma=known,
    )
    assert found.converged and not found.undetermined
    np.testing.assert_allclose(list(found.values.values()), best, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-5)
    np.testing.assert_allclose(found.correlations, correlations(covariance), rtol=1e-5, atol=1e-12)
    left = data - design(TIMES) @ best
    np.testing.assert_allclose(found.residuals["y"], left, atol=1e-5)
    quantile = norm.ppf(0.975) if known else t.ppf(0.975, len(TIMES) - 2)
    for path, value, error in zip(BOUNDS, best, np.sqrt(np.diag(covariance)), strict=True):
        ends = value - quantile * error, value + quantile * error
        assert found.intervals[path] == pytest.approx(ends, rel=1e-5)


def test_a_profile_is_the_parabola_of_the_sum_of_squares() -> None:
    found = fit(draws(2), noise=NOISE)
    for path in BOUNDS:
        profile = found.profile(path, 0.9)
        assert profile.closed == (True, True)
        assert profile.interval == pytest.approx(found.confidence(0.9)[path], rel=1e-4)
        away = (profile.values - found.values[path]) / found.standard_errors[path]
        np.testing.assert_allclose(profile.increase, away**2, rtol=1e-4, atol=1e-6)
        assert profile.limit == pytest.approx(norm.ppf(0.95) ** 2, rel=1e-9)


def test_a_robust_loss_has_scipys_minimum_and_hubers_errors() -> None:
    data = draws(3)
    data[[4, 20]] += 40.0 * NOISE
    found = fit(data, noise=NOISE, loss="soft_l1")
    a = design(TIMES) / NOISE

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.asarray(a @ x - data / NOISE)

    best = least_squares(residuals, np.zeros(2), loss="soft_l1", xtol=1e-12, ftol=1e-12)
    errors = np.array(list(found.standard_errors.values()))
    off = np.array(list(found.values.values())) - best.x
    assert np.abs(off / errors).max() < 1e-3
    left = a @ best.x - data / NOISE
    root = np.sqrt(1.0 + left**2)
    factor = np.mean((left / root) ** 2) / np.mean(root**-3) ** 2
    covariance = factor * np.linalg.inv(a.T @ a)
    np.testing.assert_allclose(errors, np.sqrt(np.diag(covariance)), rtol=1e-3)
    assert np.abs(best.x - TRUTH).max() < 5.0 * errors.max()


def test_bounds_hold_as_in_a_constrained_linear_problem() -> None:
    data, bounds = draws(5), {X: (-50.0, 5.0), Y: (-50.0, 50.0)}
    found = fit(data, vary=bounds, noise=NOISE)
    best = lsq_linear(design(TIMES), data, bounds=([-50.0, -50.0], [5.0, 50.0]))
    np.testing.assert_allclose(list(found.values.values()), best.x, rtol=1e-4)
    assert found.at_bound == (X,)


def test_two_numbers_that_act_alike_are_not_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    """The data feel x + 2 y: with y fixed, its error is that of x."""
    monkeypatch.setattr(
        f"{__name__}.design", lambda times: np.outer(np.cos(40.0 * times), [1.0, 2.0])
    )
    found = fit(draws(6), noise=NOISE)
    assert found.standard_errors == {X: np.inf, Y: np.inf}
    assert found.intervals == BOUNDS
    (sentence,) = found.undetermined
    assert f"{X} and {Y} separately" in sentence
    np.testing.assert_allclose(np.abs(found.directions[1]), [0.8**0.5, 0.2**0.5], rtol=1e-6)
    together = found.values[X] + 2.0 * found.values[Y]
    alone = fit(draws(6), vary={X: (-50.0, 50.0)}, noise=NOISE)
    assert together == pytest.approx(alone.values[X] + 2.0 * TRUTH[1], rel=1e-6)
    assert not alone.undetermined
    expected = NOISE / np.linalg.norm(np.cos(40.0 * TIMES))
    assert alone.standard_errors[X] == pytest.approx(expected, rel=1e-6)


def test_an_interval_as_wide_as_the_bounds_determines_nothing() -> None:
    """The error of x is 0.06, so that 3.9 of them are 0.25."""
    for width, determined in ((0.2, False), (0.3, True)):
        bounds = {X: (TRUTH[0] - 0.5 * width, TRUTH[0] + 0.5 * width)}
        found = fit(design(TIMES) @ TRUTH, vary=bounds, noise=NOISE)
        error = NOISE / np.linalg.norm(design(TIMES)[:, 0])
        assert 0.2 < 2.0 * norm.ppf(0.975) * error < 0.3
        assert np.isfinite(found.standard_errors[X]) == determined
        assert bool(found.undetermined) != determined


@pytest.mark.parametrize("share", [1.0, 0.3], ids=["right noise", "too small a noise"])
def test_a_robust_loss_has_right_errors_without_outliers(share: float) -> None:
    """Over 200 fits the spread of the estimates is the standard error, whatever noise is given."""
    estimates, errors = [], []
    for seed in range(200):
        found = fit(draws(seed), noise=share * NOISE, loss="soft_l1")
        estimates.append(list(found.values.values()))
        errors.append(list(found.standard_errors.values()))
    spread = np.std(estimates, axis=0)
    np.testing.assert_allclose(spread, np.sqrt(np.mean(np.square(errors), axis=0)), rtol=0.2)
