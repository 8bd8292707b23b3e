"""Equilibria beside runs: settled ones, far starts, turned objects, oscillations under load."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp

TURN = np.array([1e-2, 1e-2, 1.0, 1.0, 1.0, 1e-2, 1e-2, 1e-2, 1e-2])


@pytest.mark.parametrize(
    ("contact", "friction"),
    [("bilateral", None), ("unilateral", 0.5), ("unilateral", (0.5, 0.9))],
)
def test_after_each_operation_the_rest_is_as_far_as_the_speed_explains(
    contact: str, friction: float | None
) -> None:
    """The slowest motion decays as exp(-s t): it still goes as far as its speed divided by s."""
    scene = replace(sp.paper.manipulation(), contact=contact, friction=friction)
    run = sp.simulate(scene, formulation="projected", every=10, record=("state", "contact"))
    assert run.status == "completed"
    slipped = (run.contact == sp.ContactMode.SLIP).any() if contact == "unilateral" else False
    assert slipped == (contact == "unilateral")
    for number in range(1, 9):
        row = int(np.argmin(np.abs(run.t - number)))
        assert run.t[row] == pytest.approx(number, abs=1e-9)
        # The targets switch at this instant: it has come to rest under those before.
        before = float(np.nextafter(run.t[row], 0.0))
        found = sp.equilibrium(scene, before, near=run.state(row))
        assert found.state is not None and found.stable and not found.violations
        assert np.array_equal(found.state.q[3:5], scene.schedule.angles[number - 1])
        slowest = -found.growth
        assert 5.0 < slowest < 8.0
        moved = np.abs((found.state.q - run.q[row]) / TURN).max()
        assert moved <= 1.01 * np.abs(run.p[row] / TURN).max() / slowest
        assert moved < 1e-3


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_a_run_is_its_last_state_before_its_end(contact: str) -> None:
    scene = replace(sp.paper.manipulation(), contact=contact, friction=0.5)
    run = sp.simulate(replace(scene, duration=5.0), every=10, formulation="projected")
    found = sp.equilibrium(scene, near=run)
    # The run ends where the targets switch, and has come to rest under those before.
    assert found.time == np.nextafter(5.0, 0.0)
    assert found == sp.equilibrium(scene, found.time, near=run.state(-1))
    assert np.array_equal(found.state.q[3:5], scene.schedule.angles[4])
    assert found.grip != pytest.approx([0.0, 0.0], abs=1e-5)


@pytest.mark.parametrize(
    "changes",
    [{}, {"control": sp.Pid(ki=0.0, kd=5.0)}, {"fingers": "driven"}, {"gravity": -9.81}],
    ids=["pid", "pid without integral", "driven", "hanging"],
)
def test_the_holding_torques_are_those_of_a_settled_run(changes: dict[str, Any]) -> None:
    heavy = sp.GraspedObject(mass=0.5, inertia=2e-4, com_offset=3e-3)
    moves = sp.Schedule.minimum_jerk([0.0], np.radians([[8.0, 5.0]]), move_time=0.1)
    scene = sp.Scene(grasped=heavy, schedule=moves, duration=5.0, **changes)
    run = sp.simulate(scene, 2e-4, formulation="nullspace", every=1000, record=("state", "torque"))
    rest = sp.equilibrium(scene, near=run)
    assert rest.torque.shape == (2,) and rest.torque.min() > 1.0
    assert rest.torque[0] != rest.torque[1]
    np.testing.assert_allclose(run.torque[-1], rest.torque, rtol=1e-5)
    # Torques without feedback balance the same grasp.
    assert rest.state is not None
    held = replace(
        scene,
        control=sp.Torque(),
        fingers="pid",
        schedule=sp.Schedule.steps([0.0], [rest.torque]),
    )
    same = sp.equilibrium(held, near=rest.state)
    assert same.state is not None
    np.testing.assert_allclose(same.state.q, rest.state.q, atol=1e-9)
    np.testing.assert_allclose(same.torque, rest.torque, rtol=1e-12)


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
