"""Runs whose steps are beyond the stability limit: they are `unstable`, never `completed`."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp
from random_pinches import open_share, random_pinch
from softpinch.run.options import Options
from softpinch.run.request import Request

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


def _warnings(call: object) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", sp.StabilityWarning)
        call()  # type: ignore[operator]
    return [str(one.message) for one in caught if one.category is sp.StabilityWarning]


def test_a_run_whose_ledger_opens_is_unstable_and_warns_of_the_longest_step() -> None:
    with pytest.warns(sp.StabilityWarning, match="longest step with which rk4 is stable") as caught:
        run = sp.simulate(CAPPED, dt=2e-4)
    assert (run.status, run.holds, run.success) == ("unstable", False, False)
    assert f"{LIMIT:.3g} s" in str(caught[0].message)
    assert "energy ledger is open" in run.message and "max_stable_dt" in run.message
    assert run.state(-1).time == run.t[-1] < 0.3


def test_a_step_within_the_limit_is_right() -> None:
    exact = sp.simulate(CAPPED, tolerance=1e-9, method="radau5", formulation="projected")
    run = sp.simulate(CAPPED, dt=0.9 * LIMIT)
    assert run.status == exact.status == "completed" and run.holds
    assert abs(run.q[-1, 2] - exact.q[-1, 2]) < 1e-5


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

    (text,) = _warnings(compute)
    assert caught[0]["status"].tolist() == ["completed", "completed", "lost"]
    assert text.startswith("run 0: ") and "the run completed" in text


def test_a_study_says_how_many_of_its_runs_are_unstable() -> None:
    vary = {"disturbances.0.force": sp.Uniform((50.0, -9.0), (150.0, 9.0))}
    (text,) = _warnings(lambda: sp.monte_carlo(CAPPED, runs=32, seed=1, dt=2e-4, vary=vary))
    assert "of 32 runs are unstable" in text and f"{LIMIT:.3g} s" in text
    assert not _warnings(lambda: sp.monte_carlo(CAPPED, runs=32, seed=1, dt=5e-5, vary=vary))


def test_a_run_that_completes_beyond_the_predicted_limit_warns() -> None:
    calm = replace(CAPPED, duration=0.15, disturbances=[])
    run = sp.simulate(calm, dt=1.02 * LIMIT, method="rk4")
    assert run.status == "completed"
    (text,) = _warnings(lambda: sp.simulate(calm, dt=1.02 * LIMIT))
    assert "the run completed" in text
    assert not _warnings(lambda: sp.simulate(calm, dt=0.9 * LIMIT))
    assert not _warnings(lambda: sp.simulate(calm, dt=1e-3, method="radau5"))


def test_a_step_too_long_for_a_short_slip_only_warns() -> None:
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
    limit = 2.785 * 0.02 / 300.0
    run = sp.simulate(scene, dt=0.9 * limit)
    slips = [change.time for change in run.contact_changes]
    assert run.status == "completed" and 0.17 < min(slips) < max(slips) < 0.172
    (text,) = _warnings(lambda: sp.simulate(scene, dt=1.05 * limit))
    assert "the run completed" in text and f"beyond {limit:.3g} s" in text
    assert not _warnings(lambda: sp.simulate(scene, dt=0.9 * limit))


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
            assert request.compute()["may_be_unstable"]


def test_a_simulator_ends_as_unstable() -> None:
    sim = sp.Simulator(CAPPED, period=1e-3, dt=2e-4)
    seen = sim.reset()
    while seen.status == "running":
        seen = sim.step(np.deg2rad([3, 3] if seen.t < 0.1 else [11, -2]))
    assert seen.status == "unstable"


def test_gains_of_the_stabilisation_beyond_the_limit_are_unstable() -> None:
    # 2.785 / dt is 27 850.
    stiff = sp.Stabilization(alpha=28_500.0, beta=28_500.0)
    scene = sp.paper.disturbance("ii", duration=1.5)
    run = sp.simulate(scene, dt=1e-4, stabilization=stiff)
    assert run.status != "completed"


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize(
    "runs", [20, pytest.param(2500, marks=pytest.mark.slow)], ids=["some", "many"]
)
def test_random_hands_have_no_false_alarm_and_nothing_wrong_completes(
    contact: str, runs: int
) -> None:
    """No false alarm at a third of the limit; above it nothing wrong completes."""
    rng = np.random.default_rng(41)
    alarms, wrong = 0, 0
    for _ in range(runs):
        scene = random_pinch(rng, contact)
        limit = sp.max_stable_dt(scene, measure=False).predicted
        calm = sp.simulate(scene, dt=limit / 3.0, record=("energy",))
        assert calm.status != "unstable", calm.message
        assert calm.status != "completed" or open_share(calm) < 0.1
        # The bound on the rates is one: whatever is beyond the limit is looked at.
        options = Options.checked(dt=1.001 * limit)
        assert limit > scene.duration or Request(scene, options).compute()["may_be_unstable"]
        for factor in (1.1, 1.5, 2.5):
            run = sp.simulate(scene, dt=factor * limit, record=("energy",))
            alarms += run.status == "unstable"
            wrong += run.status == "completed" and open_share(run) > 1.0
    assert wrong == 0
    assert alarms > 0.2 * runs


@pytest.mark.parametrize("name", sorted(sp.stress.CASES))
def test_no_false_alarm_on_stress_scenes(name: str) -> None:
    case = sp.stress.CASES[name]
    limit = sp.max_stable_dt(case.scene, measure=False).predicted
    dt = min(limit / 3.0, case.scene.duration)
    scene = replace(case.scene, duration=min(case.scene.duration, 2e5 * dt))
    assert sp.simulate(scene, dt=dt, record=()).status != "unstable"


def test_no_false_alarm_on_the_manipulation_of_the_paper() -> None:
    for dt in (1e-4, 5e-4):
        assert sp.simulate(sp.paper.manipulation(), dt=dt, record=()).status == "completed"
