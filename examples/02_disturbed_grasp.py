"""How hard can a grasp be pulled?
===============================

Pull the object harder and harder, until each of four grips loses it::

    python examples/02_disturbed_grasp.py [disturbed_grasp.png]

The script starts runs from the last state of another run, adds disturbances, and treats a lost
grasp as a result. It also shows a limit of the answer: the model's tips do not slip, so the contact
must provide the friction. The largest friction is needed some milliseconds after the pull begins,
and the contact may lack it long before the grasp is lost.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import softpinch as sp

out = Path(sys.argv[1] if len(sys.argv) > 1 else "disturbed_grasp.png")
LASTS = 0.5  # s
FRICTION = 1.0  # coefficient of friction of rubber on plastic, roughly

with sp.plot.styled():
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    sag, friction = figure.subplots(1, 2)

    for degrees, style in ((2, "o-"), (4, "s--"), (6, "^-."), (8, "D:")):
        grip = sp.Scene(schedule=sp.Schedule.steps([0.0], np.deg2rad([[degrees, degrees]])))
        settled = sp.simulate(grip, record=()).state(-1)
        pulls, sags, needs = [], [], []
        for pull in range(10, 601, 10):
            pulled = replace(
                grip,
                initial=settled,  # the run starts at t = 1 s
                duration=LASTS,
                disturbances=(sp.Step(time=settled.time, force=(0.0, -pull)),),
            )
            run = sp.simulate(pulled, record=("state", "multipliers"))
            if not run.success:
                print(f"held at {degrees} degrees, lost under {pull} N: {run.message}")
                break
            pressing, rubbing = run.multipliers[:, :2], np.abs(run.multipliers[:, 2:])
            pulls.append(pull)
            sags.append(1e3 * (settled.q[1] - run.q[-1, 1]))
            needs.append((rubbing / pressing).max())  # no tip has to pull in these runs
        sag.plot(pulls, sags, style, label=f"{degrees}°")
        friction.plot(pulls, needs, style, label=f"{degrees}°")
        slips = [pull for pull, need in zip(pulls, needs, strict=True) if need > FRICTION]
        if slips:
            print(f"    with a friction of {FRICTION:g} it would slip from {slips[0]} N on")

    sag.set_ylabel(f"sag of the object after {LASTS:g} s [mm]")
    friction.set_ylabel("largest friction that no-slip needs [1]")
    friction.axhline(FRICTION, color="0.6", linewidth=0.8)
    friction.text(400, 1.03, "rubber, roughly", color="0.35", fontsize=8.0, ha="right")
    for axes in (sag, friction):
        axes.set_xlabel("downward pull [N]")
        axes.legend(title="fingers at", loc="lower right")
print("saved", sp.plot.save(figure, out))
