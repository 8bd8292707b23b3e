"""Derivatives by numbers that move breakpoints: beside differences, and their jump at a switch."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import derivative_paths as paths_of
import softpinch as sp
from derivative_differences import difference
from derivative_scenes import SCHEDULE, entries, uneven
from differences import changed, closest, states
from softpinch import _core

DT = 1e-4
# Steps end here in every run, because an input of size zero begins here; and at the end.
KEPT = (0.0031, 0.0073, 0.0123)
MARKS = tuple(sp.Step(time=time) for time in KEPT)
# Shifts of a time, as shares of a millisecond, smaller than what adds a step of DT to a segment.
# Where two breaks coincide, the error of differences is only of the first order.
LADDER = np.array([2e-2, 6e-3, 2e-3, 2e-4])
# A derivative that moves the motion by less than this share in a millisecond counts as zero.
LEAST = 1e-6

PUSH: dict[str, Any] = {"force": (6.0, -4.0), "moment": 0.04}
ANGLES = np.deg2rad([[4, 5], [8, 3], [6, 6]])
SINE = sp.Sine(frequency_hz=43.0, phase=0.4, time=0.00437, duration=0.00511, **PUSH)
IMPULSE = sp.Impulse(time=0.00557, impulse=(0.02, -0.01), angular_impulse=3e-4)


def with_load(load: Any, *more: Any, **changes: Any) -> sp.Scene:
    return uneven(disturbances=(load, *MARKS, *more), **changes)


# Moves of the hand with jumps of its acceleration, or of its jerk.
WAY = np.array([[0.0, 0.0], [1e-4, 6e-5], [3e-5, 2e-4]])
MOVES = {
    "trapezoid": sp.HandMotion.trapezoid([0.00213, 0.00957], WAY[:2], 20.0, [0.1, 0.3]),
    "limited jerk": sp.HandMotion.jerk_limited([0.00213, 0.00957], WAY[:2], 20.0, 4e4, [0.1, 0.3]),
    "measured accelerations": sp.HandMotion.sampled(
        [0.00213, 0.00557, 0.01011], accelerations=1e5 * WAY, tilts=[0.1, 0.3, 0.2]
    ),
    "held accelerations": sp.HandMotion.sampled(
        [0.00213, 0.00557, 0.01011], accelerations=1e5 * WAY + 5.0, tilts=0.2, hold=True
    ),
}


def carried(name: str, **changes: Any) -> sp.Scene:
    return uneven(motion=MOVES[name], disturbances=MARKS, **changes)


def driven(**changes: Any) -> sp.Scene:
    schedule = sp.Schedule.minimum_jerk([0.0, 0.00213, 0.00943], ANGLES - ANGLES[0], 0.00437)
    return uneven(fingers="driven", schedule=schedule, disturbances=MARKS, **changes)


SCENES = {
    "step": with_load(sp.Step(time=0.00557, **PUSH)),
    "pulse": with_load(sp.Pulse(time=0.00557, duration=0.00511, **PUSH)),
    "sine": with_load(SINE),
    "endless sine": with_load(replace(SINE, duration=None)),
    "impulse": with_load(IMPULSE),
    "impulse with a step": with_load(IMPULSE, sp.Step(time=IMPULSE.time, **PUSH)),
    "step with an impulse": with_load(sp.Step(time=IMPULSE.time, **PUSH), IMPULSE),
    "samples": with_load(
        sp.Sampled(
            times=np.array([0.00213, 0.00557, 0.01011]),
            force=np.array([[6.0, 1.0], [-4.0, 2.0], [3.0, 3.0]]),
        )
    ),
    "samples joined": with_load(
        sp.Sampled(
            times=np.array([0.00213, 0.00557, 0.01011]),
            force=np.array([[6.0, 1.0], [-4.0, 2.0], [3.0, 3.0]]),
            hold="linear",
        )
    ),
    "jumping targets": uneven(
        schedule=sp.Schedule.steps([0.0, 0.00557, 0.01011], ANGLES), disturbances=MARKS
    ),
    "ramps": uneven(
        schedule=replace(SCHEDULE, times=np.array([0.00213, 0.00557, 0.01011])), disturbances=MARKS
    ),
    "smooth targets": uneven(
        schedule=sp.Schedule.minimum_jerk([0.0, 0.00213, 0.00943], ANGLES, 0.00437),
        disturbances=MARKS,
    ),
    "driven fingers": driven(),
    **{name: carried(name) for name in MOVES},
    "driven fingers, carried": driven(motion=MOVES["trapezoid"]),
}


def size(scene: sp.Scene, path: str) -> float:
    """A millisecond; of numbers that are no times, the largest one's size."""
    is_time = path.split(".")[-1] in paths_of.TIMES
    return 1e-3 if is_time else float(np.abs(paths_of.value(scene, path)).max())


def at_kept(run: sp.Run) -> Any:
    rows = np.append(np.searchsorted(run.t, KEPT), len(run.t) - 1)
    np.testing.assert_array_equal(run.t[rows[:-1]], KEPT)
    return rows


# Each scene with one formulation, each formulation with a third of the scenes; then all with all.
PAIRS = [
    pytest.param(name, formulation, marks=[pytest.mark.slow] * ((k - n) % 3 != 0))
    for k, name in enumerate(SCENES)
    for n, formulation in enumerate(_core.FORMULATIONS)
]


@pytest.mark.parametrize(("name", "formulation"), PAIRS)
def test_differences_agree_where_breakpoints_move(name: str, formulation: str) -> None:
    scene = SCENES[name]
    how: dict[str, Any] = {"dt": DT, "method": "dop853", "formulation": formulation}
    # The schedule of the others begins with the run, so that two sides of its start differ.
    own = "schedule." if scene.disturbances == MARKS else "disturbances."
    marks = [f"disturbances.{k}.time" for k in (1, 2, 3)]
    times = paths_of.inputs(scene, times=True)
    paths = [path for path in times if path.startswith(own) and path not in marks]
    if scene.motion is not None:
        # The points of a move determine the instants of its jumps, too.
        names = ("times", "points", "accelerations", "acceleration", "jerk")
        paths = [f"motion.{name}" for name in names if np.any(getattr(scene.motion, name, None))]
    run = sp.simulate(scene, sensitivities=paths, **how)
    assert run.success
    rows = at_kept(run)
    moves = 0
    for path in paths:
        for index in entries(scene, path):

            def moved(by: float, path: str = path, index: Any = index) -> Any:
                other = sp.simulate(changed(scene, path, index, by), **how)
                return states(other)[at_kept(other)]

            ours = run.sensitivity[path][(rows, ..., *index)]
            moves += bool(ours.any())
            least = LEAST / size(scene, path) * states(run)[rows]
            steps = (LADDER * size(scene, path)).tolist()
            assert closest(ours, moved, steps, least) <= 1e-7, (path, index)
    assert moves > 0


@pytest.mark.parametrize("method", _core.METHODS)
def test_the_derivative_jumps_at_a_switch_by_the_jump_of_the_rates(method: str) -> None:
    scene = SCENES["step"]
    step: Any = scene.disturbances[0]
    time = step.time
    # The run ends just after the switch.
    just_after = replace(scene, duration=time + 1e-12)
    path = "disturbances.0.time"
    for formulation in _core.FORMULATIONS:
        run = sp.simulate(
            just_after, dt=5e-4, method=method, formulation=formulation, sensitivities=path
        )
        before, after = run.sensitivity[path][-2:]
        assert run.t[-2] == time
        assert not before.any()
        calm = with_load(replace(step, force=(0.0, 0.0), moment=0.0))
        rates = [
            sp.evaluate(
                one, time, run.q[-2], run.p[-2], run.integral[-2], formulation=formulation
            ).accelerations
            for one in (calm, scene)
        ]
        jump = np.concatenate([np.zeros(9), rates[0] - rates[1]])
        assert difference(after[None, 9:], jump[None, 9:], "rates") <= 1e-6
        assert np.abs(after[:9]).max() <= 1e-9 * np.abs(jump).max()


@pytest.mark.parametrize("time", [0.0, 0.02, 0.05])
def test_a_switch_at_the_start_the_end_or_later_moves_nothing_before_it(time: float) -> None:
    scene = uneven(disturbances=(sp.Step(time=time, **PUSH),))
    run = sp.simulate(scene, dt=5e-4, sensitivities="disturbances.0.time")
    found = run.sensitivity["disturbances.0.time"]
    assert not found[0].any()
    assert found[1:].any() == (time == 0.0)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_an_impulse_that_moves_acts_at_the_angles_of_its_new_time(formulation: str) -> None:
    """Driven fingers are under way when it comes."""
    angles = np.deg2rad([[3.0, 3.0], [5.0, 5.0], [4.0, 6.0]])
    schedule = sp.Schedule.minimum_jerk([0.0, 0.01, 0.03], angles, 0.015)

    def run(time: float, **asked: Any) -> sp.Run:
        impulse = sp.Impulse(time=time, impulse=(0.01, 0.01))
        scene = sp.Scene(duration=0.03, fingers="driven", schedule=schedule, disturbances=[impulse])
        return sp.simulate(scene, 1e-4, "dop853", formulation, every=1000, **asked)

    path, h = "disturbances.0.time", 1e-5
    ours = run(0.02003, sensitivities=path).sensitivity[path][-1]
    later, sooner = (states(run(0.02003 + by))[-1] for by in (h, -h))
    theirs = (later - sooner) / (2.0 * h)
    for part in (slice(0, 9), slice(9, 18)):
        assert np.abs(ours[part] - theirs[part]).max() <= 1e-5 * np.abs(theirs[part]).max()
