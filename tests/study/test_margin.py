"""The summary `margin`: from the recorded numbers of runs, and what it promises."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from ensembles import require_alone
from softpinch import paper, strategies
from unilateral_scenes import pushes, thrown
from violations import places, tilts

STOP_ON = ("separated", "crushed", "folded")
# A push after which about half of the grasps do not hold, of either contact.
SHAKEN = replace(
    paper.disturbance("ii", duration=1.06),
    friction=(0.5, 0.8),
    grasped=replace(paper.disturbance("ii").grasped, height=0.049),
)
VARY: dict[Any, Any] = {
    "disturbances.0.force": sp.Uniform((-150.0, -150.0), (150.0, 150.0)),
    "friction.left": sp.Uniform(0.1, 1.2),
}


def expected(run: sp.Run, after: float, stop_on: tuple[str, ...] = STOP_ON) -> float:
    """The margin of a run with a row for each step, from the numbers of its rows."""
    scene, rows = run.scene, run.t >= after
    missing = (scene.start().time + scene.duration - run.t[-1]) / scene.duration
    if not rows.any():
        return np.nan if run.success else -missing
    tips = scene.hand.tips
    radius = np.array([tip.radius for tip in tips])
    force = np.array([tip.youngs_modulus for tip in tips]) * radius**2
    normal, across = run.multipliers[rows, :2], np.abs(run.multipliers[rows, 2:])
    half = 0.5 * (scene.grasped.height or np.inf)
    compression, tilt = run.q[rows, 5:7], np.abs(tilts(run))[rows]
    inside = half - places(run)[rows]
    distances = {
        "crushed": (radius - compression) / radius,
        "folded": (np.pi / 2 - tilt) / (np.pi / 2),
        "rim": 1 - np.sin(tilt) - compression / radius,
        "off_face": inside / radius,
    }
    found = [distances[name] for name in stop_on if name in distances]
    friction = np.inf if scene.friction is None else scene.friction * np.ones(2)
    with np.errstate(invalid="ignore"):
        cone = np.where(np.isfinite(friction), friction * normal - across, np.inf) / force
    at_end = np.inf
    if scene.contact == "bilateral":
        smallest = min(one.min() for one in [*found, normal / force, cone])
    else:
        modes = run.contact[rows]
        free = modes == sp.ContactMode.FREE
        both = free.all(axis=1)
        if "slipping" in stop_on:
            found.append(np.where(modes == sp.ContactMode.STICK, cone, np.inf))
        if "opened" in stop_on:
            found.append(np.where(modes == sp.ContactMode.SLIP, normal / force, np.inf))
        smallest = min((np.where(free, np.inf, one).min() for one in found), default=np.inf)
        closed = np.where(free, np.inf, inside / radius).min()
        beside = inside[both].max(axis=1)[:, None] / radius
        smallest = min(smallest, closed, beside.min(initial=np.inf))
        gap = np.maximum(run.residuals[-1, :2], places(run)[-1] - half)
        at_end = np.where(free[-1], -gap / radius, normal[-1] / force).min()
    return float(min(smallest, at_end) if run.success else min(smallest, 0.0) - missing)


def study(scene: sp.Scene, runs: int = 1, **how: Any) -> sp.Ensemble:
    return sp.monte_carlo(
        scene, runs, summaries=("margin", "final_state"), progress=False, **{"dt": 5e-4, **how}
    )


def require_recomputed(found: sp.Ensemble, run: int, after: float, stop_on: Any = STOP_ON) -> None:
    """Also that round-off alone never decided the sign."""
    alone, margin = require_alone(found, run), found["margin"][run]
    by_hand = expected(alone, after, stop_on)
    np.testing.assert_allclose(margin, by_hand, rtol=1e-9, atol=1e-12)
    assert (margin > 0.0) == alone.holds


@given(
    strategies.scenes(duration=0.05, force=60.0),
    st.floats(-0.01, 0.06),
    st.sampled_from([STOP_ON, (), ("rim", "off_face", "folded"), ("pulling", "slipping")]),
    st.sampled_from([None, 1e-4, 2e-3, 1e-2]),
)
def test_bilateral_margins_are_those_of_the_recorded_numbers(
    scene: sp.Scene, after: float, stop_on: Any, height: float | None
) -> None:
    scene = replace(scene, grasped=replace(scene.grasped, height=height))
    found = study(scene, stop_on=stop_on, summaries_after=after)
    if after < 0.05 or not found.holds[0]:
        require_recomputed(found, 0, after, stop_on)
    else:
        assert np.isnan(found["margin"][0])  # no instant to look at


@settings(max_examples=80)
@given(
    st.one_of(pushes(), strategies.scenes(duration=0.03, force=30.0, contact="unilateral")),
    st.sampled_from([{"dt": 1e-4}, {"tolerance": 1e-6, "method": "dop853"}]),
    st.sampled_from([None, 0.02]),
    st.sampled_from([STOP_ON, (), ("slipping", "rim"), ("opened", "off_face", "folded")]),
)
def test_unilateral_margins_are_those_of_the_recorded_numbers(
    scene: sp.Scene, how: dict[str, Any], after: float | None, stop_on: Any
) -> None:
    found = study(scene, summaries_after=after, stop_on=stop_on, **{"dt": None, **how})
    require_recomputed(found, 0, -np.inf if after is None else after, stop_on)


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.usefixtures("simd_level")
def test_a_margin_in_lanes_is_that_of_the_run_alone_and_has_the_sign_of_holds(contact: Any) -> None:
    found = study(replace(SHAKEN, contact=contact), 200, vary=VARY, summaries_after=0.9, dt=1e-3)
    assert 10 < found.holds.sum() < 190
    assert ((found["margin"] > 0) == found.holds).all()
    one = {path: found[path] for path in VARY}
    for run in (0, 7, 100, 199):
        require_recomputed(found, run, 0.9)
        vary = {path: values[[run]] for path, values in one.items()}
        alone = study(found.scene, vary=vary, summaries_after=0.9, dt=1e-3)
        assert alone["margin"][0] == found["margin"][run]
    unasked = sp.monte_carlo(
        found.scene, 200, vary=VARY, summaries_after=0.9, dt=1e-3, progress=False
    )
    np.testing.assert_array_equal(unasked.end_time, found.end_time)


def random_study(contact: Any, runs: int, seed: int) -> sp.Ensemble:
    """Runs that hold, and that are lost in every way, some of them before margins count."""
    vary = {
        **VARY,
        "disturbances.0.moment": sp.Uniform(-3.0, 3.0),
        "grasped.mass": sp.LogUniform(0.05, 0.3),
        "hand.tip.youngs_modulus": sp.LogUniform(3e4, 3e5),
        "schedule.angles": sp.Uniform(0.05, 0.25),
        "friction.right": sp.LogUniform(0.5, 5.0),
        "friction.left": sp.LogUniform(0.5, 5.0),
        "gravity": sp.Uniform(0.0, 10.0),
    }
    scene = replace(SHAKEN, contact=contact)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sp.StabilityWarning)  # some of the runs are to end so
        return study(scene, runs, vary=vary, seed=seed, dt=1e-3, summaries_after=1.005)


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize("runs", [1500, pytest.param(50_000, marks=pytest.mark.slow)])
def test_a_margin_is_positive_where_the_run_holds_and_nowhere_else(contact: Any, runs: int) -> None:
    found = random_study(contact, runs, seed=3)
    margin, holds = found["margin"], found.holds
    assert len(found.counts()) > 2 and 0.02 < holds.mean() < 0.9
    np.testing.assert_array_equal(margin > 0.0, holds)
    # The sign comes from the distances: round-off decides in none of the runs.
    assert np.isfinite(margin).all() and np.abs(margin).min() > 1e-9


def test_a_run_that_is_lost_earlier_has_a_smaller_margin_and_one_lost_at_the_end_none() -> None:
    lost = study(thrown())
    end = lost.end_time[0]
    assert lost.status[0] == "lost"
    durations = np.linspace(end + 1e-6, 0.06, 5)
    found = [study(replace(thrown(), duration=duration)) for duration in durations]
    margins = np.array([one["margin"][0] for one in found])
    ends = np.array([one.end_time[0] for one in found])
    np.testing.assert_allclose(margins, ends / durations - 1.0, atol=1e-12)
    assert -1e-4 < margins[0] < 0.0 and np.all(np.diff(margins) < -0.01)


def test_an_endless_face_has_no_end_to_which_a_distance_could_count() -> None:
    """What is left are the tips and, at the end, their forces."""
    for height in (None, 1.0, 0.02):
        scene = thrown(friction=0.9)
        scene = replace(scene, grasped=sp.GraspedObject(height=height), disturbances=())
        found = study(scene)
        force = found.replay(0).multipliers[-1, :2].min()
        by_force = force / (scene.hand.tips[0].youngs_modulus * scene.hand.tips[0].radius ** 2)
        assert found.holds[0]
        if height != 0.02:
            assert found["margin"][0] == pytest.approx(by_force, rel=1e-12)


def test_a_margin_goes_through_zero_with_what_loses_the_grasp() -> None:
    """The motion of bilateral contact does not depend on friction, so only the cone moves."""
    scene = replace(paper.disturbance("ii", duration=1.06), friction=1.0)
    mu = np.linspace(0.02, 0.3, 200)
    found = study(scene, 200, vary={"friction": mu}, summaries_after=0.9)
    assert 20 < found.holds.sum() < 180
    change = np.diff(found["margin"])
    tip = scene.hand.tips[0]
    force = found.replay(0).multipliers[:, :2].max() / (tip.youngs_modulus * tip.radius**2)
    assert (change >= 0.0).all() and change.max() <= force * (mu[1] - mu[0]) * (1 + 1e-9)


def test_margins_are_drawn_and_counted_like_other_summaries() -> None:
    found = study(SHAKEN, 50, vary=VARY)
    assert sp.plot.histogram(found, "margin").axes[0].get_xlabel() == "margin [1]"
    assert sp.plot.success_map(found, "friction.left", "disturbances.0.force.0").axes
    assert float(found.quantile("margin", 0.5)) == np.median(found["margin"])
    some = found.probability(lambda rows: rows["margin"] > 0.0)
    assert some == found.probability("holds")
