"""What "error" means in every report: the largest over components of |difference|, each scaled.

The scale of a component is its largest size along the run; q, p and the multipliers are looked at
apart. A component that is round-off by symmetry is scaled by the largest one that has its unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# The components of each quantity that share a unit: metres and radians, and newtons.
_METRES, _RADIANS = [0, 1, 5, 6, 7, 8], [2, 3, 4]
UNITS = {"q": (_METRES, _RADIANS), "p": (_METRES, _RADIANS), "multipliers": ([0, 1, 2, 3],)}
# Below this share of the largest with its unit a component is round-off by symmetry.
_SYMMETRY = 1e-9


def scales(name: str, rows: Floats) -> Floats:
    """The scale of each component of "q", "p" or "multipliers", whose rows are (n, k); (k,).

    Where nothing of a unit ever differs from zero the scale is one: any error counts in full.
    """
    sizes = np.abs(rows).max(axis=0, initial=0.0)
    for unit in UNITS[name]:
        largest = sizes[unit].max()
        sizes[unit] = np.where(sizes[unit] < _SYMMETRY * largest, largest, sizes[unit])
    sizes[sizes == 0.0] = 1.0
    return np.asarray(sizes)


def by_row(value: Floats, exact: Floats, scale: Floats) -> Floats:
    """The error of each row, (n,); infinite where a number is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.abs(value - exact) / scale
    return np.asarray(np.nan_to_num(sizes, nan=np.inf, posinf=np.inf).max(axis=1, initial=0.0))


def largest(
    result: Any, expected: Any, along: Mapping[str, Floats] | None = None
) -> dict[str, float]:
    """The error of a result, the largest over its rows, by quantity.

    Args:
        result: A `Run` or anything else with t (n,) and some of q (n, 9), p (n, 9) and multipliers
            (n, 4). What it lacks (AttributeError) is left out.
        expected: The same at the same instants.
        along: Quantity -> its scales; None takes those of `expected`, which a
            `reference.Reference` has, or else makes them of its rows.

    Raises:
        ValueError: The instants differ.
    """
    if not np.array_equal(np.asarray(result.t), np.asarray(expected.t)):
        raise ValueError("the result's instants differ from those it is compared with")
    along = along or getattr(expected, "scales", None)
    found = {}
    for name in UNITS:
        if hasattr(result, name) and hasattr(expected, name):
            rows, exact = getattr(result, name), getattr(expected, name)
            scale = along[name] if along else scales(name, exact)
            found[name] = float(by_row(rows, exact, scale).max(initial=0.0))
    return found
