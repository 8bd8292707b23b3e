"""Whole runs beside SciPy (DOP853, rtol 1e-12) on the oracle's null-space form."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings

import softpinch as sp
from oracle.trajectory import Reference, error, reference
from scenes import SCENES
from softpinch import _core, paper, strategies
from transforms import without_noise


@cache
def expected(name: str, times: tuple[float, ...]) -> Reference:
    """One of the scenes, once for all formulations."""
    return reference(SCENES[name], times)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("name", SCENES)
def test_runs_agree_with_scipy(name: str, formulation: str) -> None:
    scene = SCENES[name]
    options = {"dt": 2e-5, "every": 500, "formulation": formulation}
    run = sp.simulate(scene, record=("state", "multipliers"), **options)
    assert run.success, run.message
    errors = error(run, expected(name, tuple(run.t.tolist())))
    assert errors["q"] < 2e-9, errors
    assert errors["p"] < 2e-8, errors
    assert errors["multipliers"] < 2e-8, errors


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("name", SCENES)
def test_dop853_agrees_with_scipy_at_forty_times_the_step(name: str, formulation: str) -> None:
    scene = SCENES[name]
    options = {"dt": 8e-4, "method": "dop853", "formulation": formulation, "every": 10}
    run = sp.simulate(scene, record=("state", "multipliers"), **options)
    errors = error(run, expected(name, tuple(run.t.tolist())))
    assert max(errors.values()) < 1e-7, errors


def test_the_manipulation_agrees_over_all_eight_operations() -> None:
    scene = paper.manipulation()
    run = sp.simulate(scene, dt=5e-5, record=("state", "multipliers"), every=10_000)
    errors = error(run, reference(scene, run.t))
    assert max(errors.values()) < 1e-8, errors


# Fingers that open at once: the motion after the loss stops SciPy.
LOST = sp.Scene(
    hand=sp.Hand(tip=sp.Fingertip(youngs_modulus=598578.69)),
    schedule=sp.Schedule.steps([0.0], [[-0.0698, -0.0698]]),
    duration=0.05,
)


@settings(max_examples=15)
@given(strategies.scenes(duration=0.05))
@example(LOST)
def test_any_scene_agrees_with_scipy(scene: sp.Scene) -> None:
    run = sp.simulate(scene, dt=1e-5, every=1000, record=("state",))
    # Once a grasp is lost the motion runs away, and with it what either can say: up to there.
    expected = reference(replace(without_noise(scene), duration=float(run.t[-1])), run.t)
    # One that is lost in its first steps has hardly moved, and has no size to scale an error by.
    assert not run.success or error(run, expected)["q"] < 1e-7
    np.testing.assert_allclose(run.q, expected.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.integral, expected.integral, rtol=0, atol=1e-9)
