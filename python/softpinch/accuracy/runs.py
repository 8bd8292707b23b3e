"""Runs of the core for the tools of accuracy, their CPU times, and bisection over their settings.

All of these raise KeyboardInterrupt on Ctrl-C: an interrupted run is none that failed.
"""

import math
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from .. import _core
from ..run import Request, Run, computed
from ..run.options import Options, names
from ..scene import Scene, SceneTemplate, shapes_of, usual
from ..scene.contact import formulations_of, require_formulations, without_drift
from ..support import Floats, Formulation, Method, Record
from ..support.interrupt import CtrlC
from ..support.suggest import places

# Tolerance of an accurate run, unless another one is asked for.
ACCURATE = 1e-8
# Time from which a call is slow, s, and the number of timed calls that is enough then.
_SLOW, _SLOW_REPEATS = 0.3, 3


def pairs_of(
    scene: Scene,
    formulations: Formulation | Sequence[Formulation] | None,
    methods: Method | Sequence[Method],
) -> list[tuple[Formulation, Method]]:
    """Checks formulations and methods, and pairs them; None stands for all that a scene allows."""
    kept = formulations_of(scene) if formulations is None else formulations
    kept = names("formulations", kept, _core.FORMULATIONS)
    used = names("methods", methods, _core.METHODS)
    for field, found in {"formulations": kept, "methods": used}.items():
        if not found:
            raise ValueError(f"{field} = (): must have at least one")
    require_formulations("formulations", kept, scene)
    return list(product(kept, used))


def timed_run(request: Request) -> tuple[Run, float]:
    """Computes a run, and measures its CPU time, s."""
    begin = time.thread_time()
    result = request.run_to_end()
    spent = time.thread_time() - begin
    return Run(request.scene, request.options, result), spent


def accurate_run(scene: Scene, formulation: Formulation = "nullspace", **options: Any) -> Run:
    """Runs a scene by a stiff method with adaptive steps, which stands for the exact motion.

    It uses a formulation without drift; or "csm" if `formulation` is that and the scene starts off
    the constraints, from where only "csm" can start.
    """
    usual.warn(scene)
    how: dict[str, Any] = {"method": "radau5", "tolerance": ACCURATE, "record": "state", **options}
    can_start = scene.start().check or formulation != "csm"
    how["formulation"] = without_drift(scene) if can_start else "csm"
    return computed(Request(scene, Options.checked(**how)))


def cpu_times(request: Request, repeats: int) -> list[float]:
    """CPU times of runs that keep only their last state, after one run to warm up, s."""
    only_end = request.with_(record=(), every=2**62)
    return repeated(only_end.run_to_end, repeats, time.thread_time)


def repeated(
    work: Callable[[], object], repeats: int, clock: Callable[[], float] = time.process_time
) -> list[float]:
    """Times of repeated calls of a function, after one call to warm up, s; few of a slow one."""
    # The default clock counts all threads of this process, because other solvers may use several.
    work()
    times: list[float] = []
    while len(times) < (min(repeats, _SLOW_REPEATS) if times and times[0] >= _SLOW else repeats):
        begin = clock()
        work()
        times.append(clock() - begin)
    return times


def largest_that_holds(
    holds: Callable[[float], bool],
    first: float,
    least: float,
    most: float,
    *,
    factor: float,
    accuracy: float,
) -> float | None:
    """The limit up to which a property holds, by bisection on a logarithmic scale.

    From `first`, values change by `factor` until the limit is between two of them. Returns a value
    for which the property holds; None if it does not even hold for `least`.
    """
    good, bad = min(max(first, least), most), math.inf
    while not holds(good):
        if good <= least:
            return None
        good, bad = max(good / factor, least), good
    while good < most and bad > (1.0 + accuracy) * good:
        tried = min(good * factor, most) if bad == math.inf else math.sqrt(good * bad)
        if holds(tried):
            good = tried
        else:
            bad = tried
    return good


def batches(scenes: Sequence[Scene], options: Options) -> Iterator[tuple[_core.Batch, list[int]]]:
    """Groups scenes into batches of the core, with the indices of the scenes of each batch.

    Scenes that differ in numbers only share a batch, which uses SIMD lanes, with the bits of
    `simulate`. The options must have equal steps.
    """
    groups: dict[Hashable, list[int]] = {}
    for k, scene in enumerate(scenes):
        groups.setdefault(_divided(scene)[0], []).append(k)
    for chosen in groups.values():
        own = [_divided(scenes[k])[1] for k in chosen]
        numbers = {path: np.array([each[path] for each in own]) for path in own[0]}
        differing = {path: each for path, each in numbers.items() if (each != each[:1]).any()}
        varied = SceneTemplate(scenes[chosen[0]], differing, 0)
        yield varied.batch(differing, None, summaries=[], band=0.1, options=options.core), chosen


@lru_cache(maxsize=256)  # a map asks for each scene once for every step and pair
def _divided(scene: Scene) -> tuple[Hashable, dict[str, Floats]]:
    """Divides a scene into a key of all that the runs of one batch share, and numbers by path."""
    shared: list[Hashable] = []
    numbers: dict[str, Floats] = {}
    for path, value in places(scene):
        if isinstance(value, Record):
            shared.append((path, type(value)))
            continue
        # The members of a pair, or of several records, have paths of their own.
        if isinstance(value, tuple) and (
            path == "friction" or any(isinstance(each, Record) for each in value)
        ):
            continue
        try:
            if value is not None:
                shape = shapes_of(scene, [path])[path]
                numbers[path] = np.asarray(value, np.float64)
                value = shape
        except ValueError:  # what all runs of a study share, too
            value = value.tobytes() if isinstance(value, np.ndarray) else value
        shared.append((path, value))
    return tuple(shared), numbers


def run_batch(batch: _core.Batch, threads: int) -> list[tuple[str, Floats]]:
    """The status and the final q and p (18,) of each run of a batch, in the scenes' order."""
    with CtrlC() as ctrl_c:
        ctrl_c.held = True
        result = batch.run(threads, lambda _: ctrl_c.pending)
        if ctrl_c.pending:
            raise KeyboardInterrupt
    order = np.argsort(result["run"])
    status = np.array(_core.STATUSES)[result["status"]][order].tolist()
    return list(zip(status, result["final_state"][order], strict=True))
