"""Names, units and places of the states, inputs and outputs of the linearised motion."""

from __future__ import annotations

from functools import cache
from itertools import chain, pairwise
from typing import Any, NamedTuple

import numpy as np

from .. import _core
from ..run import ContactMode, Options, Request
from ..scene.fields import COORDINATES, QUANTITIES, RATE_UNITS, RATES
from ..scene.scene import Scene, State
from ..support.arrays import Floats

FREE, STICK = ContactMode.FREE, ContactMode.STICK
INPUTS = ("targets", "torque", "force", "acceleration")
OUTPUTS = ("pose", "fingers", "compressions", "shears", "multipliers", "torque", "rates")

# Coordinate or integral -> unit.
_UNITS = {
    column: unit
    for name in ("q", "integral")
    for column, unit in zip(QUANTITIES[name].columns, QUANTITIES[name].units, strict=True)
}


def linear_at(
    scene: Scene, state: State, contact: Floats | None = None, **how: Any
) -> _core._Linear:
    """Returns the matrices of minimal states at one state (1, ...), by `Request.linear_model`.

    The tips stick, or are in the modes of `contact` (4,).
    """
    how["contacts"] = None if contact is None else contact[None]
    request = Request(scene, Options.checked(formulation="nullspace"))
    rows = np.array([state.time]), state.q[None], state.p[None], state._memories[None]
    return request.linear_model(*rows, **how)


@cache
def state_names(
    law: str, formulation: str, branches: int = 0, codes: tuple[float, ...] = (1.0, 1.0)
) -> tuple[str, ...]:
    """Names the states of a law, a formulation and Maxwell branches (docs/integrators.md).

    With the tips in the modes `codes` of `State.contact`, "nullspace" stands for minimal states:
    the surface of a free tip moves by itself, and along the face that of one that does not stick.
    """
    nullspace = formulation == "nullspace"
    pose = COORDINATES[:3] if law == "driven" else COORDINATES[:5]
    free = (name for name, code in zip(COORDINATES[5:7], codes, strict=True) if code == FREE)
    places = (*pose, *free) if nullspace else (*pose, *COORDINATES[5:])
    slides = tuple(
        f"rate of {name}"
        for name, code in zip(COORDINATES[7:], codes, strict=True)
        if code != STICK and nullspace
    )
    shears = COORDINATES[7:] if nullspace else ()
    relaxed = (
        f"branch_{k}_{kind}_{i}"
        for k in range(1, branches + 1)
        for kind in ("force", "shear")
        for i in (1, 2)
    )
    memories = (*relaxed, *(("integral_1", "integral_2") if law == "pid" else ()))
    return (*places, *(f"rate of {name}" for name in places), *slides, *shears, *memories)


def places(names: tuple[str, ...]) -> tuple[slice, slice, list[int]]:
    """Returns where coordinates, their rates and the held shears are among minimal states.

    The shears of tips that stick are held.
    """
    degrees = names.index("rate of x")
    held = [names.index(name) for name in COORDINATES[7:] if f"rate of {name}" not in names]
    return slice(0, degrees), slice(degrees, 2 * degrees), held


@cache
def unit_of(name: str) -> str:
    """Returns the unit of a state or of a rate of it ("rate of x")."""
    rate = name.removeprefix("rate of ")
    branch = "N" if "force" in rate else "m"
    unit = branch if rate.startswith("branch_") else _UNITS[rate]
    return unit + ("/s" if rate != name else "")


def shears_by_pose(a: Floats, names: tuple[str, ...]) -> Floats:
    """Returns -Phi_N of (25), derivatives of the held shears by the pose at rest (k, d), in A."""
    _, rates, shears = places(names)
    return a[shears, rates]


def without_shears(rows: Floats, by_pose: Floats, names: tuple[str, ...]) -> Floats:
    """Returns rows of A or C by the states that `kept` lists, where d_t + Phi_N pose is zero.

    No motion changes these combinations, so the rows keep all eigenvalues but their zeros.
    """
    pose, _, shears = places(names)
    rows = rows.copy()
    rows[:, pose] += rows[:, shears] @ by_pose
    return rows[:, kept(names)]


def kept(names: tuple[str, ...]) -> list[int]:
    """Returns the indices of the states that are no held shears."""
    shears = places(names)[2]
    return [k for k in range(len(names)) if k not in shears]


class Ports(NamedTuple):
    """Inputs or outputs: their indices in the core's arrays, their names and their units."""

    places: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]


_TARGETS = ("target_1", "target_2")
_TORQUES = Ports((0, 1), QUANTITIES["torque"].symbols, QUANTITIES["torque"].units)
# The schedule's values, by `Scene.law`. The angles, rates and accelerations of driven fingers act
# on the object one by one.
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


# The core's outputs: coordinates, multipliers, torques, and rates of pose and fingers.
_QUANTITIES = [QUANTITIES[name] for name in ("q", "multipliers", "torque")]
_OUTPUT_NAMES = (*(name for each in _QUANTITIES for name in each.symbols), *RATES[:5])
_OUTPUT_UNITS = (*(unit for each in _QUANTITIES for unit in each.units), *RATE_UNITS[:5])
# Group -> its places among them.
_ENDS = pairwise((0, 3, 5, 7, 9, 13, 15, 20))
_OUTPUTS = {group: range(*ends) for group, ends in zip(OUTPUTS, _ENDS, strict=True)}


@cache
def input_ports(chosen: tuple[str, ...], law: str) -> Ports:
    """Returns the inputs of these groups in this order, of equations whose fingers `law` moves."""
    schedule = _SCHEDULES[law]
    k = len(schedule.places)
    force = Ports((k, k + 1, k + 2), ("force_x", "force_y", "moment"), ("N", "N", "N m"))
    carried = Ports((k + 3, k + 4), ("acceleration_x", "acceleration_y"), ("m/s^2", "m/s^2"))
    own = {"targets": schedule, "torque": _TORQUES, "force": force, "acceleration": carried}
    chosen_ports = zip(*(own[group] for group in chosen), strict=True)
    return Ports(*(tuple(chain.from_iterable(column)) for column in chosen_ports))


@cache
def output_ports(chosen: tuple[str, ...]) -> Ports:
    """Returns the outputs of these groups in this order."""
    places = (place for group in chosen for place in _OUTPUTS[group])
    return Ports(*zip(*((k, _OUTPUT_NAMES[k], _OUTPUT_UNITS[k]) for k in places), strict=True))
