"""Runs with unilateral contact: how they end, what they record, and their estimated error."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.run import measures
from unilateral_parts import grasp
from unilateral_scenes import RECORD, gripped, regripped, thrown

FREE, STICK, SLIP, GRAZE = sp.ContactMode
ADAPTIVE: dict[str, Any] = {"tolerance": 1e-9, "method": "dop853", "formulation": "projected"}
# The equal steps are short, so that times of events differ by round-off of the adaptive ones.
HOW: list[dict[str, Any]] = [{"dt": 1e-4, "method": "dop853"}, ADAPTIVE]


# How runs end


@pytest.mark.parametrize("how", HOW, ids=["dt", "tolerance"])
@pytest.mark.parametrize("make", [thrown, regripped])
@pytest.mark.parametrize("stop_on", ["slipping", "opened"])
def test_a_run_ends_with_the_step_in_which_a_tip_slips_or_opens(
    stop_on: str, make: Callable[[], sp.Scene], how: dict[str, Any]
) -> None:
    mode = SLIP if stop_on == "slipping" else FREE
    free = sp.simulate(make(), stop_on=(), record=RECORD, **how)
    began = min(change.time for change in free.contact_changes if change.after == mode)
    run = sp.simulate(make(), stop_on=stop_on, record=RECORD, **how).check(residual=1e-4)
    assert (run.status, run.holds) == (stop_on, False)
    assert run.violations[stop_on] == began == run.violation_intervals[stop_on][0, 0]
    # The first step that ends at the event or after it.
    end = began if "tolerance" in how else free.t[np.searchsorted(free.t, began)]
    assert run.t[-1] == end
    word = {"slipping": "slipped", "opened": "left the object"}[stop_on]
    # The message may have the time of the event, or that of the step's end.
    found = re.search(rf"fingertip {word} at (?:or before )?t = (\S+) s$", run.message)
    assert found and found[1] in (f"{began:.6g}", f"{end:.6g}"), run.message
    assert run.violations == {k: t for k, t in free.violations.items() if t <= end}
    np.testing.assert_array_equal(run.q, free.q[: len(run)])


@pytest.mark.parametrize("how", HOW, ids=["dt", "tolerance"])
def test_an_object_is_lost_where_a_contact_leaves_its_face(how: dict[str, Any]) -> None:
    run = sp.simulate(thrown(), record=RECORD, **how).check(residual=1e-4)
    assert (run.status, run.success, run.holds) == ("lost", False, False)
    # The right contact is at the end of its face: A_1 of (26) is -G_1.
    matrix = sp.evaluate(
        gripped(contact="bilateral"), run.t[-1], run.q[-1], run.p[-1]
    ).constraint_matrix
    assert abs(matrix[0, 2]) == pytest.approx(0.0245, abs=1e-9)
    assert run.contact[-1].tolist() == [SLIP, FREE]
    assert run.t[-1] == pytest.approx(0.0563905557, abs=1e-9)
    endless = sp.simulate(thrown(grasped=sp.GraspedObject()), **how)
    assert (endless.status, endless.holds) == ("completed", False)


@pytest.mark.parametrize(("kind", "seed"), [("measured law", 48), ("tilted face", 182)])
def test_a_free_tip_that_passes_a_corner_within_a_step_has_met_the_face(
    kind: str, seed: int
) -> None:
    """At the end of a step it may be behind the face, and beyond the end that it passed since."""
    scene = grasp(kind, seed, duration=0.03)
    fine = sp.simulate(scene, dt=1e-5)
    assert fine.status == "lost"
    steps: list[dict[str, Any]] = [{"dt": 2e-4}, {"dt": 5e-4}, {"tolerance": 1e-6}]
    for how in steps:
        run = sp.simulate(scene, method="dop853", **how)
        assert run.status == "lost"
        assert run.t[-1] == pytest.approx(fine.t[-1], rel=1e-6)


def test_contacts_that_change_without_end_are_chattering() -> None:
    """Tips of 16 kg, which let go of the object and touch it again within nanoseconds."""
    tip = sp.Fingertip(
        normal_mass=15.680934914572132,
        tangential_mass=19.938359184908933,
        youngs_modulus=180156.17699230104,
    )
    angles = np.deg2rad([[6.0, 6.0], [-14.180380540228231, 18.942143903056973]])
    force = (-4.438650969373551, -2.237307771073855)
    scene = sp.Scene(
        hand=sp.Hand(tip=tip),
        contact="unilateral",
        friction=2.119842157503312,
        schedule=sp.Schedule.steps([0.0, 0.03], angles),
        disturbances=[
            sp.Pulse(time=0.02, duration=0.01, force=force, moment=0.9007853321207124),
        ],
        duration=0.08,
    )
    run = sp.simulate(scene, dt=5e-5, record=RECORD)
    assert (run.status, run.holds) == ("chattering", False)
    last = [change.time for change in run.contact_changes if change.time > run.t[-2]]
    assert len(last) > 8 and last[-1] <= run.t[-1] < run.t[-2] + 5e-5
    assert run.message.startswith(
        "the modes of the contacts changed more than 64 times within one step at "
        f"t = {run.t[-1]:.6g} s (the right tip "
    )
    assert "less friction, may avoid it" in run.message
    run.check(residual=1e-3, closure=math.inf)


def test_contact_that_only_presses_stays_as_it_is() -> None:
    run = sp.simulate(gripped(), record=RECORD).check()
    assert run.holds and not run.violations and not run.contact_changes
    assert (run.contact == STICK).all()
    assert not run.energy.friction_loss.any() and not run.energy.impact_loss.any()


# What they record


def test_rows_at_switches_and_impulses() -> None:
    """Contacts are those after a switch, and those before an impulse, as the state is."""
    run = sp.simulate(regripped(), record=RECORD)
    row = int(np.searchsorted(run.t, 0.02))
    assert run.contact[row - 1 : row + 1].tolist() == [[STICK, STICK], [STICK, FREE]]
    assert run.multipliers[row, 1] == 0.0 != run.multipliers[row - 1, 1]
    push = sp.Impulse(time=0.02, impulse=(0.8, 0.5), angular_impulse=0.02)
    struck = sp.simulate(gripped(disturbances=(push,)), record=RECORD)
    changed = [change for change in struck.contact_changes if change.time == 0.02]
    assert changed
    assert struck.contact[row].tolist() == [STICK, STICK]
    assert not (struck.contact[row + 1] == STICK).all()


@pytest.mark.parametrize("make", [thrown, regripped])
@pytest.mark.parametrize("method", ["dop853", "radau5", "rosenbrock"])
def test_rows_at_asked_times_across_events(make: Callable[[], sp.Scene], method: str) -> None:
    exact = sp.simulate(make(), dt=2.5e-5, method="dop853", record=RECORD)
    grid = exact.t[: int(0.95 * len(exact))][::7]
    events = [change.time for change in exact.contact_changes]
    # No row may be so near an event that the error of its time decides.
    asked = grid[np.abs(grid[:, None] - events).min(axis=1) > 1e-7]
    assert len(asked) > 0.9 * len(grid)
    run = sp.simulate(
        make(), tolerance=1e-10, method=method, times=asked, record=RECORD, formulation="projected"
    )
    ends = np.append(asked, exact.t[-1])
    assert run.t[:-1].tolist() == asked.tolist() and run.t[-1] == pytest.approx(ends[-1], abs=1e-9)
    rows = np.searchsorted(exact.t, asked)
    np.testing.assert_array_equal(run.contact[:-1], exact.contact[rows])
    for name in ("q", "p", "multipliers"):
        right = getattr(exact, name)
        size = np.abs(right).max(axis=0)
        apart = np.abs(getattr(run, name)[:-1] - right[rows]) / size
        # Between the ends of steps a polynomial of order 3 or 7 stands for the motion.
        assert apart.max() < (1e-7 if method == "dop853" else 1e-5), name
    assert [change[1:] for change in run.contact_changes] == [
        change[1:] for change in exact.contact_changes
    ]
    np.testing.assert_allclose([change.time for change in run.contact_changes], events, atol=1e-9)


# The estimated error


@pytest.mark.parametrize("make", [thrown, regripped])
@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize(
    ("method", "dt"),
    [("rk4", 1e-4), ("radau5", 1e-4), ("rosenbrock", 5e-5), ("implicit_midpoint", 2e-5)],
)
def test_the_estimated_error_is_that_of_the_run(
    make: Callable[[], sp.Scene], formulation: str, method: str, dt: float
) -> None:
    """Across slips, openings and impacts, because events are located to the method's order."""
    how: dict[str, Any] = {"formulation": formulation, "record": ("state", "multipliers")}
    run = sp.simulate(make(), dt=dt, method=method, estimate_error=True, **how)
    found = run.error_estimate
    # The last row of a run that is lost is one that the finer runs may lack.
    lost = np.isinf(found.q[-1]).any()
    assert found.asymptotic or (lost and "may be wrong" not in found.message), found.message
    exact = sp.simulate(make(), dt=dt, method="dop853", **how)
    n = min(len(run), len(exact)) - 1
    for name in ("q", "p", "multipliers"):
        right = getattr(exact, name)[:n]
        error = np.abs(getattr(run, name)[:n] - right)
        size = np.maximum(np.abs(right).max(axis=0), 1e-9)
        largest = float((error / size).max())
        assert 0.5 * largest < found.largest[name] < 2.0 * largest


# What is derived from them


def test_measures_of_free_tips() -> None:
    run = sp.simulate(regripped(), record=RECORD)
    demand, free = measures.friction_demand(run), run.contact == FREE
    assert free.any() and not demand[free].any()
    assert demand.max() <= 0.5 * (1 + 1e-12)
    assert demand[run.contact == SLIP] == pytest.approx(0.5)
    # The left tip is free for a while in the second operation.
    least = measures.least_pressing(run)
    assert least[0] > 0.0 == least[1]
    assert measures.pulling_intervals(run, 1) == []
    held = measures.held_residuals(run)
    # The row at a change has the state before it.
    modes = measures.contact_modes(run)
    assert not held[:, :2][modes == FREE].any() and not held[:, 2:][modes != STICK].any()
    assert np.abs(run.residuals[:, :2])[free].max() > 1e-5
    assert measures.peak_residuals(run).max() == held[1:].max()
    bare = sp.simulate(regripped(), record=("state", "residuals"))
    np.testing.assert_array_equal(measures.held_residuals(bare), held)
    both = sp.simulate(gripped(contact="bilateral"), record=RECORD)
    np.testing.assert_array_equal(measures.held_residuals(both), np.abs(both.residuals))


def test_evaluate_refuses_unilateral_contact_and_names_the_remedy() -> None:
    scene = gripped()
    run = sp.simulate(scene, dt=1e-5, formulation="projected", record=("state", "multipliers"))
    state = run.t[-1], run.q[-1], run.p[-1], run.integral[-1]
    message = 'Scene.contact = "unilateral": evaluate has the terms of bilateral contact only; '
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        sp.evaluate(scene, *state)
    terms = sp.evaluate(replace(scene, contact="bilateral"), *state, formulation="projected")
    # Both tips stick here.
    np.testing.assert_allclose(terms.multipliers, run.multipliers[-1], rtol=1e-9, atol=1e-7)
