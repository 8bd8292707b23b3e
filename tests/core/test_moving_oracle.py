"""The moving hand of the oracle: forces in its frame or inertial coordinates, and symmetries."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import softpinch as sp
from oracle import parameters, reference
from oracle.moving import Bodies, Moving, moving, published
from transforms import MIRROR_MULTIPLIERS, mirrored, mirrored_coordinates

Floats = NDArray[np.float64]
UNLIKE = sp.Scene(
    hand=sp.Hand(
        right=sp.Finger(length=0.08, root_offset=0.05, mass=0.12, inertia=9e-4),
        left=sp.Finger(
            length=0.07, root_offset=0.047, half_thickness=0.006, mass=0.08, inertia=4e-4
        ),
        tip=(sp.Fingertip(), sp.Fingertip(radius=0.018, youngs_modulus=2e5, tilt_coupling=-1.0)),
    ),
    grasped=sp.GraspedObject(mass=0.15, inertia=6e-5, com_offset=0.004),
    control=(sp.Pid(kp=80.0), sp.Pid(ki=500.0)),
    schedule=sp.Schedule.in_degrees("steps", [0.0, 0.02], [[6, 6], [9, 4]]),
    disturbances=[sp.Step(time=0.01, force=(1.0, -2.0), moment=0.01)],
    initial="touching",
    duration=0.06,
)
TIMES = np.array([0.015, 0.035, 0.055])
MOTIONS = {
    "translation": sp.HandMotion.trapezoid([0.0, 0.05], [[0.1, 0.2], [0.108, 0.206]], 20.0),
    "turning": sp.HandMotion.minimum_jerk([-0.01, 0.06], [[0.0, 0.0], [0.02, 0.01]], [0.3, 0.8]),
    "shaken": sp.HandMotion.sine(0.2, 6.0, "tilt", phase=0.3, tilt=0.1),
}


def require_close(found: Moving, expected: Any, tolerance: float) -> None:
    """Errors as docs/integrators.md defines them: shares of each component's largest size."""
    for name in Moving._fields:
        ours, theirs = getattr(found, name), getattr(expected, name)
        sizes = np.abs(theirs).max(axis=0) + 1e-3 * np.abs(theirs).max()
        assert np.abs((ours - theirs) / sizes).max() < tolerance, name


@given(st.integers(0, 2**32))
def test_lagranges_equations_give_the_published_forces(seed: int) -> None:
    rng = np.random.default_rng(seed)
    numbers = {name: value * rng.uniform(0.5, 2.0) for name, value in parameters(UNLIKE).items()}
    q, p, frame = rng.uniform(-1, 1, 9), rng.uniform(-3, 3, 9), rng.uniform(-4, 4, (3, 3))
    frame[2] *= 10.0
    bodies = replace(Bodies.of(UNLIKE), numbers=numbers)
    system = bodies.at(*bodies.absolute(q, p, frame), frame)
    np.testing.assert_allclose(system.q, q, atol=1e-14)
    np.testing.assert_allclose(system.p, p, atol=1e-13)
    mass, force = system.forces()
    sides = ("right", "left")
    inertias = [numbers["grasped.mass"]] * 2 + [numbers["grasped.inertia"]]
    inertias += [numbers[f"hand.{side}.inertia"] for side in sides]
    inertias += [numbers[f"hand.tip.{s}.{n}_mass"] for n in ("normal", "tangential") for s in sides]
    np.testing.assert_allclose(mass, np.diag(inertias), atol=1e-15)
    expected = published(q, p, frame, numbers)
    np.testing.assert_allclose(force, expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("name", MOTIONS)
def test_the_published_forces_move_the_grasp_as_in_inertial_coordinates(name: str) -> None:
    inertial = moving(UNLIKE, MOTIONS[name], TIMES)
    require_close(moving(UNLIKE, MOTIONS[name], TIMES, inertial=False), inertial, 1e-11)


def test_without_a_motion_the_hand_is_that_of_the_fixed_oracle() -> None:
    motion = sp.HandMotion.constant()
    require_close(moving(UNLIKE, motion, TIMES), reference(UNLIKE, TIMES), 1e-11)


def test_constant_acceleration_and_tilt_are_another_gravity() -> None:
    up = moving(UNLIKE, sp.HandMotion.constant((0.0, 4.0)), TIMES)
    require_close(up, reference(replace(UNLIKE, gravity=UNLIKE.gravity + 4.0), TIMES), 1e-11)
    falling = moving(UNLIKE, sp.HandMotion.constant((0.0, -UNLIKE.gravity)), TIMES)
    require_close(falling, reference(replace(UNLIKE, gravity=0.0), TIMES), 1e-11)
    # The frame's own loads would turn with the tilt.
    scene, tilt, g = replace(UNLIKE, disturbances=()), 0.3, UNLIKE.gravity
    pushed = (g * np.sin(tilt), g * np.cos(tilt) - g)
    tilted = moving(scene, sp.HandMotion.constant(tilt=tilt), TIMES)
    require_close(tilted, moving(scene, sp.HandMotion.constant(pushed), TIMES), 1e-11)


def test_the_mirror_image_moves_like_the_image_in_a_mirror() -> None:
    motion = MOTIONS["turning"].to_dict()
    image = sp.HandMotion.minimum_jerk(
        motion["times"], np.multiply(motion["points"], [-1, 1]), np.negative(motion["tilts"])
    )
    ours, theirs = moving(UNLIKE, MOTIONS["turning"], TIMES), moving(mirrored(UNLIKE), image, TIMES)
    q, p = mirrored_coordinates(ours.q), mirrored_coordinates(ours.p)
    require_close(theirs, Moving(q, p, ours.multipliers[:, MIRROR_MULTIPLIERS]), 1e-11)
