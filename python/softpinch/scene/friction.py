"""The coefficients of friction of a scene: one for both contacts, or a pair (right, left)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import _core
from ..support import checks
from ..support.record import SIDES


def parse_friction(data: Any, path: str) -> Any:
    """Parses one coefficient of friction, a list (right, left), or a table of both sides."""
    if not isinstance(data, Mapping):
        return data
    checks.refuse_unknown("Scene.friction", data, SIDES, path)
    for side in SIDES:
        if side not in data:
            raise ValueError(f"Scene.friction.{side}{checks.at(path)}: is missing")
    return tuple(data[side] for side in SIDES)


def pair_of(given: Any) -> tuple[float, float] | None:
    """Returns the coefficients of both contacts if a pair is given, else None.

    Raises:
        ValueError: A coefficient breaks its rule.
        TypeError: A sequence is no pair of numbers.
    """
    several = isinstance(given, np.ndarray) and given.ndim > 0
    if not (several or isinstance(given, tuple | list)):
        return None
    try:
        right, left = (checks.number("Scene.friction", value) for value in given)
    except (TypeError, ValueError):
        raise TypeError(
            f"Scene.friction = {checks.shown(given)}: must be a number, or two, (right, left)"
        ) from None
    for value in (right, left):
        _core.validate("Scene", "friction", value)
    return right, left


def coefficients(friction: float | tuple[float, float] | None) -> tuple[float, float]:
    """Returns a scene's coefficients of both contacts, (right, left); inf where it has none."""
    right, left = friction if isinstance(friction, tuple) else (friction, friction)
    return (math.inf if right is None else right, math.inf if left is None else left)


def require_finite(friction: float | tuple[float, float] | None) -> None:
    """Refuses unilateral contact without finite friction.

    Raises:
        ValueError: A coefficient is None or infinite.
    """
    pair = friction if isinstance(friction, tuple) else (friction,)
    if any(value is None or not np.isfinite(value) for value in pair):
        raise ValueError(
            f"Scene.friction = {checks.shown(friction)}: must be finite where "
            'contact = "unilateral", such as 0.5'
        )
