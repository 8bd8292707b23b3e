"""The violations of recorded rows, computed from their numbers with NumPy."""

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

import softpinch as sp

# What the rows need to have for that.
RECORD = ("state", "multipliers")
# Heights of faces that a contact leaves at once, later or never.
HEIGHTS = st.one_of(st.none(), st.floats(1e-5, 1e-2))


def shown(run: sp.Run) -> dict[str, NDArray[np.bool_]]:
    """Violation -> the rows (n,) that show it, from the numbers of the rows alone."""
    scene, q, multipliers = run.scene, run.q, run.multipliers
    radius = np.array([tip.radius for tip in scene.hand.tips])
    compression, tilt = q[:, 5:7], q[:, 3:5] + q[:, 2:3] * [-1.0, 1.0]
    normal, across = multipliers[:, :2], np.abs(multipliers[:, 2:])
    friction = np.inf if scene.friction is None else scene.friction
    with np.errstate(invalid="ignore"):  # infinity times zero, where nothing limits the friction
        slips = (across > friction * normal) & np.isfinite(friction)
    # (11), from the object's place in its own frame to that of the tip's centre.
    sides, theta = np.array([-1.0, 1.0]), q[:, 2:3]
    fingers = (scene.hand.right, scene.hand.left)
    length, thick, root = (
        np.array([getattr(each, name) for each in fingers])
        for name in ("length", "half_thickness", "root_offset")
    )
    along = q[:, 1:2] * np.cos(theta) - q[:, :1] * np.sin(theta)
    tip_along = length * np.cos(tilt) - thick * np.sin(tilt) + sides * root * np.sin(theta)
    height = np.inf if scene.grasped.height is None else scene.grasped.height
    by_tip: dict[str, Any] = {
        "separated": compression < -1e-9 * radius,
        "crushed": compression >= radius,
        "folded": np.abs(tilt) >= np.pi / 2,
        "pulling": normal < 0.0,
        "slipping": slips,
        "rim": compression > radius * (1.0 - np.abs(np.sin(tilt))),
        "off_face": np.abs(along - tip_along) > 0.5 * height,
    }
    return {name: tips.any(axis=1) for name, tips in by_tip.items()}
