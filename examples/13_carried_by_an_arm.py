"""Carried by an arm
=================

How fast an arm may carry a grasp: the limit of its acceleration, and the odds of a move::

    python examples/13_carried_by_an_arm.py [carried_by_an_arm.png] [--quick]

Soft tips that push, never pull, and stick only as far as friction lets them hold a box of 0.5 kg.
The arm moves the hand by 0.4 m to the right and 0.3 m up, by minimum jerk. How long must the move
take?

If every number is known, `sp.carry_limits` answers: with the acceleration that the grasp bears in
each direction if it grows slowly, and with the fastest move after which the grasp still holds.

But mass, friction and Young's modulus of the tips are never known exactly. So a study draws them,
and the duration of the move with them: the end of the move is a number of the scene as all others.
The share of its runs that hold, by duration, are the odds of the move.

The shortest duration that is safe with 99.9 % is a matter of few runs. Each draw of mass, friction
and modulus has a duration of its own, below which the box is lost. So all draws are tried with a
fast move; those that lose the box are tried again with longer moves, by bisection, and the others
have done. This takes it that a draw that holds in a fast move also holds in a slower one. Whether
that is so, an ensemble of other draws says in the end.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import softpinch as sp
from softpinch.plot.style import BLACK, GREY, PAGE, RED

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("carried_by_an_arm.png"))
parser.add_argument("--quick", action="store_true", help="smaller ensembles")
given = parser.parse_args()

Floats = NDArray[np.float64]
WAY = np.array([0.4, 0.3])  # m
BEGIN = 0.1  # s; before it the fingers adapt to the mass and the modulus of a run
FAST, SLOW = 0.2, 0.36  # s, durations of the moves that are tried
SHARE = 0.999
DT = 2e-4  # s
# With fewer than 3 838 runs the interval of a share does not end above 99.9 %, even if all hold.
RUNS = 4_000 if given.quick else 10_000
UNKNOWN = {
    "grasped.mass": sp.Normal(0.5, 0.05),  # kg
    "friction": sp.Normal(0.5, 0.05),
    "hand.tip.youngs_modulus": sp.LogNormal(0.3e6, 0.1),  # Pa
}
END = "motion.times.1"

grasp = sp.Scene(
    contact="unilateral",
    friction=0.5,
    hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
    grasped=sp.GraspedObject.box(0.049, 0.049, 0.5),
    schedule=sp.Schedule.in_degrees("steps", [0.0], [[4, 4]]),
)

# All numbers known: the slow limit in every direction, and the fastest move.
rest = sp.equilibrium(grasp)
slow = sp.carry_limits(rest)
print(slow)
distance = float(np.hypot(*WAY))
moves = sp.carry_limits(rest, [WAY], profile="minimum_jerk", distance=distance)
# The peak acceleration of a move by minimum jerk is 10 / sqrt(3) times D / T^2.
known = float(np.sqrt(10.0 / np.sqrt(3.0) * distance / moves.limit[0]))
print(f"fastest move: {moves.limit[0]:.1f} m/s^2, then {moves.cause[0]}: {known:.3f} s")

# Numbers that are drawn, and the duration with them.
assert rest.state is not None
carried = replace(
    grasp,
    initial=replace(rest.state, time=0.0),
    motion=sp.HandMotion.minimum_jerk([BEGIN, BEGIN + SLOW], [[0.0, 0.0], WAY]),
    duration=BEGIN + SLOW + 0.05,
)
end = sp.Uniform(BEGIN + 0.12, BEGIN + 0.28)
study = sp.monte_carlo(carried, RUNS, vary={**UNKNOWN, END: end}, dt=DT, seed=1, progress=False)
print(f"{study.probability('holds')} over all durations; it depends on")
for path, effect in sp.sensitivity(study, "holds").items():
    print(f"  {path:24} share {effect.share:5.2f}, rank correlation {effect.rank_correlation:5.2f}")
duration = study.parameters[END] - BEGIN
edges = np.linspace(0.12, 0.28, 17)
holds, bin_of = study.happened("holds"), np.digitize(duration, edges)
counted = [sp.Estimate.of(holds[bin_of == k]) for k in range(1, len(edges))]


def failing(odds: list[sp.Estimate]) -> tuple[Floats, Floats, Floats]:
    """The probabilities that the box is lost, and their intervals."""
    value, low, high = np.array([(each.value, each.low, each.high) for each in odds]).T
    return 1.0 - value, 1.0 - high, 1.0 - low


def lost(draws: dict[str, Floats], durations: Floats) -> NDArray[np.bool_]:
    """Whether the box is lost in moves of these durations (n,), s, with these draws."""
    many = sp.monte_carlo(carried, vary={**draws, END: BEGIN + durations}, dt=DT, progress=False)
    return ~many.happened("holds")


# The duration below which the box is lost, for each draw; `FAST` for those that hold in it.
fixed = carried.with_({END: BEGIN + FAST})
first = sp.monte_carlo(fixed, RUNS, vary=UNKNOWN, dt=DT, seed=2, progress=False)
again = np.flatnonzero(~first.happened("holds"))
draws = {path: values[again] for path, values in first.parameters.items()}
low, high = np.full(len(again), FAST), np.full(len(again), SLOW)
assert not lost(draws, high).any()
while high[0] - low[0] > 1e-3:
    middle = 0.5 * (low + high)
    fails = lost(draws, middle)
    low, high = np.where(fails, middle, low), np.where(fails, high, middle)
needed = np.full(RUNS, FAST)
needed[again] = high

# The share of the draws that hold, over the duration, and where it reaches 99.9 %.
durations = np.linspace(FAST, SLOW, 321)
odds = [sp.Estimate.of(needed <= each) for each in durations]
safe, soonest, latest = (
    float(durations[np.argmax([getattr(each, name) >= SHARE for each in odds])])
    for name in ("value", "high", "low")
)
print(f"safe with {100 * SHARE:g} %: {safe:.3f} s, 95 % interval {soonest:.3f} to {latest:.3f} s")
fixed = carried.with_({END: BEGIN + safe})
others = sp.monte_carlo(fixed, RUNS, vary=UNKNOWN, dt=DT / 2, seed=3, progress=False)
print(f"other draws, half the step: {others.probability('holds')}")

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 3.5), layout="constrained")
    around = figure.add_subplot(1, 2, 1, projection="polar")
    over = figure.add_subplot(1, 2, 2)
    sp.plot.carry_limits(slow, around)
    star = {"color": RED, "marker": "*", "markersize": 7.0, "linestyle": "none"}
    around.plot(np.arctan2(*WAY[::-1]), moves.limit[0], **star, label="fastest move")
    around.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=3)
    value, least, most = failing(odds)
    over.fill_between(durations, least, most, color=GREY, alpha=0.4, linewidth=0.0)
    over.plot(durations, value, color=BLACK, label="each draw's own limit")
    value, least, most = failing(counted)
    bars = {"fmt": "o", "markersize": 3.0, "color": BLACK, "elinewidth": 0.7}
    middles, sizes = 0.5 * (edges[1:] + edges[:-1]), np.array([value - least, most - value])
    seen = value > 0.0
    over.errorbar(middles[seen], value[seen], sizes[:, seen], **bars, label="random durations")
    over.axvline(known, color=BLACK, linewidth=0.8, linestyle=":", label="all numbers known")
    over.axhline(1.0 - SHARE, color=RED, linewidth=0.8)
    over.axvline(safe, color=RED, linewidth=0.8, label=f"safe with {100 * SHARE:g} %")
    over.axvspan(soonest, latest, color=RED, alpha=0.2, linewidth=0.0)
    over.set(yscale="log", ylim=(1e-4, 1.3), xlim=(0.12, 0.32), xticks=[0.15, 0.2, 0.25, 0.3])
    over.set_xlabel("duration of the move [s]")
    over.set_ylabel("probability that the box is lost,\n95 % interval")
    over.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2)
    for x, letter in ((0.01, "a"), (0.5, "b")):
        figure.text(x, 0.98, f"({letter})", va="top")
print("saved", sp.plot.save(figure, given.picture))
