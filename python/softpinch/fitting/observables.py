"""What can be measured along a run, by name: single columns, and groups of columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ..analysis.ports import output_ports
from ..run.columns import COLUMNS
from ..support import checks


class Place(NamedTuple):
    """Where a run has a column.

    Attributes:
        quantity: The array of the run: "q", "p", "multipliers" or "torque".
        column: Its index in this array.
        unit: Its unit.
    """

    quantity: str
    column: int
    unit: str


QUANTITIES = ("q", "p", "multipliers", "torque")


def _places() -> dict[str, Place]:
    """Reads names and units off the headers of the files that `Run.save` writes."""
    found = {}
    for quantity in QUANTITIES:
        for column, header in enumerate(COLUMNS[quantity]):
            name, _, unit = header.removesuffix("]").partition(" [")
            found[name] = Place(quantity, column, unit)
    return found


# Column -> its place.
PLACES: Mapping[str, Place] = _places()
# Group -> its columns. Those of `sp.linearize` have the coordinates' own names.
GROUPS: Mapping[str, tuple[str, ...]] = {
    **{
        quantity: tuple(name for name, place in PLACES.items() if place.quantity == quantity)
        for quantity in QUANTITIES
    },
    **{
        group: output_ports((group,)).names
        for group in ("pose", "fingers", "compressions", "shears", "rates")
    },
    "position": ("x", "y"),
    "rotation": ("theta",),
}
NAMES = (*GROUPS, *(name for name in PLACES if name not in GROUPS))


def columns(name: object) -> tuple[str, ...]:
    """Returns the columns of an observable.

    Raises:
        ValueError: The name is unknown; the message lists all.
        TypeError: The name is not text.
    """
    known = checks.choice("measured", name, NAMES)
    return GROUPS.get(known, (known,))
