"""How far can it be pulled? Ever harder pulls on the object, until each of four grips loses it.

    python examples/02_disturbed_grasp.py [disturbed_grasp.png]

Shows: a run that goes on from another's last state, disturbances, lost grasps as results, and what
the answer leaves open: the model's tips do not slip, and the friction for that has to be there.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import softpinch as sp

out = Path(sys.argv[1] if len(sys.argv) > 1 else "disturbed_grasp.png")
figure = Figure(figsize=(7.0, 3.0), layout="constrained")
sag, friction = figure.subplots(1, 2)

for degrees, style in ((2, "o-"), (4, "s--"), (6, "^-."), (8, "D:")):
    grip = sp.Scene(schedule=sp.Schedule.steps([0.0], np.deg2rad([[degrees, degrees]])))
    settled = sp.simulate(grip, record=()).state(-1)
    pulls, sags, needs = [], [], []
    for pull in range(10, 601, 10):
        pulled = replace(
            grip,
            initial=settled,  # it goes on at t = 1 s
            duration=0.5,
            disturbances=(sp.Step(time=settled.time, force=(0.0, -pull)),),
        )
        run = sp.simulate(pulled, record=("state", "multipliers"), every=10)
        if not run.success:
            print(f"held at {degrees} degrees, lost under {pull} N: {run.message}")
            break
        pressing, rubbing = run.multipliers[-1, :2], np.abs(run.multipliers[-1, 2:])
        pulls.append(pull)
        sags.append(1e3 * (settled.q[1] - run.q[-1, 1]))
        needs.append((rubbing / pressing).max())
    sag.plot(pulls, sags, style, markersize=3, label=f"{degrees}°")
    friction.plot(pulls, needs, style, markersize=3, label=f"{degrees}°")

sag.set_ylabel("sag of the object [mm]")
friction.set_ylabel("friction that no-slip needs [1]")
friction.axhline(1.0, color="0.6", linewidth=0.8)  # rubber on plastic, roughly
for axes in (sag, friction):
    axes.set_xlabel("downward pull [N]")
    axes.legend(title="fingers at")
figure.savefig(out, dpi=200)
print("saved", out)
