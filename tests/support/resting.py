"""States at rest, for linear models about them."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import scenes as shared
import softpinch as sp
from linear_reference import sizes

UNEVEN = replace(shared.uneven(), schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]])))


def rest(scene: sp.Scene, duration: float = 3.0) -> sp.State:
    """Where a PID has settled, at rest to round-off, at the time zero.

    Newton's method starts from the end of a run; its smallest steps keep what is neutral.
    """
    long = replace(scene, duration=duration)
    settled = sp.simulate(
        long, method="radau5", tolerance=1e-8, formulation="nullspace", record=()
    ).state()
    x = np.concatenate([settled.q[:5], np.zeros(5), settled.q[7:9], settled.integral])
    for _ in range(5):
        state = sp.State.consistent(
            scene, x=x[0], y=x[1], rotation=x[2], fingers=x[3:5], shear=x[10:12], integral=x[12:]
        )
        model = sp.linearize(scene, state)
        size = sizes(scene, model.state_units)
        x = x - size * np.linalg.lstsq(model.A * size, model.state_rates, rcond=1e-12)[0]
    return state


@cache
def resting(law: str) -> tuple[sp.Scene, sp.State]:
    """The uneven grasp at rest under a law: the same place for all three of them."""
    state = rest(UNEVEN)
    if law == "pid":
        return UNEVEN, state
    fields: dict[str, Any] = {"initial": None}
    if law == "driven":
        held = sp.Schedule.minimum_jerk([0.0], [state.q[3:5]], 0.1)
        fields |= {"fingers": "driven", "schedule": held}
    else:
        torques = sp.linearize(UNEVEN, state, "torque").input_values
        fields |= {"control": sp.Torque(), "schedule": sp.Schedule.steps([0.0], [torques])}
    return replace(UNEVEN, **fields), replace(state, integral=(0.0, 0.0))
