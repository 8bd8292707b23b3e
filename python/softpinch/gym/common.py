"""What both environments share: spaces, and checks of their arguments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from ..plot.frames import Frames
from ..simulator.episodes import LIMIT, Episodes
from ..simulator.task import Task
from ..simulator.tasks import HoldAgainstPushes
from ..support import checks

Observed: TypeAlias = NDArray[np.float64]
Actions: TypeAlias = NDArray[np.float32]
Flags: TypeAlias = NDArray[np.bool_]

# A film of one frame a step of 2 ms is ten times slower than the motion.
FPS = 50


def checked_task(task: object) -> Task:
    """Returns the task, or the default one for None."""
    if task is None:
        return HoldAgainstPushes()
    checks.instance("task", task, Task, "a Task, such as HoldAgainstPushes()")
    assert isinstance(task, Task)
    return task


def spaces(task: Task) -> tuple[Box, Box]:
    """Makes the spaces of observations and actions of one environment."""
    entries = len(task.measures)
    return Box(-LIMIT, LIMIT, (entries,), np.float64), Box(-1.0, 1.0, (2,), np.float32)


def checked_options(options: object, known: tuple[str, ...] = ()) -> dict[str, Any]:
    """Returns the options of a reset, and refuses unknown ones."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise TypeError(f"options = {checks.shown(options)}: must be a dictionary or None")
    for name in options:
        if name not in known:
            rule = f"must be one of {checks.quoted(known)}" if known else "there are no options"
            raise ValueError(f"options[{checks.shown(name)}]: unknown name; {rule}")
    return dict(options)


def draw(frames: Frames, episodes: Episodes, k: int) -> None:
    """Draws environment k as it is now."""
    seen = episodes.simulator.observations
    title = f"t = {seen.t[k]:.3f} s"
    frames.draw(seen.q[k], episodes.target(k), episodes.force(k), title)
