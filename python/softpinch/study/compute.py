"""Computing a study's runs, on threads or an executor, for results in memory or in a folder."""

import contextlib
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..analysis.rest import equilibrium
from ..run.request import Request
from ..run.stiffness import GROWN, is_explicit, needs_a_look, too_long
from ..scene import Scene
from ..support import checks
from ..support.arrays import Floats
from ..support.errors import LostRunsWarning, StabilityWarning, warn
from ..support.progress import Report, reporting
from . import engine
from .engine import Accept, Lost, how_many_threads
from .estimates import Discretisation, Estimate
from .results import Results
from .rows import HOLDS, Numbers, Rows, Spans, happened
from .sources import BLOCK
from .spec import RECORDING, StudySpec

# Largest number of blocks per call of the core: all threads are busy, and reports frequent.
MOST_BLOCKS = 32
# Number of runs whose steps, or whose rest, are looked at; rates, m/s and rad/s, that are at rest.
_SUSPECTS, _STILL = 8, 1e-9
# Number of runs that `check_dt` computes again with smaller steps.
_CHECKED = 256


class Computation:
    """A study to compute, the means to compute it, and how that ended."""

    def __init__(
        self,
        spec: StudySpec,
        *,
        only: ArrayLike | None = None,
        threads: int | None = None,
        executor: engine.Engine | None = None,
        progress: bool | Report = True,
    ) -> None:
        runs = spec.draws.runs
        self.spec = spec
        self.wanted = Spans.upto(runs) if only is None else Spans.of(_numbers(only, runs))
        for run in spec.trajectories:
            if not self.wanted.has(run):
                raise ValueError(f"trajectories: run {run} is not in only")
        if threads is not None:
            how_many_threads(threads)
        if executor is not None:
            engine.check_executor(executor)
        # From the numbers of runs to rows with their varied values.
        self.draw: Callable[[Numbers], Rows] = spec.block
        self.executor = executor
        self.interrupted = False
        self.lost: tuple[Lost, ...] = ()
        self._threads = threads
        self._progress = progress
        self._warned = False
        # The run whose step is the longest by the one that is surely stable, and this ratio.
        self._least_stable = (0.0, -1)
        # The last chunk that was checked. A study of one chunk need not be checked again.
        self._checked: engine.Checked | None = None

    def check(self, missing: Spans) -> None:
        """Refuses a study if any run breaks a rule, also with the smaller steps of `check_dt`."""
        advice: set[str] = set()
        done, total = 0, missing.count
        # A user's function counts computed runs only.
        bar = self._progress is True and total > MOST_BLOCKS * BLOCK
        finer = self.spec.finer() if self.spec.check_dt else None
        with reporting(bar, "checking") as report:
            for numbers in missing.aligned_chunks(lambda: MOST_BLOCKS * BLOCK):
                report(done, total)
                block = self.draw(numbers)
                self.spec.varied.check(self.spec.values(block), numbers)
                batch = self.spec.batch(block)
                self._checked = block, batch
                advice |= {batch.warning} if batch.warning else set()
                ratio, place = batch.least_stable
                self._least_stable = max(self._least_stable, (ratio, int(block.run[place])))
                if finer is not None:
                    with checks.reworded("check_dt: "):
                        finer.batch(block)
                done += len(numbers)
        for text in sorted(advice):
            warn(text, StabilityWarning)
            self._warned = True

    def compute(self, missing: Spans, accept: Accept, size: Callable[[], int]) -> None:
        """Computes runs; `accept` keeps their rows and returns whether they are enough."""
        blocks = map(self._drawn, missing.aligned_chunks(size))
        with reporting(self._progress, "simulating") as report:
            self.interrupted, self.lost = self._engine(self.spec, blocks, missing, report, accept)
        for one in self.lost:
            warn(f"lost {one}", LostRunsWarning)

    def _drawn(self, numbers: Numbers) -> Rows:
        if self._checked and np.array_equal(self._checked[0].run, numbers):
            return self._checked[0]
        return self.draw(numbers)

    def _engine(
        self, spec: StudySpec, blocks: Iterable[Rows], asked: Spans, report: Report, accept: Accept
    ) -> tuple[bool, tuple[Lost, ...]]:
        if self.executor is None:
            threads = how_many_threads(self._threads)
            how = (threads, report, accept, self._checked)
            return engine.on_threads(spec, blocks, asked.count, *how), ()
        threads = 1 if self._threads is None else self._threads
        return engine.on_executor(spec, blocks, asked, self.executor, threads, report, accept)

    def finish(self, results: Results) -> None:
        """Tells the results how the computation ended; repeats runs, and adds trajectories."""
        results.interrupted, results.lost = self.interrupted, self.lost
        most, unit = (engine.MOST_LANES, "thread") if self.executor is None else (BLOCK, "worker")
        results._under_way = f"at most {most} a {unit}"
        if results.runs and not results.interrupted and not self._warned:
            self._warn_of_steps(results)
            self._warn_of_loop(results)
        if self.spec.check_dt and results.runs and not results.interrupted:
            self._check_dt(results)
        for run in self.spec.trajectories:
            if results.has(run) and run not in results.trajectories:
                how = {name: getattr(self.spec.options, name) for name in RECORDING}
                replayed = results.replay(run, **how)
                if replayed.status == "interrupted":
                    results.interrupted = True
                    break
                results._add_trajectory(run, replayed)

    def _warn_of_steps(self, results: Results) -> None:
        """Looks at some unstable or else failed runs, and at the one whose steps may be too long.

        That is the one with the longest step by the bound of the core; a look takes milliseconds.
        """
        options = self.spec.options
        if options.dt is None or not is_explicit(options.method):
            return
        unstable_parts, failed_parts = [], []
        for part in results._read_by_part(("run", "status")):
            unstable_parts.append(Spans.of(part["run"][part["status"] == "unstable"]).edges)
            failed_parts.append(Spans.of(part["run"][part["status"] != "completed"]).edges)
        unstable, failed = Spans.joined(unstable_parts), Spans.joined(failed_parts)
        suspects = (unstable if unstable.count else failed).evenly_spaced(_SUSPECTS).tolist()
        if not unstable.count and self._needs_a_look(results):
            suspects.append(self._least_stable[1])
        text, run, status = None, -1, ""
        for run in suspects:
            row = results._rows_of(np.array([run], np.uint64)).columns
            status, end = str(row["status"][0]), float(row["end_time"][0])
            try:
                text = too_long(Request(results.scene_of(run), options), status, end)
            except KeyboardInterrupt:
                results.interrupted = True
                return
            if text is not None:
                break
        what = f"run {run}"
        if unstable.count:
            text = text or "take a smaller dt; its message says which dt is surely stable"
            what = f"{unstable.count} of {results.runs} runs are unstable, such as run {run}"
        elif status != "completed":
            what = f"run {run}, one of {failed.count} that did not complete"
        if text is not None:
            warn(f"{what}: {text}", StabilityWarning)

    def _needs_a_look(self, results: Results) -> bool:
        """True if the steps of the completed run with the longest ones may have been too long."""
        ratio, run = self._least_stable
        if not results.has(run):
            return False
        row = results._rows_of(np.array([run], np.uint64)).columns
        seen = {name for name in ("rim", "slipping") if np.isfinite(row[f"first_{name}"][0])}
        completed = row["status"][0] == "completed"
        return bool(completed and needs_a_look(ratio, self.spec.scene, seen))

    def _warn_of_loop(self, results: Results) -> None:
        """Says that the loop of the scene's sampled controller is unstable, if runs do not rest."""
        scene, moves = self.spec.scene, False
        if scene.law == "sampled":
            some = results._rows_of(results._computed.evenly_spaced(_SUSPECTS)).columns
            rates = some["final_state"][:, 9:] if "final_state" in some else np.inf
            moves = bool(np.any(np.abs(rates) > _STILL) or np.any(some["status"] != "completed"))
        growth = _growth(scene) if moves else 0.0
        if growth * scene.duration > math.log(GROWN):
            text = "the loop of the scene's SampledController is unstable (sp.loop): a deviation"
            advice = "lower the gains, or shorten the periods and delays"
            warn(f"{text} grows with {growth:.4g} 1/s; {advice}", StabilityWarning)

    def _check_dt(self, results: Results) -> None:
        """Estimates the error of summaries and probabilities, from runs with smaller steps."""
        coarse = results._rows_of(results._computed.evenly_spaced(_CHECKED))
        found = [self.spec.empty()]

        def accept(rows: Rows) -> bool:
            found.append(rows)
            return False

        block = Rows(columns={"run": coarse.run, **self.spec.values(coarse)})
        asked = Spans.of(coarse.run)
        interrupted, lost = self._engine(self.spec.finer(), [block], asked, lambda *_: None, accept)
        finer = Rows.joined(found)
        for one in lost:
            warn(f"check_dt: lost {one}", LostRunsWarning)
        coarse = coarse.select(np.isin(coarse.run, finer.run))
        events = ("completed", HOLDS)

        def compared(name: str, columns: Mapping[str, NDArray[Any]]) -> Floats:
            return happened(columns, name).astype(float) if name in events else columns[name]

        def sampling_error(name: str) -> Any:
            if name in events:
                return results.mean(results.happened(name)).error
            entry = self.spec.schema.entries[name]
            errors = [results.mean(column).error for column in entry.columns]
            return np.reshape(errors, entry.shape)

        results.discretisation = {
            name: Discretisation.of(
                compared(name, coarse.columns), compared(name, finer.columns), sampling_error(name)
            )
            for name in (*self.spec.summaries, *events)
        }
        results.interrupted = interrupted


@lru_cache(maxsize=64)
def _growth(scene: Scene) -> float:
    """The `growth` about the scene's rest, 1/s, or 0.0 if it has no unique one."""
    with contextlib.suppress(ValueError):
        return equilibrium(scene).growth
    return 0.0


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
        self._narrow = narrow
        self._wanted = wanted
        # Block -> number of its computed runs, and of those in which each event happened.
        self._tallies: defaultdict[int, Counter[str]] = defaultdict(Counter)
        # The same numbers, summed over all blocks before `_next`.
        self._total: Counter[str] = Counter()
        self._next = 0

    def enough(self, rows: Rows) -> bool:
        """Whether the runs so far, with these rows, are enough."""
        if not self._narrow or not len(rows):
            return False
        blocks = rows.run // BLOCK
        for block in np.unique(blocks).tolist():
            inside = blocks == block
            tally = self._tallies[block]
            tally["runs"] += int(inside.sum())
            for name in self._narrow:
                tally[name] += int(happened(rows.columns, name)[inside].sum())
        # In the order of the blocks, so that the decision does not depend on who computes them.
        last = max(self._tallies)
        while self._next <= last:
            first = self._next * BLOCK
            tally = self._tallies[self._next]
            if tally["runs"] < self._wanted.within(first, first + BLOCK).count:
                return False
            self._total += tally
            self._next += 1
            runs = self._total["runs"]
            if runs and all(
                Estimate.at_every_look(self._total[name], runs).half_width <= width
                for name, width in self._narrow.items()
            ):
                return True
        return False
