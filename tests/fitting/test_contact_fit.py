"""Fits of motions that slip, to data of the independent event-driven simulation."""

from typing import Any

import numpy as np
import pytest

import softpinch as sp
from oracle import unilateral
from softpinch.fitting.experiment import Experiment, FailedRun
from unilateral_scenes import gripped

pytest.importorskip("scipy")
from scipy.stats import binom, chi2

FRICTION, MODULUS = "friction", "hand.tip.youngs_modulus"
TRUTH = {FRICTION: 0.31, MODULUS: 2.8e5}
VARY: dict[str, Any] = {FRICTION: (0.1, 1.0), MODULUS: (1e5, 1e6)}
NOISE = {"y": 2e-5, "rotation": 2e-4}
PUSH = sp.Pulse(time=0.015, duration=0.015, force=(5.0, -40.0))
# Nothing is symmetric: no events coincide.
SCENE = gripped(
    hand=sp.Hand(
        right=sp.Finger(length=0.079),
        tip=sp.Fingertip(normal_mass=0.02, tangential_mass=0.02),
    ),
    grasped=sp.GraspedObject(com_offset=2e-3),
    disturbances=(PUSH,),
)
TIMES = np.linspace(0.001, 0.04, 40)
EVENTS = {"STICK SLIP", "SLIP STICK"}


def motion(scene: sp.Scene) -> dict[str, Any]:
    """What is measured, without noise: by SymPy's terms and SciPy's integrator."""
    found = unilateral(scene.with_(dict(TRUTH)), TIMES)
    assert found.status == "completed" and len(found.t) == len(TIMES)
    return {"y": found.q[:, 1], "rotation": found.q[:, 2]}


def fit(scene: sp.Scene, data: dict[str, Any], **how: Any) -> sp.Fit:
    given: dict[str, Any] = {"vary": VARY, "noise": NOISE, "dt": 2e-4, "progress": False, **how}
    return sp.fit(scene, TIMES, data, **given)


@pytest.mark.parametrize("count", [25, pytest.param(400, marks=pytest.mark.slow)])
def test_intervals_of_friction_and_modulus_cover_the_truth(count: int) -> None:
    exact = motion(SCENE)
    rng = np.random.default_rng(12)
    inside, off = [], []
    for _ in range(count):
        data = {name: y + rng.normal(0.0, NOISE[name], y.shape) for name, y in exact.items()}
        found = fit(SCENE, data)
        assert found.converged and not found.by_differences
        ends = found.intervals
        inside.append([ends[path][0] < truth < ends[path][1] for path, truth in TRUTH.items()])
        errors = found.standard_errors
        off.append([(found.values[path] - truth) / errors[path] for path, truth in TRUTH.items()])
    run = sp.simulate(found.scene, dt=2e-4)
    assert {f"{one.before.name} {one.after.name}" for one in run.contact_changes} >= EVENTS
    # Beyond these ends is one sample of 1000.
    covered, spread = np.sum(inside, axis=0), np.mean(np.square(off), axis=0)
    low, high = binom.interval(0.999, count, 0.95)
    assert (low <= covered).all() and (covered <= high).all(), covered
    low, high = chi2.interval(0.999, count)
    assert (low <= count * spread).all() and (count * spread <= high).all(), spread


def together() -> sp.Scene:
    """A symmetric hand that is pushed down: both tips begin to slip at one instant, and stop so."""
    push = sp.Pulse(time=0.015, duration=0.015, force=(0.0, -40.0))
    hand = sp.Hand(tip=sp.Fingertip(normal_mass=0.02, tangential_mass=0.02))
    return gripped(hand=hand, disturbances=(push,), grasped=sp.GraspedObject())


def height(scene: sp.Scene) -> Any:
    run = sp.simulate(scene, 5e-5, method="dop853", formulation="projected", times=TIMES)
    return run.q[np.isin(run.t, TIMES), 1]


def test_differences_take_the_place_of_derivatives_that_end() -> None:
    scene, mu, noise = together(), TRUTH[FRICTION], 1e-5
    data = {"y": height(scene.with_({FRICTION: mu}))}
    found = fit(scene, data, vary={FRICTION: (0.1, 1.0)}, noise=noise)
    assert found.converged and found.by_differences == (FRICTION,)
    assert any(m.startswith("friction has differences of runs for") for m in found.messages)
    assert found.values[FRICTION] == pytest.approx(mu, rel=1e-4)
    up, down = (height(scene.with_({FRICTION: mu + by})) for by in (1e-4, -1e-4))
    slope = (up - down) / 2e-4
    error = noise / float(np.sqrt(slope @ slope))
    assert found.standard_errors[FRICTION] == pytest.approx(error, rel=1e-3)


def test_runs_that_fail_on_both_sides_end_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = together()
    data = {"y": height(scene.with_({FRICTION: 0.31}))}
    simulated = Experiment.simulated

    def failing(self: Experiment, values: Any, options: Any, slopes: bool, *rest: Any) -> Any:
        if not slopes and values[FRICTION] != 0.5:
            raise FailedRun("far away")
        return simulated(self, values, options, slopes, *rest)

    monkeypatch.setattr(Experiment, "simulated", failing)
    with pytest.raises(ValueError, match="no derivatives or differences by friction"):
        fit(scene, data, vary={FRICTION: (0.1, 1.0)}, noise=1e-5)
