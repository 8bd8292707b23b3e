"""Derivatives of runs from differences of runs."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import derivative_paths as paths_of
import softpinch as sp
from derivative_differences import difference
from softpinch.scene.template import SceneTemplate

Floats = NDArray[np.float64]


def changed(scene: sp.Scene, path: str, index: tuple[int, ...], by: float) -> sp.Scene:
    """The scene with one number larger."""
    value = np.array(paths_of.value(scene, path))
    value[index] += by
    return SceneTemplate(scene, [path], 0).changed({path: value if value.ndim else float(value)})


def extrapolated(of: Callable[[float], Floats], step: float) -> Floats:
    """The derivative of a function at 0, of the fourth order in the step (Richardson)."""

    def central(h: float) -> Floats:
        return (of(h) - of(-h)) / (2 * h)

    return (4 * central(step / 2) - central(step)) / 3


def closest(
    ours: Floats, of: Callable[[float], Floats], steps: Sequence[float], least: Any = 0.0
) -> float:
    """The smallest `difference` of states from the differences of a function, over all steps."""
    return min(difference(ours, extrapolated(of, step), "state", least) for step in steps)


def states(run: sp.Run) -> Floats:
    """q and p (n, 18)."""
    return np.hstack([run.q, run.p])
