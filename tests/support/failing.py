"""Studies of every kind, in which every run fails."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import softpinch as sp
from scenes import uneven

DRAW = np.random.default_rng(3)
# No grasp holds against it.
SHOVE = sp.Step(time=0.0113, force=(900.0, -700.0), moment=0.1)
SHORT = sp.Scene(disturbances=(SHOVE,), duration=0.06)
FREE = {"tolerance": 1e-7, "formulation": "nullspace"}


def started() -> sp.Scene:
    """A start in the middle of a grasp, off the constraints as `csm` drifts."""
    state = sp.simulate(sp.Scene(duration=0.02), dt=1e-3).state()
    return replace(SHORT, initial=state, disturbances=[replace(SHOVE, time=0.025)])


def gone_on() -> sp.Scene:
    """A start with one tip that slips and one that is free, between low faces."""
    scene = sp.Scene(
        grasped=sp.GraspedObject(height=0.049),
        disturbances=[replace(SHOVE, force=(500.0, -500.0))],
        duration=0.0125,
        contact="unilateral",
        friction=(0.4, 0.6),
    )
    run = sp.simulate(scene, dt=1e-4)
    return replace(scene, initial=run.state(), duration=0.06)


def scattered(low: float, high: float, *shape: int) -> np.ndarray:
    return DRAW.uniform(low, high, (4, *shape))


KINDS: dict[str, tuple[sp.Scene, dict[Any, Any], dict[str, Any]]] = {
    "mass": (SHORT, {"grasped.mass": sp.Normal(0.1, 0.01)}, {}),
    "nothing": (SHORT, {}, {}),
    "noise": (
        replace(SHORT, disturbances=[sp.Noise(force_std=(900.0, 500.0), moment_std=0.1,
                                              rate_hz=317.0)]),
        {"disturbances.0.force_std": scattered(800.0, 900.0, 2), "grasped.mass": [0.1] * 4}, {},
    ),
    "noise of its own seed": (
        replace(SHORT, disturbances=[SHOVE, sp.Noise(force_std=9.0, moment_std=0.0, rate_hz=99.0,
                                                     duration=0.03, seed=5, run=6)]),
        {"disturbances.1.duration": scattered(0.02, 0.03)}, {"seed": 2**64 - 1},
    ),
    "one tip becomes two": (
        SHORT,
        {"hand.tip.left.radius": scattered(0.02, 0.021),
         "hand.tip.youngs_modulus": scattered(3e5, 4e5),
         "control.kp": scattered(90.0, 110.0), "control.right.ki": scattered(9e2, 1e3)}, {},
    ),
    "pairs": (
        replace(uneven(), disturbances=[SHOVE]),
        {"hand.tip.right.tangential_mass": scattered(0.05, 0.1),
         "control.left.kd": scattered(0.9, 1.4), "hand.left.length": scattered(0.069, 0.07)},
        {"formulation": "projected"},
    ),
    "paths together": (
        SHORT, {("grasped.mass", "disturbances.0.force"): scattered(0.1, 0.2, 3) * [1, 3e3, -3e3]},
        {},
    ),
    "numbers that were None": (
        SHORT, {"friction": scattered(0.2, 0.9), "hand.tip.normal_mass": scattered(0.05, 0.1)}, {},
    ),
    "schedule": (
        replace(SHORT, schedule=sp.Schedule.minimum_jerk([0.0, 0.01], [[0.1, 0.1], [0.2, 0.1]],
                                                         move_time=0.04)),
        {"schedule.angles.1.0": scattered(0.1, 0.2), "schedule.move_time": scattered(0.02, 0.04),
         "schedule.times": np.array([[0.0, 0.01], [0.001, 0.02], [0.0, 0.03], [0.0, 0.013]])}, {},
    ),
    "state": (
        started(),
        {"initial.p.0": scattered(-0.01, 0.01), "initial.integral": scattered(0.0, 1e-3, 2),
         "duration": scattered(0.05, 0.07)},
        {"stabilization": sp.Stabilization(900.0, 700.0)},
    ),
    "driven": (
        replace(SHORT, fingers="driven", schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.01], [[0.1, 0.1], [0.12, 0.1]], move_time=0.03)),
        {"schedule.angles": sp.Uniform(0.1, 0.11), "gravity": scattered(9.7, 9.9)},
        {"formulation": "nullspace", "method": "implicit_midpoint"},
    ),
    "unilateral": (
        replace(SHORT, contact="unilateral", friction=0.5, grasped=sp.GraspedObject(height=0.049)),
        {"friction.left": scattered(0.2, 0.9), "grasped.mass": scattered(0.09, 0.11)}, {},
    ),
    "unilateral, started": (
        gone_on(), {"friction": scattered(0.2, 0.9), "initial.p.1": scattered(-0.01, 0.01)},
        {"tolerance": 1e-7, "method": "dop853"},
    ),
    "dop853": (SHORT, {"grasped.width": scattered(0.049, 0.05)}, {**FREE, "method": "dop853"}),
    "radau5": (SHORT, {"grasped.com_offset": scattered(-0.002, 0.002)},
               {**FREE, "method": "radau5"}),
    "too many steps": (SHORT, {"grasped.mass": scattered(0.1, 0.2)},
                       {**FREE, "method": "rosenbrock", "max_steps": 9}),
    "not finite": (SHORT, {"grasped.inertia": [1e-300] * 4}, {"stop_on": ()}),
}  # fmt: skip


@cache
def study(kind: str) -> sp.Ensemble:
    scene, vary, how = KINDS[kind]
    arguments: dict[str, Any] = {"seed": 11, **how}
    if "tolerance" not in how:
        arguments["dt"] = 5e-4
    return sp.monte_carlo(scene, 4, vary=vary, summaries=(), progress=False, **arguments)
