"""An ensemble as columns of single numbers: what tables, figures and sensitivities have in common.

A value of several numbers becomes a column for each: "disturbances.0.force.0", which is a path that
`vary` takes too, and "final_state.theta", by the coordinate's name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene import units
from ..support import checks
from ..support.arrays import Floats
from .run_table import RunTable

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


def columns(entries: Mapping[str, NDArray[Any]]) -> dict[str, Column]:
    """Some entries of `Results.to_dict`, column by column."""
    result: dict[str, Column] = {}
    for name, values in entries.items():
        result.update(split(name, values))
    return result


def split(name: str, values: NDArray[Any]) -> dict[str, Column]:
    """The columns of one entry (runs, ...)."""
    shape = values.shape[1:]
    unit = units.units(name, shape)
    if not shape:
        assert isinstance(unit, str)
        return {name: Column(values, unit)}
    # Names for what is computed; for a parameter the index, so that the column's name is a path.
    last = units.axes(name, shape)[-1]
    named = units.AXES[last] if name in units.RESULTS and last is not None else None
    result = {}
    flat = values.reshape(len(values), math.prod(shape))
    for k, index in enumerate(np.ndindex(shape)):
        words = [str(place) for place in index]
        if named is not None:
            words[-1] = named[index[-1]]
        own = unit if isinstance(unit, str) else unit[index[-1]]
        result[".".join((name, *words))] = Column(flat[:, k], own)
    return result


def place(table: RunTable, name: str, field: str = "name") -> tuple[str, int]:
    """Where a column of numbers is: the entry of `Results.to_dict`, and which of its numbers.

    Raises:
        ValueError: It was not computed (the message says how to ask for it, and what there is),
            the name is unknown, stands for several numbers (the message has their names),
            or for what happens or not.
    """
    checks.instance(field, name, str, "the name of a column")
    if name in (*_core.STATUSES, *_core.VIOLATIONS):
        raise ValueError(f"{name!r}: happens or not: ask for its probability")
    # The columns' names need no rows, which may be on disk.
    known = {
        key: (entry, k)
        for entry, values in table._empty().items()
        for k, (key, column) in enumerate(split(entry, values).items())
        if column.unit != ""
    }
    if name in known:
        return known[name]
    parts = [key for key in known if key.startswith(f"{name}.")]
    if parts:
        raise ValueError(f"{name!r} has several numbers: take one of {checks.quoted(parts)}")
    summary = name.split(".")[0]
    computed = table._setup.summaries
    if summary in ("final_state", *_core.SUMMARIES) and summary not in computed:
        more = " and more" if len(known) > _LISTED else ""
        raise ValueError(
            f"{field} = {checks.shown(name)} was not computed: pass "
            f"summaries={(*computed, summary)!r}; there is "
            f"{checks.quoted(list(known)[:_LISTED])}{more}"
        )
    allowed = (*known, "completed", *_core.STATUSES[1:], *_core.VIOLATIONS)
    raise ValueError(f"{field} = {checks.shown(name)} is unknown{checks.hint(name, allowed)}")


def number(table: RunTable, name: str, field: str = "name") -> Column:
    """One number a run, by its column's name; of what happened, 1.0 or 0.0.

    Args:
        table: Which.
        name: A column of numbers ("peak_rotation", "final_state.theta", "grasped.mass"), or a
            status or violation ("completed", "pulling").
        field: What errors call it.

    Raises:
        ValueError: It was not computed (the message says how to ask for it, and what there is),
            the name is unknown, stands for several numbers (the message has their names),
            or is "slipping" and no run has a coefficient of friction.
    """
    checks.instance(field, name, str, "the name of a column")
    if name in (*_core.STATUSES, *_core.VIOLATIONS):
        return Column(table.happened(name).astype(np.float64), "1")
    entry, _ = place(table, name, field)
    column = split(entry, table[entry])[name]
    return Column(column.values.astype(np.float64), column.unit)


def finite(*values: Floats) -> NDArray[np.bool_]:
    """The runs in which all of the values are finite."""
    kept: NDArray[np.bool_] = np.logical_and.reduce([np.isfinite(each) for each in values])
    return kept
