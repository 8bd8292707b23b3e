"""The loop of a `SampledController` and fingers that touch nothing: whether its swings grow.

Between samples a free finger moves by I theta'' = u, without gravity, and the torque is constant
but for the instant at which a delayed one begins to act. So one period is a linear map, and its
eigenvalues tell how the swings of the loop grow. In a grasp the tips add stiffness and damping.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .. import _core
from ..support.arrays import Floats
from .sampled_control import SampledController

# Measure -> which of (angle, rate) of a finger it is; None for what the fingers do not change.
_OF_FINGERS = {"angle": 0, "angle_error": 0, "angle_rate": 1, "target": None, "target_rate": None}
# With more periods of delay the matrix is large, and the loop is rarely meant so.
_MOST_DELAYED = 50


def growth(scene: Any, control: SampledController) -> float:
    """Returns the factor by which the swings of free fingers grow in one period.

    It is below 1 for a stable loop, and 0.0 if it is not known, because the controller measures
    more than the fingers or its delay takes too many periods.
    """
    later = math.floor(control.delay / control.period)
    if not set(control.measures) <= _OF_FINGERS.keys() or later > _MOST_DELAYED:
        return 0.0
    with np.errstate(all="ignore"):
        period = _period(scene, control, later)
    return float(np.abs(np.linalg.eigvals(period)).max()) if np.isfinite(period).all() else 0.0


def _period(scene: Any, control: SampledController, later: int) -> Floats:
    """Returns the matrix of a period, of (angles, rates, xi, the torques in the past)."""
    assert control.A is not None and control.B is not None
    assert control.C is not None and control.D is not None
    n = len(control.A)
    size = 4 + n + 2 * (later + 1)
    # The torques that a sample gives, and its measurements, from the state.
    measured = np.vstack([_measured(name, size) for name in control.measures])
    torque = control.D @ measured
    torque[:, 4 : 4 + n] += control.C
    past = [np.eye(size)[4 + n + 2 * k : 6 + n + 2 * k] for k in range(later + 1)]
    inertia = np.array([[scene.hand.right.inertia], [scene.hand.left.inertia]])
    state = np.eye(size)[:4]
    begin = control.delay - later * control.period
    for duration, acting in ((begin, past[-1]), (control.period - begin, [torque, *past][later])):
        angles, rates = state[:2], state[2:]
        gained = duration * acting / inertia
        state = np.vstack([angles + duration * (rates + 0.5 * gained), rates + gained])
    xi = control.B @ measured
    xi[:, 4 : 4 + n] += control.A
    return np.vstack([state, xi, torque, *past[:-1]])


def _measured(name: str, size: int) -> Floats:
    rows = np.zeros((_core.MEASURES[name], size))
    which = _OF_FINGERS[name]
    if which is not None:
        rows[:, 2 * which : 2 * which + 2] = np.eye(2)
    return rows
