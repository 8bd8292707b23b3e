"""Differences of derivatives, as shares of the largest one with the same unit."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import softpinch as sp

_LENGTHS = [0, 1, 5, 6, 7, 8]
_ANGLES = [2, 3, 4]
# Quantity -> columns with the same unit.
GROUPS = {
    "state": [_LENGTHS, _ANGLES, [9 + k for k in _LENGTHS], [9 + k for k in _ANGLES]],
    "rates": [_LENGTHS, _ANGLES],
    "integral": [[0, 1]],
    "multipliers": [[0, 1, 2, 3]],
    "torque": [[0, 1]],
}


def of(run: sp.Run, quantity: str, path: str, index: tuple[int, ...] = ()) -> Any:
    """The derivatives of a quantity of the run by one number (n, components)."""
    found: Any = run.sensitivity
    return (found if quantity == "state" else getattr(found, quantity))[path][(..., *index)]


def difference(ours: Any, theirs: Any, quantity: str = "state", least: Any = 0.0) -> float:
    """The largest |ours - theirs| over the largest |theirs| of all rows and columns of the unit.

    `least` has the same shape, if given: what derivatives of a size that does not count have.
    """
    assert ours.shape == theirs.shape
    assert np.isfinite(ours).all()
    worst = 0.0
    least = np.broadcast_to(least, theirs.shape)
    for columns in GROUPS[quantity]:
        scale = max(np.abs(part[..., columns]).max() for part in (theirs, least))
        off = np.abs(ours[..., columns] - theirs[..., columns]).max()
        worst = max(worst, off / scale if off else 0.0)
    return float(worst)


def worst(
    run: sp.Run, expected: Mapping[str, Any], path: str, index: tuple[int, ...] = ()
) -> float:
    """The largest `difference` over the quantities that are expected."""
    pairs = {name: (of(run, name, path, index), value) for name, value in expected.items()}
    return max(difference(*pair, name) for name, pair in pairs.items())
