"""How likely does a grasp hold?
=============================

One thousand different grasps, each pushed from another side::

    python examples/03_how_likely_does_it_hold.py [how_likely.png]

The script draws random parameters and prints two probabilities, with their intervals: that a run
completes, in which a tip may pull and never slips, and that the grasp holds without either. It also
prints the parameter that matters most and the error of the time step. It then repeats one of the
failed runs with all rows.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import softpinch as sp

out = Path(sys.argv[1] if len(sys.argv) > 1 else "how_likely.png")

# The paper's disturbance (ii) pushes for 10 ms with 0.9 N; here the push is up to hundreds of times
# as strong.
scene = replace(sp.paper.disturbance("ii", duration=1.5), friction=1.0)
study = sp.monte_carlo(
    scene,
    runs=1000,
    seed=7,
    dt=2e-4,
    vary={
        "grasped.mass": sp.Normal(0.1, 0.01),
        "hand.tip.youngs_modulus": sp.LogNormal(0.30e6, 0.2),
        "disturbances.0.force": sp.Uniform((-300.0, -300.0), (300.0, 300.0)),
    },
    summaries=("peak_rotation", "min_compression"),
    summaries_after=1.0,  # s, the start of the push
    check_dt=True,
)

print(f"of the {study.model}:")
print(f"it completes with a probability of {study.probability('completed')}")
print(f"it holds with a probability of {study.probability('holds')}")
small = np.hypot(*study["disturbances.0.force"].T) < 200.0
held = study.holds[small]
print(f"pushed with less than 200 N: {np.count_nonzero(held)} of {len(held)} hold")

print("what decides whether it holds, as shares of the variance:")
for path, effect in sp.sensitivity(study, "holds").items():
    says = f"{effect.share:.2f}" if effect.share > effect.noise else "no more than chance"
    print(f"    {path:24} {says}")

step = study.discretisation["peak_rotation"]
print(
    f"the step puts the mean peak rotation off by {np.rad2deg(step.bias):.0e} degrees, "
    f"sampling by {np.rad2deg(step.sampling_error):.0e}"
)

lost = study.failures()[0]
again = lost.replay()  # gives the same bits
print(f"run {lost.run}, again in full ({len(again)} rows): {again.message}")

figure = sp.plot.success_map(study, "disturbances.0.force.0", "disturbances.0.force.1", "holds")
print("saved", sp.plot.save(figure, out))
