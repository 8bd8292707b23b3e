"""Intervals cover the truth, outliers are survived, and what the data leave open is said."""

from collections.abc import Iterator
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


def fits(count: int, noise: float | None) -> Iterator[sp.Fit]:
    """From the truth, of few measurements: Student's intervals are far wider than normal ones."""
    rng, size = np.random.default_rng(42), 2e-5
    scene, times = changed(SCENE, TRUTH), np.linspace(0.01, 0.06, 6)
    exact = columns(sp.simulate(scene, 5e-4), "rotation", times=times)["rotation"]
    for _ in range(count):
        data = {"rotation": exact + rng.normal(0.0, size, len(times))}
        yield sp.fit(scene, times, data, BOUNDS, dt=5e-4, noise=noise and size)


def coverage(count: int, noise: float | None) -> dict[str, float]:
    inside = dict.fromkeys(TRUTH, 0)
    for fit in fits(count, noise):
        for path, (low, high) in fit.intervals.items():
            inside[path] += low <= TRUTH[path] <= high
    return {path: found / count for path, found in inside.items()}


@pytest.mark.parametrize("noise", [1.0, None], ids=["known noise", "estimated noise"])
def test_intervals_cover_the_truth(noise: float | None) -> None:
    """Of 200 fits 190 do, give or take 3; six of these deviations are allowed to one side."""
    for path, share in coverage(200, noise).items():
        assert 0.90 <= share <= 0.99, path


@pytest.mark.slow
@pytest.mark.parametrize("noise", [1.0, None], ids=["known noise", "estimated noise"])
def test_intervals_cover_the_truth_in_95_of_100(noise: float | None) -> None:
    for path, share in coverage(2000, noise).items():
        assert 0.93 <= share <= 0.97, path


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


@pytest.mark.parametrize("share", [1.0, 0.3], ids=["right noise", "too small a noise"])
def test_a_robust_loss_has_right_errors_without_outliers(share: float) -> None:
    """Over 100 fits the spread of the estimates is the standard error, whatever noise is given."""
    rng, scene, times = np.random.default_rng(1), changed(SCENE, TRUTH), TIMES[:26:2]
    exact = columns(sp.simulate(scene, 5e-4), "rotation", times=times)["rotation"]
    found, errors = [], []
    for _ in range(100):
        data = {"rotation": exact + rng.normal(0.0, 5e-6, len(times))}
        fit = sp.fit(scene, times, data, {E: (1e4, 1e7)}, dt=5e-4, noise=share * 5e-6,
                     loss="soft_l1")  # fmt: skip
        found.append(fit.values[E])
        errors.append(fit.standard_errors[E])
    assert np.std(found) == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=0.25)


def test_a_number_that_the_data_do_not_feel_is_said() -> None:
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


def test_numbers_that_only_act_together_are_named_together() -> None:
    """Two forces at the same time: the data feel their sum."""
    twice = [sp.Step(time=0.03, force=(2.0, -4.0)), sp.Step(time=0.03, force=(2.0, -4.0))]
    scene = replace(SCENE, disturbances=twice)
    first, second = (f"disturbances.{k}.force.1" for k in (0, 1))
    rng = np.random.default_rng(3)
    data = columns(motion(scene), "y")["y"]
    data = {"y": data + rng.normal(0.0, 2e-6, len(TIMES))}
    vary = {E: (1e5, 1e6), first: (-50.0, 50.0), second: (-50.0, 50.0)}
    fit = sp.fit(scene, TIMES, data, vary, dt=DT, noise=2e-6)
    (sentence,) = fit.undetermined
    assert f"{first} and {second} separately" in sentence and E not in sentence
    assert f"{first} +10 N and {second} -10 N together" in sentence or (
        f"{first} -10 N and {second} +10 N together" in sentence
    )
    assert np.isfinite(fit.standard_errors[E])
    assert fit.intervals[first] == (-50.0, 50.0) == fit.intervals[second]
    assert fit.correlations[1, 2] == pytest.approx(-1.0, abs=1e-3)
    assert np.abs(fit.directions[-1]) == pytest.approx([0.0, 0.5**0.5, 0.5**0.5], abs=1e-3)
    alone = sp.fit(scene, TIMES, data, {E: (1e5, 1e6), first: (-50.0, 50.0)}, dt=DT, noise=2e-6)
    assert fit.values[first] + fit.values[second] == pytest.approx(
        alone.values[first] - 4.0, rel=1e-4
    )
    assert not alone.undetermined


def test_a_value_at_its_bound_is_said() -> None:
    fit = sp.fit(SCENE, TIMES, columns(motion(), "rotation"), {E: (1e5, 3e5)}, dt=DT, noise=1e-5)
    assert fit.at_bound == (E,) and f"{E} is at its bound" in fit.messages
    assert fit.values[E] == pytest.approx(3e5, rel=1e-5)
    assert any("times as large as the noise that was given" in each for each in fit.messages)


def test_a_profile_is_the_linearised_interval_where_that_is_right() -> None:
    rng = np.random.default_rng(4)
    data = noisy(rng, 2e-6)
    fit = sp.fit(SCENE, TIMES, data, BOUNDS, dt=DT, noise=2e-6)
    for level in (0.5, 0.95):
        for path in TRUTH:
            found = fit.profile(path, level)
            assert found.closed == (True, True)
            low, high = fit.confidence(level)[path]
            width = high - low
            assert found.interval == pytest.approx((low, high), abs=0.03 * width)
            k = int(found.increase.argmin())
            assert found.values[k] == pytest.approx(fit.values[path], rel=1e-9)
            assert (np.diff(found.increase[: k + 1]) < 0).all()
            assert (np.diff(found.increase[k:]) > 0).all()


def test_a_profile_of_a_robust_loss_is_as_wide_as_its_interval() -> None:
    """Also where the noise that is given is too small, which a robust loss corrects."""
    data = noisy(np.random.default_rng(7), 2e-6)
    fit = sp.fit(SCENE, TIMES, data, BOUNDS, dt=DT, noise=7e-7, loss="soft_l1")
    low, high = fit.intervals[E]
    assert fit.profile(E).interval == pytest.approx((low, high), abs=0.1 * (high - low))


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


def test_a_profile_without_end_is_open() -> None:
    late = sp.Step(time=0.09, force=(1.0, 0.0))
    scene = replace(SCENE, disturbances=[late])
    times = TIMES[TIMES < 0.085]
    force = "disturbances.0.force.0"
    data = columns(motion(scene), "y", times=times)
    fit = sp.fit(scene, times, data, {force: (-5.0, 5.0)}, dt=DT, noise=1e-5)
    profile = fit.profile(force)
    assert profile.closed == (False, False)
    assert profile.interval == (-5.0, 5.0)
