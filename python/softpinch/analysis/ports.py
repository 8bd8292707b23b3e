"""The inputs and outputs of linear models, by groups."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from ..scene.coordinates import COORDINATE_UNITS, COORDINATES, RATE_UNITS, RATES
from ..support import checks

INPUTS = ("targets", "torque", "force")
OUTPUTS = ("pose", "fingers", "compressions", "shears", "multipliers", "torque", "rates")


class Ports(NamedTuple):
    """Inputs or outputs of a model.

    Attributes:
        places: Their indices in the core's arrays.
        names: Their names.
        units: Their units.
    """

    places: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]


# In the order of `Run.multipliers`.
MULTIPLIERS = tuple(f"lambda_{i}^{row}" for row in "HN" for i in (1, 2))
_TARGETS = ("target_1", "target_2")
_TORQUES = Ports((0, 1), ("torque_1", "torque_2"), ("N m", "N m"))
# What the schedule's values are, by `Scene.law`. The angles, rates and accelerations of driven
# fingers act on the object one by one.
_SCHEDULES = {
    "pid": Ports((0, 1), _TARGETS, ("rad", "rad")),
    "torque": _TORQUES,
    "driven": Ports(
        (0, 1, 2, 3, 4, 5),
        tuple(
            f"{order}{name}" for order in ("", "rate of ", "acceleration of ") for name in _TARGETS
        ),
        ("rad", "rad", "rad/s", "rad/s", "rad/s^2", "rad/s^2"),
    ),
}


def _outputs() -> dict[str, Ports]:
    names = (*COORDINATES, *MULTIPLIERS, *_TORQUES.names, *RATES[:5])
    units = (*COORDINATE_UNITS, *["N"] * 4, *_TORQUES.units, *RATE_UNITS[:5])
    found, first = {}, 0
    for group, count in zip(OUTPUTS, (3, 2, 2, 2, 4, 2, 5), strict=True):
        own = slice(first, first + count)
        found[group] = Ports(tuple(range(first, first + count)), names[own], units[own])
        first += count
    return found


_OUTPUTS = _outputs()


def groups(name: str, value: object, allowed: tuple[str, ...]) -> tuple[str, ...]:
    """Checks names of groups, of which one may be given alone.

    Raises:
        ValueError: A name is unknown or repeated, or there is none.
        TypeError: The value is no name and no sequence of names.
    """
    given = (value,) if isinstance(value, str) else value
    if not isinstance(given, tuple | list) or not given:
        error = ValueError if isinstance(given, tuple | list) else TypeError
        raise error(
            f"{name} = {checks.shown(value)}: must be names out of {checks.quoted(allowed)}"
        )
    found = tuple(checks.choice(f"{name}[{k}]", one, allowed) for k, one in enumerate(given))
    for one in found:
        if found.count(one) > 1:
            raise ValueError(f'{name}: "{one}" is there more than once')
    return found


@cache
def input_ports(chosen: tuple[str, ...], law: str) -> Ports:
    """Returns the inputs of these groups in this order, of equations whose fingers `law` moves."""
    schedule = _SCHEDULES[law]
    first = len(schedule.places)
    force = Ports(
        (first, first + 1, first + 2), ("force_x", "force_y", "moment"), ("N", "N", "N m")
    )
    own = {"targets": schedule, "torque": _TORQUES, "force": force}
    return _joined([own[group] for group in chosen])


@cache
def output_ports(chosen: tuple[str, ...]) -> Ports:
    """Returns the outputs of these groups in this order."""
    return _joined([_OUTPUTS[group] for group in chosen])


def _joined(parts: list[Ports]) -> Ports:
    return Ports(
        *(tuple(each for part in column for each in part) for column in zip(*parts, strict=True))
    )
