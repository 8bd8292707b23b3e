"""Many runs of a scene whose numbers are scattered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, overload

from numpy.typing import ArrayLike

from .scene.scene import Scene
from .scene.stabilization import Stabilization
from .study.job import MOST_BLOCKS, Until
from .study.request import Request, request
from .study.results import Ensemble
from .study.rows import Rows
from .study.sources import BLOCK, Key
from .support.interrupt import handlers_waiting
from .support.progress import Report

if TYPE_CHECKING:
    from .store.study import Study
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
        threads: None is as many as the process may use; of each worker, with `executor`: 1 if left
            out.
        executor: Computes on the workers of a `concurrent.futures.Executor` (processes, Dask's
            `client.get_executor()`, mpi4py's), or on those of the executor that a function makes,
            which is shut down at the end. Blocks of 1024 runs travel; numbers are drawn here. A
            block that fails three times is lost, and so is what an executor that breaks had not
            computed: see `lost` of the result.
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
    asked = request(
        scene,
        runs,
        seed,
        vary,
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
        sampler=sampler,
        only=only,
        trajectories=trajectories,
        check_dt=check_dt,
        stop_when=stop_when,
        threads=threads,
        executor=executor,
        progress=progress,
    )
    if store is None:
        return _in_memory(asked)
    with handlers_waiting():
        from .store.driver import keep
        from .store.study import Study

    return keep(asked, store, Study)


def _in_memory(asked: Request) -> Ensemble:
    """All rows in arrays."""
    job, plan = asked.job, asked.plan
    if plan.runs > _MOST_IN_MEMORY:
        raise ValueError(
            f"runs = {plan.runs}: must be at most {_MOST_IN_MEMORY} in memory; store= keeps more"
        )
    values = plan.draw_all()
    job.source = lambda numbers: {path: value[numbers] for path, value in values.items()}
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
    ensemble = Ensemble(
        job.setup, plan.describe(), rows, requested=job.wanted.count, outcome=outcome
    )
    job.finish(ensemble)
    return ensemble
