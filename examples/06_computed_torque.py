"""Computed torque
===============

A controller of your own follows a smooth path, beside the PID of a scene::

    python examples/06_computed_torque.py [computed_torque.png] [--quick]

The fingers roll the object to and fro along minimum-jerk paths. Every millisecond the controller
reads the state, solves the equations of motion for the torques that give both fingers the wanted
accelerations, and holds these torques until the next sample. The wanted acceleration is that of the
path, plus gains on the errors of the angles, of their rates and of their integrals. The script
compares the angles' errors with those of the default PID, once with the true model and once with a
model whose fingertips are 20 % too soft.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import softpinch as sp
from softpinch.plot.style import BLACK, GREEN, LINES, PAGE, RED

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("computed_torque.png"))
parser.add_argument("--quick", action="store_true", help="only the first move")
given = parser.parse_args()

PERIOD = 1e-3  # s
MOVE = 0.2  # s, duration of each move
STARTS = np.array([0.0, 0.1]) if given.quick else np.array([0.0, 0.1, 0.4, 0.7])
ANGLES = np.deg2rad([[6, 6], [20, -8], [-8, 20], [6, 6]])[: len(STARTS)]
DURATION = STARTS[-1] + MOVE + 0.1
BANDWIDTH = 200.0  # rad/s, the triple pole of the errors


def path(t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The angles (2,) of the path, their rates and accelerations; `Schedule.minimum_jerk`'s."""
    k = int(np.searchsorted(STARTS, t, side="right")) - 1
    if k <= 0:
        return ANGLES[0], np.zeros(2), np.zeros(2)
    way, s = ANGLES[k] - ANGLES[k - 1], min((t - STARTS[k]) / MOVE, 1.0)
    return (
        ANGLES[k - 1] + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        way * (30 * s**2 - 60 * s**3 + 30 * s**4) / MOVE,
        way * (60 * s - 180 * s**2 + 120 * s**3) / MOVE**2,
    )


def inverse_dynamics(model: sp.Scene, seen: sp.Observation, wanted: np.ndarray) -> np.ndarray:
    """The torques (2,), N m, that give the fingers the wanted accelerations (2,), rad/s^2.

    M a = f + T torque + Phi^T lambda, Phi a = -b, and the fingers' rows of a are given: 15 linear
    equations for 9 accelerations, 4 multipliers and 2 torques.
    """
    terms = sp.evaluate(model, seen.t, seen.q, seen.p)
    phi = terms.constraint_matrix
    fingers = np.eye(9)[3:5]
    matrix = np.zeros((15, 15))
    matrix[:9] = np.hstack([terms.mass_matrix, -phi.T, -fingers.T])
    matrix[9:13, :9], matrix[13:, :9] = phi, fingers
    right = np.concatenate([terms.forces.total, -terms.constraint_rate, wanted])
    return np.linalg.solve(matrix, right)[13:]


def computed_torque(model: sp.Scene) -> Callable[[sp.Observation], np.ndarray]:
    """A controller that relies on a model of the grasp."""
    gains = 3 * BANDWIDTH**2, 3 * BANDWIDTH, BANDWIDTH**3
    integral = np.zeros(2)

    def torque(seen: sp.Observation) -> np.ndarray:
        nonlocal integral
        angle, rate, acceleration = path(seen.t)
        error, error_rate = angle - seen.q[3:5], rate - seen.p[3:5]
        integral = integral + PERIOD * error
        corrected = gains[0] * error + gains[1] * error_rate + gains[2] * integral
        return inverse_dynamics(model, seen, acceleration + corrected)

    return torque


def controlled(scene: sp.Scene, controller: Callable[[sp.Observation], np.ndarray]) -> sp.Run:
    """The run of a scene under a controller, with its whole recording."""
    sim = sp.Simulator(scene, PERIOD)
    seen = sim.observation
    while seen.status == "running":
        seen = sim.step(controller(seen))
    return sim.run()


def error(run: sp.Run) -> np.ndarray:
    """Degrees by which the fingers are off the path (n, 2)."""
    return np.rad2deg(run.q[:, 3:5] - [path(t)[0] for t in run.t])


held = sp.Scene(schedule=sp.Schedule.steps([0.0], ANGLES[:1]))
rest = replace(sp.simulate(held, record=()).state(-1), time=0.0, grid=None)
schedule = sp.Schedule.minimum_jerk(STARTS, ANGLES, MOVE)
by_pid = replace(held, schedule=schedule, initial=rest, duration=DURATION)
by_torque = replace(
    by_pid,
    control=sp.Torque(),
    schedule=sp.Schedule.steps([0.0], [[0.0, 0.0]]),
    initial=replace(rest, integral=(0.0, 0.0)),
)
tip = by_torque.hand.tip
soft = replace(tip, youngs_modulus=0.8 * tip.youngs_modulus)
wrong = replace(by_torque, hand=replace(by_torque.hand, tip=soft))

runs = {
    "PID": sp.simulate(by_pid, record=("state", "multipliers", "residuals", "energy")),
    "computed torque, model 20 % too soft": controlled(by_torque, computed_torque(wrong)),
    "computed torque, true model": controlled(by_torque, computed_torque(by_torque)),
}
print(
    "error of the fingers' angles, degrees: largest, largest after the first 0.1 s, RMS; least grip"
)
for name, run in runs.items():
    off = np.abs(error(run))
    moving = off[run.t > STARTS[1]]
    print(
        f"    {name:36} {off.max():8.5f} {moving.max():8.5f} {np.sqrt((off**2).mean()):8.5f} "
        f"{run.multipliers[:, :2].min():5.1f} N  {run.status}"
    )
    run.check()
best = runs["computed torque, true model"]
turned = np.rad2deg(best.q[:, 2])
print(f"the object turns between {turned.min():.1f} and {turned.max():.1f} degrees")

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 4.6), layout="constrained")
    motion, torque, off = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 1.3))
    t = best.t
    for k, side in enumerate(("right finger", "left finger")):
        motion.plot(t, np.rad2deg(best.q[:, 3 + k]), label=side, **LINES[k])
        torque.plot(t, best.torque[:, k], label=side, **LINES[k])
    motion.plot(t, turned, color=BLACK, linestyle=":", label="object's rotation")
    motion.set_ylabel("angle [deg]")
    torque.set_ylabel("computed torque [N m]")
    styles = ((RED, (0, (4, 1.5))), (GREEN, (0, (5, 1.2, 1.2, 1.2))), (BLACK, "-"))
    for (name, run), (color, dashes) in zip(runs.items(), styles, strict=True):
        largest = np.abs(error(run)).max(1)
        off.semilogy(run.t, largest, color=color, linestyle=dashes, label=name)
    off.set_ylabel("larger error\nof both angles [deg]")
    off.set_ylim(1e-6, 10.0)
    off.set_xlabel("time [s]")
    for axes in (motion, torque, off):
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
print("saved", sp.plot.save(figure, given.picture))
