"""Many runs of a scene whose numbers are scattered."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core, _record
from ._interrupt import CtrlC
from ._progress import Report, reporting
from ._record import Floats
from ._vary import Varied
from .ensemble import Discretisation, Ensemble, Estimate, Table, event
from .run import Options, Run
from .sampling import BLOCK, Key, Plan, count_runs
from .scene import Scene, Stabilization
from .simulate import MOST_STEPS, StabilityWarning, most_steps, names, simulate, steps

SUMMARIES = ("final_state", *_core.SUMMARIES)
# Runs that one call of the core takes: enough to keep threads busy, few enough to hear of them.
_MOST_BLOCKS = 32
# Runs that are computed again with half the step.
_CHECKED = 256


@dataclass(frozen=True, kw_only=True)
class Study:
    """What every run of an ensemble has in common, and what each has of its own.

    Attributes:
        scene: What all share.
        values: Path -> (runs, ...), what each has of its own.
        sampling: What the values were drawn from, as plain data.
        seed: Of the draws and of held noise.
        options: How each is simulated.
        summaries: What is computed along the way.
        after: From when on, s; minus infinity is from the start on.
        band: Of the settling time, m/s.
    """

    scene: Scene
    values: dict[str, Floats]
    sampling: dict[str, Any]
    seed: int
    options: Options
    summaries: tuple[str, ...]
    after: float
    band: float

    @property
    def refined(self) -> int:
        """How much smaller the steps or the tolerance are that `check_dt` compares with."""
        return 2 if self.options.tolerance is None else 10

    def varied(self) -> Varied:
        """Where the values go."""
        return Varied(self.scene, self.values, self.seed)

    def at(self, run: int) -> Scene:
        """The scene of one run."""
        return self.varied().at({path: value[run] for path, value in self.values.items()}, run)

    def replay(self, run: int, record: Sequence[str] = _core.RECORDABLE, every: int = 1) -> Run:
        """One run again, to the same bits."""
        how = self.options.numerics()
        return simulate(self.at(run), **how, record=record, every=every)

    def batch(self, varied: Varied, numbers: NDArray[np.uint64], refine: int = 1) -> _core.Batch:
        """Some of its runs as the core takes them, with steps or tolerance smaller by `refine`.

        The limit to their steps grows as much: a smaller tolerance takes more of them, fewer than
        in proportion.
        """
        o = self.options
        return varied.batch(
            {path: value[numbers] for path, value in self.values.items()},
            numbers,
            dt=None if o.dt is None else o.dt / refine,
            tolerance=None if o.tolerance is None else o.tolerance / refine,
            method=o.method,
            formulation=o.formulation,
            alpha=o.stabilization.alpha,
            beta=o.stabilization.beta,
            summaries=[name for name in self.summaries if name != "final_state"],
            after=self.after,
            band=self.band,
            stop_on=list(o.stop_on),
            max_steps=min(o.max_steps * refine, MOST_STEPS),
        )


def monte_carlo(
    scene: Scene,
    runs: int | None = None,
    seed: int = 0,
    vary: Mapping[Key, Any] | None = None,
    dt: float | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    summaries: str | Sequence[str] = ("final_state",),
    *,
    tolerance: float | None = None,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    stop_on: str | Sequence[str] = ("separated", "crushed", "folded"),
    max_steps: int | None = None,
    summaries_after: float | None = None,
    settling_band: float = 1e-3,
    sampler: str = "random",
    only: ArrayLike | None = None,
    trajectories: Sequence[int] = (),
    check_dt: bool = False,
    stop_when: Mapping[str, float] | None = None,
    threads: int | None = None,
    progress: bool | Report = True,
) -> Ensemble:
    """Simulates a scene many times, with numbers that differ from run to run.

    Each run gives the bits that `simulate` gives for its scene, whatever the threads, the
    processor, the order and the company. A run that fails is a row with a status, and touches no
    other.

    Ctrl-C stops within a fraction of a second and gives all runs done so far. Those under way then
    are missing, at most 8 a thread, and a long run is more often under way than a short one: so
    many runs bound the bias of what is left, which is small where many more are kept.

    Args:
        scene: What all runs share.
        runs: How many; None takes as many as the arrays in `vary` have.
        seed: From 0 to 2^64 - 1. With sampler="random" the draws of run i depend on it, the path
            and i alone, so a study of more runs, or of other paths too, has the same ones. Sobol
            points are the same for more runs, and others for another set of paths; those of a
            Latin hypercube depend on everything.
        vary: What differs: the dotted path of a number in the scene, such as "grasped.mass",
            "hand.tip.left.radius", "control.kp", "disturbances.0.force", "schedule.angles", or a
            tuple of paths that are drawn together -> an array with one entry a run; a distribution
            (`Normal`, `Uniform`, `LogUniform`, `LogNormal`, `TruncatedNormal`, `Choice`, or a
            frozen one of SciPy); or a function that takes a `numpy.random.Generator` and gives one
            run's value (for a tuple of paths a tuple). A record that stands for both fingers is
            varied for both; with `right` or `left` in the path it becomes two.
        dt: Longest step, s; 1e-4 where neither it nor `tolerance` is given.
        method: As for `simulate`.
        formulation: As for `simulate`.
        summaries: What to compute along the way, at the ends of steps, out of "final_state",
            "peak_rotation", "min_compression", "peak_friction_angle", "settling_time",
            "max_residual", "energy_closure", "peak_torque"; `Ensemble` says what they are.
        tolerance: Instead of `dt`, for methods with an error estimate.
        stabilization: The gains of (19) and (20), for "csm".
        stop_on: As for `simulate`.
        max_steps: With `tolerance`: most attempted steps of a run, as for `simulate`; the reruns of
            `check_dt` have ten times as many.
        summaries_after: What comes before this instant is left out of the summaries, s on the clock
            of the scene; None leaves nothing out.
        settling_band: The speed of the object's faces below which it has settled, m/s.
        sampler: "random", or "sobol" or "latin_hypercube" (which need SciPy, and distributions):
            points that fill the space more evenly, so that means converge faster. Intervals and
            standard errors remain those of independent draws.
        only: Numbers of the runs to compute, (k,), increasing; None is all.
        trajectories: Runs whose paths are kept, as `Ensemble.trajectories`.
        check_dt: Computes up to 256 of the runs again with half the step (or a tenth of the
            tolerance) and says in `Ensemble.discretisation` how far each summary is off.
        stop_when: Status or violation -> half width. Stops as soon as the 95 % interval of each
            probability is so narrow, at the end of a block of 1024 runs; `runs` is then the most.
        threads: None is as many as the process may use.
        progress: Draws a bar on a terminal (needs rich); or a function of (done, runs).

    Returns:
        The ensemble.

    Raises:
        ValueError: An argument breaks its rule; a path leads nowhere; an array has the wrong
            length; or a run's value breaks the rule of its field (the message says which run,
            field and value). All are found before anything is computed.
        TypeError: An argument is of the wrong kind.
        ImportError: A sampler or distribution needs SciPy, and it is not installed.

    Warns:
        StabilityWarning: `dt` is beyond what the method damps, in some run.
    """
    _record.instance("scene", scene, Scene)
    seed = _record.integer("seed", seed, 0, 2**64 - 1)
    vary = {} if vary is None else vary
    if not isinstance(vary, Mapping):
        raise TypeError(f"vary = {vary!r}: must map paths to arrays, distributions or functions")
    runs = count_runs(vary, runs)
    options = _options(dt, tolerance, method, formulation, stabilization, stop_on, max_steps)
    threads = how_many_threads(threads)
    paths = [path for key in vary for path in ((key,) if isinstance(key, str) else key)]
    plan = Plan(vary, runs, seed, sampler, shapes=Varied(scene, paths, seed).shapes)
    study = Study(
        scene=scene,
        values=plan.draw_all(),
        sampling=plan.describe(),
        seed=seed,
        options=options,
        summaries=names("summaries", summaries, SUMMARIES),
        after=-np.inf
        if summaries_after is None
        else _record.finite("summaries_after", summaries_after),
        band=_record.positive("settling_band", settling_band),
    )
    numbers = _numbers(only, runs)
    kept = _kept(trajectories, runs, numbers)
    wanted = _stop_when(stop_when, sampler, scene, plan.paths)
    if not isinstance(check_dt, bool):
        raise TypeError(f"check_dt = {check_dt!r}: must be True or False")

    varied = study.varied()
    checked = _check(study, varied, _pieces(numbers, _blocks(wanted)), check_dt)
    with reporting(progress, "simulating") as report:
        table = _compute(checked, len(numbers), threads, report, wanted)
    discretisation = None
    if check_dt and len(table.run) and not table.interrupted:
        discretisation, cut = _discretisation(study, varied, table, threads)
        table = replace(table, interrupted=cut)
    replays: dict[int, Run] = {}
    for run in kept:
        if run in table.run:
            replayed = study.replay(run)
            if replayed.status == "interrupted":
                table = replace(table, interrupted=True)
                break
            replays[run] = replayed
    return Ensemble(
        study,
        table,
        requested=len(numbers),
        trajectories=replays,
        discretisation=discretisation,
    )


def _options(
    dt: float | None,
    tolerance: float | None,
    method: str,
    formulation: str,
    stabilization: Stabilization,
    stop_on: str | Sequence[str],
    max_steps: int | None,
) -> Options:
    _record.instance("stabilization", stabilization, Stabilization)
    method = _record.choice("method", method, _core.METHODS)
    dt, tolerance = steps(dt, tolerance, method)
    return Options(
        dt=dt,
        tolerance=tolerance,
        method=method,
        formulation=_record.choice("formulation", formulation, _core.FORMULATIONS),
        stabilization=stabilization,
        record=(),
        every=1,
        stop_on=names("stop_on", stop_on, _core.STOPPABLE),
        max_steps=most_steps(tolerance, max_steps),
    )


def how_many_threads(threads: int | None) -> int:
    """How many threads; a worker of a cluster has fewer cores than its machine."""
    if threads is not None:
        return _record.integer("threads", threads, 1, 4096)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _numbers(only: ArrayLike | None, runs: int) -> NDArray[np.uint64]:
    if only is None:
        return np.arange(runs, dtype=np.uint64)
    given = np.asarray(only)
    if given.ndim != 1 or given.dtype.kind not in "iu" or len(given) == 0:
        raise TypeError(f"only = {only!r}: must be the numbers of runs, (k,)")
    # Differences of unsigned numbers would wrap.
    if (given[1:] <= given[:-1]).any() or given[0] < 0 or given[-1] >= runs:
        raise ValueError(f"only: must be increasing and from 0 to runs - 1 = {runs - 1}")
    return given.astype(np.uint64)


def _kept(trajectories: Sequence[int], runs: int, numbers: NDArray[np.uint64]) -> list[int]:
    """The runs whose paths are kept."""
    if not isinstance(trajectories, Iterable) or isinstance(trajectories, str):
        raise TypeError(
            f"trajectories = {trajectories!r}: must be the numbers of runs, such as (3, 17)"
        )
    kept = [_record.integer("trajectories", run, 0, runs - 1) for run in trajectories]
    for run in kept:
        if run not in numbers:
            raise ValueError(f"trajectories: run {run} is not among those of only")
    return kept


def _stop_when(
    stop_when: Mapping[str, float] | None, sampler: str, scene: Scene, varied: Sequence[str]
) -> dict[str, float]:
    if stop_when is None:
        return {}
    if not isinstance(stop_when, Mapping):
        raise TypeError(f"stop_when = {stop_when!r}: must map statuses to half widths")
    if sampler == "latin_hypercube":
        raise ValueError(
            "stop_when: a Latin hypercube is even as a whole only; part of it is no sample. Take "
            'sampler="random" or "sobol"'
        )
    return {
        event("stop_when", name, scene, varied): _record.positive(f"stop_when[{name!r}]", width)
        for name, width in stop_when.items()
    }


def _pieces(numbers: NDArray[np.uint64], blocks: int) -> list[NDArray[np.uint64]]:
    """The runs cut at multiples of so many blocks."""
    where = np.flatnonzero(np.diff(numbers // (blocks * BLOCK))) + 1
    return np.split(numbers, where)


def _blocks(wanted: Mapping[str, float]) -> int:
    """How many blocks are computed before anyone asks whether they are enough."""
    return 1 if wanted else _MOST_BLOCKS


Pieces: TypeAlias = Iterable[tuple[NDArray[np.uint64], _core.Batch]]


def _check(
    study: Study, varied: Varied, pieces: Sequence[NDArray[np.uint64]], check_dt: bool
) -> Pieces:
    """Refuses what breaks a rule, in any run, also with the smaller steps of `check_dt`.

    Gives the batches, made anew but for the first.
    """
    for piece in pieces:
        varied.check({path: value[piece] for path, value in study.values.items()}, piece)
    first = study.batch(varied, pieces[0])
    advice = [first.warning, *(study.batch(varied, piece).warning for piece in pieces[1:])]
    for piece in pieces if check_dt else ():
        try:
            study.batch(varied, piece, study.refined)
        except ValueError as error:
            raise ValueError(f"check_dt: {error}") from None
    for text in dict.fromkeys(filter(None, advice)):
        warnings.warn(text, StabilityWarning, stacklevel=3)
    others = ((piece, study.batch(varied, piece)) for piece in pieces[1:])
    return chain([(pieces[0], first)], others)


def _compute(
    pieces: Pieces, total: int, threads: int, report: Report, wanted: Mapping[str, float]
) -> Table:
    """Computes runs, piece by piece."""
    tables: list[Table] = []
    done = 0
    # Counted as they come: to go through all rows after every block would take their square.
    counts: Counter[str] = Counter()
    with CtrlC() as ctrl_c:
        try:
            report(0, total)
            for piece, batch in pieces:
                # From the first run to their rows in the table nothing may be lost.
                ctrl_c.held = True
                watch = partial(_watch, ctrl_c, report, done, total)
                # Threads cost something, so there are no more than runs.
                result = batch.run(min(threads, len(piece)), watch)
                tables.append(Table.of(result, piece))
                ctrl_c.held = False
                done += len(tables[-1].run)
                report(done, total)
                if ctrl_c.pending or tables[-1].interrupted:
                    return Table.joined(tables, interrupted=True)
                counts.update({name: int(tables[-1].happened(name).sum()) for name in wanted})
                if wanted and _narrow(counts, done, wanted):
                    break
        except KeyboardInterrupt:
            return Table.joined(tables, interrupted=True)
    return Table.joined(tables)


def _watch(ctrl_c: CtrlC, report: Report, before: int, total: int, done: int) -> bool:
    """Says how far the runs are; whether to stop."""
    report(before + done, total)
    return ctrl_c.pending


def _narrow(counts: Mapping[str, int], runs: int, wanted: Mapping[str, float]) -> bool:
    """Whether every probability's interval is as narrow as it should be."""
    return all(
        Estimate.counted(counts[name], runs).half_width <= width for name, width in wanted.items()
    )


def _discretisation(
    study: Study, varied: Varied, table: Table, threads: int
) -> tuple[dict[str, Discretisation], bool]:
    """How far the steps put the summaries off, from some runs with smaller ones; and Ctrl-C."""
    count = min(_CHECKED, len(table.run))
    rows = np.unique(np.linspace(0, len(table.run) - 1, count).astype(int))
    numbers = table.run[rows]
    piece = (numbers, study.batch(varied, numbers, study.refined))
    finer = _compute([piece], len(numbers), threads, lambda *_: None, {})
    coarse = table.at(rows[np.isin(numbers, finer.run)])
    pairs: dict[str, Callable[[Table], Floats]] = {
        name: lambda part, name=name: part.summary(name)  # type: ignore[misc]
        for name in study.summaries
    }
    pairs["completed"] = lambda part: part.happened("completed").astype(float)
    found = {
        name: Discretisation.of(of(coarse), of(finer), of(table)) for name, of in pairs.items()
    }
    return found, finer.interrupted
