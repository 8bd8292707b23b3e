"""The unit and the axes of every column of an ensemble: varied fields and results.

A new record field that can be varied needs a line in `FIELDS`.
"""

from __future__ import annotations

from collections.abc import Sequence

from .. import _core
from ..support.record import SIDES
from .coordinates import COORDINATE_UNITS, COORDINATES, RATE_UNITS, RATES

# Name of an axis -> the labels of the entries along it.
AXES: dict[str, tuple[str, ...]] = {
    "axis": ("x", "y"),
    "finger": ("right", "left"),
    "coordinate": COORDINATES,
    "state": COORDINATES + RATES,
}

# Field -> (unit, names of its last axes in `AXES`). A tuple of units has one for each entry along
# the last axis. Axes ahead of the named ones have no labels, only indices. "1" is dimensionless.
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
    "height": ("m", ()),
    "com_offset": ("m", ()),
    # Pid
    "kp": ("N m/rad", ()),
    "kd": ("N m s/rad", ()),
    "ki": ("N m/(rad s)", ()),
    # SampledController; matrices and measurements have the units of their measures
    "period": ("s", ()),
    "delay": ("s", ()),
    "A": ("1", ()),
    "B": ("1", ()),
    "C": ("N m", ()),
    "D": ("N m", ()),
    "limits": ("N m", ()),
    "initial_torque": ("N m", ("finger",)),
    "initial_state": ("1", ()),
    "measure_noise": ("1", ()),
    "resolution": ("1", ()),
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
# Result of an ensemble -> (unit, names of its last axes); text has the empty unit.
RESULTS: dict[str, tuple[str | tuple[str, ...], tuple[str, ...]]] = {
    "run": ("1", ()),
    "status": ("", ()),
    "message": ("", ()),
    "holds": ("1", ()),
    "end_time": ("s", ()),
    "failure_time": ("s", ()),
    "steps": ("1", ()),
    "final_state": (COORDINATE_UNITS + RATE_UNITS, ("state",)),
    **{f"first_{name}": ("s", ()) for name in _core.VIOLATIONS},
    **{name: (unit, ()) for name, unit in _core.SUMMARIES.items()},
}
_UNKNOWN: tuple[str, tuple[str, ...]] = ("unknown", ())


def field_of(path: str) -> tuple[str, tuple[int, ...]]:
    """Splits a path into the name of its last field and the indices after that name.

    A side after the field, as in "friction.left", is left out.
    """
    names = path.split(".")
    if len(names) > 1 and names[-1] in SIDES:
        names.pop()
    index: list[int] = []
    while len(names) > 1 and names[-1].isdecimal():
        index.insert(0, int(names.pop()))
    return names[-1], tuple(index)


def units(name: str, shape: Sequence[int]) -> str | tuple[str, ...]:
    """Returns the unit of a column of an ensemble, which is a result or the field at a path.

    Args:
        name: The column's name, as in `Ensemble.to_dict`.
        shape: The shape of one run's value.

    Returns:
        One unit, or a tuple with one unit for each entry along the last axis if they differ;
        "unknown" for a field of a user's own class.
    """
    if name in RESULTS:
        return RESULTS[name][0]
    field, index = field_of(name)
    unit, _ = FIELDS.get(field, _UNKNOWN)
    # A path that ends in an index, such as "initial.q.2", has the unit of that entry alone.
    return unit if isinstance(unit, str) or shape else unit[index[-1]]


def axes(name: str, shape: Sequence[int]) -> tuple[str | None, ...]:
    """Returns the names of the axes of one run's value, from `AXES`; None is an axis of indices."""
    known = RESULTS[name][1] if name in RESULTS else FIELDS.get(field_of(name)[0], _UNKNOWN)[1]
    kept = known[max(0, len(known) - len(shape)) :] if shape else ()
    return (*[None] * (len(shape) - len(kept)), *kept)
