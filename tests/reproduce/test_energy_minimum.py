"""Minima of the energy around a rest, beside SciPy, differences, and the core's terms."""

from dataclasses import replace

import numpy as np
import pytest

import random_hands
import scenes
import softpinch as sp
from softpinch import paper
from softpinch.reproduce import energy_minimum as e
from softpinch.reproduce import verdict as v

pytest.importorskip("scipy")
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

UNEVEN = replace(scenes.uneven(), duration=4.0)
TURNED = replace(
    sp.Scene(), schedule=sp.Schedule.steps([0.0], np.deg2rad([[-4, 16]])), duration=4.0
)


def rest_of(scene: sp.Scene) -> e.Rest:
    run = random_hands.settle(scene)
    assert run.success
    return e.rest_at(scene, run.q[-1], float(run.t[-1]))


@pytest.fixture(scope="module")
def uneven() -> e.Rest:
    return rest_of(UNEVEN)


@pytest.fixture(scope="module")
def turned() -> e.Rest:
    return rest_of(TURNED)


@pytest.fixture(scope="module", params=[UNEVEN, TURNED], ids=["uneven", "turned"])
def rest(request: pytest.FixtureRequest, uneven: e.Rest, turned: e.Rest) -> e.Rest:
    return uneven if request.param is UNEVEN else turned


@pytest.fixture(scope="module")
def operations() -> sp.Run:
    return sp.simulate(paper.manipulation(), dt=2e-4, record=("state",))


def energy(scene: sp.Scene, q: np.ndarray) -> float:
    """Elastic energy and gravity from the core."""
    found = sp.evaluate(scene, 0.0, q, np.zeros(9)).energies
    return found.elastic + found.gravity


def softest(rest: e.Rest) -> float:
    """The least second derivative of the energy that the stiffness gives on the ways, N/m."""
    unit = np.array([1.0, 1.0, 1.0 / max(tip.radius for tip in rest.found.scene.hand.tips)])
    ways = e.WAYS * unit
    return float(np.einsum("ni,ij,nj->n", ways, rest.found.stiffness, ways).min())


def led(scene: sp.Scene, q: np.ndarray, velocity, end: float) -> np.ndarray:  # type: ignore[no-untyped-def]
    """The coordinates to which the no-slip constraint leads, by SciPy on the core's matrix (25)."""

    def rates(t: float, at: np.ndarray) -> np.ndarray:
        moving = np.zeros(9)
        moving[:3] = velocity(t)
        # The last four columns of the matrix are the identity.
        moving[5:] = -sp.evaluate(scene, 0.0, at, np.zeros(9)).constraint_matrix @ moving
        return moving

    found = solve_ivp(rates, (0.0, end), q, method="DOP853", rtol=1e-12, atol=1e-14)
    return np.asarray(found.y[:, -1])


def test_ways_without_slip_are_those_that_scipy_integrates(rest: e.Rest) -> None:
    scene, rng = rest.found.scene, np.random.default_rng(2)
    for way in rng.normal(size=(3, 3)) * [1.0, 1.0, 60.0]:
        (ours,) = e.without_slip(scene, rest.q, way, [2e-3])
        theirs = led(scene, rest.q, lambda _, way=way: way, 2e-3)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-14)
        residuals = sp.evaluate(scene, 0.0, ours, np.zeros(9)).residuals
        np.testing.assert_allclose(residuals[:2], 0.0, atol=1e-16)


def test_the_rest_is_a_minimum_on_straight_and_on_curved_ways(rest: e.Rest) -> None:
    scene = rest.found.scene
    symmetric = 0.5 * (rest.found.stiffness + rest.found.stiffness.T)
    assert v.is_minimum(rest) and rest.found.minimum and rest.found.stable
    assert rest.curvature == pytest.approx(softest(rest), rel=1e-6)
    assert rest.turning == pytest.approx(symmetric[2, 2], rel=1e-4)
    # A curve's second derivative at rest depends on its direction alone.
    first, bend = np.array([0.6, -0.5, 40.0]), np.array([30.0, 40.0, -900.0])
    step = 2e-5
    ends = [led(scene, rest.q, lambda s, d=d: d * first + s * bend, step) for d in (1.0, -1.0)]
    total = sum(energy(scene, end) for end in ends) - 2.0 * energy(scene, rest.q)
    assert total / step**2 == pytest.approx(first @ symmetric @ first, rel=1e-4)


def test_without_gravity_elastic_energy_alone_has_a_minimum_there(rest: e.Rest) -> None:
    scene = replace(rest.found.scene, gravity=0.0)
    slope, curvature, rise = e.around(scene, e.coordinates(rest.weightless))
    assert slope < 1e-4 and curvature > 0.0 and rise > 0.0
    # With gravity its slope in y is what carries the object.
    weight = rest.found.scene.grasped.mass * rest.found.scene.gravity
    assert rest.elastic_slope == pytest.approx(-weight, rel=1e-11)
    places = e.without_slip(scene, rest.q, (0.0, 1.0, 0.0), [-1e-6, 1e-6])
    before, after = e.energies(scene, places)[0]
    assert (after - before) / 2e-6 == pytest.approx(-weight, rel=1e-6)
    # The weight moves the object by what the stiffness gives way, all but for its second order.
    moved = np.linalg.solve(rest.found.stiffness, [0.0, weight, 0.0])
    difference = e.coordinates(rest.weightless)[:3] - rest.q[:3]
    np.testing.assert_allclose(difference, moved, rtol=0.02, atol=0.01 * np.abs(moved[1]))


def test_many_loops_let_the_object_down_to_another_rest_with_less_energy(
    operations: sp.Run,
) -> None:
    rest = e.rests(operations)[6]
    scene, q, loops = rest.found.scene, rest.q, 30
    sides = {0: 1e-3, 2: np.deg2rad(1.0)}
    for _ in range(loops):
        for k, way in ((0, 1.0), (2, 1.0), (0, -1.0), (2, -1.0)):
            (q,) = e.without_slip(scene, q, way * sides[k] * np.eye(3)[k], [1.0])
    np.testing.assert_allclose(q[:7], rest.q[:7], rtol=0, atol=1e-13)
    other = sp.equilibrium(scene, near=sp.State(q, time=rest.found.time))
    assert other.state is not None and other.minimum
    carried = rest.found.multipliers[2:].sum() * np.cos(rest.q[2])
    less = carried * loops * sides[0] * sides[2]
    assert other.energy - rest.found.energy == pytest.approx(-less, rel=5e-3)
    # The numbers of docs/model.md.
    assert 1e3 * (rest.found.energy - other.energy) == pytest.approx(0.48, abs=5e-3)
    assert 1e3 * (rest.q[1] - other.state.q[1]) == pytest.approx(0.49, abs=5e-3)


def test_an_unstable_rest_is_no_minimum() -> None:
    held = next(each for each in random_hands.equilibria(50) if not each.stable)
    assert held.state is not None and not held.minimum
    rest = e.rest_at(held.scene, held.state.q, held.time)
    np.testing.assert_allclose(rest.q, held.state.q, rtol=0, atol=1e-10)
    assert not v.is_minimum(rest)
    assert rest.slope < 1e-4 and rest.curvature < 0.0
    # Beside a rest there is a slope, and an operation that did not end at one counts for nothing.
    firm = sp.equilibrium(TURNED)
    assert firm.state is not None
    (beside,) = e.without_slip(TURNED, firm.state.q, (1.0, 0.0, 0.0), [1e-4])
    assert e.around(TURNED, beside)[0] > 1.0
    assert v.is_minimum(e.rest_at(TURNED, firm.state.q, 0.0))
    assert not v.is_minimum(e.rest_at(TURNED, beside, 0.0))


def test_the_eight_operations(operations: sp.Run) -> None:
    found = e.rests(operations)
    assert [rest.number for rest in found] == list(range(1, 9))
    verdict = v._without_slipping(operations, found)
    assert verdict.verdict == "holds"
    assert verdict.value == pytest.approx(min(map(softest, found)), rel=1e-5)
    short = sp.simulate(paper.manipulation(duration=4.5), dt=2e-4, record=("state",))
    assert len(e.rests(short)) == 5
    assert v._without_slipping(operations, found[:5]).verdict == "does not hold"


def of_random_hands(count: int, seed: int = random_hands.SEED) -> None:
    for each in random_hands.settled(count, seed):
        if isinstance(each, str):
            assert each in ("separated", "crushed", "folded")
            continue
        rest = each.rest
        assert rest.found.state is not None and rest.found.stable
        assert (np.abs(rest.q - each.run.q[-1]) <= each.bound).all()
        assert v.is_minimum(rest) and rest.found.minimum
    for held in random_hands.equilibria(count, seed):
        assert held.stable == held.minimum


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_settled_runs_of_random_hands_are_minima_without_slip(seed: int) -> None:
    of_random_hands(1, seed)
