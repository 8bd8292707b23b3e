"""How wrong a trajectory is: what "error" means in every report.

The largest over components of |difference|, each component scaled by its largest size along the
run; q, p and lambda apart. A component that is round-off by symmetry is scaled by its unit's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._record import Floats

Units: TypeAlias = Sequence[Sequence[int]]

# Components that share a unit: of q and p metres and radians, of lambda newtons.
_MIXED: Units = ((0, 1, 5, 6, 7, 8), (2, 3, 4))
UNITS: Mapping[str, Units] = {"q": _MIXED, "p": _MIXED, "multipliers": ((0, 1, 2, 3),)}
# Below this share of the largest with its unit a component is round-off.
_ROUND_OFF = 1e-9


def scales(rows: Floats, units: Units) -> Floats:
    """What the differences of each component are divided by, (k,).

    Args:
        rows: The trajectory (n, k), n > 0.
        units: Which components share a unit.

    Returns:
        Each component's largest size along the run; that of the largest with its unit where it is
        below 1e-9 of it, and 1 where all with its unit are zero: an error of any size counts.
    """
    sizes = np.abs(rows).max(axis=0)
    for unit in map(list, units):
        largest = sizes[unit].max()
        sizes[unit] = np.where(sizes[unit] < _ROUND_OFF * largest, largest, sizes[unit])
    return np.where(sizes == 0, 1.0, sizes)


def errors(
    result: Any, expected: Any, along: Mapping[str, Floats] | None = None
) -> dict[str, NDArray[np.float64]]:
    """The error of a result at each of its instants.

    Take the maximum over whichever rows are asked about: all, the last, those between switches.

    Args:
        result: A `Run` or anything else with t (n,) and some of q (n, 9), p (n, 9) and multipliers
            (n, 4). What it lacks (AttributeError) is left out.
        expected: The same at the same instants.
        along: Name -> `scales` of the whole run; None takes those of `expected`, which a
            `reference.Reference` has, or else makes them of its rows.

    Returns:
        Name -> the largest scaled difference of the components, (n,); infinite where a number is
        not finite.

    Raises:
        ValueError: The instants differ.
    """
    if not np.array_equal(np.asarray(result.t), np.asarray(expected.t)):
        raise ValueError("errors: the result's instants differ from those it is compared with")
    along = along or getattr(expected, "scales", None)
    found = {}
    for name, units in UNITS.items():
        if not (hasattr(result, name) and hasattr(expected, name)):
            continue
        rows, right = (np.asarray(getattr(one, name), np.float64) for one in (result, expected))
        sizes = along[name] if along else scales(right, units)
        with np.errstate(invalid="ignore", over="ignore"):
            worst = (np.abs(rows - right) / sizes).max(axis=1)
        found[name] = np.where(np.isfinite(worst), worst, np.inf)
    return found


def largest(
    result: Any, expected: Any, along: Mapping[str, Floats] | None = None
) -> dict[str, float]:
    """The largest of `errors` over all instants, by name."""
    found = errors(result, expected, along)
    return {name: float(rows.max(initial=0.0)) for name, rows in found.items()}
