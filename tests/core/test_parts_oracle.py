"""Hands and objects of every kind, at rest and carried, against equations from their geometry."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from oracle.parts import parts_reference
from oracle.trajectory import Reference
from other_hands import FACTS, MEASURED, SCENES, scene_of
from softpinch import _core, strategies

# Accelerations of up to 180 m/s^2 and 1280 rad/s^2.
MOVE = sp.HandMotion.minimum_jerk([0.0, 0.06], [[0.0, 0.0], [0.1, 0.05]], tilts=[0.0, 0.8])
BLOW = sp.Impulse(time=0.0277, impulse=(0.02, -0.01), angular_impulse=1e-4)


def require_equal(scene: sp.Scene, exact: Reference, formulation: str, within: float) -> None:
    """q, p and multipliers in all rows, each scaled by its largest size."""
    run = sp.simulate(
        scene, method="dop853", formulation=formulation, tolerance=1e-12, times=exact.t,
        record=("state", "multipliers"),
    )  # fmt: skip
    assert run.status == "completed"
    for name in ("q", "p", "multipliers"):
        found, true = getattr(run, name), getattr(exact, name)
        assert np.abs(found - true).max() < within * np.abs(true).max(), name


# Runs are compared with either in quick tests: with this one below, with the other one in
# tests/scene/test_parts.py.
@pytest.mark.slow
@pytest.mark.parametrize("name", FACTS)
def test_two_independent_programs_agree(name: str) -> None:
    scene, fact = scene_of(name), FACTS[name]
    exact = parts_reference(scene, [0.0, scene.duration])
    assert np.abs(exact.q[-1] - np.array(fact["q"], float)).max() < 1e-13
    assert np.abs(exact.p[-1] - np.array(fact["p"], float)).max() < 1e-12


# The other scenes have each mechanism, side and law at rest; all are carried below.
MORE = ("jaws and a box", "jaws and a wedge", "links and a bottle")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name in MORE else name for name in SCENES],
)
def test_every_kind_moves_as_its_geometry_says(name: str) -> None:
    scene = replace(SCENES[name], disturbances=[BLOW], duration=0.06)
    exact = parts_reference(scene, np.linspace(0.0, scene.duration, 11))
    for formulation in _core.FORMULATIONS:
        require_equal(scene, exact, formulation, 1e-9)


@pytest.mark.parametrize("name", SCENES)
def test_every_kind_is_carried_and_turned_as_its_bodies_say(name: str) -> None:
    finger = SCENES[name].hand.left
    if isinstance(finger, sp.Parallelogram):  # whose links are more than a mass at their end
        finger = replace(finger, inertia=9e-4)
    scene = replace(
        SCENES[name],
        hand=replace(SCENES[name].hand, left=finger),
        motion=MOVE,
        disturbances=[BLOW, sp.Pulse(time=0.01, duration=0.02, force=(3.0, 1.0))],
        duration=0.05,
    )
    exact = parts_reference(scene, np.linspace(0.0, scene.duration, 11))
    for formulation in _core.FORMULATIONS:
        require_equal(scene, exact, formulation, 1e-9)


@given(
    strategies.other_hands(),
    st.sampled_from(_core.FORMULATIONS),
    st.one_of(st.none(), strategies.motions(0.03, acceleration=50.0)),
    st.booleans(),
    st.floats(0.3, 1.0),
)
@settings(max_examples=2)
def test_random_mixtures_move_as_their_geometry_says(
    scene: sp.Scene,
    formulation: str,
    motion: sp.HandMotion | None,
    measured: bool,
    shear: float,
) -> None:
    scene = replace(scene, motion=motion)
    if measured:
        tips = scene.hand.tips
        law = replace(MEASURED, shear_factor=shear)
        hand = replace(scene.hand, tip=(tips[0], replace(tips[1], law=law)))
        scene = replace(scene, hand=hand)
    exact = parts_reference(scene, np.linspace(0.0, scene.duration, 11))
    require_equal(scene, exact, formulation, 1e-8)
