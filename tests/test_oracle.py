"""The oracle against itself: identities whatever the core does, and model.md's numbers."""

from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf
from numpy.typing import NDArray

from oracle import (
    PARAMETERS,
    SIDES,
    Quantity,
    compiled,
    error,
    evaluate,
    magnitude,
    model,
    parameters,
    reference,
    vanishes,
)
from oracle.lagrangian import FORCES, SHAPES
from oracle.trajectory import breaks, inputs, jump, null_space

Floats = NDArray[np.float64]
FINGERS = pytest.mark.parametrize("i", [0, 1], ids=["right", "left"])
OPERATIONS = [(6, 6), (20, -10), (-2, 13), (-10, 20), (-7, 17), (17, -7), (-15, 25), (5, 5)]


def paper(**changes: Any) -> SimpleNamespace:
    """model.md's parameters as a bare scene, no softpinch in it; operation 1 for a second."""
    finger = SimpleNamespace(
        length=0.0762, root_offset=0.049, half_thickness=0.0045, mass=0.1, inertia=5.8e-4
    )
    tip = SimpleNamespace(
        radius=0.020,
        youngs_modulus=0.30e6,
        normal_viscosity=100.0,
        tangential_viscosity=100.0,
        tilt_coupling=changes.pop("kappa", 1.0),
        normal_mass=None,
        tangential_mass=None,
    )
    scene = {
        "hand": SimpleNamespace(right=finger, left=finger, tip=tip),
        "grasped": SimpleNamespace(width=0.049, mass=0.1, inertia=4.0e-5, com_offset=0.0),
        "control": SimpleNamespace(kp=100.0, kd=1.0, ki=1000.0),
        "schedule": steps([(6, 6)]),
        "disturbances": [],
        "gravity": 9.81,
        "duration": 1.0,
        "initial": None,
    }
    return SimpleNamespace(**{**scene, **changes})


def steps(degrees: Sequence[tuple[float, float]]) -> SimpleNamespace:
    times = np.arange(len(degrees), dtype=np.float64)
    return SimpleNamespace(kind="steps", times=times, angles=np.deg2rad(degrees))


def changed(record: SimpleNamespace, **changes: Any) -> SimpleNamespace:
    return SimpleNamespace(**{**vars(record), **changes})


def uneven(**changes: Any) -> SimpleNamespace:
    """Right and left differ, the centre of gravity is off the middle; both tips pressed."""
    scene = paper()
    finger, tip = scene.hand.right, scene.hand.tip
    soft = {"youngs_modulus": 2.5e5, "tilt_coupling": -1.0, "normal_mass": 0.05, "radius": 0.021}
    other = {"tangential_mass": 0.2, "normal_viscosity": 80.0}
    scene.hand = SimpleNamespace(
        right=changed(finger, length=0.08, mass=0.12, inertia=6e-4, root_offset=0.0485),
        left=changed(finger, half_thickness=0.005, inertia=5e-4),
        tip=(changed(tip, **soft), changed(tip, **other)),
    )
    scene.grasped = changed(scene.grasped, com_offset=0.004, inertia=5e-5, mass=0.15)
    scene.control = (scene.control, SimpleNamespace(kp=80.0, kd=0.7, ki=600.0))
    return changed(scene, **changes)


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
def test_the_tips_are_where_7_and_8_have_them(i: int) -> None:
    tip, s = model().tip(i), SIDES[i][1]
    w_f, length, d_f = (tip[f"finger_{n}"] for n in ("root_offset", "length", "half_thickness"))
    sine, cosine = sp.sin(tip["angle"]), sp.cos(tip["angle"])
    x, y = model().centers[i]
    assert vanishes(x - (-s * w_f + s * length * sine + s * d_f * cosine))
    assert vanishes(y - (length * cosine - d_f * sine))


@FINGERS
def test_the_derivation_gives_the_closed_forms_of_model_md(i: int) -> None:
    system, tip, s = model(), model().tip(i), SIDES[i][1]
    x, y, theta = system.q[:3]
    p = system.p
    c, si = sp.cos(theta), sp.sin(theta)
    ox, oy = system.centers[i]
    rx, ry = x - ox, y - oy
    big_x, g = rx * c + ry * si, -rx * si + ry * c
    radius, length, d_f = (
        tip["radius"] - tip["dn"],
        tip["finger_length"],
        tip["finger_half_thickness"],
    )
    tilt = tip["angle"] + s * theta
    st_, ct = sp.sin(tilt), sp.cos(tilt)

    phi = system.matrix("constraint_matrix")
    normal, tangential = sp.zeros(1, 9), sp.zeros(1, 9)
    normal[0], normal[1], normal[2], normal[5 + i] = s * c, s * si, s * g, 1
    normal[3 + i] = -length * ct + d_f * st_
    tangential[0], tangential[1], tangential[2] = -si, c, -big_x + s * radius
    tangential[3 + i], tangential[7 + i] = length * st_ + d_f * ct + radius, 1
    for k in range(9):
        assert vanishes(phi[i, k] - normal[k])
        assert vanishes(phi[2 + i, k] - tangential[k])

    turning, spin = tip["angle_rate"] + s * p[2], tip["angle_rate"]
    g_rate, x_rate = system.rate(g), system.rate(big_x)
    b_h = (
        s * (c * p[1] - si * p[0]) * p[2]
        + s * g_rate * p[2]
        + (length * st_ + d_f * ct) * turning * spin
    )
    b_n = (
        -(c * p[0] + si * p[1]) * p[2]
        - (x_rate + s * tip["dn_rate"]) * p[2]
        + ((length * ct - d_f * st_) * turning - tip["dn_rate"]) * spin
    )
    assert vanishes(system.terms["constraint_rate"][i] - b_h)
    assert vanishes(system.terms["constraint_rate"][2 + i] - b_n)

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


@FINGERS
def test_e_is_constant_on_the_constraint_as_30_says(i: int) -> None:
    system, s = model(), SIDES[i][1]
    dn = system.q[5 + i]
    depth = sp.solve(system.terms["residuals"][i], dn)[0]
    entry = system.matrix("constraint_matrix")[2 + i, 2]
    width, offset = (system.parameters[f"grasped.{n}"] for n in ("width", "com_offset"))
    assert vanishes(entry.subs(dn, depth) - (-s * width / 2 - offset))


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
def test_forces_are_minus_the_gradients_of_the_energies(state: Any, values: list[float]) -> None:
    q, p, rest = state
    with mp.workdps(50):
        here = terms([*q, *p, *rest], values)

        def energy(name: str, k: int, t: Any) -> Any:
            moved = [*q, *p]
            moved[k] += t
            return terms([*moved, *rest], values)[f"{name}_energy"]

        for name in ("elastic", "gravity"):
            gradient = [slope(partial(energy, name, k))[0] for k in range(9)]
            same([-f for f in here[name]], gradient)
        momenta = [slope(partial(energy, "kinetic", 9 + k))[0] for k in range(9)]
        same(times_vector(here["mass_matrix"], p), momenta)


@given(states, numbers)
def test_every_power_is_accounted_for(state: Any, values: list[float]) -> None:
    """d/dt(T + P + P_g) = torques + external - viscous loss + lambda^T Phi p (model.md, ledger)."""
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
def test_phi_minv_phit_is_positive_definite(state: Any, values: list[float]) -> None:
    q, p, _ = state
    here = evaluate(dict(zip(PARAMETERS, values, strict=True)), q, p)
    root = here.constraint_matrix.value / np.sqrt(np.diag(here.mass_matrix.value))
    a = root @ root.T
    assert (a == a.T).all()
    np.linalg.cholesky(a)
    # The last four columns are the identity, so no eigenvalue is below the heaviest tip's 1/m.
    assert np.linalg.eigvalsh(a)[0] >= (1 - 1e-9) / np.diag(here.mass_matrix.value)[5:].max()


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


def test_magnitudes_are_the_sums_of_absolute_terms() -> None:
    x, y = sp.symbols("x y", real=True)
    point = {x: sp.Rational(-3, 2), y: 4}
    for expression, expected in (
        (x - y, 5.5),
        (2 * x * (x - y) ** 2, 3 * 5.5**2),
        (sp.sin(x) * (y - 1) / sp.cos(y) ** 3, 5 * abs(np.sin(1.5) / np.cos(4) ** 3)),
        (-sp.pi * (sp.tan(x) + 1), np.pi * (np.tan(1.5) + 1)),
    ):
        assert float(magnitude(expression).subs(point)) == pytest.approx(expected, rel=1e-14)


def test_differences_see_a_change_of_1e_10_and_a_wrong_shape() -> None:
    here = evaluate(dict.fromkeys(PARAMETERS, 0.5), [0.3] * 9, [0.2] * 9)
    exact = {name: quantity.value for name, quantity in vars(here).items()}
    assert max(here.differences(exact).values()) == 0
    for name, value in exact.items():
        if value.any():
            assert here.differences({name: value * (1 + 1e-10)})[name] > 1e-12
    assert here.differences({"residuals": np.zeros(3)})["residuals"] == np.inf
    assert Quantity(np.zeros(1), np.zeros(1)).difference([1e-300]) == np.inf
    assert Quantity(np.zeros(1), np.ones(1)).difference([np.nan]) == np.inf
    allowed = here.differences({"multipliers": exact["multipliers"] * 1.1}, forming_a=True)
    strict = here.differences({"multipliers": exact["multipliers"] * 1.1})
    assert 0 < allowed["multipliers"] < strict["multipliers"]


# Trajectories


def test_the_paper_manipulation_settles_where_model_md_has_it() -> None:
    starts = np.arange(8.0)
    early = (starts[:, None] + np.linspace(0, 0.02, 101)).ravel()
    times = np.union1d(early, [*starts + 1])
    run = reference(paper(schedule=steps(OPERATIONS), duration=8.0), times)
    settled = np.searchsorted(run.t, starts + 1)
    q = run.q[settled] * 1e3
    # x, y, theta in degrees, d_n1, d_n2, as printed.
    expected = [
        "0.000 74.020 0.000 7.936 7.936",
        "-19.770 71.893 -9.427 6.242 6.340",
        "9.960 73.896 5.879 7.245 7.194",
        "19.737 72.182 10.547 6.414 6.316",
        "15.855 73.089 8.586 6.499 6.427",
        "-15.806 73.367 -7.766 6.381 6.455",
        "25.892 71.029 13.657 6.222 6.068",
        "-0.001 75.692 0.271 6.624 6.625",
    ]
    q[:, 2] = np.rad2deg(q[:, 2] / 1e3)
    found = [" ".join(f"{v + 0.0:.3f}" for v in row) for row in q[:, [0, 1, 2, 5, 6]]]
    assert [row.replace("-0.000", "0.000") for row in found] == expected
    # Just after the switch: what pulls, pulls at once.
    normal = run.multipliers[:, :2].min(axis=1)
    least = [normal[(run.t >= t) & (run.t < t + 1)].min() for t in starts]
    printed = [38, -36, -55, None, 26, None, -111, -38]
    assert [None if p is None else round(v) for v, p in zip(least, printed, strict=True)] == printed


def test_the_other_sign_of_the_coupling_settles_where_model_md_has_it() -> None:
    run = reference(paper(schedule=steps(OPERATIONS), duration=8.0, kappa=-1.0), [2.0, 8.0])
    degrees = np.rad2deg(run.q[:, 2])
    assert [f"{degrees[0]:.1f}", f"{degrees[1]:.2f}"] == ["-14.4", "0.64"]


def push(**changes: Any) -> SimpleNamespace:
    return SimpleNamespace(**{"time": 1.0, "force": (130.0, 130.0), "moment": 5.0, **changes})


def test_the_step_of_case_i_is_survived_as_model_md_says() -> None:
    times = np.union1d(np.linspace(1, 1.05, 501), [2.0])
    run = reference(paper(disturbances=[push()], duration=2.0), times)
    end = run.q[-1]
    assert [f"{v * 1e3:.2f}" for v in end[5:7]] == ["12.08", "4.37"]
    assert f"{np.rad2deg(end[2]):.2f}" == "7.17"
    np.testing.assert_allclose(np.rad2deg(end[3:5]), 6, atol=0.05)
    left = run.multipliers[:, 1]
    assert f"{left.min():.1f}" == "-2.6"
    pulling = run.t[left < 0]
    assert pulling[-1] - pulling[0] == pytest.approx(3.7e-3, abs=1.1e-4)


@pytest.mark.parametrize(
    ("kappa", "moment", "after"),
    [(1.0, 0.0, 0.03), (1.0, -5.0, 0.02), (-1.0, 5.0, 0.08)],
    ids=["no moment", "other moment", "other kappa"],
)
def test_these_steps_lose_the_grasp_as_model_md_says(
    kappa: float, moment: float, after: float
) -> None:
    # Later it runs away: P is unbounded below.
    scene = paper(disturbances=[push(moment=moment)], duration=1.0 + after, kappa=kappa)
    assert reference(scene, [1.0 + after]).q[0, 5:7].min() < -4e-3


def test_a_motion_that_runs_away_is_an_error_and_not_a_hang() -> None:
    with pytest.raises(RuntimeError, match="reference: "):
        reference(paper(disturbances=[push()], duration=2.0, kappa=-1.0), most=200_000)
    with pytest.raises(RuntimeError, match="too much work"):
        reference(paper(), most=100)


@pytest.mark.parametrize(
    ("degrees", "force", "moment", "expected", "y", "depth"),
    [
        (6, 0.9, 0.327, "0.68", None, None),
        (3, 0.9, 0.327, "1.07", "74.956", "3.982"),
        (2, 0.3, 0.109, "0.41", "75.293", "2.657"),
    ],
    ids=["ii", "iii", "iv"],
)
def test_pulses_of_10_ms_turn_the_object_as_model_md_says(
    degrees: float, force: float, moment: float, expected: str, y: str | None, depth: str | None
) -> None:
    pulse = push(force=(force, 0.0), moment=moment, duration=0.01)
    scene = paper(schedule=steps([(degrees, degrees)]), disturbances=[pulse], duration=1.2)
    run = reference(scene, np.linspace(1, 1.2, 401))
    turned = np.rad2deg(abs(run.q[:, 2]).max())
    assert f"{turned:.2f}" == expected
    if y is not None:
        settled = run.q[0] * 1e3
        assert [f"{settled[1]:.3f}", f"{settled[5]:.3f}"] == [y, depth]


def test_a_mass_on_springs_keeps_its_energy() -> None:
    """No viscosity, K_D = K_I = 0, K_P counted as a spring, a start near rest."""
    scene = uneven(schedule=steps([(7, 6)]), duration=0.1)
    scene.control = SimpleNamespace(kp=100.0, kd=0.0, ki=0.0)
    none = {"normal_viscosity": 0.0, "tangential_viscosity": 0.0}
    scene.hand.tip = tuple(changed(tip, **none) for tip in scene.hand.tip)
    run = reference(scene, np.linspace(0, 0.1, 21))
    values = parameters(scene)
    totals, kinetic = [], []
    for q, p in zip(run.q, run.p, strict=True):
        here = evaluate(values, q, p)
        spring = 50 * ((q[3:5] - scene.schedule.angles[0]) ** 2).sum()
        kinetic.append(float(here.kinetic_energy.value))
        totals.append(kinetic[-1] + here.elastic_energy.value + here.gravity_energy.value + spring)
    assert max(kinetic) > 0.01
    assert np.ptp(totals) <= 1e-10 * max(kinetic)


def test_rows_are_on_the_constraints_and_obey_newton() -> None:
    scene = uneven(duration=0.2, disturbances=[push(time=0.1, force=(9, 4), moment=0.1)])
    run = reference(scene, np.linspace(0, 0.2, 9))
    values = parameters(scene)
    for k, t in enumerate(run.t):
        external = (9.0, 4.0, 0.1) if t >= 0.1 else (0.0, 0.0, 0.0)
        here = evaluate(
            values, run.q[k], run.p[k], run.integral[k], np.deg2rad([6, 6]), external, 1.0, 1.0
        )
        zeros = {"residuals": np.zeros(4), "residual_rates": np.zeros(2)}
        assert max(here.differences(zeros).values()) <= 1e-14
        assert here.differences({"multipliers": run.multipliers[k]})["multipliers"] <= 1e-11


def test_a_start_touches_or_presses_and_a_gap_is_refused() -> None:
    narrow = paper(duration=1e-6)
    narrow.grasped = changed(narrow.grasped, width=0.047)
    with pytest.raises(ValueError, match="right fingertip does not reach"):
        reference(narrow)
    narrow.initial = "touching"
    first = reference(narrow)
    assert abs(first.q[0, 5:7]).max() < 1e-16
    assert first.q[0, 3] > 0 and first.q[0, 2] == 0 and not first.p[0].any()
    wide = paper(duration=1e-6)
    wide.grasped = changed(wide.grasped, width=0.051)
    np.testing.assert_allclose(reference(wide).q[0, 5:7], 0.001, rtol=1e-12)
    assert not reference(wide).q[0, [0, 2, 3, 4, 7, 8]].any()


def test_a_given_state_goes_on_and_one_off_the_constraints_is_refused() -> None:
    whole = reference(paper(schedule=steps([(6, 6), (9, 3)]), duration=1.1), [0.0, 0.3, 1.1])
    given_ = SimpleNamespace(q=whole.q[1], p=whole.p[1], integral=whole.integral[1], time=0.3)
    scene = paper(schedule=steps([(6, 6), (9, 3)]), duration=0.8, initial=given_)
    rest = reference(scene, [0.3, 1.1])
    shifted = SimpleNamespace(t=whole.t[1:], **{n: getattr(rest, n) for n in ("q", "p")})
    expected = reference(paper(schedule=steps([(6, 6), (9, 3)]), duration=1.1), [0.3, 1.1])
    assert max(error(shifted, expected).values()) <= 1e-11
    given_.q = given_.q + 1e-6
    with pytest.raises(ValueError, match="off the constraints"):
        reference(scene)


def test_wanted_instants_change_nothing_and_lie_within_the_run() -> None:
    scene = paper(duration=0.3)
    few, many = reference(scene, [0.3]), reference(scene, np.linspace(0, 0.3, 31))
    np.testing.assert_allclose(few.q[-1], many.q[-1], atol=1e-13)
    np.testing.assert_allclose(few.p[-1], many.p[-1], atol=1e-11)
    rough = reference(scene, [0.3], rtol=1e-9)
    assert rough.evaluations < few.evaluations
    np.testing.assert_allclose(rough.q[-1], few.q[-1], atol=1e-9)
    with pytest.raises(ValueError, match="must be from"):
        reference(scene, [0.31])


# Inputs


def driven_at(scene: SimpleNamespace, times: list[float]) -> list[list[float]]:
    """What drives a scene just after each instant, through the break that lies there."""
    return [list(inputs(scene, t, t + 1e-9)(t)) for t in times]


SCHEDULES: dict[str, tuple[dict[str, Any], list[tuple[float, float]]]] = {
    "steps": ({}, [(-1, 1), (0, 1), (0.99, 1), (1, 3), (2, 0), (9, 0)]),
    "sampled zero": ({"hold": "zero"}, [(-1, 1), (0.5, 1), (1, 3), (2, 0), (9, 0)]),
    "ramps": ({}, [(-1, 1), (0, 1), (0.25, 1.5), (1, 3), (1.5, 1.5), (2, 0), (9, 0)]),
    "sampled linear": ({"hold": "linear"}, [(-1, 1), (0.25, 1.5), (1.5, 1.5), (9, 0)]),
    "minimum_jerk": (
        {"move_time": 0.5},
        # Halfway there is half the way; a quarter of the time 53/512 of it.
        [(-1, 1), (0.9, 1), (1, 1), (1.25, 2), (1.125, 1 + 2 * 53 / 512), (1.5, 3), (2.25, 1.5)],
    ),
}


@pytest.mark.parametrize("name", SCHEDULES)
def test_schedules_are_read_as_the_interface_has_them(name: str) -> None:
    options, expected = SCHEDULES[name]
    angles = np.array([[1.0, -2.0], [3.0, -6.0], [0.0, 0.0]])
    kind = name.split()[0]
    schedule = SimpleNamespace(kind=kind, times=[0.0, 1.0, 2.0], angles=angles, **options)
    found = driven_at(paper(schedule=schedule), [t for t, _ in expected])
    np.testing.assert_allclose(found, [[v, -2 * v, 0, 0, 0] for _, v in expected], atol=1e-15)


def sampled(hold: str, moment: list[float] | None) -> SimpleNamespace:
    return SimpleNamespace(times=[1.0, 2.0], force=[[1, 2], [3, 6]], moment=moment, hold=hold)


R = np.sqrt(0.5)
DISTURBANCES: dict[str, tuple[SimpleNamespace, list[tuple[float, Any]]]] = {
    "step": (push(force=(1, 2), moment=3), [(0.9, 0), (1, (1, 2, 3)), (99, (1, 2, 3))]),
    "pulse": (
        push(force=(1, 2), moment=3, duration=0.5),
        [(0.9, 0), (1, (1, 2, 3)), (1.49, (1, 2, 3)), (1.5, 0)],
    ),
    "sine": (
        push(time=1.25, force=(1, 2), moment=3, duration=0.5, frequency_hz=1.0, phase=0.0),
        [(1, 0), (1.25, 0), (1.375, (R, 2 * R, 3 * R)), (1.5, (1, 2, 3)), (1.75, 0), (2, 0)],
    ),
    "sine for ever": (
        push(force=(1, 2), moment=3, duration=None, frequency_hz=1.0, phase=np.pi / 2),
        [(0.9, 0), (1, (1, 2, 3)), (1.5, (-1, -2, -3)), (3, (1, 2, 3))],
    ),
    "sampled zero": (
        sampled("zero", [3.0, 0.0]),
        [(0.9, 0), (1, (1, 2, 3)), (1.5, (1, 2, 3)), (2, (3, 6, 0)), (9, (3, 6, 0))],
    ),
    "sampled linear": (
        sampled("linear", None),
        [(0.9, 0), (1, (1, 2, 0)), (1.5, (2, 4, 0)), (2, (3, 6, 0)), (9, (3, 6, 0))],
    ),
}


@pytest.mark.parametrize("name", DISTURBANCES)
def test_disturbances_are_read_as_the_interface_has_them(name: str) -> None:
    disturbance, expected = DISTURBANCES[name]
    scene = paper(disturbances=[disturbance, disturbance])
    found = np.array(driven_at(scene, [t for t, _ in expected]))[:, 2:]
    twice = [2 * np.ones(3) * np.array(load) for _, load in expected]
    np.testing.assert_allclose(found, twice, atol=1e-14)


def test_every_jump_and_bend_of_an_input_is_a_break() -> None:
    moves = SimpleNamespace(
        kind="minimum_jerk", times=[0, 1, 2], angles=np.zeros((3, 2)), move_time=0.5
    )
    pulse, for_ever = push(time=3.0, duration=0.25), push(time=4.0, duration=None)
    kick = SimpleNamespace(time=5.0, impulse=(0, 0), angular_impulse=0)
    scene = paper(
        schedule=moves, disturbances=[pulse, for_ever, kick, sampled("zero", None), push(time=6.0)]
    )
    found = sorted(set(breaks(scene)))
    assert found == [0, 1, 1.5, 2, 2.5, 3, 3.25, 4, 5, 6]


def test_at_the_right_end_of_a_piece_its_own_limit_holds() -> None:
    scene = paper(schedule=steps([(0, 0), (90, 90)]), disturbances=[push()])
    assert inputs(scene, 0.0, 1.0)(1.0) == (0.0, 0.0, 0.0, 0.0, 0.0)
    assert inputs(scene, 1.0, 2.0)(1.0)[2:] == (130.0, 130.0, 5.0)


def test_multipliers_at_a_switch_are_those_after_it_but_at_the_end_those_before() -> None:
    scene = paper(schedule=steps([(6, 6), (20, -10)]), duration=1.0)
    before = reference(scene, [1.0])
    scene.duration = 1.1
    after = reference(scene, [1.0])
    np.testing.assert_allclose(before.q, after.q, atol=1e-14)
    assert abs(before.multipliers - after.multipliers).max() > 1.0
    # One that misses the switch by a unit in the last place is still at it.
    nearly = reference(scene, [np.nextafter(1.0, 0)])
    np.testing.assert_array_equal(nearly.multipliers, after.multipliers)


def test_an_impulse_keeps_the_constraints_and_acts_after_its_row() -> None:
    scene = uneven(duration=0.2)
    quiet = reference(scene, [0.1])
    kick = SimpleNamespace(time=0.1, impulse=(0.02, -0.03), angular_impulse=2e-4)
    scene.disturbances = [kick]
    struck = reference(scene, [0.1, 0.1 + 1e-12])
    np.testing.assert_allclose(struck.p[0], quiet.p[0], atol=1e-11)
    dp = struck.p[1] - struck.p[0]
    here = evaluate(parameters(scene), struck.q[0], struck.p[0])
    phi, mass = here.constraint_matrix.value, here.mass_matrix.value
    # 1e-12 s at up to 1e5 m/s^2 come on top.
    assert abs(phi @ dp).max() <= 1e-6 * abs(dp).max()
    rest = mass @ dp - np.array([0.02, -0.03, 2e-4, 0, 0, 0, 0, 0, 0])
    answer, *_ = np.linalg.lstsq(phi.T, rest, rcond=None)
    assert abs(phi.T @ answer - rest).max() <= 1e-6 * abs(rest).max()
    assert abs(dp).max() > 0.01


def test_impulses_add_up_and_act_from_the_start_to_just_before_the_end() -> None:
    kick = SimpleNamespace(time=0.0, impulse=(0.02, 0.0), angular_impulse=0.0)
    twice = SimpleNamespace(time=0.0, impulse=(0.04, 0.0), angular_impulse=0.0)
    end, early = (changed(kick, time=t) for t in (0.01, -0.01))

    def last(*disturbances: SimpleNamespace) -> Floats:
        run = reference(paper(disturbances=list(disturbances), duration=0.01), [0.0, 0.01])
        assert not run.p[0].any()
        return np.asarray(run.p[1])

    np.testing.assert_allclose(last(kick, kick), last(twice), rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(last(end, early), last())
    assert abs(last(kick) - last()).max() > 1e-3


def test_an_impulse_is_the_limit_of_short_pulses() -> None:
    kick = SimpleNamespace(time=0.05, impulse=(0.02, -0.01), angular_impulse=2e-4)
    ideal = reference(paper(disturbances=[kick], duration=0.1), [0.1]).q
    gaps = []
    for length in (2e-4, 1e-4):
        pulse = push(
            time=0.05, force=(0.02 / length, -0.01 / length), moment=2e-4 / length, duration=length
        )
        run = reference(paper(disturbances=[pulse], duration=0.1), [0.1])
        gaps.append(abs(run.q - ideal).max())
    assert gaps[0] / gaps[1] == pytest.approx(2, abs=0.1)


def test_jump_leaves_where_things_are() -> None:
    scene = paper()
    values = tuple(parameters(scene)[name] for name in PARAMETERS)
    state = np.array([0, 0.0762, 0.1, 0.1, 0.2, 1e-3, 0, 0.5, 0.5, *[0.0] * 5])
    after = jump(state, (0.0,) * 5, values, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_array_equal(after[:9], state[:9])
    assert after[9] > 0


# The error


def test_the_error_is_scaled_by_each_components_own_size_along_the_run() -> None:
    run = reference(paper(duration=0.1), np.linspace(0, 0.1, 5))
    assert set(error(run, run)) == {"q", "p", "multipliers"}
    assert max(error(run, run).values()) == 0
    for component in (1, 3, 5):
        off = run.q.copy()
        off[2, component] += 1e-3 * abs(run.q[:, component]).max()
        errors = error(SimpleNamespace(t=run.t, q=off), run)
        assert errors == {"q": pytest.approx(1e-3, rel=1e-6)}
    # x is round-off by symmetry: a share of the largest length.
    off = run.q.copy()
    off[2, 0] += 1e-3 * run.q[:, 1].max()
    assert error(SimpleNamespace(t=run.t, q=off), run)["q"] == pytest.approx(1e-3, rel=1e-6)
    with pytest.raises(ValueError, match="times differ"):
        error(SimpleNamespace(t=run.t + 1e-9, q=run.q), run)
