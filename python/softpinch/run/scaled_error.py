"""How wrong a trajectory is: what "error" means in every report.

The largest over components of |difference|, each component scaled by its largest size along the
run; q, p and lambda apart. A component that is round-off, by symmetry or because nothing moves, is
scaled by the largest with its unit, or by what is usual for the scene where that is more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from ..scene.scene import Scene
from ..support.arrays import Floats

Units: TypeAlias = Sequence[Sequence[int]]

# Components that share a unit: of q and p metres and radians, of lambda newtons.
_MIXED: Units = ((0, 1, 5, 6, 7, 8), (2, 3, 4))
UNITS: Mapping[str, Units] = {"q": _MIXED, "p": _MIXED, "multipliers": ((0, 1, 2, 3),)}
# Below this share of the largest with its unit a component is round-off.
_ROUND_OFF = 1e-9


def usual(scene: Scene) -> dict[str, Floats]:
    """What is usual for a scene, by quantity and component.

    Lengths: the larger tip's radius a; angles: one; rates: these times sqrt(E a / M), at which such
    a tip moves the object; multipliers: E a^2. What a float cannot hold is the largest float: then
    no result of a run is more than round-off of it.
    """
    tips = scene.hand.tip if isinstance(scene.hand.tip, tuple) else (scene.hand.tip,)
    radius = max(tip.radius for tip in tips)
    modulus = max(tip.youngs_modulus for tip in tips)
    places = np.full(9, radius)
    places[list(_MIXED[1])] = 1.0
    with np.errstate(over="ignore"):
        pace = np.sqrt(np.float64(modulus) * radius / scene.grasped.mass)
        force = np.full(4, modulus * radius * radius)
        found = {"q": places, "p": pace * places, "multipliers": force}
    return {name: np.minimum(sizes, np.finfo(np.float64).max) for name, sizes in found.items()}


def scales(name: str, rows: Floats, usual: Mapping[str, Floats] | None = None) -> Floats:
    """What the differences of each component of "q", "p" or "multipliers" are divided by, (k,).

    Args:
        name: Which quantity.
        rows: Its trajectory (n, k).
        usual: What is usual for the scene, where that is known.

    Returns:
        Each component's largest size along the run; where it is below 1e-9 of the largest with its
        unit, or of what is usual, the larger of these two instead. Where all with its unit are zero
        and nothing is usual, 1: an error of any size counts.
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
    """The largest with each component's unit along a run, or what is usual if more, (k,)."""
    sizes = np.maximum(np.abs(rows).max(axis=0, initial=0.0), usual[name])
    for unit in map(list, UNITS[name]):
        sizes[unit] = sizes[unit].max()
    return np.asarray(sizes)


def by_row(value: Floats, exact: Floats | float, scale: Floats) -> Floats:
    """The largest scaled difference of the components in each row; inf where one overflows.

    Args:
        value: (n, k), or one row (k,).
        exact: The same, or a number that all are compared with.
        scale: (k,), from `scales`.

    Returns:
        (n,), or of one row ().
    """
    with np.errstate(invalid="ignore", over="ignore"):
        worst = (np.abs(value - exact) / scale).max(axis=-1, initial=0.0)
    return np.where(np.isfinite(worst), worst, np.inf)


def errors(
    result: Any, expected: Any, along: Mapping[str, Floats] | None = None
) -> dict[str, Floats]:
    """The error of a result at each of its instants.

    Take the maximum over whichever rows are asked about: all, the last, those between switches.

    Args:
        result: A `Run` or anything else with t (n,) and some of q (n, 9), p (n, 9) and multipliers
            (n, 4). What it lacks (AttributeError) is left out.
        expected: The same at the same instants.
        along: Name -> `scales` of the whole run; None takes those of `expected`, which a
            `reference.Reference` has, or else makes them of its rows.

    Returns:
        Name -> (n,), as `by_row` has it.

    Raises:
        ValueError: The instants differ.
    """
    if not np.array_equal(np.asarray(result.t), np.asarray(expected.t)):
        raise ValueError("errors: the result's instants differ from those it is compared with")
    along = along or getattr(expected, "scales", None)
    found = {}
    for name in UNITS:
        if not (hasattr(result, name) and hasattr(expected, name)):
            continue
        rows, right = (np.asarray(getattr(one, name), np.float64) for one in (result, expected))
        found[name] = by_row(rows, right, along[name] if along else scales(name, right))
    return found


def largest(
    result: Any, expected: Any, along: Mapping[str, Floats] | None = None
) -> dict[str, float]:
    """The largest of `errors` over all instants, by name."""
    found = errors(result, expected, along)
    return {name: float(rows.max(initial=0.0)) for name, rows in found.items()}
