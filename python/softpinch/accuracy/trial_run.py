"""One trial: a run of a scene with one setting, and its CPU time.

`advise`, `work_precision`, `stabilization_sweep` and `max_stable_dt` make their runs here, and CPU
times are measured here only. The error of a trial is defined in `run.scaled_error`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Self

from ..run.options import Options
from ..run.run import Run
from ..run.simulate import whole
from ..scene.scene import Scene

# Time from which a call is slow, s, and the number of timed calls that is enough then.
_SLOW, _SLOW_REPEATS = 0.3, 3


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialRun:
    """A run of a scene with one setting.

    Attributes:
        scene: The simulated scene.
        options: The setting: formulation, method, step or tolerance, and recorded quantities.
        result: The core's result.
        time: CPU time of the run, s.
    """

    scene: Scene
    options: Options
    result: Mapping[str, Any]
    time: float

    @classmethod
    def of(cls, scene: Scene, options: Options) -> Self:
        """Runs the scene.

        Raises:
            ValueError: The scene cannot start.
            KeyboardInterrupt: Ctrl-C.
        """
        begin = time.thread_time()
        result = whole(scene, options)
        spent = time.thread_time() - begin
        return cls(scene=scene, options=options, result=result, time=spent)

    @cached_property
    def run(self) -> Run:
        """The result as `simulate` returns it."""
        return Run(self.scene, self.options, self.result, None)

    def refined(self, refine: int) -> Mapping[str, Any]:
        """The core's result of the run with each step divided into `refine` steps.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        return whole(self.scene, self.options, refine)


def cpu_times(scene: Scene, options: Options, repeats: int) -> list[float]:
    """CPU times of runs that keep only their last state, after one run to warm up, s.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    only_end = replace(options, record=(), every=2**62)
    return repeated(partial(whole, scene, only_end), repeats, time.thread_time)


def repeated(
    work: Callable[[], object], repeats: int, clock: Callable[[], float] = time.process_time
) -> list[float]:
    """Times of repeated calls of `work`, after one call to warm up, s.

    Args:
        work: The function to time.
        repeats: Number of timed calls; three are enough if the function is slow.
        clock: Function that returns the time, s. The default counts all threads of this process,
            because other solvers may use several.
    """
    work()
    times: list[float] = []
    while len(times) < (min(repeats, _SLOW_REPEATS) if times and times[0] >= _SLOW else repeats):
        begin = clock()
        work()
        times.append(clock() - begin)
    return times
