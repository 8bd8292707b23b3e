"""Where a grasp rests under a `SampledController`, and the eigenvalues of its loop there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from ..run.request import rest_scene
from ..run.stiffness import MEASURED
from ..scene.control import WRITTEN, Pid, SampledController
from ..scene.loop_matrix import NEUTRAL, common_period, driving, factors, measured
from ..scene.motion import HandMotion
from ..scene.outline import object_axes
from ..scene.parts import branches
from ..scene.piecewise import evaluate
from ..scene.scene import Scene, State, inputs
from ..scene.schedule import Schedule
from ..support.arrays import Complexes, Floats
from .states import kept, linear_at, shears_by_pose, state_names, without_shears

_Found: TypeAlias = dict[str, Any]  # by the core
# Step of differences by the fingers' coordinates; the last of Newton's corrections is below SMALL.
_STEP, _SMALL, _MOST = 1e-6, 1e-9, 60
# Scaled equations with a smaller singular value have no unique solution.
_SINGULAR = 1e-7


def sampled_rest(
    scene: Scene, control: SampledController, time: float, *member: Any
) -> tuple[_Found, Floats, str]:
    """Returns the core's rest, `State.controller` there, and why it is none, or an empty text.

    Newton's method finds the fingers' coordinates and, of each block, the states that drive an
    output and the outputs: xi = A xi + B y, u = C xi + D y, and the last u are the holding torques
    of fingers that stand there. `member` is that of the core's family, and where to begin.
    """
    lacks, size = _law_at_rest(scene, control, time)

    def at(fingers: Floats) -> _Found:
        held = Schedule.steps([0.0], [fingers])
        pressed = replace(scene, control=Pid(), schedule=held, initial=None)
        return rest_scene(pressed, time).equilibrium(*member)

    fingers = np.array(scene.schedule.target(time)) if member[-1] is None else member[-1][3:5]
    found, rest = at(fingers), np.zeros(size)
    for _ in range(_MOST):
        if found["status"] != "at_rest":
            return found, rest, found["message"]
        aside = [at(fingers + e) for e in _STEP * np.eye(2)]
        if any(one["status"] != "at_rest" for one in aside):
            break
        lack, none = lacks(found, rest), lacks(found, np.zeros(size))
        columns = [(lacks(one, rest) - lack) / _STEP for one in aside]
        columns += [lacks(found, e) - none for e in np.eye(size)]  # they are linear
        change, share = _solved(np.transpose(columns), -lack), 1.0
        while (there := at(fingers + share * change[:2]))["status"] != "at_rest" and share > 1e-3:
            share *= 0.5
        fingers, rest, found = fingers + share * change[:2], rest + share * change[2:], there
        if share == 1.0 and np.abs(change[:2]).max() < _SMALL:
            return found, *_row(control, time, rest)
    return found, rest, "the search for a rest of the controller does not end; give a `near` to it"


def _law_at_rest(
    scene: Scene, control: SampledController, time: float
) -> tuple[Callable[[_Found, Floats], Floats], int]:
    """What the equations of all blocks, the first one first, lack, and their number of unknowns."""
    blocks = [(block, driving(block)) for _, block in control.blocks()][::-1]
    zero, schedule = np.zeros(2), np.array(scene.schedule.target(time))
    motion = scene.motion or HandMotion.constant()
    acceleration = evaluate(motion.compile().acceleration, np.array(time))  # without its sines
    felt = object_axes(motion.at(time).tilt) @ np.add(acceleration, [0.0, scene.gravity])
    fixed = {"schedule": schedule, "target_rate": zero, "gyroscope": zero[:1]}

    def lacks(found: _Found, rest: Floats) -> Floats:
        seen = np.hstack([found["q"], found["multipliers"], found["torque"], np.zeros(5)])
        values = {name: seen[places] for name, places in MEASURED.items()} | fixed
        parts, target = [], schedule
        for block, n in blocks:
            a, b, c, d = (np.asarray(getattr(block, name)) for name in "ABCD")
            xi, outputs, rest = np.split(rest, [len(n), len(n) + 2])
            own = {"target": target, "angle_error": seen[3:5] - target, "accelerometer": felt}
            y = np.hstack([(values | own)[name] for name in block.measures])
            parts += [xi - a[np.ix_(n, n)] @ xi - b[n] @ y, outputs - c[:, n] @ xi - d @ y]
            target = outputs
        return np.hstack([*parts, found["torque"] - target])

    return lacks, sum(len(n) + 2 for _, n in blocks)


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Solves equations whose rows and columns have units of their own."""
    if not np.isfinite(matrix).all():
        raise ValueError(f"Scene.{WRITTEN['sampled']}: has no rest, its gains overflow")
    rows = np.maximum(np.abs(matrix).max(axis=1, keepdims=True), np.finfo(float).tiny)
    columns = np.maximum(np.abs(matrix / rows).max(axis=0), np.finfo(float).tiny)
    found, _, rank, _ = np.linalg.lstsq(matrix / rows / columns, right / rows[:, 0], _SINGULAR)
    if rank < len(right):
        why = "its xi = A xi + B y, u = C xi + D y have no unique solution: two states may"
        raise ValueError(f"Scene.{WRITTEN['sampled']}: has no unique rest: {why} integrate alike")
    return np.asarray(found / columns)


def _row(control: SampledController, time: float, rest: Floats) -> tuple[Floats, str]:
    """`State.controller` before the first sample, and a text if a block's limits are exceeded."""
    blocks: list[SampledController] = []
    beyond = ""
    for path, block in control.blocks():
        rest, own = np.split(rest, [len(rest) - 2 - len(driving(block))])
        xi, outputs = np.array(block.initial_state), own[-2:]
        xi[driving(block)] = own[:-2]
        low, high = (-np.inf, np.inf) if block.limits is None else block.limits.T
        if (outputs != np.clip(outputs, low, high)).any():
            beyond = f"{path}.limits do not allow its outputs at rest, {outputs.tolist()}"
        free = replace(block, outer=None, limits=None, no_load_rate=None)
        blocks.insert(0, replace(free, initial_torque=tuple(outputs), initial_state=xi))
    begun = SampledController.cascade(blocks)
    nothing = Schedule.steps([0.0], [[0.0, 0.0]])
    return np.array(inputs(nothing, (), "torque", begun).controller(time)), beyond


def sampled_eigenvalues(
    scene: Scene, control: SampledController, state: State, torque: Floats
) -> tuple[Complexes, float]:
    """As of `Equilibrium` (N,), 1/s, and their round-off; nan without a common period."""
    period, why = common_period(control)
    if why:
        return np.full(3, complex(np.nan, np.nan)), np.nan
    held = Schedule.steps([0.0], [torque])
    given = inputs(held, scene.disturbances, "torque", motion=scene.motion)
    plant = linear_at(scene, state, inputs=given, whole=True, open_loop=True, frozen=True)
    names = state_names("torque", "nullspace", branches(scene))
    by_pose, rows = shears_by_pose(plant["A"][0], names), kept(names)
    a, c = (without_shears(matrix[0], by_pose, names) for matrix in (plant["A"], plant["C"]))
    seen = measured(control, MEASURED, c, plant["D"][0][:, :2])
    found = factors(control, a[rows], plant["B"][0][rows, :2], seen)
    rates = np.log(found[found != 0.0]) / period
    return np.hstack([np.zeros(2), rates[np.argsort(-rates.real)]]), NEUTRAL / period
