"""Force control with a delay
==========================

An admittance controller at 1 kHz with a delay of 3 ms, and the gain at which it gets unstable::

    python examples/07_admittance.py [admittance.png] [--quick]

Each finger has a stiff inner loop on its angle. An outer loop moves the angle that the inner loop
holds, in proportion to the error of the measured grip force: theta_r' = gain * (wanted - measured).
That is an admittance without inertia, which presses gently and with the wanted force. Both loops
are one `SampledController`, which the core computes.

The delay limits the gain. The script predicts the limit from the linear model of the grasp at rest
(`sp.linearize`), sampled with a zero-order hold; and it finds the limit by simulation, with
ensembles over the gain.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm
from scipy.optimize import brentq

import softpinch as sp
from softpinch.plot.style import BLACK, GREEN, PAGE, RED

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("admittance.png"))
parser.add_argument("--quick", action="store_true", help="fewer gains in the ensemble")
given = parser.parse_args()

PERIOD = 1e-3  # s
LATE = 3  # periods of delay
KP, KD = 8.0, 0.04  # inner loop, N m/rad and N m s/rad
ONE, ZERO = np.eye(2), np.zeros((2, 2))
MEASURES = ("angle", "angle_rate", "multipliers", "target")

# The grasp at rest, its holding torques and its grip forces.
settled = sp.simulate(
    sp.Scene(duration=3.0, schedule=sp.Schedule.steps([0.0], [[0.02, 0.02]])),
    method="radau5",
    tolerance=1e-9,
    record=("torque", "multipliers"),
)
TORQUE, FORCE = settled.torque[-1], settled.multipliers[-1, :2]
REST = sp.State(settled.state().q, check=False)
plant = sp.Scene(
    control=sp.Torque(), schedule=sp.Schedule.steps([0.0], [TORQUE]), initial=REST, duration=1.0
)


def controller(gain: float) -> sp.SampledController:
    """Both loops; its states are the angles theta_r of the inner loop, its targets grip forces."""
    # y: angles, their rates, lambda^H, lambda^N, targets; two numbers each.
    return sp.SampledController(
        PERIOD,
        A=ONE,
        B=PERIOD * gain * np.hstack([ZERO, ZERO, -ONE, ZERO, ONE]),
        C=KP * ONE,
        D=np.hstack([-KP * ONE, -KD * ONE, ZERO, ZERO, ZERO]),
        measures=MEASURES,
        delay=LATE * PERIOD,
        initial_torque=tuple(TORQUE),
        initial_state=REST.q[3:5] + TORQUE / KP,
    )


def under_control(gain: float, duration: float) -> sp.Scene:
    """The grasp at rest, which is to press 10 % more from 50 ms on."""
    wanted = sp.Schedule.steps([0.0, 0.05], [FORCE, 1.1 * FORCE])
    return replace(plant, control=controller(gain), schedule=wanted, duration=duration)


def sampled_model() -> tuple[np.ndarray, ...]:
    """x_(k+1) = F x_k + G u with held torques u, which give grip forces H x + J u."""
    model = sp.linearize(plant, REST, inputs="torque", outputs="multipliers")
    held = expm(PERIOD * np.block([[model.A, model.B], [np.zeros((2, 14))]]))
    return held[:12, :12], held[:12, 12:], model.C[:2], model.D[:2]


F, G, H, J = sampled_model()


def growth(gain: float) -> float:
    """Factor by which the fastest-growing mode of the sampled loop grows in a period, minus one."""
    # States: x, theta_r, and the outputs of the last LATE + 1 samples, the newest first.
    n = 14 + 2 * (LATE + 1)
    loop = np.zeros((n, n))

    def output(age: int) -> slice:
        return slice(12 + 2 * age, 14 + 2 * age)

    loop[:12, :12], loop[:12, output(LATE)] = F, G
    loop[12:14, 12:14] = ONE
    loop[12:14, :12], loop[12:14, output(LATE + 1)] = -PERIOD * gain * H, -PERIOD * gain * J
    loop[output(1), 12:14] = KP * ONE
    loop[output(1), 3:5], loop[output(1), 8:10] = -KP * ONE, -KD * ONE
    for age in range(1, LATE + 1):
        loop[output(age + 1), output(age)] = ONE
    modes = np.linalg.eigvals(loop)
    # The shears at rest are free (two neutral modes); the object swings back very slowly.
    return float(np.abs(modes[np.abs(modes - 1.0) > 1e-6]).max() - 1.0)


limit = brentq(growth, 0.1, 50.0)
print(f"predicted limit of the gain: {limit:.4f} rad/(N s)")

# Ensembles over the gain, which is in the entries of B. An unstable loop swings more in the last
# quarter of a longer run than in that of a shorter one.
gains = limit * np.linspace(0.99, 1.01, 11 if given.quick else 101)
entries = {"control.B.0.4": -1.0, "control.B.1.5": -1.0, "control.B.0.8": 1.0, "control.B.1.9": 1.0}
vary = {path: sign * PERIOD * gains for path, sign in entries.items()}
steady = sp.simulate(under_control(0.3 * limit, 1.0), record="torque").torque[-1].max()
swings = []
for duration in (0.6, 1.2):
    many = sp.monte_carlo(
        under_control(limit, duration),
        vary=vary,
        summaries=("peak_torque",),
        summaries_after=0.75 * duration,
        progress=False,
    )
    swings.append(np.where(many.status == "completed", many["peak_torque"] - steady, np.inf))
found = gains[swings[1] > swings[0]].min()
print(f"found by simulation:         {found:.4f} rad/(N s), steps of {np.diff(gains)[0]:.4f}")

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 3.6), layout="constrained")
    force, torque = figure.subplots(2, 1, sharex=True)
    for share, color, dashes in ((0.3, BLACK, "-"), (0.9, GREEN, (0, (5, 1.2))), (1.1, RED, ":")):
        run = sp.simulate(under_control(share * limit, 0.25), record=("multipliers", "torque"))
        name = f"{share:.1f} of the predicted limit"
        force.plot(run.t, run.multipliers[:, 0], color=color, linestyle=dashes, label=name)
        torque.plot(run.t, run.torque[:, 0], color=color, linestyle=dashes)
    force.axhline(1.1 * FORCE[0], color=BLACK, linewidth=0.5)
    force.set_ylim(0.5 * FORCE[0], 1.7 * FORCE[0])
    force.set_ylabel("grip force\nof the right tip [N]")
    torque.set_ylim(TORQUE[0] - 0.2, TORQUE[0] + 0.2)
    torque.set_ylabel("torque on the\nright finger [N m]")
    torque.set_xlabel("time [s]")
    force.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
print("saved", sp.plot.save(figure, given.picture))
