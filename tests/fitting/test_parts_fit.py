"""Fits of other parts to motions that SymPy's equations and SciPy's integrator compute."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from oracle.parts import parts_reference
from other_hands import SCENES

pytest.importorskip("scipy")
TIMES = np.linspace(0.002, 0.05, 25)
# The scene, the true numbers, and what is measured of it.
CASES: dict[str, tuple[str, dict[str, float], tuple[str, ...]]] = {
    "jaws": (
        "jaws and a box",
        {"hand.right.mass": 0.12, "hand.left.direction": 0.03},
        ("fingers", "torque_1", "y"),
    ),
    "an arc and a law": (
        "links and a bottle",
        {"grasped.right.radius": 0.0243, "hand.tip.tilt_coupling": 0.8},
        ("fingers", "pose"),
    ),
    "power law": (
        "power law",
        {"hand.tip.law.exponent": 1.72, "hand.tip.law.coefficient": 2.1e5},
        ("fingers", "multipliers"),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_fit_finds_the_numbers_of_each_kind(name: str) -> None:
    scene_name, truth, observables = CASES[name]
    scene = replace(SCENES[scene_name], duration=0.05)
    exact = parts_reference(scene.with_(truth), TIMES)
    pid: Any = scene.control
    asked = scene.schedule.angles[0]
    error = asked[0] - exact.q[:, 3]
    torque = pid.kp * error - pid.kd * exact.p[:, 3] - pid.ki * exact.integral[:, 0]
    data = {
        "fingers": exact.q[:, 3:5],
        "pose": exact.q[:, :3],
        "y": exact.q[:, 1],
        "multipliers": exact.multipliers,
        "torque_1": torque,
    }
    measured = {each: data[each] for each in observables}
    noise = {each: 1e-4 * float(np.abs(data[each]).max()) for each in observables}
    found = sp.fit(
        scene,
        TIMES,
        measured,
        dict.fromkeys(truth),
        noise=noise,
        dt=2e-4,
        method="dop853",
        formulation="nullspace",
        progress=False,
    )
    assert found.converged
    for path, value in truth.items():
        assert found.values[path] == pytest.approx(value, rel=1e-6), path
    if name == "jaws":
        (experiment,) = found.experiments
        assert experiment.units[:3] == ("m", "m", "N")
