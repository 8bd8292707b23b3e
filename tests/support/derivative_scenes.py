"""Scenes for derivatives: nothing symmetric, so that no derivative vanishes."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

import softpinch as sp
from softpinch import _core
from softpinch.scene.parts import PAPERS
from softpinch.scene.paths import resolve

# Numbers of the core that do not enter into the motion in bilateral contact.
UNUSED = ("grasped.height", "friction.right", "friction.left")
# All numbers that both fingers have of their own, of the object, and gravity.
SIDED = tuple(name for name in _core.PARAMETERS[:PAPERS] if name not in UNUSED)
# Those that both tips or both controllers share.
SHARED = (
    *("hand.tip.radius", "hand.tip.youngs_modulus", "hand.tip.normal_viscosity"),
    *("hand.tip.tangential_viscosity", "hand.tip.tilt_coupling"),
    *("control.kp", "control.kd", "control.ki"),
    # Of the object, the tips take its mass.
    "grasped.mass",
)
SCHEDULE = sp.Schedule.ramps([0.0, 0.0113, 0.04], np.deg2rad([[4, 5], [8, 3], [6, 6]]))
LOADS = (
    sp.Sine(
        frequency_hz=43.0,
        force=(3.0, -2.0),
        moment=0.02,
        phase=0.4,
        time=0.0037,
        duration=0.0119,
    ),
    sp.Pulse(time=0.0061, duration=0.0077, force=(2.0, 1.0), moment=0.01),
)
SMOOTH_INPUTS = (
    "schedule.angles",
    *(f"disturbances.{k}.{name}" for k in range(2) for name in ("force", "moment")),
    *("disturbances.0.frequency_hz", "disturbances.0.phase"),
)
TIMES = (
    "schedule.times",
    *(f"disturbances.{k}.{name}" for k in range(2) for name in ("time", "duration")),
)


def uneven(**changes: Any) -> sp.Scene:
    """Two different fingers, tips and controllers; the tips press from the start on."""
    whole: dict[str, Any] = {
        "hand": sp.Hand(
            right=sp.Finger(length=0.079, inertia=7e-4),
            left=sp.Finger(half_thickness=0.0055, mass=0.12),
            tip=(
                sp.Fingertip(radius=0.021, normal_mass=0.05, tangential_mass=0.07),
                sp.Fingertip(
                    youngs_modulus=4e5, tilt_coupling=-0.5, normal_mass=0.03, tangential_mass=0.1
                ),
            ),
        ),
        "grasped": sp.GraspedObject(width=0.0543, com_offset=0.003, inertia=3e-5),
        "control": (sp.Pid(kp=90.0), sp.Pid(kd=1.4, ki=600.0)),
        "schedule": SCHEDULE,
        "disturbances": LOADS,
        "duration": 0.02,
    }
    return sp.Scene(**(whole | changes))


def shared(**changes: Any) -> sp.Scene:
    """Two equal tips, with the object's mass, and equal controllers; the object is pressed."""
    scene = uneven(control=sp.Pid(kd=1.4), **changes)
    grasped = sp.GraspedObject(width=0.0496, com_offset=0.002)
    return replace(
        scene, hand=replace(scene.hand, tip=sp.Fingertip(tilt_coupling=0.7)), grasped=grasped
    )


def moving(scene: sp.Scene) -> sp.Scene:
    """The scene from a state on the constraints, in which everything moves."""
    start = sp.State.consistent(
        scene,
        rotation=0.05,
        fingers=np.deg2rad([6.0, 4.0]),
        shear=(3e-4, -2e-4),
        velocity=(0.03, -0.02, 0.6),
        finger_rates=(0.4, -0.3),
    )
    return replace(scene, initial=replace(start, integral=(1e-3, -2e-3)))


def entries(scene: sp.Scene, path: str) -> list[tuple[int, ...]]:
    """The indices of the numbers at a path."""
    return list(product(*map(range, np.shape(resolve(scene, path)))))
