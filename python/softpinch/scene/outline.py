"""Geometry of the hand and the object: places, directions and outlines at one instant.

The compressions d_n1 and d_n2 depend on where the object is, but for an upright object their sum
does not (9): each finger adds L sin(theta_i) + d_f cos(theta_i) - (W_f - a - W/2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..support.arrays import Floats
from .hand import Finger

if TYPE_CHECKING:
    from .scene import Scene

# Height of an object without a height, m: with the default width it gives the default inertia.
OBJECT_HEIGHT = 0.049
# (-1)^i of (6): finger 1, the right one, first.
SIGNS = (-1.0, 1.0)
_MM = 1e3
_ARC = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 61)
# Colours of a drawing: edges, links, the object, a fingertip and the lines inside it.
EDGE, LINK, OBJECT, SKIN, _FIBRE = "#262626", "#9E9E9E", "#CFE3F2", "#F3C9A8", "#B5744A"
# Lines drawn inside a tip to show its shear: their positions on its base, as shares of its radius.
_FIBRES = (-0.72, -0.36, 0.0, 0.36, 0.72)


class FingerOutline(NamedTuple):
    """The outline of one finger, in m, in the hand's frame."""

    root: Floats  # the joint (2,)
    link: Floats  # corners of the rigid finger (4, 2)
    centre: Floats  # centre of the fingertip, O_i of (7, 8) (2,)
    tip: Floats  # outline of the deformed fingertip (n, 2)
    fibres: tuple[Floats, ...]  # lines (m, 2) in the tip, straight and normal to its base at first


def finger_of(scene: Scene, side: int) -> Finger:
    """Finger 1 (side 0) or 2 (side 1)."""
    return scene.hand.right if side == 0 else scene.hand.left


def object_axes(theta: float | Floats) -> tuple[Floats, Floats]:
    """Unit vectors across and along the object's faces, (C, S) and (-S, C)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c, s]), np.array([-s, c])


def object_height(scene: Scene) -> float:
    """The height of the drawn object, m."""
    height = scene.grasped.height
    return OBJECT_HEIGHT if height is None or not np.isfinite(height) else height


def object_outline(scene: Scene, q: Floats) -> Floats:
    """The object's corners (4, 2), m; its middle is off the centre of gravity by w."""
    across, along = object_axes(q[2])
    # w is measured from the middle towards finger 1, the right one.
    middle = q[:2] - scene.grasped.com_offset * across
    half = 0.5 * scene.grasped.width * across, 0.5 * object_height(scene) * along
    return np.array([middle + i * half[0] + j * half[1] for i, j in _CORNERS])


_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))
# Half of an arrow's shaft and of its head, and the head's length, as shares of the longest arrow.
_SHAFT, _WIDE, _HEAD = 0.04, 0.12, 0.3


def arrow(start: Floats, along: Floats, length: float, longest: float) -> Floats:
    """The outline (7, 2) of an arrow from `start` (2,) along a unit vector (2,)."""
    # The head is a share of the `longest` arrow. A short arrow has a smaller head and shaft.
    head = min(_HEAD * longest, length)
    small = head / _HEAD
    thin, wide, neck = small * _SHAFT, small * _WIDE, length - head
    points = [(0.0, thin), (neck, thin), (neck, wide), (length, 0.0)]
    points += [(u, -v) for u, v in points[2::-1]]
    up = np.array([-along[1], along[0]])
    return np.array([start + u * along + v * up for u, v in points])


def finger_axes(scene: Scene, q: Floats, side: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Root and O_i of (7, 8), m, and the unit vectors along the finger and inward (each (2,))."""
    sign, finger, angle = SIGNS[side], finger_of(scene, side), float(q[3 + side])
    root = np.array([-sign * finger.root_offset, 0.0])
    up = np.array([sign * np.sin(angle), np.cos(angle)])
    inward = np.array([sign * np.cos(angle), -np.sin(angle)])
    return root, root + finger.length * up + finger.half_thickness * inward, up, inward


def finger_outline(scene: Scene, q: Floats, side: int) -> FingerOutline:
    """Finger 1 (side 0) or 2 (side 1), its tip compressed by d_n and sheared by d_t at the face."""
    sign, finger = SIGNS[side], finger_of(scene, side)
    a = scene.hand.tips[side].radius
    root, centre, up, inward = finger_axes(scene, q, side)

    # The finger is drawn up to the far end of the tip's base.
    half, top = finger.half_thickness * inward, root + (finger.length + a) * up
    link = np.array([root - half, root + half, top + half, top - half])

    across, along_face = object_axes(q[2])
    to_face = sign * across
    d_n, d_t = float(q[5 + side]), float(q[7 + side])
    # Without contact the tip is undeformed.
    reach = max(a - d_n, 0.0) if d_n > 0.0 else np.inf
    shear = d_t if d_n > 0.0 else 0.0

    def place(along: Floats, out: Floats) -> Floats:
        """Deformed positions of points `along` the finger and `out` from it in the tip at first, m.

        The part beyond the object's face is cut off, as in (1)-(3). The shear grows linearly from
        zero at the base to d_t at the face; d_t > 0 is down along the object (12).
        """
        base = np.multiply.outer(along, up)
        offsets = base + np.multiply.outer(out, inward)
        depth, from_base = offsets @ to_face, base @ to_face
        way = np.maximum(reach - from_base, 1e-6 * a)
        share = np.clip((depth - from_base) / way, 0.0, 1.0)
        flat = offsets - np.multiply.outer(np.maximum(depth - reach, 0.0), to_face)
        return np.asarray(centre + flat - np.multiply.outer(share * shear, along_face))

    tip_line = place(a * np.sin(_ARC), a * np.cos(_ARC))
    lines = []
    for share in _FIBRES:
        out = np.linspace(0.0, a * np.sqrt(1.0 - share**2), 12)
        lines.append(place(np.full_like(out, share * a), out))
    return FingerOutline(root, link, centre, tip_line, tuple(lines))


class Shape(NamedTuple):
    """A part of the drawing of hand and object."""

    points: Floats  # its corners (n, 2), m
    fill: str  # its colour; of a line ""
    edge: str  # the colour of its line
    width: float  # the width of its line, points of print


def shapes(scene: Scene, q: Floats, skins: Sequence[str] = (SKIN, SKIN)) -> list[Shape]:
    """The drawing of hand and object, from back to front; the number of shapes is constant."""
    fingers = [finger_outline(scene, q, side) for side in (0, 1)]
    found = [Shape(np.array([finger.root for finger in fingers]), "", EDGE, 1.2)]
    found.append(Shape(object_outline(scene, q), OBJECT, EDGE, 0.8))
    for side, (finger, skin) in enumerate(zip(fingers, skins, strict=True)):
        fibre = _FIBRE if skin == SKIN else "white"
        joint = finger.root + 1.25 * finger_of(scene, side).half_thickness * _CIRCLE
        found.append(Shape(finger.tip, skin, EDGE, 0.6))
        found += [Shape(points, "", fibre, 0.4) for points in finger.fibres]
        found.append(Shape(finger.link, LINK, EDGE, 0.6))
        found.append(Shape(joint, "white", EDGE, 0.8))
    # The centre of gravity, and a line along the object's upright axis, which shows its rotation.
    height = object_height(scene)
    top = q[:2] + 0.42 * height * object_axes(float(q[2]))[1]
    found.append(Shape(q[:2] + 0.02 * height * _CIRCLE, "black", "black", 0.6))
    found.append(Shape(np.array([q[:2], top]), "", "black", 0.7))
    return found


_TURN = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
_CIRCLE = np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def tilts(q: Floats) -> Floats:
    """The tilts theta_p of both tips (6), (..., 2), rad."""
    return np.asarray(q[..., 3:5] + np.array(SIGNS) * q[..., 2:3])


def contact_point(scene: Scene, q: Floats, side: int) -> Floats:
    """The foot of the perpendicular from O_i to the face, where a contact force acts (2,), m."""
    across, _ = object_axes(q[2])
    centre = finger_axes(scene, q, side)[1]
    return np.asarray(centre + (scene.hand.tips[side].radius - q[5 + side]) * SIGNS[side] * across)


def contact_heights(scene: Scene, q: Floats) -> Floats:
    """The places G_i (11) of the contacts on their faces (n, 2), from the middle up, m."""
    hand, signs, theta = scene.hand, np.array(SIGNS), q[:, 2:3]
    length, thick, root = (
        np.array([getattr(finger, name) for finger in (hand.right, hand.left)])
        for name in ("length", "half_thickness", "root_offset")
    )
    tilt = tilts(q)
    middle = q[:, 1:2] * np.cos(theta) - q[:, :1] * np.sin(theta)
    tip = length * np.cos(tilt) - thick * np.sin(tilt) + signs * root * np.sin(theta)
    return np.asarray(middle - tip)


def extent(scene: Scene, q: Floats) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the drawing at the instants q (k, 9), mm.

    Points beyond three times the hand's size are ignored, as of an object that was thrown out.
    """
    fingers = [finger_of(scene, side) for side in (0, 1)]
    size = max(f.length + f.root_offset + f.half_thickness for f in fingers)
    joints = [
        (-sign * f.root_offset, -1.6 * f.half_thickness)
        for sign, f in zip(SIGNS, fingers, strict=True)
    ]
    clouds = [np.array(joints)]
    clouds += [object_outline(scene, row) for row in q]
    for outline in (finger_outline(scene, row, side) for row in q for side in (0, 1)):
        clouds += [outline.link, outline.tip]
    points = np.concatenate(clouds)
    points = points[(np.abs(points) <= 3.0 * size).all(axis=1)] * _MM
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    return float(left), float(right), float(bottom), float(top)


def inward(finger: Finger, angle: float) -> float:
    """Distance of O_i (7) from the finger's root, towards the object, m."""
    return finger.length * math.sin(angle) + finger.half_thickness * math.cos(angle)


def upward(finger: Finger, angle: float) -> float:
    """Height of O_i (8) above the finger's root, m."""
    return finger.length * math.cos(angle) - finger.half_thickness * math.sin(angle)


def arm(finger: Finger) -> float:
    """Distance of O_i from the finger's root, m, which is the most that `inward` can be."""
    return math.hypot(finger.length, finger.half_thickness)


def angle_at(length: float, half_thickness: float, inward: float) -> float | None:
    """Returns the angle of a finger at which O_i is so far inward, rad; None beyond its reach."""
    share = inward / math.hypot(length, half_thickness)
    if not abs(share) <= 1.0:
        return None
    return math.asin(share) - math.atan2(half_thickness, length)


def inward_at_touch(scene: Scene) -> tuple[float, float]:
    """Returns the `inward` of both fingers at which the tips touch an upright object, m."""
    right, left = (
        finger_of(scene, side).root_offset
        - scene.hand.tips[side].radius
        - 0.5 * scene.grasped.width
        for side in (0, 1)
    )
    return right, left


def compression(scene: Scene, angles: tuple[float, float]) -> float:
    """Returns d_n1 + d_n2 of an upright object, m, negative in a gap, at angles of fingers, rad."""
    touching = inward_at_touch(scene)
    return sum(inward(finger_of(scene, k), angles[k]) - touching[k] for k in (0, 1))


def closing_angle(scene: Scene, total: float) -> float | None:
    """Returns the equal angle of both fingers, rad, at which the compressions have this sum, m.

    A sum of zero gives the angle at which the tips touch the object. None: no angle does.
    """
    fingers = [finger_of(scene, side) for side in (0, 1)]
    length = sum(finger.length for finger in fingers)
    thickness = sum(finger.half_thickness for finger in fingers)
    return angle_at(length, thickness, total + sum(inward_at_touch(scene)))
