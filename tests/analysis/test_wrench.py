"""The largest wrenches, beside a closed form, slow simulations and symmetries."""

import math
import pickle
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import softpinch as sp
from resting import held
from transforms import Units

# Every violation that a limit can be.
STOPS = ("pulling", "slipping", "off_face", "separated", "crushed", "folded")
# Trapezoidal steps along the no-slip constraint, and their error as a share of a limit: with one
# step it is 5e-3 in the worst of 4000 random grasps, and a quarter with twice the steps.
STEPS, WAY = 8, 3e-4
OBLIQUE = (-0.3, -1.0, 0.02)


def tipped(coupling: float, degrees: float = 6.0, **changes: Any) -> sp.Scene:
    """A grasp with driven fingers, whose tips have this tilt coupling."""
    scene = held(degrees, fingers="driven")
    hand = replace(scene.hand, tip=replace(scene.hand.tip, tilt_coupling=coupling))
    return replace(scene, hand=hand, **changes)


@cache
def offset() -> sp.Scene:
    """A grasp without symmetry, in which the tips slip first."""
    return held(fingers="driven", friction=0.6, grasped=sp.GraspedObject(com_offset=2e-3))


@pytest.mark.parametrize("coupling", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_slip_of_an_upright_grasp_has_a_closed_form(coupling: float, sign: float) -> None:
    mu, scene = 0.4, tipped(coupling, friction=0.4)
    limits = sp.wrench_limits(scene, [[0.0, sign, 0.0]])
    rest = limits.equilibrium
    assert rest.state is not None
    # Upright and symmetric, only the shear changes. With (5), lambda^N = s mu lambda^H is
    # mu t^2 + 2 d (mu c T - s) t + d^2 (mu / cos^2 - s c T) = 0 for t = d_t, T = tan(theta_i). Both
    # lambda^N together carry the weight less the force, so an upward force makes s negative.
    d, tilt = rest.state.q[5], rest.state.q[3]
    stiffness = math.pi * scene.hand.tip.youngs_modulus
    tan, secant = math.tan(tilt), 1.0 / math.cos(tilt) ** 2
    roots = np.roots([
        mu,
        2.0 * d * (mu * coupling * tan + sign),
        d * d * (mu * secant + sign * coupling * tan),
    ])  # fmt: skip
    t = roots[np.argmin(np.abs(roots))].real
    along = stiffness * (coupling * d * d * tan + 2.0 * d * t)
    weight = scene.grasped.mass * scene.gravity
    assert limits.limit.tolist() == ["slipping"]
    np.testing.assert_allclose(sign * limits.magnitude[0], weight - 2.0 * along, rtol=1e-9)
    np.testing.assert_allclose(limits.q[0, 7:], t, rtol=1e-9)
    np.testing.assert_allclose(
        limits.q[0, :7], [0.0, limits.q[0, 1], 0.0, *rest.state.q[3:7]], atol=1e-12
    )


def slowly(scene: sp.Scene, limits: sp.WrenchLimits, k: int, time: float) -> tuple[str, float]:
    """The status with which a run ends, and its wrench as a multiple of the limit: a slow ramp."""
    state = limits.equilibrium.state
    assert state is not None
    top = 1.25 * limits.wrench[k]
    load = sp.Sampled(
        times=[0.0, time], force=[[0.0, 0.0], top[:2]], moment=[0.0, top[2]], hold="linear"
    )
    ramp = replace(scene, initial=replace(state, time=0.0), disturbances=(load,), duration=time)
    run = sp.simulate(ramp, 1e-3, method="radau5", formulation="nullspace", stop_on=STOPS)
    return run.status, 1.25 * float(run.t[-1]) / time


@pytest.mark.parametrize(
    ("scene", "directions"),
    [
        (offset(), [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), OBLIQUE]),
        (replace(offset(), fingers="pid"), [(0.0, 1.0, 0.0), OBLIQUE]),
        (tipped(-1.0, grasped=sp.GraspedObject(height=0.02)), [(1.0, 0.5, 0.0), (0.0, -1.0, 0.0)]),
        (tipped(0.0, 12.0), [(1.0, 0.2, 0.0), (0.0, 0.0, -1.0)]),
        (tipped(-1.0), [(-1.0, -0.36, 0.0)]),
    ],
    ids=["slipping", "pid", "off_face", "crushed", "separated"],
)  # fmt: skip
def test_a_force_that_grows_slowly_loses_the_grasp_at_the_limit(
    scene: sp.Scene, directions: list[tuple[float, float, float]]
) -> None:
    """The run's lag is proportional to the rate: half the rate, half the difference."""
    limits = sp.wrench_limits(scene, directions)
    for k, limit in enumerate(limits.limit.tolist()):
        (first, fast), (second, slow) = (slowly(scene, limits, k, time) for time in (8.0, 16.0))
        assert first == second == limit
        assert abs(slow - 1.0) < 0.004
        # The instants are known to a step, 1e-3 s of 8 s.
        assert 2.0 * slow - fast == pytest.approx(1.0, abs=6e-4)


@pytest.mark.parametrize("direction", [(1.0, 0.5, 0.0), (-0.2, 1.0, 0.0)])
def test_beyond_a_fold_the_grasp_is_lost_and_before_it_is_not(
    direction: tuple[float, float, float],
) -> None:
    scene = tipped(1.0, grasped=sp.GraspedObject(com_offset=2e-3))
    limits = sp.wrench_limits(scene, [direction])
    state = limits.equilibrium.state
    assert limits.limit.tolist() == ["unstable"] and state is not None
    for share, status in ((0.98, "completed"), (1.02, "separated")):
        load = share * limits.wrench[0]
        step = sp.Sampled(
            times=[0.0, 10.0], force=[[0, 0], load[:2]], moment=[0.0, 0.0], hold="linear"
        )
        ramp = replace(scene, initial=replace(state, time=0.0), disturbances=(step,), duration=30.0)
        run = sp.simulate(ramp, method="radau5", tolerance=1e-9, formulation="nullspace")
        assert run.status == status


@settings(max_examples=40, deadline=None)
@given(
    mass=st.floats(0.05, 2.0),
    offset=st.floats(-5e-3, 5e-3),
    degrees=st.floats(3.0, 12.0),
    turn=st.floats(-math.pi, math.pi),
    moment=st.floats(-1.0, 1.0),
    share=st.floats(0.1, 0.9),
)
# Sharp folds near separation, which too long steps pass: a jump to another branch.
@example(mass=0.109375, offset=0.0, degrees=3.5, turn=0.109375, moment=0.109375, share=0.5)
@example(mass=1.5266, offset=-8.1834e-4, degrees=6.17578125, turn=0.1, moment=0.0, share=0.5)
def test_a_part_of_the_wrench_that_acts_already_is_missing_at_the_limit(
    mass: float, offset: float, degrees: float, turn: float, moment: float, share: float
) -> None:
    """The limit does not depend on where the search begins on the way to it."""
    grasped = sp.GraspedObject(mass=mass, com_offset=offset, height=0.049)
    scene = held(degrees, fingers="driven", friction=0.7, grasped=grasped)
    direction = np.array([math.cos(turn), math.sin(turn), 0.02 * moment])
    whole = sp.wrench_limits(scene, [direction])
    before = whole.equilibrium
    if whole.magnitude[0] == 0.0 or before.state is None:
        return
    # The way there in steps of the no-slip constraint, each by the trapezoidal rule.
    state, loaded = before.state, scene
    for k in range(1, STEPS + 1):
        x, y, about = share * k / STEPS * whole.wrench[0]
        loaded = replace(scene, disturbances=[sp.Step(time=0.0, force=(x, y), moment=about)])
        state = sp.equilibrium(loaded, near=state).state
        assert state is not None
    part = sp.wrench_limits(loaded, [direction], near=state)
    assert part.limit.tolist() == whole.limit.tolist()
    assert part.magnitude[0] == pytest.approx(
        (1.0 - share) * whole.magnitude[0], abs=WAY * whole.magnitude[0]
    )


def test_other_units_by_powers_of_two_give_the_same_bits() -> None:
    units, scene = Units(length=2, mass=-3, time=1), offset()
    directions = np.array([[1.0, 0.0, 0.0], [0.3, -0.7, 0.01], OBLIQUE])
    dimensions = np.array([units.of(1, 1, -2)] * 2 + [units.of(2, 1, -2)])
    limits = sp.wrench_limits(scene, directions)
    other = sp.wrench_limits(units.scene(scene), directions * dimensions)
    np.testing.assert_array_equal(other.magnitude, limits.magnitude)
    np.testing.assert_array_equal(other.q, limits.q * units.coordinates)
    assert other.weakest == limits.weakest * units.of(1, 1, -2)


def test_the_size_of_a_direction_does_not_matter() -> None:
    limits = sp.wrench_limits(offset(), [OBLIQUE, 8.0 * np.array(OBLIQUE)])
    assert limits.magnitude[0] == 8.0 * limits.magnitude[1]
    np.testing.assert_array_equal(*limits.wrench)


def test_at_the_limit_the_forces_balance_and_the_contact_is_about_to_slip() -> None:
    scene = offset()
    limits = sp.wrench_limits(scene)
    assert set(limits.limit.tolist()) == {"slipping"}
    for k in range(0, 74, 6):
        force, moment = limits.wrench[k, :2], float(limits.wrench[k, 2])
        loaded = replace(
            scene, disturbances=(sp.Step(time=0.0, force=tuple(force), moment=moment),)
        )
        found = sp.evaluate(loaded, 1.0, limits.q[k], np.zeros(9), formulation="nullspace")
        assert np.abs(found.accelerations[:3]).max() < 1e-6
        normal, along = found.multipliers[:2], np.abs(found.multipliers[2:])
        assert (along / normal).max() == pytest.approx(scene.friction, rel=1e-9)


def test_the_default_directions_and_the_weakest_of_them() -> None:
    limits = sp.wrench_limits(offset())
    assert limits.length == 0.5 * offset().grasped.width
    np.testing.assert_allclose(np.hypot(*limits.directions[:72, :2].T), 1.0, rtol=1e-15)
    turns = np.unwrap(np.arctan2(limits.directions[:72, 1], limits.directions[:72, 0]))
    np.testing.assert_allclose(turns, np.arange(72) * np.deg2rad(5.0), atol=1e-14)
    np.testing.assert_array_equal(limits.directions[72:], [[0, 0, 0.0245], [0, 0, -0.0245]])
    np.testing.assert_allclose(limits.size, limits.magnitude, rtol=1e-14)
    assert limits.weakest == limits.size.min()
    assert repr(limits).startswith(
        f"<WrenchLimits of 74 directions: weakest {limits.weakest:.6g} N"
    )
    short = sp.wrench_limits(offset(), length=1e-3)
    np.testing.assert_allclose(short.wrench[72:], limits.wrench[72:], rtol=1e-12)
    assert short.size[72] == pytest.approx(24.5 * limits.size[72])


def test_an_equilibrium_or_its_scene() -> None:
    scene = replace(sp.paper.manipulation(), friction=0.5)
    rest = sp.equilibrium(scene, 1.5, grip=(0.001, -0.002))
    limits = sp.wrench_limits(scene, time=1.5, grip=(0.001, -0.002))
    assert sp.wrench_limits(rest) == limits
    assert pickle.loads(pickle.dumps(limits)) == limits
    run = sp.simulate(replace(scene, duration=2.0), 1e-3, method="radau5")
    # The run ends where the targets switch; its rest is under those before.
    near = sp.wrench_limits(scene, [[0.0, 1.0, 0.0]], near=run)
    assert near.equilibrium.stable and near.limit.tolist() == ["slipping"]


def test_a_grasp_without_a_stable_rest_bears_nothing() -> None:
    apart = sp.wrench_limits(held(-5.0), [[0.0, 1.0, 0.0]])
    assert apart.limit.tolist() == ["apart"] and apart.weakest == 0.0
    assert np.isnan(apart.q).all()
    heavy = held(friction=2.0, grasped=sp.GraspedObject(mass=30.0))
    unstable = sp.wrench_limits(heavy, [[0.0, 1.0, 0.0]])
    assert not unstable.equilibrium.stable
    assert unstable.limit.tolist() == ["unstable"] and unstable.magnitude.tolist() == [0.0]
    slips = held(friction=0.001)
    for contact in ("bilateral", "unilateral"):
        limits = sp.wrench_limits(replace(slips, contact=contact), [[0.0, 1.0, 0.0]])
        assert limits.limit.tolist() == ["slipping"] and limits.magnitude.tolist() == [0.0]


def test_a_direction_without_limit_is_infinite() -> None:
    limits = sp.wrench_limits(tipped(-1.0, 12.0), [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert limits.limit.tolist()[0] == "none"
    assert limits.wrench[0].tolist() == [0.0, math.inf, 0.0]
    assert limits.size[0] == math.inf and limits.weakest == limits.size[1] < math.inf
