"""Outlines of the hand and the object at one instant, and their drawing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scene.hand import Finger, Fingertip
from ..scene.scene import Scene
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

# Height of the drawn object, m: with the default width it gives the default inertia.
OBJECT_HEIGHT = 0.049
# (-1)^i of (6): finger 1, the right one, first.
SIGNS = (-1.0, 1.0)
_ARC = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
# Colour of a tip, and of one that sticks in a drawing of modes.
SKIN = "#F3C9A8"
# Lines drawn inside a tip to show its shear: their positions on its base, as shares of its radius.
_FIBRES = (-0.72, -0.36, 0.0, 0.36, 0.72)


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


def tip_of(scene: Scene, side: int) -> Fingertip:
    """The fingertip of finger 1 (side 0) or 2 (side 1)."""
    return scene.hand.tips[side]


def finger_of(scene: Scene, side: int) -> Finger:
    """Finger 1 (side 0) or 2 (side 1)."""
    return scene.hand.right if side == 0 else scene.hand.left


def object_axes(theta: float) -> tuple[Floats, Floats]:
    """Unit vectors across and along the object's faces, (C, S) and (-S, C)."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([c, s]), np.array([-s, c])


def object_outline(scene: Scene, q: Floats) -> Floats:
    """The object's corners (4, 2), m; its middle is off the centre of gravity by w."""
    across, along = object_axes(q[2])
    # w is measured from the middle towards finger 1, the right one.
    middle = q[:2] - scene.grasped.com_offset * across
    half = 0.5 * scene.grasped.width * across, 0.5 * OBJECT_HEIGHT * along
    return np.array([middle + i * half[0] + j * half[1] for i, j in _CORNERS])


_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def finger_outline(scene: Scene, q: Floats, side: int) -> FingerOutline:
    """One finger with its tip flattened by d_n and sheared by d_t against the object's face.

    Args:
        scene: The scene, which has the dimensions.
        q: Coordinates (9,), m and rad.
        side: 0 for finger 1, the right one; 1 for finger 2.
    """
    sign, finger, tip = SIGNS[side], finger_of(scene, side), tip_of(scene, side)
    angle, a = float(q[3 + side]), tip.radius
    root = np.array([-sign * finger.root_offset, 0.0])
    up = np.array([sign * np.sin(angle), np.cos(angle)])
    inward = np.array([sign * np.cos(angle), -np.sin(angle)])
    centre = root + finger.length * up + finger.half_thickness * inward

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


def draw(axes: Axes, scene: Scene, q: Floats, skins: Sequence[str] = (SKIN, SKIN)) -> None:
    """Draws hand and object into axes in mm.

    Args:
        axes: The axes.
        scene: The scene, which has the dimensions.
        q: Coordinates (9,), m and rad.
        skins: The colours of the right and the left tip.
    """
    from matplotlib.patches import Circle, Polygon

    body, edge = "0.62", "0.15"
    mm = style.MM.per_si
    roots = [-sign * finger_of(scene, k).root_offset * mm for k, sign in enumerate(SIGNS)]
    axes.plot(roots[::-1], [0.0, 0.0], color=edge, linewidth=1.2, zorder=1.0)
    thing = Polygon(
        object_outline(scene, q) * mm,
        facecolor="#CFE3F2",
        edgecolor=edge,
        linewidth=0.8,
        zorder=2.0,
        label="object",
    )
    axes.add_patch(thing)
    for side in (0, 1):
        outline = finger_outline(scene, q, side)
        axes.add_patch(
            Polygon(
                outline.tip * mm,
                facecolor=skins[side],
                edgecolor=edge,
                linewidth=0.6,
                zorder=3.0,
            )
        )
        fibres = "#B5744A" if skins[side] == SKIN else "white"
        for fibre in outline.fibres:
            axes.plot(*(fibre * mm).T, color=fibres, linewidth=0.4, zorder=3.1)
        axes.add_patch(
            Polygon(outline.link * mm, facecolor=body, edgecolor=edge, linewidth=0.6, zorder=3.2)
        )
        joint = 1.25 * finger_of(scene, side).half_thickness * mm
        axes.add_patch(
            Circle(
                (float(outline.root[0] * mm), 0.0),
                joint,
                facecolor="white",
                edgecolor=edge,
                linewidth=0.8,
                zorder=3.3,
            )
        )
    x, y = q[:2] * mm
    _, along = object_axes(q[2])
    axes.plot(x, y, marker="o", color="black", markersize=2.2, linestyle="none", zorder=4.0)
    # A line along the object's upright axis makes its rotation visible.
    axis = np.array([q[:2], q[:2] + 0.42 * OBJECT_HEIGHT * along]) * mm
    axes.plot(*axis.T, color="black", linewidth=0.7, zorder=4.0)


def extent(scene: Scene, q: Floats) -> tuple[float, float, float, float]:
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
    points = points[(np.abs(points) <= 3.0 * size).all(axis=1)] * style.MM.per_si
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    return float(left), float(right), float(bottom), float(top)
