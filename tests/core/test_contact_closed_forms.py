"""Unilateral contact in the core where pencil and paper say what happens."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import softpinch as sp
from contact_scenes import EVERYTHING, SLIP, STICK, check

G, E, A, HALF, MASS = 9.81, 0.30e6, 0.020, 0.0245, 0.1
FORMULATIONS = ("csm", "projected")
METHODS = ("rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock")


def fixed_fingers(
    depth: float = 0.0,
    gap: float = 0.0,
    velocity: tuple[float, float, float] = (0, 0, 0),
    **changes: Any,
) -> sp.Scene:
    """Upright fingers too heavy to move; their tips press the object or miss it."""
    heavy = sp.Finger(mass=1e-9, inertia=1e12, root_offset=0.049 + gap - depth)
    q = np.array([0, heavy.length, 0, 0, 0, depth, depth, 0, 0], dtype=float)
    p = np.array([*velocity, 0, 0, 0, 0, 0, 0], dtype=float)
    kwargs: dict[str, Any] = {
        "hand": sp.Hand(right=heavy, left=heavy),
        "control": sp.Pid(kp=0.0, kd=0.0, ki=0.0),
        "schedule": sp.Schedule.steps([0.0], [[0.0, 0.0]]),
        "initial": sp.State(q, p),
        "contact": "unilateral",
        "friction": 0.5,
        **changes,
    }
    return sp.Scene(**kwargs)


def simulated(scene: sp.Scene, **options: Any) -> sp.Run:
    usual = {"tolerance": 1e-12, "method": "dop853"}
    return sp.simulate(scene, record=EVERYTHING, **({**usual, **options}))


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("method", METHODS)
def test_open_tips_let_the_object_fall_freely(method: str, formulation: str) -> None:
    """A parabola, which every method of order 2 and more solves exactly."""
    scene = fixed_fingers(gap=0.001, velocity=(0.01, 0.02, 0.1), duration=0.03)
    run = sp.simulate(
        scene, dt=1e-4, method=method, formulation=formulation, record=EVERYTHING, every=30
    )
    assert not run.contact.any() and not run.multipliers.any() and not run.contact_changes
    np.testing.assert_allclose(run.q[:, 0], 0.01 * run.t, atol=1e-14)
    fall = scene.hand.right.length + 0.02 * run.t - G / 2 * run.t**2
    np.testing.assert_allclose(run.q[:, 1], fall, atol=1e-14)
    np.testing.assert_allclose(run.q[:, 2], 0.1 * run.t, atol=1e-14)
    assert run.holds is False
    check(run)


def test_an_object_that_falls_past_both_tips_is_lost_when_they_pass_its_ends() -> None:
    scene = fixed_fingers(gap=0.001, grasped=sp.GraspedObject(height=2 * HALF), duration=0.2)
    run = simulated(scene)
    assert run.status == "lost" and not run.holds
    # The tips' centres stand level with the object's at the start.
    assert run.t[-1] == pytest.approx(math.sqrt(2 * HALF / G), abs=1e-11)


def sliding(friction: float, speed: float, depth: float, **changes: Any) -> tuple[sp.Scene, float]:
    """A block between fixed tips, with their shear at rest for sliding at `speed`."""
    scene = fixed_fingers(depth, velocity=(0, speed, 0), friction=friction, **changes)
    # lambda^H = pi E (d_n^2 + d_t^2), mu lambda^H = 2 pi E d_n d_t.
    share = (1 - math.sqrt(1 - friction**2)) / friction
    q, p = np.array(scene.start().q), scene.start().p
    q[7:] = -math.copysign(share * depth, speed)
    scene = replace(scene, initial=sp.State(q, p, check=False))
    return scene, math.pi * E * depth**2 * (1 + share**2)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_sliding_block_slows_down_stops_and_sticks_when_computed(formulation: str) -> None:
    friction, speed = 0.3, 0.5
    scene, load = sliding(friction, speed, 0.004, duration=0.02)
    slowing = G + 2 * friction * load / MASS
    stop = speed / slowing
    times = np.array([0.0, stop / 3, stop / 2, 0.02])
    run = simulated(scene, formulation=formulation, times=times)
    np.testing.assert_allclose(run.p[:3, 1], speed - slowing * times[:3], rtol=1e-10)
    np.testing.assert_allclose(run.multipliers[:3, :2], load, rtol=1e-10)
    np.testing.assert_allclose(run.multipliers[:3, 2:], -friction * load, rtol=1e-10)
    stops = [c for c in run.contact_changes if c.time > 0][:2]
    assert {c[1:] for c in stops} == {(side, SLIP, STICK) for side in ("right", "left")}
    for change in stops:
        assert change.time == pytest.approx(stop, abs=1e-12)
    slid = speed * stop / 2
    assert run.energy.friction_loss[-1] == pytest.approx(2 * friction * load * slid, rel=1e-9)
    assert run.holds
    check(run)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_block_slides_down_only_below_the_limit_of_friction(share: float, method: str) -> None:
    depth = 0.002
    ratio = share * MASS * G / 2 / (2 * math.pi * E * depth**2)
    friction = 2 * ratio / (1 + ratio**2)
    scene, load = sliding(friction, -0.01, depth, duration=0.02)
    falling = G - 2 * friction * load / MASS
    assert falling == pytest.approx((1 - share) * G)
    run = sp.simulate(scene, dt=1e-4, method=method, record=EVERYTHING)
    if share < 1:
        np.testing.assert_allclose(run.p[:, 1], -0.01 - falling * run.t, rtol=1e-8)
        assert not [c for c in run.contact_changes if c.time > 0]
        assert (run.contact == SLIP).all() and "slipping" in run.violations
    else:
        # Friction decelerates it at a tenth of g.
        stop = 0.01 / (0.1 * G)
        for change in [c for c in run.contact_changes if c.time > 0][:2]:
            assert change.after == STICK and change.time == pytest.approx(stop, abs=1e-7)
        assert (run.contact[run.t > stop + 1e-6] == STICK).all()
    check(run)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_without_friction_only_normal_forces_act(formulation: str) -> None:
    scene = fixed_fingers(0.004, friction=0.0, duration=0.03)
    run = simulated(scene, formulation=formulation)
    np.testing.assert_allclose(run.p[:, 1], -G * run.t, atol=1e-12)
    np.testing.assert_allclose(run.multipliers[:, :2], math.pi * E * 0.004**2, rtol=1e-11)
    assert not run.multipliers[:, 2:].any() and not run.energy.friction_loss.any()
    assert (run.contact == SLIP).all()
    check(run)


def test_friction_on_one_side_only_turns_the_block() -> None:
    """A pair of friction is (right, left): the tip that has friction turns the block."""
    for pair, sign in (((0.3, 0.0), 1), ((0.0, 0.3), -1)):
        run = simulated(fixed_fingers(0.004, friction=pair, velocity=(0, -0.1, 0), duration=0.002))
        assert np.sign(run.p[-1, 2]) == sign
        assert not run.multipliers[:, 3 if sign > 0 else 2].any()
        check(run)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_an_overlap_at_the_start_goes_into_the_surface_also_where_the_tip_opens(
    formulation: str,
) -> None:
    """The object leaves the right tip faster than the surface can follow; the left one is away."""
    depth, speed = 0.006, -0.5
    scene = fixed_fingers(depth, velocity=(speed, 0, 0), duration=0.005, gravity=0.0)
    away = replace(scene.hand.left, root_offset=0.1)
    q = scene.start().q.copy()
    q[5:7] = depth - 0.002, 0.0
    scene = replace(
        scene, hand=replace(scene.hand, left=away), initial=sp.State(q, scene.start().p)
    )
    run = simulated(scene, formulation=formulation, times=[0.0, 0.005])

    def slope(_: float, y: NDArray[Any]) -> list[float]:
        return [y[1], (-100 * y[1] - math.pi * E * y[0] ** 2) / MASS]

    alone = solve_ivp(slope, (0, 0.005), [depth, 0], "DOP853", rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run.q[:, 5], [depth, alone.y[0, -1]], atol=1e-12)
    np.testing.assert_allclose(run.q[-1, 0], 0.005 * speed, atol=1e-14)
    assert not run.contact.any() and not run.contact_changes
    check(run)


def test_tips_that_do_not_reach_a_consistent_state_are_free_at_once() -> None:
    """`State.consistent` gives them negative compressions. The object falls, and nothing else."""
    scene = fixed_fingers(gap=0.001, duration=0.01)
    start = sp.State.consistent(scene, x=0.0, y=0.0762, rotation=0.02, velocity=(0.0, 0.3, 0.0))
    assert (start.q[5:7] < 0.0).all()
    run = simulated(replace(scene, initial=start), times=[0.0, 0.01])
    assert not run.contact.any() and not run.multipliers.any() and not run.contact_changes
    assert not run.q[:, 5:].any()
    np.testing.assert_allclose(run.q[-1, 1], 0.0762 + 0.003 - G / 2 * 1e-4, atol=1e-14)
    check(run)


def test_a_step_from_point_contact_slips_at_little_friction_only() -> None:
    """lambda^H is 67.6 N at once, and lambda^N is a tenth of it."""
    sticks, slips = (
        simulated(sp.Scene(contact="unilateral", friction=friction, duration=1e-3))
        for friction in (0.103, 0.102)
    )
    assert f"{sticks.multipliers[0, 0]:.1f}" == f"{sticks.multipliers[0, 1]:.1f}" == "67.6"
    assert (sticks.contact == STICK).all() and (slips.contact[0] == SLIP).all()


# By the mass of a tip: below this friction the modes are unique, for angles within 40 degrees and
# contacts within faces 49 mm high.
UNIQUE = [(0.1, 1.48), (0.02, 3.2), (0.01, 4.9)]


@pytest.mark.parametrize(("mass", "most"), UNIQUE)
@settings(max_examples=15)
@given(
    size=st.floats(1.0, 300.0),
    angle=st.floats(0, 2 * math.pi),
    moment=st.floats(-10.0, 10.0),
    share=st.floats(0.5, 1.0, exclude_max=True),
)
def test_up_to_the_critical_friction_there_is_always_a_mode(
    mass: float, most: float, size: float, angle: float, moment: float, share: float
) -> None:
    tip = sp.Fingertip(normal_mass=mass, tangential_mass=mass)
    force = (size * math.cos(angle), size * math.sin(angle))
    scene = sp.Scene(
        hand=sp.Hand(tip=tip),
        grasped=sp.GraspedObject(height=2 * HALF),
        disturbances=[sp.Pulse(time=0.02, duration=0.01, force=force, moment=moment)],
        duration=0.05,
        contact="unilateral",
        friction=share * most,
    )
    run = simulated(scene, tolerance=1e-9)
    assert run.status in ("completed", "lost", "crushed", "folded")
    check(run, closure=1e-5)
