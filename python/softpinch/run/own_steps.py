"""The steps of an adaptive run taken again, each divided into equal parts.

Integration goes from one instant at which an input may jump to the next, and ends a step there. A
force of zero that "jumps" at each end of a step therefore makes equal steps out of the adaptive
ones: as many between two of these ends as the run is refined.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..scene.disturbance import Sampled
from ..scene.scene import Scene
from ..support.arrays import Floats
from .options import Options


def ending_at(scene: Scene, t: Floats) -> Scene:
    """Returns the scene with steps that end at increasing instants (n,), s."""
    zero = Sampled(times=t, force=np.zeros((len(t), 2)))
    return replace(scene, disturbances=[*scene.disturbances, zero])


def on_steps(scene: Scene, options: Options, t: Floats) -> tuple[Scene, Options]:
    """Makes the scene and the options of a run whose steps end at given instants.

    Args:
        scene: The scene of the adaptive run.
        options: Its options, with a tolerance.
        t: The ends of its steps and the recorded instants (n,), s, n > 1, increasing.

    Returns:
        The scene, which ends one step later than `t` if its duration allows, because a finer run
        may meet the violation that ended the run later; and options for equal steps, of which the
        core takes as many between two ends as it is told to refine.
    """
    start = scene.start()
    over = 2.0 * t[-1] - t[-2]
    duration = min(scene.duration, over - start.time)
    initial = scene.initial if start.grid is None else replace(start, grid=None)
    finer = replace(ending_at(scene, np.append(t, over)), duration=duration, initial=initial)
    how = replace(options, dt=duration, tolerance=None, times=None, every=1)
    return finer, how


def recorded(result: Mapping[str, Any], t: Floats) -> Mapping[str, Any]:
    """Keeps the rows of a run at the instants `t`, and its last row."""
    rows = np.isin(result["t"], t)
    rows[-1] = True
    if rows.all():
        return result
    n = len(rows)
    return {
        name: value[rows] if isinstance(value, np.ndarray) and len(value) == n else value
        for name, value in result.items()
    }
