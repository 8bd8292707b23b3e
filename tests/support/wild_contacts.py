"""Scenes with unilateral contact whose numbers, starts and pushes are far from anything real."""

from typing import Any

import numpy as np

import softpinch as sp

STATUSES = {
    "completed",
    "crushed",
    "folded",
    "lost",
    "unstable",
    "chattering",
    "no_mode",
    "not_finite",
    "newton_failed",
    "step_too_small",
    "too_many_steps",
}


def _disturbance(random: np.random.Generator, duration: float) -> Any:
    """A disturbance of a random kind, with up to 1 kN."""
    size, angle = 10 ** random.uniform(-1, 3), random.uniform(0, 2 * np.pi)
    push = (float(size * np.cos(angle)), float(size * np.sin(angle)))
    turn = float(random.normal() * 10 ** random.uniform(-3, 1))
    time = float(random.uniform(0, duration))
    kind = random.integers(5)
    if kind == 0:
        return sp.Step(time=time, force=push, moment=turn)
    if kind == 1:
        lasting = float(random.uniform(0.05, 1) * duration)
        return sp.Pulse(time=time, duration=lasting, force=push, moment=turn)
    if kind == 2:
        kick = (0.003 * push[0], 0.003 * push[1])
        return sp.Impulse(time=time, impulse=kick, angular_impulse=0.003 * turn)
    if kind == 3:
        frequency = float(10 ** random.uniform(0, 3.5))
        return sp.Sine(time=time, force=push, moment=turn, frequency_hz=frequency)
    return sp.Noise(
        time=time,
        force_std=(abs(push[0]), abs(push[1])),
        moment_std=abs(turn),
        rate_hz=float(10 ** random.uniform(2, 4)),
        seed=int(random.integers(1000)),
    )


def _friction(random: np.random.Generator) -> tuple[float, float]:
    """None, some, or much, on each side."""
    kinds = random.random(2)
    some = np.where(kinds < 0.6, random.uniform(0, 1.5, 2), random.uniform(0, 10, 2))
    right, left = np.where(kinds < 0.15, 0.0, some)
    return float(right), float(left)


def wild_contact(seed: int, decades: float) -> tuple[sp.Scene, dict[str, Any]]:
    """A scene and options of `simulate`.

    The fingers' roots are moved until the tips are pressed; then each tip may get a gap, an
    overlap, a speed of approach or a speed of slip.

    Args:
        seed: Of all that is drawn.
        decades: How far parameters are from the defaults.
    """
    random = np.random.default_rng([int(10 * decades), seed])

    def near(value: float) -> float:
        return float(value * 10 ** random.uniform(-decades, decades))

    tips = tuple(
        sp.Fingertip(
            radius=near(0.02),
            youngs_modulus=near(3e5),
            normal_viscosity=near(100.0),
            tangential_viscosity=near(100.0),
            tilt_coupling=float(random.choice([1, 1, 0, -1])),
            normal_mass=near(0.03),
            tangential_mass=near(0.03),
        )
        for _ in range(2)
    )
    roots, duration = (0.049, 0.049), float(random.choice([0.002, 0.01, 0.03]))
    fingers = [
        {
            "length": near(0.0762),
            "half_thickness": near(0.0045),
            "mass": near(0.1),
            "inertia": near(5.8e-4),
        }
        for _ in range(2)
    ]
    width = near(0.049)
    grasped = sp.GraspedObject(
        width=width,
        mass=near(0.1),
        inertia=near(4e-5),
        com_offset=float(width * random.uniform(-0.3, 0.3)),
        height=None if random.random() < 0.4 else near(0.049),
    )
    targets = np.deg2rad(random.uniform(-25, 25, (2, 2)))
    fixed: dict[str, Any] = {
        "grasped": grasped,
        "control": tuple(sp.Pid(kp=near(100), kd=near(1), ki=near(1000)) for _ in range(2)),
        "schedule": sp.Schedule.steps([0.0, duration * 0.4], targets),
        "disturbances": [_disturbance(random, duration) for _ in range(random.integers(4))],
        "gravity": float(random.choice([0, 9.81, near(9.81)])),
        "duration": duration,
        "friction": _friction(random),
        "contact": "unilateral",
    }

    def scene(roots: tuple[float, float], **more: Any) -> sp.Scene:
        right, left = (
            sp.Finger(root_offset=root, **finger)
            for root, finger in zip(roots, fingers, strict=True)
        )
        return sp.Scene(hand=sp.Hand(right=right, left=left, tip=tips), **fixed, **more)

    turned = float(0.3 * random.normal())
    pose: dict[str, Any] = {
        "x": 0.0,
        "y": 0.0762,
        "rotation": turned,
        "fingers": 0.3 * random.normal(size=2),
        "shear": 0.003 * random.normal(size=2) * (random.random() < 0.5),
        "velocity": random.normal(size=3) * [0.3, 0.3, 3] * (random.random() < 0.7),
        "finger_rates": random.normal(size=2) * (random.random() < 0.5),
    }
    pressed = [random.uniform(0.02, 0.6) * tip.radius for tip in tips]
    missing = pressed - np.asarray(sp.State.consistent(scene(roots), **pose).q[5:7])
    moved = np.maximum(1e-3, roots - missing / np.cos(turned))
    roots = (float(moved[0]), float(moved[1]))
    start = sp.State.consistent(scene(roots), **pose)
    q, p = np.array(start.q), np.array(start.p)
    for i, tip in enumerate(tips):
        kind = random.random()
        if kind < 0.25:
            q[5 + i] += 0.1 * abs(random.normal()) * tip.radius
        elif kind < 0.35:
            q[5 + i] -= 1e-3 * abs(random.normal()) * tip.radius
        if kind < 0.5:
            p[14 - 9 + i] += 0.3 * random.normal()
        elif kind < 0.6:
            p[16 - 9 + i] += 0.3 * random.normal()
    options: dict[str, Any] = {"formulation": str(random.choice(["csm", "projected"]))}
    if random.random() < 0.4:
        options["method"] = str(random.choice(["dop853", "radau5", "rosenbrock"]))
        options |= {"tolerance": float(10 ** random.uniform(-10, -3)), "max_steps": 5000}
    else:
        methods = ["rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock"]
        options["method"] = str(random.choice(methods))
        options["dt"] = float(10 ** random.uniform(-5, -2.7))
    return scene(roots, initial=sp.State(q, p, check=False)), options
