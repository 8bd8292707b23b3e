"""The rows of a study: sets of run numbers, the schema of the columns, the rows, and the events.

Results, Parquet parts, pandas, xarray, tables and figures use one schema. An entry with several
numbers has one column for each number. The columns of a varied value have indices, as in
"disturbances.0.force.0", so that `vary` accepts their names as paths. The columns of a result have
names, as in "final_state.theta".
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene import fields as units
from ..scene.scene import Scene
from ..support import checks

Numbers = NDArray[np.uint64]
Edges = NDArray[np.int64]

# The column that says whether each run's grasp held.
HOLDS = "holds"
# Events of a run whose probability can be estimated: its final status, a violation, a held grasp.
# Some violations are statuses too, because they can end a run.
EVENTS = tuple(dict.fromkeys((*_core.STATUSES, *_core.VIOLATIONS, HOLDS)))
# Events that bilateral contact does not have -> the events that it has in their place.
_UNILATERAL = {
    "opened": 'a tip that would open pulls: ask for "pulling"',
    "lost": 'a run goes on beyond the faces: ask for "off_face"',
}
# Error messages list at most this many columns, because a study may have thousands.
_LISTED = 20


class Spans:
    """A set of up to 2^62 run numbers: sorted, separate half-open intervals `edges` (k, 2)."""

    def __init__(self, edges: Edges) -> None:
        self.edges = edges

    @classmethod
    def upto(cls, runs: int) -> Self:
        """The set of the runs 0 to `runs` - 1."""
        return cls(np.array([[0, runs]], np.int64)[: min(runs, 1)])

    @classmethod
    def of(cls, numbers: Numbers) -> Self:
        """The set of the runs `numbers` (k,), which must increase."""
        given = numbers.astype(np.int64)
        return cls.joined([np.stack([given, given + 1], axis=1)])

    @classmethod
    def joined(cls, parts: Iterable[Edges]) -> Self:
        """The union of intervals in any order; a ValueError names a run that two of them have."""
        edges = np.concatenate([np.empty((0, 2), np.int64), *parts])
        edges = edges[np.argsort(edges[:, 0], kind="stable")]
        twice = np.flatnonzero(edges[1:, 0] < edges[:-1, 1])
        if twice.size:
            raise ValueError(f"run {edges[twice[0] + 1, 0]} occurs twice")
        # Merge intervals that touch: the last of each comes before one that begins another.
        begins = np.append(True, edges[1:, 0] != edges[:-1, 1])[: len(edges)]
        return cls(np.stack([edges[begins, 0], edges[np.roll(begins, -1), 1]], axis=1))

    @property
    def count(self) -> int:
        """The number of runs in the set."""
        return int((self.edges[:, 1] - self.edges[:, 0]).sum())

    def without(self, other: Self) -> Self:
        """The runs of this set that are not in `other`."""
        cuts = np.unique(np.concatenate([self.edges.ravel(), other.edges.ravel()]))
        # Between two cuts, either all runs or no runs are in each set, so the first one decides.
        kept = self.contains(cuts[:-1]) & ~other.contains(cuts[:-1])
        return self.joined([np.stack([cuts[:-1], cuts[1:]], axis=1)[kept]])

    def within(self, first: int, last: int) -> Self:
        """The runs of the set from `first` to `last` - 1."""
        low = int(np.searchsorted(self.edges[:, 1], first, side="right"))
        high = int(np.searchsorted(self.edges[:, 0], last, side="left"))
        edges = np.clip(self.edges[low:high], first, last)
        return type(self)(edges[edges[:, 0] < edges[:, 1]])

    def contains(self, runs: Numbers | NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether each of the given runs is in the set, (k,)."""
        if not len(self.edges):
            return np.zeros(len(runs), bool)
        given = runs.astype(np.int64)
        span = np.searchsorted(self.edges[:, 0], given, side="right") - 1
        return np.asarray((span >= 0) & (given < self.edges[span, 1]))

    def has(self, run: int) -> bool:
        """Whether one run is in the set."""
        return 0 <= run < 2**63 and bool(self.contains(np.array([run]))[0])

    def numbers(self) -> Numbers:
        """The numbers of all runs, increasing, (count,)."""
        parts = [np.arange(first, last, dtype=np.uint64) for first, last in self.edges]
        return np.concatenate([np.empty(0, np.uint64), *parts])

    def evenly_spaced(self, most: int) -> Numbers:
        """The numbers of at most `most` runs, evenly spaced among all, increasing."""
        ends = np.cumsum(self.edges[:, 1] - self.edges[:, 0])
        places = np.unique(np.linspace(0, self.count - 1, min(most, self.count)).astype(np.int64))
        span = np.searchsorted(ends, places, side="right")
        return np.asarray(self.edges[span, 1] - (ends[span] - places), dtype=np.uint64)

    def aligned_chunks(self, size: Callable[[], int]) -> Iterator[Numbers]:
        """Yields all run numbers, increasing, in arrays that end at multiples of a new `size`."""
        at, k = 0, 0
        while k < len(self.edges):
            at = max(at, int(self.edges[k, 0]))
            length = size()
            stop = (at // length + 1) * length
            yield self.within(at, stop).numbers()
            at = stop
            k = int(np.searchsorted(self.edges[:, 1], at, side="right"))


class Column(NamedTuple):
    """A column: one number or one text for each run."""

    values: NDArray[Any]  # (runs,)
    unit: str  # the unit; "1" for numbers without a unit, "" for text


class Entry(NamedTuple):
    """One entry of `Results.to_dict`, an array (runs, *shape)."""

    name: str
    dtype: Any  # that of a NumPy array
    shape: tuple[int, ...]
    unit: str | tuple[str, ...]  # of all values, or one for each index of the last axis
    axes: tuple[str | None, ...]  # the name in `units.AXES` of each axis of `shape`, if it has one

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
        return np.empty((0, *self.shape), self.dtype)

    def split(self, values: NDArray[Any]) -> dict[str, Column]:
        """Splits the entry's array (runs, *shape) into its columns."""
        columns = self.columns
        flat = values.reshape(len(values), len(columns))
        return {name: Column(flat[:, k], unit) for k, (name, unit) in enumerate(columns.items())}

    def joined(self, columns: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Joins the values of the entry's columns, each (runs,), into its array."""
        whole = np.stack(columns, axis=1) if self.shape else columns[0]
        return whole.reshape(-1, *self.shape).astype(self.dtype, copy=False)


class Schema:
    """All entries of a study's results, name -> entry, in the order of `Results.to_dict`."""

    def __init__(
        self,
        summaries: Iterable[str],
        shapes: Mapping[str, tuple[int, ...]],
        law: str,
        jaws: units.Jaws = (False, False),
    ) -> None:
        """Takes summaries, path -> shape of a varied value, the law, and which fingers are jaws."""
        self.summaries = tuple(summaries)
        self.entries: dict[str, Entry] = {}

        def add(name: str, dtype: Any = np.float64, shape: tuple[int, ...] = ()) -> None:
            # With the law "torque" the schedule's values are torques, in spite of their name.
            torques = law == "torque" and name.startswith("schedule.angles")
            unit = units.units("control.limits" if torques else name, shape, jaws)
            self.entries[name] = Entry(name, dtype, shape, unit, units.axes(name, shape))

        add("run", np.uint64)
        add("status", np.array(_core.STATUSES).dtype)
        add("message", object)
        add("end_time")
        add("failure_time")
        add("steps", np.uint64)
        add(HOLDS, np.bool_)
        for path, shape in shapes.items():
            add(path, shape=shape)
        for name in _core.VIOLATIONS:
            add(f"first_{name}")
        for name in self.summaries:
            add(name, shape=(18,) if name == "final_state" else ())

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
        """Finds a numeric column: returns the name of its entry and its index in that entry."""
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
            how = f"pass summaries={(*self.summaries, summary)!r}"
            computed = f"computed columns are {checks.quoted(list(known)[:_LISTED])}{more}"
            raise ValueError(f"{field} = {checks.shown(name)} was not computed: {how}; {computed}")
        allowed = (*known, "completed", *_core.STATUSES[1:], *_core.VIOLATIONS)
        raise ValueError(f"{field} = {checks.shown(name)} is unknown{checks.hint(name, allowed)}")


@dataclass(frozen=True, kw_only=True)
class Rows:
    """Rows of some runs: their numbers, what varies between them, their results, or both."""

    columns: dict[str, NDArray[Any]]  # name -> (runs, ...)
    interrupted: bool = False  # whether Ctrl-C stopped the computation before all runs were done

    @classmethod
    def of(cls, result: Mapping[str, Any], numbers: Numbers, summaries: Sequence[str]) -> Self:
        """Makes rows from the core's result of a batch, without the varied values."""
        computed = {"final_state": result["final_state"], **result["summaries"]}
        columns = {
            "run": numbers[result["run"]],
            "status": np.array(_core.STATUSES)[result["status"]],
            # Most runs have equal messages, so rows share one string for each distinct message.
            "message": np.array(result["messages"], dtype=object)[result["message"]],
            "holds": result["holds"],
            "end_time": result["t"],
            "steps": result["steps"],
            **{f"first_{name}": times for name, times in result["violations"].items()},
            **{name: computed[name] for name in summaries},
        }
        return cls(columns=columns, interrupted=bool(result["interrupted"]))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Concatenates one or more sets of rows."""
        if len(parts) == 1:
            return parts[0]
        columns = {k: np.concatenate([part.columns[k] for part in parts]) for k in parts[0].columns}
        return cls(columns=columns, interrupted=any(part.interrupted for part in parts))

    def __len__(self) -> int:
        return len(self.run)

    def entries(self) -> dict[str, NDArray[Any]]:
        """The columns and "failure_time": the end time of failed runs, NaN for completed runs."""
        completed = self.columns["status"] == "completed"
        end = np.where(completed, np.nan, self.columns["end_time"])
        return {**self.columns, "failure_time": end}

    @property
    def run(self) -> Numbers:
        """The numbers of the runs (runs,)."""
        return self.columns["run"]

    def select(self, rows: NDArray[Any]) -> Self:
        """Selects rows by an array of indices or of booleans."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return type(self)(columns=columns, interrupted=self.interrupted)

    def in_order(self) -> Self:
        """Sorts the rows by the numbers of the runs."""
        if bool((self.run[1:] > self.run[:-1]).all()):
            return self
        return self.select(np.argsort(self.run, kind="stable"))

    def with_values(self, block: Self) -> Self:
        """Adds the varied values of a block, whose runs increase and include all of these."""
        own = block.select(np.searchsorted(block.run, self.run)).columns
        return type(self)(columns={**self.columns, **own}, interrupted=self.interrupted)


def event_columns(name: str) -> tuple[str, ...]:
    """The names of the columns from which `happened` determines an event."""
    if name == HOLDS:
        return (HOLDS,)
    return ("status", f"first_{name}") if name in _core.VIOLATIONS else ("status",)


def happened(columns: Mapping[str, NDArray[Any]], name: str) -> NDArray[np.bool_]:
    """Whether the event `name` of `EVENTS` happened in each run, (runs,)."""
    if name == HOLDS:
        return np.asarray(columns[HOLDS], dtype=bool)
    seen = columns["status"] == name
    if name in _core.VIOLATIONS:
        seen = seen | ~np.isnan(columns[f"first_{name}"])
    return np.asarray(seen, dtype=bool)


def is_friction(path: str) -> bool:
    """Whether a varied path is the friction of both contacts or of one."""
    return path.split(".")[0] == "friction"


def checked_event(field: str, name: object, scene: Scene, varied: Iterable[str]) -> str:
    """Checks an event's name, and refuses one that no run could report, which would mislead."""
    name = checks.choice(field, name, EVENTS)
    if lacks := missing(name, scene, varied):
        raise ValueError(f'{field} = "{name}": needs {lacks}')
    return name


def missing(name: str, scene: Scene, varied: Iterable[str]) -> str:
    """The feature that a scene lacks for an event to occur at all; empty if it may occur."""
    if name in _UNILATERAL and scene.contact != "unilateral":
        return f'Scene.contact = "unilateral"; in bilateral contact {_UNILATERAL[name]}'
    if name == "slipping" and scene.friction is None and not any(map(is_friction, varied)):
        return 'a coefficient of friction; give Scene.friction, or vary "friction"'
    return ""
