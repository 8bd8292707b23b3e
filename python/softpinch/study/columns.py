"""The schema of a study's results: name, kind, shape and units of every entry.

`Setup.schema` makes the schema. Results, Parquet parts, pandas, xarray, tables and figures use it.
An entry with several numbers has one column for each number. The columns of a varied value have
indices, as in "disturbances.0.force.0", so that `vary` accepts their names as paths. The columns of
a result have names, as in "final_state.theta".
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene import units
from ..support import checks
from ..support.arrays import Floats

Kind: TypeAlias = Literal["count", "status", "message", "truth", "number"]

# The column that says whether each run's grasp held.
HOLDS = "holds"

_TYPES: dict[Kind, Any] = {
    "count": np.uint64,
    "status": np.array(_core.STATUSES).dtype,
    "message": object,
    "truth": np.bool_,
    "number": np.float64,
}
# Error messages list at most this many columns, because a study may have thousands.
_LISTED = 20


class Column(NamedTuple):
    """A column: one number or one text for each run.

    Attributes:
        values: The values (runs,).
        unit: The unit; "1" for numbers without a unit, "" for text.
    """

    values: NDArray[Any]
    unit: str


class Entry(NamedTuple):
    """One entry of `Results.to_dict`, an array (runs, *shape).

    Attributes:
        name: The name of the entry.
        kind: The kind of its values.
        shape: The shape of the value of one run.
        unit: The unit of all values, or one unit for each index of the last axis.
        axes: For each axis of `shape` its name in `units.AXES`; None for an axis without a name.
    """

    name: str
    kind: Kind
    shape: tuple[int, ...]
    unit: str | tuple[str, ...]
    axes: tuple[str | None, ...]

    @classmethod
    def of(cls, name: str, kind: Kind = "number", shape: tuple[int, ...] = ()) -> Entry:
        """Makes an entry; units and axes come from the module `units`."""
        return cls(name, kind, shape, units.units(name, shape), units.axes(name, shape))

    @property
    def columns(self) -> dict[str, str]:
        """The columns of the entry, in order: column name -> unit."""
        if not self.shape:
            assert isinstance(self.unit, str)
            return {self.name: self.unit}
        # Results use the names of their last axis. Varied values use the index, because the name of
        # their column must be a path.
        last = self.axes[-1]
        named = units.AXES[last] if self.name in units.RESULTS and last is not None else None
        found = {}
        for index in np.ndindex(self.shape):
            words = [str(place) for place in index]
            if named is not None:
                words[-1] = named[index[-1]]
            own = self.unit if isinstance(self.unit, str) else self.unit[index[-1]]
            found[".".join((self.name, *words))] = own
        return found

    def empty(self) -> NDArray[Any]:
        """An array of this entry without rows."""
        return np.empty((0, *self.shape), _TYPES[self.kind])

    def split(self, values: NDArray[Any]) -> dict[str, Column]:
        """Splits the entry's array (runs, *shape) into its columns."""
        columns = self.columns
        flat = values.reshape(len(values), len(columns))
        return {name: Column(flat[:, k], unit) for k, (name, unit) in enumerate(columns.items())}


class Schema:
    """All entries of a study's results.

    Attributes:
        entries: Name -> entry, in the order of `Results.to_dict`.
        summaries: The names of the summaries.
    """

    def __init__(
        self, summaries: Iterable[str], shapes: Mapping[str, tuple[int, ...]], law: str
    ) -> None:
        """Takes the names of the summaries, path -> shape of each run's varied value, and the law.

        With the law "torque" the schedule's values are torques, in spite of their name.
        """
        self.summaries = tuple(summaries)
        entries = [
            Entry.of("run", "count"),
            Entry.of("status", "status"),
            Entry.of("message", "message"),
            Entry.of("end_time"),
            Entry.of("failure_time"),
            Entry.of("steps", "count"),
            Entry.of(HOLDS, "truth"),
            *(Entry.of(path, shape=shape) for path, shape in shapes.items()),
            *(Entry.of(f"first_{name}") for name in _core.VIOLATIONS),
            *(Entry.of(name, shape=_SHAPES.get(name, ())) for name in self.summaries),
        ]
        self.entries = {
            entry.name: entry._replace(unit="N m")
            if law == "torque" and entry.name.startswith("schedule.angles")
            else entry
            for entry in entries
        }

    def split(self, values: Mapping[str, NDArray[Any]]) -> dict[str, Column]:
        """Splits the arrays of entries, name -> (runs, ...), into columns."""
        result: dict[str, Column] = {}
        for name, each in values.items():
            result.update(self.entries[name].split(each))
        return result

    def empty(self) -> dict[str, NDArray[Any]]:
        """Arrays of all entries without rows."""
        return {name: entry.empty() for name, entry in self.entries.items()}

    def locate(self, name: str, field: str = "name") -> tuple[str, int]:
        """Finds a numeric column: returns the name of its entry and its index in that entry.

        Args:
            name: The name of the column.
            field: The argument's name, for error messages.

        Raises:
            ValueError: The name is unknown, belongs to a summary that was not computed, to an entry
                with several columns, or to an event, which has no number.
            TypeError: The name is not a string.
        """
        checks.instance(field, name, str, "the name of a column")
        if name in (*_core.STATUSES, *_core.VIOLATIONS):
            raise ValueError(f"{name!r} is an event, which has no number: use `probability`")
        known = {
            key: (entry.name, k)
            for entry in self.entries.values()
            if entry.unit != ""
            for k, key in enumerate(entry.columns)
        }
        if name in known:
            return known[name]
        parts = [key for key in known if key.startswith(f"{name}.")]
        if parts:
            raise ValueError(f"{name!r} has several numbers: take one of {checks.quoted(parts)}")
        summary = name.split(".")[0]
        if summary in ("final_state", *_core.SUMMARIES) and summary not in self.summaries:
            more = " and more" if len(known) > _LISTED else ""
            raise ValueError(
                f"{field} = {checks.shown(name)} was not computed: pass "
                f"summaries={(*self.summaries, summary)!r}; computed columns are "
                f"{checks.quoted(list(known)[:_LISTED])}{more}"
            )
        allowed = (*known, "completed", *_core.STATUSES[1:], *_core.VIOLATIONS)
        raise ValueError(f"{field} = {checks.shown(name)} is unknown{checks.hint(name, allowed)}")


# Shapes of the summaries that have several numbers.
_SHAPES = {"final_state": (18,)}


def finite(*values: Floats) -> NDArray[np.bool_]:
    """Whether all of the given values are finite in each run, (runs,)."""
    kept: NDArray[np.bool_] = np.logical_and.reduce([np.isfinite(each) for each in values])
    return kept
