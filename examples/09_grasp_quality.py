"""Grasp quality
=============

How hard a grasp can be pushed: the slow limit in every direction, beside sudden pushes::

    python examples/09_grasp_quality.py [grasp_quality.png] [--quick]

`sp.wrench_limits` follows the grasp at rest while a force on the object grows slowly, until a
contact gives way. Its smallest value is a measure of the grasp's quality. A sudden force
overshoots: `sp.monte_carlo` applies forces of random directions and sizes from one instant to the
next, to the same grasp, whose tips can slip and open; the sizes are 0.3 to 1.3 of the slow limit.
The figure shows both. Dots ("held") are pushes in which neither tip ever slipped; of the others
most keep the object.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import softpinch as sp

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("grasp_quality.png"))
parser.add_argument("--quick", action="store_true", help="fewer pushes")
given = parser.parse_args()

# Tips that push, stick as far as friction lets them, and open; a box that is heavier on the right.
scene = sp.Scene(
    schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]])),
    grasped=sp.GraspedObject(mass=0.5, inertia=2e-4, com_offset=4e-3, height=0.049),
    contact="unilateral",
    friction=0.6,
)
rest = sp.equilibrium(scene)
print(rest)

# The slow limit.
limits = sp.wrench_limits(rest)
print(limits)
for name, degrees in (("right", 0), ("up", 90), ("left", 180), ("down", 270)):
    k = degrees // 5
    print(f"  {name:>5}: {limits.magnitude[k]:6.1f} N, then {limits.limit[k]}")
print(f"quality of the grasp, the weakest direction: {limits.weakest:.1f} N")

# Which grip is best? The quality over the angle of both fingers.
for angle in (2.0, 4.0, 6.0, 8.0):
    closed = replace(scene, schedule=sp.Schedule.steps([0.0], np.deg2rad([[angle, angle]])))
    print(f"  at {angle:.0f} degrees: {sp.wrench_limits(closed).weakest:6.1f} N")

# Sudden forces on the grasp at rest. It held if neither tip slipped or opened.
runs = 300 if given.quick else 2000
rng = np.random.default_rng(9)
direction = rng.uniform(0.0, 2.0 * np.pi, runs)
share = rng.uniform(0.3, 1.3, runs)
# The slow limit in the direction of each push, from those of the directions beside it.
slow = np.interp(direction, np.deg2rad(5.0 * np.arange(73)), limits.magnitude[np.arange(73) % 72])
size = share * slow
force = size[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
assert rest.state is not None
pushed = replace(
    scene,
    initial=replace(rest.state, time=0.0),
    disturbances=[sp.Step(time=0.0)],
    duration=0.3,
)
ensemble = sp.monte_carlo(pushed, vary={"disturbances.0.force": force}, dt=2e-4, progress=False)
held = ~ensemble.happened("slipping") & (ensemble.status == "completed")
holds = ensemble.happened("holds")
print("share of the slow limit -> share of sudden pushes that never slip, and that keep the object")
for low in np.arange(0.3, 1.25, 0.1):
    some = (share >= low) & (share < low + 0.1)
    print(f"  {low:.1f} to {low + 0.1:.1f}: {held[some].mean():6.2f} {holds[some].mean():6.2f}")

print("saved", sp.plot.save(sp.plot.wrench_limits(limits, ensemble, what=held), given.picture))
