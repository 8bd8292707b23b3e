"""A row for each run, in named columns, wherever the rows are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support import checks
from ..support.arrays import Floats, read_only
from .columns import HOLDS, Column
from .rows import Rows, checked_event, event_columns, happened
from .setup import Setup
from .spans import Numbers

# Messages are texts; NumPy keeps them as objects.
Texts = NDArray[np.object_]


class RunTable(ABC):
    """Rows of runs by the names of their columns. `Results` is what users see of one.

    Attributes:
        scene: What all runs share.
        seed: Of the draws and of held noise.
        sampler: How numbers were drawn.
    """

    def __init__(self, setup: Setup, sampling: Mapping[str, Any]) -> None:
        """Takes what the runs have in common, and where their numbers come from."""
        self._setup = setup
        self._sampling = dict(sampling)
        self.scene = setup.scene
        self.seed = setup.seed
        self.sampler: str = sampling["sampler"]
        self._names = tuple(setup.schema.entries)

    @property
    @abstractmethod
    def runs(self) -> int:
        """How many rows there are."""

    @abstractmethod
    def _read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Some entries of `to_dict`, each (runs, ...)."""

    @abstractmethod
    def _read_by_part(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        """Some entries of `to_dict`, some rows at a time, in no special order."""

    @abstractmethod
    def _varied_values(self, run: int) -> dict[str, Any]:
        """What a run had of its own; an error where there is no such run."""

    @abstractmethod
    def _evenly_spaced(self, most: int) -> Numbers:
        """The numbers of some runs, evenly among all, not more than so many."""

    @abstractmethod
    def has(self, run: int) -> bool:
        """Whether there is a row of this run."""

    @abstractmethod
    def _rows_of(self, runs: Numbers) -> Rows:
        """The rows of some runs, increasing, all of them there."""

    def _column(self, name: str) -> NDArray[Any]:
        return self._read((name,))[name]

    def __len__(self) -> int:
        """How many rows there are."""
        return self.runs

    @property
    def run(self) -> NDArray[np.uint64]:
        """(runs,), their numbers."""
        return self._column("run")

    @property
    def status(self) -> NDArray[np.str_]:
        """(runs,), how each ended: see `Run.status`."""
        return self._column("status")

    @property
    def message(self) -> Texts:
        """(runs,), the same in words."""
        return self._column("message")

    @property
    def holds(self) -> NDArray[np.bool_]:
        """(runs,), whether the grasp of each held, from `summaries_after` on: see `Run.holds`."""
        return self._column(HOLDS)

    @property
    def end_time(self) -> Floats:
        """(runs,), s, the last instant of each run on the clock of the scene."""
        return self._column("end_time")

    @property
    def failure_time(self) -> Floats:
        """(runs,), s, the same of those that did not complete; NaN for the others."""
        return self._column("failure_time")

    @property
    def steps(self) -> NDArray[np.uint64]:
        """(runs,), counted."""
        return self._column("steps")

    @property
    def violations(self) -> dict[str, Floats]:
        """Name -> (runs,), s, when each was first seen; NaN for never."""
        found = self._read([f"first_{name}" for name in _core.VIOLATIONS])
        return {name.removeprefix("first_"): times for name, times in found.items()}

    @property
    def parameters(self) -> dict[str, Floats]:
        """Path -> (runs, ...), what each run had of its own."""
        return self._read(tuple(self._setup.shapes))

    @property
    def summaries(self) -> dict[str, Floats]:
        """Name -> (runs, ...), those asked for; `results["peak_rotation"]` is the same.

        Of the ends of steps (and, where steps are free, of instants inside a step at which a tip
        seemed to leave and to come back). NaN where a run ended before `summaries_after`.

        - final_state: (runs, 18), q then p at the last instant.
        - peak_rotation: The largest |theta|, rad.
        - min_compression: The least d_n of both tips, m.
        - peak_friction_angle: The largest atan2(|lambda^N|, lambda^H) of both contacts, rad: above
          90 degrees where a tip pulls.
        - peak_friction_ratio: The largest |lambda^N| / lambda^H of both contacts, the coefficient
          of friction that the grasp needs; inf where a tip pulls, or where only lambda^H is zero.
        - pulling_time: For how long a tip pulls, s: the time between two ends of steps counts by
          half for each of the two at which one does.
        - settling_time: How long after `summaries_after` (or the start) the faces of the object
          went on moving faster than `settling_band`, s: the root mean square of both faces'
          middles. Infinite where they still did at the end, or the run did not complete.
        - max_residual: The largest |C| of the four constraints, C^H in m and C^N in m/s.
        - energy_closure: The largest error of the energy ledger, J.
        - peak_torque: The largest torque on either finger, N m: of the PID, or what drives it.
        """
        return self._read(self._setup.summaries)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A summary, the values of a path, or another entry of `to_dict`, (runs, ...).

        Raises:
            KeyError: It is none; the message says how to ask for a summary.
        """
        if name in self._names:
            return self._column(name)
        if name in ("final_state", *_core.SUMMARIES):
            wanted = (*self._setup.summaries, name)
            raise KeyError(f"{name} was not computed: pass summaries={wanted!r}")
        known = checks.quoted((*self._setup.summaries, *self._setup.shapes))
        raise KeyError(f"{checks.shown(name)}: must be one of {known}")

    def happened(self, what: str) -> NDArray[np.bool_]:
        """Whether each run has this status, saw this violation at any time, or "holds", (runs,).

        Raises:
            ValueError: The name is unknown, or "slipping" and no run has a coefficient of friction.
        """
        what = checked_event("what", what, self.scene, self._setup.shapes)
        return read_only(happened(self._read(event_columns(what)), what))

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Every column by its name, each (runs, ...).

        They are run, status, message, end_time, failure_time, steps, holds, the parameters by
        their paths, the violations as first_pulling, ..., and the summaries by their names.
        """
        return self._read(self._names)


def booleans(field: str, given: Any, runs: int) -> NDArray[np.bool_]:
    """Booleans that a user gives, one for each run.

    Raises:
        ValueError: They are something else, or have another length.
    """
    found = checks.read(field, given)
    if found.dtype != bool or found.shape != (runs,):
        raise ValueError(
            f"{field}: must be a name or booleans ({runs},), not {found.dtype} {found.shape}"
        )
    return cast("NDArray[np.bool_]", found)


def number(table: RunTable, name: str | NDArray[np.bool_], field: str = "name") -> Column:
    """One number a run, by its column's name; of what happened or is given, 1.0 or 0.0.

    Args:
        table: Which.
        name: A column of numbers ("peak_rotation", "final_state.theta", "grasped.mass"), or a
            status or violation ("completed", "pulling"), or booleans (runs,).
        field: What errors call it.

    Raises:
        ValueError: As `Schema.place`; or the name is "slipping" and no run has a coefficient of
            friction.
    """
    if not isinstance(name, str):
        return Column(booleans(field, name, table.runs).astype(np.float64), "1")
    if name in (*_core.STATUSES, *_core.VIOLATIONS):
        return Column(table.happened(name).astype(np.float64), "1")
    schema = table._setup.schema
    entry, _ = schema.locate(name, field)
    column = schema.entries[entry].split(table[entry])[name]
    return Column(column.values.astype(np.float64), column.unit)
