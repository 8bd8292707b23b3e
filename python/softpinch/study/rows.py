"""Result rows of runs, stored by column: the core's results and the varied values of each run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats
from .columns import HOLDS
from .spans import Numbers


@dataclass(frozen=True, kw_only=True)
class Rows:
    """The result rows of some runs.

    Attributes:
        columns: Name -> (runs, ...): run, status, message, holds, end_time, steps, first_pulling,
            ..., the summaries, and the varied values by their paths.
        interrupted: Whether Ctrl-C stopped the computation before all runs were done.
    """

    columns: dict[str, NDArray[Any]]
    interrupted: bool = False

    @classmethod
    def of(cls, result: Mapping[str, Any], numbers: Numbers, summaries: Sequence[str]) -> Self:
        """Makes rows from the core's result of a batch, without the varied values.

        After Ctrl-C the result has only the completed runs. Threads start runs in order, so the
        missing runs are those that were in progress, one for each lane, and those not yet started.

        Args:
            result: The core's result.
            numbers: The numbers of all runs of the batch.
            summaries: The names of the summaries to include.
        """
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
        columns = {
            name: np.concatenate([part.columns[name] for part in parts])
            for name in parts[0].columns
        }
        return cls(columns=columns, interrupted=any(part.interrupted for part in parts))

    def __len__(self) -> int:
        """The number of rows."""
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

    def with_values(self, numbers: Numbers, values: Mapping[str, Floats]) -> Self:
        """Adds the varied values of each run as columns.

        Args:
            numbers: Numbers of runs (k,), increasing, which include all runs of these rows.
            values: Path -> the varied values of the runs `numbers`, (k, ...).
        """
        rows = np.searchsorted(numbers, self.run)
        own = {path: value[rows] for path, value in values.items()}
        return type(self)(columns={**self.columns, **own}, interrupted=self.interrupted)


# Events of a run whose probability can be estimated: its final status, a violation, a held grasp.
# Some violations are statuses too, because they can end a run.
EVENTS = tuple(dict.fromkeys((*_core.STATUSES, *_core.VIOLATIONS, HOLDS)))
# Events that bilateral contact does not have -> the events that it has in their place.
_UNILATERAL = {
    "opened": 'a tip that would open pulls: ask for "pulling"',
    "lost": 'a run goes on beyond the faces: ask for "off_face"',
}


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
    """Checks the name of an event and returns it.

    Without a coefficient of friction, "slipping" is refused: no run could report it, and a
    probability of zero would suggest a grasp that never slips. In bilateral contact "opened" and
    "lost" are refused for the same reason.

    Args:
        field: The argument's name, for error messages.
        name: The name of the event.
        scene: The scene that all runs share.
        varied: The varied paths.

    Raises:
        ValueError: The name is unknown; is "slipping" without a coefficient of friction; or is
            "opened" or "lost" in bilateral contact.
        TypeError: The name is not a string.
    """
    name = checks.choice(field, name, EVENTS)
    if missing := _missing(name, scene, varied):
        raise ValueError(f'{field} = "{name}": needs {missing}')
    return name


def possible_violations(scene: Scene, varied: Iterable[str]) -> list[str]:
    """The violations that `checked_event` allows."""
    varied = tuple(varied)
    return [name for name in _core.VIOLATIONS if not _missing(name, scene, varied)]


def _missing(name: str, scene: Scene, varied: Iterable[str]) -> str:
    """What a scene lacks for an event to occur at all; empty if it may occur."""
    if name in _UNILATERAL and scene.contact != "unilateral":
        return f'Scene.contact = "unilateral"; in bilateral contact {_UNILATERAL[name]}'
    if name == "slipping" and scene.friction is None and not any(map(is_friction, varied)):
        return 'a coefficient of friction; give Scene.friction, or vary "friction"'
    return ""
