"""What depends on the contact model of a scene: its formulations, and functions without slip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .. import _core
from ..support.choices import Formulation
from .scene import Scene, State

# The states of "nullspace" are on the constraints of both contacts always.
_BILATERAL = ("nullspace",)


def require_bilateral(scene: Scene, name: str, reason: str) -> None:
    """Refuses unilateral contact.

    Args:
        scene: The scene.
        name: The function that refuses it.
        reason: What it has instead, and how to use it.

    Raises:
        ValueError: The scene has unilateral contact.
    """
    if scene.contact != "bilateral":
        raise ValueError(f'Scene.contact = "{scene.contact}": {name} {reason}')


def as_bilateral(scene: Scene) -> Scene:
    """Returns the scene with bilateral contact, whose start has no modes of contacts."""
    start = scene.initial
    if isinstance(start, State):
        start = replace(start, contact=None)
    return replace(scene, contact="bilateral", initial=start)


def formulations_of(scene: Scene) -> tuple[Formulation, ...]:
    """Returns the formulations that can simulate a scene."""
    if scene.contact == "bilateral":
        return _core.FORMULATIONS
    return tuple(name for name in _core.FORMULATIONS if name not in _BILATERAL)


def without_drift(scene: Scene) -> Formulation:
    """Returns a formulation without drift off the constraints that can simulate a scene."""
    return "nullspace" if "nullspace" in formulations_of(scene) else "projected"


def require_formulations(field: str, names: Sequence[str], scene: Scene) -> None:
    """Refuses formulations that cannot simulate a scene.

    Raises:
        ValueError: One of the names is for bilateral contact only.
    """
    for name in names:
        if name not in formulations_of(scene):
            raise ValueError(
                f'{field} = "{name}": must be one of "csm" or "projected" where contact = '
                f'"{scene.contact}"'
            )
