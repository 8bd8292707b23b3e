"""The rests after the operations, and the energy around them.

The energy V = P + P_g, (5) and (16), is taken as a function of the object's pose and both shears;
the fingers are held, and the compressions follow from C^H = 0 (9).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.rest import Equilibrium, equilibrium
from ..run import measures as m
from ..run.evaluate import evaluate
from ..run.run import Run
from ..scene import outline
from ..scene.scene import Scene, State
from ..support.arrays import Floats

SIGNS = np.array(outline.SIGNS)
_AT_REST = np.zeros(9)
# The ways in x, y and theta along which the energy is measured: edges, faces and corners of a cube.
_CUBE = np.array([way for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]) - 1.0
WAYS = _CUBE / np.linalg.norm(_CUBE, axis=1, keepdims=True)
# The step for differences of the energy, m.
_STEP = 2e-6
# Opposite changes of the grips of both tips, along which the object turns.
TURNING = np.array([1.0, -1.0])
_SECANTS = 30


def energies(scene: Scene, places: Floats) -> tuple[Floats, Floats]:
    """The elastic energy (5) and the energy of gravity (16) at coordinates (n, 9), (n,), J."""
    found = [evaluate(scene, 0.0, q, _AT_REST).energies for q in places]
    return np.array([each.elastic for each in found]), np.array([each.gravity for each in found])


def lever_arms(scene: Scene) -> Floats:
    """E_1 and E_2 of (30), the distances in the no-slip constraint (12), (2,), m."""
    return -0.5 * SIGNS * scene.grasped.width - scene.grasped.com_offset


def without_slip(scene: Scene, q: ArrayLike, way: ArrayLike, far: ArrayLike) -> Floats:
    """The coordinates after the object has moved without slip of its tips, (n, 9).

    It moves on a straight way, the fingers are held. On it (12) is a quadrature in closed form:
    d_t changes by the integral of sin(theta) dx - cos(theta) dy - E dtheta.

    Args:
        scene: The scene.
        q: The coordinates at the beginning (9,).
        way: The change of x, y and theta (3,) per unit of `far`.
        far: How far it has moved (n,).
    """
    q, far = np.asarray(q, np.float64), np.asarray(far, np.float64)
    dx, dy, turn = np.asarray(way, np.float64)
    moved = np.repeat(q[None], len(far), axis=0)
    moved[:, :3] += far[:, None] * [dx, dy, turn]
    # The means of sine and cosine on the way.
    half = 0.5 * far * turn
    middle, share = q[2] + half, np.sinc(half / np.pi)
    along = share * (np.sin(middle) * dx - np.cos(middle) * dy)
    moved[:, 7:] += far[:, None] * (along[:, None] - lever_arms(scene) * turn)
    # C^H = 0 (9), in which the compressions stand by themselves.
    for row in moved:
        row[5:7] -= evaluate(scene, 0.0, row, _AT_REST).residuals[:2]
    return moved


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """The rest after an operation, and the energy around it.

    Attributes:
        number: The number of the operation.
        reached: q at the end of the operation (9,).
        found: The equilibrium to which no-slip leads from there.
        weightless: The equilibrium to which no-slip leads from there without gravity.
        lowest: The member of the family with the lowest energy, among those that the object
            reaches if the tips slip by opposite amounts.
        slope: The largest |derivative| of V on `WAYS`, N, with a tip's radius as the unit of angle.
        curvature: The smallest second derivative of V on `WAYS`, N/m.
        rise: The smallest rise of V at 1 mm from the rest on `WAYS`, J.
        turning: The second derivative of the elastic energy (and of V) by the object's rotation
            about its centre of gravity, without slip, N m/rad.
        relaxed: This derivative while x and y follow from the balance of forces, N m/rad.
    """

    number: int
    reached: Floats
    found: Equilibrium
    weightless: Equilibrium
    lowest: Equilibrium
    slope: float
    curvature: float
    rise: float
    turning: float
    relaxed: float

    @property
    def q(self) -> Floats:
        """The coordinates at rest (9,); nan where there is no equilibrium."""
        return coordinates(self.found)

    @property
    def moved(self) -> Floats:
        """Rest pose minus the final pose: x, y, theta (3,), m and rad."""
        return np.asarray(self.q[:3] - self.reached[:3])

    @property
    def tilts(self) -> Floats:
        """theta_p of both tips (2,), rad."""
        return np.asarray(self.q[3:5] + SIGNS * self.q[2])

    @property
    def elastic_slope(self) -> float:
        """The derivative of the elastic energy alone by y, N: minus the weight, without slip."""
        sine, cosine = np.sin(self.q[2]), np.cos(self.q[2])
        pressing = self.found.multipliers[:2] @ -SIGNS * sine
        return float(pressing - cosine * self.found.multipliers[2:].sum())

    @property
    def freed(self) -> float:
        """The elastic energy that both tips lose if they may slip under the held object, J.

        (5) is quadratic in d_t, its slope is lambda^N.
        """
        moduli = np.array([tip.youngs_modulus for tip in self.found.scene.hand.tips])
        along = self.found.multipliers[2:]
        return float(np.sum(along**2 / (4.0 * np.pi * moduli * self.q[5:7])))


def coordinates(found: Equilibrium) -> Floats:
    """The coordinates of an equilibrium (9,); nan if there is none."""
    return np.full(9, np.nan) if found.state is None else found.state.q


def family_slope(found: Equilibrium) -> Floats:
    """The derivatives of V by the grips of the right and the left tip (2,), N.

    At rest only slip changes V: by lambda^N times the slip, which is what the shears change along
    the family beyond (12).
    """
    q = coordinates(found)
    rows = np.zeros((2, 3))
    rows[:, 0], rows[:, 1], rows[:, 2] = -np.sin(q[2]), np.cos(q[2]), lever_arms(found.scene)
    slips = found.neutral[:, 7:] + found.neutral[:, :3] @ rows.T
    return np.asarray(slips @ found.multipliers[2:])


def members(found: Equilibrium, changes: ArrayLike) -> list[Equilibrium]:
    """The members of the family whose grips differ by these opposite changes, m."""
    changes = np.atleast_1d(np.asarray(changes, np.float64))
    return [
        equilibrium(found.scene, near=found.state, grip=found.grip + change * TURNING)
        for change in changes
    ]


def lowest_member(found: Equilibrium) -> Equilibrium:
    """The member with the lowest energy among those that `members` gives, by the secant method."""
    first, here, change = found, found, 1e-5
    slope = float(TURNING @ family_slope(first))
    for _ in range(_SECANTS):
        here = members(found, change)[0]
        now = float(TURNING @ family_slope(here))
        # Round-off alone is left.
        if here.state is None or abs(now) < 1e-11 * np.abs(here.multipliers).sum():
            break
        if now == slope:
            break
        before = float((first.grip - found.grip) @ TURNING) / 2.0
        first, slope, change = here, now, change - now * (change - before) / (now - slope)
    return here


def around(scene: Scene, q: Floats) -> tuple[float, float, float]:
    """The largest |slope|, the smallest curvature, and the smallest rise of V on `WAYS`."""
    unit = np.array([1.0, 1.0, 1.0 / max(tip.radius for tip in scene.hand.tips)])
    slopes, curvatures, rises = [], [], []
    for way in WAYS * unit:
        places = without_slip(scene, q, way, [-_STEP, 0.0, _STEP, 1e-3])
        before, here, after, far = np.sum(energies(scene, places), axis=0)
        slopes.append(abs(after - before) / (2.0 * _STEP))
        curvatures.append((after - 2.0 * here + before) / _STEP**2)
        rises.append(far - here)
    return float(np.max(slopes)), float(np.min(curvatures)), float(np.min(rises))


def rest_at(scene: Scene, q: Floats, time: float, number: int = 1) -> Rest:
    """The rest to which a settled state leads, and the energy around it."""
    state = State(q, time=time)
    found = equilibrium(scene, near=state)
    weightless = equilibrium(replace(scene, gravity=0.0), near=state)
    slope = curvature = rise = turning = relaxed = np.nan
    lowest = found
    if found.state is not None:
        lowest = lowest_member(found)
        slope, curvature, rise = around(scene, found.state.q)
        places = without_slip(scene, found.state.q, (0.0, 0.0, 1.0), [-1e-3, 0.0, 1e-3])
        before, here, after = energies(scene, places)[0]
        turning = float((after - 2.0 * here + before) / 1e-6)
        k = found.stiffness
        relaxed = float(k[2, 2] - k[2, :2] @ np.linalg.solve(k[:2, :2], k[:2, 2]))
    return Rest(
        number=number,
        reached=q,
        found=found,
        weightless=weightless,
        lowest=lowest,
        slope=slope,
        curvature=curvature,
        rise=rise,
        turning=turning,
        relaxed=relaxed,
    )


def rests(run: Run) -> list[Rest]:
    """The rests after all operations that the run has reached."""
    ends = [end for _, end in m.operations(run)]
    return [
        # At the end of an operation the schedule already has the next target.
        rest_at(run.scene, q, float(np.nextafter(end, -np.inf)), k + 1)
        for k, (q, end) in enumerate(zip(m.settled(run), ends, strict=True))
        if np.isfinite(q).all()
    ]
