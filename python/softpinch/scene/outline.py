"""Outlines of the hand and the object at one instant."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..support.arrays import Floats
from .hand import Finger, Fingertip, GraspedObject, Hand

# Height of an object whose faces have no height, m: with the default width it gives the default
# inertia.
OBJECT_HEIGHT = 0.049
# (-1)^i of (6): finger 1, the right one, first.
SIGNS = (-1.0, 1.0)
_MM = 1e3
_ARC = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
# Lines drawn inside a tip to show its shear: their positions on its base, as shares of its radius.
_FIBRES = (-0.72, -0.36, 0.0, 0.36, 0.72)


class Bodies(Protocol):
    """A scene, of which only the dimensions of hand and object are needed."""

    @property
    def hand(self) -> Hand:
        """The hand."""

    @property
    def grasped(self) -> GraspedObject:
        """The object."""


class FingerOutline(NamedTuple):
    """The outline of one finger, in m, in the hand's frame.

    Attributes:
        root: The joint (2,).
        link: Corners of the rigid finger (4, 2).
        centre: Centre of the fingertip, O_i of (7, 8) (2,).
        tip: Outline of the deformed fingertip (n, 2).
        fibres: Lines (m, 2) inside the tip; undeformed they are straight and normal to its base.
    """

    root: Floats
    link: Floats
    centre: Floats
    tip: Floats
    fibres: tuple[Floats, ...]


def tip_of(scene: Bodies, side: int) -> Fingertip:
    """The fingertip of finger 1 (side 0) or 2 (side 1)."""
    return scene.hand.tips[side]


def finger_of(scene: Bodies, side: int) -> Finger:
    """Finger 1 (side 0) or 2 (side 1)."""
    return scene.hand.right if side == 0 else scene.hand.left


def object_axes(theta: float) -> tuple[Floats, Floats]:
    """Unit vectors across and along the object's faces, (C, S) and (-S, C)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c, s]), np.array([-s, c])


def object_height(scene: Bodies) -> float:
    """The height of the drawn object, m."""
    height = scene.grasped.height
    return OBJECT_HEIGHT if height is None or not np.isfinite(height) else height


def object_outline(scene: Bodies, q: Floats) -> Floats:
    """The object's corners (4, 2), m; its middle is off the centre of gravity by w."""
    across, along = object_axes(q[2])
    # w is measured from the middle towards finger 1, the right one.
    middle = q[:2] - scene.grasped.com_offset * across
    half = 0.5 * scene.grasped.width * across, 0.5 * object_height(scene) * along
    return np.array([middle + i * half[0] + j * half[1] for i, j in _CORNERS])


_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def finger_axes(scene: Bodies, q: Floats, side: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Root and O_i of (7, 8), m, and the unit vectors along the finger and inward (each (2,))."""
    sign, finger, angle = SIGNS[side], finger_of(scene, side), float(q[3 + side])
    root = np.array([-sign * finger.root_offset, 0.0])
    up = np.array([sign * np.sin(angle), np.cos(angle)])
    inward = np.array([sign * np.cos(angle), -np.sin(angle)])
    return root, root + finger.length * up + finger.half_thickness * inward, up, inward


def finger_outline(scene: Bodies, q: Floats, side: int) -> FingerOutline:
    """One finger with its tip flattened by d_n and sheared by d_t against the object's face.

    Args:
        scene: The scene, which has the dimensions.
        q: Coordinates (9,), m and rad.
        side: 0 for finger 1, the right one; 1 for finger 2.
    """
    sign, finger = SIGNS[side], finger_of(scene, side)
    a = tip_of(scene, side).radius
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
        """Deformed positions of points of the tip.

        The part beyond the object's face is cut off, as in (1)-(3). The shear displacement grows
        linearly from zero at the base, which is fixed to the finger, to d_t at the face. d_t > 0
        means that the face, and the points touching it, have moved down along the object (12).

        Args:
            along: Position along the finger in the undeformed tip, m.
            out: Distance from the finger in the undeformed tip, m.
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
        out = np.linspace(0.0, a * np.sqrt(1.0 - share**2), 40)
        lines.append(place(np.full_like(out, share * a), out))
    return FingerOutline(root, link, centre, tip_line, tuple(lines))


def contact_point(scene: Bodies, q: Floats, side: int) -> Floats:
    """The point of a tip at which its contact force acts on the object's face (2,), m.

    It is the foot of the perpendicular from O_i to the face, where the moments of both contact
    forces, (9) and (12), have their arms.
    """
    across, _ = object_axes(q[2])
    centre = finger_axes(scene, q, side)[1]
    return np.asarray(centre + (tip_of(scene, side).radius - q[5 + side]) * SIGNS[side] * across)


def extent(scene: Bodies, q: Floats) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the drawing at the instants q (k, 9), mm.

    Points beyond three times the hand's size, and points that are not finite, are ignored, so that
    an object thrown out of the grasp does not shrink the hand to a dot.
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
