"""Searches that begin far away, turned objects, oscillations under load, and extreme numbers."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp


def targets(*degrees: float) -> sp.Schedule:
    return sp.Schedule.steps([0.0], np.radians([degrees]))


@pytest.mark.parametrize("degrees", [(6.0, 4.0), (8.0, 4.0), (5.0, 2.0)])
def test_the_search_reaches_the_rest_from_the_start_of_a_run(degrees: tuple[float, float]) -> None:
    """At the start the tips are not compressed, so that no force answers a displacement."""
    scene = sp.Scene(schedule=targets(*degrees), duration=3.0)
    found = sp.equilibrium(scene, near=sp.State.consistent(scene))
    assert found.state is not None and found.stable
    run = sp.simulate(scene, 2e-4, formulation="nullspace", every=10**6)
    # The no-slip constraint is integrated in one step, so the members differ a little.
    assert np.abs((found.state.q - run.q[-1])[:3] / [1e-2, 1e-2, 1.0]).max() < 0.2


@pytest.mark.parametrize("grip", [0.01, 0.02])
def test_a_turned_object_is_held_although_an_upright_one_would_not_be_reached(grip: float) -> None:
    scene = sp.Scene(fingers="driven", schedule=targets(0.0, 0.0), duration=1.0)
    found = sp.equilibrium(scene, grip=(grip, -grip))
    assert found.state is not None and found.stable
    run = sp.simulate(replace(scene, initial=replace(found.state, time=0.0)), every=10)
    assert np.abs(run.q - found.state.q).max() < 1e-12


def test_a_push_is_limited_where_oscillations_begin_to_grow() -> None:
    """The PID's integral makes the grasp oscillate long before the balance of forces ends."""
    scene = sp.Scene(hand=sp.Hand(tip=sp.Fingertip(tilt_coupling=-1.0)))
    limits = sp.wrench_limits(scene, [[0.0, -1.0, 0.0]])
    assert limits.limit[0] == "unstable"
    at_limit = sp.State(limits.q[0])
    for share, held in ((0.98, True), (1.02, False)):
        push = sp.Step(time=0.0, force=(0.0, -share * float(limits.magnitude[0])))
        pushed = replace(scene, disturbances=(push,), duration=3.0)
        rest = sp.equilibrium(pushed, near=at_limit)
        assert rest.state is not None and rest.stable == held
        # A small kick decays or grows, as the eigenvalues say.
        start = replace(rest.state, time=0.0, p=np.zeros(9))
        kick = sp.Impulse(time=0.0, impulse=(1e-4, 1e-4), angular_impulse=1e-6)
        kicked = replace(pushed, initial=start, disturbances=(push, kick))
        run = sp.simulate(kicked, formulation="nullspace", every=10)
        away = np.abs(run.q - rest.state.q).max(axis=1)
        early, late = away[100:800].max(), away[-700:].max()
        assert (late < early) == held


def test_slow_integrals_and_light_objects_are_stable_too() -> None:
    assert sp.equilibrium(sp.Scene(control=sp.Pid(ki=1e-6))).stable
    light = sp.GraspedObject(mass=1e-10, inertia=4e-14)
    assert sp.equilibrium(sp.Scene(grasped=light)).stable


def test_numbers_that_overflow_are_a_result() -> None:
    found = sp.equilibrium(sp.Scene(grasped=sp.GraspedObject(mass=5e-324)))
    assert not found.stable and "not known" in found.message
    found = sp.equilibrium(sp.Scene(control=sp.Pid(ki=5e-324)))
    assert found.state is None and "overflows" in found.message
