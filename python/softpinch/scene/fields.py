"""The one table of quantities: every number of a scene, and every number that a run records.

A parameter has its path, unit, symbol, usual range and the names of its axes; a recorded quantity
has the names, symbols and units of its columns. The rules of parameters are in the Rust core
(`_core.RULES`), and their defaults in the records of `hand`, `control` and `scene`. Tests compare
docs/symbols.md with this table. A new field that can be varied needs a line in `PARAMETERS`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from .. import _core
from ..support.record import SIDES
from .parts import JOINT

Unit: TypeAlias = str | tuple[str, ...]

# SI unit -> unit that is easier to read in figures, and the number of these in one SI unit.
DISPLAY_UNITS: dict[str, tuple[str, float]] = {
    "m": ("mm", 1e3),
    "m/s": ("mm/s", 1e3),
    "rad": ("deg", 57.29577951308232),
    "rad/s": ("deg/s", 57.29577951308232),
    "Pa": ("MPa", 1e-6),
}

# The generalised coordinates in the order of `State.q`, their rates in the order of `State.p`.
COORDINATES = ("x", "y", "theta", "theta_1", "theta_2", "d_n1", "d_n2", "d_t1", "d_t2")
COORDINATE_UNITS = ("m", "m", "rad", "rad", "rad", "m", "m", "m", "m")
RATES = tuple(f"rate of {name}" for name in COORDINATES)
RATE_UNITS = tuple(f"{unit}/s" for unit in COORDINATE_UNITS)
# Usual ranges: the object's position, the three angles, and the tips' deformations.
COORDINATE_RANGES = (*[(-10.0, 10.0)] * 2, *[(-math.pi, math.pi)] * 3, *[(-1.0, 1.0)] * 4)

# Name of an axis -> the labels of the entries along it.
AXES: dict[str, tuple[str, ...]] = {
    "axis": ("x", "y"),
    "finger": SIDES,
    "coordinate": COORDINATES,
    "state": COORDINATES + RATES,
}


class Parameter(NamedTuple):
    """A number or an array of a scene."""

    path: str  # in a scene, without the index of a disturbance
    unit: Unit  # "1" is dimensionless; a tuple has one for each entry along the last axis
    # The smallest and the largest usual value, ten times wider than realistic values; None if any
    # value is usual.
    usual: tuple[float, float] | None = None
    symbol: str = ""  # in plain text, as in docs/symbols.md
    # Names of its last axes in `AXES`. Axes ahead of these have no labels, only indices.
    axes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The name of the field."""
        return self.path.rpartition(".")[2]


# Largest usual finger angle, rad: a right angle, beyond which no finger can hold an object.
_TURN = 0.5 * math.pi
_FINGER, _AXIS = ("finger",), ("axis",)
PARAMETERS = (
    Parameter("hand.right.length", "m", (1e-4, 10.0), "L"),
    Parameter("hand.right.root_offset", "m", (0.0, 10.0), "W_f"),
    Parameter("hand.right.half_thickness", "m", (0.0, 1.0), "d_f"),
    Parameter("hand.right.mass", "kg", (0.0, 100.0), "M_i"),
    # The fingers of a micro-gripper, 5 mm long, weigh milligrams, and their tips micrograms.
    Parameter("hand.right.inertia", "kg m^2", (1e-13, 100.0), "I_i"),
    # Of a jaw, and of a parallelogram.
    Parameter("hand.right.height", "m", (-10.0, 10.0)),
    Parameter("hand.right.direction", "rad", (-_TURN, _TURN)),
    Parameter("hand.right.angle", "rad", (-_TURN, _TURN)),
    Parameter("hand.right.joint_friction", "N m", (0.0, 100.0)),
    Parameter("hand.right.creep_rate", "rad/s", (1e-6, 10.0)),
    Parameter("hand.tip.radius", "m", (1e-5, 1.0), "a"),
    # From a tenth of the softest tip to ten times the modulus of the stiffest materials.
    Parameter("hand.tip.youngs_modulus", "Pa", (1e3, 1e13), "E"),
    Parameter("hand.tip.normal_viscosity", "N s/m", (0.0, 1e6), "c_n"),
    Parameter("hand.tip.tangential_viscosity", "N s/m", (0.0, 1e6), "c_t"),
    Parameter("hand.tip.tilt_coupling", "1", (-10.0, 10.0), "kappa"),
    Parameter("hand.tip.law.coefficient", "N/m^n"),
    Parameter("hand.tip.law.exponent", "1", (1.0, 20.0)),
    Parameter("hand.tip.law.foot", "m", (0.0, 0.1)),
    Parameter("hand.tip.law.shear_factor", "1", (0.0, 10.0)),
    Parameter("hand.tip.relaxation.share", "1", (0.0, 100.0)),
    Parameter("hand.tip.relaxation.time", "s", (1e-5, 1e5)),
    Parameter("hand.tip.normal_mass", "kg", (1e-9, 1e3), "m_n"),
    Parameter("hand.tip.tangential_mass", "kg", (1e-9, 1e3), "m_t"),
    Parameter("grasped.width", "m", (1e-5, 10.0), "W"),
    Parameter("grasped.mass", "kg", (1e-9, 1e3), "M"),
    Parameter("grasped.inertia", "kg m^2", (1e-17, 1e3), "I"),
    Parameter("grasped.com_offset", "m", (-10.0, 10.0), "w"),
    Parameter("grasped.height", "m", (1e-5, 10.0)),
    Parameter("grasped.right.tilt", "rad", (-_TURN, _TURN)),
    Parameter("grasped.right.radius", "m", (1e-5, 1e9)),
    Parameter("grasped.right.center", "m", (-1e9, 1e9), axes=_AXIS),
    Parameter("grasped.right.span", "rad", (0.0, math.pi)),
    Parameter("control.kp", "N m/rad", (0.0, 1e6), "K_P"),
    Parameter("control.kd", "N m s/rad", (0.0, 1e4), "K_D"),
    Parameter("control.ki", "N m/(rad s)", (0.0, 1e8), "K_I"),
    # Matrices and measurements of a `SampledController` have the units of their measures.
    Parameter("control.period", "s", (1e-6, 0.1)),
    Parameter("control.delay", "s", (0.0, 0.1)),
    Parameter("control.measure_delay", "s", (0.0, 1.0)),
    Parameter("control.first_sample", "s"),
    Parameter("control.jitter", "s", (0.0, 0.1)),
    Parameter("control.loss", "1"),
    Parameter("control.rate_limit", "N m/s"),
    Parameter("control.no_load_rate", "rad/s"),
    Parameter("control.A", "1"),
    Parameter("control.B", "1"),
    Parameter("control.C", "N m"),
    Parameter("control.D", "N m"),
    Parameter("control.limits", "N m"),
    Parameter("control.initial_torque", "N m", axes=_FINGER),
    Parameter("control.initial_state", "1"),
    Parameter("control.measure_noise", "1"),
    Parameter("control.resolution", "1"),
    Parameter("control.dead_zone", "1"),
    Parameter("control.switch.at", "s"),
    Parameter("schedule.times", "s"),
    Parameter("schedule.angles", "rad", (-_TURN, _TURN), axes=_FINGER),
    Parameter("schedule.move_time", "s", (1e-6, 1e5)),
    Parameter("disturbances.time", "s"),
    Parameter("disturbances.duration", "s"),
    Parameter("disturbances.force", "N", (-1e5, 1e5), axes=_AXIS),
    Parameter("disturbances.moment", "N m", (-1e3, 1e3)),
    Parameter("disturbances.impulse", "N s", (-1e3, 1e3), axes=_AXIS),
    Parameter("disturbances.angular_impulse", "N m s", (-100.0, 100.0)),
    Parameter("disturbances.frequency_hz", "Hz", (0.0, 1e6)),
    Parameter("disturbances.phase", "rad", (-4.0 * math.pi, 4.0 * math.pi)),
    Parameter("disturbances.force_std", "N", (0.0, 1e5), axes=_AXIS),
    Parameter("disturbances.moment_std", "N m", (0.0, 1e3)),
    Parameter("disturbances.acceleration_std", "m/s^2", (0.0, 1e5), axes=_AXIS),
    Parameter("disturbances.rate_hz", "Hz", (0.0, 1e7)),
    # Usual coordinates are in `COORDINATE_RANGES`.
    Parameter("initial.q", COORDINATE_UNITS, axes=("coordinate",)),
    Parameter("initial.p", RATE_UNITS, axes=("coordinate",)),
    Parameter("initial.integral", "rad s", axes=_FINGER),
    Parameter("motion.times", "s"),
    Parameter("motion.points", "m", (-1e3, 1e3), axes=_AXIS),
    Parameter("motion.positions", "m", (-1e3, 1e3), axes=_AXIS),
    Parameter("motion.accelerations", "m/s^2", (-1e5, 1e5), axes=_AXIS),
    Parameter("motion.acceleration", "m/s^2", (-1e5, 1e5)),
    Parameter("motion.jerk", "m/s^3", (0.0, 1e7)),
    Parameter("motion.tilts", "rad", (-1e3, 1e3)),
    Parameter("motion.tilt", "rad", (-4.0 * math.pi, 4.0 * math.pi)),
    Parameter("motion.amplitude", "m", (-10.0, 10.0)),
    Parameter("motion.frequency", "Hz", (0.0, 1e6)),
    Parameter("motion.axis", "rad", (-4.0 * math.pi, 4.0 * math.pi)),
    Parameter("gravity", "m/s^2", (-300.0, 300.0), "g"),
    Parameter("duration", "s", (0.0, 1e6)),
    Parameter("friction", "1", (0.0, 30.0), "mu"),
)
# Symbol in plain text -> the path that it stands for: "E" is "hand.tip.youngs_modulus".
SYMBOLS = {field.symbol: field.path for field in PARAMETERS if field.symbol}
# Name -> field. Fields of one name, such as the masses of finger and object, have the same unit.
FIELDS = {field.name: field for field in PARAMETERS}

# Unit of a link's coordinate, and of what belongs to it -> unit of that of a jaw.
_OF_JAWS = {
    **{f"rad{rate}": f"m{rate}" for rate in ("", "/s", "/s^2", " s")},
    **{"N m": "N", "N m/rad": "N/m", "N m s/rad": "N s/m", "N m/(rad s)": "N/(m s)"},
}
# Path without sides and indices -> usual range of what is a length or a force of a jaw.
_USUAL_OF_JAWS = {
    **{"control.kp": (0.0, 1e8), "control.kd": (0.0, 1e6), "control.ki": (0.0, 1e10)},
    "schedule.angles": (-1.0, 1.0),
}
# Whether the right and the left finger is a jaw, whose coordinate is a length.
Jaws: TypeAlias = tuple[bool, bool]
_NONE: Jaws = (False, False)


def of_fingers(unit: str, jaws: Jaws) -> tuple[str, str]:
    """The units of the right and the left finger, of a unit that links have."""
    right, left = (_OF_JAWS.get(unit, unit) if jaw else unit for jaw in jaws)
    return right, left


def of_column(name: str, unit: str, jaws: Jaws) -> str:
    """The unit of a column or of a linear model's port, by its name, such as "rate of theta_1"."""
    stem, _, finger = name.rpartition(" ")[2].rpartition("_")
    own = stem in ("theta", "integral", "torque", "target")
    return of_fingers(unit, jaws)[int(finger) - 1] if own else unit


def of_coordinates(units: Sequence[str], jaws: Jaws) -> tuple[str, ...]:
    """The units of coordinates, rates or both: of each nine, 3 and 4 are the fingers'."""
    return tuple(
        of_fingers(unit, jaws)[k % 9 - 3] if k % 9 in (3, 4) else unit
        for k, unit in enumerate(units)
    )


def without_places(path: str) -> str:
    """Returns a path without sides and indices: "hand.length" for "hand.right.length"."""
    names = path.split(".")
    return ".".join(name for name in names if name not in SIDES and not name.isdecimal())


def usual_range(path: str, jaws: Jaws) -> tuple[tuple[float, float], Unit] | None:
    """The usual range of the number at a path, and its unit; None if any value is usual."""
    short = without_places(path)
    field = USUAL.get(short)
    if field is None or field.usual is None:
        return None
    if not any(jaws):
        return field.usual, field.unit
    unit, (least, most) = units(path, (2,), jaws), field.usual
    if short in _USUAL_OF_JAWS and unit != field.unit:
        low, high = _USUAL_OF_JAWS[short]
        least, most = (low, high) if all(jaws) else (min(least, low), max(most, high))
    return (least, most), unit


# Path without sides and indices -> its field, of those with a usual range.
USUAL = {without_places(field.path): field for field in PARAMETERS if field.usual is not None}


class Quantity(NamedTuple):
    """An array (n, columns) of a run."""

    record: str  # the entry of `record` that records it
    columns: tuple[str, ...]  # the names of its columns in files, tables and fits
    units: tuple[str, ...]  # the units of its columns
    symbols: tuple[str, ...]  # of its columns in plain text, as in messages and linear models


def _by_contact(record: str, letter: str, units: tuple[str, ...]) -> Quantity:
    """A quantity with a normal column (H) and a tangential one (N) for each contact."""
    pairs = [(i, row) for row in "HN" for i in (1, 2)]
    columns = tuple(f"{letter}_{i}{row}" for i, row in pairs)
    return Quantity(record, columns, units, tuple(f"{letter}_{i}^{row}" for i, row in pairs))


def _by_finger(record: str, name: str, unit: str) -> Quantity:
    columns = (f"{name}_1", f"{name}_2")
    return Quantity(record, columns, (unit, unit), columns)


# Array of a run -> its columns.
QUANTITIES: dict[str, Quantity] = {
    "q": Quantity("state", COORDINATES, COORDINATE_UNITS, COORDINATES),
    "p": Quantity("state", RATES, RATE_UNITS, RATES),
    "integral": _by_finger("state", "integral", "rad s"),
    "multipliers": _by_contact("multipliers", "lambda", ("N",) * 4),
    "residuals": _by_contact("residuals", "C", ("m", "m", "m/s", "m/s")),
    "torque": _by_finger("torque", "torque", "N m"),
    "contact": _by_finger("contact", "contact", "1"),
}
# Recorded quantities with an error estimate.
ESTIMATED = ("q", "p", "multipliers")

# Field or column -> its symbol or name in figures, where its own name with spaces would be unclear.
_IN_FIGURES = {
    "youngs_modulus": "Young's modulus",
    "kp": "$K_P$",
    "kd": "$K_D$",
    "ki": "$K_I$",
    "com_offset": "offset of mass",
    "frequency_hz": "frequency",
    "rate_hz": "rate",
    "theta": r"$\theta_{\mathrm{obj}}$",
    "x": r"$x_{\mathrm{obj}}$",
    "y": r"$y_{\mathrm{obj}}$",
    **{f"theta_{k}": rf"$\theta_{k}$" for k in (1, 2)},
    **{f"d_{kind}{k}": f"$d_{{{kind}{k}}}$" for kind in "nt" for k in (1, 2)},
    **{f"lambda_{k}{row}": rf"$\lambda_{k}^{row}$" for k in (1, 2) for row in "HN"},
    **{f"C_{k}{row}": f"$C_{k}^{row}$" for k in (1, 2) for row in "HN"},
    **{f"torque_{k}": rf"$\tau_{k}$" for k in (1, 2)},
}

# Result of an ensemble -> (unit, names of its last axes); text has the empty unit.
RESULTS: dict[str, tuple[Unit, tuple[str, ...]]] = {
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


def field_of(path: str) -> tuple[str, tuple[int, ...]]:
    """Splits a path into its last field and the indices after it; a side after it is left out."""
    names = path.split(".")
    if len(names) > 1 and names[-1] in SIDES:
        names.pop()
    index: list[int] = []
    while len(names) > 1 and names[-1].isdecimal():
        index.insert(0, int(names.pop()))
    return names[-1], tuple(index)


def units(name: str, shape: Sequence[int], jaws: Jaws = _NONE) -> Unit:
    """The unit of a result or of a field with this shape in one run, or one for each last index."""
    field, index = field_of(name)
    if name in RESULTS:
        unit, index = RESULTS[name][0], ()
    elif field in FIELDS:
        unit = FIELDS[field].unit
        if name.startswith("control.outer.") and "N m" in unit:
            return "unknown"  # its outputs are the targets of the next block
    else:
        return "unknown"  # a field of a user's own class
    if any(jaws):
        unit = _with_jaws(name, field, unit, jaws)
    # A path that ends in an index, such as "initial.q.2", has the unit of that entry alone.
    return unit if isinstance(unit, str) or shape else unit[index[-1]]


def _with_jaws(name: str, field: str, unit: Unit, jaws: Jaws) -> Unit:
    if not isinstance(unit, str):
        return of_coordinates(unit, jaws)
    owner = name.partition(".")[0]
    if owner not in ("control", "peak_torque") and field not in ("angles", "integral", *JOINT):
        return unit
    own = of_fingers(unit, jaws)
    sides = [own[k] for k, side in enumerate(SIDES) if side in name.split(".")]
    if sides or own[0] == own[1]:
        return (sides or own)[0]
    return own if field in FIELDS and FIELDS[field].axes == _FINGER else " or ".join(own)


def quantity(name: str, jaws: Jaws = _NONE) -> Quantity:
    """The columns of an array of a run, with their units in a hand that may have jaws."""
    found = QUANTITIES[name]
    pairs = zip(found.columns, found.units, strict=True)
    return found._replace(units=tuple(of_column(column, unit, jaws) for column, unit in pairs))


def headers(name: str, jaws: Jaws = _NONE) -> tuple[str, ...] | None:
    """The headers of an array that a run saves, with units; None of arrays that have none."""
    plain = name.removeprefix("error_")
    if plain not in QUANTITIES:
        return None
    own, of = quantity(plain, jaws), "" if name == plain else "error of "
    return tuple(f"{of}{c} [{u}]" for c, u in zip(own.columns, own.units, strict=True))


def axes(name: str, shape: Sequence[int]) -> tuple[str | None, ...]:
    """Returns the names of the axes of one run's value, from `AXES`; None is an axis of indices."""
    field = FIELDS.get(field_of(name)[0])
    known = RESULTS[name][1] if name in RESULTS else field.axes if field is not None else ()
    kept = known[max(0, len(known) - len(shape)) :] if shape else ()
    return (*[None] * (len(shape) - len(kept)), *kept)


def label(name: str, unit: str = "", jaws: Jaws = _NONE) -> str:
    """A column in words and its unit, "force y (disturbance 0) [N]"; a jaw's coordinate is z."""
    text = _name(name)
    for k in [k for jaw, k in zip(jaws, "12", strict=True) if jaw]:
        text = text.replace(rf"\theta_{k}", f"z_{k}").replace(rf"\tau_{k}", f"u_{k}")
    unit = unit.replace("^2", "$^2$")
    return f"{text} [{unit}]" if unit else text


def words(name: str) -> str:
    """Replaces the underscores of a name by spaces."""
    return name.replace("_", " ")


def _name(name: str) -> str:
    if name.startswith("final_state."):
        return "final " + _coordinate(name.removeprefix("final_state."))
    if name.startswith("rate of "):
        return _coordinate(name)
    if name in RESULTS or name in (*_core.STATUSES, *_core.VIOLATIONS):
        return words(name)
    field, index = field_of(name)
    text = _IN_FIGURES.get(field, words(field))
    places = [str(k) for k in index]
    # A column has one number, so its last index is a position on the field's last axis.
    axis = axes(field, index)[-1] if index else None
    if axis is not None:
        named = AXES[axis][index[-1]]
        places[-1] = _coordinate(named) if axis == "coordinate" else named
    names = name.split(".")
    # The side of a number that both contacts share otherwise follows the field: "friction.left".
    side = names[-1:] if len(names) > 1 and names[-1] in SIDES else []
    owner = [*names[: len(names) - 1 - len(index) - len(side)], *side]
    if owner and owner[0] == "disturbances":
        owner = ["disturbance", *owner[1:]]
    whose = f" ({' '.join(owner)})" if owner else ""
    return " ".join([text, *places]) + whose


def _coordinate(name: str) -> str:
    symbol = name.removeprefix("rate of ")
    return name.removesuffix(symbol) + _IN_FIGURES.get(symbol, symbol)


def spelt_out(path: str) -> tuple[str, ...]:
    """The paths that one with a symbol, "hand.tip.left.E", may mean, the likeliest first."""
    owner, _, symbol = path.rpartition(".")
    if symbol not in SYMBOLS:
        return ()
    field = SYMBOLS[symbol].rpartition(".")[2]
    return (f"{owner}.{field}" if owner else field, SYMBOLS[symbol])
