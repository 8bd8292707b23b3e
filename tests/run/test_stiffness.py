"""A run that its step has ruined is `unstable` or fails, and says which step would be stable."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import integers

import softpinch as sp
from random_pinches import open_share, random_pinch
from softpinch import strategies, stress
from softpinch.run import stiffness
from softpinch.run.options import Options
from softpinch.run.request import Request

OVERDAMPED = stress.CASES["overdamped"].scene


def said(call: Any) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", sp.StabilityWarning)
        call()
    return [str(one.message) for one in caught if one.category is sp.StabilityWarning]


@pytest.mark.parametrize("method", ["rk4", "dop853"])
@pytest.mark.parametrize("formulation", sp._core.FORMULATIONS)
def test_a_scene_that_long_steps_ruin(method: str, formulation: str) -> None:
    how: dict[str, Any] = {"method": method, "formulation": formulation}
    with pytest.warns(sp.StabilityWarning, match="dt = 0.0001 s is beyond") as caught:
        run = sp.simulate(OVERDAMPED, dt=1e-4, **how)
    assert run.status != "completed"
    (one,) = caught
    # It names the user's own line.
    assert one.filename == __file__
    text = str(one.message)
    assert 'take method="radau5"' in text and f'"{run.status}"' in text
    longest = float(text.split("is beyond ")[1].split(" s")[0])
    # The eigenvalues along the whole motion, computed elsewhere, allow the same.
    limit = sp.max_stable_dt(OVERDAMPED, **how, measure=False).predicted
    assert longest == pytest.approx(limit, rel=0.1)
    # It takes what it is told, and with a third more it fails again.
    short = replace(OVERDAMPED, duration=2e-4)
    advised = float(text.split("or dt <= ")[1].split(" s")[0])
    assert not said(lambda: sp.simulate(short, dt=advised, **how).success or pytest.fail())
    assert said(lambda: sp.simulate(short, dt=1.35 * longest, **how))


@pytest.mark.parametrize("name", ["thrown_out", "crushed"])
@pytest.mark.parametrize("dt", [1e-3, 1e-4])
def test_motions_that_end_by_themselves_give_no_warning(name: str, dt: float) -> None:
    case = stress.CASES[name]
    assert not said(lambda: sp.simulate(case.scene, dt=dt).status == case.end or pytest.fail())


def test_other_runs_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither those that complete, nor those of methods that are stable for every step."""
    monkeypatch.setattr("softpinch.run.stiffness.eigenvalues", lambda *_: pytest.fail())
    sp.simulate(sp.Scene(duration=0.01))
    blow = sp.Impulse(time=0.001, impulse=(6.0, 0.0))
    gone = sp.Scene(disturbances=[blow], duration=0.02)
    for how in ({"method": "radau5"}, {"method": "dop853", "tolerance": 1e-6}):
        assert not sp.simulate(gone, **how).success


def test_a_discrete_controller_may_start_it() -> None:
    scene = replace(OVERDAMPED, control=sp.SampledController.pid(1e-3), duration=0.01)
    (text,) = said(lambda: sp.simulate(scene, dt=1e-4))
    assert 'take method="radau5"' in text


def noisy(rate: float) -> sp.Scene:
    """Steps end at each sample; the blow at the end opens the grasp whatever the step."""
    noise = sp.Noise(rate_hz=rate, force_std=(0.1, 0.1), moment_std=0.0, seed=1)
    blow = sp.Impulse(time=0.45, impulse=(20.0, 0.0))
    return sp.Scene(duration=0.5, disturbances=[noise, blow])


@pytest.mark.parametrize("every", [1, 50])
def test_the_steps_that_were_taken_are_compared(every: int) -> None:
    """Samples of a noise end the steps after 1 ms, which is stable, whatever `dt`."""
    scene = noisy(1000.0)
    assert np.diff(sp.simulate(scene, dt=1e-3).t).max() < 1.1e-3
    assert not said(lambda: sp.simulate(scene, dt=3e-3, every=every).success and pytest.fail())


def test_an_end_that_no_stiff_method_has_reached_is_not_called_unconfirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (text,) = said(lambda: sp.simulate(OVERDAMPED, dt=1e-4, method="dop853"))
    assert "which a stiff method does not confirm" in text
    monkeypatch.setattr(stiffness, "_MOST", 2)
    (text,) = said(lambda: sp.simulate(OVERDAMPED, dt=1e-4))
    assert "confirm" not in text
    assert "a stiff method looked up to t = " in text


def test_of_completed_runs_the_least_stable_one_is_looked_at() -> None:
    """One of forty has too long steps during its slip."""
    scene, limit = slipping_shortly()
    viscosities = np.full(40, 100.0)
    viscosities[17] = 300.0
    vary = {"hand.tip.tangential_viscosity": viscosities}

    def study(dt: float) -> sp.Ensemble:
        return sp.monte_carlo(scene, 40, vary=vary, dt=dt, progress=False)

    (text,) = said(lambda: study(1.05 * limit))
    assert text.startswith("run 17: ") and "the run completed" in text
    assert not said(lambda: study(0.9 * limit))


@pytest.mark.parametrize("method", ["rk4", "dop853"])
@settings(max_examples=50, deadline=None)
@given(seed=integers(0, 2**32 - 1))
def test_the_strictest_steps_are_those_of_the_eigenvalues(method: str, seed: int) -> None:
    """The bound on eigenvalues is one, and those that are left out decide nothing."""
    rng = np.random.default_rng(seed)
    modes = rng.normal(size=(3, 14, 14)) * 10.0 ** rng.uniform(-1, 1)
    rates = stiffness.eigenvalues(modes)
    largest = float(np.abs(rates).max())
    assert largest <= stiffness._largest(modes) * (1.0 + 1e-12) < 1.4 * largest
    steps = stiffness.stable_steps(method, rates).min(axis=1)
    np.testing.assert_array_equal(stiffness.strictest_steps(method, rates), steps)
    finite = steps[np.isfinite(steps)]
    assert (finite >= stiffness.least_reach(method) / largest * (1.0 - 1e-9)).all()


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(strategies.scenes(duration=0.05))
def test_no_scene_with_a_short_step_is_warned_of(scene: sp.Scene) -> None:
    assert not said(lambda: sp.simulate(scene, dt=2e-5, method="dop853", formulation="nullspace"))


def test_of_few_failures_all_are_looked_at() -> None:
    """One of forty is unstable, and some others are lost by themselves."""
    masses = np.full(40, 0.1)
    masses[17] = 1e-4
    scene = replace(stress.CASES["hammer"].scene, duration=0.02)
    ensemble: list[sp.Ensemble] = []
    (text,) = said(
        lambda: ensemble.append(
            sp.monte_carlo(scene, 40, vary={"grasped.mass": masses}, dt=1e-4, progress=False)
        )
    )
    assert text.startswith("1 of 40 runs are unstable, such as run 17: ")
    assert ensemble[0].counts()["completed"] == 39


# By the energy ledger.

# Viscous tips, a switch of the targets and a push that opens them: openings cap what grows.
TIP = sp.Fingertip(
    normal_mass=0.01, tangential_mass=0.01, normal_viscosity=150.0, tangential_viscosity=150.0
)
CAPPED = sp.Scene(
    contact="unilateral",
    friction=0.3,
    hand=sp.Hand(tip=TIP),
    grasped=sp.GraspedObject(height=0.06),
    initial="touching",
    duration=0.3,
    schedule=sp.Schedule.steps([0.0, 0.1], np.deg2rad([[3, 3], [11, -2]])),
    disturbances=[sp.Pulse(time=0.2, duration=0.01, force=(100.0, 0.0))],
)
# RK4 damps the mode of a free surface, m d'' + c d' = 0, up to this step.
LIMIT = 2.785 * 0.01 / 150.0


def test_a_run_whose_ledger_opens_is_unstable_and_warns_of_the_longest_step() -> None:
    with pytest.warns(sp.StabilityWarning, match="longest step with which rk4 is stable") as caught:
        run = sp.simulate(CAPPED, dt=2e-4)
    assert (run.status, run.holds, run.success) == ("unstable", False, False)
    assert f"{LIMIT:.3g} s" in str(caught[0].message)
    assert "energy ledger is open" in run.message and "max_stable_dt" in run.message
    assert run.state(-1).time == run.t[-1] < 0.3


def test_record_and_lanes_do_not_change_the_status() -> None:
    runs = [
        sp.simulate(CAPPED, dt=2e-4, record=record)
        for record in (("state",), (), ("state", "energy"), ("multipliers",))
    ]
    assert {(run.status, run.t[-1], run.message) for run in runs} == {
        ("unstable", runs[0].t[-1], runs[0].message)
    }
    # Softer tips beside it in the lanes are stable.
    study = sp.monte_carlo(
        CAPPED, runs=16, dt=2e-4, vary={"hand.tip.normal_viscosity": np.linspace(20.0, 150.0, 16)}
    )
    alone = [sp.simulate(study.scene_of(run), dt=2e-4) for run in range(16)]
    assert study["status"].tolist() == [run.status for run in alone]
    assert study["end_time"].tolist() == [run.t[-1] for run in alone]
    assert np.array_equal(study["final_state"][:, :9], [run.q[-1] for run in alone])


def test_a_study_says_how_many_of_its_runs_are_unstable() -> None:
    vary = {"disturbances.0.force": sp.Uniform((50.0, -9.0), (150.0, 9.0))}
    (text,) = said(lambda: sp.monte_carlo(CAPPED, runs=32, seed=1, dt=2e-4, vary=vary))
    assert "of 32 runs are unstable" in text and f"{LIMIT:.3g} s" in text
    assert not said(lambda: sp.monte_carlo(CAPPED, runs=32, seed=1, dt=5e-5, vary=vary))


def test_a_run_that_completes_beyond_the_predicted_limit_warns() -> None:
    calm = replace(CAPPED, duration=0.15, disturbances=[])
    run = sp.simulate(calm, dt=1.02 * LIMIT, method="rk4")
    assert run.status == "completed"
    (text,) = said(lambda: sp.simulate(calm, dt=1.02 * LIMIT))
    assert "the run completed" in text
    assert not said(lambda: sp.simulate(calm, dt=0.9 * LIMIT))
    assert not said(lambda: sp.simulate(calm, dt=1e-3, method="radau5"))


def test_rows_of_a_study_are_unstable_like_lone_runs() -> None:
    """Lanes that wait for others in a step once counted energies of trials as their own."""
    tip = sp.Fingertip(
        youngs_modulus=1.2e6,
        normal_viscosity=250.0,
        tilt_coupling=-1.0,
        normal_mass=0.009,
        tangential_mass=0.0045,
    )
    scene = sp.Scene(
        contact="unilateral",
        friction=0.2,
        hand=sp.Hand(tip=tip),
        initial="touching",
        duration=0.1,
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[4.0, -1.0]])),
    )
    masses = np.geomspace(0.05, 0.2, 13)
    study = sp.monte_carlo(scene, runs=13, dt=1e-3, method="dop853", vary={"grasped.mass": masses})
    alone = [sp.simulate(study.scene_of(run), dt=1e-3, method="dop853") for run in range(13)]
    assert "unstable" in {run.status for run in alone}
    assert study["status"].tolist() == [run.status for run in alone]
    assert study["end_time"].tolist() == [run.t[-1] for run in alone]


def test_a_study_with_physical_failures_warns_of_its_completed_runs() -> None:
    """A stiff method confirms how the pushed object is lost; the other runs complete."""
    push = sp.Step(time=0.05, force=(0.0, 0.0))
    scene = replace(CAPPED, duration=0.15, disturbances=[push])
    forces = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, -60.0]])
    caught: list[sp.Ensemble] = []

    def compute() -> None:
        vary = {"disturbances.0.force": forces}
        caught.append(sp.monte_carlo(scene, runs=3, dt=1.02 * LIMIT, vary=vary))

    (text,) = said(compute)
    assert caught[0]["status"].tolist() == ["completed", "completed", "lost"]
    assert text.startswith("run 0: ") and "the run completed" in text


def slipping_shortly() -> tuple[sp.Scene, float]:
    """A scene, and the longest stable step of RK4 during its slip."""
    # Nine switches have most steps of the stiff run that looks for the limit; the slip has few.
    tip = sp.Fingertip(tangential_mass=0.02, tangential_viscosity=300.0)
    times, angles = 0.05 * np.arange(9), 8.0 + 0.5 * (np.arange(9) % 2)
    scene = sp.Scene(
        contact="unilateral",
        friction=0.5,
        hand=sp.Hand(tip=tip),
        initial="touching",
        duration=0.45,
        schedule=sp.Schedule.steps(times, np.deg2rad(np.stack([angles, angles], axis=1))),
        disturbances=[sp.Pulse(time=0.17, duration=0.001, force=(0.0, 150.0))],
    )
    # RK4 damps the shear of a slipping tip, m d'' + c d' = 0 but for its weak spring, up to this.
    return scene, 2.785 * 0.02 / 300.0


def test_a_step_too_long_for_a_short_slip_only_warns() -> None:
    scene, limit = slipping_shortly()
    run = sp.simulate(scene, dt=0.9 * limit)
    slips = [change.time for change in run.contact_changes]
    assert run.status == "completed" and 0.17 < min(slips) < max(slips) < 0.172
    (text,) = said(lambda: sp.simulate(scene, dt=1.05 * limit))
    assert "the run completed" in text and f"beyond {limit:.3g} s" in text
    assert not said(lambda: sp.simulate(scene, dt=0.9 * limit))


def looked_at(request: Request) -> bool:
    result = request.compute()
    return stiffness.needs_a_look(result["step_to_stable_one"], request.scene, result["violations"])


@pytest.mark.parametrize("formulation", ["nullspace", "projected", "csm"])
def test_round_off_at_a_start_without_energy_is_no_alarm(formulation: str) -> None:
    """Without gravity a point contact starts with round-off in place of an energy."""
    pushed = sp.Sine(frequency_hz=40.0, force=(3.0, 2.0))
    for width in np.linspace(0.04, 0.05, 41):
        grasped = sp.GraspedObject(width=float(width), com_offset=2e-3)
        scene = sp.Scene(grasped=grasped, gravity=0.0, initial="touching", duration=0.02)
        for loads in ([], [pushed]):
            scene = replace(scene, disturbances=loads)
            run = sp.simulate(scene, dt=1.2e-3, formulation=formulation)
            assert run.status != "unstable", (width, run.message)
            request = Request(scene, Options.checked(dt=1.2e-3, formulation=formulation))
            assert looked_at(request)


def test_a_simulator_ends_as_unstable() -> None:
    sim = sp.Simulator(CAPPED, period=1e-3, dt=2e-4)
    seen = sim.reset()
    while seen.status == "running":
        seen = sim.step(np.deg2rad([3, 3] if seen.t < 0.1 else [11, -2]))
    assert seen.status == "unstable"


def check_the_limit(scene: sp.Scene, limit: float) -> None:
    calm = sp.simulate(scene, dt=limit / 3.0, record=("energy",))
    assert calm.status != "unstable", calm.message
    assert calm.status != "completed" or open_share(calm) < 0.1
    # The bound on the rates is one: whatever is beyond the limit is looked at.
    options = Options.checked(dt=1.001 * limit)
    assert limit > scene.duration or looked_at(Request(scene, options))


@pytest.mark.parametrize(
    "place",
    [
        pytest.param(819, id="a graze"),
        pytest.param(1325, id="a slip of 0.3 microseconds"),
        pytest.param(1741, id="near the critical friction"),
    ],
)
def test_rates_beyond_the_bound(place: int) -> None:
    """Scenes of the long sweep below, in which the bound does not hold or rows are far apart."""
    rng = np.random.default_rng(41)
    scene = [random_pinch(rng, "unilateral") for _ in range(place + 1)][-1]
    check_the_limit(scene, sp.max_stable_dt(scene, measure=False).predicted)


def test_runs_beyond_the_rim_of_a_tip_are_looked_at() -> None:
    rng = np.random.default_rng(41)
    scene = [random_pinch(rng, "unilateral") for _ in range(1998)][-1]
    request = Request(scene, Options.checked(dt=1e-5))
    assert request.compute()["violations"]["rim"] < scene.duration
    assert looked_at(request)
    assert not looked_at(request.with_(replace(scene, duration=0.1)))


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize(
    "runs", [20, pytest.param(2500, marks=pytest.mark.slow)], ids=["some", "many"]
)
def test_random_hands_have_no_false_alarm_and_nothing_wrong_completes(
    contact: str, runs: int
) -> None:
    """No false alarm at a third of the limit; above it nothing wrong completes."""
    rng = np.random.default_rng(41)
    alarms, wrong, unknown = 0, 0, 0
    for _ in range(runs):
        scene = random_pinch(rng, contact)
        longest = sp.max_stable_dt(scene, measure=False)
        limit = longest.predicted
        if "the motion is known to" in longest.message:
            # Beyond the rim of a tip the energy (4) has a pole at a tilt of 90 degrees.
            assert "rim" in sp.simulate(scene, method="radau5", tolerance=1e-6).violations
            unknown += 1
            continue
        check_the_limit(scene, limit)
        for factor in (1.1, 1.5, 2.5):
            run = sp.simulate(scene, dt=factor * limit, record=("energy",))
            alarms += run.status == "unstable"
            wrong += run.status == "completed" and open_share(run) > 1.0
    assert wrong == 0
    assert alarms > 0.2 * runs
    assert unknown <= 1


@pytest.mark.parametrize("name", sorted(sp.stress.CASES))
def test_no_false_alarm_on_stress_scenes(name: str) -> None:
    case = sp.stress.CASES[name]
    limit = sp.max_stable_dt(case.scene, measure=False).predicted
    dt = min(limit / 3.0, case.scene.duration)
    scene = replace(case.scene, duration=min(case.scene.duration, 2e5 * dt))
    assert sp.simulate(scene, dt=dt, record=()).status != "unstable"


def slippery(viscosity: float) -> sp.Scene:
    """A grasp that slips down between tips of 10 g."""
    tip = sp.Fingertip(tangential_viscosity=viscosity, tangential_mass=0.01)
    return sp.Scene(hand=sp.Hand(tip=tip), contact="unilateral", friction=0.01, duration=0.03)


def test_a_slipping_tip_limits_the_step() -> None:
    """Its shear decays at c / m = 1e5 1/s, which RK4 damps up to 2.785 / 1e5 s."""
    scene = slippery(1e3)
    how: dict[str, Any] = {"formulation": "projected"}
    exact = sp.simulate(scene, method="radau5", tolerance=1e-6, **how)
    below, above = (sp.simulate(scene, dt=dt, **how) for dt in (2.6e-5, 2.9e-5))
    shear = exact.q[-1, 7:]
    np.testing.assert_allclose(below.q[-1, 7:], shear, rtol=1e-3)
    assert (np.abs(above.q[-1, 7:] / shear - 1.0) > 0.1).all()
    (text,) = said(lambda: sp.simulate(slippery(1e2), dt=5.57e-3, **how).success and pytest.fail())
    assert "is beyond 0.000279 s" in text


def test_a_step_within_the_limit_is_right() -> None:
    exact = sp.simulate(CAPPED, tolerance=1e-9, method="radau5", formulation="projected")
    run = sp.simulate(CAPPED, dt=0.9 * LIMIT)
    assert run.status == exact.status == "completed" and run.holds
    assert abs(run.q[-1, 2] - exact.q[-1, 2]) < 1e-5


def test_gains_of_the_stabilisation_beyond_the_limit_are_unstable() -> None:
    # 2.785 / dt is 27 850.
    stiff = sp.Stabilization(alpha=28_500.0, beta=28_500.0)
    scene = sp.paper.disturbance("ii", duration=1.5)
    run = sp.simulate(scene, dt=1e-4, stabilization=stiff)
    assert run.status != "completed"
