"""Fits of synthetic motions: the truth comes back, errors are right, and gaps are left out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from measured_motions import (
    BOUNDS,
    DT,
    SCENE,
    TIMES,
    TRUTH,
    C,
    E,
    assert_close,
    at,
    changed,
    columns,
    motion,
)

pytest.importorskip("scipy")
from scipy.optimize import curve_fit


@pytest.mark.parametrize("factors", [(10.0, 10.0), (0.1, 10.0), (0.1, 0.1)])
def test_a_start_a_factor_of_ten_off_finds_the_truth(factors: tuple[float, float]) -> None:
    start = {path: by * TRUTH[path] for path, by in zip(TRUTH, factors, strict=True)}
    data = columns(motion(), "rotation", "position")
    fit = sp.fit(SCENE, TIMES, data, BOUNDS, start=start, dt=DT)
    assert fit.converged and not fit.undetermined and not fit.at_bound
    assert_close(fit, TRUTH, 1e-6)
    assert fit.scene == changed(SCENE, fit.values)
    for name, rest in fit.residuals.items():
        assert np.abs(rest).max() < 1e-7 * np.abs(data[name]).max()


@pytest.mark.parametrize("factors", [(0.1, 0.1), (0.3, 10.0), (10.0, 3.0)])
def test_a_start_at_a_bound_moves_away(factors: tuple[float, float]) -> None:
    """The size of SciPy's first trust region is that of the start, which is tiny beside zero."""
    bounds = {path: (0.1 * value, 10.0 * value) for path, value in TRUTH.items()}
    start = {path: by * TRUTH[path] for path, by in zip(TRUTH, factors, strict=True)}
    fit = sp.fit(SCENE, TIMES, columns(motion(), "rotation"), bounds, start=start, dt=DT)
    assert fit.converged and not fit.at_bound
    assert_close(fit, TRUTH, 1e-6)


def test_a_search_that_takes_too_many_evaluations_ends_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("softpinch.fitting.problem.MOST_EVALUATIONS", 3)
    start = {path: 10.0 * value for path, value in TRUTH.items()}
    fit = sp.fit(SCENE, TIMES, columns(motion(), "rotation"), BOUNDS, start=start, dt=DT)
    assert not fit.converged and "the search did not converge" in fit.messages


@pytest.mark.parametrize("name", ["q", "p", "multipliers", "torque", "pose", "lambda_1N", "x"])
def test_every_observable_leads_to_the_truth(name: str) -> None:
    start = {E: 2e5, C: 80.0}
    data = columns(motion(), name)
    fit = sp.fit(SCENE, TIMES, data, BOUNDS, start=start, dt=DT, noise=1e-3)
    assert_close(fit, TRUTH, 1e-5)
    assert fit.residuals.keys() == {name}
    assert fit.residuals[name].shape == data[name].shape


def test_methods_formulations_and_tolerances_do_not_matter() -> None:
    """The data are of small steps; each fit is as good as its own simulation."""
    data = columns(motion(), "rotation", "y")
    how: list[dict[str, Any]] = [
        {"dt": DT, "method": "radau5", "formulation": "nullspace"},
        {"tolerance": 1e-9, "method": "dop853", "formulation": "nullspace"},
    ]
    for each in how:
        fit = sp.fit(SCENE, TIMES, data, BOUNDS, start={E: 3e5, C: 50.0}, noise=1e-5, **each)
        assert_close(fit, TRUTH, 1e-4)


def test_errors_are_those_of_curve_fit() -> None:
    """SciPy's own, which differentiates our simulations by differences and knows no scaling."""
    rng = np.random.default_rng(3)
    sizes = np.array([3e-5, 2e-6])
    run = motion()
    rows = at(run)
    data = run.q[rows][:, [2, 1]] + rng.normal(0.0, sizes, (len(TIMES), 2))
    weights = np.repeat(sizes, len(TIMES))

    def model(_: Any, e: float, c: float) -> Any:
        return motion(values={E: 1e5 * e, C: 10.0 * c}).q[rows][:, [2, 1]].T.ravel()

    units = np.array([1e5, 10.0])
    best, covariance = curve_fit(
        model, np.arange(0.0), data.T.ravel(), p0=[4.3, 3.7], sigma=weights,
        absolute_sigma=True, xtol=1e-12, ftol=1e-12, epsfcn=1e-10,
    )  # fmt: skip
    covariance = covariance * np.outer(units, units)
    measured = {"rotation": data[:, 0], "y": data[:, 1]}
    noise = {"rotation": sizes[0], "y": sizes[1]}
    fit = sp.fit(SCENE, TIMES, measured, BOUNDS, dt=DT, noise=noise)
    errors = np.sqrt(np.diag(covariance))
    off = (np.array(list(fit.values.values())) - best * units) / errors
    assert np.abs(off).max() < 1e-3
    assert list(fit.standard_errors.values()) == pytest.approx(errors, rel=1e-3)
    assert fit.covariance == pytest.approx(covariance, rel=1e-2)
    rest = np.concatenate(list(fit.residuals.values())) / weights
    assert fit.chi_squared == pytest.approx(float(rest @ rest), rel=1e-9)


def test_estimated_noise_is_what_was_added() -> None:
    rng = np.random.default_rng(8)
    sizes: dict[str, Any] = {"rotation": 1e-3, "position": np.array([1e-5, 1e-4])}
    data = {
        name: value + rng.normal(0.0, sizes[name], value.shape)
        for name, value in columns(motion(), *sizes).items()
    }
    fit = sp.fit(SCENE, TIMES, data, BOUNDS, dt=DT)
    assert fit.noise_estimated
    assert fit.experiments[0].noise == pytest.approx([1e-3, 1e-5, 1e-4], rel=0.25)
    # By construction.
    assert fit.chi_squared == pytest.approx(fit.degrees_of_freedom, rel=0.02)


def test_missing_measurements_are_left_out() -> None:
    rng = np.random.default_rng(5)
    data = columns(motion(), "rotation", "y")
    data = {name: value + rng.normal(0.0, 1e-5, value.shape) for name, value in data.items()}
    gone = {"rotation": [0, 7, 8], "y": [44, 45]}
    gaps = {name: value.copy() for name, value in data.items()}
    for name, rows in gone.items():
        gaps[name][rows] = np.nan
    fit = sp.fit(SCENE, TIMES, gaps, BOUNDS, dt=DT, noise=1e-5)
    assert fit.degrees_of_freedom == 2 * len(TIMES) - 5 - 2
    for name, rows in gone.items():
        assert np.flatnonzero(np.isnan(fit.residuals[name])).tolist() == rows
    # Rows without any measurement do not matter.
    again = sp.fit(
        SCENE, TIMES[:44], {n: v[:44] for n, v in gaps.items()}, BOUNDS, dt=DT, noise=1e-5
    )
    late = {name: np.where(np.arange(46) < 44, value, np.nan) for name, value in gaps.items()}
    whole = sp.fit(SCENE, TIMES, late, BOUNDS, dt=DT, noise=1e-5)
    assert_close(whole, again.values, 1e-7)
    assert whole.standard_errors == pytest.approx(again.standard_errors, rel=1e-5)


def test_experiments_share_the_numbers() -> None:
    """Two experiments have the information of both: inverse covariances add in the logarithms."""
    other = replace(SCENE, disturbances=[sp.Pulse(time=0.04, duration=0.02, force=(0.0, 9.0))])
    rng = np.random.default_rng(6)
    data = [
        {name: value + rng.normal(0.0, 1e-5, value.shape)
         for name, value in columns(motion(scene), "rotation", "y").items()}
        for scene in (SCENE, other)
    ]  # fmt: skip
    both = sp.fit([SCENE, other], [TIMES, TIMES], data, BOUNDS, dt=DT, noise=1e-5)
    alone = [
        sp.fit(scene, TIMES, each, BOUNDS, dt=DT, noise=1e-5)
        for scene, each in zip((SCENE, other), data, strict=True)
    ]
    information = sum(np.linalg.inv(fit.covariance) for fit in alone)
    assert np.linalg.inv(both.covariance) == pytest.approx(information, rel=0.03)
    assert both.scenes == tuple(changed(scene, both.values) for scene in (SCENE, other))
    for name in ("scene", "residuals"):
        with pytest.raises(ValueError, match=rf"^Fit.{name}: there are 2 experiments; take Fit\."):
            getattr(both, name)
    sizes = [abs(both.values[E] - fit.values[E]) / fit.standard_errors[E] for fit in alone]
    assert max(sizes) < 4.0


def test_multistart_leaves_a_poor_start() -> None:
    """Sines of two frequencies agree nowhere, so that the search for one stays beside its start."""
    scene = replace(SCENE, disturbances=[sp.Sine(frequency_hz=60.0, force=(0.0, 3.0))])
    path = "disturbances.0.frequency_hz"
    data = columns(motion(scene, {}), "y")
    given: dict[str, Any] = {"vary": {path: (20.0, 150.0)}, "start": {path: 120.0}, "dt": DT}
    stuck = sp.fit(scene, TIMES, data, **given)
    assert abs(stuck.values[path] - 60.0) > 10.0
    fits = [sp.fit(scene, TIMES, data, **given, multistart=12, seed=2) for _ in "ab"]
    assert fits[0] == fits[1]
    assert 2 <= fits[0].starts <= 13 and 1 <= fits[0].same_minimum < fits[0].starts
    assert fits[0].values[path] == pytest.approx(60.0, rel=1e-6)
    ended = f"{fits[0].same_minimum} of {fits[0].starts} starts ended in this minimum"
    assert fits[0].messages == (ended,)


def test_progress_counts_up_to_the_largest_number() -> None:
    seen: list[tuple[int, int]] = []
    sp.fit(SCENE, TIMES, columns(motion(), "rotation"), {E: (1e5, 1e6)}, dt=DT,
           progress=lambda done, most: seen.append((done, most)))  # fmt: skip
    done, most = zip(*seen, strict=True)
    assert len(set(most)) == 1 and list(done) == sorted(done) and done[-1] == most[-1]
