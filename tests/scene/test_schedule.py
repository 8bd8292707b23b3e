"""Schedules: the polynomials that they become are what their names say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import softpinch as sp
from softpinch import paper, strategies
from softpinch.scene.schedule import KINDS

Floats = NDArray[np.float64]
TIMES = np.array([0.25, 1.0, 1.5])
ANGLES = np.array([[0.1, 0.2], [-0.3, 0.4], [0.5, -0.1]])
instants = st.floats(-1.0, 4.0)


def before(times: np.ndarray, t: float) -> int:
    """Which knot came last, -1 for none."""
    return int(np.searchsorted(times, t, side="right")) - 1


def expected(schedule: sp.Schedule, t: float) -> np.ndarray:
    """What a schedule asks for at `t`, straight from its description."""
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


@given(strategies.schedules(duration=2.0, kinds=("steps", "sampled")))
def test_at_a_jump_what_is_asked_for_is_what_follows(schedule: sp.Schedule) -> None:
    np.testing.assert_array_equal(schedule.target(schedule.times), schedule.angles)


@given(strategies.schedules(duration=2.0, kinds=("ramps", "minimum_jerk")))
def test_ramps_and_smooth_moves_do_not_jump(schedule: sp.Schedule) -> None:
    breaks, _ = schedule.compile()
    for t in breaks:
        ahead = schedule.target(np.nextafter(t, -np.inf))
        np.testing.assert_allclose(ahead, schedule.target(t), rtol=0, atol=1e-12)


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


def test_moves_back_to_back_are_allowed_though_their_sum_rounds_up() -> None:
    # 0.2 + 0.1 is more than 0.3 in floating point.
    schedule = sp.Schedule.minimum_jerk([0.0, 0.1, 0.2, 0.3], np.zeros((4, 2)), 0.1)
    assert list(schedule.compile()[0]) == [0.1, 0.2, 0.3, 0.4]


def test_a_step_at_the_first_time_is_no_break() -> None:
    breaks, coefficients = sp.Schedule.steps(TIMES, ANGLES).compile()
    assert list(breaks) == [1.0, 1.5]
    assert coefficients.shape == (3, 2, 1)


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
