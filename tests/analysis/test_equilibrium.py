"""Equilibria: all forces balance, a simulation stays, and the family is complete."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import oracle
import softpinch as sp
from softpinch import strategies
from softpinch.support.arrays import Floats
from transforms import Units

LAWS = ("pid", "pid without integral", "torque", "driven")
# A run stays at an unstable equilibrium as long as deviations grow by less than exp of this.
GROWN = 8.0


def target(scene: sp.Scene, angles: object) -> sp.Scene:
    return replace(scene, schedule=sp.Schedule.steps([0.0], [angles]), duration=1.0)


@st.composite
def resting_scenes(draw: st.DrawFn, law: str) -> sp.Scene:
    """Scenes that hold constant targets, or constant torques, with forces that begin at once."""
    fingers = "driven" if law == "driven" else "pid"
    scene = draw(strategies.scenes(spread=0.2, most_disturbances=0, fingers=fingers))
    start = scene.start().q
    push = draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3))
    load = sp.Step(time=0.0, force=push[:2], moment=5e-3 * push[2])
    initial = None if law == "driven" else "touching"
    scene = replace(scene, initial=initial, disturbances=(load,))
    if law == "torque":
        return target(replace(scene, control=sp.Torque()), held_by(draw, scene))
    if law == "pid without integral":
        pids = scene.control if isinstance(scene.control, tuple) else (scene.control,) * 2
        scene = replace(scene, control=tuple(replace(pid, ki=0.0) for pid in pids))
    closed = start[3:5] + np.radians(draw(st.tuples(*[st.floats(2.0, 8.0)] * 2)))
    return target(scene, closed)


def held_by(draw: st.DrawFn, scene: sp.Scene) -> list[float]:
    """Torques that press both tips with a force that they bear, and balance the push in x."""
    share = draw(st.floats(0.1, 0.25))
    # (5): the force that presses a tip by this share of its radius.
    press = min(np.pi * tip.youngs_modulus * (share * tip.radius) ** 2 for tip in scene.hand.tips)
    half, angles = 0.5 * pushes(scene)[0], scene.start().q[3:5]
    forces = (press + half, press - half)
    return [
        force * (finger.length * np.cos(angle) - finger.half_thickness * np.sin(angle))
        for force, finger, angle in zip(
            forces, (scene.hand.right, scene.hand.left), angles, strict=True
        )
    ]


def pushes(scene: sp.Scene) -> Floats:
    step = scene.disturbances[0]
    return np.array([*step.force, step.moment])


def held_still(scene: sp.Scene, found: sp.Equilibrium) -> float:
    """The distance of a run of one second from the equilibrium; a radian counts as a metre.

    What the equilibrium lacks to the exact one grows at an unstable one: there the share of it is
    returned that does not come from this, and the simulation is shorter if it grows fast.
    """
    assert found.state is not None
    growth = max(found.growth, 0.0)
    duration = min(1.0, GROWN / max(growth, GROWN))
    scene = replace(scene, initial=replace(found.state, time=0.0), duration=duration)
    run = sp.simulate(scene, method="radau5", tolerance=1e-10, formulation="nullspace")
    assert run.status == "completed"
    return float(np.abs(run.q - found.state.q).max() / np.exp(growth * duration))


@pytest.mark.parametrize("law", LAWS)
@given(data=st.data())
@settings(max_examples=5, deadline=None)
def test_all_accelerations_vanish_in_the_oracle_and_a_run_stays(
    law: str, data: st.DataObject
) -> None:
    scene = data.draw(resting_scenes(law))
    found = sp.equilibrium(scene, time=0.0)
    assume(found.state is not None)
    assert found.state is not None
    state, torque = found.state, found.torque
    pid = replace(scene, control=sp.Pid(kp=0.0, kd=0.0, ki=1.0), fingers="pid")
    # The oracle has PIDs only: an integral with the gain 1 gives the torque.
    terms = oracle.evaluate(
        oracle.parameters(pid), state.q, state.p, -torque, state.q[3:5], pushes(scene)
    )
    assert np.abs(terms.accelerations.value / terms.accelerations.scale).max() < 1e-12
    assert np.abs(terms.residuals.value[:2]).max() < 1e-15
    scale = np.abs(terms.multipliers.value).max()
    assert np.abs(found.multipliers - terms.multipliers.value).max() < 1e-12 * scale
    assert held_still(scene, found) < 1e-12


def test_zero_shears_have_no_equilibrium_in_the_paper() -> None:
    """The reason why `grip` and not `shear` tells the members apart.

    In an upright symmetric grasp the height enters no force, and the shears carry the weight.
    """
    scene = target(sp.Scene(), np.radians([6.0, 6.0]))
    found = sp.equilibrium(scene)
    assert found.state is not None
    q, area = found.state.q, np.pi * sp.Fingertip().youngs_modulus
    # (5): lambda^N = pi E (kappa d_n^2 tan(theta_p) + 2 d_n d_t) carries half of the weight.
    shear = (0.5 * 0.981 / area - q[5] ** 2 * np.tan(q[3])) / (2.0 * q[5])
    assert q[7:] == pytest.approx([shear, shear], rel=1e-12)
    none = sp.equilibrium(scene, shear=(0.0, 0.0))
    assert none.state is None and none.status == "not_found"
    higher = sp.equilibrium(scene, grip=(-1e-3, -1e-3))
    assert higher.state is not None
    assert higher.state.q[7:] == pytest.approx(q[7:], rel=1e-12)
    assert higher.state.q[1] - q[1] == pytest.approx(1e-3, rel=1e-9)


@given(data=st.data(), law=st.sampled_from(LAWS))
@settings(max_examples=10, deadline=None)
def test_grip_shear_and_near_name_the_same_member(data: st.DataObject, law: str) -> None:
    scene = data.draw(resting_scenes(law))
    grip = data.draw(st.tuples(*[st.floats(-2e-3, 2e-3)] * 2))
    found = sp.equilibrium(scene, grip=grip)
    assume(found.state is not None)
    assert found.state is not None
    assert found.grip == pytest.approx(grip, abs=1e-15)
    again = sp.equilibrium(scene, near=found.state)
    assert again.state is not None
    assert np.abs(again.state.q - found.state.q).max() < 1e-12
    theirs = sp.equilibrium(scene, shear=found.state.q[7:], near=found.state)
    # Where both shears hardly change along the family, they do not tell its members apart.
    smallest = np.linalg.svd(found.neutral[:, 7:], compute_uv=False)[-1]
    if smallest > 1e-6:
        assert theirs.state is not None
        assert np.abs(theirs.state.q - found.state.q).max() < 1e-15 / smallest
        assert np.array_equal(theirs.state.q[7:], found.state.q[7:])


@given(data=st.data(), law=st.sampled_from(LAWS))
@settings(max_examples=10, deadline=None)
def test_neutral_directions_are_the_tangent_of_the_family(data: st.DataObject, law: str) -> None:
    scene = data.draw(resting_scenes(law))
    found = sp.equilibrium(scene)
    assume(found.state is not None and found.stable)
    lengths = [1, 1, 0.02, 0.02, 0.02, 1, 1, 1, 1]

    def slope(k: int, step: float) -> Floats:
        """The central difference of q by the grip of a tip."""
        ends = []
        for sign in (1.0, -1.0):
            member = sp.equilibrium(scene, grip=sign * step * np.eye(2)[k], near=found.state)
            assert member.state is not None
            ends.append(member.state.q)
        return (ends[0] - ends[1]) / (2.0 * step)

    for k, direction in enumerate(found.neutral):
        coarse, fine = slope(k, 4e-6), slope(k, 2e-6)
        best = fine + (fine - coarse) / 3.0
        scale = np.abs(best * lengths).max()
        # The family of a hand that torques hold can bend sharply.
        allowed = 1e-6 * scale + np.abs((fine - coarse) * lengths).max()
        assert np.abs((direction - best) * lengths).max() < allowed


@given(data=st.data(), exponents=st.tuples(*[st.integers(-3, 3)] * 3))
@settings(max_examples=10, deadline=None)
def test_other_units_give_the_same_bits(
    data: st.DataObject, exponents: tuple[int, int, int]
) -> None:
    scene = data.draw(resting_scenes("pid"))
    units = Units(*exponents)
    here, there = sp.equilibrium(scene), sp.equilibrium(units.scene(scene))
    assert here.status == there.status
    if here.state is None or there.state is None:
        return
    assert np.array_equal(there.state.q, here.state.q * units.coordinates)
    assert np.array_equal(there.multipliers, here.multipliers * units.of(1, 1, -2))
    assert there.energy == here.energy * units.of(2, 1, -2)
    assert there.stable == here.stable and there.minimum == here.minimum


def test_forces_hold_as_they_are_at_the_instant() -> None:
    """Steps and pulses count while they last; sines, noise and impulses do not."""
    free = sp.Scene(duration=2.0)
    loads = (
        sp.Step(time=0.5, force=(2.0, 0.0)),
        sp.Pulse(time=1.0, duration=0.25, force=(0.0, 3.0), moment=0.01),
    )
    idle = (
        sp.Sine(frequency_hz=3.0, force=(5.0, 5.0)),
        sp.Noise(force_std=4.0, moment_std=0.1, rate_hz=100.0),
        sp.Impulse(time=1.1, impulse=(0.1, 0.1)),
    )
    scene = replace(free, disturbances=(*loads, *idle))
    for time, force in (
        (0.25, (0, 0, 0)),
        (0.5, (2, 0, 0)),
        (1.1, (2, 3, 0.01)),
        (None, (2, 0, 0)),
    ):
        found = sp.equilibrium(scene, time)
        step = sp.Step(time=0.0, force=force[:2], moment=force[2])
        expected = sp.equilibrium(replace(free, disturbances=(step,)))
        assert found.state is not None and expected.state is not None
        assert np.array_equal(found.state.q, expected.state.q), time


def test_an_unstable_equilibrium_grows_as_its_eigenvalue_says() -> None:
    """Two constant torques hold the object, but nothing holds the fingers' common motion."""
    scene = replace(target(sp.Scene(control=sp.Torque()), [1.2, 1.2]), duration=4.0)
    found = sp.equilibrium(scene)
    assert found.state is not None and not found.stable
    assert "grows with" in found.message
    rate = found.eigenvalues[2].real
    nudged = found.state.q.copy()
    nudged[0] += 1e-9
    angles = nudged[3:5]
    start = sp.State.consistent(scene, x=nudged[0], y=nudged[1], fingers=angles, shear=nudged[7:])
    run = sp.simulate(
        replace(scene, initial=start), tolerance=1e-12, method="dop853", times=[2.0, 3.0, 4.0],
        formulation="nullspace",
    )  # fmt: skip
    away = np.abs(run.q[:, 0] - found.state.q[0])
    growth = np.log(away[1:] / away[:-1])
    assert growth == pytest.approx(rate, rel=1e-3)


def test_far_starts_reach_the_same_equilibrium() -> None:
    """From states at which Newton's method fails, the object is released slowly."""
    scene = sp.Scene()
    home = sp.equilibrium(scene)
    assert home.state is not None
    rng = np.random.default_rng(7)
    for _ in range(20):
        q = home.state.q.copy()
        q[:3] += rng.uniform(-1, 1, 3) * [2e-3, 2e-3, 0.3]
        near = sp.State.consistent(
            scene, x=q[0], y=q[1], rotation=q[2], fingers=q[3:5], shear=q[7:]
        )
        if near.q[5:7].min() <= 0.0:
            continue
        found = sp.equilibrium(scene, near=near, grip=home.grip)
        assert found.state is not None
        assert np.abs(found.state.q - home.state.q).max() < 1e-12


def test_a_contact_without_a_limit_of_friction_has_a_margin_without_end() -> None:
    """Even of a tip that pulls, which needs infinite friction."""
    for friction, margin in (
        (None, np.inf),
        (np.inf, np.inf),
        ((0.5, np.inf), 0.3),
        (0.5, -np.inf),
    ):
        found = sp.equilibrium(sp.Scene(friction=friction))
        pulling = replace(found, multipliers=np.array([10.0, -1.0, -2.0, 1.0]))
        assert pulling.friction_margin == pytest.approx(margin)


def test_a_bilateral_rest_names_the_slip_that_it_ignores() -> None:
    scene = sp.Scene(friction=0.3, grasped=sp.GraspedObject(mass=10.0))
    found = sp.equilibrium(scene)
    assert found.stable and found.violations == ("slipping",)
    assert "a tip would slip" in found.message
    assert found.friction_margin == pytest.approx(0.3 - found.friction_needed.max())
