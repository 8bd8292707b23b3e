"""Runs with unilateral contact that go on from a row of an earlier run: the same bits."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import _core
from unilateral_scenes import RECORD, gripped, pushes, regripped, thrown


def struck() -> sp.Scene:
    """Two impulses, of which the first opens both tips and the second comes while one is open."""
    return gripped(
        disturbances=(
            sp.Impulse(time=0.02, impulse=(0.8, 0.5), angular_impulse=0.02),
            sp.Impulse(time=0.0321, impulse=(-0.3, 0.5), angular_impulse=0.01),
        )
    )


SCENES = {"thrown": thrown(), "regripped": regripped(), "struck": struck()}


def require_same_rest(run: sp.Run, k: int, how: dict[str, Any]) -> None:
    """The run from row `k` on has the bits of the rest of the run, and the same changes."""
    left = run.scene.duration - float(run.t[k])
    scene = replace(run.scene, initial=run.state(k), duration=left)
    again = sp.simulate(scene, **how)
    assert (again.status, again.holds) == (run.status, run.holds)
    # The end is the start and the duration together, to round-off.
    np.testing.assert_allclose(again.t, run.t[k:], rtol=4e-16)
    for name in ("q", "p", "integral", "multipliers", "residuals", "contact"):
        np.testing.assert_array_equal(
            getattr(again, name), getattr(run, name)[k:], err_msg=f"{name} from row {k}"
        )
    # A change at the very instant of the row is one of the first run, or of both.
    later = [change for change in run.contact_changes if change.time > run.t[k]]
    assert [change for change in again.contact_changes if change.time > run.t[k]] == later


@pytest.mark.parametrize("method", _core.METHODS)
@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize("name", SCENES)
def test_rows_around_events_breakpoints_and_impulses(
    name: str, formulation: str, method: str
) -> None:
    how = {"dt": 2e-4, "method": method, "formulation": formulation, "record": RECORD}
    run = sp.simulate(SCENES[name], **how)
    around = np.searchsorted(run.t, [change.time for change in run.contact_changes])
    kept = {int(row) + step for row in around for step in (-2, -1, 0, 1)} | {0, 57, len(run) // 2}
    for k in kept & set(range(len(run) - 1)):
        require_same_rest(run, k, how)


@given(pushes(), st.sampled_from(_core.METHODS), st.sampled_from(["csm", "projected"]), st.data())
def test_any_row_of_a_shaken_grasp(
    scene: sp.Scene, method: str, formulation: str, data: st.DataObject
) -> None:
    how: dict[str, Any] = {"method": method, "formulation": formulation, "record": RECORD}
    run = sp.simulate(scene, dt=4e-4, **how)
    k = data.draw(st.integers(0, max(0, len(run) - 2)))
    if len(run) > 1:
        require_same_rest(run, k, {"dt": 4e-4, **how})


def test_a_slip_that_an_impact_of_the_other_tip_has_stopped_goes_on() -> None:
    tips = (
        sp.Fingertip(normal_mass=0.02, tangential_mass=0.01),
        sp.Fingertip(normal_mass=0.05),
    )
    opens = sp.Schedule.steps([0.0, 0.02], np.deg2rad([[6.0, 6.0], [0.0, 0.0]]))
    scene = sp.Scene(
        hand=sp.Hand(tip=tips), schedule=opens, duration=0.04, friction=1.0, contact="unilateral"
    )
    run = sp.simulate(scene, dt=4e-4, record=RECORD)
    for k in range(66, 72):
        codes = run.state(k).contact[:2]
        slips = run.contact[k] == sp.ContactMode.SLIP
        np.testing.assert_array_equal(np.sign(codes[slips]), np.sign(run.residuals[k, 2:][slips]))
        require_same_rest(run, k, {"dt": 4e-4, "record": RECORD})


@pytest.mark.parametrize("name", SCENES)
def test_states_keep_their_contacts_in_files(name: str) -> None:
    how: dict[str, Any] = {"dt": 2e-4, "record": RECORD}
    run = sp.simulate(SCENES[name], **how)
    modes = {sp.ContactMode(mode) for mode in run.contact.ravel()}
    assert {sp.ContactMode.FREE, sp.ContactMode.STICK, sp.ContactMode.SLIP} <= modes
    for k in np.flatnonzero((run.contact == sp.ContactMode.FREE).any(axis=1))[:2].tolist():
        state = run.state(k)
        left = replace(run.scene, initial=state, duration=run.scene.duration - state.time)
        read = sp.Scene.from_toml(left.to_toml())
        assert read == left
        np.testing.assert_array_equal(sp.simulate(read, **how).q, run.q[k:])
        again = pickle.loads(pickle.dumps(run))
        np.testing.assert_array_equal(again.state(k).contact, state.contact)
