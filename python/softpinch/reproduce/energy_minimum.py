"""The rests after the operations: the local minimum of elastic energy (LMEE), in which sense.

The paper concludes that the LMEE plays an important role, and leaves the definition to its
references [1] and [2]. Here the energy is tried on displacements without slip, from the rest after
each operation; docs/model.md, "At rest: the local minimum of elastic energy", has the mathematics,
and the definitions for which the rest is no minimum.

The energy V = P + P_g, (5) and (16), is taken as a function of the object's pose and both shears;
the fingers are held, and the compressions follow from C^H = 0 (9).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.rest import Equilibrium, equilibrium
from ..run import Run, evaluate
from ..run import measures as m
from ..scene import Scene, State, outline
from ..support import Floats, Table

# How far the curves of the figure reach to both sides of the rests, rad, and their points.
_MARGIN, _POINTS = np.deg2rad(4.0), 81


SIGNS = np.array(outline.SIGNS)
_AT_REST = np.zeros(9)
# The ways in x, y and theta along which the energy is measured: edges, faces and corners of a cube.
_CUBE = np.array([way for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]) - 1.0
WAYS = _CUBE / np.linalg.norm(_CUBE, axis=1, keepdims=True)
# The step for differences of the energy, m.
_STEP = 2e-6


def energies(scene: Scene, places: Floats) -> tuple[Floats, Floats]:
    """The elastic energy (5) and the energy of gravity (16) at coordinates (n, 9), (n,), J."""
    found = [evaluate(scene, 0.0, q, _AT_REST).energies for q in places]
    return np.array([each.elastic for each in found]), np.array([each.gravity for each in found])


def without_slip(scene: Scene, q: ArrayLike, way: ArrayLike, far: ArrayLike) -> Floats:
    """The coordinates after the object has moved without slip of its tips by `far` (n,), (n, 9).

    It moves from `q` along `way`, the change of x, y and theta per unit of `far`. By (12) d_t
    changes by the integral of sin(theta) dx - cos(theta) dy - E dtheta, in closed form.
    """
    q, far = np.asarray(q, np.float64), np.asarray(far, np.float64)
    dx, dy, turn = np.asarray(way, np.float64)
    moved = np.repeat(q[None], len(far), axis=0)
    moved[:, :3] += far[:, None] * [dx, dy, turn]
    # The means of sine and cosine on the way.
    half = 0.5 * far * turn
    middle, share = q[2] + half, np.sinc(half / np.pi)
    along = share * (np.sin(middle) * dx - np.cos(middle) * dy)
    # E_1 and E_2 of (30), the distances in (12).
    arms = -0.5 * SIGNS * scene.grasped.width - scene.grasped.com_offset
    moved[:, 7:] += far[:, None] * (along[:, None] - arms * turn)
    # C^H = 0 (9), in which the compressions stand by themselves.
    for row in moved:
        row[5:7] -= evaluate(scene, 0.0, row, _AT_REST).residuals[:2]
    return moved


@dataclass(frozen=True, kw_only=True, eq=False)
class Rest:
    """The rest after an operation, and the energy around it."""

    number: int  # of the operation
    reached: Floats  # q at the end of the operation (9,)
    found: Equilibrium  # to which no-slip leads from there
    weightless: Equilibrium  # to which no-slip leads from there without gravity
    # The largest |derivative| of V on `WAYS`, N, with a tip's radius as the unit of angle.
    slope: float
    curvature: float  # the smallest second derivative of V on `WAYS`, N/m
    rise: float  # the smallest rise of V at 1 mm from the rest on `WAYS`, J
    # The second derivative of the elastic energy (and of V) by the object's rotation about its
    # centre of gravity, without slip, N m/rad.
    turning: float

    @property
    def q(self) -> Floats:
        """The coordinates at rest (9,); nan where there is no equilibrium."""
        return coordinates(self.found)

    @property
    def moved(self) -> Floats:
        """Rest pose minus the final pose: x, y, theta (3,), m and rad."""
        return np.asarray(self.q[:3] - self.reached[:3])

    @property
    def elastic_slope(self) -> float:
        """The derivative of the elastic energy alone by y, N: minus the weight, without slip."""
        sine, cosine = np.sin(self.q[2]), np.cos(self.q[2])
        pressing = self.found.multipliers[:2] @ -SIGNS * sine
        return float(pressing - cosine * self.found.multipliers[2:].sum())


def coordinates(found: Equilibrium) -> Floats:
    """The coordinates of an equilibrium (9,); nan if there is none."""
    return np.full(9, np.nan) if found.state is None else found.state.q


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
    slope = curvature = rise = turning = np.nan
    if found.state is not None:
        slope, curvature, rise = around(scene, found.state.q)
        places = without_slip(scene, found.state.q, (0.0, 0.0, 1.0), [-1e-3, 0.0, 1e-3])
        before, here, after = energies(scene, places)[0]
        turning = float((after - 2.0 * here + before) / 1e-6)
    around_it = {"slope": slope, "curvature": curvature, "rise": rise, "turning": turning}
    return Rest(number=number, reached=q, found=found, weightless=weightless, **around_it)


def rests(run: Run) -> list[Rest]:
    """The rests after all operations that the run has reached."""
    ends = [end for _, end in m.operations(run)]
    return [
        # At the end of an operation the schedule already has the next target.
        rest_at(run.scene, q, float(np.nextafter(end, -np.inf)), k + 1)
        for k, (q, end) in enumerate(zip(m.settled(run), ends, strict=True))
        if np.isfinite(q).all()
    ]


def table(found: Sequence[Rest]) -> Table:
    """The rest after each operation, and the energy around it."""
    rows = []
    for rest in found:
        row = [
            np.rad2deg(rest.q[2]),
            1e3 * rest.found.energy,
            1e3 * rest.found.elastic_energy,
            1e6 * float(np.abs(rest.moved[:2]).max()),
            rest.slope,
            1e-3 * rest.curvature,
            1e3 * rest.rise,
            rest.turning,
            rest.elastic_slope,
            1e3 * float(coordinates(rest.weightless)[1] - rest.q[1]),
        ]
        rows.append((rest.number, *map(float, row)))
    columns = (
        *("operation", "theta [deg]", "P + P_g [mJ]", "P [mJ]", "operation ends within [um]"),
        *("largest slope [N]", "smallest second derivative [N/mm]", "smallest rise on 1 mm [mJ]"),
        *("by theta [N m/rad]", "slope of P in y [N]", "minimum of P is higher by [mm]"),
    )
    return Table(columns=columns, rows=tuple(rows))


def curves(found: Sequence[Rest], titles: Sequence[str]) -> dict[str, Floats]:
    """Angle, rad, and energy beyond that at rest, J, while the object turns without slip (2, n)."""
    drawn = {}
    for rest in found:
        if rest.found.state is None:
            continue
        turns = np.linspace(-_MARGIN, _MARGIN, _POINTS)
        turned = without_slip(rest.found.scene, rest.q, (0.0, 0.0, 1.0), turns)
        energy = np.sum(energies(rest.found.scene, turned), axis=0) - rest.found.energy
        drawn[titles[rest.number - 1]] = np.stack([turned[:, 2], energy])
    return drawn
