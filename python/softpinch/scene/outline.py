"""Geometry of the hand and the object: places, directions, outlines and drawings at one instant.

The drawings are SVG, which needs no package. Tilts, places of contact, normals and tips' centres of
any parts come from the core (`contacts`).
"""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .. import _core
from ..support import SIDES, Floats
from .hand import Finger, links
from .parts import Arc, Face, Jaw, Parallelogram, half_widths, others, sides_of

if TYPE_CHECKING:
    from .scene import Scene

# Height of an object without a height, m: with the default width it gives the default inertia.
OBJECT_HEIGHT = 0.049
# (-1)^i of (6): finger 1, the right one, first.
SIGNS = (-1.0, 1.0)
# From the lower to the upper end of an arc, as shares of its span.
_SWEEP = np.linspace(-0.5, 0.5, 61)
# Colours of a drawing: edges, links, the object, a fingertip and the lines inside it.
EDGE, LINK, OBJECT, SKIN, _FIBRE = "#262626", "#9E9E9E", "#CFE3F2", "#F3C9A8", "#B5744A"
# Lines drawn inside a tip to show its shear: their positions on its base, as shares of its radius.
_FIBRES = (-0.72, -0.36, 0.0, 0.36, 0.72)


class FingerOutline(NamedTuple):
    """The outline of one finger, in m, in the hand's frame."""

    root: Floats  # where it is fixed to the hand (2,)
    links: tuple[Floats, ...]  # corners of the rigid parts (4, 2), from back to front
    joints: tuple[Floats, ...]  # their joints (2,)
    rail: Floats  # the ends of the line on which a jaw travels (2, 2), or (0, 2)
    centre: Floats  # centre of the fingertip, O_i of (7, 8) (2,)
    tip: Floats  # outline of the deformed fingertip (n, 2)
    fibres: tuple[Floats, ...]  # lines (m, 2) in the tip, straight and normal to its base at first


class Contacts(NamedTuple):
    """Both contacts at states q (..., 9), along the hand's axes."""

    tilts: Floats  # theta_p of both tips (6), (..., 2), rad
    places: Floats  # of the contacts on the sides, from their middles up: G_i of (11) (..., 2), m
    normals: Floats  # of the sides there, from the left finger to the right one (..., 2, 2)
    centres: Floats  # of the tips, O_i of (7, 8) (..., 2, 2), m


def contacts(scene: Scene, q: Floats) -> Contacts:
    """Both contacts at states q (..., 9), as the core finds them for any parts."""
    q = np.asarray(q, dtype=np.float64)
    found = _core.contacts(scene.parameters(), np.ascontiguousarray(q.reshape(-1, 9)))
    found = found.reshape(*q.shape[:-1], 12)
    pairs = found[..., 4:].reshape(*q.shape[:-1], 2, 2, 2)
    return Contacts(found[..., :2], found[..., 2:4], pairs[..., 0, :, :], pairs[..., 1, :, :])


def finger_of(scene: Scene, side: int) -> Finger | Jaw | Parallelogram:
    """Finger 1 (side 0) or 2 (side 1)."""
    return scene.hand.right if side == 0 else scene.hand.left


def object_axes(theta: float | Floats) -> tuple[Floats, Floats]:
    """Unit vectors across and along the object's faces, (C, S) and (-S, C)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c, s]), np.array([-s, c])


def object_outline(scene: Scene, q: Floats) -> Floats:
    """The object's outline (n, 2), m, counter-clockwise from the lower end of its left side."""
    right, left = (_side(scene, k) for k in (0, 1))
    across, along = object_axes(q[2])
    local = np.concatenate([left[:1], right, left[:0:-1]])
    return np.asarray(q[:2] + local[:, :1] * across + local[:, 1:] * along)


def _side(scene: Scene, side: int) -> Floats:
    """One side of the object from its lower to its upper end (n, 2), along the object's axes, m."""
    sign, grasped = SIGNS[side], scene.grasped
    shape = sides_of(grasped)[side]
    if isinstance(shape, Arc):
        turn = _SWEEP * shape.opening
        arc = np.column_stack([-sign * np.cos(turn), np.sin(turn)])
        return np.asarray(shape.center + shape.radius * arc)
    own = shape.height if isinstance(shape, Face) else None
    height, tilt = own or grasped.height, shape.tilt if isinstance(shape, Face) else 0.0
    # Endless faces are drawn so that their ends are level.
    endless = height is None or not np.isfinite(height)
    half = 0.5 * (OBJECT_HEIGHT / np.cos(tilt) if endless else height)  # type: ignore[operator]
    up = np.array([-np.sin(sign * tilt), np.cos(tilt)])
    middle = np.array([-sign * half_widths(scene)[side], 0.0])
    return np.array([middle - half * up, middle + half * up])


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


def _base_axes(scene: Scene, q: Floats, side: int) -> tuple[Floats, Floats]:
    """Unit vectors along the base of a tip and inward from it (each (2,))."""
    sign, finger = SIGNS[side], finger_of(scene, side)
    angle = float(q[3 + side]) if isinstance(finger, Finger) else finger.angle
    up = np.array([sign * np.sin(angle), np.cos(angle)])
    return up, np.array([up[1] * sign, -up[0] * sign])


def _beam(start: Floats, end: Floats, half: float) -> Floats:
    """The corners of a beam between two points, `half` of its thickness to either side (4, 2)."""
    along = end - start
    across = half * np.array([along[1], -along[0]]) / max(np.hypot(*along), 1e-300)
    return np.array([start - across, start + across, end + across, end - across])


def _mechanism(scene: Scene, q: Floats, side: int, centre: Floats) -> FingerOutline:
    """The rigid parts of a finger whose tip has this centre; the tip is added later."""
    sign, finger, a = SIGNS[side], finger_of(scene, side), scene.hand.tips[side].radius
    up, inward = _base_axes(scene, q, side)
    half, towards, none = finger.half_thickness, np.array([sign, 0.0]), np.empty((0, 2))
    root = np.array([-sign * finger.root_offset, 0.0])
    middle = centre - half * inward
    if isinstance(finger, Finger):
        link = _beam(root, root + (finger.length + a) * up, half)
        return FingerOutline(root, (link,), (root,), none, centre, none, ())
    # A pad that carries the tip. Lines of no thickness are drawn a little thicker.
    thick = max(half, 0.12 * a)
    pad = _beam(middle - 1.15 * a * up, middle + 1.15 * a * up, half)
    if isinstance(finger, Parallelogram):
        swing = float(q[3 + side])
        arm = finger.length * np.array([sign * np.sin(swing), np.cos(swing)])
        ends = root + arm
        apart = -max(1.1 * a, 3.0 * half) * towards
        bars = [_beam(foot, foot + arm, 0.6 * thick) for foot in (root + apart, root)]
        coupler = _beam(ends + apart, ends + 0.5 * half * towards, 0.9 * thick)
        joints = (root, root + apart, ends, ends + apart)
        return FingerOutline(root + apart, (*bars, pad, coupler), joints, none, centre, none, ())
    assert isinstance(finger, Jaw)
    way = np.array([sign * np.cos(finger.direction), np.sin(finger.direction)])
    # The carriage stands on a rail as far below the tip as the hand's origin, or below the pad.
    below = max(finger.height, 1.8 * a)
    foot = middle - below * up
    pad = _beam(foot, middle + 1.15 * a * up, half)
    carriage = _beam(foot - 2.5 * thick * way, foot + 2.5 * thick * way, 1.3 * thick)
    fixed = foot - float(q[3 + side]) * way
    rail = np.array([fixed - 0.3 * finger.root_offset * way, fixed + finger.root_offset * way])
    return FingerOutline(fixed, (pad, carriage), (), rail, centre, none, ())


def finger_outline(scene: Scene, q: Floats, side: int) -> FingerOutline:
    """Finger 1 (side 0) or 2 (side 1), its tip compressed by d_n and sheared by d_t at the side."""
    sign, a = SIGNS[side], scene.hand.tips[side].radius
    found = contacts(scene, q)
    centre = found.centres[side]
    rigid = _mechanism(scene, q, side, centre)
    up, inward = _base_axes(scene, q, side)
    shape = sides_of(scene.grasped)[side]
    radius = shape.radius if isinstance(shape, Arc) else np.inf

    across = found.normals[side]
    along_face = np.array([-across[1], across[0]])
    to_face = sign * across
    d_n, d_t = float(q[5 + side]), float(q[7 + side])
    # Without contact the tip is undeformed.
    reach = max(a - d_n, 0.0) if d_n > 0.0 else np.inf
    shear = d_t if d_n > 0.0 else 0.0

    def place(along: Floats, out: Floats) -> Floats:
        """Deformed positions of points `along` the finger and `out` from it in the tip at first, m.

        The part beyond the object's side is cut off, as in (1)-(3). The shear grows linearly from
        zero at the base to d_t at the side; d_t > 0 is down along the object (12).
        """
        base = np.multiply.outer(along, up)
        offsets = base + np.multiply.outer(out, inward)
        depth, from_base = offsets @ to_face, base @ to_face
        # An arc falls back behind its tangent.
        beside = np.minimum(np.abs(offsets @ along_face), radius)
        surface = reach + beside**2 / (radius + np.sqrt(radius**2 - beside**2))
        way = np.maximum(surface - from_base, 1e-6 * a)
        share = np.clip((depth - from_base) / way, 0.0, 1.0)
        flat = offsets - np.multiply.outer(np.maximum(depth - surface, 0.0), to_face)
        return np.asarray(centre + flat - np.multiply.outer(share * shear, along_face))

    tip_line = place(a * np.sin(np.pi * _SWEEP), a * np.cos(np.pi * _SWEEP))
    lines = []
    for share in _FIBRES:
        out = np.linspace(0.0, a * np.sqrt(1.0 - share**2), 12)
        lines.append(place(np.full_like(out, share * a), out))
    return rigid._replace(tip=tip_line, fibres=tuple(lines))


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
        found += [Shape(finger.rail, "", EDGE, 1.2)] * bool(len(finger.rail))
        found.append(Shape(finger.tip, skin, EDGE, 0.6))
        found += [Shape(points, "", fibre, 0.4) for points in finger.fibres]
        found += [Shape(link, LINK, EDGE, 0.6) for link in finger.links]
        size = (1.25 if len(finger.links) == 1 else 0.6) * finger_of(scene, side).half_thickness
        found += [Shape(joint + size * _CIRCLE, "white", EDGE, 0.8) for joint in finger.joints]
    # The centre of gravity, and a line along the object's upright axis, which shows its rotation.
    height = float(np.ptp(object_outline(scene, np.zeros(9))[:, 1]))
    top = q[:2] + 0.42 * height * object_axes(float(q[2]))[1]
    found.append(Shape(q[:2] + 0.02 * height * _CIRCLE, "black", "black", 0.6))
    found.append(Shape(np.array([q[:2], top]), "", "black", 0.7))
    return found


_TURN = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
_CIRCLE = np.column_stack([np.cos(_TURN), np.sin(_TURN)])


def contact_point(scene: Scene, q: Floats, side: int) -> Floats:
    """The foot of the perpendicular from O_i to the side, where a contact force acts (2,), m."""
    found, reach = contacts(scene, q), scene.hand.tips[side].radius - q[5 + side]
    return np.asarray(found.centres[side] + reach * SIGNS[side] * found.normals[side])


def extent(scene: Scene, q: Floats) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of the drawing at q (k, 9), mm, without what was thrown out."""
    fingers = [finger_of(scene, side) for side in (0, 1)]
    ways = np.abs(q[:, 3:5]).max(axis=0).tolist()  # jaws may travel far
    size = max(
        (abs(f.height) + way if isinstance(f, Jaw) else f.length)
        + (f.root_offset + f.half_thickness + tip.radius)
        for f, way, tip in zip(fingers, ways, scene.hand.tips, strict=True)
    )
    joints = [
        (-sign * f.root_offset, -1.6 * f.half_thickness)
        for sign, f in zip(SIGNS, fingers, strict=True)
        if not isinstance(f, Jaw)
    ]
    clouds = [np.array(joints).reshape(-1, 2)]
    clouds += [object_outline(scene, row) for row in q]
    for outline in (finger_outline(scene, row, side) for row in q for side in (0, 1)):
        clouds += [*outline.links, outline.tip]
    points = np.concatenate(clouds)
    points = points[(np.abs(points) <= 3.0 * size).all(axis=1)] * 1e3
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    return float(left), float(right), float(bottom), float(top)


def inward(finger: Finger, angle: float) -> float:
    """Distance of O_i (7) from the finger's root, towards the object, m."""
    return finger.length * math.sin(angle) + finger.half_thickness * math.cos(angle)


def upward(finger: Finger, angle: float) -> float:
    """Height of O_i (8) above the finger's root, m."""
    return finger.length * math.cos(angle) - finger.half_thickness * math.sin(angle)


def angle_at(length: float, half_thickness: float, inward: float) -> float | None:
    """Returns the angle of a finger at which O_i is so far inward, rad; None beyond its reach."""
    share = inward / math.hypot(length, half_thickness)
    if not abs(share) <= 1.0:
        return None
    return math.asin(share) - math.atan2(half_thickness, length)


def compression(scene: Scene, fingers: Sequence[float]) -> float:
    """Returns d_n1 + d_n2, m, negative in a gap, of an upright object between these fingers."""
    # Where the fingers hold it at first; on flat faces the sum does not depend on that.
    pose = np.array([*scene._start_position(), 0.0, *fingers])
    q, _ = _core.consistent(scene.parameters(), pose, np.zeros(2), np.zeros(5))
    return float(q[5] + q[6])


def closing(scene: Scene, depth: float) -> tuple[float, float] | None:
    """Returns the fingers' coordinates at which the mean compression is `depth`, m.

    Two `Finger`s at parallel faces have equal angles, others compress each tip by the same share of
    its radius. A depth of zero is where the tips touch an upright object. None: they do not reach
    so far.
    """
    if not others(scene):
        fingers = links(scene, "a hand of links")
        reach = 2.0 * depth - scene.grasped.width
        pairs = zip(fingers, scene.hand.tips, strict=True)
        reach += sum(finger.root_offset - tip.radius for finger, tip in pairs)
        length, thickness = (sum(f.length for f in fingers), sum(f.half_thickness for f in fingers))
        angle = angle_at(length, thickness, reach)
        return None if angle is None else (angle, angle)
    # A tip that is smaller by the depth touches where the tip itself is compressed by it.
    numbers = scene.parameters().copy()
    numbers[_RADII] *= 1.0 - depth / numbers[_RADII].mean()
    try:
        right, left = _core.start(numbers, "touching")[3:5].tolist()
    except ValueError:
        return None
    return right, left


_RADII = [_core.PARAMETERS.index(f"hand.tip.{side}.radius") for side in SIDES]


# Pixels of one drawing's width, and of the line of text below it.
_WIDTH, _TEXT = 240.0, 18.0
_MARGIN = 3.0  # mm
# Width in the drawing, mm, of a line whose width in print is one point.
_MM_PER_POINT = 0.4


def drawings(scene: Scene, states: Sequence[Floats], texts: Sequence[str]) -> str:
    """An SVG of finite states (9,) of a scene side by side, at one scale, each with its text."""
    if not states or not np.isfinite(states).all():
        return ""
    left, right, bottom, top = extent(scene, np.array(states))
    width, height = right - left + 2.0 * _MARGIN, top - bottom + 2.0 * _MARGIN
    scale = _WIDTH / width
    panels = []
    for k, (q, text) in enumerate(zip(states, texts, strict=True)):
        x, y = scale * (k * width + _MARGIN - left), scale * (top + _MARGIN)
        # SVG counts y downwards.
        place = f"translate({x:.2f} {y:.2f}) scale({scale:.5f} {-scale:.5f})"
        panels.append(f'<g transform="{place}">')
        for points, fill, edge, thick in shapes(scene, q):
            corners = " ".join(f"{1e3 * x:.2f},{1e3 * y:.2f}" for x, y in points)
            line = f'stroke="{edge}" stroke-width="{_MM_PER_POINT * thick:.2f}"'
            kind = "polygon" if fill else "polyline"
            panels.append(f'<{kind} points="{corners}" fill="{fill or "none"}" {line}/>')
        panels.append("</g>")
        panels.append(
            f'<text x="{(k + 0.5) * _WIDTH:.1f}" y="{scale * height + 0.7 * _TEXT:.1f}" '
            'font-size="12" text-anchor="middle" fill="currentColor">'
            f"{html.escape(text)}</text>"
        )
    size = len(states) * _WIDTH, scale * height + _TEXT
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]:.0f}" height="{size[1]:.0f}" '
        f'viewBox="0 0 {size[0]:.2f} {size[1]:.2f}">{"".join(panels)}</svg>'
    )
