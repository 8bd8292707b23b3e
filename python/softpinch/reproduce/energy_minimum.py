"""The rests after the operations: the local minimum of elastic energy (LMEE), in which sense.

The paper concludes that the LMEE plays an important role, and leaves the definition to its
references [1] and [2]. The definitions that are possible are tried at the rest after each
operation; docs/model.md, "At rest: the local minimum of elastic energy", has the mathematics.

The energy V = P + P_g, (5) and (16), is taken as a function of the object's pose and both shears;
the fingers are held, and the compressions follow from C^H = 0 (9).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..analysis.rest import Equilibrium, equilibrium
from ..run import measures as m
from ..run.evaluate import evaluate
from ..run.run import Run
from ..scene import outline
from ..scene.scene import Scene, State
from ..support.arrays import Floats
from ..support.table import Table
from .finding import BANDS, FAILS, HOLDS, Finding, observation

if TYPE_CHECKING:
    from .experiment import Runs

# The slope of the energy that counts as zero, N: its error by differences is a tenth of it.
_FLAT = 1e-4
# How far the curves of the figure reach beyond the rests, rad, and their points.
_MARGIN, _POINTS = np.deg2rad(4.0), 81


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


class EnergyCurves(NamedTuple):
    """The energy around a rest, by the angle of the object, rad, and relative to the rest, J.

    Attributes:
        rest: The rest (2,): angle, energy.
        rolled: While the object turns about its centre of gravity without slip (2, n).
        family: The energy of other states of rest, which need slip (2, k).
        lowest: The one of these with the lowest energy (2,).
    """

    rest: Floats
    rolled: Floats
    family: Floats
    lowest: Floats


def is_minimum(rest: Rest) -> bool:
    """True if elastic energy and gravity have a minimum here on every way without slip.

    The operation must have ended here, too, within `BAND`.
    """
    arrived = bool((np.abs(rest.moved) <= BANDS).all())
    return arrived and rest.slope <= _FLAT and rest.curvature > 0.0 and rest.turning > 0.0


def without_slipping(run: Run, found: Sequence[Rest]) -> Finding:
    """LMEE in the sense that holds: elastic energy and gravity, displacements without slip."""
    every = len(found) == len(m.operations(run)) and all(map(is_minimum, found))
    curvature = np.array([rest.curvature for rest in found])
    value = float(curvature.min()) if every else np.nan
    words = "some operations have no such rest"
    if every:
        turning = np.array([rest.turning for rest in found])
        rise = min(rest.rise for rest in found)
        off = np.max([np.abs(rest.moved) for rest in found], axis=0) * [1e6, 1e6, 180e3 / np.pi]
        words = (
            f"it holds with the energy of gravity, and while no tip slips: on {len(WAYS)} ways "
            f"from each of the {len(found)} rests elastic energy and gravity have no slope, "
            f"second derivatives of {1e-3 * value:.1f} to {1e-3 * curvature.max():.1f} N/mm on "
            f"the softest way, and rise by {1e3 * rise:.1f} mJ or more on 1 mm. Gravity does not "
            "change where the object only turns about its centre of gravity: there elastic energy "
            f"alone has the minimum, with {turning.min():.1f} to {turning.max():.1f} N m/rad. The "
            f"operations end within {off[:2].max():.2g} um and {off[2]:.2g} mdeg of these rests"
        )
    return Finding(
        claim="the object rests in a local minimum of elastic energy (LMEE)",
        source="VII, by [1], [2]",
        verdict=HOLDS if every and value > 0.0 else FAILS,
        measure="smallest second derivative of elastic energy and gravity without slip, N/m",
        value=value,
        limit=0.0,
        evidence=words,
    )


def elastic_alone(found: Sequence[Rest]) -> Finding:
    """The distance of the rests from the minimum of elastic energy alone."""
    claim = "elastic energy alone is not stationary at rest: its slope in y is the weight"
    measure = "how far the rest is below the minimum of elastic energy alone, mm"
    there = [coordinates(rest.weightless) - rest.q for rest in found]
    rises = [1e3 * float(move[1]) for move in there]
    turns = [1e3 * float(np.rad2deg(abs(move[2]))) for move in there]
    less = [1e3 * (rest.found.elastic_energy - rest.weightless.elastic_energy) for rest in found]
    weights = [-rest.elastic_slope for rest in found]
    return observation(
        claim,
        measure,
        max(rises),
        f"the weight is {_span(weights, '.3f')} N. Without gravity the minimum would be "
        f"{_span(rises, '.3f')} mm higher, turned by at most {max(turns):.2g} mdeg, with "
        f"{_span(less, '.3f')} mJ less of the "
        f"{_span([1e3 * rest.found.elastic_energy for rest in found], '.0f')} mJ: so close that "
        "it makes little difference",
    )


def if_tips_slip(found: Sequence[Rest]) -> Finding:
    """The energy that a grasp can lose if the tips may slip."""
    claim = "if tips may slip the rest is no minimum, nor the equilibrium with the lowest energy"
    measure = "largest energy that the rest has more than the lowest member of its family, mJ"
    less = [1e3 * (rest.found.energy - rest.lowest.energy) for rest in found]
    worst = found[int(np.argmax(less))]
    angles = [np.rad2deg(coordinates(at)[2]) for at in (worst.found, worst.lowest)]
    largest = max(float(np.abs(rest.found.multipliers[2:]).max()) for rest in found)
    return observation(
        claim,
        measure,
        max(less),
        f"the slope of elastic energy by the shears is lambda^N, at rest up to {largest:.1f} N, "
        "and with held fingers the grasp can rest in a family of states with two parameters. Along "
        "the one, with which the object slides down between the tips, the energy has no minimum; "
        "along the other it has one, but not where the operations end. After operation "
        f"{worst.number} the object rests at {angles[0]:.2f} deg, the member with the lowest "
        f"energy at {angles[1]:.2f} deg, {max(less):.1f} mJ lower",
    )


def upright_tips(found: Sequence[Rest]) -> Finding:
    """LMEE of one tip: at given compression (4) without shear is least at theta_p = 0."""
    claim = "the tips do not stand upright on the object, where the energy of one tip is least"
    measure = "largest |theta_p| at rest, deg"
    tilts = [float(np.rad2deg(np.abs(rest.tilts).max())) for rest in found]
    turned = [
        (rest.number, np.rad2deg(0.5 * (rest.q[3] - rest.q[4])), np.rad2deg(rest.q[2]))
        for rest in found
        if abs(rest.q[3] + rest.q[4]) < 0.9 * abs(rest.q[3] - rest.q[4])
    ]
    turns = "; ".join(f"{number}: {asks:.1f} and {has:.1f}" for number, asks, has in turned)
    return observation(
        claim,
        measure,
        max(tilts),
        "both tips together would ask for theta = (theta_1 - theta_2)/2, but without slip the "
        f"object rolls on them to the other side (operation, asked and real angle in deg): {turns}",
    )


def depends_on_the_way(found: Sequence[Rest], direct: Run) -> Finding:
    """The minimum is one on each way, not of a function of the pose."""
    claim = (
        "the energy at rest is no function of the pose: it is a minimum on each way without slip"
    )
    measure = "energy of the last rest after all operations less that straight from the start, mJ"
    value, comparison = np.nan, ""
    end = m.settled(direct)[-1]
    if np.isfinite(end).all():
        last = found[-1]
        other = rest_at(direct.scene, end, float(direct.t[-1]))
        value = 1e3 * (last.found.energy - other.found.energy)
        turned, raised = (np.rad2deg(1.0), 1e3) * (last.q - other.q)[[2, 1]]
        comparison = (
            f"; after all operations the last rest is {abs(raised):.2f} mm "
            f"{'higher' if raised > 0.0 else 'lower'}, turned by {turned:.3f} deg, and has "
            f"{value:.2f} mJ more than straight from the start, and both are minima"
        )
    skew = [
        (rest.found.stiffness - rest.found.stiffness.T)[0, 2] / np.cos(rest.q[2]) for rest in found
    ]
    return observation(
        claim,
        measure,
        value,
        "the sum of lambda^N carries the weight, and makes the stiffness differ from its transpose "
        f"by {_span(skew, '.3f')} N times cos(theta) in (x, theta): the object that "
        f"is led around a small loop in x and theta comes back with another energy{comparison}",
    )


def _span(values: Sequence[float], style: str) -> str:
    """The range of numbers in words."""
    low, high = format(min(values), style), format(max(values), style)
    return low if low == high else f"{low} to {high}"


def find(runs: Runs) -> tuple[Finding, ...]:
    """The verdict on LMEE, and the definitions for which it does not hold, at rests with all."""
    verdict = without_slipping(runs.operations, runs.rests)
    known = [
        rest
        for rest in runs.rests
        if all(each.state is not None for each in (rest.found, rest.weightless, rest.lowest))
    ]
    if not known:
        return (verdict,)
    return (
        verdict,
        elastic_alone(known),
        if_tips_slip(known),
        upright_tips(known),
        depends_on_the_way(known, runs.direct),
    )


def table(found: Sequence[Rest]) -> Table:
    """The rest after each operation, the energy around it, and the minima of other definitions."""
    rows = []
    for rest in found:
        there, lowest = coordinates(rest.weightless), coordinates(rest.lowest)
        slopes = family_slope(rest.found)
        row = [
            np.rad2deg(rest.q[2]),
            1e3 * rest.found.energy,
            1e3 * rest.found.elastic_energy,
            1e6 * float(np.abs(rest.moved[:2]).max()),
            rest.slope,
            1e-3 * rest.curvature,
            1e3 * rest.rise,
            rest.turning,
            rest.relaxed,
            rest.elastic_slope,
            1e3 * float(there[1] - rest.q[1]),
            *rest.found.multipliers[2:],
            1e3 * rest.freed,
            *slopes,
            np.rad2deg(lowest[2]),
            1e3 * (rest.found.energy - rest.lowest.energy),
            *np.rad2deg(rest.tilts),
        ]
        rows.append((rest.number, *map(float, row)))
    columns = (
        *("operation", "theta [deg]", "P + P_g [mJ]", "P [mJ]", "operation ends within [um]"),
        *("largest slope [N]", "smallest second derivative [N/mm]", "smallest rise on 1 mm [mJ]"),
        *("by theta [N m/rad]", "by theta, x and y follow [N m/rad]"),
        *("slope of P in y [N]", "minimum of P is higher by [mm]"),
        *("lambda_1^N [N]", "lambda_2^N [N]", "P that slip would free [mJ]"),
        *("slope by the right grip [N]", "slope by the left grip [N]"),
        *("theta of the lowest member [deg]", "it is lower by [mJ]"),
        *("theta_p1 [deg]", "theta_p2 [deg]"),
    )
    return Table(columns=columns, rows=tuple(rows))


def curves(found: Sequence[Rest], titles: Sequence[str]) -> dict[str, EnergyCurves]:
    """The energy without slip and along the family, around the rest after each operation."""
    drawn = {}
    for rest in found:
        if rest.found.state is None or rest.lowest.state is None:
            continue
        scene, q = rest.found.scene, rest.q
        turns = np.linspace(-_MARGIN, _MARGIN, _POINTS)
        rolled = without_slip(scene, q, (0.0, 0.0, 1.0), turns)
        # Along the family the angle is all but proportional to the change of the grips.
        per_grip = float(rest.found.neutral[:, 2] @ [1.0, -1.0])
        low, high = sorted((q[2], coordinates(rest.lowest)[2]))
        angles = np.linspace(low - _MARGIN, high + _MARGIN, _POINTS)
        family = members(rest.found, (angles - q[2]) / per_grip)
        places = [(coordinates(each)[2], each.energy) for each in family if each.state is not None]
        # Energies are relative to the rest.
        zero = np.array([0.0, rest.found.energy])
        drawn[titles[rest.number - 1]] = EnergyCurves(
            rest=np.array([q[2], 0.0]),
            rolled=np.stack([rolled[:, 2], np.sum(energies(scene, rolled), axis=0)])
            - zero[:, None],
            family=np.transpose(places) - zero[:, None],
            lowest=np.array([coordinates(rest.lowest)[2], rest.lowest.energy]) - zero,
        )
    return drawn
