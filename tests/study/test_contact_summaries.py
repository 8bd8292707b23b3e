"""Summaries of the contact forces, compared with the recorded multipliers of the same runs."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import softpinch as sp
from scenes import jerked
from softpinch import strategies

NAMES = ("pulling_time", "peak_friction_ratio")


def expected(run: sp.Run, after: float) -> dict[str, float]:
    """The summaries of a run with a row for each watched instant, from its rows."""
    rows = run.t >= after
    if not rows.any():
        return dict.fromkeys(NAMES, np.nan)
    t, forces = run.t[rows], run.multipliers[rows]
    normal, across = forces[:, :2], np.abs(forces[:, 2:])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(normal < 0, np.inf, across / np.abs(normal))
    ratio[(normal == 0) & (across == 0)] = 0.0
    pulls = (normal < 0).any(axis=1).astype(float)
    return {
        "pulling_time": float(np.trapezoid(pulls, t)),
        "peak_friction_ratio": float(ratio.max()),
    }


def study(scene: sp.Scene, **how: Any) -> sp.Ensemble:
    return sp.monte_carlo(scene, 1, summaries=NAMES, stop_on=(), progress=False, **how)


def summarised(scene: sp.Scene, **how: Any) -> dict[str, NDArray[np.float64]]:
    return dict(study(scene, **how).summaries)


@given(strategies.scenes(duration=0.05, force=60.0), st.floats(-0.01, 0.06))
def test_contact_summaries_equal_those_of_recorded_multipliers(
    scene: sp.Scene, after: float
) -> None:
    """Also of scenes that pull for a part of the time, and from any instant on."""
    found = study(scene, dt=5e-4, summaries_after=after)
    run = found.replay(0, record="multipliers")
    for name, value in expected(run, after).items():
        np.testing.assert_allclose(found[name][0], value, rtol=1e-12, err_msg=name)


def test_a_jump_of_the_targets_pulls_for_a_while() -> None:
    """And needs an infinite coefficient of friction, until the jump is over."""
    found = summarised(jerked(), dt=1e-4)
    assert 2e-4 < found["pulling_time"][0] < 1e-3
    assert found["peak_friction_ratio"][0] == np.inf
    calm = summarised(jerked(), dt=1e-4, summaries_after=0.029)
    assert calm["pulling_time"][0] == 0.0
    assert 0.0 < calm["peak_friction_ratio"][0] < np.inf
    # The instants between steps of 0.1 ms do not decide: finer steps give nearly the same time.
    finer = summarised(jerked(), dt=1e-5)["pulling_time"][0]
    assert found["pulling_time"][0] == pytest.approx(finer, abs=1e-4)


def test_a_point_contact_without_any_force_needs_no_friction() -> None:
    """Zero over zero is zero; sizes are exact in binary, so that the forces are exactly zero."""
    finger = sp.Finger(root_offset=0.0625, half_thickness=0.0)
    scene = sp.Scene(
        hand=sp.Hand(right=finger, left=finger, tip=sp.Fingertip(radius=0.03125)),
        grasped=sp.GraspedObject(width=0.0625),
        schedule=sp.Schedule.steps([0.0], [[0.0, 0.0]]),
        gravity=0.0,
        duration=0.01,
    )
    assert not sp.simulate(scene, dt=1e-3, record="multipliers").multipliers.any()
    still = summarised(scene, dt=1e-3)
    assert (still["pulling_time"][0], still["peak_friction_ratio"][0]) == (0.0, 0.0)
