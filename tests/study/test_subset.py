"""Probabilities by subset and importance sampling, beside those that a formula gives."""

import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np
import pytest

pytest.importorskip("scipy")

from softpinch.study.subset import Found, estimate, importance_sampling, subset_simulation

BELOW = NormalDist().cdf


def generator(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.Philox(seed))


def plane(beta: float) -> Callable[[np.ndarray], np.ndarray]:
    """At a distance of beta from the medians: the probability is BELOW(-beta)."""
    return lambda u: beta - u.sum(axis=1) / math.sqrt(u.shape[1])


def opposite(beta: float) -> Callable[[np.ndarray], np.ndarray]:
    """Two ways to the event, with a probability of 2 BELOW(-beta)."""
    return lambda u: beta - np.abs(u[:, 0])


def subset(distance: Callable[..., np.ndarray], d: int, seed: int, size: int = 2000) -> Found:
    return subset_simulation(distance, d, size, 100_000, generator(seed))


@pytest.mark.parametrize("dimensions", [1, 3, 200])
@pytest.mark.parametrize("beta", [0.5, 2.326, 4.753])
def test_a_plane(beta: float, dimensions: int) -> None:
    found = [subset(plane(beta), dimensions, seed) for seed in range(8)]
    values = np.array([one.probability for one in found])
    covs = np.array([one.cov for one in found])
    assert all(one.found and one.levels[-1].threshold == 0.0 for one in found)
    # The mean of eight, within four of its standard errors.
    assert abs(values.mean() / BELOW(-beta) - 1.0) < 4.0 * covs.mean() / math.sqrt(8)
    # The coefficient of variation is that of the values, as far as eight tell.
    assert 0.4 < values.std(ddof=1) / values.mean() / covs.mean() < 2.0


def test_the_levels_multiply_and_count_all_runs() -> None:
    calls = []

    def distance(u: np.ndarray) -> np.ndarray:
        calls.append(len(u))
        return plane(4.0)(u)

    found = subset_simulation(distance, 2, 1000, 10**6, generator(3))
    assert sum(level.runs for level in found.levels) == sum(calls)
    assert found.probability == pytest.approx(math.prod(v.probability for v in found.levels))
    # The levels of a plane are known: the share of each is below its threshold.
    for k, level in enumerate(found.levels):
        share = math.prod(v.probability for v in found.levels[: k + 1])
        assert share == pytest.approx(BELOW(level.threshold - 4.0), rel=1.0)


@pytest.mark.parametrize("probability", [1e-2, 1e-3])
def test_intervals_cover(probability: float) -> None:
    beta = -NormalDist().inv_cdf(probability)
    found = [subset(plane(beta), 4, seed, 1000) for seed in range(200)]
    covered = [one.end(-1.0) <= probability <= one.end(1.0) for one in found]
    # Four standard errors below 95 %.
    assert np.mean(covered) > 0.95 - 4.0 * math.sqrt(0.95 * 0.05 / 200)


def curved(beta: float) -> tuple[Callable[[np.ndarray], np.ndarray], float]:
    """A parabola, and its probability, an integral over the first coordinate."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    probability = weights @ [BELOW(-beta - 0.3 * x * x) for x in nodes] / weights.sum()
    return lambda u: beta + 0.3 * u[:, 0] ** 2 - u[:, 1], probability


def test_intervals_of_few_points_cover() -> None:
    """Few lineages reach the event, and their variance is known as badly as their mean."""
    distance, probability = curved(2.0)
    found = [subset(distance, 4, seed, 100) for seed in range(400)]
    covered = [one.end(-1.0) <= probability <= one.end(1.0) for one in found]
    assert np.mean(covered) > 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / 400)


def test_intervals_of_a_curved_event_cover() -> None:
    """Without the 15 % of `Found.end`, 92.5 % of these do."""
    distance, probability = curved(2.8)
    found = [estimate(distance, 4, 10_000, generator(seed), "subset")[0] for seed in range(400)]
    covered = [one.end(-1.0) <= probability <= one.end(1.0) for one in found]
    assert np.mean(covered) >= 0.95
    assert np.median([one.end(1.0) / one.end(-1.0) for one in found]) < 2.2


@pytest.mark.parametrize("runs", [1000, pytest.param(3000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", ["subset", "importance"])
def test_few_runs_with_two_ways_cover(method: str, runs: int) -> None:
    probability = 2.0 * BELOW(-3.29)
    found = [estimate(opposite(3.29), 2, runs, generator(seed), method) for seed in range(100)]
    assert {name for _, name in found} == {method}
    covered = [one.end(-1.0) <= probability <= one.end(1.0) for one, _ in found]
    assert np.mean(covered) > 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / 100)


def test_many_numbers_with_many_ways_are_not_drawn_towards_the_medians() -> None:
    """One of 50 sums of 20 numbers is large; chains of widths from their own points gave half."""

    def distance(u: np.ndarray) -> np.ndarray:
        return 5.0 - np.abs(u.reshape(-1, 50, 20).sum(axis=2)).max(axis=1) / math.sqrt(20)

    values = np.array([subset(distance, 1000, seed, 500).probability for seed in range(20)])
    probability = -math.expm1(50 * math.log1p(-2.0 * BELOW(-5.0)))
    assert abs(values.mean() - probability) < 4.0 * values.std(ddof=1) / math.sqrt(20)


def test_levels_that_do_not_reach_the_event_leave_the_first_estimate() -> None:
    """The second levels are planned for a likely event, and then stand before a wall."""
    calls = []

    def distance(u: np.ndarray) -> np.ndarray:
        calls.append(len(u))
        return plane(1.6)(u) if sum(calls) <= 1500 else np.ones(len(u))

    found, _ = estimate(distance, 2, 10_000, generator(1), "subset")
    assert found.found and 0.02 < found.probability < 0.2
    assert "did not lead to the event" in found.warnings[-1]


def test_chains_that_keep_times_before_an_instant() -> None:
    """The numbers before it stay, those after it are new: the distribution is kept."""
    times = np.append([np.nan], np.arange(20.0))
    found = [
        subset_simulation(plane(3.09), 21, 2000, 10**6, generator(seed), times) for seed in range(8)
    ]
    values = [one.probability for one in found]
    mean_cov = np.mean([one.cov for one in found])
    assert abs(np.mean(values) / BELOW(-3.09) - 1.0) < 4.0 * mean_cov / math.sqrt(8)


@pytest.mark.parametrize(
    ("distance", "dimensions", "probability"),
    [
        (plane(4.753), 2, BELOW(-4.753)),
        (plane(4.753), 10, BELOW(-4.753)),
        (opposite(4.0), 3, 2.0 * BELOW(-4.0)),
    ],
)
def test_importance(
    distance: Callable[..., np.ndarray], dimensions: int, probability: float
) -> None:
    covered = []
    for seed in range(30):
        rng = generator(seed)
        levels = subset_simulation(distance, dimensions, 2000, 10**6, rng)
        found = importance_sampling(distance, levels, 8000, rng)
        assert found.cov < 0.1
        covered.append(found.end(-1.0) <= probability <= found.end(1.0))
        assert (distance(found.points) <= 0.0).all()
    assert np.mean(covered) > 0.95 - 4.0 * math.sqrt(0.95 * 0.05 / 30)


@pytest.mark.parametrize("distance", [plane(4.753), opposite(4.753)])
def test_many_numbers_are_weighted_in_the_directions_that_lead_to_the_event(
    distance: Callable[..., np.ndarray],
) -> None:
    probability = BELOW(-4.753) * (1 + (distance(-9.0 * np.eye(1, 100)) <= 0.0)[0])
    for seed in range(4):
        found, method = estimate(distance, 100, 20_000, generator(seed))
        assert method == "importance" and found.cov < 0.05
        assert abs(found.probability / probability - 1.0) < 4.0 * found.cov


def test_many_numbers_without_such_directions_keep_the_levels() -> None:
    """Outside of a ball of 50 dimensions, every direction leads to the event."""
    radius = 9.76  # the probability is that of chi-square
    found, method = estimate(lambda u: radius - np.linalg.norm(u, axis=1), 50, 20_000, generator(1))
    assert method == "subset"
    wanted = math.exp(-0.5 * radius**2) * sum(
        (0.5 * radius**2) ** k / math.factorial(k) for k in range(25)
    )
    assert found.end(-1.0) < wanted < found.end(1.0)


def test_many_numbers_without_derivatives_keep_the_levels() -> None:
    """Steps lead to the event, and no direction does."""

    def distance(u: np.ndarray) -> np.ndarray:
        return np.where(u[:, 0] > 2.5, -1.0, np.where(u[:, 0] > 1.2, 1.0, 2.0))

    found, method = estimate(distance, 40, 5000, generator(1))
    assert method == "subset" and found.end(-1.0) < BELOW(-2.5) < found.end(1.0)


def test_an_event_that_never_happens_is_not_found() -> None:
    found = subset(lambda u: 1.0 + (u**2).sum(axis=1), 2, 1)
    assert not found.found
    assert found.probability < 1e-8
    found = subset(lambda u: np.ones(len(u)), 2, 1)
    assert not found.found and len(found.levels) == 1
    assert "100% of its runs are equally near" in found.warnings[0]


def test_a_distance_with_steps_is_reported() -> None:
    found = subset(lambda u: np.maximum(np.ceil(4.0 - u[:, 0]), 0.0), 1, 1)
    assert found.probability == pytest.approx(BELOW(-4.0), rel=1.0)
    assert any("equally near" in text for text in found.warnings)


def test_all_runs_are_the_event() -> None:
    found = subset(lambda u: -np.ones(len(u)), 1, 1)
    assert (found.probability, found.cov, found.found) == (1.0, 0.0, True)


def test_the_limit_of_runs_is_kept() -> None:
    calls = []

    def distance(u: np.ndarray) -> np.ndarray:
        calls.append(len(u))
        return plane(6.0)(u)

    found = subset_simulation(distance, 2, 1000, 3000, generator(3))
    assert sum(calls) <= 3000
    assert not found.found and len(found.levels) == 4


def test_few_lineages_are_reported() -> None:
    """A hundred points cannot keep two ways over seven levels."""
    found = subset(opposite(5.0), 1, 1, size=100)
    assert any("descends from" in text for text in found.warnings)


def test_runs_in_all_directions_tell_of_ways_that_few_lineages_may_have_lost() -> None:
    """Levels go where the distance falls first, and lose most lineages where it falls no more."""

    def distance(u: np.ndarray) -> np.ndarray:
        return np.where(u[:, 0] > 3.9, 4.7534 - u[:, 0], np.maximum(5.0 - u[:, 1], 1.0))

    covs = []
    for seed in range(10):
        found, method = estimate(distance, 2, 30_000, generator(seed))
        assert method == "importance" and found.warnings
        assert found.end(-1.0) < BELOW(-4.7534) < found.end(1.0)
        if found.lineages < 5.0:
            covs.append(found.cov)
    # Where these runs have met the event they tell; elsewhere `cov` stays that of the levels.
    assert len(covs) > 2 and min(covs) < 0.1 and max(covs) > 0.9


def test_ctrl_c_keeps_the_finished_levels() -> None:
    calls = []

    def distance(u: np.ndarray) -> np.ndarray:
        calls.append(len(u))
        if len(calls) == 15:
            raise KeyboardInterrupt
        return plane(4.0)(u)

    found = subset_simulation(distance, 2, 1000, 10**6, generator(3))
    assert found.interrupted and not found.found
    assert len(found.levels) == 2
