"""Nothing that is merely extreme is refused: it ends in a result with a status."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from softpinch import strategies
from wild_scenes import started, wild_scene

STATUSES = {"completed", "separated", "crushed", "folded", "unstable", "not_finite"}
EVERYTHING = ("state", "multipliers", "residuals", "energy")

wilder = st.floats(-300.0, 300.0)


def ends_well(scene: sp.Scene, **options: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sp.StabilityWarning)
        run = sp.simulate(scene, record=EVERYTHING, **options)
    assert run.status in STATUSES
    assert run.message
    assert len(run.t) >= 1
    if run.status != "not_finite" or len(run.t) > 1:
        for values in (run.t, run.q, run.p, run.multipliers, run.residuals):
            assert np.isfinite(values).all(), run.status
    assert all(np.isfinite(list(run.violations.values())))


@settings(max_examples=100)
@given(st.data())
def test_parameters_at_the_ends_of_the_number_range_end_in_a_status(data: st.DataObject) -> None:
    scene = wild_scene(data.draw, wilder)
    try:
        scene = started(scene, data.draw)
    except ValueError as error:  # the geometry itself overflows
        assert "finite" in str(error)
        return
    ends_well(replace(scene, initial=replace(scene.initial, check=False)), dt=1e-3)


huge = st.floats(0.0, 1e300)


@given(strategies.scenes(duration=0.01), st.floats(1e-6, 1e300), huge, huge)
def test_any_step_and_any_gain_end_in_a_status(
    scene: sp.Scene, dt: float, alpha: float, beta: float
) -> None:
    ends_well(scene, dt=dt)
    ends_well(sp.Scene(duration=0.01), stabilization=sp.Stabilization(alpha=alpha, beta=beta))


def test_each_way_of_failing_has_its_status_and_says_which_tip_when() -> None:
    soft = sp.Hand(tip=sp.Fingertip(youngs_modulus=3e3))
    crushed = sp.simulate(
        sp.Scene(hand=soft, schedule=sp.Schedule.steps([0.0], np.deg2rad([[25, 25]])))
    )
    assert crushed.status == "crushed"
    assert "fingertip was crushed at t = " in crushed.message
    assert crushed.violations["crushed"] == crushed.t[-1]

    torn = sp.simulate(
        sp.Scene(disturbances=[sp.Step(time=0.5, force=(0.0, 0.0), moment=-20.0)]), dt=1e-4
    )
    assert torn.status in {"separated", "folded"}
    pulled = sp.simulate(
        sp.Scene(disturbances=[sp.Step(time=0.2, force=(900.0, 0.0))]),
    )
    assert pulled.status == "separated"
    assert "the left fingertip left the object" in pulled.message
    assert pulled.q[-1, 6] < 0 <= pulled.q[-2, 6]

    noted = sp.simulate(
        sp.Scene(disturbances=[sp.Step(time=0.2, force=(900.0, 0.0))], duration=0.25),
        stop_on=(),
    )
    assert noted.violations["separated"] == pulled.t[-1]
    assert noted.t[-1] > pulled.t[-1]


def test_an_overflow_at_the_start_is_not_finite() -> None:
    heavy = sp.Scene(grasped=sp.GraspedObject(mass=1e-320), duration=0.01)
    run = sp.simulate(heavy)
    assert run.status == "not_finite"
    assert "overflowed" in run.message
