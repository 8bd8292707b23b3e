"""`Run.violation_intervals` and `Run.holds`, compared with the rows of the same run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import softpinch as sp
from scenes import jerked
from softpinch import strategies
from violations import HEIGHTS, RECORD, shown

ADAPTIVE = {"tolerance": 1e-6, "method": "dop853"}


def intervals(t: NDArray[np.float64], rows: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The first and the last instant of each stretch of true rows, (k, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(int)))
    return np.stack([t[edges[::2]], t[edges[1::2] - 1]], axis=1)


@given(
    strategies.scenes(duration=0.05, force=60.0),
    HEIGHTS,
    st.sampled_from([None, "pulling", "rim"]),
)
def test_intervals_are_the_stretches_of_rows_that_show_a_violation(
    scene: sp.Scene, height: float | None, stop_on: str | None
) -> None:
    scene = replace(scene, grasped=replace(scene.grasped, height=height))
    stops = (stop_on,) if stop_on else ()
    run = sp.simulate(scene, dt=5e-4, stop_on=stops, record=RECORD)
    expected = {name: intervals(run.t, rows) for name, rows in shown(run).items() if rows.any()}
    assert run.violation_intervals.keys() == expected.keys()
    for name, found in run.violation_intervals.items():
        np.testing.assert_array_equal(found, expected[name], err_msg=name)
        assert run.violations[name] == found[0, 0]


@given(
    strategies.scenes(duration=0.05, force=60.0),
    st.sampled_from(["rk4", "implicit_midpoint", "dop853"]),
    st.integers(1, 1000),
)
def test_intervals_do_not_depend_on_the_record(scene: sp.Scene, method: str, every: int) -> None:
    how: dict[str, Any] = {"dt": 1e-3, "method": method, "stop_on": ()}
    full = sp.simulate(scene, **how, record=RECORD)
    bare = sp.simulate(scene, **how, record=(), every=every)
    assert full.violation_intervals.keys() == bare.violation_intervals.keys()
    for name, found in full.violation_intervals.items():
        np.testing.assert_array_equal(found, bare.violation_intervals[name])
    assert full.holds == bare.holds


def test_adaptive_steps_note_stretches_of_their_own_ends() -> None:
    """Here no tip leaves and comes back inside a step, so that the rows are all that was seen."""
    run = sp.simulate(jerked(), **ADAPTIVE, record=RECORD, stop_on=())  # type: ignore[arg-type]
    expected = {name: intervals(run.t, rows) for name, rows in shown(run).items() if rows.any()}
    assert {"pulling", "slipping"} <= expected.keys() == run.violation_intervals.keys()
    for name, found in run.violation_intervals.items():
        np.testing.assert_array_equal(found, expected[name])


@given(
    strategies.scenes(duration=0.05, force=60.0),
    st.floats(-0.01, 0.06),
    st.sampled_from([{"dt": 5e-4}, ADAPTIVE]),
)
def test_a_grasp_holds_if_it_completes_and_no_later_instant_shows_a_pull_or_a_slip(
    scene: sp.Scene, after: float, how: dict[str, Any]
) -> None:
    run = sp.simulate(scene, **how, record=RECORD, summaries_after=after)
    late = run.t >= after
    lost = shown(run)
    broken = bool(((lost["pulling"] | lost["slipping"]) & late).any())
    assert run.holds == (run.status == "completed" and not broken)
    # The intervals say the same: their ends are instants that show it.
    nothing = np.full((1, 2), -np.inf)
    last = [run.violation_intervals.get(name, nothing)[-1, 1] for name in ("pulling", "slipping")]
    assert run.holds == (run.success and max(last) < after)


def test_the_start_and_a_jump_decide_only_what_is_asked_from_them_on() -> None:
    held = {
        after: sp.simulate(jerked(), summaries_after=after).holds for after in (None, 9e-3, 0.02)
    }
    assert held == {None: False, 9e-3: False, 0.02: True}
    lost = sp.Scene(schedule=sp.Schedule.steps([0.0], [[-0.2, -0.2]]))
    assert not sp.simulate(lost, summaries_after=0.9).holds
    with pytest.raises(ValueError, match=r"^summaries_after = nan: must be finite"):
        sp.simulate(jerked(), summaries_after=np.nan)
