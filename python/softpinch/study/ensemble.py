"""What many runs came to, in memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..run.run import Run
from ..support import checks
from ..support.arrays import read_only
from .capsule import Capsule
from .estimates import Discretisation, plain
from .results import Outcome, Results, failure_time
from .rows import Rows
from .setup import Setup
from .spans import Numbers


class Ensemble(Results):
    """The result of `monte_carlo` without a store: arrays with a row for each run, read-only.

    Attributes:
        requested: How many runs were asked for; more than there are rows where Ctrl-C, `stop_when`
            or lost workers ended it.
        interrupted: Whether Ctrl-C did, or cut short `discretisation` or `trajectories`.
    """

    def __init__(
        self,
        setup: Setup,
        sampling: Mapping[str, Any],
        rows: Rows,
        *,
        requested: int,
        outcome: Outcome = Outcome(),  # noqa: B008, it never changes
        trajectories: Mapping[int, Run] | None = None,
        discretisation: dict[str, Discretisation] | None = None,
    ) -> None:
        """Users get ensembles from `monte_carlo`."""
        super().__init__(setup, sampling)
        self._rows = rows
        self.requested = requested
        self.interrupted, self.lost, self._under_way = outcome
        self.trajectories: dict[int, Run] = dict(trajectories or {})
        self.discretisation = discretisation
        columns = {**rows.columns, "failure_time": failure_time(rows.columns)}
        self._columns = {name: read_only(columns[name]) for name in self._names}

    @property
    def runs(self) -> int:
        """How many rows there are."""
        return len(self._rows)

    def _take(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        return {name: self._columns[name] for name in names}

    def _in_parts(self, names: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
        yield self._take(names)

    def _some(self, runs: Numbers) -> Rows:
        return self._rows.at(np.searchsorted(self.run, runs))

    def chunks(self) -> Iterator[Ensemble]:
        """All rows, at once."""
        yield self

    def _spread_out(self, most: int) -> Numbers:
        rows = np.linspace(0, self.runs - 1, min(most, self.runs)).astype(int)
        chosen: Numbers = self.run[np.unique(rows)]
        return chosen

    def _keep(self, run: int, path: Run) -> None:
        self.trajectories[run] = path

    def has(self, run: int) -> bool:
        """Whether there is a row of this run."""
        if not 0 <= checks.integer("run", run) < 2**64:
            return False
        row = int(np.searchsorted(self.run, np.uint64(run)))
        return row < self.runs and bool(self.run[row] == run)

    def _values_of(self, run: int) -> dict[str, Any]:
        if not self.has(run):
            raise IndexError(
                f"run {checks.shown(run)} is not among the {self.runs} runs of this ensemble"
            )
        row = int(np.searchsorted(self.run, np.uint64(run)))
        return {path: self._columns[path][row] for path in self._setup.shapes}

    def failures(self) -> list[Capsule]:
        """The runs that did not complete, each with all that replays it alone."""
        return self._capsules(np.flatnonzero(self.status != "completed"))

    def _capsules(self, rows: NDArray[np.intp]) -> list[Capsule]:
        varied, options = self._setup.varied, self._setup.options
        return [
            Capsule(
                run=int(self.run[row]),
                status=str(self.status[row]),
                time=float(self.end_time[row]),
                message=str(self.message[row]),
                parameters={path: plain(self._columns[path][row]) for path in self._setup.shapes},
                varied=varied,
                options=options,
            )
            for row in rows.tolist()
        ]

    def __reduce__(self) -> tuple[Any, ...]:
        """Through the constructor: unpickled arrays would be writable."""
        return _rebuild, (
            (self._setup, self._sampling, self._rows),
            {
                "requested": self.requested,
                "outcome": Outcome(self.interrupted, self.lost, self._under_way),
                "trajectories": self.trajectories,
                "discretisation": self.discretisation,
            },
        )

    def __repr__(self) -> str:
        """Counts of the statuses, and what was computed."""
        counts = ", ".join(f"{count} {name}" for name, count in self.counts().items()) or "no runs"
        cut = f" of {self.requested} requested" if self.requested != self.runs else ""
        stopped = ", interrupted" if self.interrupted else ""
        return (
            f"<Ensemble of {self.runs} runs{cut}: {counts}{stopped}; "
            f"{', '.join(self._setup.summaries) or 'no summaries'}>"
        )


def _rebuild(what: tuple[Any, ...], how: Mapping[str, Any]) -> Ensemble:
    return Ensemble(*what, **how)
