"""Whether the object rests in a local minimum of elastic energy (LMEE), and in which sense.

The paper concludes that the LMEE plays an important role, and leaves the definition to its
references [1] and [2]. The definitions that are possible are tried at the rest after each
operation; docs/model.md, "At rest: the local minimum of elastic energy", has the mathematics.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..run import measures as m
from ..run.run import Run
from ..support.arrays import Floats
from ..support.table import Table
from .experiment import Runs
from .finding import BANDS, FAILS, HOLDS, Finding, observation
from .rests import (
    WAYS,
    Rest,
    coordinates,
    energies,
    family_slope,
    members,
    rest_at,
    without_slip,
)

# The slope of the energy that counts as zero, N: its error by differences is a tenth of it.
_FLAT = 1e-4
# How far the curves of the figure reach beyond the rests, rad, and their points.
_MARGIN, _POINTS = np.deg2rad(4.0), 81


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
    """Whether elastic energy and gravity have a minimum here on every way without slip.

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
