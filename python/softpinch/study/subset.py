"""Probabilities of rare events of standard normal numbers: subset and importance sampling.

    >>> rng = np.random.Generator(np.random.Philox(1))
    >>> found = subset_simulation(lambda u: 4.0 - u[:, 0], 2, 1000, 30_000, rng)
    >>> 2e-5 < found.probability < 5e-5  # 3.2e-5
    True

An event happens where a function of the point (d,) is at most 0. Subset simulation (Au and Beck,
"Estimation of small failure probabilities in high dimensions by subset simulation", 2001)
multiplies the shares of levels, each a tenth of the one before. Chains begin at the points inside a
level and stay inside, by adaptive conditional sampling (Papaioannou, Betz, Zwirglmaier and Straub,
"MCMC algorithms for subset simulation", 2015). All chains step together, so that runs use lanes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..support import Floats, Result, require

# A level is a tenth of the one before, so that chains from inside it have so many points.
LENGTH = 10
# Subset simulation gives up below this probability.
LEAST = 1e-9
# The acceptance rate that is aimed at, and the range outside of which chains explore little.
_TARGET, _ACCEPTABLE = 0.44, (0.15, 0.8)
# Twice the standard deviation of runs in all directions, if no point of the event is known.
_FAR = 5.0
# Intervals are wider than `cov` alone makes them. It is estimated from the runs that also give the
# probability and the thresholds of levels, and up to 7 % below the measured scatter.
_WIDER = 1.15
# Fewer effective lineages hardly tell how many ways to the event there are.
_FEW_LINEAGES = 5.0
# The effective number of runs in all directions with the event that tells of ways instead.
_MET = 10.0
# The most dimensions in which runs are weighted; from `_MANY` on, these lead to the event. Above
# `FEW`, "auto" tries it with so many runs for each number, and takes the smaller `cov`.
FEW, _MANY, _RUNS_EACH = 12, 5, 100

# Weights, which are 1 together, and frozen distributions of SciPy.
Mixture: TypeAlias = list[tuple[float, Any]]
# From points (n, d) to their distances to the event (n,).
Distance = Callable[[Floats], Floats]
# Takes a text about where the computation is.
Tell = Callable[[str], object]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Level(Result):
    """A level of subset simulation.

    Attributes:
        threshold: The largest distance to the event of runs inside the level.
        probability: The share of runs inside, among those inside the level before.
        cov: Coefficient of variation of `probability`, with the correlation of the chains.
        acceptance: The share of the chains' steps that were accepted; NaN for independent runs.
        runs: Number of runs.
    """

    threshold: float
    probability: float
    cov: float
    acceptance: float
    runs: int


@dataclass
class Found:
    """The probability of an event, or of the last level before it.

    `lineages` is the effective number of first points from which the points inside descend. The
    variance is known as well as from so many independent numbers.
    """

    levels: list[Level] = field(default_factory=list)
    probability: float = 1.0
    cov: float = 0.0
    lineages: float = 1.0
    points: Floats = field(default_factory=lambda: np.empty((0, 0)))  # inside (k, d)
    weights: Floats = field(default_factory=lambda: np.empty(0))  # of these (k,)
    first: Floats = field(default_factory=lambda: np.empty((0, 0)))  # inside the first level (m, d)
    found: bool = False  # whether the event is reached
    interrupted: bool = False
    left: int = 0  # calls that were allowed, and not needed
    warnings: list[str] = field(default_factory=list)

    @property
    def spread(self) -> float:
        """The standard deviation of the logarithm of a log-normal number with this `cov`."""
        return math.sqrt(math.log1p(self.cov**2))

    def end(self, side: float) -> float:
        """The lower (-1.0) or upper (1.0) end of the 95 % interval of a log-normal estimate.

        Its half width is a quantile of Student's t, because the variance is an estimate too, and
        15 % more, with which at least 95 % of the measured intervals have the probability.
        """
        quantile = _WIDER * _scipy("special").stdtrit(max(self.lineages - 1.0, 2.0), 0.975)
        return self.probability * math.exp(self.spread * (0.5 * self.spread + side * quantile))


def estimate(
    distance: Distance,
    dimensions: int,
    most: int,
    rng: np.random.Generator,
    method: str = "auto",
    times: Floats | None = None,
    tell: Tell = str,
) -> tuple[Found, str]:
    """The probability of an event by at most `most` calls, and the method that gave it.

    Some of the calls find the levels; the others give the estimate. `times` is for "splitting".
    """
    size = int(np.clip(most // 30, 100, 1000))
    pilot = found = subset_simulation(distance, dimensions, size, most, rng, times, tell)
    left = pilot.left
    choose = method == "auto" and dimensions > FEW
    few = method in ("auto", "importance") and not (choose and dimensions * _RUNS_EACH > most)
    method = "splitting" if method == "splitting" else "subset"
    if not pilot.interrupted:
        deepest = pilot.probability * math.exp(-3.0 * pilot.spread) if pilot.found else LEAST
        levels = max(1, math.ceil(-math.log10(deepest)))
        # Levels that keep all ways to the event need more runs than the weighted ones.
        part, bound = (0.6, 0.8) if few and levels > 1 else (1.0, 1.0)
        size = int(part * left / (levels - (levels - 1) / LENGTH))
        if size >= 10 * LENGTH:
            most = int(bound * left)
            found = subset_simulation(distance, dimensions, size, most, rng, times, tell)
            left -= most - found.left
            if pilot.found and not found.found:
                lost = ["most runs did not lead to the event: this is what the others give"]
                lost = pilot.warnings + lost * (not found.interrupted)
                found = replace(pilot, interrupted=found.interrupted, warnings=lost)
    if few and not found.interrupted and (len(found.levels) > 1 or not found.found):
        tell(f"weighted runs, after {len(found.levels)} levels to {found.probability:.2g}")
        try:
            weighted = importance_sampling(distance, found, left, rng)
            if not choose or weighted.cov < found.cov:
                found, method = weighted, "importance"
        except KeyboardInterrupt:
            found = replace(found, interrupted=True)
    if found.found and pilot.found:
        apart = abs(math.log(found.probability / pilot.probability))
        if apart > 3.0 * math.hypot(found.spread, pilot.spread):
            text = f"fewer runs gave {pilot.probability:.2g}, and more {found.probability:.2g}"
            found.warnings.append(f"{text}: one of them misses a part of the event")
    if found.found and len(found.levels) > 1 and dimensions <= FEW:
        found.warnings += _lost_ways(found.first, found.points)
    return found, method


def _lost_ways(first: Floats, events: Floats) -> list[str]:
    """A warning if runs of the first level lie in directions in which no run has the event."""
    here, there = (x / np.linalg.norm(x, axis=1)[:, None] for x in (first, events[:2000]))
    share = float(((here @ there.T).max(axis=1) < 0.3).mean())
    text = f"{share:.0%} of the runs of the first level lie where no run has the event at the end"
    return [f"{text}, so that a second way to the event may be lost"] if share > 0.05 else []


def subset_simulation(
    distance: Distance,
    dimensions: int,
    size: int,
    most: int,
    rng: np.random.Generator,
    times: Floats | None = None,
    tell: Tell = str,
) -> Found:
    """Goes down level by level, with `size` points in each, and at most `most` calls in all.

    A KeyboardInterrupt of `distance` keeps the finished levels. With `times` (d,), NaN for
    numbers without a time, half of the steps draw numbers from a random instant on anew.
    """
    chains, result = size // LENGTH, Found(left=most - size // LENGTH * LENGTH)
    points = rng.standard_normal((chains * LENGTH, dimensions))
    ancestors, scale, acceptance = np.arange(len(points)), 0.6, math.nan
    before, runs, squares = math.inf, len(points), 0.0
    try:
        values = distance(points)
        while True:
            threshold = max(0.0, float(np.partition(values, chains - 1)[chains - 1]))
            highest = min(before, float(values.max()))
            if threshold >= highest and (values < highest).any():
                # Many values are equal: go down to the next one.
                threshold = max(0.0, float(values[values < highest].max()))
            elif threshold >= before and result.levels:
                return result
            inside = values <= threshold
            share, cov = float(inside.mean()), _cov(inside.reshape(-1, chains), before == math.inf)
            facts = {"probability": share, "cov": cov, "acceptance": acceptance}
            result.levels.append(Level(threshold=threshold, runs=runs, **facts))
            result.probability *= share
            result.points, result.weights = points[inside], np.ones(int(inside.sum()))
            result.first = result.points if before == math.inf else result.first
            lineages = np.unique(ancestors[inside], return_counts=True)[1]
            squares, number = squares + cov**2, len(result.levels)
            result.lineages = _effective(lineages.astype(float))
            descent = _descent(result.lineages, chains * LENGTH, number)
            result.cov = math.sqrt(max(squares, descent))
            result.warnings += _warnings(number, result.levels[-1], len(lineages))
            tell(f"level {number}: {result.probability:.2g} within {threshold:.3g} of the event")
            result.found, length = threshold == 0.0, min(LENGTH, 1 + result.left // chains)
            if result.found or inside.all() or result.probability < LEAST or length < 3:
                return result
            seeds = np.resize(rng.permutation(np.flatnonzero(inside)), chains)
            u, value, ancestors = points[seeds], values[seeds], np.tile(ancestors[seeds], length)
            steps, accepted = [(u, value)], []
            for k in range(1, length):
                # One width for all numbers: each number's spread over the points inside depends on
                # the chains' own first points, which draws these towards the medians.
                sigma = min(1.0, scale)
                fresh = rng.standard_normal(u.shape)
                trial = math.sqrt(1.0 - sigma**2) * u + sigma * fresh
                if times is not None:
                    cut = rng.choice(times[np.isfinite(times)], (chains, 1))
                    cut = np.where(rng.random((chains, 1)) < 0.5, cut, np.inf)
                    trial = np.where(times >= cut, fresh, trial)
                new = distance(trial)
                moved = new <= threshold
                u, value = np.where(moved[:, None], trial, u), np.where(moved, new, value)
                steps.append((u, value))
                accepted.append(float(moved.mean()))
                scale *= math.exp((accepted[-1] - _TARGET) / math.sqrt(k))
            points, values = (np.concatenate(parts) for parts in zip(*steps, strict=True))
            # The first points of the chains belong to the level before.
            before, runs, acceptance = threshold, len(points) - chains, float(np.mean(accepted))
            result.left -= runs
    except KeyboardInterrupt:
        result.interrupted = True
        return result


def _cov(inside: NDArray[np.bool_], independent: bool) -> float:
    """The coefficient of variation of a level's share, from which points (steps, chains) are in.

    The factor 1 + gamma of Au and Beck, equations (25) and (28), is that of correlated chains.
    """
    steps, share = len(inside), float(inside.mean())
    gamma, variance = 0.0, share * (1.0 - share)
    for lag in range(1, steps if variance and not independent else 1):
        both = float((inside[lag:] & inside[:-lag]).mean()) - share**2
        gamma += 2.0 * (1.0 - lag / steps) * both / variance
    return math.sqrt((1.0 - share) / (share * inside.size) * (1.0 + max(gamma, 0.0)))


def _effective(weights: Floats) -> float:
    return float(weights.sum() ** 2 / (weights**2).sum())


def _descent(lineages: float, size: int, levels: int) -> float:
    """The relative variance of the product of all levels, from the effective number of lineages.

    Levels are not independent, but lineages of different first points are nearly so (Lee and
    Whiteley, "Variance estimation in the particle filter", 2018, equation (8)).
    """
    return 1.0 - (size / (size - 1)) ** levels * (1.0 - 1.0 / lineages)


def _warnings(number: int, level: Level, lineages: int) -> list[str]:
    """Warnings about level `number`, whose points inside have so many lineages."""
    texts = []
    if level.acceptance < _ACCEPTABLE[0] or level.acceptance > _ACCEPTABLE[1]:
        texts += [f"{level.acceptance:.0%} of the steps were accepted: chains explore little"]
    if level.threshold > 0.0 and level.probability > 1.5 / LENGTH:
        texts += [f"{level.probability:.0%} of its runs are equally near: levels may mislead"]
    if number > 1 and lineages < LENGTH:
        texts += [f"it descends from {lineages} of the first runs: other ways may be lost"]
    return [f"level {number}: {text}" for text in texts]


def _scipy(module: str) -> Any:
    return require(f"scipy.{module}", extra="study", purpose="rare_event (SciPy)")


def importance_sampling(
    distance: Distance, levels: Found, runs: int, rng: np.random.Generator
) -> Found:
    """Weights independent runs from a mixture of normal distributions, about points of the event.

    To the points of the event that subset simulation found, the likeliest mixture is the one with
    the least cross-entropy. A fourth of the runs improves it, or half where few lineages are left,
    and the others give the estimate.
    Some runs look in all directions, for ways to the event that the levels did not lead to.
    """
    normal = _scipy("stats").multivariate_normal
    points = levels.points[: len(levels.points) * levels.found]
    axes, used = _axes(distance, points, runs // 4, rng)
    first, runs, r = levels.first @ axes, runs - used, axes.shape[1]
    if not r:
        return levels
    few = levels.lineages < _FEW_LINEAGES
    # Few lineages leave points that tell little: their mixture is improved once more.
    quarters = 2 if few else 1
    rest = runs - quarters * (runs // 4)
    for number, share in [*[(runs // 4, 0.5)] * quarters, (rest, 0.5 if few else 0.1)]:
        # Numbers beside the axes keep their distribution.
        near = points @ axes
        radii = np.linalg.norm(near, axis=1)
        far = max(1.0, 0.5 * float(radii.min(initial=_FAR)))
        wide: Mixture = [(1.0, normal(np.zeros(r), far**2 * np.eye(r)))]
        mixture = wide
        if len(points):
            # The runs of the first level, moved as far out as the event, lie in all of its ways.
            out = float(np.median(radii) / np.median(np.linalg.norm(first, axis=1)))
            wide = _joined((0.5, wide), (0.5, _mixture(out * first, rng)))
            mixture = _joined((share, wide), (1.0 - share, _mixture(near, rng)))
        counts = rng.multinomial(number, [weight for weight, _ in mixture])
        drawn = [one.rvs(n, rng) for n, (_, one) in zip(counts, mixture, strict=True)]
        trial = np.concatenate([each.reshape(-1, r) for each in drawn]) @ axes.T
        if r < len(axes):
            beside = rng.standard_normal(trial.shape)
            trial += beside - beside @ axes @ axes.T
        happens = distance(trial) <= 0.0
        inside = trial[happens]
        if not len(inside):
            return levels
        weights = _weights(inside @ axes, mixture)
        first_ones = np.arange(number) < counts[: len(wide)].sum()
        alone = _weights(trial[happens & first_ones] @ axes, wide)
        points = inside[rng.choice(len(inside), 2000, p=weights / weights.sum())]
    mean, square = float(weights.sum()) / number, float((weights**2).sum()) / number
    missed, large = 0.0, 0.05 * number * mean
    if levels.found:  # the chains may know greater weights than these runs have
        known = _weights(levels.points @ axes, mixture)
        # Where one run would be 5 % of the estimate, there may be none.
        missed = float((known > large).mean())
        square = max(square, mean * float(np.minimum(known, large).mean()))
    cov = math.hypot(math.sqrt(max(square / mean**2 - 1.0, 0.0) / (number - 1)), missed)
    if few:
        # Of a way to the event that the levels lost, the runs in all directions may tell: what none
        # of n such runs has met is about 1 / n of the probability.
        met = _effective(alone) if len(alone) else 0.0
        cov = max(cov, min(levels.cov, math.hypot(cov, 1.0 / met) if met > _MET else math.inf))
    lost = [] if levels.found else ["the levels did not lead to the event: runs around it did"]
    if (most := weights.max() / weights.sum()) > 0.05:
        lost.append(f"{most:.0%} of the estimate comes from one run: cov may be too small")
    changes: dict[str, Any] = {"probability": mean, "cov": cov, "points": inside}
    changes["lineages"] = min(levels.lineages, _effective(weights))
    changes["weights"] = weights
    return replace(levels, found=True, warnings=levels.warnings + lost, **changes)


def _axes(
    distance: Distance, points: Floats, runs: int, rng: np.random.Generator
) -> tuple[Floats, int]:
    """Orthonormal directions (d, r) that lead to the event, and how many of the runs they took.

    They span nearly all derivatives of the distance at points of the event, by differences. Beside
    them the points have nearly the distribution of all runs (Uribe, Papaioannou, Marzouk and
    Straub, "Cross-entropy-based importance sampling with failure-informed dimension reduction for
    rare event simulation", 2021).
    """
    d = points.shape[1]
    count, everywhere = min(runs // (d + 1), 60), np.eye(d, d if d <= FEW else 0)
    if d < _MANY or not count or not len(points):
        return everywhere, 0
    moved = rng.choice(points, count)[:, None] + 0.1 * np.eye(d + 1, d, -1)
    values = distance(moved.reshape(-1, d)).reshape(count, d + 1)
    slopes = values[:, 1:] - values[:, :1]
    sizes = np.linalg.norm(slopes, axis=1, keepdims=True)
    ok = np.isfinite(sizes[:, 0]) & (sizes[:, 0] > 0.0)
    if not ok.any():
        return everywhere, values.size
    _, spans, axes = np.linalg.svd(slopes[ok] / sizes[ok], full_matrices=False)
    rest = 1.0 - np.cumsum(spans**2) / ok.sum()
    return axes[: min(FEW, 1 + int((rest > 0.01).sum()))].T, values.size


def _joined(*parts: tuple[float, Mixture]) -> Mixture:
    return [(share * weight, one) for share, mixture in parts for weight, one in mixture]


def _weights(points: Floats, mixture: Mixture) -> Floats:
    """The density of the standard normal distribution at points (n, d), over a mixture's."""
    logs = [math.log(weight) + one.logpdf(points).reshape(-1) for weight, one in mixture]
    squares = (points**2).sum(axis=1) + points.shape[1] * math.log(2.0 * math.pi)
    weights: Floats = np.exp(-0.5 * squares - np.logaddexp.reduce(logs, axis=0))
    return weights


def _mixture(points: Floats, rng: np.random.Generator) -> Mixture:
    """Weights and normal distributions about 4 and about 8 groups of points (n, d)."""
    normal = _scipy("stats").multivariate_normal
    vq = _scipy("cluster.vq")
    n, d = points.shape
    most, result = min(n // (10 * d), len(np.unique(points, axis=0))), []
    # Wide ways to the event need few groups, and many ways need many.
    for groups in sorted({max(1, min(most, number)) for number in (4, 8)}):
        group = vq.kmeans2(points, groups, minit="++", rng=rng)[1]
        for own in (points[group == k] for k in range(groups)):
            if len(own) < 2:
                continue
            covariance = np.cov(own.T).reshape(d, d)
            # Few points do not determine correlations: shrink them.
            kept = np.where(np.eye(d) == 1.0, 1.0, len(own) / (len(own) + d))
            covariance = covariance * kept + 1e-6 * np.eye(d)
            # Wider than the points, and a tenth of it much wider, so that no weight is huge.
            for share, factor in ((0.9, 1.2), (0.1, 2.4)):
                one = normal(own.mean(axis=0), factor**2 * covariance)
                result.append((share * len(own) / n, one))
    total = sum(weight for weight, _ in result)
    return [(weight / total, one) for weight, one in result]
