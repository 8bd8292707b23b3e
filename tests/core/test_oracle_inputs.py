"""Schedules, disturbances and impulses, as the reference, the oracle and the core read them.

Every expected number is computed by hand from the interface's description. Two readings are held
to them: that of `accuracy.segments`, for the reference and the oracle, and the core's.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import softpinch as sp
from oracle import reference
from softpinch.accuracy.segments import Inputs

Floats = NDArray[np.float64]
BEGIN, END = -2.0, 100.0


def driven_at(scene: sp.Scene, times: list[float]) -> tuple[Floats, Floats]:
    """The inputs of a scene just after each instant (n, 5): by `Inputs`, and by the core."""
    inputs = Inputs(scene, BEGIN, END)
    ours, cores = [], []
    for t in times:
        k = int(np.searchsorted(inputs.edges, t, side="right"))
        ours.append(inputs.between(*inputs.edges[k - 1 : k + 1])(t))
        here = sp.evaluate(scene, t, np.zeros(9), np.zeros(9))
        cores.append([*here.target, *here.forces.external[:3]])
    return np.array(ours), np.array(cores)


TIMES, ANGLES = [0.0, 1.0, 2.0], [[1.0, -2.0], [3.0, -6.0], [0.0, 0.0]]
SCHEDULES: dict[str, tuple[sp.Schedule, list[tuple[float, float]]]] = {
    "steps": (
        sp.Schedule.steps(TIMES, ANGLES),
        [(-1, 1), (0, 1), (0.99, 1), (1, 3), (2, 0), (9, 0)],
    ),
    "sampled zero": (
        sp.Schedule.sampled(TIMES, ANGLES, hold="zero"),
        [(-1, 1), (0.5, 1), (1, 3), (2, 0), (9, 0)],
    ),
    "ramps": (
        sp.Schedule.ramps(TIMES, ANGLES),
        [(-1, 1), (0, 1), (0.25, 1.5), (1, 3), (1.5, 1.5), (2, 0), (9, 0)],
    ),
    "sampled linear": (
        sp.Schedule.sampled(TIMES, ANGLES, hold="linear"),
        [(-1, 1), (0.25, 1.5), (1.5, 1.5), (9, 0)],
    ),
    "minimum_jerk": (
        sp.Schedule.minimum_jerk(TIMES, ANGLES, move_time=0.5),
        # Halfway there is half the way; a quarter of the time 53/512 of it, three quarters the
        # rest of the way but for 53/512.
        [
            *((-1, 1), (0.9, 1), (1, 1), (1.125, 1 + 2 * 53 / 512), (1.25, 2)),
            *((1.375, 3 - 2 * 53 / 512), (1.5, 3), (1.9, 3), (2.25, 1.5), (2.5, 0), (9, 0)),
        ],
    ),
    "via_points": (
        sp.Schedule.minimum_jerk(TIMES, ANGLES),
        # At t = 1 the velocity is -15/16 and the acceleration -50/3, by hand.
        [
            *((-1, 1), (0, 1), (0.5, 2 + 75 / 512 - 25 / 96), (1, 3)),
            *((1.5, 1.5 - 75 / 512 - 25 / 96), (2, 0), (9, 0)),
        ],
    ),
}


@pytest.mark.parametrize("name", SCHEDULES)
def test_schedules_are_read_as_the_interface_has_them(name: str) -> None:
    schedule, expected = SCHEDULES[name]
    for found in driven_at(sp.Scene(schedule=schedule), [t for t, _ in expected]):
        np.testing.assert_allclose(found, [[v, -2 * v, 0, 0, 0] for _, v in expected], atol=1e-15)


def sampled(hold: str, moment: list[float] | None) -> sp.Sampled:
    return sp.Sampled(times=[1.0, 2.0], force=[[1, 2], [3, 6]], moment=moment, hold=hold)


R = np.sqrt(0.5)
LOAD: dict[str, Any] = {"force": (1, 2), "moment": 3}
DISTURBANCES: dict[str, tuple[sp.Disturbance, list[tuple[float, Any]]]] = {
    "step": (sp.Step(time=1.0, **LOAD), [(0.9, 0), (1, (1, 2, 3)), (99, (1, 2, 3))]),
    "pulse": (
        sp.Pulse(time=1.0, duration=0.5, **LOAD),
        [(0.9, 0), (1, (1, 2, 3)), (1.49, (1, 2, 3)), (1.5, 0)],
    ),
    "sine": (
        sp.Sine(time=1.25, duration=0.5, frequency_hz=1.0, **LOAD),
        [(1, 0), (1.25, 0), (1.375, (R, 2 * R, 3 * R)), (1.5, (1, 2, 3)), (1.75, 0), (2, 0)],
    ),
    "sine for ever": (
        sp.Sine(time=1.0, frequency_hz=1.0, phase=np.pi / 2, **LOAD),
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
    scene = sp.Scene(disturbances=[disturbance, disturbance])
    twice = [2 * np.ones(3) * np.array(load) for _, load in expected]
    for found in driven_at(scene, [t for t, _ in expected]):
        np.testing.assert_allclose(found[:, 2:], twice, atol=1e-14)


def test_every_jump_and_bend_of_an_input_is_an_edge() -> None:
    scene = sp.Scene(
        schedule=sp.Schedule.minimum_jerk([0, 1, 2], np.zeros((3, 2)), move_time=0.5),
        disturbances=[
            sp.Pulse(time=3.0, duration=0.25, **LOAD),
            sp.Sine(time=4.0, frequency_hz=1.0, **LOAD),
            sp.Impulse(time=5.0, impulse=(1.0, 2.0), angular_impulse=3.0),
            sampled("zero", None),
            sp.Step(time=6.0, **LOAD),
            sp.Sine(time=7.0, duration=0.5, frequency_hz=1.0, **LOAD),
        ],
    )
    found = Inputs(scene, -1.0, 9.0)
    assert found.edges == [-1, 1, 1.5, 2, 2.5, 3, 3.25, 4, 5, 6, 7, 7.5, 9]
    assert found.impulses == {5.0: (1.0, 2.0, 3.0)}
    # The first time of a schedule is no edge, as nothing changes there.
    assert Inputs(replace(scene, disturbances=()), -1.0, 9.0).edges == [-1, 1, 1.5, 2, 2.5, 9]


def test_at_the_right_end_of_a_piece_its_own_limit_holds() -> None:
    schedule = sp.Schedule.steps([0.0, 1.0], [[0.0, 0.0], [1.5, 1.5]])
    push = sp.Step(time=1.0, force=(130.0, 130.0), moment=5.0)
    inputs = Inputs(sp.Scene(schedule=schedule, disturbances=[push]), 0.0, 2.0)
    assert inputs.between(0.0, 1.0)(1.0) == (0.0, 0.0, 0.0, 0.0, 0.0)
    assert inputs.between(1.0, 2.0)(1.0)[2:] == (130.0, 130.0, 5.0)


def test_multipliers_at_a_switch_are_those_after_it_but_at_the_end_those_before() -> None:
    steps = sp.Schedule.steps([0.0, 0.02], np.deg2rad([[4.0, 4.0], [10.0, -2.0]]))
    scene = sp.Scene(schedule=steps, duration=0.02)
    before = reference(scene, [0.02])
    scene = replace(scene, duration=0.021)
    after = reference(scene, [0.02])
    np.testing.assert_allclose(before.q, after.q, atol=1e-14)
    assert abs(before.multipliers - after.multipliers).max() > 1.0
    # One that misses the switch by a unit in the last place is still at it.
    nearly = reference(scene, [np.nextafter(0.02, 0)])
    np.testing.assert_array_equal(nearly.multipliers, after.multipliers)
