"""Monte Carlo studies: many runs of one scene, with parameters that vary from run to run."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from ._core import RECORDABLE
from .run.options import STOP_ON, Options
from .scene import Scene, Stabilization, usual
from .study.compute import MOST_BLOCKS, Computation, EarlyStopping
from .study.engine import Engine, how_many_threads
from .study.gradients import checked_gradients, differentiated
from .study.results import Ensemble
from .study.rows import Rows
from .study.sources import BLOCK, Key
from .study.spec import StudySpec
from .support.choices import Formulation, Method, Recordable, Sampler, Summary, Violation
from .support.progress import Report

if TYPE_CHECKING:
    from .store.study import Study


class _Settings(TypedDict, total=False):
    """The keyword-only arguments of `monte_carlo` except `store`, for type checkers."""

    tolerance: float | None
    stabilization: Stabilization
    stop_on: Violation | Sequence[Violation]
    max_steps: int | None
    summaries_after: float | None
    settling_band: float
    sampler: Sampler
    only: ArrayLike | None
    trajectories: Sequence[int]
    record: Recordable | Sequence[Recordable]
    every: int
    times: ArrayLike | None
    check_dt: bool
    gradients: str | Sequence[str]
    sensitivities: str | Sequence[str]
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
    method: Method = "rk4",
    formulation: Formulation = "csm",
    summaries: Summary | Sequence[Summary] = ("final_state",),
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
    method: Method = "rk4",
    formulation: Formulation = "csm",
    summaries: Summary | Sequence[Summary] = ("final_state",),
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
    method: Method = "rk4",
    formulation: Formulation = "csm",
    summaries: Summary | Sequence[Summary] = ("final_state",),
    *,
    tolerance: float | None = None,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    stop_on: Violation | Sequence[Violation] = STOP_ON,
    max_steps: int | None = None,
    summaries_after: float | None = None,
    settling_band: float = 1e-3,
    sampler: Sampler = "random",
    only: ArrayLike | None = None,
    trajectories: Sequence[int] = (),
    record: Recordable | Sequence[Recordable] = RECORDABLE,
    every: int = 1,
    times: ArrayLike | None = None,
    check_dt: bool = False,
    gradients: str | Sequence[str] = (),
    sensitivities: str | Sequence[str] = (),
    stop_when: Mapping[str, float] | None = None,
    threads: int | None = None,
    executor: Engine | None = None,
    store: str | Path | None = None,
    progress: bool | Report = True,
) -> Ensemble | Study:
    """Simulates a scene many times, with parameters that vary from run to run.

    Each run has exactly the bits that `simulate` gives for the run's scene, for any number of
    threads, any processor and any order of computing. A run that fails is a row with a status and
    does not affect other runs.

    Ctrl-C stops within a fraction of a second and returns all completed runs. The runs under way
    at that moment are missing: at most 8 for each thread, or the submitted blocks of an executor.
    Long ones are under way more often, which biases the sample if few runs were completed.

    Args:
        scene: The scene that all runs share.
        runs: Number of runs; None takes the length of the arrays in `vary`.
        seed: Seed of all draws and of held noise, from 0 to 2^64 - 1. With sampler="random" the
            draws of run i for a path depend on the seed, the path and i only. Sobol points stay
            equal when runs are added, but change with the set of paths; Latin hypercubes with both.
        vary: Path -> source of values. A path is the dotted path of a parameter in the scene, such
            as "grasped.mass", "hand.tip.left.radius", "control.kp", "disturbances.0.force" or
            "schedule.angles"; a tuple of paths is drawn jointly. A source is an array with one
            entry for each run; a distribution (`Normal`, `Uniform`, `LogUniform`, `LogNormal`,
            `TruncatedNormal`, `Choice`, or a frozen SciPy distribution); or a function from a
            `numpy.random.Generator` to the value of one run (a tuple of values for a tuple of
            paths). A path to a record that both fingers share varies both; with `right` or `left`
            in the path, only that finger.
        dt, method, formulation, tolerance, stabilization, stop_on: As for `simulate`.
        summaries: Quantities to compute for each run, at the ends of steps: "final_state",
            "peak_rotation", "min_compression", "peak_friction_angle", "peak_friction_ratio",
            "pulling_time", "settling_time", "max_residual", "energy_closure", "peak_torque",
            "slip_distance", "free_time", "margin". `Ensemble.summaries` explains them.
        max_steps: As for `simulate`; the reruns of `check_dt` may take ten times as many.
        summaries_after: Summaries ignore the time before this instant, s on the scene's clock, and
            so does "holds" in bilateral contact; None ignores nothing.
        settling_band: The object counts as settled while its faces move slower than this, m/s.
        sampler: "random"; or "sobol" or "latin_hypercube", which need SciPy and distributions in
            `vary`. With these two means converge faster, but intervals and standard errors remain
            those of independent draws.
        only: Numbers of the runs to compute, (k,), increasing; None computes all. It applies to
            this call only: `Study.resume` computes the other runs too.
        trajectories: Numbers of runs whose trajectories are kept, in `Ensemble.trajectories`. They
            are computed after the runs, one after the other, and with `store` written at once.
        record, every, times: Quantities and rows of the trajectories, as for `simulate`; all groups
            if left out. Instants outside the duration of a run are left out.
        check_dt: Whether to compute up to 256 of the runs again with half the step (or a tenth of
            the tolerance), for the errors in `Ensemble.discretisation`.
        gradients: Summaries whose derivatives are computed too, after the runs, in
            `Ensemble.gradients`: "final_state", "peak_rotation", "min_compression",
            "peak_friction_angle", "peak_friction_ratio", "peak_torque", "margin". Not with a
            `SampledController`. Ctrl-C then returns the ensemble without them.
        sensitivities: The paths by which `gradients` differentiates, as for `simulate`; those of
            `vary` if left out. They need not vary between runs.
        stop_when: Status, violation or "holds" -> half width. Stops at the end of the first block
            of 1024 runs at which the 95 % interval of each probability has at most this half width;
            `runs` is then the maximum. The intervals, also those of `probability`, hold at every
            look (`Estimate.at_every_look`) and are wider than Wilson's. The kept runs do not depend
            on threads or executor.
        threads: Number of threads; None takes as many as the process may use. With `executor`: the
            threads of each worker, 1 if left out.
        executor: Computes the runs on the workers of a `concurrent.futures.Executor` (processes,
            Dask's `client.get_executor()`, mpi4py's), or of the executor that a function makes,
            which is shut down at the end. Workers receive blocks of 1024 runs. A block that fails
            three times is lost, and so is what an executor has not computed when it breaks: see
            `lost` of the result.
        store: Folder in which the rows are kept, so that memory use does not grow with the runs. It
            is made if missing, and refused if it holds other files. If it holds this study, only
            missing runs are computed; `runs` may be larger than before, and runs beyond a smaller
            `runs` stay. Needs the extra `study`.
        progress: True draws a bar on a terminal (needs rich); False draws none; or a function that
            is called with the number of completed runs and the number of all runs.

    Returns:
        An `Ensemble`; with `store` a `Study`, which reads from the folder.

    Raises:
        ValueError: An argument, or a run's value, breaks its rule; a path does not exist; an array
            has the wrong length; or the folder holds another study, and the message lists each
            field that differs. All are found before anything is computed.
        TypeError: An argument is of the wrong kind.
        ImportError: A sampler or distribution needs SciPy, or a store needs pyarrow and tomli_w,
            and it is not installed.
        StoreError: The folder cannot be written, is locked by another process, is damaged, holds
            other files and no study, or has rows whose bits this machine or software does not
            give. Rows already in the folder are kept.
        VersionMismatchError: A worker of the executor has a softpinch version with other bits.

    Warns:
        StabilityWarning: As of `simulate`, of some run; whether `dt` was too long is looked at in
            up to eight runs: unstable ones, else failed ones, else any.
        SuspiciousValueWarning: A value that all runs share is far from the usual range.
        LostRunsWarning: Runs failed on workers of the executor and are missing.
    """
    how = (dt, method, formulation, stabilization, record, every, stop_on)
    spec = StudySpec.checked(
        scene,
        Options.checked(*how, tolerance, times, max_steps, summaries_after),
        runs=runs,
        seed=seed,
        vary=vary,
        summaries=summaries,
        settling_band=settling_band,
        sampler=sampler,
        stop_when=stop_when,
        check_dt=check_dt,
        trajectories=trajectories,
    )
    differentiable, by = checked_gradients(
        scene, gradients, sensitivities, list(spec.shapes), store=store, executor=executor
    )
    wanted = Computation(spec, only=only, threads=threads, executor=executor, progress=progress)
    result = compute(wanted, store)
    if by and isinstance(result, Ensemble) and not result.interrupted:
        try:
            many = how_many_threads(threads)
            result._gradients = differentiated(spec, result._rows, differentiable, by, many)
        except KeyboardInterrupt:
            result.interrupted = True
    return result


def compute(computation: Computation, store: str | Path | None) -> Ensemble | Study:
    """Computes a study, in memory if `store` is None; errors and warnings as of `monte_carlo`."""
    spec = computation.spec
    replaced = any(path.startswith("schedule.angles") for path in spec.shapes)
    usual.warn(spec.scene, schedule_replaced=replaced)
    if store is not None:
        from .store.study import compute_in_folder

        return compute_in_folder(computation, store)
    _require_memory(computation)
    drawn = spec.block(np.arange(spec.draws.runs, dtype=np.uint64))
    computation.draw = drawn.select
    computation.check(computation.wanted)
    stopping = EarlyStopping(spec.stop_when, computation.wanted)
    found: list[Rows] = []

    def accept(rows: Rows) -> bool:
        if len(rows):
            found.append(rows)
        return stopping.enough(rows)

    # `stop_when` is decided after each block, and an executor gets one block at a time.
    blocks = 1 if spec.stop_when or computation.executor is not None else MOST_BLOCKS
    computation.compute(computation.wanted, accept, lambda: blocks * BLOCK)
    rows = Rows.joined(found or [spec.empty()]).in_order()
    ensemble = Ensemble(spec, rows, requested=computation.wanted.count)
    computation.finish(ensemble)
    return ensemble


def _require_memory(computation: Computation) -> None:
    """Refuses a study whose rows this machine cannot hold, before anything is drawn."""
    runs = computation.spec.draws.runs
    columns = computation.spec.schema.empty().values()
    row = sum(column.itemsize * math.prod(column.shape[1:]) for column in columns)
    drawn = 8 * (1 + sum(map(math.prod, computation.spec.shapes.values())))
    # The rows exist twice while those of all blocks are joined.
    needed = runs * drawn + 2 * computation.wanted.count * row
    try:
        there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        there = 2**40  # unknown: Windows has no `sysconf`
    if needed > there:
        why = f"each takes about {needed // runs} bytes and this machine has {there / 1e9:.3g} GB"
        rule = f"must be at most {runs * there // needed} in memory, because {why}"
        raise ValueError(f"runs = {runs}: {rule}: pass store=, which keeps rows in a folder")
