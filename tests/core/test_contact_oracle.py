"""The oracle of unilateral contact against invariants, and the bilateral oracle.

Closed forms are compared with the core, and the core with the oracle.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from oracle import UnilateralReference, reference, unilateral
from scenes import uneven

# Half the height of a face, m.
HALF = 0.0245
HELD = sp.Schedule.steps([0.0], np.deg2rad([[6, 6]]))
PUSH = sp.Step(time=0.02, force=(130.0, 130.0), moment=5.0)


def paper(**changes: Any) -> sp.Scene:
    return sp.Scene(**{"schedule": HELD, "duration": 0.05, **changes})


def check(run: UnilateralReference) -> None:
    """Asserts the conditions that hold along any run."""
    # Without forces nothing is exchanged, and round-off remains.
    assert abs(run.imbalance) <= 1e-9 * run.exchanged + 1e-15
    assert run.ledger["friction"] >= 0
    assert run.ledger["stop"] >= 0
    assert run.ledger["viscous"] <= 0
    assert run.worst["normal"] >= -1e-8
    assert run.worst["cone"] <= 1e-8
    assert run.worst["gap"] >= -1e-12
    assert run.worst["position"] <= 1e-11
    assert run.worst["velocity"] <= 1e-10
    for modes, forces in zip(run.modes, run.multipliers, strict=True):
        for i, mode in enumerate(modes):
            assert mode in ("stick", "slip+", "slip-") or not forces[[i, 2 + i]].any()


def test_a_surface_that_comes_to_zero_stops_there() -> None:
    """Beside an object that both tips miss by 1 cm."""
    heavy = sp.Finger(mass=1e-9, inertia=1e12, root_offset=0.059)
    q, p = np.zeros(9), np.zeros(9)
    q[1], q[6], q[8], p[6] = heavy.length, 1e-4, 1e-5, -2.0
    hand, start = sp.Hand(right=heavy, left=heavy), sp.State(q, p)
    run = unilateral(paper(hand=hand, initial=start, duration=0.01), 0.5, times=[0.0, 0.01])
    assert run.q[-1, [6, 8]].tolist() == run.p[-1, [6, 8]].tolist() == [0, 0]
    assert 0.1 < run.ledger["stop"] < 0.1 * 2.0**2 / 2
    check(run)


# The bilateral oracle, and the mirror


@pytest.mark.parametrize("case", ["paper", "uneven"])
def test_where_nothing_pulls_or_slips_it_is_the_bilateral_oracle(case: str) -> None:
    pulse = sp.Pulse(time=0.03, duration=0.01, force=(2.0, 1.0), moment=0.02)
    # An impulse would open the contact that it moves away from.
    scene = {"paper": paper(), "uneven": replace(uneven(), schedule=HELD)}[case]
    scene = replace(scene, duration=0.08, disturbances=[pulse])
    times = np.linspace(0, 0.08, 9)
    ours, theirs = unilateral(scene, 2.0, 2 * HALF, times), reference(scene, times)
    assert not ours.changes and ours.holds
    for name, size in (("q", 1e-12), ("p", 1e-10), ("multipliers", 1e-8), ("integral", 1e-13)):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=size)
    check(ours)


# Runs with all modes


@pytest.mark.parametrize(
    ("friction", "disturbance"),
    [
        (0.5, PUSH),
        (0.8, sp.Pulse(time=0.02, duration=0.01, moment=27.6)),
        (0.3, sp.Pulse(time=0.02, duration=0.01, force=(232.0, 0.0))),
        (0.4, sp.Impulse(time=0.02, impulse=(0.4, 0.3), angular_impulse=5e-4)),
        (5.0, PUSH),
    ],
    ids=["i", "turn", "x", "impulse", "much friction"],
)
def test_constraints_cones_gaps_and_the_ledger_hold_along_any_run(
    friction: float, disturbance: Any
) -> None:
    for scene in (paper(), replace(uneven(), schedule=HELD, duration=0.05)):
        scene = replace(scene, disturbances=[disturbance])
        run = unilateral(scene, friction, 2 * HALF, np.linspace(0, 0.05, 26))
        assert run.status in ("completed", "lost") and run.changes
        assert run.status == "completed" or friction < 5
        check(run)
        if isinstance(disturbance, sp.Pulse):
            assert run.ledger["impact"] >= 0


def test_two_contacts_that_open_each_other_in_turn_settle_with_both_closed() -> None:
    """Each collision of the left tip opens the right one, with an eighth of the speed."""
    run = unilateral(paper(disturbances=[PUSH]), 5.0, 2 * HALF)
    times = [c.time for c in run.changes if c[1:4] == ("right", "stick", "free")]
    apart = np.diff(times)
    np.testing.assert_allclose(apart[1:4] / apart[:3], 0.135, atol=0.05)
    assert run.holds and len(times) < 12
    check(run)


def test_wanted_instants_change_no_event() -> None:
    """The tip meets the face 0.3 mm from its end, within a step that leaves the face."""
    push_along = sp.Pulse(time=1.0, duration=0.01, force=(231.95, 0.0))
    scene = paper(disturbances=[push_along], duration=1.02)
    few = unilateral(scene, 0.3, 2 * HALF, [1.02])
    many = unilateral(scene, 0.3, 2 * HALF, [*np.linspace(1.0, 1.02, 21), 1.01327])
    assert [c[1:] for c in few.changes] == [c[1:] for c in many.changes]
    for one, other in zip(few.changes, many.changes, strict=True):
        assert one.time == pytest.approx(other.time, abs=1e-9)
    np.testing.assert_allclose(few.q[-1], many.q[-2], atol=1e-9)


def driven(**changes: Any) -> sp.Scene:
    """A smooth move of driven fingers, pushed on the way."""
    move = sp.Schedule.minimum_jerk([0.0, 0.0137], np.deg2rad([[5, 6], [8, 4]]), move_time=0.0411)
    pulse = sp.Pulse(time=0.03, duration=0.01, force=(80.0, 30.0), moment=2.0)
    return sp.Scene(fingers="driven", schedule=move, disturbances=[pulse], duration=0.08, **changes)


def test_driven_fingers_follow_their_schedule_whatever_the_contact_does() -> None:
    times = np.linspace(0, 0.08, 9)
    run = unilateral(driven(), 0.3, 2 * HALF, times)
    assert len(run.changes) >= 4 and run.holds
    targets = [np.deg2rad([5, 6]), np.deg2rad([8, 4])]
    np.testing.assert_allclose(run.q[[0, -1], 3:5], targets, atol=1e-13)
    np.testing.assert_allclose(run.p[-1, 3:5], 0, atol=1e-12)
    check(run)
    # The inertia of the fingers counts in the torque only.
    heavy = sp.Hand(right=sp.Finger(inertia=0.1), left=sp.Finger(inertia=2e-4))
    same = unilateral(driven(hand=heavy), 0.3, 2 * HALF, times)
    np.testing.assert_allclose(same.q, run.q, atol=1e-13)
    assert [c[1:] for c in same.changes] == [c[1:] for c in run.changes]


@pytest.mark.slow
def test_method_and_tolerance_change_neither_events_nor_their_times() -> None:
    """The oracle's own error."""
    scene = paper(disturbances=[replace(PUSH, time=1.0)], duration=1.03)
    fine = unilateral(scene, 0.8, 2 * HALF, [1.02, 1.03], rtol=1e-12)
    for method, rtol in (("DOP853", 1e-10), ("RK45", 1e-10)):
        rough = unilateral(scene, 0.8, 2 * HALF, [1.02, 1.03], method=method, rtol=rtol)
        assert [c[1:] for c in rough.changes] == [c[1:] for c in fine.changes]
        for one, other in zip(rough.changes, fine.changes, strict=True):
            assert one.time == pytest.approx(other.time, abs=1e-9)
        np.testing.assert_allclose(rough.q, fine.q, atol=1e-9)
