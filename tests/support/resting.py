"""States at rest, for linear models about them."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import scenes as shared
import softpinch as sp

UNEVEN = replace(shared.uneven(), schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]])))


@cache
def resting(law: str) -> tuple[sp.Scene, sp.State]:
    """The uneven grasp at rest under a law: the same place for all three of them."""
    found = sp.equilibrium(UNEVEN, grip=(1e-3, -2e-3)).state
    assert found is not None
    state = replace(found, time=0.0)
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
