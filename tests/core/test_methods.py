"""Steps of free length, dense output, counted work and failures of every method that has them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import softpinch as sp
from oracle.trajectory import Reference, error, reference
from scenes import SCENES, driven, swaying
from softpinch import _core, paper

EVERYTHING = ("state", "multipliers", "residuals", "energy")
IMPLICIT = ("implicit_midpoint", "radau5", "rosenbrock")
adaptive = pytest.mark.parametrize("method", _core.ADAPTIVE_METHODS)
every_formulation = pytest.mark.parametrize("formulation", _core.FORMULATIONS)


@cache
def expected_of(name: str, times: tuple[float, ...] = ()) -> Reference:
    """By SciPy, once for all methods and formulations."""
    scene = driven() if name == "driven" else SCENES[name]
    # `error` scales each component by the largest size that it is shown.
    return reference(scene, times or np.linspace(0, scene.duration, 101), rtol=1e-10)


ADAPTIVE_PAIRS = [(m, f) for m in _core.ADAPTIVE_METHODS for f in _core.FORMULATIONS]


@pytest.mark.parametrize(
    ("name", "method", "formulation"),
    [
        *((name, *pair) for name in ("driven", "uneven") for pair in ADAPTIVE_PAIRS),
        # The other inputs are read in the same way for all pairs.
        *((name, *ADAPTIVE_PAIRS[k % 9]) for k, name in enumerate(SCENES) if name != "uneven"),
    ],
)
def test_the_error_is_of_the_order_of_the_tolerance(
    name: str, method: str, formulation: str
) -> None:
    scene = driven() if name == "driven" else SCENES[name]
    expected = expected_of(name)
    steps = []
    for tolerance in (1e-5, 1e-7, 1e-9):
        run = sp.simulate(
            scene,
            tolerance=tolerance,
            times=expected.t,
            method=method,
            formulation=formulation,
            record=("state", "multipliers"),
        )
        assert run.success, run.message
        # Errors of single steps, each below `tolerance`, add up.
        assert max(error(run, expected).values()) <= 300 * tolerance
        steps.append(run.stats["steps"])
    assert steps[0] < steps[1] < steps[2]


@adaptive
@every_formulation
def test_dense_output_is_as_accurate_as_the_steps(method: str, formulation: str) -> None:
    scene = driven()
    rng = np.random.default_rng(7)
    inside = rng.uniform(0, scene.duration, 60)
    # Among them start, end, switches, and instants next to them.
    times = np.unique([0.0, *inside, 0.0613, 0.1124, 0.1601, 0.1601 + 1e-6, 0.22])
    expected = expected_of("driven", tuple(times))
    # An explicit method steps at its limit of stability where csm's own modes are the fastest, and
    # in such a step they leave the polynomial a hundred times worse than its ends.
    limit = 10 if (method, formulation) == ("dop853", "csm") else 1
    for tolerance, allowed in ((1e-6, 3e-5 * limit), (1e-9, 3e-8)):
        run = sp.simulate(
            scene,
            tolerance=tolerance,
            times=times,
            method=method,
            formulation=formulation,
            record=("state", "multipliers", "residuals", "energy"),
        )
        np.testing.assert_array_equal(run.t, times)
        errors = error(run, expected)
        assert errors["q"] <= allowed, errors
        assert errors["p"] <= allowed, errors
        assert errors["multipliers"] <= 10 * allowed, errors
        assert np.abs(run.energy.closure).max() <= 10 * allowed * run.energy.exchanged
        if formulation == "projected":
            assert np.abs(run.residuals).max() <= 1e-13


@adaptive
def test_asking_for_instants_changes_no_step(method: str) -> None:
    scene = driven()
    plain = sp.simulate(scene, tolerance=1e-7, method=method, record=EVERYTHING)
    asked = sp.simulate(scene, tolerance=1e-7, method=method, times=[0.01, 0.1601])
    every = sp.simulate(scene, tolerance=1e-7, method=method, every=7)
    assert plain.stats["steps"] == asked.stats["steps"] == every.stats["steps"]
    assert plain.stats["jacobians"] == asked.stats["jacobians"]
    assert plain.state(-1) == asked.state(-1) == every.state(-1)
    np.testing.assert_array_equal(asked.t, [0.01, 0.1601, 0.22])
    rows = [*range(0, len(plain.t) - 1, 7), len(plain.t) - 1]
    np.testing.assert_array_equal(every.q, plain.q[rows])
    assert plain.dt is None
    assert plain.tolerance == 1e-7


@adaptive
def test_steps_end_on_every_breakpoint(method: str) -> None:
    run = sp.simulate(driven(), tolerance=1e-6, method=method, formulation="nullspace")
    assert {0.0, 0.0613, 0.0613 + 0.0511, 0.1601, 0.22} <= set(run.t)
    assert len(run.t) == run.stats["steps"] + 1
    assert run.stats["segments"] == 4


@pytest.mark.parametrize("method", IMPLICIT)
@every_formulation
def test_work_is_counted(method: str, formulation: str) -> None:
    scene = driven()
    run = sp.simulate(scene, dt=1e-3, method=method, formulation=formulation)
    stats = run.stats
    starts = stats["steps"] + 2  # one at the end, one after the impulse
    if method == "rosenbrock":
        assert stats["jacobians"] == stats["factorisations"] == stats["steps"]
        assert stats["iterations"] == 0
        assert stats["evaluations"] == starts + 5 * stats["steps"]
    else:
        stages, factors = (1, 1) if method == "implicit_midpoint" else (3, 2)
        assert stats["evaluations"] == starts + stages * stats["iterations"]
        # Jacobian and factors serve many steps: stored counts, so that a slow-down shows.
        assert stats["segments"] <= stats["jacobians"] <= 0.6 * stats["steps"]
        assert stats["factorisations"] <= factors * (stats["jacobians"] + stats["segments"])
        assert stats["iterations"] <= 5 * stats["steps"]
    assert stats["rejected"] == 0
    explicit = sp.simulate(scene, dt=1e-3).stats
    assert explicit["jacobians"] == explicit["factorisations"] == explicit["iterations"] == 0


LOST = replace(
    paper.disturbance("i"), disturbances=[sp.Step(time=1.0, force=(130.0, 130.0), moment=0.0)]
)


@adaptive
@every_formulation
def test_a_motion_that_runs_away_ends_with_a_status(method: str, formulation: str) -> None:
    run = sp.simulate(LOST, tolerance=1e-6, method=method, formulation=formulation, stop_on=())
    assert run.status == "step_too_small"
    assert "no step was short enough at t = 1.04" in run.message
    assert np.isfinite(run.q).all()
    kept = sp.simulate(LOST, tolerance=1e-6, method=method, formulation=formulation)
    assert kept.status == "separated"
    assert kept.t[-1] == pytest.approx(1.0217, abs=1e-3)


@pytest.mark.parametrize("method", ["implicit_midpoint", "radau5"])
@every_formulation
def test_an_iteration_that_fails_is_a_status_with_time_and_residual(
    method: str, formulation: str
) -> None:
    run = sp.simulate(LOST, dt=1e-4, method=method, formulation=formulation, stop_on=())
    assert run.status == "newton_failed"
    assert "from t = 1.043" in run.message
    assert "its correction was still" in run.message
    assert np.isfinite(run.q).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tolerance": 1e-6}, "method = 'rk4' has no error estimate: tolerance goes with"),
        ({"tolerance": 1e-6, "method": "implicit_midpoint"}, "has no error estimate"),
        ({"tolerance": 1e-6, "dt": 1e-3, "method": "radau5"}, "give one of them"),
        ({"tolerance": 0.0, "method": "radau5"}, r"tolerance = 0\.0: must be >= 1e-14 and < 1"),
        ({"tolerance": 1.0, "method": "radau5"}, r"tolerance = 1\.0: must be"),
        ({"tolerance": float("nan"), "method": "radau5"}, "tolerance = NaN: must be"),
        ({"times": [0.1], "tolerance": 1e-6, "method": "dop853", "every": 2}, "give one of them"),
        ({"times": [0.2, 0.1], "tolerance": 1e-6, "method": "dop853"}, r"times\[1\] = 0\.1"),
        ({"times": [-0.1], "tolerance": 1e-6, "method": "dop853"}, r"times\[0\] = -0\.1: must lie"),
        ({"times": [1.1], "tolerance": 1e-6, "method": "dop853"}, r"times\[0\] = 1\.1: must lie"),
        ({"times": [], "tolerance": 1e-6, "method": "dop853"}, "times has shape"),
    ],
)
def test_bad_options_are_refused_by_name(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sp.simulate(sp.Scene(), **options)


@adaptive
def test_a_free_run_goes_on(method: str) -> None:
    scene = swaying()
    whole = sp.simulate(scene, tolerance=1e-9, method=method)
    half = sp.simulate(replace(scene, duration=0.04), tolerance=1e-9, method=method)
    rest = replace(scene, initial=half.state(-1), duration=0.06)
    again = sp.simulate(rest, tolerance=1e-9, method=method)
    scale = np.abs(whole.q).max(axis=0)
    assert np.all(np.abs(again.q[-1] - whole.q[-1]) <= 1e-7 * scale)


@adaptive
@every_formulation
def test_the_ledger_counts_from_the_start_to_late_instants(method: str, formulation: str) -> None:
    run = sp.simulate(
        swaying(),
        tolerance=1e-8,
        method=method,
        formulation=formulation,
        times=[0.031, 0.07],
        record=("energy",),
    )
    assert np.abs(run.energy.closure).max() <= 1e-5 * run.energy.exchanged
    run.check()


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
@adaptive
@every_formulation
def test_a_loss_between_the_ends_of_steps_is_seen(
    method: str, formulation: str, tolerance: float
) -> None:
    """Fingers on stiff springs without damping throw a tip off and catch it within a step."""
    scene = sp.Scene(
        control=sp.Pid(kp=1e6, kd=0.0, ki=0.0),
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 4]])),
        duration=0.02,
    )
    how = {"tolerance": tolerance, "method": method, "formulation": formulation}
    run = sp.simulate(scene, **how)
    asked = sp.simulate(scene, times=np.linspace(0, 0.02, 2001), **how)
    fine = sp.simulate(scene, dt=1e-6, formulation="nullspace")
    for one in (run, asked, fine):
        assert one.status == "separated"
        assert one.t[-1] == pytest.approx(fine.t[-1], abs=2e-5)


@pytest.mark.parametrize(
    "times", [[0.0, 1e-17], [1e-17], [np.nextafter(0.2, 0), 0.2], [np.nextafter(0.2, 0)]]
)
def test_instants_next_to_an_end_are_kept_as_asked(times: list[float]) -> None:
    run = sp.simulate(sp.Scene(duration=0.2), tolerance=1e-6, method="radau5", times=times)
    np.testing.assert_array_equal(run.t, sorted({*times, 0.2}))


def test_an_instant_outside_by_round_off_is_the_end() -> None:
    state = replace(sp.Scene(duration=0.7)).start()
    scene = sp.Scene(initial=replace(state, time=0.7), duration=0.1)
    end = 0.7 + 0.1
    run = sp.simulate(scene, tolerance=1e-6, method="radau5", times=[np.nextafter(end, 1)])
    np.testing.assert_array_equal(run.t, [end])


def test_steps_below_the_resolution_of_the_clock_are_named() -> None:
    late = replace(sp.Scene().start(), time=1.7e9)
    scene = sp.Scene(
        initial=late, schedule=sp.Schedule.steps([1.7e9], np.deg2rad([[6, 6]])), duration=0.2
    )
    run = sp.simulate(scene, tolerance=1e-4, method="radau5")
    assert run.status == "step_too_small"
    assert "the clock does not resolve" in run.message
    with pytest.raises(ValueError, match=r"dt = 1e-11: must be more than round-off"):
        sp.simulate(replace(scene, initial=replace(late, time=1e6), duration=1e-8), dt=1e-11)


@pytest.mark.parametrize("method", ["radau5", "rosenbrock"])
@every_formulation
def test_a_light_and_viscous_grasp_has_the_error_that_was_asked_for(
    method: str, formulation: str
) -> None:
    """The mass does not say which rates are small: here they are tiny all along."""
    scene = sp.Scene(
        hand=sp.Hand(tip=sp.Fingertip(normal_viscosity=1e6, tangential_viscosity=1e6)),
        grasped=sp.GraspedObject(mass=1e-3),
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 4]])),
        duration=0.2,
    )
    exact = sp.simulate(scene, tolerance=1e-10, method="radau5", formulation="csm")
    run = sp.simulate(scene, tolerance=1e-5, method=method, formulation=formulation)
    for ours, theirs in ((run.q, exact.q), (run.p, exact.p)):
        scale = np.abs(theirs).max(axis=0)
        assert np.all(np.abs(ours[-1] - theirs[-1]) <= 1e-3 * scale)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8])
@pytest.mark.parametrize("method", ["radau5", "rosenbrock"])
@pytest.mark.parametrize("formulation", ["csm", "nullspace"])
def test_a_longer_hold_costs_next_to_nothing(
    method: str, formulation: str, tolerance: float
) -> None:
    """Stiff modes have died out, and the scale of errors does not depend on the duration."""
    how = {"tolerance": tolerance, "method": method, "formulation": formulation}
    short = sp.simulate(sp.Scene(duration=1.0), **how)
    long = sp.simulate(sp.Scene(duration=100.0), **how)
    assert long.success
    assert long.stats["evaluations"] <= 1.5 * short.stats["evaluations"]
    assert long.stats["jacobians"] <= 1.5 * short.stats["jacobians"] + 20
    # The one is the other's beginning, but for the step that ends it.
    same = len(short.t) - 3
    np.testing.assert_array_equal(short.q[:same], long.q[:same])
