"""`advise` meets the tolerance on random scenes and stress scenes, at the least cost."""

import html
import itertools
import math
import re
import time
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

import softpinch as sp
from oracle.trajectory import error, reference
from softpinch import paper, strategies, stress
from softpinch.accuracy import reference_motion
from softpinch.accuracy.runs import cpu_times
from softpinch.run.options import Options
from softpinch.run.request import Request
from softpinch.scene.parts import others

LATE = 0.11
DURATION = 0.15


@pytest.fixture(autouse=True)
def _budget_in_cpu_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other work on the machine takes nothing from the budget of `advise`."""
    monkeypatch.setattr("softpinch.accuracy.advisor.perf_counter", time.process_time)


def eventful(scene: sp.Scene, angle: float, push: float) -> sp.Scene:
    """With a switch and a pulse after any pilot, which is 20 ms long here."""
    held = np.asarray(scene.schedule.angles)[-1]
    times = np.append(scene.schedule.times, LATE)
    angles = np.vstack([scene.schedule.angles, held + np.deg2rad([angle, -angle])])
    pulse = sp.Pulse(time=LATE + 0.03, duration=0.01, force=(push, -push), moment=0.0)
    return replace(
        scene,
        schedule=sp.Schedule.steps(times, angles),
        disturbances=[*scene.disturbances, pulse],
    )


# Shrinking would take minutes: each example is a reference by SciPy.
PHASES = [phase for phase in Phase if phase not in (Phase.shrink, Phase.explain)]


@settings(max_examples=3, phases=PHASES, suppress_health_check=list(HealthCheck))
@given(
    strategies.scenes(duration=DURATION, spread=0.2),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 5.0),
    st.sampled_from([1e-4, 1e-6, 1e-8]),
)
def test_the_tolerance_is_met_against_scipy(
    scene: sp.Scene, angle: float, push: float, tolerance: float
) -> None:
    """Only scenes whose grasp holds: the ends of others are another test's."""
    assume(scene.schedule.kind == "steps" and max(scene.schedule.times) < LATE - 1e-3)
    # SciPy's side reads scenes by itself, and makes no samples.
    assume(not any(isinstance(each, sp.Noise) for each in scene.disturbances))
    scene = eventful(scene, angle, push)
    trusted = sp.simulate(scene, tolerance=1e-7, method="radau5", formulation="nullspace")
    assume(trusted.success)
    advice = sp.advise(scene, tolerance)
    assert advice.met, advice.message
    assert max(advice.error.values()) <= tolerance
    assert advice.confirmed <= tolerance
    run = advice.simulate(record=("state", "multipliers"), every=1)
    # Not the start: an input a nanosecond later is there, or is not, for SciPy's side.
    rows = np.unique(np.linspace(1, len(run) - 1, 60).astype(int))
    exact = reference(scene, run.t[rows], rtol=1e-12)

    class Rows:
        t, q, p = run.t[rows], run.q[rows], run.p[rows]
        multipliers = run.multipliers[rows]

    found = error(Rows, exact)
    # SciPy's own error is at most that.
    assert max(found.values()) <= max(tolerance, 1e-9), (found, advice.message)


# Neither has a run that a violation ends a reference (see `work_precision`), nor one of a hand that
# moves or has other parts.
ADVISED = list(stress.CASES)
HARD = [
    name
    for name in ADVISED
    if not stress.CASES[name].long
    and stress.CASES[name].end == "completed"
    and not others(stress.CASES[name].scene)
]
ADAPTIVE = sp._core.ADAPTIVE_METHODS


# One scene with other parts than the paper's stands for all in a short run, and one that is stiff.
OTHERS = ("overdamped", "needle", "steep_wedge", "unlike_fingers", "sharp_start", "toggle")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name in OTHERS else name for name in ADVISED],
)
def test_advice_for_every_stress_scene_meets_the_tolerance(name: str) -> None:
    case = stress.CASES[name]
    advice = sp.advise(case.scene, 1e-6, stabilization=case.stabilization, budget=4.0)
    assert advice.met, advice.message
    run = advice.simulate(record=("state", "multipliers"))
    assert run.status == case.end
    assert advice.margin > 1.0
    assert (advice.dt is None) != (advice.step_tolerance is None)
    assert advice.message.startswith(f'take formulation="{advice.formulation}"')
    tried = [(t.formulation, t.method) for t in advice.trials]
    for formulation, method in itertools.product(sp._core.FORMULATIONS, sp._core.METHODS):
        assert tried.count((formulation, method)) == 1 + (method in ADAPTIVE)
    times = [trial.time for trial in advice.trials if trial.whole]
    assert times == sorted(times)
    # Both costs are said, and the lower one is taken.
    assert advice.equal is not None and advice.adaptive is not None
    assert "the best equal steps: " in advice.message
    assert "the best adaptive steps: " in advice.message
    assert advice.time <= 1.5 * min(advice.equal.time, advice.adaptive.time)
    assert advice.tried == case.scene.duration
    for name in advice.untried:
        assert re.search("(1 pair was|pairs were) not tried within 4 s", advice.message), name


def work(scene: sp.Scene, gains: sp.Stabilization, **how: Any) -> float:
    """The cost of a run by counts; a factorisation costs about as much as six evaluations."""
    stats = sp.simulate(scene, stabilization=gains, record=(), every=10**9, **how).stats
    return stats["evaluations"] + 6.0 * stats["factorisations"]


@pytest.mark.parametrize("name", ["deadbeat_gains", "undamped"])
def test_the_advice_takes_no_more_than_twice_the_work_of_the_cheapest(name: str) -> None:
    """Counted, not timed: `make test-slow` times every scene."""
    case = stress.CASES[name]
    pairs: dict[str, Any] = {"formulations": "nullspace", "methods": ("dop853", "radau5")}
    found = sp.work_precision(
        case.scene,
        **pairs,
        dt=[1e-4, 1e-5],
        tolerances=[1e-3, 1e-4, 1e-5, 1e-6, 1e-7],
        progress=False,
    )
    best = found.cheapest(1e-6, "along")
    advice = sp.advise(case.scene, 1e-6, stabilization=case.stabilization, progress=False, **pairs)
    how = {"dt": advice.dt, "tolerance": advice.step_tolerance}
    ours = work(
        case.scene, case.stabilization, method=advice.method, formulation="nullspace", **how
    )
    least = min(
        work(case.scene, case.stabilization, method=one.method, formulation=one.formulation,
             **{one.setting: one.value})
        for one in best
    )  # fmt: skip
    assert ours <= 2.0 * least, advice.message


@cache
def measured(name: str) -> sp.WorkPrecision:
    case = stress.CASES[name]
    return sp.work_precision(
        case.scene, stabilization=case.stabilization, progress=False, longest=0.02
    )


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("name", HARD)
def test_the_advice_takes_no_more_than_twice_as_long_as_the_cheapest(
    name: str, tolerance: float
) -> None:
    case = stress.CASES[name]
    best = measured(name).cheapest(tolerance, "along")
    begun = time.process_time()
    advice = sp.advise(case.scene, tolerance, stabilization=case.stabilization, progress=False)
    assert time.process_time() - begun < 2.0
    assert best and advice.met, advice.message

    def timed(formulation: str, method: str, **how: Any) -> float:
        options = Options.checked(
            formulation=formulation, method=method, stabilization=case.stabilization, **how
        )
        return min(cpu_times(Request(case.scene, options), 9))

    setting = {"dt": advice.dt, "tolerance": advice.step_tolerance}
    ours = timed(advice.formulation, advice.method, **setting)
    least = min(timed(one.formulation, one.method, **{one.setting: one.value}) for one in best[:3])
    assert ours <= 2.0 * least, (advice.message, best[0])


def test_pairs_beyond_the_budget_are_listed() -> None:
    scene = stress.CASES["overdamped"].scene
    for budget in (0.2, 0.6, 2.0, 4.0):  # a slow machine needs more
        seen: list[tuple[int, int]] = []
        short = sp.advise(scene, 1e-6, budget=budget, progress=lambda *n, s=seen: s.append(n))
        if short.met:
            break
    assert short.met and short.step_tolerance is not None
    assert short.untried
    assert f"{len(short.untried)} pairs were not tried within {budget:g} s" in short.message
    notes = [trial.note for trial in short.trials if trial.note.startswith("not tried within")]
    assert len(notes) == len(short.untried)
    assert seen[-1][0] == seen[-1][1] == len(short.trials)
    # Pairs that the budget did not allow have a predicted cost.
    assert short.equal is not None and not short.equal.found and short.equal.time > 1e-3


def test_a_long_scene_is_tried_at_its_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference_motion, "MOST_STEPS", 500)
    scene = paper.manipulation()
    advice = sp.advise(scene, 1e-4, methods=("radau5", "dop853"), formulations="nullspace")
    assert 0.0 < advice.tried < 0.5 * scene.duration
    assert f"only the first {advice.tried:.3g} s were tried" in advice.message
    assert not any(trial.whole for trial in advice.trials)
    assert advice.simulate().success


def test_a_tighter_tolerance_takes_shorter_steps() -> None:
    scene = paper.disturbance("iii")
    steps = [
        sp.advise(scene, tolerance, methods="rk4", formulations="nullspace").dt or math.nan
        for tolerance in (1e-3, 1e-5, 1e-7)
    ]
    # Of order four, a hundredth of the error takes a step shorter by 3.2; found within a factor.
    for long, short in itertools.pairwise(steps):
        assert 1.5 < long / short < 6.5, steps


def test_a_start_off_the_constraints_is_for_csm() -> None:
    """A run of "csm" has drifted off the constraints, from where only "csm" can go on."""
    state = sp.simulate(sp.Scene(duration=0.02), formulation="csm").state(-1)
    assert not state.check
    scene = sp.Scene(duration=0.02, initial=state)
    with pytest.raises(ValueError, match="for 'csm' only"):
        sp.advise(scene, formulations=("csm", "projected"))
    advice = sp.advise(scene, 1e-5, progress=False)
    assert advice.met, advice.message
    assert {trial.formulation for trial in advice.trials} == {"csm"}
    assert advice.simulate().success


def test_a_sampled_controller_has_advice() -> None:
    """Its torques depend on the run, so that no eigenvalues limit the steps."""
    scene = sp.Scene(duration=0.1, control=sp.SampledController.pid(1e-3))
    advice = sp.advise(scene, 1e-3, methods=("rk4", "radau5"), budget=4.0)
    assert advice.met, advice.message
    equal = replace(advice, dt=advice.equal.dt, step_tolerance=None, method=advice.equal.method)
    run = equal.simulate()
    # An advised dt may be longer than the period of 1e-3 s (radau5: 0.09 s); no step is.
    assert run.success and np.diff(run.t).max() <= 1e-3 * (1.0 + 1e-9)
    exact = sp.simulate(scene, tolerance=1e-12, method="rosenbrock", times=run.t)
    np.testing.assert_allclose(run.q, exact.q, rtol=0.0, atol=1e-3 * np.abs(exact.q).max())
    alone = sp.advise(scene, 1e-3, methods="rk4", budget=4.0)
    assert math.isnan(alone.margin)
    assert "the longest stable dt is not known with a SampledController" in alone.message


def test_a_tolerance_that_no_pair_meets_is_reported() -> None:
    case = stress.CASES["overdamped"]
    pair: dict[str, Any] = {"methods": "implicit_midpoint", "formulations": "nullspace"}
    advice = sp.advise(case.scene, 1e-10, budget=4.0, **pair)
    assert not advice.met
    assert "no pair meets 1e-10" in advice.message
    assert "ms a run" in advice.message
    assert math.isinf(max(advice.error.values()))
    assert advice.adaptive is None
    assert advice.simulate().success


def test_motions_as_small_as_round_off_have_advice() -> None:
    """At rest, rates of 1e-17 m/s are no size to compare with; a tiny moment moves hardly more."""
    scene = sp.Scene(duration=4.0)
    settled = sp.simulate(scene, dt=2e-4, formulation="nullspace").state(-1)
    resting = replace(scene, initial=replace(settled, grid=None), duration=0.2)
    pushed = sp.Scene(disturbances=[sp.Step(time=0.01, moment=1e-8)], duration=0.05)
    for each in (resting, pushed):
        advice = sp.advise(each, 1e-6)
        assert advice.met, advice.message


def test_a_scene_that_is_over_at_once_has_no_advice() -> None:
    scene = sp.Scene(disturbances=[sp.Impulse(time=0.0, impulse=(6.0, 0.0))], duration=0.02)
    advice = sp.advise(scene)
    assert not advice.met
    assert math.isinf(max(advice.error.values()))


BRIEF = sp.Scene(duration=0.005)


@pytest.mark.parametrize("equal", [True, False])
def test_advice_simulates_with_its_setting_and_shows_it_first(equal: bool) -> None:
    # Which steps of a method with both are quicker is a matter of timing; rk4 has equal steps only.
    found = sp.advise(BRIEF, 1e-3, formulations="csm", methods="rk4", progress=False)
    assert found.dt is not None, found.message
    if not equal:
        found = replace(found, dt=None, step_tolerance=1e-3, method="radau5")
    for option in ("dt", "tolerance", "method", "formulation", "stabilization"):
        with pytest.raises(TypeError, match=f"multiple values for (keyword )?argument '{option}'"):
            found.simulate(**{"every": 2, option: 1e-4})
    run = found.simulate(record=("state", "torque"), every=2)
    assert run.status == "completed" and run.torque.shape == (len(run.t), 2)
    shown = f"adaptive: dt = None, step_tolerance = {found.step_tolerance}"
    if equal:
        shown = f"equal: dt = {found.dt:.5g}, step_tolerance = None"
    first, second, third, *_ = repr(found).splitlines()
    assert first == "<Advice" and second.split(None, 1) == ["steps", shown]
    assert third.split() == ["formulation", "csm"]
    page = html.unescape(found._repr_html_())
    assert shown in page and found.message[:60] in page
