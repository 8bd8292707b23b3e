"""What mechanics demands of a moving hand: full turns, free fall, units, orders of methods."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import softpinch as sp
from core.test_convergence import METHODS
from core.test_moving_oracle import MOTIONS, UNLIKE, require_close
from oracle.moving import Moving, moving
from scenes import swaying
from softpinch import _core
from transforms import MIRROR_MULTIPLIERS, Units, mirrored_coordinates, require_scaled

Floats = NDArray[np.float64]
TURN = 2.0 * np.pi
STILL = [[0.0, 0.0], [0.0, 0.0]]
EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque", "contact")
LIKE = sp.Scene(
    friction=0.5,
    hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
    schedule=sp.Schedule.in_degrees("steps", [0.0], [[8, 8]]),
    duration=0.3,
)
# Fingers without integral action give way to the load, and the left one more.
HEAVY = replace(
    UNLIKE,
    friction=1.2,
    grasped=sp.GraspedObject(mass=0.6, inertia=2e-4, com_offset=0.004),
    control=(sp.Pid(kp=80.0, ki=0.0), sp.Pid(ki=0.0)),
    schedule=LIKE.schedule,
    disturbances=(),
)
CONTACTS = ("bilateral", "unilateral")


def states(run: sp.Run) -> Floats:
    return np.hstack([run.q, run.p])


# A full turn about the root


def turned(scene: sp.Scene, start: sp.State, duration: float) -> sp.State:
    """Where the grasp is at rest after a full turn by minimum jerk."""
    motion = sp.HandMotion.minimum_jerk([0.0, duration], STILL, [0.0, TURN])
    scene = replace(scene, initial=replace(start, time=0.0), motion=motion, duration=duration + 2.0)
    run = sp.simulate(scene, dt=2e-3, method="rosenbrock", record=EVERYTHING, every=100)
    assert run.status == "completed" and not run.contact_changes
    run.check()
    np.testing.assert_allclose(run.world(run.q[:, :2])[-1], run.q[-1, :2], atol=1e-15)
    # At rest there is no other way than the equilibrium without a motion.
    rest = sp.equilibrium(replace(scene, motion=None), near=run).state
    assert np.abs(run.p[-1]).max() < 1e-6
    np.testing.assert_allclose(run.q[-1], rest.q, rtol=0, atol=2e-8)
    return rest


@pytest.mark.parametrize("contact", CONTACTS)
def test_a_slow_full_turn_leads_to_the_equilibrium_that_the_tilts_on_its_way_lead_to(
    contact: Any,
) -> None:
    """Rolling is not integrable: a full turn moves the object, and the way determines by how much.

    From equilibrium to equilibrium the way has no time. The error of a walk falls with the square
    of its steps, that of a turn with its speed.
    """
    scene = replace(HEAVY, contact=contact)
    start = sp.equilibrium(scene).state
    walks = []
    for steps in (32, 64):
        near = start
        for tilt in np.linspace(0.0, TURN, steps + 1)[1:]:
            tilted = replace(scene, motion=sp.HandMotion.constant(tilt=tilt))
            near = sp.equilibrium(tilted, near=near).state
        walks.append(near.q - start.q)
    way = (4.0 * walks[1] - walks[0]) / 3.0
    assert abs(way[1]) > 1e-6 and abs(way[2]) > 1e-5
    slow, slower = (turned(scene, start, duration).q - start.q for duration in (16.0, 32.0))
    np.testing.assert_allclose(slower, way, rtol=4e-3, atol=1e-12)
    np.testing.assert_allclose(2.0 * slower - slow, way, rtol=1e-3, atol=1e-12)


@pytest.mark.parametrize("contact", CONTACTS)
def test_a_slow_full_turn_of_like_fingers_returns(contact: Any) -> None:
    """On the way back from half a turn the fingers change roles, which undoes the way there."""
    scene = replace(LIKE, contact=contact)
    start = sp.equilibrium(scene).state
    slow, slower = (turned(scene, start, duration).q - start.q for duration in (8.0, 16.0))
    assert 1e-9 < np.abs(slow).max() < 1e-7
    assert np.abs(slower).max() < 0.52 * np.abs(slow).max()
    assert np.abs(2.0 * slower - slow)[:2].max() < 0.02 * np.abs(slow[:2]).max()


def test_a_fast_full_turn_moves_as_in_inertial_coordinates() -> None:
    motion = sp.HandMotion.minimum_jerk([0.01, 0.19], [[0.0, 0.0], [0.1, 0.05]], [0.0, TURN])
    scene, times = replace(UNLIKE, motion=motion, duration=0.2), np.array([0.07, 0.13, 0.195])
    run = sp.simulate(
        scene, tolerance=1e-12, method="dop853", times=times, record=("state", "multipliers")
    )
    assert run.status == "completed"
    found = Moving(run.q[:3], run.p[:3], run.multipliers[:3])
    require_close(found, moving(replace(scene, motion=None), motion, times), 1e-10)


@pytest.mark.parametrize("scene", [UNLIKE, replace(LIKE, contact="unilateral")])
def test_a_turn_to_upright_is_a_turn_from_upright(scene: sp.Scene) -> None:
    runs = [
        sp.simulate(
            replace(scene, motion=sp.HandMotion.minimum_jerk([0.01, 0.2], STILL, tilts)),
            dt=1e-4,
        )
        for tilts in ([-TURN, 0.0], [0.0, TURN], [TURN, 2.0 * TURN])
    ]
    assert len(runs[0]) > 500 and np.abs(states(runs[0])).max() < 1e3
    for run in runs[1:]:
        assert run.status == runs[0].status and run.violations == runs[0].violations
        np.testing.assert_allclose(states(run), states(runs[0]), rtol=0, atol=1e-10)


@pytest.mark.parametrize("contact", CONTACTS)
def test_without_gravity_the_opposite_turn_of_like_fingers_is_the_image_in_a_mirror(
    contact: Any,
) -> None:
    scene = replace(LIKE, contact=contact, gravity=0.0, friction=0.2)
    ours, theirs = (
        sp.simulate(
            replace(scene, motion=sp.HandMotion.minimum_jerk([0.01, 0.2], STILL, [0.1, tilt])),
            dt=1e-4,
            record=EVERYTHING,
        )
        for tilt in (0.1 + TURN, 0.1 - TURN)
    )
    assert ours.status == theirs.status == "completed"
    assert bool(ours.contact_changes) == (contact == "unilateral")
    assert np.abs(ours.q[:, 2]).max() > 1e-3
    image = Moving(*map(mirrored_coordinates, (ours.q, ours.p)),
                   ours.multipliers[:, MIRROR_MULTIPLIERS])  # fmt: skip
    require_close(Moving(theirs.q, theirs.p, theirs.multipliers), image, 1e-9)


# Free fall


@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize("method", _core.METHODS)
def test_a_hand_in_free_fall_does_not_feel_weight(method: Any, contact: Any) -> None:
    """From rest without gravity nothing moves in the hand; in a hand that stays, all of it sags."""
    scene = replace(HEAVY, contact=contact, duration=0.1)
    weightless = replace(scene, gravity=0.0)
    start = replace(sp.equilibrium(weightless).state, time=0.0)
    down = (0.0, -scene.gravity)
    runs = {
        name: sp.simulate(
            replace(each, initial=start, motion=motion),
            dt=2e-4,
            method=method,
            record=("state", "energy"),
        )
        for name, each, motion in (
            ("falls", scene, sp.HandMotion.constant(down)),
            ("floats", weightless, None),
            ("falls aslant", scene, sp.HandMotion.constant(down, tilt=0.7)),
            ("stays", scene, None),
        )
    }
    falls = runs["falls"]
    np.testing.assert_array_equal(states(falls), states(runs["floats"]))
    for name in ("falls", "falls aslant"):
        assert np.abs(runs[name].q - start.q).max() < 1e-12
        assert np.abs(runs[name].p).max() < 1e-10
        assert np.abs(runs[name].energy.motion_work).max() < 1e-14
    assert np.abs(runs["stays"].q - start.q).max() > 1e-3
    height = falls.world(falls.q[:, :2])[:, 1]
    expected = start.q[1] - scene.gravity * falls.t**2 / 2.0
    np.testing.assert_allclose(height, expected, rtol=0, atol=1e-12)


# Orders


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize("method", _core.METHODS)
def test_jumps_of_the_acceleration_keep_the_order_of_each_pair(
    method: Any, formulation: Any
) -> None:
    """The instants of the jumps are no multiples of the steps."""
    move = sp.HandMotion.trapezoid([0.0031, 0.0527], [[0.0, 0.0], [0.02, 0.01]], 60.0, [0.0, 0.4])
    assert len(move.breakpoints(0.0, 0.06)) == 4
    scene = replace(swaying(), motion=move, duration=0.0614)
    # Gains as soft as the scene, as in tests/core/test_convergence.py, which has the steps.
    how: dict[str, Any] = {
        "stabilization": sp.Stabilization(alpha=40.0, beta=40.0),
        "record": ("state", "multipliers"),
    }
    exact = sp.simulate(scene, tolerance=1e-14, method="dop853", formulation="projected", **how)
    order, within, steps = METHODS[method]
    errors = []
    for dt in steps:
        run = sp.simulate(scene, dt=float(dt), method=method, formulation=formulation, **how)
        errors.append([
            np.abs(getattr(run, name)[-1] - getattr(exact, name)[-1]).max()
            for name in ("q", "p", "multipliers")
        ])  # fmt: skip
    found = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    # DOP853's slope wanders.
    assert (found > order - (0.8 if method == "dop853" else within)).all(), (found, errors)


# Other units

KINDS = {
    **MOTIONS,
    "jerk limited": sp.HandMotion.jerk_limited(
        [0.0013, 0.0433], [[0.0, 0.0], [0.09, 0.01]], 600.0, 3e5, [0.2, 0.9]
    ),
    "positions": sp.HandMotion.sampled(
        np.linspace(0.0, 0.05, 6),
        positions=np.cumsum(np.arange(12.0).reshape(6, 2), axis=0) * 1e-3,
        tilts=np.linspace(0.0, 0.3, 6) ** 2,
    ),
    "accelerations": sp.HandMotion.sampled(
        np.linspace(0.0, 0.05, 6), accelerations=5.0 * np.arange(12.0).reshape(6, 2)
    ),
    "sine": sp.HandMotion.sine(0.002, 25.0, 0.3, tilt=0.4),
    "constant": sp.HandMotion.constant((30.0, 20.0), 0.2),
}
# Tips slip and open.
SHOVED = replace(
    LIKE,
    contact="unilateral",
    friction=0.4,
    disturbances=[sp.Pulse(time=0.02, duration=0.01, force=(60.0, 0.0))],
    duration=0.06,
)
exponents = st.integers(-6, 6)


@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=6)
@given(st.sampled_from([UNLIKE, SHOVED]), exponents, exponents, exponents)
def test_powers_of_two_of_length_mass_and_time_scale_a_motion_to_the_bit(
    name: str, scene: sp.Scene, length: int, mass: int, time: int
) -> None:
    scene, units = replace(scene, motion=KINDS[name]), Units(length, mass, time)
    scaled = units.scene(scene)
    if name == "shaken":
        # The amplitude of a hand that sways is an angle.
        scaled = scaled.with_({"motion.amplitude": scene.motion.to_dict()["amplitude"]})
    gains = sp.Stabilization()
    soft = sp.Stabilization(alpha=gains.alpha / units.time, beta=gains.beta / units.time)
    how: dict[str, Any] = {"record": EVERYTHING, "every": 7}
    run = sp.simulate(scene, dt=1e-4, **how)
    other = sp.simulate(scaled, dt=1e-4 * units.time, stabilization=soft, **how)
    require_scaled(run, other, units)
    assert run.energy.motion_work.any()
    joules = units.of(2, 1, -2)
    np.testing.assert_array_equal(other.energy.motion_work, run.energy.motion_work * joules)
    np.testing.assert_array_equal(other.hand.position, run.hand.position * units.length)
    np.testing.assert_array_equal(other.hand.tilt, run.hand.tilt)
    np.testing.assert_array_equal(
        other.hand.acceleration, run.hand.acceleration * units.of(1, 0, -2)
    )
    for ours, theirs in zip(run.contact_changes, other.contact_changes, strict=True):
        assert theirs == ours._replace(time=ours.time * units.time)
