"""Access to the columns of results, independent of where the rows are stored."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.display import Shown, ShownTable
from .columns import HOLDS, Column
from .results_tables import distributions, statuses
from .rows import Rows, checked_event, event_columns, happened
from .setup import Setup
from .spans import Numbers

# Messages differ in length, so NumPy stores them as objects.
Texts = NDArray[np.object_]


# A notebook shows the distributions of so many runs at most; a study of more would have to be read.
_SHOWN_RUNS = 200_000
# Of entries with several numbers, the longest that it shows.
_SHOWN_COLUMNS = 4


class RunTable(Shown, ABC):
    """A table with one row for each run and named columns; `Results` adds statistics.

    Attributes:
        scene: The scene that all runs share, apart from the varied values.
        seed: Seed of the draws and of held noise.
        sampler: How numbers were drawn.
    """

    def __init__(self, setup: Setup, sampling: Mapping[str, Any]) -> None:
        """Takes the setup that all runs share, and the description of the draws."""
        self._setup = setup
        self._sampling = dict(sampling)
        self.scene = setup.scene
        self.seed = setup.seed
        self.sampler: str = sampling["sampler"]
        self._names = tuple(setup.schema.entries)

    @property
    @abstractmethod
    def runs(self) -> int:
        """The number of rows."""

    @abstractmethod
    def _read(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Returns entries of `to_dict` by their names, each (runs, ...)."""

    @abstractmethod
    def _read_by_part(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        """Yields entries of `to_dict` for some rows at a time, in any order of the rows."""

    @abstractmethod
    def _varied_values(self, run: int) -> dict[str, Any]:
        """Returns the varied values of a run.

        Raises:
            IndexError: There is no such run.
        """

    @abstractmethod
    def _evenly_spaced(self, most: int) -> Numbers:
        """Returns the numbers of at most `most` runs, evenly spaced among all runs."""

    @abstractmethod
    def has(self, run: int) -> bool:
        """Whether the table has a row of this run."""

    @abstractmethod
    def _rows_of(self, runs: Numbers) -> Rows:
        """Returns the rows of some runs: increasing numbers, all in the table."""

    def _column(self, name: str) -> NDArray[Any]:
        return self._read((name,))[name]

    def __len__(self) -> int:
        """The number of rows."""
        return self.runs

    @property
    def run(self) -> NDArray[np.uint64]:
        """The numbers of the runs (runs,)."""
        return self._column("run")

    @property
    def status(self) -> NDArray[np.str_]:
        """The final status of each run (runs,); see `Run.status`."""
        return self._column("status")

    @property
    def message(self) -> Texts:
        """The status of each run in words, with numbers (runs,)."""
        return self._column("message")

    @property
    def holds(self) -> NDArray[np.bool_]:
        """Whether each run's grasp held (runs,); see `Run.holds`.

        In bilateral contact this counts from `summaries_after` on; in unilateral contact it means
        that the run completed and no tip is free at its end.
        """
        return self._column(HOLDS)

    @property
    def end_time(self) -> Floats:
        """The last instant of each run (runs,), s, on the clock of the scene."""
        return self._column("end_time")

    @property
    def failure_time(self) -> Floats:
        """The last instant of each run that did not complete (runs,), s; NaN for completed runs."""
        return self._column("failure_time")

    @property
    def steps(self) -> NDArray[np.uint64]:
        """The number of steps of each run (runs,)."""
        return self._column("steps")

    @property
    def violations(self) -> dict[str, Floats]:
        """Violation -> the time at which each run first had it (runs,), s; NaN for never."""
        found = self._read([f"first_{name}" for name in _core.VIOLATIONS])
        return {name.removeprefix("first_"): times for name, times in found.items()}

    @property
    def parameters(self) -> dict[str, Floats]:
        """Path -> the varied values of each run (runs, ...)."""
        return self._read(tuple(self._setup.shapes))

    @property
    def summaries(self) -> dict[str, Floats]:
        """Name -> (runs, ...), the computed summaries; also available as `results["name"]`.

        Summaries use the states at the ends of steps. With `tolerance` they also use instants
        inside a step at which a tip seemed to separate and return. They are NaN if the run ended
        before `summaries_after`.

        - final_state: q, then p, at the last instant (runs, 18).
        - peak_rotation: The largest |theta|, rad.
        - min_compression: The smallest d_n of both tips, m.
        - peak_friction_angle: The largest atan2(|lambda^N|, lambda^H) of both contacts, rad; above
          90 degrees if a tip pulls.
        - peak_friction_ratio: The largest |lambda^N| / lambda^H of both contacts, which is the
          coefficient of friction that the grasp needs; inf if a tip pulls, or if lambda^H is zero
          and lambda^N is not.
        - pulling_time: The total time during which a tip pulls, s. A step counts in full if a tip
          pulls at both of its ends, and by half if at one end. Zero in unilateral contact.
        - slip_distance: The distance that the faces slide over the tips, both contacts together, m.
          Zero in bilateral contact.
        - free_time: The total time during which a tip is free, s. Zero in bilateral contact.
        - settling_time: The time from `summaries_after`, or from the start, until the speed of the
          object's faces stays below `settling_band`, s. The speed is the root mean square of both
          faces' middles. It is inf if the speed is above the band at the end, or if the run did not
          complete.
        - max_residual: The largest |C| of the four constraints, C^H in m and C^N in m/s.
        - energy_closure: The largest error of the energy ledger, J.
        - peak_torque: The largest torque on either finger, N m: of the PID, or the torque that
          drives the finger.
        """
        return self._read(self._setup.summaries)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """An entry of `to_dict` by its name: a summary, a varied path, or another one, (runs, ...).

        Raises:
            KeyError: There is no such entry; the message says how to compute a missing summary.
        """
        if name in self._names:
            return self._column(name)
        if name in ("final_state", *_core.SUMMARIES):
            wanted = (*self._setup.summaries, name)
            raise KeyError(f"{name} was not computed: pass summaries={wanted!r}")
        known = checks.quoted((*self._setup.summaries, *self._setup.shapes))
        raise KeyError(f"{checks.shown(name)}: must be one of {known}")

    def happened(self, what: str) -> NDArray[np.bool_]:
        """Whether an event happened in each run: a status, a violation or "holds", (runs,).

        Raises:
            ValueError: The name is unknown, "slipping" and no run has a coefficient of friction, or
                "opened" or "lost" in bilateral contact.
        """
        what = checked_event("what", what, self.scene, self._setup.shapes)
        return read_only(happened(self._read(event_columns(what)), what))

    def _tables(self) -> Iterator[ShownTable]:
        """The statuses, and the distributions of varied numbers and summaries."""
        if not self.runs:
            return
        parts = self._read_by_part(("status", *event_columns(HOLDS)))
        yield statuses((part["status"], happened(part, HOLDS)) for part in parts)
        entries = self._setup.schema.entries
        columns = [entries[name].columns for name in (*self._setup.shapes, *self._setup.summaries)]
        names = [name for some in columns if len(some) <= _SHOWN_COLUMNS for name in some]
        if names and self.runs <= _SHOWN_RUNS:
            yield distributions({name: number(self, name) for name in names})

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """All entries by their names, each (runs, ...).

        The entries are run, status, message, end_time, failure_time, steps, holds, the varied
        values by their paths, the violations as first_pulling, ..., and the summaries.
        """
        return self._read(self._names)


def booleans(field: str, given: Any, runs: int) -> NDArray[np.bool_]:
    """Checks an array of booleans from the user, one for each run.

    Args:
        field: The argument's name, for error messages.
        given: The array.
        runs: The expected number of booleans.

    Raises:
        ValueError: The array does not hold booleans, or has the wrong shape.
    """
    found = checks.read(field, given)
    if found.dtype != bool or found.shape != (runs,):
        raise ValueError(
            f"{field}: must be a name or booleans ({runs},), not {found.dtype} {found.shape}"
        )
    return cast("NDArray[np.bool_]", found)


def number(table: RunTable, name: str | NDArray[np.bool_], field: str = "name") -> Column:
    """Returns one number for each run: the values of a column, or 1.0 and 0.0 for an event.

    Args:
        table: The table.
        name: A numeric column ("peak_rotation", "final_state.theta", "grasped.mass"), a status or
            violation ("completed", "pulling"), or booleans (runs,).
        field: The argument's name, for error messages.

    Raises:
        ValueError: As for `Schema.locate`; the name is "slipping" and no run has a coefficient of
            friction; or it is "opened" or "lost" in bilateral contact.
    """
    if not isinstance(name, str):
        return Column(booleans(field, name, table.runs).astype(np.float64), "1")
    if name in (*_core.STATUSES, *_core.VIOLATIONS):
        return Column(table.happened(name).astype(np.float64), "1")
    schema = table._setup.schema
    entry, _ = schema.locate(name, field)
    column = schema.entries[entry].split(table[entry])[name]
    return Column(column.values.astype(np.float64), column.unit)


def drawn_by_magnitude(table: RunTable, name: str) -> bool:
    """Whether a number was drawn by a distribution of its logarithm."""
    for paths, source in table._sampling["vary"].items():
        if source["kind"] in ("log_uniform", "log_normal"):
            for path in paths.split(", "):
                if name == path or name.startswith(f"{path}."):
                    return True
    return False
