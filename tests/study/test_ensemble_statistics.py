"""Probabilities, means and errors of steps, compared with theory and with finer steps."""

import math
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy import stats

import softpinch as sp
from softpinch.study.estimates import Discretisation, Estimate
from softpinch.study.tables import probabilities

CALM = sp.Scene(
    schedule=sp.Schedule.minimum_jerk([0.0, 0.001], np.deg2rad([[5, 5], [8, 4]]), move_time=0.03),
    disturbances=[sp.Step(time=0.01, force=(1.0, -2.0), moment=0.01)],
    duration=0.04,
)
# Over in an instant, for what is about counts alone.
TINY = sp.Scene(duration=1e-3)


def coin(runs: int, **how: object) -> sp.Ensemble:
    """Runs of which some are lost at once: those that are pushed hard, with probability 0.3."""
    scene = replace(TINY, disturbances=[sp.Impulse(time=0.0)], duration=2e-3)
    pushes = {"disturbances.0.impulse.0": sp.Choice([0.0, 50.0], weights=[0.7, 0.3])}
    return sp.monte_carlo(scene, runs, vary=pushes, dt=1e-3, progress=False, **how)


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.999])
@pytest.mark.parametrize("runs", [1, 2, 7, 100, 100_000])
def test_wilsons_interval_is_scipys(runs: int, confidence: float) -> None:
    for count in {0, 1, runs // 3, runs - 1, runs}:
        ours = Estimate.of(np.arange(runs) < count, confidence)
        theirs = stats.binomtest(count, runs).proportion_ci(confidence, method="wilson")
        assert (ours.low, ours.high) == pytest.approx(
            (theirs.low, theirs.high), rel=1e-9, abs=1e-15
        )
        assert ours.low <= ours.value <= ours.high
        assert (ours.happened, ours.runs, float(ours)) == (count, runs, count / runs)


@pytest.mark.parametrize(
    ("count", "runs", "shown"),
    [
        # Rounded by hand from SciPy's `binomtest(count, runs).proportion_ci(method="wilson")`.
        (99_997, 10**5, ("0.99997", "0.99991", "0.99999")),
        (999_999, 10**6, ("0.999999", "0.9999943", "0.9999998")),
        (10**6, 10**6, ("1", "0.999996", "1")),
        (3, 10**6, ("3e-06", "1.0203e-06", "8.8211e-06")),
        (5 * 10**11, 10**12, ("0.5", "0.499999", "0.500001")),
    ],
)
def test_digits_tell_a_probability_and_its_interval_from_0_and_1(
    count: int, runs: int, shown: tuple[str, str, str]
) -> None:
    ours = Estimate.counted(count, runs)
    value, low, high = shown
    told = f"{value} (95 %: {low} to {high}), {count} of {runs} runs"
    assert str(ours) == told if count < runs else str(ours).startswith(f"{told}; it fails")
    assert [cell for cell in re.findall(r">([^<]+)</td>", ours._repr_html_())][:3] == [*shown]
    # In the table of a study: event, runs, share and interval.
    assert probabilities({"holds": ours}).rows == [("holds", count, value, f"{low} to {high}")]


def test_a_part_of_a_latin_hypercube_is_refused() -> None:
    vary = {"grasped.mass": sp.Uniform(0.08, 0.12)}
    how = {"vary": vary, "dt": 1e-3, "progress": False, "stop_when": {"completed": 0.1}}
    with pytest.raises(
        ValueError, match="stop_when: only a whole Latin hypercube is a fair sample"
    ):
        sp.monte_carlo(TINY, 3000, sampler="latin_hypercube", **how)
    assert sp.monte_carlo(TINY, 3000, sampler="sobol", **how).runs == 1024


def test_slipping_without_friction_is_no_probability_of_zero() -> None:
    vary: dict[str, object] = {"grasped.mass": np.linspace(0.09, 0.11, 8)}
    slippery: dict[str, object] = {**vary, "friction": np.r_[np.full(5, 0.01), np.full(3, 50.0)]}
    how = {"dt": 1e-3, "progress": False}
    none = sp.monte_carlo(CALM, vary=vary, **how)
    said = r'= "slipping": needs a coefficient of friction; give Scene.friction, or vary "friction"'
    for ask in (
        lambda: none.probability("slipping"),
        lambda: none.happened("slipping"),
        lambda: sp.sensitivity(none, "slipping"),
        lambda: sp.monte_carlo(CALM, vary=vary, stop_when={"slipping": 0.1}, **how),
    ):
        with pytest.raises(ValueError, match=said):
            ask()
    given = sp.monte_carlo(replace(CALM, friction=0.01), vary=vary, **how)
    assert given.probability("slipping").value == 1.0
    varied = sp.monte_carlo(CALM, vary=slippery, stop_when={"slipping": 0.9}, **how)
    assert varied.happened("slipping").tolist() == [True] * 5 + [False] * 3
    assert varied.probability("slipping").value == 5 / 8
    assert set(sp.sensitivity(varied, "slipping")) == {"grasped.mass", "friction"}


def test_violations_are_noted_over_the_whole_run_and_summaries_after_an_instant() -> None:
    scene = replace(CALM, friction=0.05, schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]))
    scene = replace(scene, disturbances=(), duration=1.0)
    late = sp.monte_carlo(
        scene, 2, dt=1e-3, summaries="peak_friction_angle", summaries_after=0.5, progress=False
    )
    assert late.probability("slipping").value == 1.0
    assert (late.violations["slipping"] < 0.5).all()
    assert late.probability(late["peak_friction_angle"] > math.atan(0.05)).value == 0.0


def test_stop_when_ends_at_the_first_block_that_is_narrow_enough() -> None:
    whole = coin(1024 * 6, seed=4)
    lost = whole.status == "separated"
    counts = [(int(lost[: 1024 * k].sum()), 1024 * k) for k in range(1, 7)]
    widths = [Estimate.at_every_look(*count).half_width for count in counts]
    assert all(before > after for before, after in pairwise(widths))
    for k in range(6):
        # Just narrow enough after block k, and not a block before.
        for threads in (1, 2):
            wanted = {"separated": widths[k] * (1 + 1e-12)}
            some = coin(1024 * 6, seed=4, threads=threads, stop_when=wanted)
            assert (some.runs, some.requested) == (1024 * (k + 1), 1024 * 6)
            assert not some.interrupted
            np.testing.assert_array_equal(some["final_state"], whole["final_state"][: some.runs])
    both = coin(1024 * 6, seed=4, stop_when={"completed": 0.5, "separated": widths[3]})
    assert both.runs == 1024 * 4
    assert coin(1500, seed=4, stop_when={"completed": 1e-9}).runs == 1500
    assert coin(100, seed=4, stop_when={"completed": 0.4}).runs == 100
    # Runs that are asked for alone are cut where their blocks end.
    only = np.arange(1000, 3000)
    some = coin(4096, seed=4, only=only, stop_when={"completed": 0.45})
    assert list(some.run) == list(range(1000, 1024))
    some = coin(4096, seed=4, only=np.arange(1100, 3000), stop_when={"completed": 0.3})
    assert list(some.run) == list(range(1100, 2048))


@pytest.mark.parametrize("formulation", ["csm", "nullspace"])
def test_the_bias_of_steps_is_that_against_far_smaller_ones(formulation: str) -> None:
    vary = {"grasped.mass": sp.Uniform(0.08, 0.12)}
    how = {"vary": vary, "formulation": formulation, "progress": False}
    how["summaries"] = ("final_state", "peak_rotation", "energy_closure")
    ensemble = sp.monte_carlo(CALM, 40, dt=1e-4, check_dt=True, **how)
    fine = sp.monte_carlo(CALM, 40, dt=1e-5, **how)
    assert ensemble.discretisation is not None
    for name in ("final_state", "energy_closure"):
        said = ensemble.discretisation[name]
        true = (ensemble[name] - fine[name]).mean(axis=0)
        large = np.abs(true) > 0.02 * np.abs(true).max()
        # Half the step leaves a sixteenth.
        ratio = np.atleast_1d(true / said.bias)[np.atleast_1d(large)]
        np.testing.assert_allclose(ratio, 16 / 15, rtol=0.01)
        assert said.runs == 40
    half = sp.monte_carlo(CALM, 40, dt=5e-5, **how)
    assert ensemble.discretisation.keys() == {*how["summaries"], "completed", "holds"}
    for name in how["summaries"]:
        said = ensemble.discretisation[name]
        difference = ensemble[name] - half[name]
        np.testing.assert_allclose(said.bias, difference.mean(axis=0), rtol=1e-12, atol=1e-300)
        np.testing.assert_array_equal(said.worst, np.abs(difference).max(axis=0))
        error = stats.sem(difference)
        np.testing.assert_allclose(said.bias_error, error, rtol=1e-10, atol=1e-300)
        np.testing.assert_allclose(said.sampling_error, stats.sem(ensemble[name]), rtol=1e-12)
    assert ensemble.discretisation["completed"].bias == 0.0


def test_steps_are_checked_on_part_of_many_runs_and_by_the_tolerance() -> None:
    how = {"vary": {"grasped.mass": sp.Uniform(0.08, 0.12)}, "progress": False, "check_dt": True}
    many = sp.monte_carlo(TINY, 1100, dt=1e-3, **how)
    assert many.discretisation is not None and many.discretisation["final_state"].runs == 256
    free = sp.monte_carlo(CALM, 20, tolerance=1e-4, method="dop853", **how)
    finer = sp.monte_carlo(CALM, 20, tolerance=1e-5, method="dop853", **{**how, "check_dt": False})
    assert free.discretisation is not None
    said = free.discretisation["final_state"].bias
    np.testing.assert_array_equal(said, (free["final_state"] - finer["final_state"]).mean(axis=0))


def test_runs_that_end_otherwise_with_smaller_steps_count_as_bias() -> None:
    # Steps that just hold the viscous modes of heavy tips, and blow up those of light ones.
    vary = {"grasped.mass": sp.Uniform(0.02, 0.1)}
    how = {"vary": vary, "formulation": "nullspace", "progress": False}
    ensemble = sp.monte_carlo(CALM, 60, dt=2e-3, check_dt=True, **how)
    half = sp.monte_carlo(CALM, 60, dt=1e-3, **how)
    held, then = (part.status == "completed" for part in (ensemble, half))
    assert (held != then).any()
    assert ensemble.discretisation is not None
    said = ensemble.discretisation["completed"]
    assert said.bias == pytest.approx(held.mean() - then.mean(), abs=1e-15)
    assert (said.worst, said.runs) == (1.0, 60)
    assert said.sampling_error == pytest.approx(stats.sem(held.astype(float)))


def test_numbers_that_are_not_finite_are_left_out_of_the_bias() -> None:
    coarse, fine = np.array([1.0, np.inf, np.nan, 4.0]), np.array([2.0, np.inf, 1.0, 2.0])
    said = Discretisation.of(coarse, fine, 0.1)
    assert (said.bias, said.worst, said.runs) == (0.5, 2.0, 2)
    nothing = Discretisation.of(coarse[1:3], fine[1:3], 0.1)
    assert math.isnan(nothing.bias) and math.isnan(nothing.bias_error) and nothing.runs == 0
