"""The largest acceleration of the hand: slow, against equilibria; in moves, against runs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp

SCHEDULE = sp.Schedule.in_degrees("steps", [0.0], [[8.0, 7.0]])
# Without integral action the fingers give way to their own inertial forces.
YIELDING = sp.Scene(
    friction=0.5,
    schedule=SCHEDULE,
    control=(sp.Pid(kp=60.0, ki=0.0), sp.Pid(kp=80.0, ki=0.0)),
    hand=sp.Hand(right=sp.Finger(mass=0.15, inertia=1e-3)),
    grasped=sp.GraspedObject.box(0.049, 0.049, 0.3),
)
LOSING = replace(
    YIELDING,
    contact="unilateral",
    control=sp.Pid(),
    hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
    grasped=replace(sp.GraspedObject.box(0.049, 0.049, 0.8), height=0.049),
)
SLANTED = [[1.0, 0.3], [-0.2, 1.0], [-1.0, -1.0], [0.1, -1.0]]


def accelerated(scene: sp.Scene, acceleration: Any, tilt: float = 0.0) -> sp.Scene:
    return replace(scene, motion=sp.HandMotion.constant(tuple(acceleration), tilt))


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_equilibria_hold_up_to_the_slow_limit_and_not_beyond(tilt: float) -> None:
    limits = sp.carry_limits(YIELDING, SLANTED, tilt=tilt)
    assert set(limits.cause) == {"slipping"}
    near = sp.equilibrium(accelerated(YIELDING, (0.0, 0.0), tilt))
    for direction, limit in zip(limits.direction, limits.limit, strict=True):
        for share in np.linspace(0.1, 1.0, 10):
            acceleration = share * 0.9999 * limit * direction
            near = sp.equilibrium(accelerated(YIELDING, acceleration, tilt), near=near.state)
            assert near.status == "at_rest" and "slipping" not in near.violations
        beyond = accelerated(YIELDING, 1.0001 * limit * direction, tilt)
        assert "slipping" in sp.equilibrium(beyond, near=near.state).violations
        near = sp.equilibrium(accelerated(YIELDING, (0.0, 0.0), tilt))


def test_a_hand_without_inertia_of_its_fingers_bears_what_a_force_on_the_object_is() -> None:
    """Fingers with integral action stand at their targets, whatever acts on them."""
    scene = replace(YIELDING, control=sp.Pid())
    limits = sp.carry_limits(scene, SLANTED)
    forces = np.column_stack([-limits.direction, np.zeros(len(SLANTED))])
    found = sp.wrench_limits(scene, forces).magnitude / scene.grasped.mass
    np.testing.assert_allclose(limits.limit, found, rtol=1e-9)


def test_several_tilts_are_those_of_single_calls() -> None:
    tilts = np.array([0.0, 0.4, 2.5])
    limits = sp.carry_limits(YIELDING, SLANTED, tilt=tilts)
    assert limits.limit.shape == limits.cause.shape == (3, 4)
    assert isinstance(limits.equilibrium, tuple) and "weakest" in repr(limits)
    for k, tilt in enumerate(tilts):
        alone = sp.carry_limits(YIELDING, SLANTED, tilt=tilt)
        np.testing.assert_array_equal(limits.limit[k], alone.limit)
        np.testing.assert_array_equal(limits.cause[k], alone.cause)
        assert limits.equilibrium[k] == alone.equilibrium and alone.tilt == tilt


def test_without_gravity_the_limits_turn_with_the_hand() -> None:
    weightless = replace(YIELDING, gravity=0.0)
    tilt = 0.7
    turn = np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
    upright = sp.carry_limits(weightless, SLANTED)
    turned = sp.carry_limits(weightless, np.array(SLANTED) @ turn, tilt=[tilt])
    # The length of the steps, in which no-slip is integrated, depends on the direction.
    np.testing.assert_allclose(turned.limit[0], upright.limit, rtol=1e-5)


def test_an_equilibrium_in_a_tilted_hand_is_one_in_a_turned_gravity() -> None:
    tilt, g = 0.3, YIELDING.gravity
    tilted = sp.equilibrium(accelerated(YIELDING, (0.0, 0.0), tilt))
    turned = (g * np.sin(tilt), g * np.cos(tilt) - g)
    theirs = sp.equilibrium(accelerated(YIELDING, turned))
    assert tilted.state is not None and theirs.state is not None
    np.testing.assert_allclose(tilted.state.q, theirs.state.q, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(np.sort(tilted.eigenvalues), np.sort(theirs.eigenvalues), rtol=1e-9)


@pytest.mark.parametrize("profile", ["trapezoid", "minimum_jerk"])
def test_moves_hold_below_the_limit_and_are_lost_above(profile: Any) -> None:
    limits = sp.carry_limits(LOSING, [[0.0, 1.0]], profile=profile, distance=0.1)
    (limit,) = limits.limit
    assert limits.cause.tolist() == ["lost"]
    factor = {"trapezoid": 2.0, "minimum_jerk": np.sqrt(10.0 / np.sqrt(3.0))}[profile]
    rest = limits.equilibrium
    for share, holds in ((1.0, True), (1.003, False)):
        peak = share * limit
        times = [rest.time, rest.time + factor * np.sqrt(0.1 / peak)]
        points = [[0.0, 0.0], [0.0, 0.1]]
        made = sp.HandMotion.trapezoid(times, points, peak)
        if profile == "minimum_jerk":
            made = sp.HandMotion.minimum_jerk(times, points)
            fine = np.linspace(*times, 2001)
            assert np.abs(made.at(fine).acceleration).max() == pytest.approx(peak, rel=1e-5)
        duration = times[1] - times[0] + 0.1
        moved = LOSING.with_({"initial": rest.state, "duration": duration, "motion": made})
        assert sp.simulate(moved).holds == holds


def test_a_mirrored_grasp_has_mirrored_limits() -> None:
    scene = replace(YIELDING, hand=sp.Hand(), control=sp.Pid(), schedule=sp.Schedule.in_degrees(
        "steps", [0.0], [[8.0, 8.0]]))  # fmt: skip
    limits = sp.carry_limits(scene)
    mirrored = np.array([(36 - k) % 72 for k in range(72)])
    np.testing.assert_allclose(limits.limit[mirrored], limits.limit, rtol=1e-8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"directions": [[0.0, 0.0]]}, r"directions\[0\] = \(0, 0\): must not be zero"),
        ({"profile": "circle"}, "profile = 'circle'"),
        ({"profile": "trapezoid"}, "bilateral one is never lost"),
        ({"profile": "trapezoid", "distance": 0.0}, "distance"),
        ({"tilt": np.nan}, "tilt"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sp.carry_limits(YIELDING, **arguments)
    turning = replace(
        YIELDING, motion=sp.HandMotion.minimum_jerk([0.0, 1.0], [[0, 0], [0, 0]], [0.0, 1.0])
    )
    with pytest.raises(ValueError, match=r"turns at t = 0\.5 s"):
        sp.equilibrium(turning, time=0.5)
    with pytest.raises(ValueError, match="has a motion already"):
        sp.carry_limits(turning, tilt=0.1)


def test_a_grasp_that_is_not_at_rest_bears_nothing() -> None:
    far = replace(YIELDING, schedule=sp.Schedule.in_degrees("steps", [0.0], [[-5.0, -5.0]]))
    limits = sp.carry_limits(far, [[1.0, 0.0]])
    assert limits.limit.tolist() == [0.0] and limits.cause.tolist() == [limits.equilibrium.status]


# The same gains as a digital controller, whose loop is stable at rest.
SAMPLED = replace(LOSING, control=sp.SampledController.pid(1e-3, kp=20.0, kd=0.2, ki=100.0))
UP = [[0.0, 1.0]]


def test_the_slow_limits_refuse_a_sampled_controller_by_name() -> None:
    rest = sp.equilibrium(SAMPLED)
    assert rest.stable
    for grasp in (SAMPLED, rest):
        message = r"Scene\.control=SampledController.*: .* carry_limits\(profile=\.\.\.\)"
        with pytest.raises(ValueError, match=message):
            sp.carry_limits(grasp, UP)
        with pytest.raises(ValueError, match=message):
            sp.wrench_limits(grasp, [[0.0, 1.0, 0.0]])


def test_moves_find_the_limit_under_a_sampled_controller() -> None:
    limits = sp.carry_limits(SAMPLED, UP, profile="trapezoid", distance=0.1)
    plain = sp.carry_limits(LOSING, UP, profile="trapezoid", distance=0.1)
    assert limits.cause.tolist() == ["lost"]
    assert 0.5 * plain.limit[0] < limits.limit[0] < 2.0 * plain.limit[0]


def test_a_loop_that_is_unstable_at_rest_bears_no_move() -> None:
    control = sp.SampledController.pid(1e-3, kp=200.0, kd=0.2, ki=1000.0, delay=2e-2)
    limits = sp.carry_limits(replace(SAMPLED, control=control), UP, profile="trapezoid")
    assert limits.limit.tolist() == [0.0] and limits.cause.tolist() == ["unstable"]


def test_the_limit_of_moves_is_below_every_loss_that_is_found() -> None:
    """Slower moves than those that are just held may be lost, at other phases of the swing."""
    scene = sp.Scene(
        contact="unilateral",
        friction=0.35,
        hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),
        grasped=sp.GraspedObject.box(0.049, 0.049, 0.8),
        schedule=sp.Schedule.in_degrees("steps", [0.0], [[8.0, 8.0]]),
    )
    limits = sp.carry_limits(scene, [[0.0, -1.0]], profile="trapezoid", distance=0.3)
    rest = limits.equilibrium
    assert rest.state is not None

    def holds(peak: float) -> bool:
        times = [rest.time, rest.time + 2.0 * np.sqrt(0.3 / peak)]
        motion = sp.HandMotion.trapezoid(times, [[0.0, 0.0], [0.0, -0.3]], peak)
        changes = {"initial": rest.state, "duration": times[1] - times[0] + 0.1, "motion": motion}
        return sp.simulate(scene.with_(changes)).holds

    # The first bisection ends at 107 m/s^2, above a range of peaks that are lost.
    assert holds(107.0) and not holds(96.0)
    (limit,) = limits.limit
    assert limit == pytest.approx(93.2, abs=0.3)
    assert holds(limit) and not holds(1.003 * limit)


LIGHT = replace(LOSING, hand=sp.Hand(tip=sp.Fingertip(normal_mass=1e-5, tangential_mass=1e-5)))


def test_a_numerical_failure_is_no_limit_of_the_grasp() -> None:
    message = r'profile: .* a peak of \S+ m/s\^2 .*"(unstable|lost)".* method="radau5"'
    with pytest.raises(ValueError, match=message):
        sp.carry_limits(LIGHT, UP, profile="minimum_jerk")
    how: dict[str, Any] = {"profile": "minimum_jerk", "method": "radau5", "tolerance": 1e-6}
    stiff, heavier = sp.carry_limits(LIGHT, UP, **how), sp.carry_limits(LOSING, UP, **how)
    assert stiff.cause.tolist() == ["lost"]
    assert stiff.limit[0] == pytest.approx(heavier.limit[0], rel=0.2)


def test_the_options_are_those_of_simulate() -> None:
    with pytest.raises(ValueError, match="dt = 0"):
        sp.carry_limits(LOSING, UP, profile="trapezoid", dt=0.0)
    with pytest.raises(ValueError, match='"radau5"'):
        sp.carry_limits(LOSING, UP, profile="trapezoid", method="rk5")  # type: ignore[arg-type]
    how: dict[str, Any] = {"profile": "trapezoid", "distance": 0.1}
    finer = sp.carry_limits(LOSING, UP, formulation="projected", dt=5e-5, **how)
    assert finer.limit == pytest.approx(sp.carry_limits(LOSING, UP, **how).limit, rel=2e-3)
    how |= {"method": "radau5", "tolerance": 1e-6}
    tilted = sp.carry_limits(LOSING, UP, tilt=[0.0], **how)
    np.testing.assert_array_equal(tilted.limit[0], sp.carry_limits(LOSING, UP, **how).limit)


@pytest.mark.parametrize(
    "motion",
    [
        sp.HandMotion.constant((0.0, 5.0)),
        sp.HandMotion.sine(0.01, 5.0, "y"),
        sp.HandMotion.minimum_jerk([0.0, 0.1], [[0.0, 0.0], [0.0, 0.1]]),
    ],
)
def test_a_move_does_not_replace_another_motion_without_a_word(motion: sp.HandMotion) -> None:
    scene = replace(LOSING, motion=motion)
    for grasp in (scene, sp.equilibrium(scene)):
        with pytest.raises(ValueError, match=r"Scene\.motion: .*profile.* must be None or"):
            sp.carry_limits(grasp, UP, profile="trapezoid")
