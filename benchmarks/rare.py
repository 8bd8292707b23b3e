"""Runs and time for rare events, P = 1e-3 to 1e-7, beside plain runs and OpenTURNS.

make bench-rare

A grasp is pushed at random, and the event is that its object turns by more than an angle. Prints
the runs that each method takes, its time, its coefficient of variation, and, for a distance of
which the probability is known, how often its 95 % intervals have the truth. OpenTURNS'
SubsetSampling takes part where it is installed. `--scenes` prints the same of "auto" for scenes of
tests/support/rare_scenes.py, beside their plain runs; that takes half an hour.
"""

import math
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

import softpinch as sp
from command import parser
from machine import describe
from softpinch.study.subset import FEW, Distance, estimate

sys.path.append(str(Path(__file__).parent.parent / "tests" / "support"))
from rare_scenes import RARER, SCENES, RareScene, known

SCENE, VARY, DT = SCENES["bilateral"].scene, SCENES["bilateral"].vary, SCENES["bilateral"].dt
# Angles whose probabilities are about 1e-3 ... 1e-7, rad.
ANGLES = (0.0200, 0.0249, 0.0290, 0.0325, 0.0357)


def runs_at(points: Any) -> Any:
    """The peak rotations of runs at points of the standard normal space (n, 4)."""
    u = np.asarray(points)
    columns = {
        "grasped.mass": 0.1 + 0.01 * u[:, 0],
        "hand.tip.youngs_modulus": 0.3e6 * np.exp(0.2 * u[:, 1]),
        "disturbances.0.force": np.array([20.0, 10.0]) * u[:, 2:],
    }
    study = sp.monte_carlo(SCENE, vary=columns, dt=DT, summaries="peak_rotation", progress=False)
    return study["peak_rotation"]


def peer(angle: float, seed: int) -> tuple[float, float, int]:
    """Probability, coefficient of variation and runs of OpenTURNS' subset simulation.

    OpenTURNS decides how many levels it takes: 5000 runs each.
    """
    import openturns as ot

    ot.RandomGenerator.SetSeed(seed)

    def batch(points: Any) -> Any:
        return runs_at(points)[:, None]

    function = ot.PythonFunction(4, 1, func_sample=batch)
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(4)))
    subset = ot.SubsetSampling(ot.ThresholdEvent(vector, ot.Greater(), angle))
    subset.setMaximumOuterSampling(5)
    subset.setBlockSize(1000)
    subset.run()
    result = subset.getResult()
    calls = result.getOuterSampling() * result.getBlockSize()
    return result.getProbabilityEstimate(), result.getCoefficientOfVariation(), calls


def row(name: str, p: float, cov: float, runs: float, seconds: float, note: str = "") -> None:
    print(f"  {name:22} {p:10.3g} {100 * cov:7.1f} % {runs:10.3g} {seconds:9.2f} s  {note}")


def scatter(values: Any) -> str:
    return f"scatter of {len(values)} seeds {100 * values.std() / values.mean():.1f} %"


def table(quick: bool) -> None:
    """Each method for each angle."""
    print("\nthe object turns by more than an angle:")
    print(f"  {'method':22} {'P':>10} {'cov':>9} {'runs':>10} {'time':>11}")
    begun = time.perf_counter()
    count = 4000 if quick else 200_000
    sp.monte_carlo(SCENE, count, 1, VARY, dt=DT, summaries="peak_rotation", progress=False)
    each = (time.perf_counter() - begun) / count
    runs, seeds = (1500, 1) if quick else (30_000, 5)
    for angle in ANGLES[:1] if quick else ANGLES:
        print(f"angle {angle} rad")
        for method in ("importance", "subset"):
            found, spent = [], []
            for seed in range(seeds):
                begun = time.perf_counter()
                how: dict[str, Any] = {"method": method, "dt": DT, "progress": False}
                event = ("peak_rotation", ">", angle)
                found.append(sp.rare_event(SCENE, VARY, event, runs, seed, **how))
                spent.append(time.perf_counter() - begun)
            values = np.array([one.probability for one in found])
            cov, took = float(np.median([one.cov for one in found])), float(np.median(spent))
            noted = f"{scatter(values)}, {sum(bool(one.warnings) for one in found)} with warnings"
            row(f"{method}", float(np.median(values)), cov, found[0].runs, took, noted)
            if method == "importance":
                best, cov_best = float(np.median(values)), cov
        if find_spec("openturns") and not quick:
            begun = time.perf_counter()
            peers = np.array([peer(angle, 1 + seed) for seed in range(seeds)])
            took = (time.perf_counter() - begun) / seeds
            p, cov, calls = np.median(peers, axis=0)
            row("OpenTURNS subset", p, cov, calls, took, scatter(peers[:, 0]))
        for name, target in (("plain, cov 10 %", 0.1), ("plain, as importance", cov_best)):
            needed = (1.0 / best - 1.0) / target**2
            row(name, best, target, needed, needed * each, "computed from the time of a run")


def plane(d: int, probability: float) -> tuple[str, int, Distance, float]:
    """A plane in d dimensions at a distance from the medians."""
    beta = -NormalDist().inv_cdf(probability)
    name = f"plane, {d} dimensions, {probability:g}"
    return name, d, lambda u: beta - u.sum(axis=1) / math.sqrt(d), probability


def two_ways(d: int, probability: float) -> tuple[str, int, Distance, float]:
    """Two planes on both sides of the medians."""
    beta = -NormalDist().inv_cdf(probability / 2.0)
    name = f"two ways, {d} dimensions, {probability:g}"
    return name, d, lambda u: beta - np.abs(u[:, 0]), probability


def curved(d: int, beta: float) -> tuple[str, int, Distance, float]:
    """A parabola, whose probability is an integral over its first coordinate."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    below = [NormalDist().cdf(-beta - 0.3 * x * x) for x in nodes]
    probability = float(weights @ below / weights.sum())
    name = f"parabola, {d} dimensions, {probability:.2g}"
    return name, d, lambda u: beta + 0.3 * u[:, 0] ** 2 - u[:, 1], probability


def coverage(quick: bool) -> None:
    """How often intervals have a probability that a formula gives."""
    seeds = 3 if quick else 200
    print(
        f"\n95 % intervals that have the truth, of {seeds} seeds (median of upper over lower end):"
    )
    functions = [plane(2, 1e-3), two_ways(2, 1e-3), two_ways(4, 1e-5), curved(4, 2.8)]
    for name, d, distance, probability in [*functions, plane(100, 1e-3)]:
        for method in ("importance", "subset")[d > FEW :]:
            texts = []
            for runs in (1000, 3000, 10_000, 30_000):
                ends, right = [], 0
                for seed in range(seeds):
                    rng = np.random.Generator(np.random.Philox(seed))
                    found, _ = estimate(distance, d, runs, rng, method)
                    low, high = (found.end(-1.0), found.end(1.0)) if found.found else (0.0, 1.0)
                    right += low <= probability <= high
                    ends.append(high / low if low else math.inf)
                share = f"{100 * right / seeds:.1f} % ({np.median(ends):.3g})"
                texts.append(f"{runs} runs {share}")
            print(f"  {name}, {method}: {', '.join(texts)}", flush=True)


def scenes(quick: bool) -> None:
    """How "auto" scatters at about 1e-6, and how often its intervals have what plain runs gave."""
    runs, few, many = (1500, 2, 3) if quick else (30_000, 20, 200)

    def found(one: RareScene, seeds: int) -> list[sp.RareEvent]:
        args = one.scene, one.vary, one.event, runs
        return [sp.rare_event(*args, seed, dt=one.dt, progress=False) for seed in range(seeds)]

    names = list(RARER)[: 1 if quick else None]
    print(f"\nscenes whose event is made rarer, {runs} runs:")
    for name in names:
        some = found(RARER[name], few)
        values, covs = np.array([one.probability for one in some]), [one.cov for one in some]
        text = f"{sum(cov <= 0.1 for cov in covs)} of {few} at most 10 %, {scatter(values)}"
        text += f", {sum(bool(one.warnings) for one in some)} with warnings"
        median, most = 100.0 * np.median(covs), 100.0 * max(covs)
        print(f"  {name}: {np.median(values):.3g}, cov {median:.1f} % (to {most:.1f} %), {text}")
    print("\n95 % intervals that meet that of plain runs (median of upper over lower end):")
    for name in names:
        truth, right, ends = known()[name], 0, []
        for one in found(SCENES[name], many):
            low, high = one.interval
            right += bool(low <= truth.high and truth.low <= high)
            ends.append(high / low if low else math.inf)
        share = f"{100 * right / many:.1f} % of {many} seeds"
        print(f"  {name}, {truth.value:.3g}: {share} ({np.median(ends):.3g})", flush=True)


def main() -> None:
    given = parser(__doc__)
    given.add_argument("--coverage", action="store_true", help="print the shares of intervals only")
    given.add_argument("--scenes", action="store_true", help="print the scenes only")
    asked = given.parse_args()
    missing = {} if find_spec("openturns") else {"OpenTURNS": "not installed"}
    print(describe("all cores", missing=missing))
    if asked.quick or not (asked.coverage or asked.scenes):
        table(asked.quick)
    if asked.quick or not asked.scenes:
        coverage(asked.quick)
    if asked.quick or asked.scenes:
        scenes(asked.quick)


if __name__ == "__main__":
    main()
