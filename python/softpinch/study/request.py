"""What `monte_carlo` is asked for, checked: the work, and where its numbers come from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..scene import usual
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.interrupt import handlers_waiting
from ..support.progress import Report
from .engine import how_many_threads
from .job import Job
from .rows import event
from .sampling import Plan, count_runs
from .setup import make_setup
from .sources import Key
from .spans import Numbers, Spans

if TYPE_CHECKING:
    from .executor import Engine


class Request(NamedTuple):
    """What is asked for.

    Attributes:
        job: The work.
        plan: Where the numbers come from.
        vary: As it was given.
    """

    job: Job
    plan: Plan
    vary: Mapping[Key, Any]


def request(
    scene: Scene,
    runs: int | None,
    seed: int,
    vary: Mapping[Key, Any] | None,
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
    sampler: str,
    only: ArrayLike | None,
    trajectories: Sequence[int],
    check_dt: bool,
    stop_when: Mapping[str, float] | None,
    threads: int | None,
    executor: Engine | None,
    progress: bool | Report,
) -> Request:
    """The arguments of `monte_carlo` but `store`, checked; errors and warnings are its own."""
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
    usual.warn(scene, stacklevel=3)
    plan = Plan(vary, runs, setup.seed, sampler, shapes=setup.shapes)
    wanted = Spans.upto(runs) if only is None else Spans.of(_numbers(only, runs))
    kept = _kept(trajectories, runs, wanted)
    narrow = _stop_when(stop_when, sampler, scene, setup.shapes)
    check_dt = checks.boolean("check_dt", check_dt)
    if threads is not None:
        how_many_threads(threads)
    if executor is not None:
        with handlers_waiting():
            from . import executor as executors

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
    return Request(job, plan, vary)


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
