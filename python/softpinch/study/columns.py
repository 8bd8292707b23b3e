"""The schema of a study's results: name, kind, shape and units of every entry.

`Setup.schema` makes one. Results, Parquet parts, pandas, xarray, tables and figures read it. An
entry of several numbers is a column for each: "disturbances.0.force.0", which is a path that
`vary` takes too, and "final_state.theta", by the coordinate's name.
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
# How many columns an error lists: a study may have thousands.
_LISTED = 20


class Column(NamedTuple):
    """One number, or text, for each run.

    Attributes:
        values: (runs,).
        unit: "1" for a number without one, "" for text.
    """

    values: NDArray[Any]
    unit: str


class Entry(NamedTuple):
    """One entry of `Results.to_dict`, an array (runs, *shape).

    Attributes:
        name: Its name.
        kind: What its values are.
        shape: Of one run's value.
        unit: Of its values, or one for each place along the last axis.
        axes: What its axes are, by names of `units.AXES`; None is counted.
    """

    name: str
    kind: Kind
    shape: tuple[int, ...]
    unit: str | tuple[str, ...]
    axes: tuple[str | None, ...]

    @classmethod
    def of(cls, name: str, kind: Kind = "number", shape: tuple[int, ...] = ()) -> Entry:
        """The entry of a name; units and axes are those of `units`."""
        return cls(name, kind, shape, units.units(name, shape), units.axes(name, shape))

    @property
    def columns(self) -> dict[str, str]:
        """The names of its single columns, in order -> unit."""
        if not self.shape:
            assert isinstance(self.unit, str)
            return {self.name: self.unit}
        # Names for what is computed; for a parameter the index, so that the column is a path.
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
        """Its array without a row."""
        return np.empty((0, *self.shape), _TYPES[self.kind])

    def split(self, values: NDArray[Any]) -> dict[str, Column]:
        """Its single columns, from (runs, *shape)."""
        columns = self.columns
        flat = values.reshape(len(values), len(columns))
        return {name: Column(flat[:, k], unit) for k, (name, unit) in enumerate(columns.items())}


class Schema:
    """All entries of a study's results.

    Attributes:
        entries: Name -> entry, in the order of `Results.to_dict`.
        summaries: The names of those that are computed along the way.
    """

    def __init__(self, summaries: Iterable[str], shapes: Mapping[str, tuple[int, ...]]) -> None:
        """Takes the summaries, and path -> shape of what each run has of its own."""
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
        self.entries = {entry.name: entry for entry in entries}

    def split(self, values: Mapping[str, NDArray[Any]]) -> dict[str, Column]:
        """Some entries, name -> (runs, ...), column by column."""
        result: dict[str, Column] = {}
        for name, each in values.items():
            result.update(self.entries[name].split(each))
        return result

    def empty(self) -> dict[str, NDArray[Any]]:
        """The entries without a row."""
        return {name: entry.empty() for name, entry in self.entries.items()}

    def locate(self, name: str, field: str = "name") -> tuple[str, int]:
        """Where a column of numbers is: the name of its entry, and which of its numbers.

        Raises:
            ValueError: It was not computed (the message says how to ask for it, and what there
                is), the name is unknown, stands for several numbers (the message has their names),
                or for what happens or not.
        """
        checks.instance(field, name, str, "the name of a column")
        if name in (*_core.STATUSES, *_core.VIOLATIONS):
            raise ValueError(f"{name!r} is an event without a number: ask for its probability")
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
                f"summaries={(*self.summaries, summary)!r}; there is "
                f"{checks.quoted(list(known)[:_LISTED])}{more}"
            )
        allowed = (*known, "completed", *_core.STATUSES[1:], *_core.VIOLATIONS)
        raise ValueError(f"{field} = {checks.shown(name)} is unknown{checks.hint(name, allowed)}")


# The summaries of several numbers.
_SHAPES = {"final_state": (18,)}


def finite(*values: Floats) -> NDArray[np.bool_]:
    """The runs in which all of the values are finite."""
    kept: NDArray[np.bool_] = np.logical_and.reduce([np.isfinite(each) for each in values])
    return kept
