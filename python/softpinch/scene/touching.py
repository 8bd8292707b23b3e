"""The geometry of closing fingers: how far they press an upright object, and where they touch it.

The compressions d_n1 and d_n2 depend on where the object is, but for an upright object their sum
does not (9): each finger adds L sin(theta_i) + d_f cos(theta_i) - (W_f - a - W/2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ..support.record import SIDES


def compression(scene: Any, angles: tuple[float, float]) -> float:
    """Returns d_n1 + d_n2 of an upright object, m, at these angles of the fingers, rad.

    It is negative where the tips leave a gap.
    """
    return sum(
        length * math.sin(angle) + thickness * math.cos(angle) - gap
        for angle, (length, thickness, gap) in zip(angles, _fingers(scene), strict=True)
    )


def closing_angle(scene: Any, total: float) -> float | None:
    """Returns the equal angle of both fingers, rad, at which the compressions have this sum, m.

    A sum of zero gives the angle at which the tips touch the object. None: no angle does.
    """
    lengths, thicknesses, gaps = (sum(values) for values in zip(*_fingers(scene), strict=True))
    share = (total + gaps) / math.hypot(lengths, thicknesses)
    if not abs(share) <= 1.0:
        return None
    return math.asin(share) - math.atan2(thicknesses, lengths)


def _fingers(scene: Any) -> Iterator[tuple[float, float, float]]:
    """Yields length, half thickness, and the gap of a finger whose tip stands above its root, m."""
    hand = scene.hand
    for side, tip in zip(SIDES, hand.tips, strict=True):
        finger = getattr(hand, side)
        gap = finger.root_offset - tip.radius - 0.5 * scene.grasped.width
        yield finger.length, finger.half_thickness, gap
