"""A run's own error bar: right within a factor of two wherever it says that it can be trusted."""

import math
import pickle
import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import softpinch as sp
from oracle.parts import reference_of
from oracle.trajectory import Reference, error, reference
from softpinch import _core, paper, stress
from softpinch.run import scaled_error
from softpinch.run.error_estimate import _observed_order
from softpinch.scene import fields

PAIRS = [(f, m) for f in _core.FORMULATIONS for m in _core.METHODS]
RECORD = ("state", "multipliers")
ROWS = 20
STIFF = ("feather", "gram_jaws", "needle", "steep_wedge", "unlike_fingers")


@cache
def expected(name: str) -> Reference:
    """By SciPy, at instants that every run below records."""
    scene = stress.CASES[name].scene
    # Where rates die out in 1e-7 s, SciPy's explicit method takes 300 000 evaluations.
    method = "Radau" if name in STIFF else "DOP853"
    return reference_of(scene, np.linspace(0.0, scene.duration, ROWS + 1), method=method)


def estimated(case: stress.StressCase, pair: tuple[str, str], steps: int) -> sp.Run:
    formulation, method = pair
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sp.StabilityWarning)
        return sp.simulate(
            case.scene,
            dt=case.scene.duration / (steps * ROWS),
            every=steps,
            method=method,
            formulation=formulation,
            stabilization=case.stabilization,
            record=RECORD,
            estimate_error=True,
        )


# Where the rows of every grid are the same; of the others each run has a reference of its own.
EVEN = [
    name
    for name, case in stress.CASES.items()
    if case.end == "completed" and not case.long and name not in ("switching_every_step", "whirled")
]


# One scene with other parts than the paper's stands for all in a short run.
OTHERS = ("needle", "steep_wedge", "unlike_fingers", "sharp_start", "toggle")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name in OTHERS else name for name in EVEN],
)
def test_a_trusted_estimate_is_right_within_a_factor_of_two(name: str) -> None:
    trusted = 0
    for pair in PAIRS:
        for steps in (5, 30):
            run = estimated(stress.CASES[name], pair, steps)
            bar = run.error_estimate
            if not bar.asymptotic:
                continue
            assert run.success
            assert np.allclose(run.t, expected(name).t, rtol=1e-12)
            true = error(run, replace(expected(name), t=run.t))
            for quantity, size in bar.largest.items():
                # SciPy's reference is right to less than this.
                if max(size, true[quantity]) > 1e-8:
                    trusted += 1
                    assert 0.5 < size / true[quantity] < 2.0, (pair, steps, quantity, str(bar))
    # The first 1e-7 s of that one are far from any such step: it says so.
    assert trusted > 2 or name == "overdamped"


@pytest.mark.parametrize("name", ["switching_every_step", "crushed", "thrown_out"])
def test_estimates_hold_with_many_switches_and_up_to_an_early_end(name: str) -> None:
    case = stress.CASES[name]
    trusted = 0
    for pair in [("csm", "rk4"), ("nullspace", "radau5"), ("projected", "implicit_midpoint")]:
        run = estimated(case, pair, 10)
        assert run.status == case.end
        bar = run.error_estimate
        # The row at which a violation ends it is often none that the others share.
        last = len(run) - int(np.isinf(bar.q[-1]).any())
        until = replace(case.scene, duration=float(run.t[last - 1]))
        exact = reference(until, run.t[:last])

        class Rows:
            t, q, p, multipliers = (
                getattr(run, each)[:last] for each in ("t", "q", "p", "multipliers")
            )

        true = error(Rows, exact)
        for quantity, size in bar.largest.items():
            if "may be wrong" not in bar.message and max(size, true[quantity]) > 1e-8:
                trusted += 1
                assert 0.5 < size / true[quantity] < 2.0, (pair, quantity, str(bar))
    assert trusted > 2


@pytest.mark.parametrize("pair", PAIRS)
def test_bars_stand_at_each_row_and_component(pair: tuple[str, str]) -> None:
    """Against the same method with steps so short that nothing is left of its error."""
    formulation, method = pair
    scene = paper.disturbance("ii", duration=1.1)
    how = {"method": method, "formulation": formulation, "record": RECORD}
    steps = {"implicit_midpoint": 0.5e-4, "dop853": 1e-3}.get(method, 2e-4)
    run = sp.simulate(scene, dt=steps, every=8, estimate_error=True, **how)
    plain = sp.simulate(scene, dt=steps, every=8, **how)
    assert run.error_estimate.asymptotic
    exact = sp.simulate(
        scene, tolerance=1e-13, times=run.t, method="radau5", formulation=formulation, record=RECORD
    )
    for name, width in {"q": 9, "p": 9, "multipliers": 4}.items():
        # Asking for it changes nothing of the run.
        assert np.array_equal(getattr(run, name), getattr(plain, name))
        bars = getattr(run.error_estimate, name)
        assert bars.shape == (len(run), width)
        true = np.abs(getattr(run, name) - getattr(exact, name))
        # What is far below the largest is where the error changes its sign.
        large = true > 1e-2 * true.max(axis=0)
        large &= true > 1e-11 * np.abs(getattr(exact, name)).max()
        assert large.any()
        ratio = bars[large] / true[large]
        assert 0.5 < np.median(ratio) < 2.0
        assert np.mean((ratio > 0.5) & (ratio < 2.0)) > 0.9, (
            name,
            np.quantile(ratio, [0.05, 0.95]),
        )


def test_an_estimate_with_too_long_steps_is_not_trusted() -> None:
    case = stress.CASES["overdamped"]
    failed = estimated(case, ("nullspace", "rk4"), 2)
    assert not failed.success
    assert not failed.error_estimate.asymptotic
    assert "ended differently" in failed.error_estimate.message or failed.error_estimate.order < 3
    stiff = estimated(case, ("nullspace", "implicit_midpoint"), 5)
    assert stiff.success
    assert not stiff.error_estimate.asymptotic
    assert "smaller dt" in stiff.error_estimate.message


def test_round_off_is_no_failure() -> None:
    run = sp.simulate(
        replace(stress.CASES["anvil"].scene, duration=0.01),
        dt=1e-4,
        method="dop853",
        formulation="nullspace",
        estimate_error=True,
    )
    assert run.error_estimate.asymptotic
    assert run.error_estimate.order == math.inf
    assert max(run.error_estimate.largest.values()) < 1e-12


def test_a_run_that_a_violation_ends_has_bars_up_to_there() -> None:
    case = stress.CASES["thrown_out"]
    run = sp.simulate(case.scene, dt=1e-4, estimate_error=True)
    assert run.status == "separated"
    bars = run.error_estimate.q
    assert bars is not None
    assert np.isinf(bars[-1]).all()
    assert np.isfinite(bars[:-1]).all()
    assert math.isfinite(run.error_estimate.largest["q"])
    assert not run.error_estimate.asymptotic
    assert run.error_estimate.message.endswith(
        f"; 1 of {len(run)} rows have no estimate, because a contact changes or the run ends "
        f"there: t = {run.t[-1]:.6g} s"
    )


def test_the_message_names_the_worst_component_of_each_quantity() -> None:
    scene = sp.Scene(duration=0.05, disturbances=[sp.Step(time=0.01, force=(1.0, 0.5))])
    run = sp.simulate(scene, dt=1e-3, record=("state", "multipliers"), estimate_error=True)
    bars = run.error_estimate
    for name in ("q", "p", "multipliers"):
        sizes = scaled_error.scales(name, getattr(run, name))
        row, column = np.unravel_index(
            np.argmax(getattr(bars, name) / sizes), getattr(bars, name).shape
        )
        of = f"({fields.QUANTITIES[name].columns[column]} at t = {run.t[row]:.6g} s)"
        assert f"{name} {bars.largest[name]:.1e} {of}" in bars.message


def test_recorded_quantities_have_estimates_which_are_saved(tmp_path) -> None:
    scene = sp.Scene(duration=0.02)
    run = sp.simulate(scene, estimate_error=True)
    assert run.error_estimate.multipliers is None
    assert set(run.error_estimate.largest) == {"q", "p"}
    with pytest.raises(ValueError, match="read-only"):
        run.error_estimate.q[0] = 1.0
    again = pickle.loads(pickle.dumps(run))
    assert np.array_equal(again.error_estimate.q, run.error_estimate.q)
    saved = np.load(run.save(tmp_path / "run.npz"))
    assert np.array_equal(saved["error_p"], run.error_estimate.p)
    header = run.save(tmp_path / "run.csv").read_text().splitlines()[0]
    assert "error of x [m]" in header
    assert str(run.error_estimate) == run.error_estimate.message


def test_bad_input() -> None:
    scene = sp.Scene(duration=0.02)
    with pytest.raises(sp.NotRecordedError, match="estimate_error=True"):
        _ = sp.simulate(scene).error_estimate
    with pytest.raises(ValueError, match="'state' or 'multipliers' in record"):
        sp.simulate(scene, record=("energy",), estimate_error=True)
    with pytest.raises(TypeError, match="estimate_error = 1"):
        sp.simulate(scene, estimate_error=1)  # type: ignore[arg-type]


def test_an_overflow_of_the_finest_run_alone_is_no_order() -> None:
    assert _observed_order(1.0, math.inf) == _observed_order(math.inf, math.inf) == -math.inf
    assert _observed_order(math.inf, 1.0) == _observed_order(1.0, 0.0) == math.inf
    assert _observed_order(16.0, 1.0) == 4.0
