"""The reference solver beside SymPy's equations, the oracle's trajectories and itself."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import oracle
import softpinch as sp
from noises import AWKWARD, held, noise
from oracle.trajectory import jump as oracle_jump
from scenes import SCENES, pushed, uneven
from softpinch.accuracy import reference
from softpinch.accuracy.null_space import PLAIN, jump, parameters
from softpinch.reference import confirmed, solve
from softpinch.run import scaled_error

STIFF = sp.Scene(
    hand=sp.Hand(tip=sp.Fingertip(normal_viscosity=1e4, tangential_viscosity=1e4)),
    grasped=sp.GraspedObject(mass=1e-3),
    schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 4]])),
    duration=0.003,
)
SHORT = pushed(
    sp.Step(time=0.0231, force=(8.0, -3.0), moment=0.03),
    sp.Sine(frequency_hz=33.0, force=(6.0, 4.0), moment=0.02, phase=0.4, time=0.0091),
)


def random_states(scene: sp.Scene, count: int) -> list[tuple[list[float], tuple[float, ...]]]:
    """States (14,) and inputs (5,) about the start, none of them small."""
    rng = np.random.default_rng(7)
    q = scene.start().q[:5]
    found = []
    for _ in range(count):
        y = [*q + rng.normal(size=5) * [3e-3, 3e-3, 0.1, 0.1, 0.1], *1e-3 * rng.normal(size=2)]
        y += [*0.01 * rng.normal(size=2), *rng.normal(size=5) * [0.2, 0.2, 4, 4, 4]]
        u = rng.normal(size=5) * [0.1, 0.1, 9, 9, 0.1]
        found.append(([float(v) for v in y], tuple(u.tolist())))
    return found


@pytest.mark.parametrize("scene", [uneven(), sp.Scene()], ids=["uneven", "even"])
def test_equations_are_those_that_sympy_derives(scene: sp.Scene) -> None:
    numbers, c = oracle.parameters(scene), parameters(scene)
    for y, u in random_states(scene, 12):
        d_n1, d_n2, *tips = PLAIN.followers(y, c)
        rates, multipliers = PLAIN.rates(y, c, u), PLAIN.multipliers(y, c, u)
        q, p = [*y[:5], d_n1, d_n2, *y[5:7]], [*y[9:], *tips]
        expected = oracle.evaluate(numbers, q, p, y[7:9], u[:2], u[2:])
        found = {"residuals": np.zeros(4), "multipliers": multipliers}
        assert max(expected.differences(found, forming_a=True).values()) < 1e-11
        accelerations = expected.accelerations
        five = oracle.Quantity(accelerations.value[:5], accelerations.scale[:5])
        assert five.difference(rates[9:]) < 1e-11
        lags = np.array(y[3:5]) - u[:2]
        np.testing.assert_array_equal(rates[:9], [*y[9:], *tips[2:], *lags])


def test_an_impulse_is_the_oracles() -> None:
    scene, impulse = uneven(), (0.05, -0.02, 2e-4)
    values = tuple(oracle.parameters(scene)[name] for name in oracle.PARAMETERS)
    for y, _ in random_states(scene, 4):
        found = jump(y, parameters(scene), impulse)
        expected = oracle_jump(np.array(y), values, impulse)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_the_jacobian_is_the_slope_of_the_rates() -> None:
    scene = uneven()
    problem = reference._Problem(scene, None, 1e-10, None, 100_000)
    for y, u in random_states(scene, 3):
        found = problem.jacobian(np.array(y), u)
        step = 1e-6 * np.maximum(np.abs(y), 1e-3)
        for k in range(14):
            ahead, behind = (list(y), list(y))
            ahead[k] += step[k]
            behind[k] -= step[k]
            sides = (np.array(PLAIN.rates(at, problem.c, u)) for at in (ahead, behind))
            slope = np.subtract(*sides) / (ahead[k] - behind[k])
            np.testing.assert_allclose(found[:, k], slope, rtol=1e-5, atol=1e-7 * abs(slope).max())


def resumed() -> sp.Scene:
    """From the middle of another run on, its clock going on, and its switches."""
    run = sp.simulate(SHORT, method="dop853", tolerance=1e-9, formulation="nullspace")
    k = int(np.searchsorted(run.t, 0.03))
    return replace(SHORT, initial=run.state(k), duration=0.05)


@pytest.mark.parametrize("name", ["uneven", "impulse", "sine", "samples joined", "resumed"])
def test_trajectories_are_the_oracles(name: str) -> None:
    """The inputs have one reader, which tests/core/test_oracle_inputs.py tests."""
    scene = resumed() if name == "resumed" else SCENES[name]
    at_breaks = solve(scene, rtol=1e-6).t
    begin, end = at_breaks[[0, -1]]
    times = np.union1d(at_breaks, np.linspace(begin, end, 12))
    expected = oracle.reference(scene, times)
    found = solve(scene, times)
    assert max(oracle.error(found, expected).values()) < 3e-11
    np.testing.assert_allclose(found.integral, expected.integral, atol=1e-15)
    assert found.own_error is None and "DOP853" in found.method


@pytest.mark.parametrize("one", [noise(), AWKWARD[2], AWKWARD[3]], ids=["from 0", "ends", "early"])
def test_noise_is_held_samples(one: sp.Noise) -> None:
    scene = pushed(sp.Step(time=0.0), one)
    times = np.linspace(0, 0.1, 9)
    expected = oracle.reference(pushed(sp.Step(time=0.0), held(one, 1, 0.1)), times)
    assert max(oracle.error(solve(scene, times), expected).values()) < 3e-11


def test_a_stiff_scene_is_solved_by_implicit_methods_and_right() -> None:
    times = np.linspace(0, STIFF.duration, 9)
    found = confirmed(STIFF, times)
    assert found.method.startswith("SciPy Radau") and "confirmed by SciPy LSODA" in found.method
    assert found.own_error is not None and max(found.own_error.values()) < 1e-10
    # By an explicit one, and so by a hundred times the work.
    expected = oracle.reference(STIFF, times)
    assert max(oracle.error(found, expected).values()) < 1e-9
    assert 2 * found.evaluations < expected.evaluations


@pytest.mark.parametrize("scene", [SHORT, uneven(), sp.Scene(duration=0.1)], ids=range(3))
@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_own_error_is_honest(scene: sp.Scene, rtol: float) -> None:
    times = np.linspace(0, scene.duration, 11)
    found, exact = confirmed(scene, times, rtol=rtol), solve(scene, times)
    actual = scaled_error.largest(found, exact, exact.scales)
    assert found.own_error is not None and found.own_error.keys() == actual.keys()
    for name, error in actual.items():
        assert 0.3 * error < found.own_error[name] < 300 * error, (name, error, found.own_error)
        assert error > 1e-13


def test_without_lsoda_two_tolerances_confirm(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    integrate = reference.integrate

    def hopeless(*args: object, method: str, rtol: float, **how: object) -> object:
        if method == "LSODA" and rtol < 1e-9:
            raise RuntimeError("hopeless")
        return integrate(*args, method=method, rtol=rtol, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(reference, "integrate", hopeless)
    found = confirmed(sp.Scene(duration=0.05))
    assert found.method == "SciPy DOP853 at rtol 1e-12, confirmed by SciPy DOP853 at rtol 1e-11"


def test_rows_are_at_the_wanted_instants() -> None:
    few, many = solve(SHORT, [0.1]), solve(SHORT, np.linspace(0, 0.1, 41))
    end = SimpleNamespace(**pick(many, [-1]))
    assert max(scaled_error.largest(few, end, many.scales).values()) < 1e-12
    # An additional step to each instant.
    assert many.evaluations < few.evaluations + 41 * 14
    mixed = solve(SHORT, [0.1, 0.0, 0.05, 0.05])
    np.testing.assert_array_equal(mixed.t, [0.1, 0.0, 0.05, 0.05])
    np.testing.assert_array_equal(mixed.q[2], mixed.q[3])
    np.testing.assert_allclose(mixed.q[1], SHORT.start().q, atol=1e-16)
    everywhere = solve(SHORT)
    np.testing.assert_allclose(everywhere.t, [0, 0.0091, 0.0137, 0.0231, 0.0548, 0.1], rtol=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        few.q[0, 0] = 1.0
    # What is large between the rows counts in the scales.
    for name, sizes in few.scales.items():
        largest = np.abs(getattr(many, name)).max(axis=0)
        assert (sizes > 0.99 * largest).all() and (sizes < 1.2 * largest).all()


def pick(run: reference.Reference, rows: list[int]) -> dict[str, object]:
    return {name: getattr(run, name)[rows] for name in ("t", "q", "p", "multipliers")}


def test_given_rates_are_used() -> None:
    calls = []

    def rates(y: object, c: object, u: object) -> object:
        assert isinstance(y, tuple) and isinstance(c, tuple) and isinstance(u, tuple)
        calls.append(1)
        return PLAIN.rates(y, c, u)

    scene = sp.Scene(duration=0.01)
    found = solve(scene, rates=rates, method="Radau")
    np.testing.assert_array_equal(found.q, solve(scene, method="Radau").q)
    # The others are the Jacobians', fourteen each.
    others = found.evaluations - len(calls)
    assert 0 < others < 0.5 * found.evaluations and others % 14 == 0


def test_a_motion_that_diverges_is_an_error_with_the_time() -> None:
    tip = sp.Fingertip(tilt_coupling=-1.0)
    lost = replace(sp.paper.disturbance("i"), hand=sp.Hand(tip=tip))
    # The left tip leaves the object 69 ms after the push at 1 s (docs/model.md, "The sign of the
    # shear"); soon after there is no motion any more.
    before = sp.simulate(
        lost, tolerance=1e-12, method="dop853", formulation="nullspace", times=[0.99]
    )
    late = replace(lost, initial=before.state(0))
    with pytest.raises(RuntimeError, match=r"reference: .* at t = 1\.0957436"):
        confirmed(late)
    with pytest.raises(RuntimeError, match=r"reference: the motion runs away at t = 1\.0957436"):
        solve(late, rtol=1e-9, method="LSODA")
    with pytest.raises(RuntimeError, match=r"takes more than 100 evaluations at t = 0\.0"):
        solve(SHORT, most=100)


@pytest.mark.parametrize(("name", "equation"), [("q", r"off C\^H = 0"), ("p", "off Phi p = 0")])
def test_a_start_off_the_constraints_is_refused(name: str, equation: str) -> None:
    scene = sp.Scene(duration=0.01)
    state = sp.State.consistent(scene, fingers=(0.1, 0.1), velocity=(0.1, 0, 1.0))
    moved = getattr(state, name) + 1e-8 * np.eye(9)[6 if name == "q" else 8]
    off = replace(scene, initial=replace(state, **{name: moved}))
    with pytest.raises(ValueError, match=f"Scene.initial: 1.000e-08 m.* {equation}"):
        solve(off)
    assert solve(off, tolerance=1e-6).q.shape == (2, 9)
    solve(replace(scene, initial=state))


def test_errors_count_what_is_zero_by_symmetry_and_what_is_not_finite() -> None:
    rows = np.zeros((3, 9))
    rows[:, 1], rows[:, 5], rows[:, 3] = 0.08, 1e-3, [0.1, -0.2, 0.1]
    rows[:, 0] = 1e-13
    scales = scaled_error.scales("q", rows)
    np.testing.assert_array_equal(scales, [0.08, 0.08, 0.2, 0.2, 0.2, 1e-3, 0.08, 0.08, 0.08])
    off = rows.copy()
    off[1, 0] += 0.08e-3
    off[2, 4] = np.nan
    errors = scaled_error.by_row(off, rows, scales)
    np.testing.assert_allclose(errors, [0, 1e-3, np.inf], rtol=1e-9)
    # All at rest: an error of any size counts in full.
    np.testing.assert_array_equal(scaled_error.scales("p", np.zeros((2, 9))), np.ones(9))
