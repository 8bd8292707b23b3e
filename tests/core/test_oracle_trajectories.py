"""The oracle against itself: its trajectories beside two other simulations, and its error."""

from types import SimpleNamespace

import numpy as np
import pytest

import softpinch as sp
from bare_scenes import changed, paper, push, steps, uneven
from oracle import error, evaluate, parameters, reference

OPERATIONS = [(6, 6), (20, -10), (-2, 13), (-10, 20), (-7, 17), (17, -7), (-15, 25), (5, 5)]


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


@pytest.mark.parametrize(
    ("end", "expected"), [(2.0, "-14.4"), pytest.param(8.0, "0.64", marks=pytest.mark.slow)]
)
def test_the_other_sign_of_the_coupling_settles_where_model_md_has_it(
    end: float, expected: str
) -> None:
    run = reference(paper(schedule=steps(OPERATIONS), duration=end, kappa=-1.0), [end])
    digits = len(expected.partition(".")[2])
    assert f"{np.rad2deg(run.q[0, 2]):.{digits}f}" == expected


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
    with pytest.raises(RuntimeError, match=r"takes more than 100 evaluations at t = 0\.0"):
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
    pulse = sp.Pulse(time=1.0, force=(force, 0.0), moment=moment, duration=0.01)
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
