"""The loop of a `SampledController` and fingers that touch nothing: whether its swings grow.

A free finger moves by I theta'' = u, without gravity. In a grasp the tips add stiffness and
damping.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .. import _core
from .loop_matrix import MOST_UNDER_WAY, spectral_radius
from .sampled_control import SampledController

# Measure -> which states of the fingers it is, of their angles and then their rates; none where the
# fingers do not change it.
_OF_FINGERS = {
    "angle": [0, 1],
    "angle_error": [0, 1],
    "angle_rate": [2, 3],
    "target": [],
    "target_rate": [],
}


def growth(scene: Any, control: SampledController) -> float:
    """Returns the factor by which the swings of free fingers grow in one period.

    It is below 1 for a stable loop, and 0.0 if it is not known, because the controller measures
    more than the fingers or its delay takes too many periods.
    """
    known = set(control.measures) <= _OF_FINGERS.keys()
    if not known or control.delay > MOST_UNDER_WAY * control.period:
        return 0.0
    a, b = np.zeros((4, 4)), np.zeros((4, 2))
    a[:2, 2:] = np.eye(2)
    with np.errstate(all="ignore"):
        b[2:] = np.diag([1.0 / scene.hand.right.inertia, 1.0 / scene.hand.left.inertia])
    h = np.zeros((sum(_core.MEASURES[name] for name in control.measures), 4))
    first = 0
    for name in control.measures:
        for row, state in enumerate(_OF_FINGERS[name]):
            h[first + row, state] = 1.0
        first += _core.MEASURES[name]
    factor = spectral_radius(control, a, b, h, np.zeros((len(h), 2)))
    return 0.0 if math.isnan(factor) else factor
