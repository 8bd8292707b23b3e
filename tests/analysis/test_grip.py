"""`grip`: the targets that press with a given force, against a solution by hand and simulations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

import softpinch as sp
from softpinch import strategies

SCENE = sp.Scene()
# Two different fingers and tips, and a centre of gravity that is off the middle.
UNEVEN = sp.Scene(
    hand=sp.Hand(
        right=sp.Finger(root_offset=0.055, length=0.07),
        tip=(sp.Fingertip(), sp.Fingertip(youngs_modulus=2e5)),
    ),
    grasped=sp.GraspedObject(com_offset=0.004),
)


def by_hand(force: float) -> tuple[float, float]:
    """Angle and compression of an upright symmetric grasp with kappa = 0, from (5), (9) and (16).

    P = pi E (d_n^3 / (3 cos^2) + d_n d_t^2) for each tip; 2 dP/dd_t carries the weight, and dP/dd_n
    is the force.
    """
    finger, tip, grasped = sp.Finger(), sp.Fingertip(), sp.GraspedObject()
    stiffness = np.pi * tip.youngs_modulus
    gap = finger.root_offset - tip.radius - grasped.width / 2

    def pressed(angle: float) -> float:
        return finger.length * np.sin(angle) + finger.half_thickness * np.cos(angle) - gap

    def pressing(angle: float) -> float:
        d = pressed(angle)
        shear = grasped.mass * SCENE.gravity / (4.0 * stiffness * d)
        return float(stiffness * (d**2 / np.cos(angle) ** 2 + shear**2))

    # From the least force on, which is near half the weight.
    angle = brentq(lambda a: pressing(a) - force, np.deg2rad(0.4), np.deg2rad(15.0), xtol=1e-14)
    return angle, pressed(angle)


@pytest.mark.parametrize("force", [0.6, 5.0, 60.0, 300.0])
def test_the_targets_are_those_of_a_calculation_by_hand(force: float) -> None:
    scene = SCENE.with_({"hand.tip.tilt_coupling": 0.0})
    angle, pressed = by_hand(force)
    found = sp.grip(scene, force=force)
    np.testing.assert_allclose(found.targets, [angle, angle], rtol=1e-9)
    assert found.compression == pytest.approx(pressed, rel=1e-9)
    assert found.force == pytest.approx(force, rel=1e-9)
    again = sp.grip(scene, compression=pressed)
    np.testing.assert_allclose(again.targets, found.targets, rtol=1e-9)


SETTLED = {
    "symmetric": SCENE,
    "without integral": SCENE.with_({"control": sp.Pid(ki=0.0)}),
    "sliding tips": SCENE.with_({"contact": "unilateral", "friction": 0.6}),
    "driven": SCENE.with_({"fingers": "driven", "initial": None}),
}


@pytest.mark.parametrize("name", SETTLED)
def test_a_run_settles_with_this_force(name: str) -> None:
    """The way there decides which member of the family it reaches: other shears, nearly alike."""
    found = sp.grip(SETTLED[name], force=5.0)
    run = sp.simulate(
        replace(found.scene, duration=2.0), 5e-4, every=100, record=("state", "multipliers")
    )
    assert run.status == "completed"
    np.testing.assert_allclose(run.multipliers[-1, :2], 5.0, rtol=0.02)
    np.testing.assert_allclose(run.q[-1, 5:7], found.compression, rtol=0.02)


def settled(scene: sp.Scene, force: float) -> float:
    """The mean force in which a run settles that closes the fingers until they touch."""
    found = sp.grip(scene, force=force)
    closing = replace(found.scene, initial="touching", duration=3.0)
    run = sp.simulate(closing, 1e-3, every=100, method="radau5", record=("state", "multipliers"))
    assert run.status == "completed" and np.abs(run.p[-1]).max() < 1e-5
    return float(run.multipliers[-1, :2].mean())


def test_a_closing_run_settles_as_near_to_the_force_as_the_docstring_says() -> None:
    for left in (sp.Fingertip(youngs_modulus=1.5e5), sp.Fingertip(normal_viscosity=300.0)):
        alike = SCENE.with_({"hand.tip": (sp.Fingertip(), left)})
        assert settled(alike, 5.0) == pytest.approx(5.0, rel=0.02)
    radii = SCENE.with_({"hand.tip": (sp.Fingertip(), sp.Fingertip(radius=0.015))})
    assert settled(radii, 2.0) == pytest.approx(2.0, rel=0.032)
    off = [settled(UNEVEN, force) / force - 1.0 for force in (2.0, 8.0)]
    assert 0.34 > off[0] > 0.2 > off[1] > 0.05


@given(strategies.scenes(most_disturbances=1), st.floats(2.0, 40.0))
def test_any_grip_presses_as_hard_as_it_was_asked_to(scene: sp.Scene, force: float) -> None:
    try:
        found = sp.grip(scene, force=force)
    except ValueError as error:
        assert str(error).startswith("force = ")
        return
    assert found.force == pytest.approx(force, rel=1e-6)
    rest = sp.equilibrium(replace(found.scene, disturbances=()), 0.0)
    assert rest.multipliers[:2].mean() == pytest.approx(force, rel=1e-6)
    np.testing.assert_array_equal(found.scene.schedule.target(7.0), found.targets)
    assert found.scene.disturbances == scene.disturbances


@pytest.mark.parametrize("compression", [1e-4, 1.5e-4, 3e-3])
@pytest.mark.parametrize("control", [sp.Pid(ki=0.0), (sp.Pid(), sp.Pid(ki=0.0))], ids=repr)
def test_fingers_that_yield_have_the_grip_that_was_asked_for(
    control: Any, compression: float
) -> None:
    # The same targets have another rest, of fingers that yield more.
    held = sp.grip(SCENE.with_({"control": control}), compression=compression)
    assert held.compression == pytest.approx(compression, rel=1e-9)
    stiff = sp.grip(SCENE, compression=compression)
    np.testing.assert_allclose(held.equilibrium.state.q, stiff.equilibrium.state.q, atol=1e-12)
