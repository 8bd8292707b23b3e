"""Values between the steps of a run: exact at rows, of their order between, linear in the rows."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from measured_motions import SCENE, TRUTH, C, E, changed
from softpinch.fitting.experiment import Experiment
from softpinch.fitting.interpolation import Interpolation
from softpinch.run.options import Options
from softpinch.scene.template import SceneTemplate

KICK = sp.Impulse(time=0.03, impulse=(0.02, -0.03), angular_impulse=1e-4)
KICKED = replace(changed(SCENE, TRUTH), disturbances=[*SCENE.disturbances, KICK])
RECORD = ("state", "multipliers", "torque")


def between(dt: float, times: Any, scene: sp.Scene = KICKED) -> dict[str, Any]:
    run = sp.simulate(scene, dt, record=RECORD, formulation="nullspace")
    rows = Interpolation(run, times)
    q, p = rows.state(run.q, run.p)
    return {
        "q": q,
        "p": p,
        "multipliers": rows.other(run.multipliers),
        "torque": rows.other(run.torque),
    }


def exact(times: Any) -> dict[str, Any]:
    run = sp.simulate(KICKED, 1e-5, record=RECORD, formulation="nullspace")
    rows = np.searchsorted(run.t, times - 1e-9)
    assert np.allclose(run.t[rows], times, atol=1e-12)
    return {name: getattr(run, name)[rows] for name in ("q", "p", "multipliers", "torque")}


def test_rows_are_themselves() -> None:
    """Also those at an impulse and at a switch, which have other values on their other sides."""
    run = sp.simulate(KICKED, 1e-3, record=RECORD)
    rows = Interpolation(run, run.t)
    q, p = rows.state(run.q, run.p)
    np.testing.assert_allclose(q, run.q, rtol=0, atol=1e-15)
    np.testing.assert_allclose(p, run.p, rtol=1e-12, atol=1e-14)
    assert np.array_equal(rows.other(run.multipliers), run.multipliers)
    one = Interpolation(run, run.t[-1:])
    assert np.array_equal(one.other(run.torque), run.torque[-1:])


@pytest.mark.parametrize(("name", "order"), [("q", 4), ("p", 3), ("multipliers", 2), ("torque", 2)])
def test_errors_fall_with_their_order(name: str, order: int) -> None:
    """In the middle of steps that end at no jump, and at a third."""
    at = np.arange(0.005, 0.095, 0.001)
    at = at[np.abs(at[:, None] - [0.03, 0.04, 0.06]).min(axis=1) > 2.5e-3]
    errors = []
    for dt in (1e-3, 5e-4):
        times = at + np.round(0.3 * dt, 5)
        gap = np.abs(between(dt, times)[name] - exact(times)[name])
        errors.append(float(np.max(gap / np.ptp(exact(times)[name], axis=0))))
    assert errors[0] / errors[1] > 0.8 * 2**order
    assert errors[1] < 2e-3


def test_a_step_from_an_impulse_loses_one_order_only() -> None:
    errors = []
    for dt in (2e-4, 1e-4):  # the tips answer within a millisecond
        times = np.array([KICK.time + np.round(0.4 * dt, 5)])
        found, right = between(dt, times), exact(times)
        errors.append([float(np.abs(found[name] - right[name]).max()) for name in ("q", "p")])
    (q, p), (finer_q, finer_p) = errors
    assert q / finer_q > 0.75 * 2**3 and p / finer_p > 0.75 * 2**2
    assert finer_q < 1e-7


def test_multipliers_do_not_look_across_a_jump() -> None:
    """Within the step before a push they are those before it."""
    time, dt = 0.04, 1e-3
    times = np.array([time - 0.3 * dt, time, time + 0.3 * dt])
    found = between(dt, times)["multipliers"]
    right = exact(np.round(times, 5))["multipliers"]
    jump = np.abs(right[1] - right[0]).max()
    assert jump > 1.0
    assert np.abs(found - right).max() < 0.1 * jump


@pytest.mark.parametrize("how", [{"dt": 5e-4}, {"tolerance": 1e-10, "method": "dop853"}])
def test_slopes_are_those_of_the_values(how: dict[str, Any]) -> None:
    """By differences of the values themselves, around an impulse and with every quantity."""
    times = np.sort(np.random.default_rng(0).uniform(0.01, 0.1, 30))
    names = ("q", "p", "multipliers", "torque")
    data = {name: np.zeros((30, n)) for name, n in zip(names, (9, 9, 4, 2), strict=True)}
    experiment = Experiment.checked(KICKED, times, data, 1.0)
    template = SceneTemplate(KICKED, (E, C), 0)
    options = Options.checked(**how)
    table, slope, _ = experiment.simulated(template, TRUTH, options, True)
    assert slope is not None and slope.shape == (*table.shape, 2)
    for k, path in enumerate((E, C)):
        h = 1e-4 * TRUTH[path]
        up, down = (
            experiment.simulated(template, TRUTH | {path: TRUTH[path] + by}, options, False).table
            for by in (h, -h)
        )
        size = np.abs(slope[..., k]).max(axis=0) + 1e-3 * np.abs(slope[..., k]).max()
        assert np.max(np.abs((up - down) / (2.0 * h) - slope[..., k]) / size) < 1e-4
