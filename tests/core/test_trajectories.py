"""Runs beside SciPy (DOP853, rtol 1e-12) on the oracle's null-space form, and tests of that."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings

import softpinch as sp
from oracle.trajectory import Reference, error, reference
from scenes import SCENES, uneven
from softpinch import paper, strategies
from transforms import without_noise


@cache
def expected(name: str, times: tuple[float, ...]) -> Reference:
    """One of the scenes, once for all formulations."""
    return reference(SCENES[name], times)


@pytest.mark.slow
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


# The reference itself


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kappa", "degrees"),
    [(0.0, (-11.195, 12.074, 15.255, 0.384)), (-1.0, (-14.433, 15.079, 18.647, 0.637))],
)
def test_the_signs_of_the_shear_turn_the_object_as_model_md_has_it(
    kappa: float, degrees: tuple[float, ...]
) -> None:
    hand = sp.Hand(tip=sp.Fingertip(tilt_coupling=kappa))
    run = reference(paper.manipulation(hand=hand), [2.0, 4.0, 7.0, 8.0])
    np.testing.assert_allclose(np.rad2deg(run.q[:, 2]), degrees, rtol=0, atol=5.01e-4)


def test_starts_are_upright_or_touching() -> None:
    scene = uneven()
    fingers, tips = (scene.hand.right, scene.hand.left), scene.hand.tips
    start, width = scene.start(), scene.grasped.width
    for finger, tip, angle in zip(fingers, tips, start.q[3:5], strict=True):
        # A tip that touches, uncompressed, has its centre a from the face (9).
        inward = finger.length * np.sin(angle) + finger.half_thickness * np.cos(angle)
        assert inward == pytest.approx(finger.root_offset - tip.radius - width / 2, abs=1e-16)
    assert np.abs(start.q[5:]).max() < 1e-16 and not start.p.any()
    upright = sp.Scene(grasped=sp.GraspedObject(com_offset=0.002)).start()
    np.testing.assert_array_equal(upright.q[:5], [0.002, sp.Finger().length, 0.0, 0.0, 0.0])
