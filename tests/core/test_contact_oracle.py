"""The oracle of unilateral contact against closed forms, invariants, and the bilateral oracle."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import softpinch as sp
from bare_scenes import changed, paper, push, steps, uneven
from oracle import UnilateralReference, parameters, reference, unilateral
from oracle.contact_terms import SIGNS, Mechanics

G, E, A, HALF = 9.81, 0.30e6, 0.020, 0.0245


def fixed_fingers(
    depth: float = 0.0, gap: float = 0.0, velocity: Any = (0, 0, 0), **changes: Any
) -> SimpleNamespace:
    """Weightless fingers that nothing moves, upright; their tips press the object or miss it."""
    scene = paper(**changes)
    heavy = changed(scene.hand.right, mass=0.0, inertia=1e12)
    heavy.root_offset += gap - depth
    scene.hand = changed(scene.hand, right=heavy, left=heavy)
    scene.control = SimpleNamespace(kp=0.0, kd=0.0, ki=0.0)
    scene.schedule = steps([(0, 0)])
    q = np.array([0, heavy.length, 0, 0, 0, depth, depth, 0, 0], dtype=float)
    p = np.array([*velocity, 0, 0, 0, 0, 0, 0], dtype=float)
    scene.initial = SimpleNamespace(q=q, p=p, integral=np.zeros(2), time=0.0)
    return scene


def check(run: UnilateralReference) -> None:
    """What holds along any run."""
    assert abs(run.imbalance) <= 1e-9 * run.exchanged
    assert run.ledger["friction"] >= 0
    assert run.ledger["stop"] >= 0
    assert run.ledger["viscous"] <= 0
    assert run.worst["normal"] >= -1e-8
    assert run.worst["cone"] <= 1e-8
    assert run.worst["gap"] >= -1e-12
    assert run.worst["position"] <= 1e-11
    assert run.worst["velocity"] <= 1e-10
    for modes, forces in zip(run.modes, run.multipliers, strict=True):
        for i, mode in enumerate(modes):
            assert mode in ("stick", "slip+", "slip-") or not forces[[i, 2 + i]].any()


# Closed forms


def test_open_tips_let_the_object_fall_freely_and_then_it_is_lost() -> None:
    scene = fixed_fingers(gap=0.001, velocity=(0.01, 0.02, 0.1), duration=0.05)
    times = np.linspace(0, 0.05, 6)
    run = unilateral(scene, 0.5, times=times)
    assert run.modes == [("free", "free")] * 6 and not run.multipliers.any()
    np.testing.assert_allclose(run.q[:, 0], 0.01 * times, atol=1e-14)
    np.testing.assert_allclose(run.q[:, 1], 0.0762 + 0.02 * times - G / 2 * times**2, atol=1e-14)
    np.testing.assert_allclose(run.q[:, 2], 0.1 * times, atol=1e-14)
    check(run)
    ended = unilateral(fixed_fingers(gap=0.001), 0.5, 2 * HALF)
    assert ended.status == "lost" and not ended.holds
    # The tips' centres stand d_f inward of the fingers, and level with the object at the start.
    assert ended.end.t == pytest.approx(math.sqrt(2 * HALF / G), abs=1e-11)


def sliding(friction: float, speed: float, depth: float = 0.004, **changes: Any) -> Any:
    """A block between fixed tips, with its shear at rest for sliding at `speed`."""
    scene = fixed_fingers(depth, velocity=(0, speed, 0), **changes)
    # lambda^H = pi E (d_n^2 + d_t^2), mu lambda^H = 2 pi E d_n d_t.
    share = (1 - math.sqrt(1 - friction**2)) / friction
    scene.initial.q[7:] = -math.copysign(share * depth, speed)
    return scene, math.pi * E * depth**2 * (1 + share**2)


def test_a_sliding_block_slows_down_stops_and_sticks_when_computed() -> None:
    scene, load = sliding(0.3, 0.5, duration=0.02)
    slowing = G + 2 * 0.3 * load / 0.1
    stop = 0.5 / slowing
    times = np.array([0.0, stop / 3, stop / 2, 0.02])
    run = unilateral(scene, 0.3, times=times)
    np.testing.assert_allclose(run.p[:3, 1], 0.5 - slowing * times[:3], rtol=1e-10)
    np.testing.assert_allclose(run.multipliers[:3, :2], load, rtol=1e-10)
    np.testing.assert_allclose(run.multipliers[:3, 2:], -0.3 * load, rtol=1e-10)
    assert [c[1:] for c in run.changes[:2]] == [
        (side, "slip+", "stick", "stopped") for side in ("right", "left")
    ]
    for change in run.changes[:2]:
        assert change.time == pytest.approx(stop, abs=1e-12)
    assert run.holds
    assert run.ledger["friction"] == pytest.approx(2 * 0.3 * load * 0.5 * stop / 2, rel=1e-9)
    check(run)


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_block_slides_down_only_below_the_limit_of_friction(share: float) -> None:
    depth = 0.002
    ratio = share * 0.1 * G / 2 / (2 * math.pi * E * depth**2)
    friction = 2 * ratio / (1 + ratio**2)
    scene, load = sliding(friction, -0.01, depth, duration=0.05)
    run = unilateral(scene, friction, times=[0.0, 0.01, 0.05])
    falling = G - 2 * friction * load / 0.1
    assert falling == pytest.approx((1 - share) * G)
    if share < 1:
        np.testing.assert_allclose(run.p[:, 1], -0.01 - falling * run.t, rtol=1e-9)
        assert not run.changes
    else:
        assert [c.after for c in run.changes[:2]] == ["stick", "stick"]
        # Friction is the larger one: it decelerates at a tenth of g.
        assert run.changes[0].time == pytest.approx(0.01 / (0.1 * G), abs=1e-11)
    check(run)


def test_without_friction_only_normal_forces_act() -> None:
    run = unilateral(fixed_fingers(0.004, duration=0.03), 0.0, times=[0.0, 0.01, 0.03])
    np.testing.assert_allclose(run.p[:, 1], -G * run.t, atol=1e-12)
    np.testing.assert_allclose(run.multipliers[:, :2], math.pi * E * 0.004**2, rtol=1e-11)
    assert not run.multipliers[:, 2:].any() and run.ledger["friction"] == 0
    assert np.array_equal(run.codes, np.full((3, 2), 2))


def inverse_inertia(scene: Any, q: NDArray[Any], i: int) -> NDArray[Any]:
    """S of one contact (2, 2), typed in from the rows H_i and N_i of docs/model.md."""
    s, finger, grasped = SIGNS[i], scene.hand.right, scene.grasped
    angle, theta, dn = q[3 + i], q[2], q[5 + i]
    tilt = angle + s * theta
    length, d_f, a = finger.length, finger.half_thickness, scene.hand.tip.radius
    ox = -s * finger.root_offset + s * (length * math.sin(angle) + d_f * math.cos(angle))
    oy = length * math.cos(angle) - d_f * math.sin(angle)
    c, si = math.cos(theta), math.sin(theta)
    height = -(q[0] - ox) * si + (q[1] - oy) * c
    big_x = (q[0] - ox) * c + (q[1] - oy) * si
    rows = [
        [s * c, s * si, s * height, -length * math.cos(tilt) + d_f * math.sin(tilt), 1, 0],
        [-si, c, -big_x + s * (a - dn), 0, 0, 1],
    ]
    rows[1][3] = length * math.sin(tilt) + d_f * math.cos(tilt) + a - dn
    masses = [grasped.mass, grasped.mass, grasped.inertia, finger.inertia, 0.1, 0.1]
    return np.array([[sum(x * y / m for x, y, m in zip(left, right, masses, strict=True))
                      for right in rows] for left in rows])  # fmt: skip


@pytest.mark.parametrize("friction", [0.0, 5.0])
def test_an_impact_on_a_resting_finger_loses_what_it_must(friction: float) -> None:
    """All of the approach, and with much friction of the slip."""
    scene = fixed_fingers(gap=0.002, velocity=(0.3, 0.02, 0.4), duration=0.01, gravity=0.0)
    scene.hand.right = scene.hand.left = changed(scene.hand.right, inertia=5.8e-4)
    scene.initial.q[1] += 0.003
    run = unilateral(scene, friction)
    (hit,) = [c for c in run.changes if c.cause == "gap"][:1]
    assert hit.finger == "right" and hit.time == pytest.approx(0.0066, abs=2e-4)
    before = unilateral(scene, friction, times=[hit.time])
    q = before.q[0]
    # The object has moved freely, the surfaces and fingers have rested.
    p = scene.initial.p
    terms = Mechanics(parameters(scene)).terms([*q, *p, 0, 0], [0] * 5, [0, 0])
    rates = (terms.phi @ p)[[0, 2]]
    s = inverse_inertia(scene, q, 0)
    if friction:
        impulse = np.linalg.solve(s, -rates)
        assert abs(impulse[1]) < friction * impulse[0]
        loss = rates @ np.linalg.solve(s, rates) / 2
    else:
        loss = rates[0] ** 2 / s[0, 0] / 2
    short = changed(scene, duration=hit.time + 1e-9)
    booked = unilateral(short, friction).ledger["impact"]
    assert rates[0] < 0 and booked == pytest.approx(loss, rel=1e-9)
    check(run)


def test_a_free_tip_relaxes_by_its_own_spring_and_damper() -> None:
    depth, tilt = 0.006, 0.3
    scene = fixed_fingers(gap=0.03, duration=0.04, gravity=0.0)
    scene.initial.q[[3, 5, 7]] = tilt, depth, 0.002
    scene.initial.q[4] = -0.1
    # A tilt that changes later is not felt.
    scene.initial.p[2] = 0.5
    run = unilateral(scene, 0.5, times=[0.0, 0.04])

    def slope(_: float, y: NDArray[Any]) -> list[float]:
        dn, dt, *rates = y
        normal = dn**2 / math.cos(tilt) ** 2 + 2 * dn * dt * math.tan(tilt) + dt**2
        tangential = dn**2 * math.tan(tilt) + 2 * dn * dt
        return [
            *rates,
            (-100 * rates[0] - math.pi * E * normal) / 0.1,
            (-100 * rates[1] - math.pi * E * tangential) / 0.1,
        ]

    alone = solve_ivp(slope, (0, 0.04), [depth, 0.002, 0, 0], "DOP853", rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(run.q[-1, [5, 7]], alone.y[:2, -1], atol=1e-12)
    np.testing.assert_allclose(run.q[-1, 2], 0.02, atol=1e-14)
    check(run)


def test_a_surface_that_comes_to_zero_stops_there() -> None:
    scene = fixed_fingers(gap=0.01, duration=0.01)
    scene.initial.q[6], scene.initial.p[15 - 9] = 1e-4, -2.0
    scene.initial.q[8] = 1e-5
    run = unilateral(scene, 0.5, times=[0.0, 0.01])
    assert run.q[-1, [6, 8]].tolist() == run.p[-1, [6, 8]].tolist() == [0, 0]
    assert 0.1 < run.ledger["stop"] < 0.1 * 2.0**2 / 2
    check(run)


# The start of a grasp


def test_a_step_from_point_contact_slips_at_little_friction_only() -> None:
    sticks, slips = (unilateral(paper(duration=1e-3), mu, times=[0.0]) for mu in (0.103, 0.102))
    assert sticks.modes == [("stick", "stick")] and slips.modes == [("slip+", "slip+")]
    assert f"{sticks.multipliers[0, 0]:.1f}" == f"{sticks.multipliers[0, 1]:.1f}" == "67.6"
    demand = np.abs(sticks.multipliers[0, 2:]) / sticks.multipliers[0, :2]
    np.testing.assert_allclose(demand, 0.1023, atol=5e-5)
    assert {c.after for c in slips.changes} == {"stick"}


# The bilateral oracle, and the mirror


@pytest.mark.parametrize("case", ["paper", "uneven"])
def test_where_nothing_pulls_or_slips_it_is_the_bilateral_oracle(case: str) -> None:
    pulse = sp.Pulse(time=0.03, duration=0.01, force=(2.0, 1.0), moment=0.02)
    # An impulse would open the contact that it moves away from.
    make = {"paper": paper, "uneven": uneven}[case]
    scene = make(duration=0.08, disturbances=[pulse])
    times = np.linspace(0, 0.08, 9)
    ours, theirs = unilateral(scene, 2.0, 2 * HALF, times), reference(scene, times)
    assert not ours.changes and ours.holds
    for name, size in (("q", 1e-12), ("p", 1e-10), ("multipliers", 1e-8), ("integral", 1e-13)):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=size)
    check(ours)


def test_the_mirror_image_runs_the_mirror_image() -> None:
    scene = uneven(schedule=steps([(6, 6)]), duration=0.06)
    scene.disturbances = [sp.Pulse(time=0.03, duration=0.01, force=(60.0, 20.0), moment=2.0)]
    other = uneven(schedule=steps([(6, 6)]), duration=0.06)
    other.hand = changed(
        scene.hand, right=scene.hand.left, left=scene.hand.right, tip=scene.hand.tip[::-1]
    )
    other.grasped = changed(scene.grasped, com_offset=-scene.grasped.com_offset)
    other.control = scene.control[::-1]
    other.disturbances = [sp.Pulse(time=0.03, duration=0.01, force=(-60.0, 20.0), moment=-2.0)]
    times = np.linspace(0, 0.06, 7)
    ours = unilateral(scene, (0.2, 0.4), 0.06, times)
    theirs = unilateral(other, (0.4, 0.2), 0.06, times)
    assert len(ours.changes) >= 4
    swapped = [0, 1, 2, 4, 3, 6, 5, 8, 7]
    signs = np.array([-1, 1, -1, 1, 1, 1, 1, 1, 1])
    np.testing.assert_allclose(theirs.q[:, swapped] * signs, ours.q, atol=1e-11)
    np.testing.assert_allclose(theirs.multipliers[:, [1, 0, 3, 2]], ours.multipliers, atol=1e-7)
    # Slip velocities keep their signs: up is up in the mirror.
    back = {"right": "left", "left": "right"}
    mirrored = sorted(c._replace(finger=back[c.finger]) for c in theirs.changes)
    assert [c[1:] for c in mirrored] == [c[1:] for c in sorted(ours.changes)]
    for one, other_one in zip(sorted(ours.changes), mirrored, strict=True):
        assert one.time == pytest.approx(other_one.time, abs=1e-10)
    check(ours)


# Runs with all modes


@pytest.mark.parametrize(
    ("friction", "disturbance"),
    [
        (0.5, push(time=0.02)),
        (0.8, sp.Pulse(time=0.02, duration=0.01, moment=27.6)),
        (0.3, sp.Pulse(time=0.02, duration=0.01, force=(232.0, 0.0))),
        (0.4, sp.Impulse(time=0.02, impulse=(0.4, 0.3), angular_impulse=5e-4)),
        (5.0, push(time=0.02)),
    ],
    ids=["i", "turn", "x", "impulse", "much friction"],
)
def test_what_holds_along_any_run(friction: float, disturbance: Any) -> None:
    for make in (paper, uneven):
        scene = make(schedule=steps([(6, 6)]), disturbances=[disturbance], duration=0.05)
        run = unilateral(scene, friction, 2 * HALF, np.linspace(0, 0.05, 26))
        assert run.status in ("completed", "lost") and run.changes
        assert run.status == "completed" or friction < 5
        check(run)
        if isinstance(disturbance, sp.Pulse):
            assert run.ledger["impact"] >= 0


def test_grazing_acts_with_a_part_of_the_couple_and_no_force() -> None:
    scene = paper(disturbances=[push(time=0.3)], duration=0.31)
    run = unilateral(scene, 0.5, 2 * HALF)
    begin, end = [c for c in run.changes if "graze" in (c.before, c.after)][:2]
    assert (begin.after, end.before, end.after) == ("graze", "graze", "free")
    inside = unilateral(scene, 0.5, 2 * HALF, [(begin.time + end.time) / 2])
    i = ["right", "left"].index(begin.finger)
    assert inside.modes[0][i] == "graze" and 0 < inside.couples[0, i] < 1
    assert not inside.multipliers[0, [i, 2 + i]].any()


def test_two_contacts_that_open_each_other_in_turn_settle_with_both_closed() -> None:
    """Each collision of the left tip opens the right one, with an eighth of the speed."""
    run = unilateral(paper(disturbances=[push(time=0.02)], duration=0.05), 5.0, 2 * HALF)
    times = [c.time for c in run.changes if c[1:4] == ("right", "stick", "free")]
    apart = np.diff(times)
    np.testing.assert_allclose(apart[1:4] / apart[:3], 0.135, atol=0.05)
    assert run.holds and len(times) < 12
    check(run)


def test_wanted_instants_change_no_event() -> None:
    """The tip meets the face 0.3 mm from its end, within a step that leaves the face."""
    push_along = sp.Pulse(time=1.0, duration=0.01, force=(231.95, 0.0))
    scene = paper(disturbances=[push_along], duration=1.02)
    few = unilateral(scene, 0.3, 2 * HALF, [1.02])
    many = unilateral(scene, 0.3, 2 * HALF, [*np.linspace(1.0, 1.02, 21), 1.01327])
    assert [c[1:] for c in few.changes] == [c[1:] for c in many.changes]
    for one, other in zip(few.changes, many.changes, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-9)
    np.testing.assert_allclose(few.q[-1], many.q[-2], atol=1e-9)


def test_a_given_state_goes_on() -> None:
    scene = paper(disturbances=[push(time=0.02)], duration=0.03)
    whole = unilateral(scene, 0.8, 2 * HALF, [0.01, 0.03])
    initial = SimpleNamespace(q=whole.q[0], p=whole.p[0], integral=whole.integral[0], time=0.01)
    rest = unilateral(changed(scene, initial=initial, duration=0.02), 0.8, 2 * HALF, [0.03])
    np.testing.assert_allclose(rest.q[-1], whole.q[-1], atol=1e-11)
    initial.q = initial.q - np.array([0.1, 0, 0, 0, 0, 0, 0, 0, 0])
    with pytest.raises(ValueError, match="inside the object"):
        unilateral(changed(scene, initial=initial, duration=0.02), 0.8)


def driven(**changes: Any) -> sp.Scene:
    """A smooth move of driven fingers, pushed on the way."""
    move = sp.Schedule.minimum_jerk([0.0, 0.0137], np.deg2rad([[5, 6], [8, 4]]), move_time=0.0411)
    pulse = sp.Pulse(time=0.03, duration=0.01, force=(80.0, 30.0), moment=2.0)
    return sp.Scene(fingers="driven", schedule=move, disturbances=[pulse], duration=0.08, **changes)


def test_driven_fingers_follow_their_schedule_whatever_the_contact_does() -> None:
    times = np.linspace(0, 0.08, 9)
    run = unilateral(driven(), 0.3, 2 * HALF, times)
    assert len(run.changes) >= 4 and run.holds
    targets = [np.deg2rad([5, 6]), np.deg2rad([8, 4])]
    np.testing.assert_allclose(run.q[[0, -1], 3:5], targets, atol=1e-13)
    np.testing.assert_allclose(run.p[-1, 3:5], 0, atol=1e-12)
    check(run)
    # The inertia of the fingers counts in the torque only.
    heavy = sp.Hand(right=sp.Finger(inertia=0.1), left=sp.Finger(inertia=2e-4))
    same = unilateral(driven(hand=heavy), 0.3, 2 * HALF, times)
    np.testing.assert_allclose(same.q, run.q, atol=1e-13)
    assert [c[1:] for c in same.changes] == [c[1:] for c in run.changes]


def test_driven_fingers_that_neither_pull_nor_slip_are_those_of_the_core() -> None:
    run = unilateral(driven(), 3.0, times=np.linspace(0, 0.08, 9))
    assert not run.changes
    core = sp.simulate(driven(), dt=2e-5, method="dop853", formulation="nullspace", every=500)
    np.testing.assert_allclose(run.q, core.q, atol=1e-11)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    size=st.floats(10, 500),
    angle=st.floats(0, 2 * math.pi),
    moment=st.floats(-20, 20),
    kick=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    friction=st.tuples(st.floats(0.05, 4), st.floats(0.05, 4)),
    even=st.booleans(),
)
def test_what_holds_along_random_runs(
    size: float,
    angle: float,
    moment: float,
    kick: tuple[float, float],
    friction: tuple[float, float],
    even: bool,
) -> None:
    force = (size * math.cos(angle), size * math.sin(angle))
    disturbances = [
        sp.Pulse(time=0.02, duration=0.01, force=force, moment=moment),
        sp.Impulse(time=0.04, impulse=kick),
    ]
    scene = (paper if even else uneven)(
        schedule=steps([(6, 6)]), disturbances=disturbances, duration=0.06
    )
    run = unilateral(scene, friction, 2 * HALF, np.linspace(0, 0.06, 13))
    assert run.status in ("completed", "lost", "crushed", "folded")
    check(run)
