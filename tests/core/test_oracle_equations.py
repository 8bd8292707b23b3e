"""The oracle against itself: its derivation and its evaluation, at any state."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from oracle import PARAMETERS, SIDES, Quantity, compiled, evaluate, model, vanishes
from oracle.lagrangian import FORCES, SHAPES
from oracle.trajectory import null_space

FINGERS = pytest.mark.parametrize("i", [0, 1], ids=["right", "left"])

# Random states: any numbers, on the constraints or not. Away from zero, so that no scale is tiny.
_share = st.floats(0.1, 1.0).flatmap(lambda v: st.sampled_from([v, -v]))
states = st.tuples(
    st.lists(_share, min_size=9, max_size=9),
    st.lists(_share, min_size=9, max_size=9),
    st.lists(_share, min_size=7, max_size=7),
)
numbers = st.lists(st.floats(0.1, 2.0), min_size=len(PARAMETERS), max_size=len(PARAMETERS))


def terms(state: list[Any], values: list[float]) -> dict[str, Any]:
    """`compiled` in mpmath by name: lists of mpf, row by row."""
    with mp.workdps(50):
        flat = list(compiled("mpmath")([mpf(v) for v in state], [mpf(v) for v in values]))
    result = {}
    for name, shape in SHAPES.items():
        size = int(np.prod(shape))
        result[name], flat = flat[:size], flat[size:]
    return result


def slope(function: Callable[[Any], list[Any]]) -> list[Any]:
    """The derivative at zero by central differences, good to about 32 of 50 digits."""
    h = mpf(10) ** -16
    ahead, behind = function(h), function(-h)
    return [(a - b) / (2 * h) for a, b in zip(ahead, behind, strict=True)]


def same(left: list[Any], right: list[Any], digits: int = 25) -> None:
    with mp.workdps(50):
        size = max(map(abs, [*left, *right, mpf(1)]))
        gap = max(abs(a - b) for a, b in zip(left, right, strict=True))
        assert gap <= size * mpf(10) ** -digits, (gap, left, right)


def times_vector(matrix: list[Any], vector: list[Any]) -> list[Any]:
    n = len(vector)
    return [
        sum(a * b for a, b in zip(matrix[k : k + n], vector, strict=True))
        for k in range(0, len(matrix), n)
    ]


# The derivation


@FINGERS
def test_the_derivation_gives_the_constraints_and_forces_of_model_md(i: int) -> None:
    system, tip, s = model(), model().tip(i), SIDES[i][1]
    x, y, theta = system.q[:3]
    c, si = sp.cos(theta), sp.sin(theta)
    ox, oy = system.centers[i]
    rx, ry = x - ox, y - oy
    big_x, g = rx * c + ry * si, -rx * si + ry * c
    radius = tip["radius"] - tip["dn"]
    tilt = tip["angle"] + s * theta
    st_, ct = sp.sin(tilt), sp.cos(tilt)

    turning, g_rate = tip["angle_rate"] + s * system.p[2], system.rate(g)
    residual = s * big_x - radius - system.parameters["grasped.width"] / 2
    residual -= s * system.parameters["grasped.com_offset"]
    assert vanishes(system.terms["residuals"][i] - residual)
    nonholonomic = g_rate + radius * turning + tip["dt_rate"]
    assert vanishes(system.terms["residuals"][2 + i] - nonholonomic)

    e, kappa, dn, dt = tip["youngs_modulus"], tip["tilt_coupling"], tip["dn"], tip["dt"]
    about = sp.pi * e * (sp.Rational(2, 3) * dn**3 * st_ / ct**3 + kappa * dn**2 * dt / ct**2)
    elastic = system.terms["elastic"]
    assert vanishes(elastic[3 + i] + about)
    along = sp.pi * e * (dn**2 / ct**2 + 2 * kappa * dn * dt * sp.tan(tilt) + dt**2)
    assert vanishes(elastic[5 + i] + along)
    across = sp.pi * e * (kappa * dn**2 * sp.tan(tilt) + 2 * dn * dt)
    assert vanishes(elastic[7 + i] + across)
    other = -elastic[4 - i] * SIDES[1 - i][1]
    assert vanishes(elastic[2] + s * about + other)


def test_masses_and_the_other_forces_are_as_14_16_39_44_and_45_have_them() -> None:
    system = model()
    one, two = system.tip(0), system.tip(1)
    of = system.parameters
    mass, inertia, g = of["grasped.mass"], of["grasped.inertia"], of["gravity"]
    masses = [mass, mass, inertia, one["finger_inertia"], two["finger_inertia"]]
    masses += [tip[f"{name}_mass"] for name in ("normal", "tangential") for tip in (one, two)]
    assert system.matrix("mass_matrix") == sp.diag(*masses)
    typed: dict[str, dict[int, Any]] = {
        "gravity": {1: -mass * g},
        "viscous": {},
        "control": {},
        "external": dict(enumerate(system.external)),
    }
    for i, tip in enumerate((one, two)):
        lever = tip["finger_length"] * sp.sin(tip["angle"])
        typed["gravity"][3 + i] = tip["finger_mass"] * g * lever
        typed["viscous"][5 + i] = -tip["normal_viscosity"] * tip["dn_rate"]
        typed["viscous"][7 + i] = -tip["tangential_viscosity"] * tip["dt_rate"]
        error_ = tip["angle"] - system.target[i]
        torque = tip["kp"] * error_ + tip["kd"] * tip["angle_rate"] + tip["ki"] * system.integral[i]
        typed["control"][3 + i] = -torque
    for name, entries in typed.items():
        for k, force in enumerate(system.terms[name]):
            assert vanishes(force - entries.get(k, 0)), (name, k)


@given(states, numbers)
def test_the_constraint_matrix_times_p_is_the_rate_of_both_constraints(
    state: Any, values: list[float]
) -> None:
    q, p, rest = state
    with mp.workdps(50):
        here = terms([*q, *p, *rest], values)
        product = times_vector(here["constraint_matrix"], p)
        same(product[:2], here["residual_rates"], 45)
        same(product[2:], here["residuals"][2:], 45)

        def moved(t: Any) -> dict[str, Any]:
            return terms([*(a + t * b for a, b in zip(q, p, strict=True)), *p, *rest], values)

        same(product[:2], slope(lambda t: moved(t)["residuals"][:2]))
        b = slope(lambda t: times_vector(moved(t)["constraint_matrix"], p))
        same(here["constraint_rate"], b)


@given(states, numbers)
def test_every_power_is_accounted_for(state: Any, values: list[float]) -> None:
    """d/dt(T + P + P_g) = torques + external - viscous loss + lambda^T Phi p."""
    q, p, rest = state
    named = dict(zip(PARAMETERS, values, strict=True))
    here = evaluate(named, q, p, rest[:2], rest[2:4], rest[4:])
    with mp.workdps(50):
        fast = [mpf(float(v)) for v in here.accelerations.value]

        def total(t: Any) -> list[Any]:
            moved = [*(a + t * b for a, b in zip(q, p, strict=True))]
            moved += [a + t * b for a, b in zip(p, fast, strict=True)]
            there = terms([*moved, *rest], values)
            return [sum(there[f"{n}_energy"][0] for n in ("kinetic", "elastic", "gravity"))]

        power = float(slope(total)[0])
    p = np.array(p)
    works = sum(getattr(here, n).value @ p for n in ("control", "external", "viscous"))
    constraint = here.multipliers.value @ here.constraint_matrix.value @ p
    losses = here.viscous.value @ p
    assert losses <= 0
    size = here.force.scale @ abs(p) + here.multipliers.scale @ here.constraint_matrix.scale @ abs(
        p
    )
    assert abs(power - works - constraint) <= 1e-13 * size


# Evaluation


@given(states, numbers, st.sampled_from([0.0, 1.0, 1000.0]), st.sampled_from([0.0, 50.0]))
def test_accelerations_and_multipliers_solve_24(
    state: Any, values: list[float], alpha: float, beta: float
) -> None:
    q, p, rest = state
    named = dict(zip(PARAMETERS, values, strict=True))
    here = evaluate(named, q, p, rest[:2], rest[2:4], rest[4:], alpha, beta)
    phi, fast = here.constraint_matrix, here.accelerations
    motion = here.mass_matrix.value @ fast.value - phi.value.T @ here.multipliers.value
    size = here.mass_matrix.scale @ fast.scale + phi.scale.T @ here.multipliers.scale
    assert (abs(motion - here.force.value) <= 1e-14 * (size + here.force.scale)).all()
    gamma = here.constraint_rate.value.copy()
    gamma[:2] += 2 * alpha * here.residual_rates.value + alpha**2 * here.residuals.value[:2]
    gamma[2:] += beta * here.residuals.value[2:]
    bound = phi.scale @ fast.scale + abs(gamma)
    assert (abs(phi.value @ fast.value + gamma) <= 1e-13 * bound).all()
    total = sum(getattr(here, n).value for n in FORCES)
    assert here.force.difference(total) <= 1e-15
    # The sizes bound what they are the sizes of.
    for quantity in vars(here).values():
        assert (abs(quantity.value) <= quantity.scale * (1 + 1e-12)).all()


@given(states, numbers)
def test_both_formulations_agree_on_the_constraints(state: Any, values: list[float]) -> None:
    q, p, rest = state
    fourteen, asked = [*q[:5], *q[7:], *rest[:2], *p[:5]], rest[2:]
    motion, others = null_space()
    flat = np.array(motion(fourteen, asked, values))
    v = np.linalg.solve(flat[:25].reshape(5, 5), flat[25:30])
    depths, rates, multipliers = np.split(np.array(others(fourteen, asked, values, v)), [2, 6])
    np.testing.assert_allclose(rates[2:], flat[30:], rtol=1e-12, atol=1e-14)
    q, p = [*q[:5], *depths, *q[7:]], [*p[:5], *rates]
    named = dict(zip(PARAMETERS, values, strict=True))
    here = evaluate(named, q, p, rest[:2], asked[:2], asked[2:], 1.0, 1.0)
    zeros = {"residuals": np.zeros(4), "residual_rates": np.zeros(2)}
    assert max(here.differences(zeros).values()) <= 1e-14
    assert (abs(multipliers - here.multipliers.value) <= 1e-10 * here.multipliers.scale).all()
    assert (abs(v - here.accelerations.value[:5]) <= 1e-10 * here.accelerations.scale[:5]).all()


def test_differences_see_a_change_of_1e_10_and_a_wrong_shape() -> None:
    here = evaluate(dict.fromkeys(PARAMETERS, 0.5), [0.3] * 9, [0.2] * 9)
    exact = {name: quantity.value for name, quantity in vars(here).items()}
    assert max(here.differences(exact).values()) == 0
    for name, value in exact.items():
        if value.any():
            assert here.differences({name: value * (1 + 1e-10)})[name] > 1e-12
    assert here.differences({"residuals": np.zeros(3)})["residuals"] == np.inf
    assert Quantity(np.zeros(1), np.zeros(1)).difference([1e-280]) > 1e19
    assert Quantity(np.zeros(1), np.ones(1)).difference([np.nan]) == np.inf
    allowed = here.differences({"multipliers": exact["multipliers"] * 1.1}, forming_a=True)
    strict = here.differences({"multipliers": exact["multipliers"] * 1.1})
    assert 0 < allowed["multipliers"] < strict["multipliers"]
