"""Motions of the hand: they are what their names say, smooth where they say so, and consistent."""

import pickle
import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.interpolate import make_interp_spline
from scipy.optimize import brentq

import softpinch as sp
from softpinch.scene.directions import _TINY, _moved
from softpinch.scene.motion import MOTIONS

Floats = NDArray[np.float64]
# The package as those see it who check no types.
HandMotion: Any = sp.HandMotion
MOVES = ("minimum_jerk", "trapezoid", "jerk_limited")
within = st.integers(-100, 100).map(lambda k: k / 200.0)


def least_time(way: float, acceleration: float, jerk: float) -> float:
    """The time of the quickest move from rest to rest over a way, by its greatest speed."""

    def excess(speed: float) -> float:
        return speed * ramp(speed, acceleration, jerk) - way

    speed = float(brentq(excess, 0.0, 1e3, xtol=1e-300, rtol=1e-15))
    return 2.0 * ramp(speed, acceleration, jerk)


def ramp(speed: float, acceleration: float, jerk: float) -> float:
    """The time from rest to a speed, s."""
    if speed < acceleration**2 / jerk:
        return 2.0 * float(np.sqrt(speed / jerk))
    return speed / acceleration + acceleration / jerk


@st.composite
def motions(draw: st.DrawFn, kinds: tuple[str, ...] = tuple(MOTIONS)) -> Any:
    """Motions of all kinds, with ways up to 1.4 m in 1 to 4 times the least time, and pauses."""
    kind = draw(st.sampled_from(kinds))
    if kind == "sine":
        axis = draw(st.sampled_from(["x", "y", "tilt"]) | within)
        values = draw(st.tuples(within, st.floats(0.1, 4.0), st.just(axis), within, within))
        return HandMotion.sine(*values)
    if kind == "constant":
        return HandMotion.constant(draw(st.tuples(within, within)), draw(within))
    pairs = st.tuples(within, within)
    points = np.array(draw(st.lists(pairs, min_size=1, max_size=4)))
    tilts = draw(st.none() | within | st.lists(within, min_size=len(points), max_size=len(points)))
    limits = 10.0 ** draw(st.floats(0.0, 1.5)), 10.0 ** draw(st.floats(0.5, 4.0))
    stretch = draw(st.floats(1.0 + 1e-9, 4.0))
    times = [draw(within)]
    for way in np.linalg.norm(np.diff(points, axis=0), axis=1).tolist():
        jerk = limits[1] if kind == "jerk_limited" else 1e12
        times.append(times[-1] + (stretch * least_time(way, limits[0], jerk) if way else 0.25))
    if kind == "sampled":
        if draw(st.booleans()):
            how = {"tilts": tilts, "hold": draw(st.booleans())}
            return HandMotion.sampled(times, accelerations=points, **how)
        return HandMotion.sampled(times, points, tilts=tilts)
    more = {"minimum_jerk": (), "trapezoid": limits[:1], "jerk_limited": limits}[kind]
    return getattr(HandMotion, kind)(times, points, *more, tilts=tilts)


def rates(state: Any) -> list[tuple[Floats, Floats]]:
    """Quantities of a `HandState` and their rates."""
    place, turn = (state.position, state.velocity), (state.tilt, state.tilt_rate)
    return [place, (place[1], state.acceleration), turn, (turn[1], state.tilt_acceleration)]


@given(motions(), st.floats(0.01, 0.99))
def test_velocity_and_acceleration_are_the_rates_of_position_and_velocity(
    motion: Any, share: float
) -> None:
    """By central differences of sixth order between the breakpoints."""
    edges = [-3.0, *motion.breakpoints(-3.0, 12.0), 12.0]
    for begin, end in pairwise(edges):
        t, h = begin + share * (end - begin), 0.002 * min(end - begin, 1.0)
        offsets = np.array([-3, -2, -1, 0, 1, 2, 3])
        weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60.0 * h)
        near = motion.at(t + h * offsets)
        for value, rate in rates(near):
            found = np.tensordot(weights, value, 1)
            scale = 1.0 + np.abs(rate).max() + 1e-14 * np.abs(value).max() / h / 1e-8
            np.testing.assert_allclose(found, rate[3], rtol=0, atol=1e-8 * scale)


@given(motions())
def test_there_is_no_jump_of_velocity_and_of_some_kinds_none_of_acceleration(motion: Any) -> None:
    state = motion.to_dict()
    smooth = state["kind"] in ("minimum_jerk", "jerk_limited") or "positions" in state
    for t in motion.breakpoints(-3.0, 12.0):
        before, after = motion.at(np.nextafter(t, -9.0)), motion.at(t)
        for k, (value, rate) in enumerate(rates(before)):
            other = rates(after)[k]
            np.testing.assert_allclose(value, other[0], rtol=1e-11, atol=1e-11)
            if smooth or k in (0, 2, 3):
                np.testing.assert_allclose(rate, other[1], rtol=1e-10, atol=1e-8)


@given(motions(MOVES))
def test_moves_rest_at_every_point_exactly_and_stay_on_the_lines_between(motion: Any) -> None:
    there = motion.at(motion.times)
    np.testing.assert_array_equal(there.position, motion.points)
    np.testing.assert_array_equal(there.tilt, np.broadcast_to(motion.tilts, len(motion.times)))
    assert not there.velocity.any() and not there.tilt_rate.any()
    outside = motion.at([motion.times[0] - 5.0, motion.times[-1] + 5.0])
    np.testing.assert_array_equal(outside.position, motion.points[[0, -1]])
    assert not outside.velocity.any() and not outside.acceleration.any()
    for k, way in enumerate(np.diff(motion.points, axis=0)):
        t = np.linspace(*motion.times[k : k + 2], 50)
        aside = np.linalg.det(np.stack([motion.at(t).position - motion.points[k],
                                        np.broadcast_to(way, (50, 2))], axis=1))  # fmt: skip
        np.testing.assert_allclose(aside, 0.0, atol=1e-14)


@given(motions(("trapezoid", "jerk_limited")))
def test_limits_are_kept_and_reached_at_the_lowest_top_speed(motion: Any) -> None:
    acceleration, jerk = motion.acceleration, getattr(motion, "jerk", 1e15)
    rows = motion.compile().acceleration[1]
    sizes = np.linalg.norm(rows[:, :, 0], axis=1)
    slopes = np.linalg.norm(rows[:, :, 1:], axis=(1, 2))
    limited = slopes / jerk if jerk < 1e15 else sizes / acceleration
    assert sizes.max() <= acceleration * (1 + 1e-9)
    np.testing.assert_allclose(np.minimum(limited, abs(limited - 1.0)), 0.0, atol=1e-6)
    for k, way in enumerate(np.linalg.norm(np.diff(motion.points, axis=0), axis=1).tolist()):
        begin, end = motion.times[k : k + 2].tolist()
        speeds = np.linalg.norm(motion.at(np.linspace(begin, end, 201)).velocity, axis=1)

        def excess(v: float, time: float = end - begin, way: float = way) -> float:
            return v * (time - ramp(v, acceleration, jerk)) - way

        # The way is v (time - ramp(v)); a top speed of 2 way / time leaves no time to cruise.
        top = 2.0 * way / (end - begin)
        speed = brentq(excess, 0.0, top, xtol=1e-12) if excess(top) > 0 else top
        assert abs(speeds.max() - speed) <= 1e-6 * speed


logarithms = st.floats(-1.0, 1.0)


@example(1.0, [0.0, 0.0, None], 0.25)
@given(within, st.tuples(logarithms, logarithms, st.none() | st.floats(-1.0, 5.0)), st.floats(0, 1))
def test_a_move_needs_the_time_that_the_message_names(
    begin: float, powers: Sequence[float | None], share: float
) -> None:
    way, acceleration, jerk = (1e15 if power is None else 10.0**power for power in powers)

    def move(until: float) -> Any:
        rows = [begin, until], [[0.0, 0.0], [0.6 * way, 0.8 * way]], acceleration
        if powers[2] is None:
            return HandMotion.trapezoid(*rows)
        return HandMotion.jerk_limited(*rows, jerk)

    least = least_time(way, acceleration, jerk)
    with pytest.raises(ValueError, match=r"^HandMotion\.times\[1\] = \S+: must be at") as error:
        move(begin + least * (1 - 1e-6))
    found = float(re.findall(r"at least (\S+),", str(error.value))[0])
    assert abs(found - begin - least) < 1e-6 * least
    # In the least time nothing is cruised, and the speed is highest halfway.
    motion = move(found)
    middle, other = motion.at(0.5 * (begin + found)), motion.at(begin + share * (found - begin))
    np.testing.assert_allclose(middle.position, [0.3 * way, 0.4 * way], rtol=1e-12)
    assert np.linalg.norm(other.velocity) <= np.linalg.norm(middle.velocity) * (1 + 1e-12)
    assert np.linalg.norm(other.acceleration) <= acceleration * (1 + 1e-9)
    pieces = 4 if way < 2.0 * acceleration**3 / jerk**2 else 2 if powers[2] is None else 6
    assert len(motion.breakpoints(-9.0, 999.0)) == pieces + 1


@given(motions(("minimum_jerk",)), st.floats(0.0, 1.0))
def test_minimum_jerk_is_its_formula(motion: Any, s: float) -> None:
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    for k, way in enumerate(np.diff(motion.points, axis=0)):
        t = motion.times[k] + s * (motion.times[k + 1] - motion.times[k])
        state = motion.at(t)
        np.testing.assert_allclose(state.position, motion.points[k] + share * way, atol=1e-14)
        if np.ndim(motion.tilts):
            turned = motion.tilts[k] + share * (motion.tilts[k + 1] - motion.tilts[k])
            np.testing.assert_allclose(state.tilt, turned, atol=1e-14)


@given(motions(("sampled",)), st.floats(-0.2, 1.2))
def test_samples_are_interpolated_as_the_docstring_says(motion: Any, share: float) -> None:
    times = motion.times
    t = times[0] + share * (times[-1] - times[0])
    inside = float(np.clip(t, times[0], times[-1]))
    state = motion.at(t)
    if getattr(motion, "hold", False):
        # Each acceleration from its time on, as if there were the differences alone.
        since = np.maximum(t - times, 0.0)[:, None]
        steps = np.diff(motion.accelerations, axis=0, prepend=0.0)
        acceleration = (steps * (times <= t)[:, None]).sum(axis=0)
        np.testing.assert_allclose(state.acceleration, acceleration, atol=1e-14)
        np.testing.assert_allclose(state.velocity, (steps * since).sum(axis=0), atol=1e-11)
        np.testing.assert_allclose(state.position, (steps * since**2 / 2.0).sum(axis=0), atol=1e-11)
    elif motion.accelerations is not None and len(times) > 1:
        for axis, samples in enumerate(motion.accelerations.T):
            if 0.0 <= share < 1.0:
                assert abs(state.acceleration[axis] - np.interp(t, times, samples)) < 1e-12

            def sample(u: float, samples: Floats = samples) -> float:
                return float(np.interp(u, times, samples))

            options: Any = {"points": times[1:-1], "epsabs": 1e-13, "limit": 200}
            velocity = quad(sample, times[0], inside, **options)[0]
            lever = quad(lambda u: (inside - u) * sample(u), times[0], inside, **options)[0]
            assert abs(state.velocity[axis] - velocity) < 1e-11
            assert abs(state.position[axis] - lever - velocity * max(t - inside, 0.0)) < 1e-11
    if motion.positions is not None and len(times) > 1:
        rest = [(1, 0.0), (2, 0.0)]
        for axis, samples in enumerate(motion.positions.T):
            spline = make_interp_spline(times, samples, k=5, bc_type=(rest, rest))
            assert abs(state.position[axis] - spline(inside)) < 1e-11
        np.testing.assert_allclose(motion.at(times).position, motion.positions, atol=1e-14)


def test_shaking_and_constant_acceleration_are_their_formulas() -> None:
    t = np.linspace(-1.0, 1.0, 7)
    omega = 2 * np.pi * 3.0
    wave, swing = 0.01 * np.sin(omega * t + 0.4), 0.01 * omega * np.cos(omega * t + 0.4)
    angles = {"x": (1, 0, 0), "y": (0, 1, 0), "tilt": (0, 0, 1), 0.5: (np.cos(0.5), np.sin(0.5), 0)}
    for axis, (x, y, turn) in angles.items():
        state = HandMotion.sine(0.01, 3.0, axis, phase=0.4, tilt=0.2).at(t)
        np.testing.assert_allclose(state.position, np.outer(wave, [x, y]), atol=1e-15)
        np.testing.assert_allclose(state.velocity, np.outer(swing, [x, y]), atol=1e-14)
        expected = -(omega**2) * np.outer(wave, [x, y, turn])
        found = np.column_stack([state.acceleration, state.tilt_acceleration])
        np.testing.assert_allclose(found, expected, atol=1e-13)
        np.testing.assert_allclose(state.tilt, 0.2 + turn * wave, atol=1e-15)
    state = HandMotion.constant((1.0, -2.0), tilt=0.3).at(t)
    np.testing.assert_allclose(state.position, np.outer(t**2 / 2, [1.0, -2.0]), atol=1e-15)
    np.testing.assert_allclose(state.velocity, np.outer(t, [1.0, -2.0]), atol=1e-15)
    np.testing.assert_array_equal(state.acceleration, np.broadcast_to([1.0, -2.0], (7, 2)))
    assert (state.tilt == 0.3).all() and not state.tilt_rate.any()


@given(motions(), st.floats(-1.0, 8.0))
def test_the_compiled_accelerations_are_those_of_the_motion(motion: Any, t: float) -> None:
    """As a core reads them: the piece, the time since its start, ascending powers."""
    compiled = motion.compile()
    found = []
    for breaks, rows in (compiled.acceleration, compiled.tilt):
        piece = sum(t >= edge for edge in breaks)
        since = t - breaks[piece - 1] if piece else t
        found += [Polynomial(row)(since) for row in rows[piece]]
    for omega, phase, x, y, turn in compiled.sines:
        wave = np.sin(omega * t + phase)
        found = list(np.add(found, [-x * omega**2 * wave, -y * omega**2 * wave, turn * wave]))
    state = motion.at(t)
    scale = 1.0 + np.abs(state.acceleration).max()
    np.testing.assert_allclose(found, [*state.acceleration, state.tilt], rtol=0, atol=1e-9 * scale)


@given(motions(), st.floats(-1.0, 8.0))
def test_the_mirror_image_moves_like_the_image_in_a_mirror(motion: Any, t: float) -> None:
    changes: dict[str, Any] = {"tilt": -1} if hasattr(motion, "tilt") else {"tilts": -1}
    kind = motion.to_dict()["kind"]
    if kind == "sine":
        changes |= {"amplitude": 1 if motion.axis == "y" else -1}
    pairs = ("acceleration",) if kind == "constant" else ("points", "positions", "accelerations")
    changes |= {name: [-1, 1] for name in pairs if getattr(motion, name, None) is not None}
    image = {name: getattr(motion, name) * np.array(signs) for name, signs in changes.items()}
    if kind == "sine" and not isinstance(motion.axis, str):
        image["axis"] = -motion.axis
    ours, theirs = motion.at(t), replace(motion, **image).at(t)
    for name in ("position", "velocity", "acceleration"):
        value = getattr(ours, name) * [-1, 1]
        np.testing.assert_allclose(getattr(theirs, name), value, rtol=1e-12, atol=1e-12)
    for name in ("tilt", "tilt_rate", "tilt_acceleration"):
        assert getattr(theirs, name) == -getattr(ours, name)


@given(motions(MOVES), st.integers(-20, 20), st.integers(-20, 20), st.floats(0.0, 1.0))
def test_other_units_of_powers_of_two_give_the_same_bits(
    motion: Any, length: int, time: int, share: float
) -> None:
    meter, second = 2.0**length, 2.0**time
    limits = {"acceleration": meter / second**2, "jerk": meter / second**3}
    changes = {n: getattr(motion, n) * f for n, f in limits.items() if hasattr(motion, n)}
    other = replace(motion, times=motion.times * second, points=motion.points * meter, **changes)
    t = motion.times[0] + share * (motion.times[-1] - motion.times[0])
    ours, theirs = motion.at(t), other.at(t * second)
    np.testing.assert_array_equal(theirs.position, ours.position * meter)
    np.testing.assert_array_equal(theirs.acceleration, ours.acceleration * (meter / second**2))


@given(motions())
def test_a_motion_makes_the_round_trip(motion: Any) -> None:
    text = tomli_w.dumps(motion.to_dict())
    for other in (
        sp.HandMotion.from_dict(tomllib.loads(text)),
        pickle.loads(pickle.dumps(motion)),
        eval(repr(motion), {"HandMotion": HandMotion}),
    ):
        assert other == motion and hash(other) == hash(motion)


def test_many_runs_are_each_run_and_complex_numbers_give_derivatives() -> None:
    points = np.array([[0.0, 0.0], [0.1, 0.05], [0.1, -0.1]])
    times, tilts = [0.0, 0.4, 0.8], [0.0, 0.2, 0.1]
    cases: list[tuple[Any, str, tuple[int, ...]]] = [
        (HandMotion.minimum_jerk(times, points, tilts), "points", (1, 0)),
        (HandMotion.minimum_jerk(times, points, tilts), "tilts", (1,)),
        (HandMotion.trapezoid(times, points, 6.0), "acceleration", ()),
        (HandMotion.trapezoid(times, points, 6.0), "times", (1,)),
        (HandMotion.jerk_limited(times, points, 6.0, 200.0), "jerk", ()),
        (HandMotion.jerk_limited(times, points, 60.0, 120.0), "points", (1, 1)),
        (HandMotion.sampled(times, accelerations=points), "accelerations", (2, 0)),
        (HandMotion.sampled(times, accelerations=points, hold=True), "accelerations", (1, 1)),
        (HandMotion.sine(0.01, 3.0, 0.4), "axis", ()),
        (HandMotion.sine(0.01, 3.0, "tilt"), "frequency", ()),
        (HandMotion.constant((1.0, 2.0)), "acceleration", (1,)),
    ]

    def flat(compiled: Any) -> list[Any]:
        return [*compiled.position, *compiled.tilt, *compiled.sines]

    for motion, name, place in cases:
        step = 1e-6
        up, down = (_moved(motion, name, place, by) for by in (step, -step))
        runs = motion.compile_runs({name: np.array([getattr(up, name), getattr(down, name)])})
        slopes = _moved(motion, name, place, 1j * _TINY).compile()
        for found, high, low, slope in zip(
            *map(flat, (runs, up.compile(), down.compile(), slopes)), strict=True
        ):
            np.testing.assert_array_equal(found, [high, low])
            difference = (high - low) / (2.0 * step)
            np.testing.assert_allclose(np.imag(slope) / _TINY, difference, rtol=1e-5, atol=1e-6)


ENDS = [[0.0, 0.0], [0.1, 0.0]]
BAD: list[tuple[str, tuple[Any, ...], str]] = [
    # A way in no time would be a jump.
    (
        "minimum_jerk",
        ([0.0, 0.0], ENDS),
        r"times\[1\] = 0\.0: must be greater than the time before",
    ),
    ("minimum_jerk", ([0.0, 1e-200], ENDS), r"times: too close together"),
    ("trapezoid", ([1.0, 1.0 + 1e-15], ENDS, 1e40), r"times: too close together"),
    ("minimum_jerk", ([0.0, 1.0], [0.0, 0.1]), r"points has shape \(2,\): must have"),
    ("minimum_jerk", ([0.0], ENDS), r"points has 2 rows: must have one for each of"),
    ("minimum_jerk", ([0.0, 1.0], ENDS, [0.0]), r"tilts has 1 rows: must have one for each of"),
    ("minimum_jerk", ([0.0, 1.0], ENDS, np.inf), r"tilts = inf: must be finite"),
    ("trapezoid", ([0.0, 1.0], ENDS, -1.0), r"acceleration = -1\.0: must be finite and > 0"),
    ("jerk_limited", ([0.0, 1.0], ENDS, 1.0, 0.0), r"jerk = 0\.0: must be finite and > 0"),
    ("sampled", ([0.0, 1.0],), "positions: are missing; so are accelerations and tilts"),
    ("sampled", ([0.0, 1.0], ENDS, None, None, True), r"hold = True: holds accelerations, which"),
    ("sampled", ([0.0, 1.0], ENDS, ENDS), "accelerations: must not be given together"),
    ("sine", (0.1, 0.0, "x"), r"frequency = 0\.0: must be finite and > 0"),
    ("sine", (0.1, 1e200, "x"), r"frequency = 1e\+200: the acceleration must be finite"),
    ("sine", (0.1, 1.0, "z"), r'axis = \'z\': must be one of "x", "y", "tilt"'),
    ("constant", (1.0,), r"acceleration has shape \(\): must have shape \(2,\)"),
]


@pytest.mark.parametrize(("kind", "arguments", "message"), BAD)
def test_bad_motions_are_refused(kind: str, arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=rf"^HandMotion\.{message}"):
        getattr(HandMotion, kind)(*arguments)


def csv(columns: Any, heading: str = "") -> str:
    return heading + "\n".join(",".join(map(repr, row)) for row in np.asarray(columns).tolist())


def log(end: float = 0.6, period: float = 1e-3, noise: float = 0.0) -> Floats:
    """Time, x, y and tilt of a move from 0.1 to 0.5 s, logged from 0 to the end."""
    move = sp.HandMotion.minimum_jerk([0.1, 0.5], [[0.0, 0.0], [0.4, 0.2]], [0.1, 0.5])
    times = np.arange(0.0, end + 0.5 * period, period)
    at = move.at(times)
    rows = np.column_stack([at.position, at.tilt])
    return np.column_stack([times, rows + noise * np.random.default_rng(0).normal(size=rows.shape)])


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_a_log_is_read_from_a_file(noise: float, tmp_path: Path) -> None:
    path, rows = tmp_path / "robot.csv", log(noise=noise)
    times, place, tilts = rows[:, 0], rows[:, 1:3], rows[:, 3]
    for heading in ("", "time [s],x [m],y [m],tilt [rad]\n"):
        path.write_text(csv(rows, heading))
        assert HandMotion.from_csv(path) == HandMotion.sampled(times, place, tilts=tilts)
        assert HandMotion.from_csv(path, kind="accelerations", hold=True) == HandMotion.sampled(
            times, accelerations=place, tilts=tilts, hold=True
        )
    path.write_text(csv(rows[:, :3]))
    assert HandMotion.from_csv(path) == HandMotion.sampled(times, place)
    # From rest at once, with a constant acceleration, and in one move.
    t = np.linspace(0.0, 1.0, 5)
    path.write_text(
        csv(np.column_stack([t, np.where(t < 0.5, 2 * t**2, 1 - 2 * (1 - t) ** 2), t * 0]))
    )
    HandMotion.from_csv(path)
    path.write_text("0,0,0\n1,1,0\n")
    HandMotion.from_csv(path)


def test_a_log_that_begins_or_ends_in_motion_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.csv"
    for rows, which in ((log(0.35), "last"), (log(0.45), "last"), (log()[200:], "first")):
        for some in (rows, rows[:, :3], rows * [1.0, 0.0, 0.0, 1.0]):
            path.write_text(csv(some))
            with pytest.raises(ValueError, match=rf"robot\.csv: moves .* in its {which} interval"):
                HandMotion.from_csv(path)
        path.write_text(csv(rows[:, :3]))
        HandMotion.from_csv(path, kind="accelerations")


def test_a_file_that_is_no_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "robot.csv"
    for wrong in ("0,1\n1,2\n", "0,1,2,3,4\n1,1,2,3,4\n", "0;1;2\n", "", "0,0,0\n1,x,0\n"):
        path.write_text(wrong)
        with pytest.raises(ValueError, match=r"robot\.csv: must have three or four columns"):
            HandMotion.from_csv(path)
    path.write_text("0,0,0\n0,1,0\n")
    with pytest.raises(ValueError, match=r"HandMotion\.times"):
        HandMotion.from_csv(path)
    with pytest.raises(ValueError, match="kind = 'speeds'"):
        HandMotion.from_csv(path, kind="speeds")
