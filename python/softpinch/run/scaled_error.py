"""The error of a trajectory, as every report defines it.

The error is the largest |difference| over components, each scaled by its largest magnitude along
the run; q, p and lambda have separate errors. A component may be nothing but round-off, by symmetry
or because nothing moves. It is then scaled by the largest component with its unit, or by a typical
magnitude for the scene if that is larger.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..scene.fields import ESTIMATED, QUANTITIES, quantity
from ..scene.parts import jaws, others, stiffness
from ..scene.scene import Scene
from ..support.arrays import Floats

# Groups of components that share a unit: metres and radians in q and p, newtons in lambda.
UNITS: Mapping[str, Sequence[Sequence[int]]] = {
    name: [
        [k for k, one in enumerate(QUANTITIES[name].units) if one == unit]
        for unit in dict.fromkeys(QUANTITIES[name].units)
    ]
    for name in ESTIMATED
}
# A component below this share of the largest one with its unit is round-off.
_ROUND_OFF = 1e-9


def usual(scene: Scene) -> dict[str, Floats]:
    """Returns typical magnitudes for a scene: quantity -> one for each component.

    They are the larger tip's radius a for lengths, 1 for angles, E a^2 for multipliers, and for
    rates a or 1 times sqrt(E a / M), the frequency of an object of mass M on such a tip.
    """
    tips = scene.hand.tips
    radius = max(tip.radius for tip in tips)
    # With it (5) is as stiff as the tip's law is at full compression.
    modulus = (
        max(
            float(stiffness(scene, k, np.array([tip.radius]))[0]) / (2.0 * np.pi * tip.radius)
            for k, tip in enumerate(tips)
        )
        if others(scene)
        else max(tip.youngs_modulus for tip in tips)
    )
    places = np.full(9, radius)
    places[[k for k, unit in enumerate(quantity("q", jaws(scene)).units) if unit == "rad"]] = 1.0
    pace = np.sqrt(modulus * radius / scene.grasped.mass)
    force = np.full(4, modulus * radius * radius)
    return {"q": places, "p": pace * places, "multipliers": force}


def scales(name: str, rows: Floats, usual: Mapping[str, Floats] | None = None) -> Floats:
    """Returns the largest magnitude of each component (k,) along the rows (n, k) of a run.

    The largest one with its unit replaces it if it is below 1e-9 of that; the typical magnitude in
    `usual` does if all with the unit are below 1e-9 of that. It is 1 if all are zero.
    """
    sizes = np.abs(rows).max(axis=0, initial=0.0)
    for unit in map(list, UNITS[name]):
        largest = sizes[unit].max()
        if usual is not None:
            common = float(usual[name][unit].max())
            largest = common if largest < _ROUND_OFF * common else largest
        sizes[unit] = np.where(sizes[unit] < _ROUND_OFF * largest, largest, sizes[unit])
    return np.where(sizes == 0, 1.0, sizes)


def common(name: str, rows: Floats, usual: Mapping[str, Floats]) -> Floats:
    """Returns the largest magnitude with each component's unit along a run, or in `usual`, (k,)."""
    sizes = np.maximum(np.abs(rows).max(axis=0, initial=0.0), usual[name])
    for unit in map(list, UNITS[name]):
        sizes[unit] = sizes[unit].max()
    return np.asarray(sizes)


def by_row(value: Floats, exact: Floats | float, scale: Floats) -> Floats:
    """Returns the largest scaled difference in each row, (n, k) or (k,); inf for NaN."""
    with np.errstate(invalid="ignore", over="ignore"):
        worst = (np.abs(value - exact) / scale).max(axis=-1, initial=0.0)
    return np.where(np.isfinite(worst), worst, np.inf)


def at_end(
    last: Mapping[str, Floats], expected: Any, along: Mapping[str, Floats]
) -> dict[str, float]:
    """Returns the errors of last rows (k,) by quantity; `along` has the scales of the whole run."""
    return {k: float(by_row(row, getattr(expected, k)[-1], along[k])) for k, row in last.items()}


def largest(value: Any, exact: Any, along: Mapping[str, Floats]) -> dict[str, float]:
    """Returns the largest errors over all instants by quantity; `along` is as for `at_end`."""
    pairs = ((k, by_row(getattr(value, k), getattr(exact, k), along[k])) for k in along)
    return {name: float(rows.max(initial=0.0)) for name, rows in pairs}
