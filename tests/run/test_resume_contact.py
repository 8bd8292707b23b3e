"""Runs with unilateral contact that go on from a row of an earlier run: the same bits."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from random_pinches import random_pinch
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


PAIRS = [(f, m) for f in ("csm", "projected") for m in _core.METHODS]


@pytest.mark.parametrize(
    ("name", "formulation", "method"),
    [
        *(("regripped", *pair) for pair in PAIRS),
        *((name, *pair) for name in ("thrown", "struck") for pair in (PAIRS[0], PAIRS[-2])),
    ],
)
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
    run = sp.simulate(scene, dt=2e-4, **how)
    k = data.draw(st.integers(0, max(0, len(run) - 2)))
    if len(run) > 1:
        require_same_rest(run, k, {"dt": 2e-4, **how})


def test_a_slip_that_an_impact_of_the_other_tip_has_met_goes_on() -> None:
    rng = np.random.default_rng(5)
    how: dict[str, Any] = {"dt": 5e-5, "record": RECORD}
    met = 0
    for _ in range(60):
        scene = replace(random_pinch(rng, "unilateral"), duration=0.1)
        run = sp.simulate(scene, **how)
        hits = [change for change in run.contact_changes if change.before == sp.ContactMode.FREE]
        for hit in hits if run.status != "unstable" else ():
            other = 1 if hit.finger == "right" else 0
            row = int(np.searchsorted(run.t, hit.time))
            if run.contact[row - 1, other] != sp.ContactMode.SLIP or row + 1 >= len(run):
                continue
            met += 1
            for k in (row, row + 1):
                codes = run.state(k).contact[:2]
                slips = run.contact[k] == sp.ContactMode.SLIP
                velocities = run.residuals[k, 2:][slips]
                np.testing.assert_array_equal(np.sign(codes[slips]), np.sign(velocities))
                require_same_rest(run, k, how)
    assert met > 5
