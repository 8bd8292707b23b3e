"""Contact and friction of a scene: coefficients, formulations, and functions without slip."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..support import SIDES, Formulation, checks

if TYPE_CHECKING:
    from .scene import Scene


def require_bilateral(scene: Scene, name: str, reason: str) -> None:
    """Refuses unilateral contact in the function `name`; `reason` says what it computes instead."""
    if scene.contact != "bilateral":
        raise ValueError(f'Scene.contact = "{scene.contact}": {name} {reason}')


def as_bilateral(scene: Scene) -> Scene:
    """Returns the scene with bilateral contact, whose start has no modes of contacts."""
    start = scene.initial
    if start is not None and not isinstance(start, str):
        start = replace(start, contact=None)
    return replace(scene, contact="bilateral", initial=start)


def formulations_of(scene: Scene) -> tuple[Formulation, ...]:
    """Returns the formulations that can simulate a scene."""
    if scene.contact == "bilateral":
        return _core.FORMULATIONS
    # The states of "nullspace" are on the constraints of both contacts always.
    return tuple(name for name in _core.FORMULATIONS if name != "nullspace")


def without_drift(scene: Scene) -> Formulation:
    """Returns a formulation without drift off the constraints that can simulate a scene."""
    return "nullspace" if "nullspace" in formulations_of(scene) else "projected"


def require_formulations(field: str, names: Sequence[str], scene: Scene) -> None:
    """Refuses formulations that cannot simulate a scene."""
    for name in names:
        if name not in formulations_of(scene):
            rule = f'must be one of "csm" or "projected" where contact = "{scene.contact}"'
            raise ValueError(f'{field} = "{name}": {rule}')


def parse_friction(data: Any, path: str) -> Any:
    """Parses one coefficient of friction, a list (right, left), or a table of both sides."""
    if not isinstance(data, Mapping):
        return data
    checks.refuse_unknown("Scene.friction", data, SIDES, path, needed=SIDES)
    return tuple(data[side] for side in SIDES)


def pair_of(given: Any) -> tuple[float, float] | None:
    """Returns the checked coefficients of both contacts if a pair is given, else None."""
    if not (isinstance(given, tuple | list) or np.ndim(given)):
        return None
    try:
        right, left = (checks.number("Scene.friction", value) for value in given)
    except (TypeError, ValueError):
        rule = "must be a number, or two, (right, left)"
        raise TypeError(f"Scene.friction = {checks.shown(given)}: {rule}") from None
    for value in (right, left):
        _core.validate("Scene", "friction", value)
    return right, left


def coefficients(friction: float | tuple[float, float] | None) -> tuple[float, float]:
    """Returns a scene's coefficients of both contacts, (right, left); inf where it has none."""
    right, left = friction if isinstance(friction, tuple) else (friction, friction)
    return (math.inf if right is None else right, math.inf if left is None else left)
