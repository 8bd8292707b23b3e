"""The oracle against itself: what it takes schedules, disturbances and impulses to be."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bare_scenes import changed, paper, push, steps, uneven
from oracle import PARAMETERS, evaluate, parameters, reference
from oracle.trajectory import breaks, inputs, jump

Floats = NDArray[np.float64]


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
