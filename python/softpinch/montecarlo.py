"""Many runs of a scene whose numbers are scattered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from . import _core
from .run.options import Options, most_steps, names, steps
from .scene import usual
from .scene.scene import Scene
from .scene.stabilization import Stabilization
from .scene.template import SceneTemplate
from .study.engine import how_many_threads
from .study.job import MOST_BLOCKS, Job, Until
from .study.results import Ensemble
from .study.rows import Rows, event
from .study.sampling import Plan, count_runs
from .study.setup import SUMMARIES, Setup
from .study.sources import BLOCK, Key
from .study.spans import Numbers, Spans
from .support import checks
from .support.interrupt import handlers_waiting
from .support.progress import Report

if TYPE_CHECKING:
    from .store import Study
    from .study.executor import Engine


# Their numbers alone would take 8 TB.
_MOST_IN_MEMORY = 2**40


class _Settings(TypedDict, total=False):
    """The keyword arguments of `monte_carlo` but `store`, for type checkers."""

    tolerance: float | None
    stabilization: Stabilization
    stop_on: str | Sequence[str]
    max_steps: int | None
    summaries_after: float | None
    settling_band: float
    sampler: str
    only: ArrayLike | None
    trajectories: Sequence[int]
    check_dt: bool
    stop_when: Mapping[str, float] | None
    threads: int | None
    executor: Engine | None
    progress: bool | Report


@overload
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
    store: None = None,
    **settings: Unpack[_Settings],
) -> Ensemble: ...


@overload
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
    store: str | Path,
    **settings: Unpack[_Settings],
) -> Study: ...


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
    executor: Engine | None = None,
    store: str | Path | None = None,
    progress: bool | Report = True,
) -> Ensemble | Study:
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
            "max_residual", "energy_closure", "peak_torque"; `Ensemble.summaries` says what they
            are.
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
        only: Numbers of the runs to compute, (k,), increasing; None is all. It is of this call:
            `Study.resume` computes the others, too.
        trajectories: Runs whose paths are kept, as `Ensemble.trajectories`.
        check_dt: Computes up to 256 of the runs again with half the step (or a tenth of the
            tolerance) and says in `Ensemble.discretisation` how far each summary is off.
        stop_when: Status or violation -> half width. Stops as soon as the 95 % interval of each
            probability is so narrow, at the end of a block of 1024 runs; `runs` is then the most.
            The same runs are kept, whoever computes them.
        threads: None is as many as the process may use; of each worker, with `executor`, its share
            of this machine's cores, and 1 where workers may be elsewhere (Dask's, MPI's).
        executor: Computes on the workers of a `concurrent.futures.Executor` (processes, Dask's
            `client.get_executor()`, mpi4py's), or of what a function makes, which is asked for
            another one where an executor breaks. Blocks of 1024 runs travel; numbers are drawn
            here. A block that fails three times is lost: see `lost` of the result.
        store: A folder that keeps the rows; made where it is not there, refused where it holds
            other files. Where it holds this study, that is gone on with: only missing runs are
            computed, and `runs` may be more than before; where there are more, they stay. Needs the
            extra `study`; the memory that it takes does not grow with the runs.
        progress: Draws a bar on a terminal (needs rich); or a function of (done, runs).

    Returns:
        An `Ensemble`; with `store` a `Study`, which reads from the folder.

    Raises:
        ValueError: An argument breaks its rule; a path leads nowhere; an array has the wrong
            length; or a run's value breaks the rule of its field (the message says which run,
            field and value). All are found before anything is computed. Or the folder holds
            another study: the message says field by field how it differs.
        TypeError: An argument is of the wrong kind.
        ImportError: A sampler or distribution needs SciPy, or a store pyarrow, and it is not
            installed.
        StoreError: The folder cannot be written, is being written by another process, is damaged,
            or holds other files and no study. What was written before is kept.
        VersionMismatchError: A worker of the executor has a softpinch whose bits are others.

    Warns:
        StabilityWarning: `dt` is beyond what the method damps, in some run.
        SuspiciousValueWarning: A number that all runs share is far from what is usual.
        LostRunsWarning: Workers of the executor failed to bring some runs back.
    """
    checks.instance("scene", scene, Scene)
    vary = {} if vary is None else vary
    if not isinstance(vary, Mapping):
        raise TypeError(
            f"vary = {checks.shown(vary)}: must map paths to arrays, distributions or functions"
        )
    runs = count_runs(vary, runs)
    setup = make_setup(
        scene,
        [path for key in vary for path in ((key,) if isinstance(key, str) else key)],
        seed,
        dt=dt,
        tolerance=tolerance,
        method=method,
        formulation=formulation,
        stabilization=stabilization,
        stop_on=stop_on,
        max_steps=max_steps,
        summaries=summaries,
        summaries_after=summaries_after,
        settling_band=settling_band,
    )
    usual.warn(scene)
    plan = Plan(vary, runs, setup.seed, sampler, shapes=setup.shapes)
    wanted = Spans.upto(runs) if only is None else Spans.of(_numbers(only, runs))
    kept = _kept(trajectories, runs, wanted)
    narrow = _stop_when(stop_when, sampler, scene, setup.shapes)
    check_dt = checks.boolean("check_dt", check_dt)
    if threads is not None:
        how_many_threads(threads)
    if executor is not None:
        with handlers_waiting():
            from .study import executor as executors

        executors.check(executor)
    job = Job(
        setup=setup,
        source=plan.rows,
        wanted=wanted,
        kept=kept,
        check_dt=check_dt,
        narrow=narrow,
        threads=threads,
        executor=executor,
        progress=progress,
    )
    if store is None:
        if runs > _MOST_IN_MEMORY:
            raise ValueError(
                f"runs = {runs}: must be at most {_MOST_IN_MEMORY} in memory; store= keeps more"
            )
        values = plan.draw_all()
        job.source = lambda numbers: {path: value[numbers] for path, value in values.items()}
        return _in_memory(job, plan.describe())
    with handlers_waiting():
        from .store.driver import keep

    return keep(job, plan, vary, store)


def make_setup(
    scene: Scene,
    paths: Sequence[str],
    seed: int,
    *,
    dt: float | None,
    tolerance: float | None,
    method: str,
    formulation: str,
    stabilization: Stabilization,
    stop_on: str | Sequence[str],
    max_steps: int | None,
    summaries: str | Sequence[str],
    summaries_after: float | None,
    settling_band: float,
) -> Setup:
    """The arguments of `monte_carlo` that its runs have in common, checked."""
    seed = checks.integer("seed", seed, 0, 2**64 - 1)
    checks.instance("stabilization", stabilization, Stabilization)
    method = checks.choice("method", method, _core.METHODS)
    dt, tolerance = steps(dt, tolerance, method)
    after = summaries_after
    return Setup(
        scene=scene,
        shapes=SceneTemplate(scene, paths, seed).shapes,
        seed=seed,
        options=Options(
            dt=dt,
            tolerance=tolerance,
            method=method,
            formulation=checks.choice("formulation", formulation, _core.FORMULATIONS),
            stabilization=stabilization,
            record=(),
            every=1,
            stop_on=names("stop_on", stop_on, _core.STOPPABLE),
            max_steps=most_steps(tolerance, max_steps),
        ),
        summaries=names("summaries", summaries, SUMMARIES),
        after=-np.inf if after is None else checks.finite("summaries_after", after),
        band=checks.positive("settling_band", settling_band),
    )


def _numbers(only: ArrayLike, runs: int) -> Numbers:
    given = checks.read("only", only)
    if given.ndim != 1 or given.dtype.kind not in "iu" or len(given) == 0:
        raise TypeError(f"only = {checks.shown(only)}: must be the numbers of runs, (k,)")
    # Differences of unsigned numbers would wrap.
    if (given[1:] <= given[:-1]).any() or given[0] < 0 or given[-1] >= runs:
        raise ValueError(f"only: must be increasing and from 0 to runs - 1 = {runs - 1}")
    return given.astype(np.uint64)


def _kept(trajectories: Sequence[int], runs: int, wanted: Spans) -> list[int]:
    """The runs whose paths are kept."""
    given = checks.several(
        "trajectories", trajectories, "the numbers of runs, such as (3, 17)", runs
    )
    kept = [checks.integer("trajectories", run, 0, runs - 1) for run in given]
    for run in kept:
        if not wanted.within(run, run + 1).count:
            raise ValueError(f"trajectories: run {run} is not among those of only")
    return kept


def _stop_when(
    stop_when: Mapping[str, float] | None, sampler: str, scene: Scene, varied: Iterable[str]
) -> dict[str, float]:
    if stop_when is None:
        return {}
    if not isinstance(stop_when, Mapping):
        raise TypeError(f"stop_when = {checks.shown(stop_when)}: must map statuses to half widths")
    if sampler == "latin_hypercube":
        raise ValueError(
            "stop_when: a Latin hypercube is even as a whole only; part of it is no sample. Take "
            'sampler="random" or "sobol"'
        )
    return {
        event("stop_when", name, scene, varied): checks.positive(
            f"stop_when[{checks.shown(name)}]", width
        )
        for name, width in stop_when.items()
    }


def _in_memory(job: Job, sampling: Mapping[str, Any]) -> Ensemble:
    """All rows in arrays."""
    job.check(job.wanted)
    until = Until(job.narrow, job.wanted)
    found: list[Rows] = []

    def accept(rows: Rows) -> bool:
        if len(rows):
            found.append(rows)
        return until.enough(rows)

    # One block where it is asked after each whether they are enough; workers take one, too.
    blocks = 1 if job.narrow or job.executor is not None else MOST_BLOCKS
    outcome = job.compute(job.wanted, accept, lambda: blocks * BLOCK)
    rows = Rows.joined(found or [job.setup.empty()]).in_order()
    ensemble = Ensemble(job.setup, sampling, rows, requested=job.wanted.count, outcome=outcome)
    job.finish(ensemble)
    return ensemble
