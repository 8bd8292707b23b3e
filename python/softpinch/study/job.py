"""The computing of a study's runs, wherever it is done and wherever their rows are kept."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support.arrays import Floats
from ..support.errors import LostRunsWarning, StabilityWarning
from ..support.progress import Report, reporting
from .engine import Accept, Piece, how_many_threads, on_threads
from .estimates import Discretisation, Estimate
from .outcome import Outcome
from .results import Results
from .rows import Rows, happened
from .setup import Setup
from .sources import BLOCK
from .spans import Numbers, Spans

if TYPE_CHECKING:
    from .executor import Engine

# Runs that one call of the core takes: enough to keep threads busy, few enough to hear of them.
MOST_BLOCKS = 32
# Runs that are computed again with half the step.
_CHECKED = 256

# Gives what each of some runs has of its own: path -> (k, ...).
Source: TypeAlias = Callable[[Numbers], dict[str, Floats]]


@dataclass(kw_only=True)
class Job:
    """What `monte_carlo` was asked for, checked.

    Attributes:
        setup: What the runs have in common.
        source: What each has of its own.
        wanted: Which to compute.
        kept: Those whose paths are kept.
        check_dt: Whether some are computed again with smaller steps.
        narrow: Status or violation -> half width at which it is enough.
        threads: As for `monte_carlo`, like those that follow.
        executor: Computes them.
        progress: Hears of it.
    """

    setup: Setup
    source: Source
    wanted: Spans
    kept: Sequence[int]
    check_dt: bool
    narrow: Mapping[str, float]
    threads: int | None
    executor: Engine | None
    progress: bool | Report
    _first: tuple[Numbers, _core.Batch] | None = None

    def check(self, missing: Spans) -> None:
        """Refuses what breaks a rule, in any run, also with the smaller steps of `check_dt`.

        Warns:
            StabilityWarning: `dt` is beyond what the method damps.
        """
        advice: list[str] = []
        for numbers in missing.pieces(lambda: MOST_BLOCKS * BLOCK):
            values = self.source(numbers)
            self.setup.varied.check(values, numbers)
            batch = self.setup.batch(numbers, values)
            self._first = self._first or (numbers, batch)
            advice.append(batch.warning or "")
            if self.check_dt:
                try:
                    self.setup.batch(numbers, values, self.setup.refined)
                except ValueError as error:
                    raise ValueError(f"check_dt: {error}") from None
        for text in dict.fromkeys(filter(None, advice)):
            warnings.warn(text, StabilityWarning, stacklevel=4)

    def compute(self, missing: Spans, accept: Accept, size: Callable[[], int]) -> Outcome:
        """Computes runs; `accept` keeps them, and says whether they are enough.

        Warns:
            LostRunsWarning: Workers failed to bring some back.
        """
        pieces = (self._piece(numbers) for numbers in missing.pieces(size))
        with reporting(self.progress, "simulating") as report:
            outcome = self._engine(pieces, missing, report, accept)
        for one in outcome.lost:
            warnings.warn(f"lost {one}", LostRunsWarning, stacklevel=4)
        return outcome

    def _piece(self, numbers: Numbers) -> Piece:
        """Runs to compute. Most studies are one piece, which has been made to be checked."""
        first, self._first = self._first, None
        if self.executor is None and first is not None and np.array_equal(first[0], numbers):
            return Piece(numbers, self.source(numbers), batch=first[1])
        return Piece(numbers, self.source(numbers))

    def _engine(
        self, pieces: Iterable[Piece], asked: Spans, report: Report, accept: Accept
    ) -> Outcome:
        if self.executor is None:
            threads = how_many_threads(self.threads)
            return on_threads(self.setup, pieces, asked.count, threads, report, accept)
        from .executor import on_executor

        threads = 1 if self.threads is None else self.threads
        in_order = bool(self.narrow)
        return on_executor(
            self.setup, pieces, asked, self.executor, threads, report, accept, in_order
        )

    def finish(self, results: Results) -> None:
        """Computes what follows the runs: some of them with smaller steps, and paths to keep.

        Warns:
            LostRunsWarning: Workers failed to bring those with smaller steps back.
        """
        if self.check_dt and results.runs and not results.interrupted:
            self._check_dt(results)
        for run in self.kept:
            if results.has(run) and run not in results.trajectories:
                replayed = results.replay(run)
                if replayed.status == "interrupted":
                    results.interrupted = True
                    break
                results._keep(run, replayed)

    def _check_dt(self, results: Results) -> None:
        """How far the steps put the summaries off, from some runs with smaller ones."""
        coarse = results._some(results._spread_out(_CHECKED))
        values = {path: coarse.columns[path] for path in self.setup.shapes}
        piece = Piece(coarse.run, values, self.setup.refined)
        found = [self.setup.empty()]

        def accept(rows: Rows) -> bool:
            found.append(rows)
            return False

        outcome = self._engine([piece], Spans.of(coarse.run), lambda *_: None, accept)
        finer = Rows.joined(found)
        for one in outcome.lost:
            warnings.warn(f"check_dt: lost {one}", LostRunsWarning, stacklevel=5)
        coarse = coarse.at(np.isin(coarse.run, finer.run))
        pairs: dict[str, Callable[[Mapping[str, NDArray[Any]]], Floats]] = {
            name: lambda columns, name=name: columns[name]  # type: ignore[misc]
            for name in self.setup.summaries
        }
        pairs["completed"] = lambda columns: (columns["status"] == "completed").astype(float)
        results.discretisation = {
            name: Discretisation.of(
                of(coarse.columns),
                of(finer.columns),
                (
                    of(part)
                    for part in results._in_parts(("status" if name == "completed" else name,))
                ),
            )
            for name, of in pairs.items()
        }
        results.interrupted = outcome.interrupted


class Until:
    """Says when probabilities are known well enough: at the end of a block, whoever computes it."""

    def __init__(self, narrow: Mapping[str, float], wanted: Spans) -> None:
        """Takes half widths, and the runs that there may be."""
        self._narrow = narrow
        self._wanted = wanted
        # Block -> how many of its runs there are, and in how many it happened.
        self._runs: Counter[int] = Counter()
        self._happened: dict[str, Counter[int]] = {name: Counter() for name in narrow}
        # What all blocks before `_next` have.
        self._next = 0
        self._done = 0
        self._counts: Counter[str] = Counter()

    def enough(self, rows: Rows) -> bool:
        """Whether they are with these rows."""
        if not self._narrow:
            return False
        blocks = rows.run // BLOCK
        for block in np.unique(blocks).tolist():
            inside = blocks == block
            self._runs[block] += int(inside.sum())
            for name, counts in self._happened.items():
                counts[block] += int(happened(rows.columns, name)[inside].sum())
        # From block to block: a later one that is there already does not count before its turn.
        while self._runs[self._next] and self._whole(self._next):
            self._done += self._runs[self._next]
            for name, counts in self._happened.items():
                self._counts[name] += counts[self._next]
            self._next += 1
            if self._is_narrow():
                return True
        return False

    def _whole(self, block: int) -> bool:
        wanted = self._wanted.within(block * BLOCK, (block + 1) * BLOCK).count
        return self._runs[block] >= wanted

    def _is_narrow(self) -> bool:
        return all(
            Estimate.counted(self._counts[name], self._done).half_width <= width
            for name, width in self._narrow.items()
        )
