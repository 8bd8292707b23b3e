"""Labels and units of an ensemble's columns in figures."""

from __future__ import annotations

from .. import _core
from ..scene import units
from ..support.record import SIDES
from .columns import Column

# SI unit -> unit that is easier to read, and the number of these in one SI unit.
_SHOWN = {
    "m": ("mm", 1e3),
    "m/s": ("mm/s", 1e3),
    "rad": ("deg", 57.29577951308232),
    "rad/s": ("deg/s", 57.29577951308232),
    "Pa": ("MPa", 1e-6),
}
# Labels of fields and coordinates whose names with spaces would be unclear.
_SYMBOLS = {
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
}


def shown(column: Column) -> Column:
    """Converts a column to the unit that figures use."""
    unit, factor = _SHOWN.get(column.unit, (column.unit, 1.0))
    return Column(column.values * factor, unit)


def label(name: str, unit: str = "") -> str:
    """The label of a column: its name in words, and its unit in brackets if one is given.

    For example, "disturbances.0.force.1" becomes "force y (disturbance 0)".
    """
    text = _name(name)
    unit = unit.replace("^2", "$^2$")
    return f"{text} [{unit}]" if unit else text


def words(name: str) -> str:
    """Replaces the underscores of a name by spaces."""
    return name.replace("_", " ")


def _name(name: str) -> str:
    if name.startswith("final_state."):
        return "final " + _coordinate(name.removeprefix("final_state."))
    if name in units.RESULTS or name in (*_core.STATUSES, *_core.VIOLATIONS):
        return words(name)
    field, index = units.field_of(name)
    text = _SYMBOLS.get(field, words(field))
    places = [str(k) for k in index]
    # A column has one number, so its last index is a position on the field's last axis.
    axis = units.axes(field, index)[-1] if index else None
    if axis is not None:
        named = units.AXES[axis][index[-1]]
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
    rate = name.startswith("rate of ")
    symbol = name.removeprefix("rate of ")
    return ("rate of " if rate else "") + _SYMBOLS.get(symbol, symbol)
