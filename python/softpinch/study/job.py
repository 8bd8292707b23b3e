"""Computing a study's runs, on threads or an executor, for results in memory or in a folder."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run.simulate import whole
from ..run.stiffness import is_explicit, too_long
from ..support import checks
from ..support.arrays import Floats
from ..support.errors import LostRunsWarning, StabilityWarning, warn
from ..support.interrupt import handlers_waiting
from ..support.progress import Report, reporting
from .columns import HOLDS
from .engine import Accept, RunBlock, how_many_threads, on_threads
from .estimates import Discretisation, Estimate
from .outcome import Outcome
from .results import Results
from .rows import Rows, event_columns, happened
from .setup import Setup
from .sources import BLOCK
from .spans import Numbers, Spans
from .spec import StudySpec

if TYPE_CHECKING:
    from .executor import Engine

# Largest number of blocks per call of the core: enough to keep all threads busy, few enough for
# frequent progress reports.
MOST_BLOCKS = 32
# Number of failed runs whose steps are looked at.
_SUSPECTS = 8
# Number of runs that `check_dt` computes again with smaller steps.
_CHECKED = 256

# Function from the numbers of runs to their varied values: path -> (k, ...).
Source: TypeAlias = Callable[[Numbers], dict[str, Floats]]


@dataclass(kw_only=True)
class Job:
    """A study to compute, and the means to compute it.

    Attributes:
        spec: The study.
        source: Gives the varied values of runs.
        wanted: The runs to compute.
        threads: As for `monte_carlo`, as are `executor` and `progress`.
        executor: The executor that computes the runs; None computes them on threads.
        progress: Whether and how to report progress.
    """

    spec: StudySpec
    source: Source
    wanted: Spans
    threads: int | None
    executor: Engine | None
    progress: bool | Report
    _first: tuple[Numbers, _core.Batch] | None = None
    _warned: bool = False

    @classmethod
    def checked(
        cls,
        spec: StudySpec,
        *,
        only: ArrayLike | None = None,
        threads: int | None = None,
        executor: Engine | None = None,
        progress: bool | Report = True,
    ) -> Self:
        """Checks the arguments of `monte_carlo` that say which runs to compute and how.

        Raises:
            ValueError: An argument breaks its rule.
            TypeError: An argument is of the wrong kind.
        """
        runs = spec.runs
        wanted = Spans.upto(runs) if only is None else Spans.of(_numbers(only, runs))
        for run in spec.trajectories:
            if not wanted.within(run, run + 1).count:
                raise ValueError(f"trajectories: run {run} is not in only")
        if threads is not None:
            how_many_threads(threads)
        if executor is not None:
            with handlers_waiting():
                from . import executor as executors

            executors.check(executor)
        return cls(
            spec=spec,
            source=spec.plan.rows,
            wanted=wanted,
            threads=threads,
            executor=executor,
            progress=progress,
        )

    @property
    def setup(self) -> Setup:
        """The part of the study that all runs share."""
        return self.spec.setup

    def check(self, missing: Spans) -> None:
        """Refuses a study if any run breaks a rule, also with the smaller steps of `check_dt`.

        Warns:
            StabilityWarning: `dt` is too long for the method to be stable.
        """
        advice: list[str] = []
        for numbers in missing.aligned_chunks(lambda: MOST_BLOCKS * BLOCK):
            values = self.source(numbers)
            self.setup.varied.check(values, numbers)
            batch = self.setup.batch(numbers, values)
            self._first = self._first or (numbers, batch)
            advice.append(batch.warning or "")
            if self.spec.check_dt:
                try:
                    self.setup.batch(numbers, values, self.setup.refined)
                except ValueError as error:
                    raise ValueError(f"check_dt: {error}") from None
        for text in dict.fromkeys(filter(None, advice)):
            warn(text, StabilityWarning)
            self._warned = True

    def compute(self, missing: Spans, accept: Accept, size: Callable[[], int]) -> Outcome:
        """Computes runs; `accept` keeps their rows and returns whether they are enough.

        Warns:
            LostRunsWarning: Workers failed to compute some runs.
        """
        blocks = (self._block(numbers) for numbers in missing.aligned_chunks(size))
        with reporting(self.progress, "simulating") as report:
            outcome = self._engine(blocks, missing, report, accept)
        for one in outcome.lost:
            warn(f"lost {one}", LostRunsWarning)
        return outcome

    def _block(self, numbers: Numbers) -> RunBlock:
        """A block of runs; with its batch, if `check` has made it already."""
        first, self._first = self._first, None
        if self.executor is None and first is not None and np.array_equal(first[0], numbers):
            return RunBlock(numbers, self.source(numbers), batch=first[1])
        return RunBlock(numbers, self.source(numbers))

    def _engine(
        self, blocks: Iterable[RunBlock], asked: Spans, report: Report, accept: Accept
    ) -> Outcome:
        if self.executor is None:
            threads = how_many_threads(self.threads)
            return on_threads(self.setup, blocks, asked.count, threads, report, accept)
        from .executor import on_executor

        threads = 1 if self.threads is None else self.threads
        in_order = bool(self.spec.stop_when)
        return on_executor(
            self.setup, blocks, asked, self.executor, threads, report, accept, in_order
        )

    def finish(self, results: Results) -> None:
        """Does the work after the runs: repeats some with smaller steps, and adds trajectories.

        Warns:
            LostRunsWarning: Workers failed to compute some runs with smaller steps.
            StabilityWarning: A run failed because `dt` is too long for its method.
        """
        if results.runs and not results.interrupted and not self._warned:
            self._warn_of_steps(results)
        if self.spec.check_dt and results.runs and not results.interrupted:
            self._check_dt(results)
        for run in self.spec.trajectories:
            if results.has(run) and run not in results.trajectories:
                replayed = results.replay(run)
                if replayed.status == "interrupted":
                    results.interrupted = True
                    break
                results._add_trajectory(run, replayed)

    def _warn_of_steps(self, results: Results) -> None:
        """Looks at some of the failed runs, and warns once if their steps were too long."""
        options = self.setup.options
        if options.dt is None or not is_explicit(options.method):
            return
        count, suspects = 0, []
        for part in results._read_by_part(("run", "status", "end_time")):
            rows = np.flatnonzero(part["status"] != "completed")
            count += len(rows)
            for row in rows[_spread(len(rows))]:
                ended = str(part["status"][row]), float(part["end_time"][row])
                suspects.append((int(part["run"][row]), ended))
        for k in _spread(len(suspects)).tolist():
            run, ended = suspects[k]
            try:
                text = too_long(results.scene_of(run), options, ended, whole)
            except KeyboardInterrupt:
                results.interrupted = True
                return
            if text is not None:
                what = f"run {run}, one of {count} that did not complete"
                warn(f"{what}: {text}", StabilityWarning)
                return

    def _check_dt(self, results: Results) -> None:
        """Estimates the error of summaries and probabilities, from runs with smaller steps."""
        coarse = results._rows_of(results._evenly_spaced(_CHECKED))
        values = {path: coarse.columns[path] for path in self.setup.shapes}
        block = RunBlock(coarse.run, values, self.setup.refined)
        found = [self.setup.empty()]

        def accept(rows: Rows) -> bool:
            found.append(rows)
            return False

        outcome = self._engine([block], Spans.of(coarse.run), lambda *_: None, accept)
        finer = Rows.joined(found)
        for one in outcome.lost:
            warn(f"check_dt: lost {one}", LostRunsWarning)
        coarse = coarse.select(np.isin(coarse.run, finer.run))
        events = ("completed", HOLDS)

        def compared(name: str, columns: Mapping[str, NDArray[Any]]) -> Floats:
            return happened(columns, name).astype(float) if name in events else columns[name]

        results.discretisation = {
            name: Discretisation.of(
                compared(name, coarse.columns),
                compared(name, finer.columns),
                (
                    compared(name, part)
                    for part in results._read_by_part(
                        event_columns(name) if name in events else (name,)
                    )
                ),
            )
            for name in (*self.setup.summaries, *events)
        }
        results.interrupted = outcome.interrupted


def _spread(count: int) -> NDArray[np.intp]:
    """Up to eight indices, evenly spread over `count` places."""
    return np.unique(np.linspace(0, count - 1, min(_SUSPECTS, count)).astype(np.intp))


def _numbers(only: ArrayLike, runs: int) -> Numbers:
    given = checks.read("only", only)
    if given.ndim != 1 or given.dtype.kind not in "iu" or len(given) == 0:
        raise TypeError(f"only = {checks.shown(only)}: must be the numbers of runs, (k,)")
    # Differences of unsigned numbers would wrap.
    if (given[1:] <= given[:-1]).any() or given[0] < 0 or given[-1] >= runs:
        raise ValueError(f"only: must be increasing and from 0 to runs - 1 = {runs - 1}")
    return given.astype(np.uint64)


class EarlyStopping:
    """Decides after each block whether the probabilities are known well enough to stop."""

    def __init__(self, narrow: Mapping[str, float], wanted: Spans) -> None:
        """Takes the half widths, by event, and the runs that were asked for."""
        self._narrow = narrow
        self._wanted = wanted
        # Block -> number of its computed runs, and number of those in which the event happened.
        self._runs: Counter[int] = Counter()
        self._happened: dict[str, Counter[int]] = {name: Counter() for name in narrow}
        # The same numbers, summed over all blocks before `_next`.
        self._next = 0
        self._done = 0
        self._counts: Counter[str] = Counter()

    def enough(self, rows: Rows) -> bool:
        """Whether the runs so far, with these rows, are enough."""
        if not self._narrow:
            return False
        blocks = rows.run // BLOCK
        for block in np.unique(blocks).tolist():
            inside = blocks == block
            self._runs[block] += int(inside.sum())
            for name, counts in self._happened.items():
                counts[block] += int(happened(rows.columns, name)[inside].sum())
        # In the order of the blocks, so that the decision does not depend on who computes them.
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
