"""The loop of a `SampledController` and a linear motion, from sample to sample.

Between two samples the torques are held, so a linear motion has an exact discrete-time model. With
the state of the controller and its torques that are under way it is the loop, whose spectral radius
is the factor by which a deviation grows in each period. Limits of the torques are left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .. import _core
from ..support.arrays import Floats
from .control import SampledController
from .parts import Jaw

if TYPE_CHECKING:
    from .scene import Scene

# With more torques under way the matrix of the loop is too large to compute.
MOST_UNDER_WAY = 50
# Terms of the exponential series, of a matrix whose norm is at most one half.
_TERMS = 16
# Measure -> its places among the angles and then the rates of the fingers.
_OF_FINGERS = {"angle": [0, 1], "angle_error": [0, 1], "angle_rate": [2, 3]}
# Measures that depend on no state.
_GIVEN = {"target", "target_rate", "accelerometer", "gyroscope"}


def spectral_radius(
    control: SampledController, a: Floats, b: Floats, h: Floats, j: Floats
) -> float:
    """Spectral radius of the loop of x' = a x + b v, measured as h x + j v; nan by overflow."""
    with np.errstate(all="ignore"):
        loop = _matrix(control, a, b, h, j)
    if not np.isfinite(loop).all():
        return math.nan
    return float(np.abs(np.linalg.eigvals(loop)).max())


def _matrix(control: SampledController, a: Floats, b: Floats, h: Floats, j: Floats) -> Floats:
    """The matrix of the loop from sample to sample: of x, xi, and the last outputs, newest first.

    The oldest output is in force at the sample. With delay = late * period + rest, that one acts
    for `rest` longer, and then the next one does.
    """
    gains = [np.asarray(getattr(control, name)) for name in "ABCD"]
    size, n = len(a), len(gains[0])
    late = int(control.delay // control.period)
    rest = min(max(control.delay - late * control.period, 0.0), control.period)
    outputs = [slice(size + n + 2 * k, size + n + 2 * k + 2) for k in range(late + 1)]
    whole = outputs[-1].stop
    x, xi = slice(0, size), slice(size, size + n)
    # Rows of y and of the new output by all states.
    y = np.zeros((len(h), whole))
    y[:, x], y[:, outputs[-1]] = h, j
    new = gains[3] @ y
    new[:, xi] += gains[2]
    loop = np.zeros((whole, whole))
    before, after = (_held(a, b, time) for time in (rest, control.period - rest))
    loop[x, x] = after[0] @ before[0]
    loop[x, outputs[-1]] += after[0] @ before[1]
    if late:
        loop[x, outputs[-2]] += after[1]
    else:
        loop[x] += after[1] @ new
    loop[xi] = gains[1] @ y
    loop[xi, xi] += gains[0]
    loop[outputs[0]] = new
    for newer, older in pairwise(outputs):
        loop[older, newer] = np.eye(2)
    return loop


def _held(a: Floats, b: Floats, time: float) -> tuple[Floats, Floats]:
    """F and G of x(t + time) = F x(t) + G u with held inputs u."""
    size, whole = len(a), len(a) + b.shape[1]
    generator = np.zeros((whole, whole))
    generator[:size] = time * np.hstack([a, b])
    norm = float(np.abs(generator).sum(axis=0).max())
    if not math.isfinite(norm):
        return np.full(a.shape, np.nan), np.full(b.shape, np.nan)
    halvings = max(0, math.frexp(norm)[1] + 1)
    step = np.ldexp(generator, -halvings)
    found = np.eye(whole)
    for k in range(_TERMS, 0, -1):
        found = np.eye(whole) + step @ found / k
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(halvings):
            found = found @ found
    return found[:size, :size], found[:size, size:]


def measured(
    control: SampledController, places: Mapping[str, list[int]], c: Floats, d: Floats
) -> tuple[Floats, Floats]:
    """H (m, n) and J (m, 2) of the measurements H x + J v, by each measure's rows of c and d."""
    h, j = [], []
    for name in control.measures:
        width = _core.MEASURES[name]
        rows = places.get(name)
        h.append(c[rows] if rows else np.zeros((width, c.shape[1])))
        j.append(d[rows] if rows else np.zeros((width, d.shape[1])))
    return np.vstack(h), np.vstack(j)


def growth(scene: Scene, control: SampledController) -> float:
    """Growth of free fingers' swings in a period; 0.0 with other measures or a long delay."""
    known = set(control.measures) <= _OF_FINGERS.keys() | _GIVEN
    if not known or control.delay > MOST_UNDER_WAY * control.period:
        return 0.0
    # A finger that touches nothing moves by I theta'' = u, without gravity.
    a, b = np.zeros((4, 4)), np.zeros((4, 2))
    a[:2, 2:] = np.eye(2)
    with np.errstate(all="ignore"):
        fingers = (scene.hand.right, scene.hand.left)
        b[2:] = np.diag([1.0 / (f.mass if isinstance(f, Jaw) else f.inertia) for f in fingers])
    h, j = measured(control, _OF_FINGERS, np.eye(4), np.zeros((4, 2)))
    factor = spectral_radius(control, a, b, h, j)
    return 0.0 if math.isnan(factor) else factor
