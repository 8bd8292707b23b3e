"""The names of the states in which each formulation integrates the motion, with their units."""

from __future__ import annotations

from functools import cache

from ..scene.coordinates import COORDINATE_UNITS, COORDINATES

# Coordinate or integral -> unit.
_UNITS = dict(zip(COORDINATES, COORDINATE_UNITS, strict=True))
_UNITS |= {"integral_1": "rad s", "integral_2": "rad s"}


@cache
def state_names(law: str, formulation: str) -> tuple[str, ...]:
    """Names the states (docs/integrators.md, "How the constraints are kept").

    Args:
        law: What moves the fingers, as `Scene.law`; "torque" for fingers that torques turn.
        formulation: The formulation whose states these are.

    Returns:
        The coordinates, then the rates of these ("rate of x"), then what depends on both.
    """
    nullspace = formulation == "nullspace"
    pose = COORDINATES[:3] if law == "driven" else COORDINATES[:5]
    places = pose if nullspace else (*pose, *COORDINATES[5:])
    shears = COORDINATES[7:] if nullspace else ()
    memories = ("integral_1", "integral_2") if law == "pid" else ()
    return (*places, *(f"rate of {name}" for name in places), *shears, *memories)


def places(names: tuple[str, ...]) -> tuple[slice, slice, slice]:
    """Returns where coordinates, their rates and the shears are among states of "nullspace"."""
    degrees = names.index("rate of x")
    return slice(0, degrees), slice(degrees, 2 * degrees), slice(2 * degrees, 2 * degrees + 2)


@cache
def unit_of(name: str) -> str:
    """Returns the unit of a state or of a rate of it ("rate of x")."""
    rate = name.removeprefix("rate of ")
    return _UNITS[rate] + ("/s" if rate != name else "")
