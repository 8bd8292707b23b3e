"""Gradients through slips, openings and impacts, and of margins, beside differences of studies."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from random_pinches import random_pinch
from study import test_gradients
from unilateral_scenes import gripped, regripped

SUMMARIES = (*test_gradients.SUMMARIES, "margin")
STIFFNESS, MASS, FRICTION = "hand.tip.right.youngs_modulus", "grasped.mass", "friction.left"
HEIGHT = "grasped.height"
RUNS = 40
ENDS_EARLY = r"of \d+ runs have NaN among their gradients: .*the run ends early \(\d+\)"


def values(seed: int, *names: str) -> dict[Any, Any]:
    usual = {STIFFNESS: 3e5, MASS: 0.1, FRICTION: 0.5, HEIGHT: 0.05}
    rng = np.random.default_rng(seed)
    return {name: usual[name] * rng.uniform(0.7, 1.4, RUNS) for name in names}


def study(scene: sp.Scene, vary: dict[Any, Any], **how: Any) -> sp.Ensemble:
    return sp.monte_carlo(
        scene, vary=vary, progress=False, **{"dt": 2e-4, "summaries": SUMMARIES, **how}
    )


def require_differences(found: sp.Ensemble, vary: dict[Any, Any], **how: Any) -> None:
    """Compares with extrapolated central differences, where these tell."""

    def apart(path: str, share: float) -> dict[str, Any]:
        up, down = (
            study(found.scene, {**vary, path: vary[path] * (1.0 + by)}, **how)
            for by in (share, -share)
        )
        by = 2.0 * share * vary[path]
        return {name: (up[name].T - down[name].T) / by for name in SUMMARIES}

    for path in vary:
        coarse, fine = apart(path, 4e-5), apart(path, 2e-5)
        for name in SUMMARIES:
            ours, theirs = found.gradients[name][path].T, (4.0 * fine[name] - coarse[name]) / 3.0
            known = np.isfinite(ours) & np.isfinite(theirs)
            size = np.abs(np.where(known, theirs, 0.0)).max(axis=-1, keepdims=True)
            sure = known & (np.abs(coarse[name] - fine[name]) <= 1e-5 * size + 1e-12)
            assert sure.mean() > 0.6 * known.mean() > 0.2, (name, path, sure.mean(), known.mean())
            off = np.where(sure, np.abs(ours - theirs), 0.0)
            assert (off <= 2e-6 * size + 1e-12).all(), (name, path, (off / size).max())


@pytest.mark.parametrize("method", ["rk4", "radau5"])
def test_gradients_go_on_through_slips_openings_and_impacts(method: Any) -> None:
    scene, vary = regripped(friction=(0.5, 0.5)), values(1, STIFFNESS, MASS, FRICTION)
    found = study(scene, vary, gradients=SUMMARIES, method=method)
    require_differences(found, vary, method=method)
    run = sp.simulate(found.scene_of(3), dt=2e-4, method=method, sensitivities=FRICTION)
    changes = {f"{one.before.name} {one.after.name}" for one in run.contact_changes}
    assert {"STICK FREE", "FREE SLIP", "SLIP STICK"} <= changes
    for summary, row in (("final_state", -1), ("peak_rotation", np.abs(run.q[:, 2]).argmax())):
        ours, theirs = found.gradients[summary][FRICTION][3], run.sensitivity[FRICTION][row]
        theirs = np.sign(run.q[row, 2]) * theirs[2] if summary == "peak_rotation" else theirs
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ("contact", "force", "moment"),
    [("bilateral", (30.0, 90.0), 0.5), ("unilateral", (20.0, 40.0), 0.2)],
)
def test_a_margin_has_the_derivative_of_the_distance_that_it_is(
    contact: Any, force: Any, moment: float
) -> None:
    """The smallest distance is a cone, the end of a face, or a force at the end."""
    push = sp.Pulse(time=0.01, duration=0.02, force=force, moment=moment)
    scene = gripped(friction=(1.0, 1.0), disturbances=(push,), duration=0.03)
    scene = replace(scene, contact=contact)
    vary = values(2, STIFFNESS, MASS, FRICTION, HEIGHT)
    vary[HEIGHT] = np.linspace(2e-3, 0.04, RUNS)
    stop_on = ("separated", "crushed", "folded", "off_face")
    how: dict[str, Any] = {"summaries_after": 5e-3, "stop_on": stop_on}
    with pytest.warns(sp.StabilityWarning, match=ENDS_EARLY):
        found = study(scene, vary, gradients=SUMMARIES, **how)
    early = found.status != "completed"
    assert 0 < early.sum() < RUNS // 2
    for path in vary:
        assert (np.isnan(found.gradients["margin"][path]) == early).all()
        rows = found.gradients["final_state"][path][early]
        assert np.isnan(rows).all() == (contact == "unilateral")
    require_differences(found, vary, **how)


def test_runs_without_a_derivative_are_counted_by_their_reasons() -> None:
    """The tips of a symmetric hand slip together; round-off lets one of them stop first."""
    scene = sp.Scene(contact="unilateral", friction=0.01, duration=0.02)
    reason = r"^3 of 3 runs have NaN .*: an event coincides with another one .*breakpoint \(3\)$"
    vary = {"gravity": np.array([9.0, 9.8, 10.0])}
    with pytest.warns(sp.StabilityWarning, match=reason):
        found = study(scene, vary, gradients=SUMMARIES, sensitivities=("control.kp", "gravity"))
    assert (found.status == "completed").all()
    for path in ("control.kp", "gravity"):
        assert np.isnan(found.gradients["final_state"][path]).all()
        assert np.isnan(found.gradients["margin"][path]).all()
    # The largest torque is that of the first instant, before any event: K_P times the error.
    torque = found.gradients["peak_torque"]["control.kp"]
    np.testing.assert_allclose(torque, found["peak_torque"] / 100.0, rtol=1e-12)


def test_one_direction_without_a_derivative_leaves_the_others() -> None:
    when, vary = "schedule.times.1", {FRICTION: np.array([0.4, 0.5])}
    with pytest.warns(sp.StabilityWarning, match=r"breakpoint that a path moves \(2\)$"):
        found = study(
            regripped(friction=(0.5, 0.5)), vary, gradients="final_state",
            sensitivities=(when, FRICTION),
        )  # fmt: skip
    assert np.isnan(found.gradients["final_state"][when]).all()
    assert np.isfinite(found.gradients["final_state"][FRICTION]).all()


def test_steps_that_may_be_unstable_carry_a_ledger_that_gradients_leave_out() -> None:
    scene = random_pinch(np.random.default_rng(80009), "unilateral", 0.04)
    vary = {"gravity": np.array([9.8])}
    found = study(scene, vary, gradients="final_state")
    run = sp.simulate(found.scene_of(0), dt=2e-4, sensitivities="gravity")
    assert run._result["step_to_stable_one"] > 1.0 and run.success and len(run.contact_changes) == 3
    np.testing.assert_array_equal(
        found.gradients["final_state"]["gravity"][0], run.sensitivity["gravity"][-1]
    )
