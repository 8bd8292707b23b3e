"""A bottle in jaws
================

A parallel gripper with measured tips lifts a bottle, and its odds over the speed of the move::

    python examples/14_a_bottle_in_jaws.py [a_bottle_in_jaws.png] [--quick]

A bottle of 0.5 kg lies on its side. Two jaws with soft tips take it at its waist, which is 70 mm
thick, and an arm lifts it by 0.25 m and carries it 0.4 m aside. How long must the move take?

The force of a tip is what was measured on a flat plate, `examples/data/silicone_tip.csv` (a curve
that is plausible for a tip of soft silicone, of no particular product). `sp.MeasuredLaw` fits
springs to it and says how far they miss it. On the bottle the same tip is softer, because fewer of
its springs reach a round side; `sp.explain` has the factor.

The gripper closes by a way, not to a force: `sp.grip` finds the travel of the jaws with which the
measured tips press with 15 N. Tips of other batches of silicone are softer or stiffer and then
press with less or more. A curve is no number that a study can draw, so the study has eight parts,
one for each eighth of the batches. Each draws mass, friction, stiffness against shear, which was
not measured, and the duration of the move.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist

import numpy as np
from matplotlib.figure import Figure

import softpinch as sp
from softpinch.plot.style import BLACK, BLUE, PAGE, PALE, RED

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("a_bottle_in_jaws.png"))
parser.add_argument("--quick", action="store_true", help="smaller ensembles")
given = parser.parse_args()

CURVE = Path(sys.argv[0]).parent / "data" / "silicone_tip.csv"
FORCE = 15.0  # N, of the grip with the tips that were measured
UP, ASIDE = 0.25, 0.4  # m
BEGIN = 0.1  # s; before it the grasp adapts to the mass of a run
REST = 0.05  # s after the move
FAST, SLOW = 0.5, 1.0  # s, durations of the moves
DT = 2e-4  # s
SLIP = 1e-3  # m
WORDS = {"slips": "slips by 1 mm", "lost": "lost"}
BATCHES, SCATTER = 8, 0.1  # parts of the study; standard deviation of the logarithm of the force
RUNS = 100 if given.quick else 800  # of each part
UNKNOWN = {
    "grasped.mass": sp.Normal(0.5, 0.05),  # kg, as the bottle is more or less full
    "friction": sp.Normal(0.5, 0.05),
    "hand.tip.law.shear_factor": sp.Uniform(0.6, 1.0),
}
TIMES = ("motion.times.1", "motion.times.2")


def gripper(law: sp.MeasuredLaw) -> sp.Scene:
    """Two jaws with these tips, which touch the bottle."""
    jaw = sp.Jaw(root_offset=0.062, mass=0.15)
    waist = sp.Arc(0.035, span=2.9)  # which ends, so that a bottle that falls is lost
    return sp.Scene(
        hand=sp.Hand(
            right=jaw,
            left=jaw,
            tip=sp.Fingertip(law=law, normal_mass=0.01, tangential_mass=0.01),
        ),
        grasped=replace(sp.GraspedObject.disc(0.07, 0.5), right=waist, left=waist),
        control=sp.Pid(kp=2e4, kd=200.0, ki=2e5),  # N/m, N s/m and N/(m s)
        contact="unilateral",
        friction=0.5,
        initial="touching",
    )


def times(duration: float) -> list[float]:
    """Begin of the move, end of its lift, and end, s; both parts have the same acceleration."""
    share = np.sqrt(UP) / (np.sqrt(UP) + np.sqrt(ASIDE))
    return [BEGIN, BEGIN + share * duration, BEGIN + duration]


def carried(held: sp.Scene, duration: float) -> sp.Scene:
    """The move, which begins where the grasp rests."""
    rest = sp.equilibrium(held).state
    assert rest is not None
    return replace(
        held,
        initial=replace(rest, time=0.0),
        motion=sp.HandMotion.minimum_jerk(times(duration), [[0.0, 0.0], [0.0, UP], [ASIDE, UP]]),
        duration=BEGIN + duration + REST,
    )


# The tips that were measured, and how far their jaws must travel.
law = sp.MeasuredLaw.from_csv(CURVE)
print(f"{len(law.force)} forces up to {law.force[-1]:g} N, misfit {law.misfit:.2%}")
grip = sp.grip(gripper(law), force=FORCE)
print(grip)
print(next(line for line in str(sp.explain(grip.scene)).splitlines() if "soften" in line).strip())
print(sp.carry_limits(grip.equilibrium))

# All numbers known: the shortest move after which the bottle is still held.
low, high = FAST, SLOW
while high - low > 1e-3:
    middle = 0.5 * (low + high)
    holds = sp.simulate(carried(grip.scene, middle), DT, record=()).holds
    low, high = (low, middle) if holds else (middle, high)
known = high


def peak(duration: float) -> float:
    """The peak acceleration, m/s^2, of a lift by minimum jerk: 10 / sqrt(3) times D / T^2."""
    return float(10.0 / np.sqrt(3.0) * UP / (times(duration)[1] - BEGIN) ** 2)


print(f"all numbers known: {known:.3f} s, with a peak of {peak(known):.1f} m/s^2")

# Each eighth of the batches, with the travel that was found for the measured tips.
factors = np.exp([SCATTER * NormalDist().inv_cdf((k + 0.5) / BATCHES) for k in range(BATCHES)])
studies, durations = [], []
for k, factor in enumerate(factors):
    scene = replace(gripper(replace(law, force=factor * law.force)), schedule=grip.scene.schedule)
    drawn = np.random.default_rng([14, k]).uniform(FAST, SLOW, RUNS)
    study = sp.monte_carlo(
        carried(scene, SLOW),
        RUNS,
        vary={**UNKNOWN, TIMES: np.array([times(each)[1:] for each in drawn])},
        dt=DT,
        seed=k,
        summaries="slip_distance",
        progress=False,
    )
    force = sp.equilibrium(scene).multipliers[0]
    print(f"tips {factor:4.2f} times as stiff: {force:4.1f} N, {study.probability('holds')}")
    studies.append(study)
    durations.append(drawn)
duration = np.concatenate(durations)
lost = np.concatenate([~study.happened("holds") for study in studies])
slips = lost | np.concatenate([study["slip_distance"] > SLIP for study in studies])
print("with tips much like those, whether the bottle is held depends on")
for path, effect in sp.sensitivity(studies[BATCHES // 2], "holds").items():
    if path != TIMES[0]:  # both instants say how long the move takes
        print(f"  {path}: share {effect.share:.2f}")

edges = np.linspace(FAST, SLOW, 13)
middles, part = 0.5 * (edges[1:] + edges[:-1]), np.digitize(duration, edges)
odds = {
    "lost": [sp.Estimate.of(lost[part == k]) for k in range(1, len(edges))],
    "slips": [sp.Estimate.of(slips[part == k]) for k in range(1, len(edges))],
}
print("duration, s   peak, m/s^2   lost          slips by 1 mm")
for k in range(0, len(middles), 2):
    shares = "   ".join(f"{each[k].low:.3f} to {each[k].high:.3f}" for each in odds.values())
    print(f"{middles[k]:11.4f} {peak(middles[k]):13.1f}   {shares}")

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 2.8), layout="constrained")
    grasp, tips, over = figure.subplots(1, 3, width_ratios=[1.0, 1.0, 1.35])
    shown = sp.simulate(carried(grip.scene, SLOW), DT, record=("state", "multipliers", "contact"))
    # A move by minimum jerk has its peak at this share of its duration.
    lift, first = times(SLOW)[1] - BEGIN, 0.5 - 0.5 / np.sqrt(3.0)
    sp.plot.snapshot(shown, BEGIN + first * lift, grasp)
    grasp.get_legend().remove()
    grasp.set_title("at the peak of the lift", loc="left")
    depth = np.linspace(0.0, law.compression[-1], 101)
    force, mm = law.predicted(depth), 1e3 * depth
    tips.fill_between(mm, factors[0] * force, factors[-1] * force, color=PALE, label="batches")
    tips.plot(mm, force, color=RED, label=f"law, misfit {100.0 * law.misfit:.1f} %")
    tips.plot(1e3 * law.compression, law.force, "o", color=BLACK, markersize=2.5, label="measured")
    tips.set(xlabel="compression $d_n$ [mm]", ylabel="force on a flat plate [N]", ylim=(0.0, None))
    tips.legend(loc="upper left")
    for name, colour, style in (("slips", BLUE, "--"), ("lost", BLACK, "-")):
        value, least, most = np.array([(one.value, one.low, one.high) for one in odds[name]]).T
        over.fill_between(middles, least, most, color=colour, alpha=0.25, linewidth=0.0)
        value[value == 0.0] = np.nan
        over.plot(middles, value, style, color=colour, marker=".", label=WORDS[name])
    over.axvline(known, color=RED, linestyle=":", label="all numbers known")
    over.set(xlabel="duration of the move [s]", xlim=(FAST, SLOW), yscale="log", ylim=(2e-3, 1.2))
    over.set_ylabel("probability, 95 % interval")
    over.legend(loc="upper right")
    top, ticks = over.secondary_xaxis("top"), np.linspace(FAST, SLOW, 6)
    top.set_xticks(ticks, [f"{peak(each):.0f}" for each in ticks])
    top.set_xlabel("peak acceleration [m/s$^2$]")
    for x, letter in ((0.01, "a"), (0.32, "b"), (0.61, "c")):
        figure.text(x, 0.98, f"({letter})", va="top")
print("saved", sp.plot.save(figure, given.picture))
