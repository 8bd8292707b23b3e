"""Rows of runs, column by column: what the core gives, and what each run had of its own."""

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
    """Some runs.

    Attributes:
        columns: Name -> (runs, ...): run, status, message, holds, end_time, steps, first_pulling,
            ..., the summaries, and the paths of what each run had of its own.
        interrupted: Whether Ctrl-C left some out.
    """

    columns: dict[str, NDArray[Any]]
    interrupted: bool = False

    @classmethod
    def of(cls, result: Mapping[str, Any], numbers: Numbers, summaries: Sequence[str]) -> Self:
        """The runs of a batch that were done; `numbers` are those of all its runs.

        Threads take them in their order. So what Ctrl-C leaves out are the few under way, one a
        lane, and those never begun, which no length of theirs has chosen.
        """
        computed = {"final_state": result["final_state"], **result["summaries"]}
        columns = {
            "run": numbers[result["run"]],
            "status": np.array(_core.STATUSES)[result["status"]],
            # Most runs end with the same words: they are kept once.
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
        """Several behind each other, at least one."""
        if len(parts) == 1:
            return parts[0]
        columns = {
            name: np.concatenate([part.columns[name] for part in parts])
            for name in parts[0].columns
        }
        return cls(columns=columns, interrupted=any(part.interrupted for part in parts))

    def __len__(self) -> int:
        """How many rows there are."""
        return len(self.run)

    def entries(self) -> dict[str, NDArray[Any]]:
        """The columns, and when runs that did not complete ended."""
        completed = self.columns["status"] == "completed"
        end = np.where(completed, np.nan, self.columns["end_time"])
        return {**self.columns, "failure_time": end}

    @property
    def run(self) -> Numbers:
        """Their numbers (runs,)."""
        return self.columns["run"]

    def select(self, rows: NDArray[Any]) -> Self:
        """Some of the rows, by index or by truth."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return type(self)(columns=columns, interrupted=self.interrupted)

    def in_order(self) -> Self:
        """By the numbers of the runs."""
        if bool((self.run[1:] > self.run[:-1]).all()):
            return self
        return self.select(np.argsort(self.run, kind="stable"))

    def with_values(self, numbers: Numbers, values: Mapping[str, Floats]) -> Self:
        """With what each run had of its own, out of that of the runs `numbers` (increasing)."""
        rows = np.searchsorted(numbers, self.run)
        own = {path: value[rows] for path, value in values.items()}
        return type(self)(columns={**self.columns, **own}, interrupted=self.interrupted)


# What can be asked of each run: how it ended, what it saw, and whether its grasp held.
EVENTS = (*_core.STATUSES, *_core.VIOLATIONS, HOLDS)


def event_columns(name: str) -> tuple[str, ...]:
    """The columns that say whether something happened."""
    if name == HOLDS:
        return (HOLDS,)
    return ("status", f"first_{name}") if name in _core.VIOLATIONS else ("status",)


def happened(columns: Mapping[str, NDArray[Any]], name: str) -> NDArray[np.bool_]:
    """Whether a run has this status, or saw this violation, or holds, (runs,)."""
    if name == HOLDS:
        return np.asarray(columns[HOLDS], dtype=bool)
    seen = columns["status"] == name
    if name in _core.VIOLATIONS:
        seen = seen | ~np.isnan(columns[f"first_{name}"])
    return np.asarray(seen, dtype=bool)


def checked_event(field: str, name: object, scene: Scene, varied: Iterable[str]) -> str:
    """A status, a violation or "holds", of runs of a scene; `field` is what errors call it.

    Raises:
        ValueError: It is unknown, or "slipping" where no run has a coefficient of friction: that
            nothing was noted then would pass for a grasp that never slips.
        TypeError: It is no text.
    """
    name = checks.choice(field, name, EVENTS)
    if name == "slipping" and scene.friction is None and "friction" not in varied:
        raise ValueError(
            f'{field} = "slipping": needs a coefficient of friction; give Scene.friction, or vary '
            '"friction"'
        )
    return name
