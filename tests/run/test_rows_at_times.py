"""Rows at instants that were asked for, between the ends of equal steps: `times=` with `dt`."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from unilateral_scenes import regripped, thrown

METHODS = ("rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock")
# The order of one step is at least that of the method.
ORDERS = {"rk4": 4.0, "dop853": 7.0, "implicit_midpoint": 1.9, "radau5": 5.0, "rosenbrock": 4.0}
PUSHED = sp.Scene(
    disturbances=[
        sp.Pulse(time=0.03, duration=0.02, force=(2.0, -1.0), moment=0.01),
        sp.Impulse(time=0.07, impulse=(0.004, 0.001)),
        sp.Noise(force_std=0.3, moment_std=0.001, rate_hz=250.0),
    ],
    duration=0.12,
)
# The impulses let the tips slip, and the moves between rows are long.
STRUCK = sp.Scene(
    contact="unilateral",
    friction=0.3,
    disturbances=[
        sp.Impulse(time=0.02 * (k + 1), impulse=(0.0, (-1) ** k * 0.002)) for k in range(4)
    ],
    duration=0.1,
)
# Its samples and their outputs come between rows.
SAMPLED = sp.Scene(
    control=sp.SampledController.pid(0.007, 4.0, 0.05, 20.0, delay=0.0025), duration=0.1
)
INSTANTS = np.sort(np.random.default_rng(5).uniform(0.0, 0.1, 60))


def states(run: sp.Run) -> Any:
    return np.hstack([run.q, run.p])


def error(run: sp.Run, exact: sp.Run) -> float:
    """The largest error of a coordinate or a rate, as a share of the largest of its kind."""
    rows = min(len(run), len(exact))
    np.testing.assert_array_equal(run.t[:rows], exact.t[:rows])
    return max(
        float(np.abs(got[:rows] - wanted[:rows]).max() / np.abs(wanted).max())
        for got, wanted in ((run.q, exact.q), (run.p, exact.p))
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scene", [PUSHED, STRUCK, SAMPLED], ids=["pushed", "struck", "sampled"])
@pytest.mark.parametrize("formulation", ["csm", "projected"])
def test_rows_between_steps_are_as_accurate_as_the_ends_of_steps(
    scene: sp.Scene, method: str, formulation: str
) -> None:
    how: dict[str, Any] = {"method": method, "formulation": formulation}
    run = sp.simulate(scene, dt=5e-4, **how, times=INSTANTS)
    exact = sp.simulate(scene, tolerance=1e-12, method="dop853", times=INSTANTS)
    ends = sp.simulate(scene, dt=5e-4, **how)
    exact_ends = sp.simulate(scene, tolerance=1e-12, method="dop853", times=ends.t)
    np.testing.assert_array_equal(run.t[:-1], INSTANTS)
    assert error(run, exact) < 1.5 * error(ends, exact_ends) + 1e-9
    np.testing.assert_array_equal(states(run)[-1], states(ends)[-1])
    assert run.contact_changes == ends.contact_changes


@pytest.mark.parametrize("method", METHODS)
def test_rows_inside_one_step_have_the_order_of_the_method(method: str) -> None:
    scene = sp.Scene(duration=0.05, schedule=sp.Schedule.steps([0.0], [[0.11, 0.09]]))
    shares = np.array([0.21, 0.5, 0.83])

    def one(h: float) -> float:
        how: dict[str, Any] = {"formulation": "projected", "times": 0.02 + shares * h}
        start = sp.simulate(scene, tolerance=1e-13, method="dop853", times=[0.02]).state(0)
        later = sp.Scene(duration=0.03, schedule=scene.schedule, initial=start)
        exact = sp.simulate(later, tolerance=1e-14, method="dop853", **how)
        return error(sp.simulate(later, dt=h, method=method, **how), exact)

    long = 4e-3 if method == "dop853" else 1e-3
    order = np.log2(one(long) / one(long / 2))
    assert order > ORDERS[method]


@pytest.mark.parametrize("method", METHODS)
def test_rows_at_ends_of_steps_have_their_bits(method: str) -> None:
    record = ("state", "multipliers", "energy", "torque", "contact")
    for scene in (PUSHED, STRUCK):
        whole = sp.simulate(scene, dt=5e-4, method=method, record=record)
        kept = np.arange(0, len(whole), 7)
        asked = np.union1d(whole.t[kept], INSTANTS)
        run = sp.simulate(scene, dt=5e-4, method=method, record=record, times=asked)
        rows = np.searchsorted(run.t, whole.t[kept])
        for name, wanted in whole.arrays().items():
            np.testing.assert_array_equal(run.arrays()[name][rows], wanted[kept], err_msg=name)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("make", [thrown, regripped])
def test_a_row_just_after_a_step_has_the_state_at_its_end(
    make: Callable[[], sp.Scene], method: str
) -> None:
    """A step of rosenbrock as short as that would be one of 1e-6 s."""
    run = sp.simulate(make(), dt=2e-4, method=method)
    later = run.at(np.nextafter(run.t[:-1], 1.0))
    np.testing.assert_allclose(later[:, :9], run.q[:-1], rtol=0.0, atol=1e-12)


def test_rows_have_all_that_belongs_to_their_instant() -> None:
    record = ("state", "multipliers", "residuals", "energy", "torque", "contact")
    sp.simulate(STRUCK, dt=1e-4, record=record, times=INSTANTS).check()
    run = sp.simulate(PUSHED, dt=1e-4, record=record, times=INSTANTS).check()
    for k in range(len(INSTANTS)):
        terms = sp.evaluate(PUSHED, run.t[k], run.q[k], run.p[k], run.integral[k])
        np.testing.assert_allclose(run.multipliers[k], terms.multipliers, rtol=1e-9, atol=1e-9)


def test_no_row_is_later_than_the_end_of_a_run_that_ends_inside_a_step() -> None:
    scene = thrown()
    end = sp.simulate(scene, dt=1e-4).t[-1]
    asked = np.sort(np.concatenate([end + np.array([-3e-5, -1e-6, 1e-6, 3e-5]), [0.1 * end]]))
    run = sp.simulate(scene, dt=1e-4, times=asked)
    assert run.status == "lost"
    np.testing.assert_array_equal(run.t, [*asked[:3], end])


def test_derivatives_of_rows_between_steps_are_those_of_the_run() -> None:
    scene = sp.Scene(duration=0.05, disturbances=[sp.Impulse(time=0.02, impulse=(0.004, 0.001))])
    path, asked = "grasped.mass", np.linspace(0.0013, 0.049, 12)
    for method in METHODS:
        how: dict[str, Any] = {"dt": 1e-3, "method": method, "times": asked}
        run = sp.simulate(scene, **how, sensitivities=(path,))
        step = 1e-4 * scene.grasped.mass
        more, less = (
            sp.simulate(scene.with_({path: scene.grasped.mass + by}), **how) for by in (step, -step)
        )
        slope = (more.q - less.q) / (2.0 * step)
        np.testing.assert_allclose(
            run.sensitivity[path][:, :9], slope, rtol=1e-5, atol=1e-6 * np.abs(slope).max()
        )


def test_the_error_of_rows_between_steps_is_estimated() -> None:
    run = sp.simulate(PUSHED, dt=5e-4, times=INSTANTS, estimate_error=True)
    exact = sp.simulate(PUSHED, tolerance=1e-13, method="dop853", times=INSTANTS)
    assert run.error_estimate.asymptotic
    wrong = np.abs(run.q - exact.q[: len(run)]).max(axis=0)
    assert (wrong <= 2.0 * run.error_estimate.q.max(axis=0) + 1e-12).all()


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 0.2], r"times\[1\] = 0.2.* between the run's start and its end"),
        ([0.05, 0.05], r"times\[1\]"),
        ([], "times"),
    ],
)
def test_wrong_times_are_refused(times: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sp.simulate(sp.Scene(duration=0.1), dt=1e-3, times=times)


def test_a_run_gives_its_states_at_any_instants_in_any_order() -> None:
    for scene in (PUSHED, STRUCK, SAMPLED):
        for how in ({"dt": 1e-3}, {"tolerance": 1e-6, "method": "dop853"}):
            if scene is SAMPLED and "tolerance" in how:
                continue
            run = sp.simulate(scene, **how, record=("torque",), every=3 if "dt" in how else 1)  # type: ignore[arg-type]
            wanted = sp.simulate(scene, **how, times=INSTANTS)  # type: ignore[arg-type]
            order = np.random.default_rng(1).permutation(len(INSTANTS))
            found = run.at(np.concatenate([INSTANTS[order], INSTANTS[:2], [run.t[-1]]]))
            assert found.shape == (len(INSTANTS) + 3, 18)
            np.testing.assert_array_equal(found[: len(order)], states(wanted)[order])
            np.testing.assert_array_equal(found[-3:-1], states(wanted)[:2])
            np.testing.assert_array_equal(found[-1, :9], run.state(-1).q)


@pytest.mark.parametrize("time", [-1e-9, 0.1 + 1e-9, np.nan, np.inf])
def test_instants_outside_a_run_are_refused(time: float) -> None:
    run = sp.simulate(sp.Scene(duration=0.1), dt=1e-3)
    with pytest.raises(ValueError, match=r"times(\[1\])?"):
        run.at([0.05, time])


def test_a_run_that_is_unstable_says_so_with_times_too() -> None:
    with pytest.warns(sp.StabilityWarning, match="dt"):
        run = sp.simulate(sp.Scene(), dt=6e-3, times=[0.3, 0.9])
    assert run.status in ("unstable", "separated", "crushed", "folded", "not_finite")


@pytest.mark.parametrize("method", METHODS)
def test_an_instant_next_to_the_start_of_a_step_has_its_state(method: str) -> None:
    # A step of 5e-324 s cannot be solved.
    run = sp.simulate(sp.Scene(duration=0.01), dt=1e-3, method=method, times=[5e-324, 0.005])
    assert (run.status, len(run)) == ("completed", 3)
    np.testing.assert_array_equal(run.q[0], sp.Scene().start().q)


def test_states_just_before_the_end_of_a_run_that_a_violation_ends() -> None:
    torn = sp.Scene(disturbances=[sp.Pulse(time=0.01, duration=0.1, force=(3000.0, 0.0))])
    for how in ({"dt": 1e-4}, {"tolerance": 1e-6, "method": "dop853"}):
        run = sp.simulate(torn, **how)  # type: ignore[arg-type]
        assert run.status == "separated"
        found = run.at([np.nextafter(run.t[-1], 0.0), run.t[-1]])
        np.testing.assert_allclose(found[1, :9], run.q[-1], rtol=0, atol=1e-9)
