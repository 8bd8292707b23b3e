"""Grasps for equilibria and linear models, and the balance of forces of an object at rest."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import scenes as shared
import softpinch as sp

Floats = np.ndarray
UNEVEN = replace(shared.uneven(), schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]])))

# x, y, theta, d_t1 and d_t2 in q: what the balance and the grips determine while the fingers stand.
UNKNOWNS = [0, 1, 2, 7, 8]
# What is divided out of them.
SIZES = np.array([1e-2, 1e-2, 1.0, 1e-2, 1e-2])


def held(degrees: float = 6.0, **changes: Any) -> sp.Scene:
    """The paper's grasp with both fingers at one angle."""
    scene = sp.Scene(schedule=sp.Schedule.steps([0.0], np.deg2rad([[degrees, degrees]])))
    return replace(scene, **changes)


def leaning(mass: float, com_offset: float) -> sp.Scene:
    """A narrow, heavy object in a light grasp, which leans to one side or to the other one.

    Above about 2.7 kg the upright rest is a saddle, and the object has a rest on either side. Each
    of them ends in a fold when its centre of gravity moves to the other side: over mass and offset
    the rotation has a cusp.
    """
    scene, angle, width, pressed = held(12.0), math.radians(12.0), 0.02, 0.002
    finger, radius = scene.hand.right, scene.hand.tip.radius
    inwards = finger.length * math.sin(angle) + finger.half_thickness * math.cos(angle)
    finger = replace(finger, root_offset=inwards + 0.5 * width + radius - pressed)
    grasped = replace(scene.grasped, width=width, mass=mass, com_offset=com_offset)
    hand = replace(scene.hand, right=finger, left=finger)
    return replace(scene, hand=hand, grasped=grasped, fingers="driven")


@cache
def resting(law: str) -> tuple[sp.Scene, sp.State]:
    """The uneven grasp at rest under a law: the same place for all three of them."""
    found = sp.equilibrium(UNEVEN, grip=(1e-3, -2e-3)).state
    assert found is not None
    state = replace(found, time=0.0)
    if law == "pid":
        return UNEVEN, state
    fields: dict[str, Any] = {"initial": None}
    if law == "driven":
        held = sp.Schedule.minimum_jerk([0.0], [state.q[3:5]], 0.1)
        fields |= {"fingers": "driven", "schedule": held}
    else:
        torques = sp.linearize(UNEVEN, state, "torque").input_values
        fields |= {"control": sp.Torque(), "schedule": sp.Schedule.steps([0.0], [torques])}
    return replace(UNEVEN, **fields), replace(state, integral=(0.0, 0.0))


def left_over(
    scene: sp.Scene, grip: Floats, z: Floats, push: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """What the balance (3) and the grips (2) lack, with a force beside those of the scene.

    Args:
        scene: The scene, whose fingers stand at their first targets.
        grip: The wanted grips (2,), m.
        z: The unknowns in parts of their sizes (5,).
        push: The force in x and y, N.
    """
    x, y, theta, *shear = z * SIZES
    angles = scene.schedule.angles[0]
    state = sp.State.consistent(scene, x=x, y=y, rotation=theta, fingers=angles, shear=shear)
    terms = sp.evaluate(scene, 0.0, state.q, state.p, formulation="nullspace")
    forces = terms.forces.total
    balance = forces[:3] - terms.constraint_matrix[:, :3].T @ forces[5:] + [*push, 0.0]
    grips = []
    for i, sign in enumerate((-1.0, 1.0)):
        place = sign * terms.constraint_matrix[i, 2]
        tilt = state.q[3 + i] + sign * theta
        grips.append(place + (scene.hand.tips[i].radius - state.q[5 + i]) * tilt + state.q[7 + i])
    return np.array([*(balance / [10.0, 10.0, 0.1]), *((np.array(grips) - grip) / 1e-2)])
