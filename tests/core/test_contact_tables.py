"""The oracle of unilateral contact against the results of an earlier, independent simulation.

Both come from independent programs. Of the paper's parameters, with faces 49 mm high.
"""

import math
from typing import Any

import numpy as np
import pytest

import contact_facts
import softpinch as sp
from bare_scenes import paper, push, steps
from contact_facts import (
    BILATERAL,
    DEGREES,
    ENDS,
    FRICTIONS,
    HEIGHT,
    OPENINGS,
    OPERATIONS,
    PUSHES,
    SLIPPED,
    SMOOTH,
    Direction,
)
from oracle import UnilateralReference, reference, unilateral


def operations(friction: float, count: int, **changes: Any) -> UnilateralReference:
    scene = paper(**{"schedule": steps(OPERATIONS), "duration": float(count), **changes})
    return unilateral(scene, friction, HEIGHT, np.arange(1.0, count + 1))


def ends(run: UnilateralReference) -> list[str]:
    angles, heights = np.rad2deg(run.q[:, 2]), run.q[:, 1] * 1e3
    found = [f"{a:.3f}/{y:.3f}" for a, y in zip(angles, heights, strict=True)]
    return [each.replace("-0.000/", "0.000/") for each in found]


def closes(run: UnilateralReference) -> None:
    assert abs(run.imbalance) <= 1e-11 * run.exchanged
    assert run.worst["normal"] >= 0 and run.worst["cone"] <= 1e-12 and run.worst["gap"] >= 0
    assert run.worst["position"] <= 1e-11 and run.worst["velocity"] <= 1e-10


def test_the_first_two_operations_end_where_another_simulation_has_them() -> None:
    run = operations(0.5, 2)
    assert ends(run) == ENDS[0.5].split()[:2]
    assert [c[1:] for c in run.changes] == [
        ("left", "stick", "free", "input"),
        ("left", "free", "slip-", "gap"),
        ("left", "slip-", "stick", "stopped"),
    ]
    assert run.changes[0].time == 1.0
    closes(run)


@pytest.mark.slow
@pytest.mark.parametrize("friction", FRICTIONS)
def test_the_eight_operations_end_where_another_simulation_has_them(friction: float) -> None:
    run = operations(friction, 8)
    assert ends(run) == ENDS[friction].split()
    assert 18 <= len(run.changes) <= 33 and run.holds
    opened = [c.time for c in run.changes if c.after == "free"]
    assert opened == OPENINGS
    closed = [c.time for c in run.changes if c.before == "free"]
    apart = np.subtract(closed, opened)
    assert apart.min() > 1e-4 and apart.max() < 4.05e-3
    if friction == 0.5:
        assert f"{run.ledger['friction'] * 1e3:.0f}" == "110"
        assert f"{run.ledger['impact'] * 1e3:.0f}" == "132"
        assert f"{run.ledger['torque']:.1f}" == "1.6"
    closes(run)


@pytest.mark.slow
@pytest.mark.parametrize(("milliseconds", "slips", "holds"), SMOOTH)
def test_smooth_moves_need_the_friction_that_another_simulation_found(
    milliseconds: int, slips: float, holds: float
) -> None:
    """And with it, nothing slips or opens, and the bilateral result holds."""
    degrees = np.deg2rad(OPERATIONS)
    move = milliseconds * 1e-3
    moves = sp.Schedule.minimum_jerk(np.arange(8.0), degrees, move_time=move)
    scene = paper(schedule=moves, duration=6.1)
    run = unilateral(scene, holds, HEIGHT, [6.1])
    assert not run.changes and run.holds
    np.testing.assert_allclose(run.q, reference(scene, [6.1]).q, atol=1e-9)
    assert unilateral(scene, slips, HEIGHT).changes
    closes(run)


def disturbed(case: str, friction: float) -> UnilateralReference:
    degrees = DEGREES[case]
    scene = paper(
        schedule=steps([(degrees, degrees)]),
        disturbances=sp.paper.disturbance(case).disturbances,
        duration=2.0,
    )
    return unilateral(scene, friction, HEIGHT, [1.0, 2.0])


def test_the_step_of_case_i_is_lost_at_friction_of_a_half() -> None:
    run = disturbed("i", 0.5)
    assert run.status == "lost" and not run.holds
    assert {c.after for c in run.changes} == {"stick", "slip+", "slip-", "graze", "free"}
    assert f"{run.end.t:.4f}" == "1.0161"
    closes(run)


@pytest.mark.slow
@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("case", DEGREES)
def test_disturbances_end_as_in_another_simulation(case: str, friction: float) -> None:
    run = disturbed(case, friction)
    closes(run)
    angle = math.degrees(run.end.q[2])
    if case == "i":
        assert run.holds == (friction >= 0.8) and run.status == (
            "completed" if run.holds else "lost"
        )
        assert not run.holds or 14.35 < angle < 14.5
        return
    assert run.holds
    slips = SLIPPED.get((case, friction))
    assert bool(run.changes) == (slips is not None)
    if slips:
        assert f"{angle:.2f}" == slips


# Pushes of 10 ms


def held(friction: float, direction: Direction, size: float) -> bool:
    scene = paper(disturbances=[contact_facts.push(direction, size)], duration=1.51)
    return unilateral(scene, friction, HEIGHT, [1.0]).holds


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "friction"),
    [(d, friction) for d, row in PUSHES.items() for friction in row if friction is not BILATERAL],
)
def test_pushes_are_held_up_to_what_another_simulation_found(
    direction: Direction, friction: float
) -> None:
    size = PUSHES[direction][friction]
    assert held(friction, direction, 0.99 * size)
    assert not held(friction, direction, 1.02 * size)


@pytest.mark.slow
def test_method_and_tolerance_change_neither_events_nor_their_times() -> None:
    """The oracle's own error."""
    scene = paper(disturbances=[push()], duration=1.03)
    fine = unilateral(scene, 0.8, HEIGHT, [1.02, 1.03], rtol=1e-12)
    for method, rtol in (("DOP853", 1e-10), ("RK45", 1e-10)):
        rough = unilateral(scene, 0.8, HEIGHT, [1.02, 1.03], method=method, rtol=rtol)
        assert [c[1:] for c in rough.changes] == [c[1:] for c in fine.changes]
        for one, other in zip(rough.changes, fine.changes, strict=True):
            assert one.time == pytest.approx(other.time, abs=1e-9)
        np.testing.assert_allclose(rough.q, fine.q, atol=1e-9)
