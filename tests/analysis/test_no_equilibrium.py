"""Without an equilibrium there is a reason, and a load that is too large has its exact share."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar, root

import softpinch as sp
from resting import SIZES, UNKNOWNS, left_over

RADIUS, MODULUS = sp.Fingertip().radius, sp.Fingertip().youngs_modulus


def at(degrees: list[float]) -> sp.Scene:
    return sp.Scene(schedule=sp.Schedule.steps([0.0], np.radians([degrees])))


def share_of(found: sp.Equilibrium) -> float:
    """The share of the load that the message names."""
    named = re.search(r"([0-9.]+) % of the load", found.message)
    assert named is not None
    return float(named[1]) / 100.0


@pytest.mark.parametrize(
    ("scene", "status", "words"),
    [
        (at([-3.0, -3.0]), "apart", "mm wider"),
        (
            sp.Scene(contact="unilateral", friction=0.3, grasped=sp.GraspedObject(mass=10.0)),
            "slipping",
            "slip",
        ),
        (
            sp.Scene(
                contact="unilateral",
                friction=0.9,
                grasped=sp.GraspedObject(height=0.002, com_offset=0.0),
                schedule=at([14.0, 2.0]).schedule,
            ),
            "off_face",
            "end of its face",
        ),
    ],
    ids=["open fingers", "too little friction", "a low object"],
)
def test_without_equilibrium_there_is_a_reason_and_no_state(
    scene: sp.Scene, status: str, words: str
) -> None:
    found = sp.equilibrium(scene)
    assert found.state is None and found.status == status and words in found.message
    assert not found.stable and not found.minimum
    assert np.isnan(found.stiffness).all() and np.isnan(found.multipliers).all()
    assert status in repr(found)


def test_a_search_of_one_grip_does_not_speak_of_the_others() -> None:
    """A run of this scene settles, while the grip (0, 0) has no equilibrium."""
    steps = sp.Schedule.in_degrees("steps", [0.0, 0.7, 1.4], [[6, 6], [9.8, 11.4], [8.1, -5.5]])
    heavy = sp.Scene(schedule=steps, grasped=sp.GraspedObject(mass=1.0), duration=3.0)
    found = sp.equilibrium(heavy)
    assert found.state is None and found.status == "overloaded"
    assert found.message.startswith("no equilibrium with grip = (0, 0) mm: at 90.22 % of the load")
    assert "sp.equilibrium(scene, near=run)" in found.message
    run = sp.simulate(heavy, dt=2e-4, every=100, formulation="nullspace")
    assert sp.equilibrium(heavy, near=run).stable
    found = sp.equilibrium(sp.Scene(), shear=(-0.001, 0.0))
    assert found.message.startswith("no equilibrium with shear = (-1, 0) mm: ")
    assert sp.equilibrium(at([-3.0, -3.0]), near=run).message.startswith("no equilibrium: ")


def upright(pressed: float, push: float) -> sp.Scene:
    """Straight fingers that press both tips by a depth, without gravity, and a force in x."""
    finger = replace(sp.Finger(), root_offset=sp.Finger().root_offset - pressed)
    return sp.Scene(
        hand=sp.Hand(right=finger, left=finger),
        gravity=0.0,
        fingers="driven",
        schedule=sp.Schedule.minimum_jerk([0.0], [[0.0, 0.0]], 0.1),
        disturbances=(sp.Step(time=0.0, force=(push, 0.0)),),
    )


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("pressed", [0.002, 0.006, 0.009, 0.011, 0.015])
def test_a_tip_is_separated_or_crushed_at_the_exact_force(pressed: float, side: float) -> None:
    """Upright, (5) gives lambda^H = pi E d_n^2, and the sum of both d_n stays as it is.

    So the force that is borne is pi E (d_2^2 - d_1^2), until one tip has no compression, or the
    other one that of its radius.
    """
    both = 2.0 * pressed
    status = "separated" if both < RADIUS else "crushed"
    deep = min(both, RADIUS)
    borne = np.pi * MODULUS * (deep**2 - (both - deep) ** 2)
    below = sp.equilibrium(upright(pressed, 0.98 * side * borne))
    assert below.state is not None
    np.testing.assert_allclose(
        below.multipliers[:2], np.pi * MODULUS * below.state.q[5:7] ** 2, rtol=1e-9
    )
    for load in (1.02, 3.0):
        found = sp.equilibrium(upright(pressed, load * side * borne))
        assert found.state is None and found.status == status
        assert f"a tip is {status}" in found.message and status in repr(found)
        assert load * share_of(found) == pytest.approx(1.0, abs=1e-5)


def held_by_driven_fingers(push: float) -> sp.Scene:
    held = sp.Schedule.minimum_jerk([0.0], np.radians([[6.0, 6.0]]), 0.1)
    step = sp.Step(time=0.0, force=(push, 0.0))
    return sp.Scene(fingers="driven", schedule=held, disturbances=(step,))


def fold_at(load: float | None) -> float:
    """The largest force in x that is balanced at the grip zero while the load is put on, N.

    SciPy finds the force for each rotation, and the maximum over the rotations. The weight is part
    of the load: at a force f the share f / load of it acts. None is the whole weight all the time.
    """
    scene = sp.Scene()
    weight = scene.grasped.mass * scene.gravity
    below = sp.equilibrium(held_by_driven_fingers(193.0))
    assert below.state is not None and below.stable
    start = below.state.q[UNKNOWNS] / SIZES
    sought = np.array([*start[:2], *start[3:], 1.0])

    def opposite(theta: float) -> float:
        def missing(z: np.ndarray) -> np.ndarray:
            force = 200.0 * z[4]
            carried = 0.0 if load is None else 1.0 - force / load
            push = (force, carried * weight)
            return left_over(scene, np.zeros(2), np.array([*z[:2], theta, *z[2:4]]), push)

        solved = root(missing, sought, tol=1e-12)
        assert np.abs(solved.fun).max() < 1e-9
        return -200.0 * float(solved.x[4])

    turned = (start[2] - 0.02, start[2] + 0.1)
    fold = minimize_scalar(opposite, bounds=turned, method="bounded")
    assert turned[0] + 0.01 < fold.x < turned[1] - 0.01
    return -float(fold.fun)


@pytest.mark.parametrize("load", [300.0, 500.0])
def test_a_load_is_too_large_beyond_the_fold_that_a_general_solver_finds(load: float) -> None:
    driven = held_by_driven_fingers(load)
    for scene in (driven, replace(sp.Scene(), disturbances=driven.disturbances)):
        found = sp.equilibrium(scene)
        assert found.state is None and found.status == "overloaded"
        assert load * share_of(found) == pytest.approx(fold_at(load), rel=3e-6)


@pytest.mark.parametrize("beyond", [1e-3, 1e-5, 1e-6, 1e-8])
def test_just_beyond_a_fold_nothing_that_nearly_balances_counts(beyond: float) -> None:
    """The forces that are left over grow with the distance from the fold, from nothing."""
    scene = held_by_driven_fingers(fold_at(None) * (1.0 + beyond))
    found = sp.equilibrium(scene)
    if found.state is None:
        return
    # The search may find another branch, on which the forces must balance as well as anywhere.
    terms = sp.evaluate(scene, found.time, found.state.q, found.state.p, formulation="nullspace")
    forces, phi = terms.forces.total, terms.constraint_matrix
    balance = forces[:3] - phi[:, :3].T @ forces[5:]
    largest = np.abs(found.multipliers).sum()
    assert np.abs(balance * [1.0, 1.0, 100.0]).max() < 1e-10 * largest
