"""How rarely it fails
===================

The probability that a grasp is lost, which plain runs hardly ever show::

    python examples/15_how_rarely_it_fails.py [how_rarely_it_fails.png] [--quick]

Friction, Young's modulus and a push are random. A hundred thousand plain runs would see the loss a
few times; `sp.rare_event` finds its probability, the likeliest failing grasp, and how the
probability changes with the parameters of the distributions.
"""

import argparse
from pathlib import Path

from matplotlib.figure import Figure

import softpinch as sp

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("how_rarely_it_fails.png"))
parser.add_argument("--quick", action="store_true", help="fewer runs")
given = parser.parse_args()

scene = sp.Scene(
    contact="unilateral",
    friction=0.8,
    hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),  # kg
    grasped=sp.GraspedObject(height=0.049),  # m, so that the object can be lost
    disturbances=[sp.Pulse(time=0.2, duration=0.01)],
    duration=0.4,
)
vary = {
    "friction": sp.LogNormal(0.8, 0.1),
    "hand.tip.youngs_modulus": sp.LogNormal(0.30e6, 0.15),  # Pa
    "disturbances.0.force": sp.Normal((0.0, 0.0), (25.0, 25.0)),  # N
}
runs = 8000 if given.quick else 30_000
found = sp.rare_event(scene, vary, "lost", runs=runs, seed=2, dt=2e-4, progress=False)
print(f"lost with a probability of {found}, as good as {found.plain_runs:.2g} plain ones")
for text in found.warnings:
    print("warning:", text)
for name, share in found.importance.items():
    print(f"  {name}: {100.0 * share:.0f} % of the way to the loss")
slope = found.sensitivity["friction.median"]
print(f"a median friction higher by 0.01 changes ln(probability) by {0.01 * slope:.2f}")
print("the likeliest failing grasp:", found.design_point)

# The design point again, as the object leaves the tips.
lost = sp.simulate(
    scene.with_(found.design_point), 2e-4, record=("state", "multipliers", "contact")
)
print(lost.message)
with sp.plot.styled():
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    way, grasp = figure.subplots(1, 2)
    rows = found.events
    x, y = (rows["disturbances.0.force"][:, k] for k in (0, 1))
    points = way.scatter(x, y, s=2.0, c=rows["friction"], cmap="cividis")
    way.plot(*found.design_point["disturbances.0.force"], "X", color="#D55E00", markersize=7.0)
    way.set(xlabel="push x [N]", ylabel="push y [N]", title="runs that lose the object")
    way.set(xlim=(-170.0, 170.0), ylim=(-170.0, 170.0))  # runs are drawn up to seven deviations
    figure.colorbar(points, ax=way, label="friction [1]")
    sp.plot.snapshot(lost, float(lost.t[-1]), grasp)
print("saved", sp.plot.save(figure, given.picture))
