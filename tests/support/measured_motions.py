"""Synthetic measurements of a pushed grasp, for tests of fits."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.fitting.experiment import GROUPS, INDICES
from softpinch.scene.template import SceneTemplate

E, C, KAPPA = "hand.tip.youngs_modulus", "hand.tip.normal_viscosity", "hand.tip.tilt_coupling"
# A push at a grasp that closes; the object is heavier on the right, so that it turns.
SCENE = sp.Scene(
    grasped=sp.GraspedObject(com_offset=4e-3),
    disturbances=[sp.Pulse(time=0.04, duration=0.02, force=(3.0, -6.0), moment=0.02)],
    duration=0.1,
)
TRUTH = {E: 4.3e5, C: 37.0}
BOUNDS = {E: (1e4, 1e7), C: (1.0, 1e3)}
TIMES = np.linspace(0.01, 0.1, 46)
DT = 2e-4


def changed(scene: sp.Scene, values: Mapping[str, float]) -> sp.Scene:
    return SceneTemplate(scene, values, 0).changed(values)


def motion(scene: sp.Scene = SCENE, values: Mapping[str, float] = TRUTH) -> sp.Run:
    """Its rows are every fifth step, at multiples of a millisecond; `TIMES` are among them."""
    return sp.simulate(
        changed(scene, values),
        DT,
        record=("state", "multipliers", "torque"),
        every=5,
        stop_on=(),
    )


def at(run: sp.Run, times: Any = TIMES) -> Any:
    rows = np.searchsorted(run.t, np.asarray(times) - 1e-9)
    assert np.allclose(run.t[rows], times, atol=1e-12)
    return rows


def columns(run: sp.Run, *names: str, times: Any = TIMES) -> dict[str, Any]:
    rows = at(run, times)
    found = {}
    for name in names:
        table = [getattr(run, INDICES[c].quantity)[rows, INDICES[c].column]
                 for c in GROUPS.get(name, (name,))]  # fmt: skip
        found[name] = table[0] if len(table) == 1 else np.column_stack(table)
    return found


def assert_close(fit: sp.Fit, truth: Mapping[str, float], share: float) -> None:
    assert fit.values == pytest.approx(dict(truth), rel=share)
