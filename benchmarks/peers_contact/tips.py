"""A hand in MuJoCo whose tips are the paper's: compliant joints with the energy (4).

Each tip's surface is a body on two sliding joints of its jaw, for d_n and d_t. Their masses (14)
are the joints' armature, their viscosities the joints' damping, and MuJoCo's callback for passive
forces adds the forces of (4) and the couple on the cube in every evaluation. What remains of
MuJoCo's own contact is that a surface neither enters the cube nor slips on it. As the jaws do not
turn, and the cube hardly does, d_n along the jaw's way is that of (9).
"""

from __future__ import annotations

import math
from typing import Any

import carry_peers
import creep

YOUNGS_MODULUS, VISCOSITY, SURFACE = 3e5, 100.0, 0.01  # of the problems; Pa, N s/m, kg
# Of the bodies, kg: the masses of (14) are armature, which each joint feels for itself.
_TRACE = 1e-5
SIDES = (("right", -1), ("left", 1))


def forces(dn: float, dt: float, tilt: float) -> tuple[float, float, float]:
    """The derivatives of (4) by d_n, d_t and the tilt, N and N m; a tip cannot be stretched."""
    dn = max(dn, 0.0)
    scale, tan = math.pi * YOUNGS_MODULUS, math.tan(tilt)
    stretched = 1.0 + tan * tan  # 1 / cos^2
    return (
        scale * (dn * dn * stretched + 2.0 * dn * dt * tan + dt * dt),
        scale * (dn * dn * tan + 2.0 * dn * dt),
        scale * dn * dn * stretched * (2.0 * dn * tan / 3.0 + dt),
    )


def pinch(options: dict[str, str], time_constant: float) -> str:
    """`creep.pinch` on the carriage, with joints between jaws and balls."""
    text = creep.pinch(options, time_constant, carry_peers.CARRIAGE)
    for name, side in SIDES:
        joint = f'<joint name="{name}" type="slide" axis="{side} 0 0"/>'
        ball = '<geom type="sphere" size="0.02" mass="0.1"/></body>'
        head, found, tail = text.partition(joint + ball)
        assert found
        inertia = '<inertial pos="0 0 0" mass="{}" diaginertia="1e-4 1e-4 1e-4"/>'
        slides = "".join(
            f'<joint name="{name}_{kind}" type="slide" axis="{axis}" armature="{SURFACE}" '
            f'damping="{VISCOSITY}"/>'
            for kind, axis in (("dn", f"{-side} 0 0"), ("dt", "0 0 -1"))
        )
        surface = f'<geom type="sphere" size="0.02" mass="{_TRACE}"/>'
        jaw = joint + inertia.format(carry_peers.FINGER)
        text = f"{head}{jaw}<body>{slides}{surface}</body></body>{tail}"
    return text


class PaperTips(carry_peers.MuJoCo):
    """The hand of `carry_peers.MuJoCo` with the paper's tips."""

    def __init__(self, options: dict[str, str], time_constant: float, step: float) -> None:
        """Takes MuJoCo's options, the time constant of its contacts, s, and the step, s."""
        super().__init__(options, time_constant, step, pinch(options, time_constant))
        self._tips = [
            (side, *(int(self._model.joint(f"{name}_{kind}").qposadr[0]) for kind in ("dn", "dt")))
            for name, side in SIDES
        ]

    def _passive(self, _: Any, data: Any) -> None:
        q, added = data.qpos.tolist(), data.qfrc_passive
        # The hinge's axis is that of y: clockwise in the plane of x and z.
        theta, moment = -q[2], 0.0
        for side, normal, shear in self._tips:
            by_dn, by_dt, couple = forces(q[normal], q[shear], side * theta)
            added[normal] -= by_dn
            added[shear] -= by_dt
            moment += side * couple
        added[2] += moment

    def advance(self, x: float, y: float, steps: int = 1) -> None:
        """As `Peer.advance`."""
        self._mujoco.set_mjcb_passive(self._passive)
        try:
            super().advance(x, y, steps)
        finally:
            self._mujoco.set_mjcb_passive(None)

    def shears(self) -> list[float]:
        """d_t of both tips, m."""
        return [float(self._data.qpos[shear]) for _, _, shear in self._tips]

    def compressions(self) -> list[float]:
        """d_n of both tips, m."""
        return [float(self._data.qpos[normal]) for _, normal, _ in self._tips]
