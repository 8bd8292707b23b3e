"""Scenes as bare records, with no softpinch in them: what the oracle's own tests share."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np


def paper(**changes: Any) -> SimpleNamespace:
    """The default parameters as a bare scene, no softpinch in it; operation 1 for a second."""
    finger = SimpleNamespace(
        length=0.0762, root_offset=0.049, half_thickness=0.0045, mass=0.1, inertia=5.8e-4
    )
    tip = SimpleNamespace(
        radius=0.020,
        youngs_modulus=0.30e6,
        normal_viscosity=100.0,
        tangential_viscosity=100.0,
        tilt_coupling=changes.pop("kappa", 1.0),
        normal_mass=None,
        tangential_mass=None,
    )
    scene = {
        "hand": SimpleNamespace(right=finger, left=finger, tip=tip),
        "grasped": SimpleNamespace(width=0.049, mass=0.1, inertia=4.0e-5, com_offset=0.0),
        "control": SimpleNamespace(kp=100.0, kd=1.0, ki=1000.0),
        "schedule": steps([(6, 6)]),
        "disturbances": [],
        "gravity": 9.81,
        "duration": 1.0,
        "initial": None,
    }
    return SimpleNamespace(**{**scene, **changes})


def steps(degrees: Sequence[tuple[float, float]]) -> SimpleNamespace:
    times = np.arange(len(degrees), dtype=np.float64)
    return SimpleNamespace(kind="steps", times=times, angles=np.deg2rad(degrees))


def changed(record: SimpleNamespace, **changes: Any) -> SimpleNamespace:
    return SimpleNamespace(**{**vars(record), **changes})


def uneven(**changes: Any) -> SimpleNamespace:
    """Right and left differ, the centre of gravity is off the middle; both tips pressed."""
    scene = paper()
    finger, tip = scene.hand.right, scene.hand.tip
    soft = {"youngs_modulus": 2.5e5, "tilt_coupling": -1.0, "normal_mass": 0.05, "radius": 0.021}
    other = {"tangential_mass": 0.2, "normal_viscosity": 80.0}
    scene.hand = SimpleNamespace(
        right=changed(finger, length=0.08, mass=0.12, inertia=6e-4, root_offset=0.0485),
        left=changed(finger, half_thickness=0.005, inertia=5e-4),
        tip=(changed(tip, **soft), changed(tip, **other)),
    )
    scene.grasped = changed(scene.grasped, com_offset=0.004, inertia=5e-5, mass=0.15)
    scene.control = (scene.control, SimpleNamespace(kp=80.0, kd=0.7, ki=600.0))
    return changed(scene, **changes)


def push(**changes: Any) -> SimpleNamespace:
    return SimpleNamespace(**{"time": 1.0, "force": (130.0, 130.0), "moment": 5.0, **changes})
