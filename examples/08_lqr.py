"""LQR
===

A controller that is designed on the linear model of a grasp and run on the nonlinear grasp::

    python examples/08_lqr.py [lqr.png] [--quick]

`sp.linearize` gives the open loop about the grasp at rest: torques in, pose and fingers out,
without the two neutral states. Torques that are only held let the object go: one pole is unstable.
python-control samples the model with a zero-order hold and computes the gains; one
`sp.SampledController` at 1 kHz runs them in the core.

Linear design says nothing about large deviations. So impulses of random direction and size hit the
object, in an ensemble for each controller. How often does the grasp come back? And how often does
it come back without a tip that would have to pull, which a real tip cannot do? The bands of the
figure are 95 % confidence intervals of these shares.
"""

import argparse
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import control
import numpy as np
from matplotlib.figure import Figure

import softpinch as sp
from softpinch.plot.style import BLACK, PAGE, RED, tag

parser = argparse.ArgumentParser()
parser.add_argument("picture", nargs="?", type=Path, default=Path("lqr.png"))
parser.add_argument("--quick", action="store_true", help="fewer runs in the ensembles")
given = parser.parse_args()

PERIOD = 1e-3  # s
MEASURES = ("position", "rotation", "angle", "velocity", "rotation_rate", "angle_rate")
# Deviations that cost as much as one another: of x, y, m; of theta, theta_1, theta_2, rad; of their
# rates; and of a torque, N m.
POSE, RATES = [1e-3, 1e-3, 0.02, 0.02, 0.02], [0.1, 0.1, 2.0, 2.0, 2.0]
TORQUE = 0.5
LARGEST = 4.0  # N s, the largest impulse
LEVER = 2e-3  # m, the impulse's largest lever

# The grasp at rest, under its PID.
scene = sp.Scene(schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 6]])))
plant = sp.linearize(scene, inputs="torque", outputs=("pose", "fingers"), reduced=True)
rest = replace(plant.state, time=0.0)
print(f"open loop: {len(plant.states)} states, fastest growth {plant.poles.real.max():.1f} 1/s")

# The states of the plant are, in this order, what the controller measures.
sampled = control.c2d(plant.to_control(), PERIOD)
cost = np.diag(1.0 / np.array(POSE + RATES) ** 2)
gain, _, poles = control.dlqr(sampled, cost, np.eye(2) / TORQUE**2)
decay = -np.log(np.abs(poles).max()) / PERIOD
print(f"closed loop: slowest decay {decay:.1f} 1/s")
lqr = sp.SampledController(
    PERIOD,
    # Without an input the controller's states stay what they are: the constant part of the torque.
    A=np.eye(2),
    B=np.zeros((2, 10)),
    C=np.eye(2),
    D=-gain,
    measures=MEASURES,
    initial_torque=tuple(plant.input_values),
    initial_state=plant.input_values + gain @ plant.state_values,
)
SCENES = {
    "PID": replace(scene, initial=rest, duration=1.0),
    "LQR": replace(scene, control=lqr, initial=sp.State(rest.q), duration=1.0),
}

# A small kick: the motion is that of the linear model.
velocity = np.array([0.03, -0.02, 1.0])
kicked = sp.State.consistent(
    scene,
    x=rest.q[0],
    y=rest.q[1],
    rotation=rest.q[2],
    fingers=rest.q[3:5],
    shear=rest.q[7:],
    velocity=velocity,
)
run = sp.simulate(replace(SCENES["LQR"], initial=kicked, duration=0.02), dt=1e-4, every=10)
x, predicted = np.concatenate([np.zeros(5), velocity, np.zeros(2)]), []
for _ in run.t:
    predicted.append(x[:5])
    x = (sampled.A - sampled.B @ gain) @ x
off = np.abs(run.q[:, :5] - rest.q[:5] - predicted).max(0) / np.abs(predicted).max(0)
print(f"after a small kick: within {off.max():.2%} of the linear motion for {run.t[-1]:g} s")

# The same random impulses for both controllers.
runs = 400 if given.quick else 20_000
random = np.random.default_rng(8)
size, direction = LARGEST * random.uniform(size=runs), random.uniform(0.0, 2.0 * np.pi, runs)
impulses = {
    "disturbances.0.impulse.0": size * np.cos(direction),
    "disturbances.0.impulse.1": size * np.sin(direction),
    "disturbances.0.angular_impulse": size * LEVER * random.uniform(-1.0, 1.0, runs),
}
edges = np.linspace(0.0, LARGEST, 9 if given.quick else 21)
shares: dict[str, dict[str, list[sp.Estimate]]] = {}
for name, grasp in SCENES.items():
    hit = replace(grasp, disturbances=[sp.Impulse(time=0.0)])
    many = sp.monte_carlo(hit, vary=impulses, dt=2e-4, summaries="final_state", progress=False)
    moved = np.abs(many["final_state"][:, :3] - rest.q[:3])
    back = (many.status == "completed") & (moved < [5e-3, 5e-3, 0.1]).all(1)
    shares[name] = {
        what: [
            sp.Estimate.of(happened[(low <= size) & (size < high)]) for low, high in pairwise(edges)
        ]
        for what, happened in (("comes back", back), ("without pulling", back & many.holds))
    }
    total = {what: np.mean([one.value for one in found]) for what, found in shares[name].items()}
    print(
        f"{name}: comes back from {total['comes back']:.1%} of the impulses up to {LARGEST:g} N s, "
        f"from {total['without pulling']:.1%} without pulling"
    )

with sp.plot.styled():
    figure = Figure(figsize=(PAGE, 3.2), layout="constrained")
    motion, odds = figure.subplots(1, 2)
    push = sp.Impulse(time=0.01, impulse=(0.4, 0.2), angular_impulse=4e-4)
    middle = 0.5 * (edges[1:] + edges[:-1])
    for (name, grasp), color in zip(SCENES.items(), (BLACK, RED), strict=True):
        run = sp.simulate(replace(grasp, disturbances=[push], duration=0.15), dt=1e-4)
        motion.plot(1e3 * run.t, np.rad2deg(run.q[:, 2] - rest.q[2]), color=color, label=name)
        for (what, found), dashes in zip(shares[name].items(), ("-", (0, (4, 1.5))), strict=True):
            odds.plot(middle, [one.value for one in found], color=color, linestyle=dashes,
                      label=f"{name}, {what}")  # fmt: skip
            odds.fill_between(middle, [one.low for one in found], [one.high for one in found],
                              color=color, alpha=0.15, linewidth=0)  # fmt: skip
    motion.set_xlabel("time [ms]")
    motion.set_ylabel("rotation after an impulse\nof 0.45 N s and 0.4 mN m s [deg]")
    odds.set_xlabel("impulse [N s]")
    odds.set_ylabel("share of runs, with its 95 % interval")
    odds.set_ylim(0.0, 1.05)
    for axes, letter in ((motion, "a"), (odds, "b")):
        tag(axes, letter)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
print("saved", sp.plot.save(figure, given.picture))
