"""Whether a failed run had an unstable sampled loop: the motion is linearised, and the loop closed.

A run that completes pays nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from .. import _core
from ..scene.compilation import inputs as compiled_inputs
from ..scene.contact import as_bilateral
from ..scene.loop_matrix import MOST_UNDER_WAY, spectral_radius
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
        compute: Computes a run; Ctrl-C raises.

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
    if control.delay > MOST_UNDER_WAY * control.period or lasted < control.period:
        return None
    every = 1 if options.dt is None else max(1, int(lasted / options.dt / _ROWS))
    record = ("state", "torque", "contact")
    motion = compute(scene, replace(options, record=record, every=every, times=None))
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
    a, b = plant["A"][0], plant["B"][0][:, :2]
    return spectral_radius(control, a, b, *_measured(control, plant))


def _measured(control: SampledController, plant: _core._Linear) -> tuple[Floats, Floats]:
    """H and J, with which the controller measures y = H x + J v under the torques v."""
    h, j = [], []
    for name in control.measures:
        rows = MEASURED.get(name)
        width = _core.MEASURES[name]
        h.append(plant["C"][0][rows] if rows else np.zeros((width, plant["A"].shape[1])))
        j.append(plant["D"][0][rows, :2] if rows else np.zeros((width, 2)))
    return np.vstack(h), np.vstack(j)
