"""Random hands, objects, moves and pushes as a gripper may have them, in both kinds of contact."""

from typing import Any

import numpy as np

import softpinch as sp


def random_pinch(rng: np.random.Generator, contact: str, duration: float = 0.15) -> sp.Scene:
    """Unlike tips and fingers of light or heavy surfaces, often switched, pushed or struck."""

    def scaled(value: float, decades: float = 0.4) -> float:
        return float(value * 10.0 ** rng.uniform(-decades, decades))

    surface = scaled(0.02, 0.6)

    def tip() -> sp.Fingertip:
        return sp.Fingertip(
            radius=scaled(0.02, 0.15),
            youngs_modulus=scaled(3e5, 0.6),
            normal_viscosity=scaled(100.0, 0.6),
            tangential_viscosity=scaled(100.0, 0.6),
            normal_mass=scaled(surface, 0.2),
            tangential_mass=scaled(surface, 0.2),
            tilt_coupling=float(rng.choice([1.0, 0.0, -1.0])),
        )

    def finger() -> sp.Finger:
        usual = sp.Finger()
        return sp.Finger(
            length=scaled(usual.length, 0.1),
            half_thickness=scaled(usual.half_thickness, 0.15),
            mass=scaled(usual.mass, 0.2),
        )

    usual = sp.GraspedObject()
    width = scaled(usual.width, 0.08)
    grasped = sp.GraspedObject(
        width=width,
        mass=scaled(0.1),
        inertia=scaled(usual.inertia),
        com_offset=width * rng.uniform(-0.1, 0.1),
        height=None if rng.random() < 0.3 else scaled(0.06, 0.2),
    )
    press, turn = rng.uniform(2.0, 8.0), rng.uniform(-8.0, 8.0)
    times, targets = [0.0], [[press + turn, press - turn]]
    if rng.random() < 0.6:
        times.append(duration * rng.uniform(0.2, 0.7))
        targets.append([rng.uniform(-5.0, 15.0), rng.uniform(-5.0, 15.0)])
    pushes: list[sp.Disturbance] = []
    if rng.random() < 0.7:
        size, angle = 10.0 ** rng.uniform(0.5, 2.3), rng.uniform(0.0, 2.0 * np.pi)
        x, y = float(size * np.cos(angle)), float(size * np.sin(angle))
        time, kind = duration * rng.uniform(0.3, 0.9), rng.integers(3)
        moment = float(0.2 * rng.normal())
        pushes.append(
            sp.Pulse(time=time, duration=0.01, force=(x, y))
            if kind == 0
            else sp.Step(time=time, force=(x / 4.0, y / 4.0), moment=moment)
            if kind == 1
            else sp.Impulse(time=time, impulse=(x / 100.0, y / 100.0))
        )
    slips: dict[str, Any] = {}
    if contact == "unilateral":
        slips = {"contact": contact, "friction": float(rng.uniform(0.2, 1.2))}
    return sp.Scene(
        hand=sp.Hand(right=finger(), left=finger(), tip=(tip(), tip())),
        grasped=grasped,
        schedule=sp.Schedule.steps(times, np.deg2rad(targets)),
        initial="touching",
        duration=duration,
        disturbances=pushes,
        **slips,
    )


def open_share(run: sp.Run) -> float:
    """The ledger's error as a share of the energy that the motion was given."""
    e = run.energy
    fallen = np.abs(e.gravity - e.start[2])
    given = e.start[0] + e.start[1] + np.abs(e.controller_work) + np.abs(e.external_work) + fallen
    return float(np.max(np.abs(e.closure) / np.maximum.accumulate(given + 1e-300)))
