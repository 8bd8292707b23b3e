"""Schedules: the polynomials that they become are what their names say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

import softpinch as sp
from softpinch import paper, strategies
from softpinch.scene.schedule import KINDS

Floats = NDArray[np.float64]
TIMES = np.array([0.25, 1.0, 1.5])
ANGLES = np.array([[0.1, 0.2], [-0.3, 0.4], [0.5, -0.1]])
instants = st.floats(-1.0, 4.0)


def before(times: np.ndarray, t: float) -> int:
    """Index of the last knot before `t`, -1 for none."""
    return int(np.searchsorted(times, t, side="right")) - 1


def angles_between(times: Floats, angles: Floats, t: float) -> Floats:
    """The motion of least jerk through all angles, as a spline of SciPy that rests at both ends."""
    if len(times) == 1:
        return angles[0]
    rest = [(1, 0.0), (2, 0.0)]
    clipped = float(np.clip(t, times[0], times[-1]))
    return np.array(
        [make_interp_spline(times, one, k=5, bc_type=(rest, rest))(clipped) for one in angles.T]
    )


def expected(schedule: sp.Schedule, t: float) -> np.ndarray:
    """The target at `t`, straight from the description of the schedule."""
    times: Floats = schedule.times
    angles: Floats = schedule.angles
    k = before(times, t)
    last: Floats = angles[max(k, 0)]
    following: Floats = angles[min(k + 1, len(times) - 1)]
    if schedule.kind == "minimum_jerk":
        assert schedule.move_time is not None
        s = min((t - times[k]) / schedule.move_time, 1.0) if k > 0 else 1.0
        ahead: Floats = angles[max(k - 1, 0)]
        return ahead + (last - ahead) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    if schedule.kind == "via_points":
        return angles_between(times, angles, t)
    if schedule.kind == "ramps" or schedule.hold == "linear":
        if k < 0 or k == len(times) - 1:
            return last
        share = (t - times[k]) / (times[k + 1] - times[k])
        return last + (following - last) * float(share)
    return last


@given(strategies.schedules(duration=2.0), instants)
def test_the_target_is_the_formula(schedule: sp.Schedule, t: float) -> None:
    target = schedule.target(t)
    assert target.shape == (2,)
    np.testing.assert_allclose(target, expected(schedule, t), rtol=0, atol=1e-12)


@given(strategies.schedules(duration=2.0), st.lists(instants, min_size=1, max_size=5))
def test_the_core_asks_the_fingers_for_the_same(schedule: sp.Schedule, times: list[float]) -> None:
    scene = sp.Scene(schedule=schedule)
    start = scene.start()
    many = schedule.target(times)
    assert many.shape == (len(times), 2)
    for t, row in zip(times, many, strict=True):
        core = sp.evaluate(scene, t, start.q, start.p).target
        np.testing.assert_allclose(core, row, rtol=0, atol=1e-12)


@given(strategies.schedules(duration=2.0, kinds=("minimum_jerk",)))
def test_smooth_moves_begin_and_end_at_rest_without_acceleration(schedule: sp.Schedule) -> None:
    breaks, coefficients = schedule.compile()
    for start, end, row in zip(breaks, breaks[1:], coefficients[1:], strict=False):
        for channel in row:
            move = np.polynomial.Polynomial(channel)
            scale = np.abs(channel[3:]).sum() + 1.0
            for order in (1, 2):
                assert move.deriv(order)(0.0) == 0.0
                assert abs(move.deriv(order)(end - start)) <= 1e-9 * scale


@given(strategies.schedules(duration=2.0, kinds=("via_points",), knots=6))
def test_a_way_through_points_has_continuous_derivatives(schedule: sp.Schedule) -> None:
    breaks, rows = schedule.compile()
    np.testing.assert_array_equal(breaks, schedule.times[1 if len(breaks) < 2 else 0 :])
    for k in range(len(breaks)):
        length = breaks[k] - breaks[k - 1] if k else 0.0
        for order in range(5 if 0 < k < len(breaks) - 1 else 3):
            for before_, after in zip(rows[k], rows[k + 1], strict=True):
                left = np.polynomial.Polynomial(before_).deriv(order)(length)
                right = np.polynomial.Polynomial(after).deriv(order)(0.0)
                powers = np.abs(before_) * length ** np.arange(len(before_))
                scale = 1.0 + max(powers) * 120.0 / max(length, 1e-3) ** order
                assert abs(left - right) <= 1e-9 * scale


def test_no_other_way_through_the_points_has_less_jerk() -> None:
    """Flash and Hogan's criterion: a bump that keeps points and ends only adds to it."""
    times, angles = (
        [0.0, 0.3, 1.0, 1.2],
        np.array([[0.1, 0.0], [0.3, 0.1], [-0.2, 0.1], [0.0, 0.4]]),
    )
    t = np.linspace(0.0, 1.2, 20_001)
    way = sp.Schedule.minimum_jerk(times, angles).target(t)[:, 0]

    def jerk(x: Floats) -> float:
        return float(np.sum(np.diff(x, 3)[10:-10] ** 2))

    bump = np.prod([(t - knot) for knot in times], axis=0) * t**2 * (t - 1.2) ** 2
    least = jerk(way)
    for size in (0.3, -0.3):
        assert jerk(way + size * bump) > least * 1.000001


@given(strategies.schedules(duration=2.0, kinds=("via_points",)), st.floats(-3.0, 3.0))
def test_a_way_through_two_points_is_a_move(schedule: sp.Schedule, t: float) -> None:
    times, angles = schedule.times[:2], schedule.angles[:2]
    if len(times) == 2:
        way = sp.Schedule.minimum_jerk(times, angles)
        move = sp.Schedule.minimum_jerk([times[0] - 9.0, times[0]], angles, [times[1] - times[0]])
        np.testing.assert_allclose(way.target(t), move.target(t), rtol=0, atol=1e-12)


def test_each_move_may_have_its_own_time() -> None:
    schedule = sp.Schedule.minimum_jerk(TIMES, ANGLES, [0.5, 0.1])
    assert list(schedule.compile()[0]) == [1.0, 1.5, 1.6]
    alone = sp.Schedule.minimum_jerk(TIMES[:2], ANGLES[:2], 0.5)
    other = sp.Schedule.minimum_jerk([0.0, 1.5], ANGLES[1:], 0.1)
    for t in np.linspace(0.0, 2.0, 41):
        np.testing.assert_array_equal(
            schedule.target(t), alone.target(t) if t < 1.5 else other.target(t)
        )
    equal = sp.Schedule.minimum_jerk(TIMES, ANGLES, [0.5, 0.5])
    same = sp.Schedule.minimum_jerk(TIMES, ANGLES, 0.5)
    np.testing.assert_array_equal(equal.compile()[1], same.compile()[1])
    assert schedule.end == 1.6
    assert sp.Schedule.from_dict(schedule.to_dict()) == schedule


def test_studies_may_vary_the_time_of_one_move_and_the_angle_of_one_point() -> None:
    moves = sp.Schedule.minimum_jerk([0.0, 0.001, 0.005], np.full((3, 2), 0.1), [0.002, 0.004])
    ways = sp.Schedule.minimum_jerk([0.0, 0.004, 0.008], np.deg2rad([[6, 6], [7, 6], [6, 6]]))
    for schedule, path, values in (
        (moves, "schedule.move_time.1", [0.001, 0.003]),
        (ways, "schedule.angles.1.0", [0.11, 0.12]),
        (ways, "schedule.times.1", [0.003, 0.005]),
    ):
        scene = sp.Scene(schedule=schedule, duration=0.01)
        study = sp.monte_carlo(scene, vary={path: values}, dt=1e-3, progress=False)
        for run, value in enumerate(values):
            end = sp.simulate(scene.with_({path: value}), 1e-3).state(-1)
            np.testing.assert_array_equal(study["final_state"][run], [*end.q, *end.p])


def test_driven_fingers_follow_a_way_through_points() -> None:
    ways = sp.Schedule.in_degrees("via_points", [0.0, 0.03, 0.05], [[6, 6], [8, 5], [7, 6]])
    scene = sp.Scene(schedule=ways, fingers="driven", duration=0.06)
    run = sp.simulate(scene, 1e-4, record=("state", "energy"))
    np.testing.assert_allclose(run.q[:, 3:5], ways.target(run.t), atol=1e-12)
    assert np.abs(run.energy.closure).max() < 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_angles_may_be_given_in_degrees(kind: str) -> None:
    options = {"minimum_jerk": {"move_time": 0.1}}.get(kind, {})
    found = sp.Schedule.in_degrees(kind, TIMES, np.rad2deg(ANGLES), **options)
    assert found.kind == kind
    np.testing.assert_allclose(found.angles, ANGLES, rtol=1e-15)
    assert found.hold == ("zero" if kind == "sampled" else None)
    with pytest.raises(ValueError, match="angles"):
        sp.Schedule.in_degrees(kind, TIMES, ANGLES[0], **options)


def test_moves_back_to_back_are_allowed_though_their_sum_rounds_up() -> None:
    # 0.2 + 0.1 is more than 0.3 in floating point.
    schedule = sp.Schedule.minimum_jerk([0.0, 0.1, 0.2, 0.3], np.zeros((4, 2)), 0.1)
    assert list(schedule.compile()[0]) == [0.1, 0.2, 0.3, 0.4]


@pytest.mark.parametrize("scale", [1e-40, 1e40])
def test_the_clock_may_be_of_any_scale(scale: float) -> None:
    schedule = sp.Schedule.minimum_jerk(TIMES * scale, ANGLES, 0.5 * scale)
    plain = sp.Schedule.minimum_jerk(TIMES, ANGLES, 0.5)
    np.testing.assert_allclose(schedule.target(1.2 * scale), plain.target(1.2), rtol=1e-9)


def test_moves_of_7_ms_do_not_make_a_tip_pull_and_of_6_ms_do_as_model_md_says() -> None:
    starts, angles = np.arange(8.0), np.deg2rad(paper.OPERATIONS)

    def least(milliseconds: float) -> Floats:
        schedule = sp.Schedule.minimum_jerk(starts, angles, 1e-3 * milliseconds)
        scene = paper.manipulation(schedule=schedule)
        run = sp.simulate(scene, record=("multipliers",))
        assert ("pulling" in run.violations) == (run.multipliers[:, :2].min() < 0)
        return np.array([run.multipliers[(run.t >= t) & (run.t < t + 1), :2].min() for t in starts])

    assert least(7.0).min() > 2
    assert round(least(6.0)[6]) == -2
    # Longer moves press harder, and from some 100 ms on as hard as the grasp itself.
    assert least(20.0).min() > 27 and least(200.0).min() > 37


@given(strategies.schedules(kinds=KINDS))
def test_arrays_are_copies_that_cannot_be_written(schedule: sp.Schedule) -> None:
    with pytest.raises(ValueError, match="read-only"):
        schedule.angles[0, 0] = 1.0
    angles = np.array(schedule.angles)
    copy = sp.Schedule.steps(schedule.times, angles)
    angles[:] = 7.0
    assert (copy.angles == schedule.angles).all()


def test_angles_of_whole_degrees_are_shown_in_degrees() -> None:
    written = sp.Schedule.in_degrees("steps", [0.0, 0.5], [[6, 6], [15.25, -5]])
    assert repr(written) == (
        "Schedule.in_degrees(kind='steps', times=[0.0, 0.5], angles=[[6.0, 6.0], [15.25, -5.0]])"
    )
    for schedule in (written, sp.Schedule.steps([0.0], [[0.1, 0.2]]), sp.Scene().schedule):
        shown = eval(repr(schedule), {"Schedule": sp.Schedule})
        assert shown == schedule and np.array_equal(shown.angles, schedule.angles)
