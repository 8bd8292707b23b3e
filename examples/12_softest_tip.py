"""The softest tip
===============

The softest tip that still holds with 99.9 % under random pushes: stochastic gradients::

    python examples/12_softest_tip.py [softest_tip.png] [--quick]

Two fingers hold a box at fixed angles, and pushes of random direction and size hit it for 20 ms.
The grasp holds if the box never turns by more than 3 degrees and both tips stay on it. Between
stiffer tips it turns less. So the softest tip that holds with 99.9 % is the one with which the
quantile of the largest rotation, at 99.9 %, is 3 degrees.

Its Young's modulus E is found by the method of Robbins and Monro. Each iteration draws an ensemble
of new pushes. Its quantile says how far off E is, and the derivative of the quantile by log E how
large a step is needed. This derivative is the mean derivative of the largest rotation over the runs
at the quantile (L. J. Hong, Operations Research 57, 2009), which `sp.monte_carlo(...,
gradients=...)` gives. Later steps count less and less, so that the noise averages out.

In the end ensembles of their own, with half the step, say how likely the grasp holds with this tip,
and with tips that are a little softer.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import softpinch as sp
from softpinch.plot.style import BLACK, GREY, PAGE, RED, tag

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("softest_tip.png"))
parser.add_argument("--quick", action="store_true", help="smaller ensembles")
given = parser.parse_args()

Floats = NDArray[np.float64]
PATH = "hand.tip.youngs_modulus"
SHARE, LIMIT = 0.999, np.deg2rad(3.0)
FORCE = 30.0  # N, standard deviation of each component of a push
DT = 4e-4  # s
RUNS = 5_000 if given.quick else 20_000  # in an iteration
NEAREST = 10 if given.quick else 20  # runs about the quantile, of which the derivatives are taken
FULL, AVERAGED = 8, 24  # iterations with full steps, and then with averaged ones
CHECKED = 20_000 if given.quick else 100_000  # runs of an ensemble in the end
random = np.random.default_rng(12)

scene = sp.Scene(
    schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]])),
    fingers="driven",
    disturbances=[sp.Pulse(time=0.0, duration=0.02)],
    duration=0.05,
)


def with_tip(modulus: float) -> sp.Scene:
    """The scene with a Young's modulus, Pa, of both tips."""
    return replace(scene, hand=sp.Hand(tip=sp.Fingertip(youngs_modulus=modulus)))


def rotations(modulus: float, pushes: Floats, dt: float = DT) -> Floats:
    """The largest rotations (runs,), rad, under pushes (runs, 2), N; infinite if a tip left."""
    many = sp.monte_carlo(
        with_tip(modulus),
        vary={"disturbances.0.force": pushes},
        dt=dt,
        summaries="peak_rotation",
        progress=False,
    )
    return np.where(many.status == "completed", many["peak_rotation"], np.inf)


def slopes(modulus: float, pushes: Floats) -> Floats:
    """The derivatives of the largest rotations (runs,) by log E, rad, under pushes (runs, 2)."""
    many = sp.monte_carlo(
        with_tip(modulus),
        vary={"disturbances.0.force": pushes},
        dt=DT,
        summaries="peak_rotation",
        gradients="peak_rotation",
        sensitivities=PATH,
        progress=False,
    )
    return modulus * many.gradients["peak_rotation"][PATH]


def estimate(modulus: float) -> sp.Estimate:
    """How likely the grasp holds, with its 95 % interval, from pushes that the search has not."""
    return sp.Estimate.of(
        rotations(modulus, FORCE * random.normal(size=(CHECKED, 2)), DT / 2) <= LIMIT
    )


modulus, found = 1e5, []
print("iteration       E, Pa  quantile, deg  its derivative by log E, deg")
for k in range(FULL + AVERAGED):
    pushes = FORCE * random.normal(size=(RUNS, 2))
    turned = rotations(modulus, pushes)
    # The runs about the quantile, as far as they have a rotation.
    order = np.argsort(turned)
    middle = min(round(SHARE * RUNS), int(np.isfinite(turned).sum()) - NEAREST // 2)
    nearest = order[middle - NEAREST // 2 : middle + NEAREST // 2]
    quantile = float(turned[order[middle]])
    derivative = float(np.mean(slopes(modulus, pushes[nearest])))
    if k % 4 == 0:
        print(f"{k:9d} {modulus:11.0f} {np.rad2deg(quantile):14.3f} {np.rad2deg(derivative):29.3f}")
    # Newton's step, but not beyond a factor of 1.5: far away the quantile is no straight line.
    step = np.clip((LIMIT - quantile) / derivative, -np.log(1.5), np.log(1.5))
    modulus *= float(np.exp(step / max(1, k - FULL + 1)))
    found.append(modulus)

print(f"the softest tip has E = {modulus:.0f} Pa")
pushes = FORCE * random.normal(size=(RUNS, 2))
many = sp.monte_carlo(
    with_tip(modulus), vary={"disturbances.0.force": pushes}, dt=DT, progress=False
)
print(f"a tip would have to pull in {many.happened('pulling').mean():.2%} of the runs")
moduli = modulus * np.array([0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3])
holds = [estimate(each) for each in moduli]
for each, odds in zip(moduli, holds, strict=True):
    print(f"E = {each:7.0f} Pa: holds with {odds.value:.3%}, {odds.low:.3%} to {odds.high:.3%}")

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 2.8), layout="constrained")
    search, odds_of = figure.subplots(1, 2)
    search.plot(np.arange(1, len(found) + 1), 1e-3 * np.array(found), ".-", color=BLACK)
    search.axhline(1e-3 * modulus, color=RED, linewidth=0.8)
    search.set_xlabel("iteration")
    search.set_ylabel("Young's modulus of the tips [kPa]")
    failing = np.array([[1.0 - odds.value, 1.0 - odds.high, 1.0 - odds.low] for odds in holds])
    odds_of.fill_between(
        1e-3 * moduli, failing[:, 1], failing[:, 2], color=GREY, alpha=0.4, linewidth=0
    )
    odds_of.plot(1e-3 * moduli, failing[:, 0], ".-", color=BLACK)
    odds_of.axhline(1.0 - SHARE, color=RED, linewidth=0.8)
    odds_of.axvline(1e-3 * modulus, color=RED, linewidth=0.8)
    odds_of.set_yscale("log")
    odds_of.set_xlabel("Young's modulus of the tips [kPa]")
    odds_of.set_ylabel("probability that the grasp\ndoes not hold, 95 % interval")
    for axes, letter in ((search, "a"), (odds_of, "b")):
        tag(axes, letter)
print("saved", sp.plot.save(figure, given.picture))
