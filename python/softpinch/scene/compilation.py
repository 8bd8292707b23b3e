"""Conversion of schedule, disturbances and controller to the core's inputs, for one run or many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support.arrays import Floats
from .disturbance import Disturbance, Noise
from .sampled_control import SampledController
from .schedule import Schedule

# The fields that differ between runs, if no field does.
_ALIKE: Mapping[str, Floats] = MappingProxyType({})


def inputs(
    schedule: Schedule,
    disturbances: Sequence[Disturbance],
    law: str,
    control: object = None,
    *,
    moves: Mapping[str, Floats] = _ALIKE,
    loads: Sequence[Mapping[str, Floats]] = (),
    gains: Mapping[str, Floats] = _ALIKE,
    numbers: NDArray[np.uint64] | None = None,
    seed: int = 0,
) -> _core.Inputs:
    """Converts schedule, disturbances and controller to the core's inputs, for one run or many.

    Args:
        schedule: The target angles of the fingers, or the torques, as shared by all runs.
        disturbances: The loads on the object, as shared by all runs.
        law: What moves the fingers: "pid", "torque", "sampled" or "driven".
        control: The scene's control, of which only a `SampledController` is an input.
        moves: Fields of the schedule that differ between runs -> (runs, ...).
        loads: For each disturbance, its fields that differ between runs -> (runs, ...); empty if
            no disturbance differs.
        gains: Fields of a `SampledController` that differ between runs -> (runs, ...).
        numbers: The run numbers (runs,), which key the noise; None keeps each noise's own `seed`
            and `run`.
        seed: The study's seed, which keys the noise if `numbers` is given.

    Raises:
        ValueError: A run's value breaks a rule.
    """

    def many(*arrays: Any) -> tuple[Any, ...]:
        return tuple(np.ascontiguousarray(array) for array in arrays)

    def one(*arrays: Any) -> tuple[Any, ...]:
        return many(*(array[None] for array in arrays))

    moved = many(*schedule.compile_runs(moves)) if moves else one(*schedule.compile())
    forces, sines, impulses, noises = [], [], [], []
    for place, (disturbance, values) in enumerate(
        zip(disturbances, loads or [_ALIKE] * len(disturbances), strict=True)
    ):
        compiled = disturbance.compile_runs(values) if values else disturbance.compile()
        take = many if values else one
        forces += [take(*force) for force in compiled.forces]
        sines += list(take(*compiled.sines))
        impulses += list(take(*compiled.impulses))
        for row, own_seed, own_run in compiled.noises:
            own = np.array([own_run], np.uint64)
            # Only a `Noise` takes the study's seed and run number, as in `SceneTemplate.at`.
            alone = numbers is None or not isinstance(disturbance, Noise)
            key = (own_seed, own) if alone else (seed, numbers)
            noises.append((*take(row), *key, place))
    if not isinstance(control, SampledController):
        return _core.Inputs(moved, forces, sines, impulses, noises, law)
    controller = control.compile_runs(gains, numbers, control.seed if numbers is None else seed)
    return _core.Inputs(moved, forces, sines, impulses, noises, "torque", controller)
