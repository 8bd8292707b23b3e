"""The error bar of a run with adaptive steps: where it is trusted, within a factor of three."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import softpinch as sp
from softpinch import paper, strategies, stress
from softpinch.run import scaled_error
from softpinch.run.error_estimate import ends_of_steps
from unilateral_scenes import regripped, thrown

RECORD = ("state", "multipliers")
PAIRS = [("csm", "rosenbrock"), ("nullspace", "radau5"), ("projected", "dop853")]
# With explicit steps these take tens of thousands of them.
STIFF = ("overdamped", "strong_stabilization", "feather")


def exact(run: sp.Run, how: dict[str, Any]) -> sp.Run:
    """The same motion by another method at a much tighter tolerance, with steps that end at rows.

    The zero force is what makes them end there: dense output of long steps is less exact than their
    ends. Violations do not end it, so that it has all rows.
    """
    zero = sp.Sampled(times=run.t, force=np.zeros((len(run), 2)))
    scene = replace(run.scene, disturbances=[*run.scene.disturbances, zero])
    method = "radau5" if run.method != "radau5" else "rosenbrock"
    tight = 1e-13 if method == "radau5" else 1e-12
    tighter = {**how, "method": method, "tolerance": tight, "times": run.t, "every": 1}
    return sp.simulate(scene, **tighter, stop_on=())


def sound(bar: sp.ErrorEstimate) -> bool:
    """Whether the rows that have an estimate can be trusted."""
    missing = "rows have no estimate" in bar.message
    return bar.asymptotic or (missing and "may be wrong" not in bar.message)


def require_right(scene: sp.Scene, within: float = 3.0, **how: Any) -> sp.ErrorEstimate:
    how = {"record": RECORD, **how}
    run = sp.simulate(scene, **how, estimate_error=True)
    bar = run.error_estimate
    if not sound(bar):
        return bar
    right = exact(run, how)
    rows = np.flatnonzero(np.isfinite(bar.q).all(axis=1)[: len(right)])
    np.testing.assert_array_equal(run.t[rows], right.t[rows])
    for name, size in bar.largest.items():
        true = getattr(right, name)[rows]
        scale = scaled_error.scales(name, true, scaled_error.usual(scene))
        error = float(scaled_error.by_row(getattr(run, name)[rows], true, scale).max())
        # Below that, the other run has errors and round-off of its own.
        if max(error, size) > 1e-9:
            assert 1.0 / within < size / error < within, (name, size, error, str(bar))
    return bar


def check(name: str, pair: tuple[str, str], tolerance: float) -> bool:
    case = stress.CASES[name]
    formulation, method = pair
    how = {"formulation": formulation, "method": method, "stabilization": case.stabilization}
    return sound(require_right(case.scene, tolerance=tolerance, **how))


SCENES = [name for name, case in stress.CASES.items() if not case.long]


@pytest.mark.parametrize("name", SCENES)
def test_trusted_estimates_are_right_on_stress_scenes(name: str) -> None:
    for pair in PAIRS:
        # An explicit method takes seconds here: the slow test has it.
        assert (
            (pair[1] == "dop853" and name in STIFF)
            or check(name, pair, 1e-5)
            or (
                # Its targets jump at each step: what is left is round-off, which has no order.
                name == "switching_every_step" or name in STIFF
            )
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_trusted_estimates_are_right_with_every_pair_and_tolerance(name: str) -> None:
    pairs = [(f, m) for f in sp._core.FORMULATIONS for m in sp._core.ADAPTIVE_METHODS]
    found = [check(name, pair, tol) for pair in pairs for tol in (1e-3, 1e-5, 1e-8)]
    assert sum(found) > len(found) / 2


@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    strategies.scenes(duration=0.1),
    st.sampled_from(PAIRS),
    st.floats(-8.0, -2.0),
    st.integers(1, 5),
)
def test_trusted_estimates_are_right_on_random_scenes(
    scene: sp.Scene, pair: tuple[str, str], power: float, every: int
) -> None:
    how: dict[str, Any] = {"formulation": pair[0], "method": pair[1], "every": every}
    assume(sp.simulate(scene, tolerance=1e-6, max_steps=5000, **how).success)
    require_right(scene, tolerance=10.0**power, **how)


def driven() -> sp.Scene:
    schedule = sp.Schedule.minimum_jerk([0.0, 0.02], np.deg2rad([[3.0, 3.0], [5.0, 4.0]]), 0.05)
    return sp.Scene(fingers="driven", schedule=schedule, duration=0.1)


def sampled() -> sp.Scene:
    control = sp.SampledController.pid(1e-3)
    return sp.Scene(control=control, duration=0.05)


def noisy() -> sp.Scene:
    noise = sp.Noise(force_std=1.0, moment_std=0.01, rate_hz=500.0)
    return sp.Scene(disturbances=[noise], duration=0.05)


def continued() -> sp.Scene:
    scene = paper.disturbance("ii", duration=1.1)
    begun = sp.simulate(replace(scene, duration=1.04), dt=1e-3, formulation="nullspace")
    return replace(scene, initial=begun.state(-1), duration=0.06)


@pytest.mark.parametrize("make", [driven, sampled, noisy, continued, thrown, regripped])
@pytest.mark.parametrize("method", sp._core.ADAPTIVE_METHODS)
def test_every_kind_of_scene_has_a_bar(make: Callable[[], sp.Scene], method: str) -> None:
    bar = require_right(make(), tolerance=1e-5, method=method, formulation="projected")
    assert sound(bar), bar.message


@pytest.mark.parametrize("rows", [{"every": 5}, {"times": np.linspace(0.003, 0.097, 33)}], ids=str)
@pytest.mark.parametrize("method", sp._core.ADAPTIVE_METHODS)
def test_rows_that_are_not_every_step(rows: dict[str, Any], method: str) -> None:
    """Between steps the error is that of the interpolation."""
    scene = stress.CASES["hammer"].scene
    how: dict[str, Any] = {"tolerance": 1e-6, "method": method, "record": RECORD, **rows}
    run = sp.simulate(scene, **how, estimate_error=True)
    assert require_right(scene, **how).asymptotic
    plain = sp.simulate(scene, **how)
    for name in ("q", "p", "multipliers"):
        # Asking for it changes nothing of the run.
        np.testing.assert_array_equal(getattr(run, name), getattr(plain, name))
        assert getattr(run.error_estimate, name).shape == getattr(run, name).shape


def test_changes_of_contacts_have_no_bar() -> None:
    """Except where an input jumps, at which all runs change."""
    how: dict[str, Any] = {"tolerance": 1e-5, "method": "dop853", "estimate_error": True}
    run = sp.simulate(regripped(), **how)
    changes = [change.time for change in run.contact_changes]
    bars = run.error_estimate.q
    assert bars is not None and 0.02 in changes
    there = np.isin(run.t, changes) & (run.t != 0.02)
    assert np.isinf(bars[there]).all() and np.isfinite(bars[~there]).all()
    message = run.error_estimate.message
    assert not run.error_estimate.asymptotic and sound(run.error_estimate)
    assert f"; {there.sum()} of {len(run)} rows have no estimate" in message
    assert f"t = {run.t[there][0]:.6g}, {run.t[there][1]:.6g}" in message
    chosen = sp.simulate(regripped(), **how, times=np.linspace(0.0, 0.04, 21))
    assert chosen.error_estimate.asymptotic


def mirrored(seed: int) -> sp.Scene:
    """A grasp whose tips change their contacts at one instant, up to round-off."""
    draw = np.random.default_rng(seed).uniform
    return sp.Scene(
        contact="unilateral",
        friction=draw(0.3, 1.0),
        schedule=sp.Schedule.steps([0.0], np.deg2rad(np.full((1, 2), draw(4.0, 8.0)))),
        duration=0.1,
        disturbances=[sp.Pulse(time=0.0, duration=0.005, force=(0.0, draw(-250.0, 250.0)))],
    )


@pytest.mark.parametrize(
    ("seed", "method"), [(k, sp._core.ADAPTIVE_METHODS[k % 3]) for k in range(8)]
)
def test_rows_between_changes_of_contacts_have_a_bar(seed: int, method: str) -> None:
    """Ends of steps within round-off of each other once left most rows without."""
    scene, tolerance = mirrored(seed), 10.0 ** np.random.default_rng(seed).uniform(-6.0, -3.0)
    bar = require_right(scene, tolerance=tolerance, method=method, times=np.linspace(0.0, 0.1, 21))
    assert bar.q is not None and np.isfinite(bar.q).all()
    assert bar.asymptotic or "may be wrong" in bar.message


@pytest.mark.parametrize("every", [1, 3])
def test_two_changes_within_round_off_are_one_end_of_a_step(every: int) -> None:
    how: dict[str, Any] = {"tolerance": 6.31e-4, "method": "dop853", "every": every}
    scene = mirrored(0)
    pulse = sp.Pulse(time=0.0, duration=0.005, force=(0.0, -200.0))
    run = sp.simulate(replace(scene, friction=1.0, disturbances=[pulse]), **how)
    changes = np.array([change.time for change in run.contact_changes])
    bar = require_right(run.scene, **how)
    assert bar.q is not None
    lost = np.isinf(bar.q).any(axis=1)
    assert changes.size and (np.abs(run.t[lost][:, None] - changes).min(axis=1) == 0.0).all()


def test_an_asked_row_may_lie_within_round_off_of_the_end_of_a_step() -> None:
    pulse = sp.Pulse(time=0.005, duration=0.01, force=(1.0, 2.0))
    end = pulse.time + pulse.duration
    times = np.append(np.linspace(0.0, 0.014, 8), [np.nextafter(end, 1.0), 0.02, 0.03])
    scene = sp.Scene(disturbances=[pulse], duration=0.03)
    bar = require_right(scene, tolerance=1e-5, method="dop853", times=times)
    assert bar.asymptotic and bar.q is not None and np.isfinite(bar.q).all()


def test_finer_runs_do_not_end_steps_at_the_changes_that_the_run_found() -> None:
    t = np.array([0.0, 0.01, 0.02, np.nextafter(0.02, 1.0), 0.03])
    assert ends_of_steps(t, [0.01]).tolist() == [0.0, 0.02, 0.03]
    assert ends_of_steps(t, [0.0, 0.03]).tolist() == [0.0, 0.01, 0.02, 0.03]


def test_an_estimate_with_too_long_steps_is_not_trusted() -> None:
    case = stress.CASES["strong_stabilization"]
    stiff = sp.simulate(
        case.scene, tolerance=1e-3, method="dop853", stabilization=case.stabilization,
        record=RECORD, estimate_error=True,
    )  # fmt: skip
    assert not stiff.error_estimate.asymptotic
    assert "take a smaller tolerance" in stiff.error_estimate.message
    cut = sp.simulate(
        case.scene, tolerance=1e-6, method="radau5", max_steps=50, estimate_error=True
    )
    assert cut.status == "too_many_steps"
    assert not cut.error_estimate.asymptotic
    assert "with its own steps, halves and quarters of them" in cut.error_estimate.message
    assert cut.error_estimate.message.endswith("; raise max_steps")
    gone = sp.Scene(disturbances=[sp.Impulse(time=0.0, impulse=(6.0, 0.0))], duration=0.02)
    over = sp.simulate(gone, tolerance=1e-6, method="radau5", estimate_error=True)
    assert not over.success and not over.error_estimate.asymptotic


@pytest.mark.parametrize("method", sp._core.ADAPTIVE_METHODS)
def test_the_end_alone_has_the_bar_that_it_has_among_other_rows(method: str) -> None:
    how: dict[str, Any] = {"tolerance": 1e-4, "method": method, "record": RECORD}
    scene = sp.Scene(duration=0.2)
    run = sp.simulate(scene, times=[0.2], **how, estimate_error=True)
    bar = run.error_estimate
    assert len(run) == 1 and run.success
    assert "cannot" not in bar.message
    true = exact(run, how)
    for name, size in bar.largest.items():
        scale = scaled_error.scales(name, getattr(true, name)[-1:], scaled_error.usual(scene))
        error = scaled_error.by_row(getattr(run, name), getattr(true, name)[-1:], scale)
        assert not bar.asymptotic or 1.0 / 3.0 < size / float(error[0]) < 3.0, (name, str(bar))
    among = sp.simulate(scene, **how, estimate_error=True).error_estimate
    for name in ("q", "p", "multipliers"):
        alone, last = getattr(bar, name)[0], getattr(among, name)[-1]
        assert np.isfinite(alone).all()
        np.testing.assert_allclose(alone, last, rtol=0.3, atol=1e-15)
