"""What is advised is right: the tolerance is met on scenes that nobody chose, to their end."""

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st

import softpinch as sp
from oracle.trajectory import error, reference
from softpinch import paper, strategies, stress
from softpinch.accuracy.advisor import _Advisor

LATE = 0.11
DURATION = 0.15


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


HOW: dict[str, Any] = {"phases": PHASES, "suppress_health_check": list(HealthCheck)}
SCENES = (
    strategies.scenes(duration=DURATION, spread=0.2),
    st.floats(-3.0, 3.0),
    st.floats(0.0, 5.0),
    st.sampled_from([1e-4, 1e-6, 1e-8]),
)


@settings(max_examples=20, **HOW)
@given(*SCENES)
def test_the_tolerance_is_met_against_scipy(
    scene: sp.Scene, angle: float, push: float, tolerance: float
) -> None:
    require_met(scene, angle, push, tolerance)


@pytest.mark.slow
@settings(max_examples=200, **HOW)
@given(*SCENES)
def test_the_tolerance_is_met_on_many_scenes(
    scene: sp.Scene, angle: float, push: float, tolerance: float
) -> None:
    require_met(scene, angle, push, tolerance)


def require_met(scene: sp.Scene, angle: float, push: float, tolerance: float) -> None:
    """Of scenes whose grasp holds; where it does not, their ends are another test's."""
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
    rows = np.unique(np.linspace(1, len(run) - 1, 150).astype(int))
    exact = reference(scene, run.t[rows], rtol=1e-12)

    class Rows:
        t, q, p = run.t[rows], run.q[rows], run.p[rows]
        multipliers = run.multipliers[rows]

    found = error(Rows, exact)
    # SciPy's own error is at most that.
    assert max(found.values()) <= max(tolerance, 1e-9), (found, advice.message)


@pytest.mark.parametrize("name", [n for n, c in stress.CASES.items() if not c.long])
def test_every_stress_scene_has_advice(name: str) -> None:
    if name == "overdamped":
        pytest.skip("equal steps of a millionth of it: `make test-slow`")
    check_stress(name)


@pytest.mark.slow
def test_an_overdamped_scene_has_advice() -> None:
    advice = check_stress("overdamped")
    assert "tolerance=" in advice.message


def check_stress(name: str) -> sp.Advice:
    case = stress.CASES[name]
    advice = sp.advise(case.scene, 1e-6, stabilization=case.stabilization)
    assert advice.met, advice.message
    run = advice.simulate(record=("state", "multipliers"))
    assert run.status == case.end
    assert advice.margin > 1.0
    assert advice.message.startswith(f'take formulation="{advice.formulation}"')
    assert {(t.formulation, t.method) for t in advice.trials} == {
        (f, m) for f in ("csm", "nullspace", "projected") for m in sp._core.METHODS
    }
    times = [trial.time for trial in advice.trials if trial.whole]
    assert times == sorted(times)
    return advice


def test_a_tighter_tolerance_takes_shorter_steps() -> None:
    scene = paper.disturbance("iii")
    steps = [
        sp.advise(scene, tolerance, methods="rk4", formulations="nullspace").dt
        for tolerance in (1e-3, 1e-5, 1e-7)
    ]
    # Of order four, a hundredth of the error takes a step shorter by 3.2; found within a factor.
    for long, short in itertools.pairwise(steps):
        assert 1.5 < long / short < 6.5, steps


def test_a_start_off_the_constraints_is_for_csm() -> None:
    scene = sp.Scene(duration=0.05)
    start = scene.start()
    off = sp.State(np.array(start.q) + 1e-6, start.p, check=False)
    scene = replace(scene, initial=off)
    with pytest.raises(ValueError, match="for 'csm' only"):
        sp.advise(scene)
    advice = sp.advise(scene, 1e-5, formulations="csm")
    assert advice.met
    assert advice.formulation == "csm"


def test_what_cannot_be_met_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    # Of the limit itself a run takes seconds, and the search takes several.
    monkeypatch.setattr("softpinch.accuracy.advisor._MOST_STEPS", 20_000)
    case = stress.CASES["overdamped"]
    advice = sp.advise(case.scene, 1e-10, methods="implicit_midpoint", formulations="nullspace")
    assert not advice.met
    assert "no pair meets 1e-10" in advice.message
    assert "it would take too many steps" in advice.message
    assert math.isinf(max(advice.error.values()))


def test_the_pilot_is_the_busiest_window() -> None:
    """A hold with a blow in the middle: what the blow does is looked at, not the hold."""
    scene = sp.Scene(
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 6]])),
        disturbances=[sp.Impulse(time=2.0, impulse=(0.1, 0.05))],
        duration=4.0,
    )
    settled = sp.simulate(replace(scene, duration=1.0, disturbances=[])).state(-1)
    scene = replace(scene, initial=replace(settled, time=0.0, grid=None, check=False))
    pilot = _Advisor(scene, 1e-6, sp.Stabilization()).pilot
    begin = pilot.start().time
    assert begin <= 2.0 < begin + pilot.duration
    assert pilot.duration == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tolerance": 0.0}, "tolerance = 0.0: must be from 1e-11 to 0.1"),
        ({"tolerance": math.nan}, "tolerance = nan"),
        ({"methods": "euler"}, "euler"),
        ({"methods": ()}, r"methods = \(\): must have at least one"),
        ({"formulations": ("csm", "lagrange")}, "lagrange"),
    ],
)
def test_bad_input(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sp.advise(sp.Scene(duration=0.1), **change)


def at_rest() -> sp.Scene:
    scene = sp.Scene(duration=4.0)
    settled = sp.simulate(scene, dt=2e-4, formulation="nullspace").state(-1)
    return replace(scene, initial=replace(settled, grid=None), duration=0.2)


def test_what_rests_is_no_error() -> None:
    """Rates of 1e-17 m/s are no size to compare with."""
    scene = at_rest()
    advice = sp.advise(scene, 1e-6)
    assert advice.met, advice.message
    bar = sp.simulate(scene, dt=1e-4, formulation="nullspace", estimate_error=True).error_estimate
    assert bar.asymptotic
    assert max(bar.largest.values()) < 1e-10


@pytest.mark.parametrize("moment", [1e-6, 1e-8, 1e-9])
def test_a_whiff_costs_no_more_than_a_push(moment: float) -> None:
    """What it moves is next to round-off of the rest."""
    scene = sp.Scene(disturbances=[sp.Step(time=0.01, moment=moment)], duration=0.05)
    advice = sp.advise(scene, 1e-6)
    assert advice.met, advice.message
    assert len([trial for trial in advice.trials if trial.whole]) <= 4


def test_a_scene_that_is_over_at_once_has_no_advice() -> None:
    scene = sp.Scene(disturbances=[sp.Impulse(time=0.0, impulse=(6.0, 0.0))], duration=0.02)
    advice = sp.advise(scene)
    assert not advice.met
    assert math.isinf(max(advice.error.values()))
