"""Whether a failed run had an unstable sampled loop: its linear model from sample to sample.

Between two samples the torques are held, so the linearised motion has an exact discrete-time model.
With the state of the controller and its torques that are under way it is the loop, whose spectral
radius is the factor by which a deviation grows in each period. A run that completes pays nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from .. import _core
from ..scene.compilation import inputs as compiled_inputs
from ..scene.contact import as_bilateral
from ..scene.sampled_control import SampledController
from ..scene.scene import Scene
from ..scene.schedule import Schedule
from ..support.arrays import Floats
from .contact import ContactMode
from .options import Options

# The ends that an unstable loop does not explain: the run was stopped.
_STOPPED = ("completed", "interrupted", "too_many_steps")
# The motion is linearised at this many rows of the run, of about so many.
_INSTANTS, _ROWS = 9, 1000
# The loop is named if a deviation has grown so much by the end of the run.
_GROWN = 10.0
# With more torques under way the matrix of the loop is too large to look at.
_MOST_UNDER_WAY = 50
# Where the core's outputs of a linear model have each measure; targets do not move.
MEASURED: Mapping[str, list[int]] = {
    "angle": [3, 4],
    "angle_error": [3, 4],
    "angle_rate": [18, 19],
    "position": [0, 1],
    "velocity": [15, 16],
    "rotation": [2],
    "rotation_rate": [17],
    "compression": [5, 6],
    "shear": [7, 8],
    "multipliers": [9, 10, 11, 12],
}
# Terms of the exponential series, of a matrix whose norm is at most one half.
_TERMS = 16


def unstable(
    scene: Scene,
    options: Options,
    ended: tuple[str, float],
    compute: Callable[[Scene, Options], Mapping[str, Any]],
) -> str | None:
    """Says that a run failed under a sampled controller whose loop is unstable.

    The loop is linearised, without its limits, about several states of the run in which both tips
    stick. It is named if the median of the spectral radii lets a deviation grow tenfold or more
    until the end of the run.

    Args:
        scene: The scene.
        options: The options of the run.
        ended: The run's status, and the instant at which it ended, s.
        compute: Computes a run.

    Returns:
        The warning; None if the run did not fail, there is no `SampledController`, or its loop is
        not that unstable.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """
    status, end = ended
    control = scene.control
    if status in _STOPPED or not isinstance(control, SampledController):
        return None
    lasted = end - scene.start().time
    if control.delay > _MOST_UNDER_WAY * control.period or lasted < control.period:
        return None
    every = 1 if options.dt is None else max(1, int(lasted / options.dt / _ROWS))
    record = ("state", "torque", "contact")
    motion = compute(scene, replace(options, record=record, every=every, times=None))
    if motion["status"] == "interrupted":
        raise KeyboardInterrupt
    rows = np.flatnonzero((motion["contact"] == ContactMode.STICK).all(axis=1))
    rows = rows[np.linspace(0, len(rows) - 1, min(_INSTANTS, len(rows))).round().astype(int)]
    radii = [
        radius(scene, *(motion[name][row] for name in ("t", "q", "p", "torque"))) for row in rows
    ]
    found = float(np.median(radii)) if radii else math.nan
    if not math.log(max(found, 1.0)) * lasted / control.period >= math.log(_GROWN):
        return None
    return (
        f'the run ended as "{status}" at t = {end:.4g} s, and the likely cause is its '
        f"SampledController, whose loop is unstable: by the linearised motion deviations grow by "
        f"a factor of {found:.4g} in each sampling period of {control.period:g} s (the spectral "
        "radius of the loop); lower the gains, or shorten the period and the delay"
    )


def radius(scene: Scene, t: float, q: Floats, p: Floats, torque: Floats) -> float:
    """The spectral radius of the loop from sample to sample, about a state; nan if it overflows.

    It is at least 1, because a grasp at rest has two neutral states. Limits of the torques are left
    out.

    Args:
        scene: The scene, whose control is a `SampledController`.
        t: Time, s.
        q: Coordinates (9,).
        p: Rates of the coordinates (9,).
        torque: The torques in force (2,), N m.
    """
    control = scene.control
    assert isinstance(control, SampledController)
    bilateral = as_bilateral(scene)
    held = Schedule.steps([0.0], [torque])
    plant = _core.linearize(
        bilateral.parameters(),
        compiled_inputs(held, scene.disturbances, "torque"),
        np.array([t]),
        q[None],
        p[None],
        np.zeros((1, 2)),
        "nullspace",
        0.0,
        0.0,
        whole=True,
        open_loop=True,
        frozen=False,
    )
    loop = _loop(control, plant["A"][0], plant["B"][0][:, :2], *_measured(control, plant))
    if not np.isfinite(loop).all():
        return math.nan
    return float(np.abs(np.linalg.eigvals(loop)).max())


def _measured(control: SampledController, plant: _core._Linear) -> tuple[Floats, Floats]:
    """H and J, with which the controller measures y = H x + J v under the torques v."""
    h, j = [], []
    for name in control.measures:
        rows = MEASURED.get(name)
        width = _core.MEASURES[name]
        h.append(plant["C"][0][rows] if rows else np.zeros((width, plant["A"].shape[1])))
        j.append(plant["D"][0][rows, :2] if rows else np.zeros((width, 2)))
    return np.vstack(h), np.vstack(j)


def _loop(control: SampledController, a: Floats, b: Floats, h: Floats, j: Floats) -> Floats:
    """The matrix of the loop from sample to sample.

    Its states are those of the motion, x, and of the controller, xi, and the last outputs, the
    newest first, of which the oldest is in force at the sample. With delay = late * period + rest,
    that one acts for `rest` longer, and then the next one does.
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
