"""Scenes for equilibria: grasps of one pair of targets, and one with two stable rotations."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

import softpinch as sp


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
