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


def tilts(run: sp.Run) -> NDArray[np.float64]:
    """theta_pi (6) in each row (n, 2), rad."""
    return np.asarray(run.q[:, 3:5] + run.q[:, 2:3] * [-1.0, 1.0])


def places(run: sp.Run) -> NDArray[np.float64]:
    """|G_i| (11) in each row (n, 2), m: from the object's place in its own frame to the tip's."""
    scene, q, tilt = run.scene, run.q, tilts(run)
    sides, theta = np.array([-1.0, 1.0]), q[:, 2:3]
    fingers = (scene.hand.right, scene.hand.left)
    length, thick, root = (
        np.array([getattr(each, name) for each in fingers])
        for name in ("length", "half_thickness", "root_offset")
    )
    along = q[:, 1:2] * np.cos(theta) - q[:, :1] * np.sin(theta)
    tip_along = length * np.cos(tilt) - thick * np.sin(tilt) + sides * root * np.sin(theta)
    return np.abs(along - tip_along)


def shown(run: sp.Run) -> dict[str, NDArray[np.bool_]]:
    """Violation -> the rows (n,) that show it, from the numbers of the rows alone."""
    scene, multipliers = run.scene, run.multipliers
    radius = np.array([tip.radius for tip in scene.hand.tips])
    compression, tilt = run.q[:, 5:7], tilts(run)
    normal, across = multipliers[:, :2], np.abs(multipliers[:, 2:])
    friction = np.inf if scene.friction is None else scene.friction
    with np.errstate(invalid="ignore"):  # infinity times zero, where nothing limits the friction
        slips = (across > friction * normal) & np.isfinite(friction)
    height = np.inf if scene.grasped.height is None else scene.grasped.height
    by_tip: dict[str, Any] = {
        "separated": compression < -1e-9 * radius,
        "crushed": compression >= radius,
        "folded": np.abs(tilt) >= np.pi / 2,
        "pulling": normal < 0.0,
        "slipping": slips,
        "rim": compression > radius * (1.0 - np.abs(np.sin(tilt))),
        "off_face": places(run) > 0.5 * height,
    }
    return {name: tips.any(axis=1) for name, tips in by_tip.items()}
