"""Derivatives through slips, openings and impacts, beside differences of runs."""

import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import derivative_paths as paths_of
import softpinch as sp
from derivative_differences import difference
from differences import changed, extrapolated, states
from random_pinches import random_pinch
from unilateral_scenes import regripped

Floats = NDArray[np.float64]
PATHS: list[tuple[str, tuple[int, ...]]] = [
    ("friction", ()),
    ("hand.tip.right.youngs_modulus", ()),
    ("grasped.mass", ()),
    ("grasped.com_offset", ()),
    ("schedule.angles", (0, 1)),
    ("hand.left.length", ()),
    ("hand.tip.left.normal_mass", ()),
    ("control.kp", ()),
]
# Near rest, rates have the round-off of coordinates times the rate of the fastest motions.
ROUND_OFF = np.repeat([1.0, 30.0], 9)
# Shares of a number's size.
LADDER = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


def changes(run: sp.Run) -> list[Any]:
    return [change[1:] for change in run.contact_changes]


def times_of(run: sp.Run) -> Floats:
    return np.array([change.time for change in run.contact_changes])


class Compared:
    """A run with derivatives by one number, and the errors of these beside differences.

    Attributes:
        reason: Why the derivatives end before the run; None if they do not.
        error: Of the states; None if no difference has the changes of contacts that the run has.
        time_error: Of the times of the changes, as a share of the largest.
    """

    def __init__(self, scene: sp.Scene, path: str, index: tuple[int, ...], **how: Any) -> None:
        how = {"stop_on": (), **how}
        self.reason = None
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            self.run = sp.simulate(scene, sensitivities=path, **how)
            for each in said:
                if "no derivatives" in str(each.message):
                    self.reason = str(each.message)
        self.error = self.time_error = None
        ours = self.run.sensitivity[path][(..., *index)]
        if self.run.status in ("unstable", "chattering", "newton_failed"):
            return
        if self.reason is not None:
            assert np.isnan(ours).any()
            return
        assert np.isfinite(ours).all()
        # The last row of a run that is lost is at a time that moves.
        rows = slice(0, None if self.run.success else -1)
        size = paths_of.size(scene, path, index)
        for share in LADDER:
            self._compare(scene, (path, index), share * size, rows, how)

    def _compare(
        self, scene: sp.Scene, by: tuple[str, Any], step: float, rows: slice, how: Any
    ) -> None:
        path, index = by
        found = {
            h: sp.simulate(changed(scene, path, index, h), **how)
            for h in (step, -step, step / 2, -step / 2)
        }
        if any(changes(other) != changes(self.run) for other in found.values()):
            return
        if any(len(other.t) != len(self.run.t) for other in found.values()):
            return

        def derivative(of: Callable[[sp.Run], Floats]) -> Floats:
            return extrapolated(lambda h: of(found[h]), step)

        ours = self.run.sensitivity[path][(..., *index)][rows]
        theirs = derivative(lambda run: states(run)[rows])
        # Where a number changes the motion by less than a millionth, differences are round-off.
        size = paths_of.size(scene, path, index)
        least = 1e-6 / size * (np.abs(states(self.run)[rows]) + ROUND_OFF)
        error = difference(ours, theirs, "state", least)
        times = derivative(times_of)
        own = np.array([each.sensitivity[path][index] for each in self.run.contact_changes])
        off = float(np.abs(own - times).max(initial=0.0) / np.abs(times).max(initial=1e-12))
        # Each by the differences that are best for it.
        self.error = error if self.error is None else min(error, self.error)
        self.time_error = off if self.time_error is None else min(off, self.time_error)


def pinched(
    seed: int, alter: Callable[[sp.Scene], sp.Scene] = lambda scene: scene, **how: Any
) -> Compared:
    """A random pinch, by one of the numbers in turn."""
    scene = alter(random_pinch(np.random.default_rng(seed), "unilateral", 0.03))
    path, index = PATHS[seed % len(PATHS)]
    pushed = [hasattr(push, "force") for push in scene.disturbances]
    if seed % 3 == 0 and pushed and pushed[0]:
        path, index = "disturbances.0.force", (1,)
    return Compared(scene, path, index, **how)


def require_all(compared: Iterable[Compared], most: int) -> None:
    """Requires that most of so many runs are compared, agree, and have every event."""
    seen: set[str] = set()
    errors = []
    for k, found in enumerate(compared):
        if found.error is None:
            continue
        assert found.time_error is not None and found.time_error < 1e-6, k
        errors.append(found.error)
        seen |= {f"{each.before.name} {each.after.name}" for each in found.run.contact_changes}
    # Of a few derivatives that are small, the best differences have more round-off.
    assert max(errors) < 1e-6 and np.quantile(errors, 0.99, method="lower") < 1e-7
    assert len(errors) > 0.65 * most
    assert {"STICK SLIP", "SLIP STICK", "GRAZE FREE", "FREE SLIP"} <= seen


def check(seeds: range, **how: Any) -> None:
    require_all((pinched(seed, **how) for seed in seeds), len(seeds))


@pytest.mark.parametrize(
    ("first", "method", "formulation"),
    [
        (0, "rk4", "csm"),
        (300, "dop853", "projected"),
        pytest.param(0, "implicit_midpoint", "projected", marks=pytest.mark.slow),
        (0, "radau5", "csm"),
        (300, "rosenbrock", "projected"),
    ],
)
def test_random_scenes(first: int, method: str, formulation: str) -> None:
    check(range(first, first + 20), dt=2e-4, method=method, formulation=formulation)


def driven(scene: sp.Scene) -> sp.Scene:
    angles = np.deg2rad([[4, 5], [12, -3]])
    close = sp.Schedule.minimum_jerk([0.0, 0.02], angles, 0.02)
    return replace(scene, fingers="driven", schedule=close, initial=None)


def carried(scene: sp.Scene) -> sp.Scene:
    return replace(scene, motion=sp.HandMotion.constant(acceleration=(3.0, -2.0), tilt=0.2))


@pytest.mark.parametrize("alter", [driven, carried])
@pytest.mark.parametrize("method", ["rk4", "rosenbrock"])
def test_driven_fingers_and_hands_that_move(
    alter: Callable[[sp.Scene], sp.Scene], method: str
) -> None:
    compared = 0
    for seed in (0, 2, 6, 8, 9, 10, 11):
        found = pinched(seed, alter, dt=1e-4, method=method)
        assert found.error is not None and found.error < 1e-7, seed
        compared += len(found.run.contact_changes) > 1
    assert compared >= 4


@pytest.mark.slow
@pytest.mark.parametrize("method", ["rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock"])
@pytest.mark.parametrize("formulation", ["csm", "projected"])
def test_many_random_scenes(method: str, formulation: str) -> None:
    check(range(1000, 1250), dt=2e-4, method=method, formulation=formulation)


@pytest.mark.parametrize("method", ["dop853", "radau5", "rosenbrock"])
def test_steps_of_free_length_have_the_derivatives_of_the_motion(method: str) -> None:
    times = np.linspace(0.0, 0.03, 31)
    for seed in (0, 2, 4, 5, 9):
        scene = random_pinch(np.random.default_rng(seed), "unilateral", 0.03)
        path, index = PATHS[seed % len(PATHS)]
        how: dict[str, Any] = {"sensitivities": path, "times": times}
        fine = sp.simulate(scene, dt=1e-5, method="dop853", **how)
        free = sp.simulate(scene, tolerance=1e-10, method=method, **how)
        assert fine.contact_changes and changes(fine) == changes(free)
        ours, theirs = (run.sensitivity[path][(..., *index)] for run in (free, fine))
        assert difference(ours, theirs) < 1e-7
        for one, other in zip(free.contact_changes, fine.contact_changes, strict=True):
            np.testing.assert_allclose(one.sensitivity[path], other.sensitivity[path], rtol=1e-5)


def test_an_event_at_the_start_but_for_round_off_is_one() -> None:
    """A tip that just touches is relaxed after 5e-18 s, too short a step to choose modes by."""
    scene, path = random_pinch(np.random.default_rng(70020), "unilateral", 0.04), "friction"
    how: dict[str, Any] = {"sensitivities": path, "method": "dop853", "formulation": "projected"}
    free, fine = sp.simulate(scene, tolerance=1e-12, **how), sp.simulate(scene, dt=2e-5, **how)
    assert 0.0 < free.t[1] < 1e-15 and changes(free) == changes(fine)
    ours, theirs = (
        np.array([change.sensitivity[path] for change in run.contact_changes])
        for run in (free, fine)
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-12)


def test_a_row_inside_a_step_is_that_of_a_step_that_ends_there() -> None:
    scene, path = regripped(), "friction"
    whole = sp.simulate(scene, dt=1e-4, sensitivities=path)
    assert whole.contact_changes
    times = np.sort(np.concatenate([whole.t[::7], whole.t[:-1:5] + 0.3e-4, whole.t[-1:]]))
    some = sp.simulate(scene, dt=1e-4, sensitivities=path, times=times)
    times = some.t
    shared = np.isin(times, whole.t)
    ours, theirs = some.sensitivity[path][shared], whole.sensitivity[path]
    theirs = theirs[np.isin(whole.t, times)]
    np.testing.assert_array_equal(ours, theirs)
    assert np.isfinite(some.sensitivity[path]).all()
    # Rows lie on the curve through the rows beside them.
    for k in np.flatnonzero(~shared)[:40]:
        at = int(np.searchsorted(whole.t, times[k]))
        near = whole.sensitivity[path][at - 1 : at + 1]
        span = np.abs(whole.sensitivity[path]).max(axis=0) + 1e-12
        middle = np.abs(some.sensitivity[path][k] - near.mean(axis=0)) / span
        assert middle.max() < 0.5


def test_impulses_act_through_the_law_of_impact() -> None:
    scene = random_pinch(np.random.default_rng(0), "unilateral", 0.03)
    blow = sp.Impulse(time=0.0201, impulse=(0.2, -0.15))
    scene = replace(scene, disturbances=(blow,))
    how: dict[str, Any] = {"dt": 1e-4, "method": "dop853"}
    for path, index in (("disturbances.0.impulse", (1,)), ("disturbances.0.time", ())):
        run = sp.simulate(scene, sensitivities=path, **how)
        assert sum(change.time == 0.0201 for change in run.contact_changes) == 2
        # The object is lost in the end, at a time that moves.
        rows = run.t[-49:-20]

        def moved(
            h: float, path: str = path, index: Any = index, rows: Floats = rows
        ) -> tuple[list[Any], Floats]:
            other = sp.simulate(changed(scene, path, index, h), **how, times=rows)
            return changes(other), states(other)[np.isin(other.t, rows)]

        ours = run.sensitivity[path][(..., *index)][np.isin(run.t, rows)]
        assert moved(1e-6)[0] == changes(run)
        best = min(
            difference(ours, extrapolated(lambda h: moved(h)[1], step))
            for step in (1e-4, 1e-5, 1e-6)
        )
        # Where a path moves a breakpoint, the motion is that of the exact equations.
        assert best < (1e-7 if path.endswith("impulse") else 1e-6), path
        struck = [each for each in run.contact_changes if each.time == 0.0201]
        by_time = [each.sensitivity[path][index] for each in struck]
        assert by_time == [1.0 if path.endswith("time") else 0.0] * 2


@pytest.mark.parametrize("path", ["motion.times.1", "motion.acceleration", "motion.points.1.0"])
def test_jumps_of_the_hands_acceleration_move(path: str) -> None:
    """Tips slip and open before and after the four jumps of a move."""
    scene = random_pinch(np.random.default_rng(9), "unilateral", 0.03)
    way = [[0.0, 0.0], [8e-4, 5e-4]]
    move = sp.HandMotion.trapezoid([0.0053, 0.0207], way, 30.0, [0.0, 0.1])
    scene = replace(scene, motion=move)
    how: dict[str, Any] = {"dt": 1e-4, "method": "dop853", "stop_on": ()}
    run = sp.simulate(scene, **how, sensitivities=path)
    jumps = move.breakpoints(0.0, 0.03)
    assert len(jumps) == 4 and len(run.contact_changes) > 2
    value = scene.vary_paths()[path][0]

    def moved(by: float) -> sp.Run:
        return sp.simulate(scene.with_({path: value + by}), **how)

    ours = run.sensitivity[path][-1:]
    step = 1e-4 * value
    assert changes(moved(step)) == changes(moved(-step)) == changes(run)
    best = min(
        difference(ours, extrapolated(lambda h: states(moved(h))[-1:], by))
        for by in (step, 0.1 * step, 0.01 * step)
    )
    # Where a path moves a breakpoint, the motion is that of the exact equations.
    assert best < 1e-6


COINCIDENT: list[dict[str, Any]] = [
    *({"dt": dt, "method": method} for dt in (1e-4, 2.5e-4) for method in ("rk4", "dop853")),
    *({"tolerance": 10.0**-k, "method": "dop853"} for k in range(3, 13)),
]


@pytest.mark.parametrize("how", COINCIDENT, ids=str)
def test_events_that_coincide_have_no_derivative(how: dict[str, Any]) -> None:
    """The scene is symmetric, but round-off lets one tip stop before the other."""
    scene = sp.Scene(contact="unilateral", friction=0.01, duration=0.02)
    with pytest.warns(
        sp.StabilityWarning, match="coincides with another one.*from there on are NaN"
    ):
        run = sp.simulate(scene, sensitivities="friction", **how)
    slopes = run.sensitivity["friction"]
    first = run.contact_changes[2].time
    # A row at the event itself, but for round-off, is on either side.
    before, after = slopes[run.t < first], slopes[run.t > first + 1e-12]
    assert np.isfinite(before).all() and np.isnan(after).all() and len(after)
    for change in run.contact_changes[2:]:
        assert np.isnan(change.sensitivity["friction"])


def test_a_run_goes_on_from_a_row_in_which_no_tip_is_free() -> None:
    scene, path = regripped(), "friction"
    whole = sp.simulate(scene, dt=1e-4, sensitivities=path, record=("state", "contact"))
    free = (whole.contact == sp.ContactMode.FREE).any(axis=1)
    k = int(np.flatnonzero(free)[-1]) + 3
    later = replace(scene, initial=whole.state(k), duration=float(scene.duration - whole.t[k]))
    rest = sp.simulate(later, dt=1e-4, sensitivities=whole.sensitivity.at(k))
    ours, theirs = rest.sensitivity[path], whole.sensitivity[path][k:]
    assert difference(ours, theirs[: len(ours)]) < 1e-12
    opened = int(np.flatnonzero(free)[3])
    open_scene = replace(scene, initial=whole.state(opened))
    with pytest.raises(ValueError, match=r"^sensitivities: a SensitivityState goes on only from"):
        sp.simulate(open_scene, dt=1e-4, sensitivities=whole.sensitivity.at(opened))


@pytest.mark.parametrize(
    ("how", "text"),
    [
        (
            {"record": ("state", "energy")},
            r'^record = "energy": must be one of the others in unilateral contact',
        ),
    ],
)
def test_what_is_not_followed_is_refused_before_the_run(how: Any, text: str) -> None:
    # A run as long as this one would take minutes.
    scene = replace(regripped(), duration=1e4)
    with pytest.raises(ValueError, match=text):
        sp.simulate(scene, sensitivities="friction", dt=1e-4, every=10**6, **how)


def test_changes_of_a_run_without_derivatives_have_none() -> None:
    assert not sp.simulate(regripped()).contact_changes[0].sensitivity


def test_tips_that_slip_together_have_no_derivative() -> None:
    tip = sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)
    scene = sp.Scene(
        contact="unilateral",
        friction=(0.5, 0.5),
        hand=sp.Hand(tip=tip),
        schedule=sp.Schedule.steps([0.0], [[0.105, 0.105]]),
        duration=0.008,
        disturbances=[sp.Pulse(time=0.005, duration=0.005, force=(0.0, -80.0))],
    )
    with pytest.warns(UserWarning, match="an event coincides with another one"):
        run = sp.simulate(scene, dt=1e-4, sensitivities="friction.left")
    both = [change for change in run.contact_changes if change.after.name == "SLIP"]
    assert len(both) == 2 and both[0].time == both[1].time
    for change in both:
        assert np.isnan(change.sensitivity["friction.left"])
    assert np.isnan(run.sensitivity["friction.left"][-1]).any()
    assert np.isfinite(run.sensitivity["friction.left"][run.t < 0.005]).all()


def test_a_change_at_a_breakpoint_that_moves_has_no_derivative() -> None:
    switch = sp.Schedule.steps([0.0, 0.02], np.deg2rad([[6, 6], [20, -10]]))
    scene = sp.Scene(schedule=switch, contact="unilateral", friction=0.5, duration=0.022)
    with pytest.warns(UserWarning, match="change at a breakpoint that a path moves"):
        run = sp.simulate(scene, dt=1e-4, sensitivities="schedule.times.1")
    assert run.contact_changes[0].time == 0.02
    assert np.isnan(run.contact_changes[0].sensitivity["schedule.times.1"])
    assert run.sensitivity.at(5).derivatives.shape == (20, 1)
    with pytest.raises(
        ValueError,
        match=r'^sensitivity\.at: k = -1: the derivatives by "schedule\.times\.1" are NaN',
    ):
        run.sensitivity.at()


def test_a_direction_without_derivatives_leaves_the_others_alone() -> None:
    switch = sp.Schedule.steps([0.0, 0.02], np.deg2rad([[6, 6], [20, -10]]))
    scene = sp.Scene(schedule=switch, contact="unilateral", friction=0.5, duration=0.03)
    others = ("friction", "grasped.mass", "schedule.angles")
    paths = ("schedule.times.1", *others)
    # Up to a row inside a step, which the run takes again.
    times = np.append(np.arange(0.0, 0.03, 1e-4), [0.02503, 0.03])
    for more in ({}, {"times": np.unique(times)}):
        how: dict[str, Any] = {"dt": 1e-4, **more}
        with pytest.warns(sp.StabilityWarning) as said:
            both = sp.simulate(scene, sensitivities=paths, **how)
        texts = [str(each.message) for each in said if "sensitivities" in str(each.message)]
        assert len(texts) == 1
        assert "change at a breakpoint that a path moves" in texts[0]
        assert 'no derivatives by "schedule.times.1". The derivatives' in texts[0]
        lost = both.sensitivity["schedule.times.1"]
        assert np.isfinite(lost[both.t < 0.02]).all() and np.isnan(lost[both.t >= 0.02]).all()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            alone = sp.simulate(scene, sensitivities=others, **how)
        for path in others:
            assert np.isfinite(both.sensitivity[path]).all()
            np.testing.assert_array_equal(both.sensitivity[path], alone.sensitivity[path])
        for one, own in zip(both.contact_changes, alone.contact_changes, strict=True):
            assert np.isnan(one.sensitivity["schedule.times.1"])
            for path in others:
                np.testing.assert_array_equal(one.sensitivity[path], own.sensitivity[path])
        assert len(both.contact_changes) >= 3
