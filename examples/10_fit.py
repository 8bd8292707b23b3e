"""Fit the tips' parameters
========================

Young's modulus, viscosity and tilt coupling of the tips from a noisy motion::

    python examples/10_fit.py [fit.png] [--data motion.csv]

The measured motion is synthetic, so that the truth is known: a camera sees position and rotation of
the object every 5 ms, with noise. The fingers close, turn the object, and something hits it.
`sp.fit` starts far from the truth and returns values with standard errors. Then some pictures of
the camera are wrong, and at last it only sees the grasp at rest. `--data` also writes the
measured motion as a CSV file for `softpinch fit examples/studies/fit.toml motion.csv`.
"""

import argparse
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

import softpinch as sp

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("fit.png"))
parser.add_argument("--data", type=Path, help="also write the measured motion, a CSV file")
given = parser.parse_args()

# Everything but the tips is known.
E, C, KAPPA = "hand.tip.youngs_modulus", "hand.tip.normal_viscosity", "hand.tip.tilt_coupling"
scene = sp.Scene(
    grasped=sp.GraspedObject(mass=0.1, com_offset=4e-3),
    schedule=sp.Schedule.minimum_jerk([0.0, 0.15], np.deg2rad([[6, 6], [11, 1]]), move_time=0.12),
    disturbances=[sp.Pulse(time=0.32, duration=0.02, force=(8.0, -10.0), moment=0.1)],
    duration=0.5,
)

# The true tips, which the fit does not know, and what the camera measures.
tip = sp.Fingertip(youngs_modulus=4.3e5, normal_viscosity=60.0, tilt_coupling=1.0)
truth = {E: tip.youngs_modulus, C: tip.normal_viscosity, KAPPA: tip.tilt_coupling}
run = sp.simulate(replace(scene, hand=sp.Hand(tip=tip)), dt=1e-4, every=50)
rng = np.random.default_rng(1)
noise = {"position": 2e-5, "rotation": 5e-4}  # m and rad
position = run.q[:, :2] + rng.normal(0.0, noise["position"], (len(run), 2))
rotation = run.q[:, 2] + rng.normal(0.0, noise["rotation"], len(run))
if given.data is not None:
    with given.data.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["t [s]", "x [m]", "y [m]", "theta [rad]"])
        writer.writerows(np.column_stack([run.t, position, rotation]).tolist())
    print("saved", given.data)

# The bounds of E and c span decades, so that they are searched in their logarithm; the scene's
# values, E = 0.3 MPa and c = 100 N s/m, are the start, and a factor of ten off works too.
vary = {E: (3e4, 3e6), C: (6.0, 600.0), KAPPA: (-2.0, 2.0)}
start = {E: 4.3e4, C: 600.0, KAPPA: 0.0}
measured = {"position": position, "rotation": rotation}
fit = sp.fit(scene, run.t, measured, vary, noise=noise, start=start, dt=2e-4)
print(fit)
for path, value in truth.items():
    off = (fit.values[path] - value) / fit.standard_errors[path]
    print(f"  {path}: the truth is {value:g}, {abs(off):.1f} standard errors away")
print("correlations of E, c and kappa:", fit.correlations[np.triu_indices(3, 1)].round(2))
low, high = fit.profile(C).interval
print(f"c by its profile likelihood: {low:.1f} to {high:.1f} N s/m, 95 %")

# One picture in twenty is wrong by half a degree or more.
wrong = rng.choice(len(run), len(run) // 20, replace=False)
spoilt = rotation.copy()
spoilt[wrong] += rng.uniform(0.01, 0.03, len(wrong))
print("E with 5 % of outliers:")
for loss in ("linear", "soft_l1"):
    robust = sp.fit(scene, run.t, measured | {"rotation": spoilt}, vary, noise=noise, loss=loss,
                    dt=2e-4)  # fmt: skip
    print(f"  {loss:8}", robust.lines()[0])

# From the grasp at rest, before it is hit, nobody can tell all three.
rest = (run.t > 0.28) & (run.t < 0.32)
still = sp.fit(scene, run.t[rest], {"position": position[rest]}, vary, noise=2e-5, dt=2e-4)
print("from the position at rest:")
for line in (*still.lines(), *still.messages):
    print(" ", line)

print("saved", sp.plot.save(sp.plot.fit(fit), given.picture))
