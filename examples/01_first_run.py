"""First run
=========

Close the fingers on an object, move it sideways, and check the accuracy::

    python examples/01_first_run.py [first_run.png]

The script defines a scene in a few lines. It prints how the run ended, where the object is, which
limits of the model were exceeded and how large the errors are, and plots everything that was
recorded.
"""

import sys
from pathlib import Path

import numpy as np

import softpinch as sp

out = Path(sys.argv[1] if len(sys.argv) > 1 else "first_run.png")

scene = sp.Scene(
    # Finger 1 is the right one. Both close to 6 degrees, and at 1 s they move the object left.
    schedule=sp.Schedule.steps([0.0, 1.0], np.deg2rad([[6, 6], [20, -10]])),
    duration=2.0,
)
run = sp.simulate(scene, record=("state", "multipliers", "residuals", "energy"))

x, y, theta = run.q[-1, :3]
print(f"{run.status}: {run.message}")
print(
    f"the object is at {1e3 * x:.2f}, {1e3 * y:.2f} mm, turned by {np.rad2deg(theta):.2f} degrees"
)
for name, time in run.violations.items():
    print(f"from {time:g} s on a limit of the model is exceeded: {name}")
print(f"C^H is off by up to {np.abs(run.residuals[:, :2]).max():.0e} m")
print(f"the energy ledger is off by up to {np.abs(run.energy.closure).max():.0e} J")
run.check()  # raises if an invariant is violated

# At the step at 1 s the left tip has to pull for half a millisecond. A smooth move avoids this.
smooth = sp.Schedule.minimum_jerk([0.0, 1.0], np.deg2rad([[6, 6], [20, -10]]), move_time=0.3)
gentle = sp.simulate(sp.Scene(schedule=smooth, duration=2.0), record=("state", "multipliers"))
print(f"a smooth move instead presses with {gentle.multipliers[:, :2].min():.1f} N at least")

print("saved", sp.plot.save(sp.plot.run(run), out))
