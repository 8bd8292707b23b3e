"""The units of everything that an ensemble holds, by name.

A new field of a record that `vary` can reach needs a line in `FIELDS`.
"""

from __future__ import annotations

from collections.abc import Sequence

from .. import _core
from .coordinates import COORDINATE_UNITS, COORDINATES, RATE_UNITS, RATES

# What stands along the axes of fields and summaries, and the names of the places there.
AXES: dict[str, tuple[str, ...]] = {
    "axis": ("x", "y"),
    "finger": ("right", "left"),
    "coordinate": COORDINATES,
    "state": COORDINATES + RATES,
}

# Name of a field -> its unit, or one for each place along the last axis; and what its last axes
# are. Axes ahead of those are counted. "1" is a number without unit.
FIELDS: dict[str, tuple[str | tuple[str, ...], tuple[str, ...]]] = {
    # Finger, Fingertip, GraspedObject
    "length": ("m", ()),
    "root_offset": ("m", ()),
    "half_thickness": ("m", ()),
    "mass": ("kg", ()),
    "inertia": ("kg m^2", ()),
    "radius": ("m", ()),
    "youngs_modulus": ("Pa", ()),
    "normal_viscosity": ("N s/m", ()),
    "tangential_viscosity": ("N s/m", ()),
    "tilt_coupling": ("1", ()),
    "normal_mass": ("kg", ()),
    "tangential_mass": ("kg", ()),
    "width": ("m", ()),
    "com_offset": ("m", ()),
    # Pid
    "kp": ("N m/rad", ()),
    "kd": ("N m s/rad", ()),
    "ki": ("N m/(rad s)", ()),
    # Schedule
    "times": ("s", ()),
    "angles": ("rad", ("finger",)),
    "move_time": ("s", ()),
    # Disturbances
    "time": ("s", ()),
    "duration": ("s", ()),
    "force": ("N", ("axis",)),
    "moment": ("N m", ()),
    "impulse": ("N s", ("axis",)),
    "angular_impulse": ("N m s", ()),
    "frequency_hz": ("Hz", ()),
    "phase": ("rad", ()),
    "force_std": ("N", ("axis",)),
    "moment_std": ("N m", ()),
    "rate_hz": ("Hz", ()),
    # State
    "q": (COORDINATE_UNITS, ("coordinate",)),
    "p": (RATE_UNITS, ("coordinate",)),
    "integral": ("rad s", ("finger",)),
    # Scene
    "gravity": ("m/s^2", ()),
    "friction": ("1", ()),
}
# What an ensemble has beside parameters; text has no unit.
RESULTS: dict[str, tuple[str | tuple[str, ...], tuple[str, ...]]] = {
    "run": ("1", ()),
    "status": ("", ()),
    "message": ("", ()),
    "end_time": ("s", ()),
    "failure_time": ("s", ()),
    "steps": ("1", ()),
    "final_state": (COORDINATE_UNITS + RATE_UNITS, ("state",)),
    **{f"first_{name}": ("s", ()) for name in _core.VIOLATIONS},
    **{name: (unit, ()) for name, unit in _core.SUMMARIES.items()},
}


def field_of(path: str) -> tuple[str, tuple[int, ...]]:
    """The field that a path ends in, and the indices behind it."""
    names = path.split(".")
    index: list[int] = []
    while len(names) > 1 and names[-1].isdecimal():
        index.insert(0, int(names.pop()))
    return names[-1], tuple(index)


def units(name: str, shape: Sequence[int]) -> str | tuple[str, ...]:
    """The unit of a column of an ensemble: of a result, or of the field at a path.

    Args:
        name: As in `Ensemble.to_dict`.
        shape: Of one run's value.

    Returns:
        One unit, or one for each place along the last axis where they differ.

    Raises:
        KeyError: Its field has no line in the table.
    """
    if name in RESULTS:
        return RESULTS[name][0]
    field, index = field_of(name)
    unit, _ = FIELDS[field]
    # An index into such a vector picks the place; a whole one keeps all of them.
    return unit if isinstance(unit, str) or shape else unit[index[-1]]


def axes(name: str, shape: Sequence[int]) -> tuple[str | None, ...]:
    """What the axes of one run's value are, by names of `AXES`; None is counted."""
    known = RESULTS[name][1] if name in RESULTS else FIELDS[field_of(name)[0]][1]
    kept = known[max(0, len(known) - len(shape)) :] if shape else ()
    return (*[None] * (len(shape) - len(kept)), *kept)
