"""Unilateral contact in the core against the facts that another simulation found."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
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
    push,
)

FINE = {"tolerance": 1e-11, "method": "dop853"}


def scene(friction: float | None, **changes: Any) -> sp.Scene:
    grasped = sp.GraspedObject(height=HEIGHT)
    contact = "bilateral" if friction is BILATERAL else "unilateral"
    return sp.Scene(grasped=grasped, friction=friction, contact=contact, **changes)


def steps(degrees: list[tuple[int, int]]) -> sp.Schedule:
    return sp.Schedule.steps(np.arange(float(len(degrees))), np.deg2rad(degrees))


@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize("friction", ENDS)
def test_the_eight_operations_end_where_another_simulation_has_them(
    friction: float | None, formulation: str
) -> None:
    run = sp.simulate(
        scene(friction, schedule=steps(OPERATIONS), duration=8.0),
        formulation=formulation,
        times=np.arange(1.0, 9.0),
        record=("state", "energy"),
        **FINE,
    )
    angles, heights = np.rad2deg(run.q[:, 2]), run.q[:, 1] * 1e3
    ends = " ".join(f"{a:.3f}/{y:.3f}" for a, y in zip(angles, heights, strict=True))
    assert ends.replace("-0.000/", "0.000/") == ENDS[friction]
    assert run.status == "completed"
    assert np.abs(run.energy.closure).max() <= 1e-9 * run.energy.exchanged
    if friction is BILATERAL:
        return
    assert run.holds and 18 <= len(run.contact_changes) <= 33
    opened = [c.time for c in run.contact_changes if c.after == sp.ContactMode.FREE]
    closed = [c.time for c in run.contact_changes if c.before == sp.ContactMode.FREE]
    assert opened == OPENINGS
    apart = np.subtract(closed, opened)
    assert apart.min() > 1e-4 and apart.max() < 4.05e-3
    if friction == 0.5:
        assert f"{run.energy.friction_loss[-1] * 1e3:.0f}" == "110"
        assert f"{run.energy.impact_loss[-1] * 1e3:.0f}" == "132"
        assert f"{run.energy.controller_work[-1]:.1f}" == "1.6"


@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("case", DEGREES)
def test_disturbances_end_as_in_another_simulation(case: str, friction: float) -> None:
    disturbed = scene(
        friction,
        schedule=steps([(DEGREES[case], DEGREES[case])]),
        disturbances=sp.paper.disturbance(case).disturbances,
        duration=2.0,
    )
    run = sp.simulate(disturbed, **FINE)
    angle = math.degrees(run.q[-1, 2])
    if case == "i":
        assert run.holds == (friction >= 0.8)
        assert run.status == ("completed" if run.holds else "lost")
        assert not run.holds or 14.35 < angle < 14.5
        assert friction != 0.5 or f"{run.t[-1]:.4f}" == "1.0161"
        return
    assert run.holds
    slips = SLIPPED.get((case, friction))
    assert bool(run.contact_changes) == ("slipping" in run.violations) == (slips is not None)
    if slips:
        assert f"{angle:.2f}" == slips
    else:
        same = sp.simulate(replace(disturbed, contact="bilateral"), **FINE)
        np.testing.assert_array_equal(run.q, same.q)


@pytest.mark.parametrize(("milliseconds", "slips", "holds"), SMOOTH)
def test_smooth_moves_need_the_friction_that_another_simulation_found(
    milliseconds: int, slips: float, holds: float
) -> None:
    move = milliseconds * 1e-3
    moves = sp.Schedule.minimum_jerk(np.arange(8.0), np.deg2rad(OPERATIONS), move_time=move)
    enough, too_little = (
        sp.simulate(scene(friction, schedule=moves, duration=8.0), every=100)
        for friction in (holds, slips)
    )
    assert not enough.contact_changes and not enough.violations and enough.holds
    assert too_little.contact_changes
    assert 6.0 < too_little.violations["slipping"] < 6.0 + 2 * move


def held(friction: float | None, direction: Direction, size: float) -> bool:
    pushed = scene(friction, disturbances=[push(direction, size)], duration=1.51)
    run = sp.simulate(pushed, every=10**6)
    return run.success if friction is BILATERAL else run.holds


@pytest.mark.parametrize(
    ("direction", "friction"), [(d, friction) for d, row in PUSHES.items() for friction in row]
)
def test_pushes_are_held_up_to_what_another_simulation_found(
    direction: Direction, friction: float | None
) -> None:
    size = PUSHES[direction][friction]
    low, high = 0.98 * size, 1.02 * size
    assert held(friction, direction, low) and not held(friction, direction, high)
    for _ in range(4):
        middle = (low + high) / 2
        if held(friction, direction, middle):
            low = middle
        else:
            high = middle
    assert (low + high) / 2 == pytest.approx(size, rel=0.01)
