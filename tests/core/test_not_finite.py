"""A number that overflows, in whatever a run reports, ends it with the status "not_finite"."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from softpinch import _core
from wild_scenes import started, wild_scene

RECORDED = ("t", "q", "p", "multipliers", "residuals", "torque")
EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque")
SUMMARIES = ("final_state", *_core.SUMMARIES)
METHODS = [
    (method, steps)
    for method in _core.METHODS
    for steps in (("dt", "tolerance") if method in _core.ADAPTIVE_METHODS else ("dt",))
]


def swung() -> sp.Scene:
    """Fingers so heavy that their kinetic energy, 5e309 J, is no double; every state is one."""
    scene = sp.Scene(
        hand=sp.Hand(right=sp.Finger(inertia=1e300)),
        schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]),
        gravity=0.0,
        duration=1e-9,
    )
    start = sp.State.consistent(scene, fingers=(0.1, 0.1), finger_rates=(1e5, 0.0))
    return replace(scene, initial=start)


def driven() -> sp.Scene:
    """Driven fingers whose torque overflows when they move, after a while; it moves nothing."""
    return sp.Scene(
        fingers="driven",
        hand=sp.Hand(right=sp.Finger(inertia=1.7e308)),
        schedule=sp.Schedule.minimum_jerk([0.0, 4e-4], [[0.1, 0.1], [0.1001, 0.1]], 1e-3),
        duration=1e-3,
    )


# What overflows -> the scene, what is recorded and summarized, and when it overflows first.
OVERFLOWS = {
    "energy": (swung(), "energy", "energy_closure", 0.0),
    "torque": (driven(), "torque", "peak_torque", 4e-4),
}


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize(("method", "steps"), METHODS)
@pytest.mark.parametrize("what", OVERFLOWS)
def test_a_run_whose_energy_or_torque_overflows_is_not_finite_alone_and_among_others(
    what: str, method: str, steps: str, formulation: str
) -> None:
    scene, record, summary, overflows = OVERFLOWS[what]
    how: dict[str, Any] = {"method": method, "formulation": formulation, "stop_on": ()}
    how[steps] = scene.duration / 10 if steps == "dt" else 1e-3
    alone = sp.simulate(scene, record=("state", record), **how)
    assert alone.status == "not_finite", alone.message
    assert alone.t[-1] <= overflows
    if what == "torque":
        assert len(alone.t) > 1 and np.isfinite(alone.torque).all()
    if steps == "tolerance":
        between = np.linspace(0.1, 0.9, 7) * scene.duration
        dense = sp.simulate(scene, record=("state", record), times=between, **how)
        assert (dense.status, dense.message) == (alone.status, alone.message)
    study = sp.monte_carlo(scene, 5, summaries=("final_state", summary), progress=False, **how)
    assert list(study.status) == ["not_finite"] * 5
    assert list(study.message) == [alone.message] * 5
    assert list(study.end_time) == [alone.t[-1]] * 5
    last = np.concatenate([alone.q[-1], alone.p[-1]])
    assert study["final_state"].tobytes() == 5 * last.tobytes()


@pytest.mark.usefixtures("simd_level")
def test_an_energy_that_was_not_asked_for_ends_no_run() -> None:
    assert sp.simulate(swung(), dt=1e-10, record=EVERYTHING[:3]).success
    # Here the force's power overflows, whose integral the code of some levels always carries.
    scene = sp.Scene(
        grasped=sp.GraspedObject(mass=1e290),
        schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]),
        disturbances=[sp.Step(time=0.0, force=(0.0, 1e299))],
        gravity=0.0,
        duration=1e-9,
    )
    start = sp.State.consistent(scene, fingers=(0.1, 0.1), velocity=(0.0, 1e10, 0.0))
    pushed = replace(scene, initial=start)
    for method in ("rk4", "dop853", "rosenbrock"):
        assert sp.simulate(pushed, dt=1e-10, method=method, record=EVERYTHING[:3]).success, method
        ledger = sp.simulate(pushed, dt=1e-10, method=method, record="energy")
        assert ledger.status == "not_finite", method


@settings(max_examples=75)
@given(st.data())
def test_all_results_of_a_completed_run_are_finite(data: st.DataObject) -> None:
    scene = wild_scene(data.draw, st.floats(-160.0, 160.0))
    try:
        scene = started(scene, data.draw)
    except ValueError as error:  # the geometry itself overflows
        assert "finite" in str(error)
        return
    scene = replace(scene, duration=1e-5, initial=replace(scene.initial, check=False))
    method = data.draw(st.sampled_from(["rk4", "dop853", "rosenbrock"]))
    steps: dict[str, Any] = {"dt": 1e-6}
    if method != "rk4" and data.draw(st.booleans()):
        steps = {"tolerance": 1e-3, "max_steps": 100}
    gains = sp.Stabilization(alpha=0.0, beta=0.0)
    how = {"method": method, "stabilization": gains, "stop_on": (), **steps}
    run = sp.simulate(scene, record=EVERYTHING, **how)
    study = sp.monte_carlo(scene, 2, summaries=SUMMARIES, progress=False, seed=1, **how)
    assert [run.status, run.status] == list(study.status)
    if run.success:
        for name in RECORDED:
            assert np.isfinite(getattr(run, name)).all(), name
        assert np.isfinite(run.energy.closure).all()
        for name in SUMMARIES:
            # Infinite where the object has not settled at the end, and where a tip pulls; no angle
            # without a force.
            if name not in ("settling_time", "peak_friction_angle", "peak_friction_ratio"):
                assert np.isfinite(study[name]).all(), name
