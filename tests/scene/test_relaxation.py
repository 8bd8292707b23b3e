"""Tips that relax: Maxwell branches against closed forms, SciPy, and the ledger."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import softpinch as sp

MODULUS, RADIUS, WIDTH = 3e5, 0.02, 0.05
LAWS: dict[str, tuple[dict[str, Any], Any, Any]] = {
    "springs": (
        {"youngs_modulus": MODULUS},
        lambda d: np.pi * MODULUS * d**2,
        lambda d: 2.0 * np.pi * MODULUS * d,
    ),
    "power": (
        {"law": sp.PowerLaw(4e4, 1.6, foot=1e-4)},
        lambda d: 4e4 * ((d + 1e-4) ** 1.6 - 1e-4**1.6 - 1.6 * 1e-4**0.6 * d),
        lambda d: 4e4 * 1.6 * ((d + 1e-4) ** 0.6 - 1e-4**0.6),
    ),
}
BRANCHES = (sp.Maxwell(0.4, 0.05), sp.Maxwell(0.25, 0.008))


def squeezed(
    times: Any, travels: Any, law: str = "springs", branches: Any = BRANCHES, **more: Any
) -> sp.Scene:
    """Two driven jaws that press a box from both sides alike, so that d_n is their travel."""
    tip = sp.Fingertip(**LAWS[law][0], relaxation=branches, radius=RADIUS)
    jaw = sp.Jaw(root_offset=0.5 * WIDTH + RADIUS + 0.01, half_thickness=0.01, height=0.0)
    scene = {
        "hand": sp.Hand(right=jaw, left=jaw, tip=tip),
        "grasped": sp.GraspedObject(width=WIDTH),
        "schedule": sp.Schedule.ramps(times, np.repeat(np.reshape(travels, (-1, 1)), 2, axis=1)),
        "fingers": "driven",
        "gravity": 0.0,
        "duration": 0.1,
    }
    return sp.Scene(**{**scene, **more})


def lively(**more: Any) -> sp.Scene:
    """A grasp by links whose tips have branches, pushed until it slips and opens."""
    tips = (
        sp.Fingertip(relaxation=BRANCHES[:1], normal_mass=0.01, tangential_mass=0.01),
        sp.Fingertip(
            law=sp.PowerLaw(5e4, 1.7, foot=2e-4),
            relaxation=sp.Maxwell(0.7, 0.02),
            normal_mass=0.01,
            tangential_mass=0.02,
        ),
    )
    scene = {
        "hand": sp.Hand(tip=tips),
        "grasped": sp.GraspedObject(width=0.045, height=0.05),
        "schedule": sp.Schedule.in_degrees("steps", [0.0], [[5.0, 6.0]]),
        "disturbances": [sp.Pulse(time=0.15, duration=0.02, force=(14.0, -18.0))],
        "contact": "unilateral",
        "friction": 0.5,
        "initial": "touching",
        "duration": 0.3,
    }
    return sp.Scene(**{**scene, **more})


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("method", ["rk4", "dop853", "rosenbrock", "radau5"])
def test_a_held_tip_relaxes_as_the_closed_form_says(law: str, method: str) -> None:
    d, force = 0.004, LAWS[law][1](0.004)
    scene = squeezed([0.0], [d], law)
    # It has just been pressed: nothing is remembered.
    scene = replace(scene, initial=replace(scene.start(), relaxation=np.zeros(8)))
    how: dict[str, Any] = {"dt": 1e-4} if method == "rk4" else {"tolerance": 1e-11}
    record = ("state", "multipliers")
    run = sp.simulate(scene, method=method, formulation="nullspace", record=record, **how)
    faded = sum(one.share * np.exp(-run.t / one.time) for one in BRANCHES)
    assert np.abs(run.multipliers[:, :2] / (force * (1.0 + faded))[:, None] - 1.0).max() < 1e-10
    remembered = [force * (1.0 - np.exp(-run.t / one.time)) for one in BRANCHES]
    assert np.allclose(run.relaxation[:, [0, 4]].T, remembered, rtol=0.0, atol=1e-10 * force)
    assert run.status == "completed"


def test_the_response_to_a_smooth_squeeze_is_the_closed_form() -> None:
    """The travel is a quintic of time, so that r' + r / tau = F / tau has a polynomial solution."""
    branch, T = BRANCHES[1], 0.06
    schedule = sp.Schedule.minimum_jerk([0.0, 0.01], [[0.002] * 2, [0.005] * 2], move_time=T)
    scene = squeezed([0.0], [0.002], branches=branch, schedule=schedule)
    times = 0.01 + T * np.linspace(0.0, 1.0, 31)
    run = sp.simulate(scene, tolerance=1e-12, method="dop853", times=times)
    s = np.polynomial.Polynomial([0.0, 1.0 / T])
    travel = 0.002 + 0.003 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    force = np.pi * MODULUS * travel**2
    particular = sum((-branch.time) ** k * force.deriv(k) for k in range(11))
    past = times - 0.01
    # It has relaxed when the move begins.
    rest = (force(0.0) - particular(0.0)) * np.exp(-past / branch.time)
    assert np.abs(run.relaxation[:31, 0] - (particular(past) + rest)).max() < 1e-10 * force(T)


@pytest.mark.parametrize("law", LAWS)
def test_a_released_tip_moves_as_scipy_says(law: str) -> None:
    """A free tip keeps its mass, law and branch, and a dent that fades."""
    branch, d0 = sp.Maxwell(0.8, 0.02), 0.004
    tip = replace(squeezed([0.0], [d0], law, branch).hand.tip, normal_mass=0.02)
    scene = squeezed([0.0], [d0], law, branch)
    away = scene.start().q.copy()
    away[3:5] -= 0.02
    scene = replace(
        scene,
        hand=replace(scene.hand, tip=tip),
        schedule=sp.Schedule.steps([0.0], [[d0 - 0.02] * 2]),
        contact="unilateral",
        friction=0.5,
        initial=sp.State(away, contact=np.zeros(4)),
    )
    run = sp.simulate(scene, tolerance=1e-11, method="dop853")
    force, m, c = LAWS[law][1], 0.02, tip.normal_viscosity

    def rate(_: float, y: Any) -> list[float]:
        d, v, r = y
        pull = force(d) + branch.share * (force(d) - r)
        return [v, -(c * v + pull) / m, (force(d) - r) / branch.time]

    start = [d0, 0.0, force(d0)]
    found = solve_ivp(rate, (0.0, 0.1), start, "DOP853", run.t, rtol=1e-12, atol=1e-14)
    assert not run.contact_changes
    assert np.abs(run.q[:, 5] - found.y[0]).max() < 1e-9 * d0
    assert np.abs(run.relaxation[:, 0] - found.y[2]).max() < 1e-9 * start[2]
    assert run.q[-1, 5] > 0.3 * d0, "it keeps a dent"


@pytest.mark.parametrize("formulation", ["csm", "nullspace", "projected"])
def test_formulations_and_methods_agree_and_the_ledger_closes(formulation: str) -> None:
    scene = lively(contact="bilateral", friction=None)
    how: dict[str, Any] = {"tolerance": 1e-11, "times": np.linspace(0.0, 0.3, 31)}
    best = sp.simulate(scene, method="dop853", formulation="nullspace", **how)
    for method in ("dop853", "rosenbrock", "radau5"):
        how["tolerance"] = 1e-11 if method == "dop853" else 1e-9
        record = ("state", "multipliers", "energy")
        run = sp.simulate(scene, method=method, formulation=formulation, record=record, **how)
        size = np.abs(best.q).max(axis=0)
        assert np.abs((run.q - best.q) / size).max() < 2e-7, method
        assert np.abs(run.relaxation - best.relaxation).max() < 1e-6 * best.relaxation.max()
        exchanged = run.energy.exchanged
        assert np.abs(run.energy.closure).max() < 1e-6 * exchanged, method
        assert np.diff(run.energy.viscous_loss).min() > -1e-9 * exchanged, "branches are passive"


@pytest.mark.parametrize("method", ["rk4", "implicit_midpoint", "radau5", "rosenbrock"])
def test_equal_steps_have_their_order_with_branches(method: str) -> None:
    scene = lively(contact="bilateral", friction=None, disturbances=[], duration=0.02)
    exact = sp.simulate(scene, tolerance=1e-13, method="dop853", formulation="nullspace")
    errors = []
    for dt in (2e-4, 1e-4):
        run = sp.simulate(scene, dt=dt, method=method, formulation="nullspace")
        error = np.abs(run.relaxation[-1] - exact.relaxation[-1]).max()
        errors.append(error / np.abs(exact.relaxation[-1]).max())
    order = np.log2(errors[0] / errors[1])
    expected = {"rk4": 4.0, "implicit_midpoint": 2.0, "radau5": 5.0, "rosenbrock": 4.0}[method]
    assert order > expected - 0.4 or errors[1] < 1e-11, (errors, order)


def test_unilateral_runs_close_the_ledger_and_have_the_bits_of_lanes_and_resumed_runs() -> None:
    scene = lively()
    run = sp.simulate(scene, record=("state", "energy", "contact"), dt=2e-5, every=50)
    assert {change.after.name for change in run.contact_changes} >= {"SLIP", "STICK"}
    assert np.abs(run.energy.closure).max() < 1e-6 * run.energy.exchanged
    plain = sp.simulate(scene, dt=2e-5, every=50)
    half = plain.state(len(plain.t) // 2)
    assert half.relaxation is not None and half.relaxation.shape == (4,)
    rest = replace(scene, initial=half, duration=plain.t[-1] - half.time)
    again = sp.simulate(rest, dt=2e-5)
    assert again.q[-1].tobytes() == plain.q[-1].tobytes()
    assert again.relaxation[-1].tobytes() == plain.relaxation[-1].tobytes()
    many = sp.monte_carlo(
        scene,
        vary={"hand.tip.right.relaxation.0.share": np.array([0.0, 0.2, 0.4, 0.7, 1.0])},
        dt=2e-5,
    )
    for k in range(5):
        alone = sp.simulate(many.scene_of(k), dt=2e-5)
        assert many["final_state"][k].tobytes() == np.r_[alone.q[-1], alone.p[-1]].tobytes()


@given(share=st.floats(0.05, 1.5), time=st.floats(1e-3, 0.3))
def test_the_mirrored_hand_relaxes_as_the_mirror_image(share: float, time: float) -> None:
    right, left = (replace(tip, relaxation=sp.Maxwell(share, time)) for tip in lively().hand.tips)
    scene = lively(duration=0.02, disturbances=[])
    scene = replace(scene, hand=replace(scene.hand, tip=(right, left)))
    mirrored = replace(
        scene,
        hand=replace(scene.hand, tip=(left, right)),
        schedule=sp.Schedule.in_degrees("steps", [0.0], [[6.0, 5.0]]),
    )
    one, other = (sp.simulate(each, dt=1e-4) for each in (scene, mirrored))
    assert np.allclose(one.q[-1, 5:7], other.q[-1, [6, 5]], rtol=1e-9)
    assert np.allclose(one.relaxation[-1], other.relaxation[-1, [1, 0, 3, 2]], rtol=1e-8, atol=1e-9)


def test_branches_change_no_equilibrium_and_decay_in_its_linear_model() -> None:
    scene = lively(friction=2.0)
    plain = replace(
        scene,
        hand=replace(scene.hand, tip=tuple(replace(t, relaxation=None) for t in scene.hand.tips)),
    )
    held, still = sp.equilibrium(scene), sp.equilibrium(plain)
    # The law of tips with branches is (5) in other words.
    assert np.abs(held.state.q - still.state.q).max() < 1e-15
    assert held.stable and len(held.eigenvalues) == len(still.eigenvalues) + 4
    run = sp.simulate(replace(scene, initial=held.state, duration=0.01), dt=1e-4)
    assert np.abs(run.q - held.state.q).max() < 1e-10
    model = sp.linearize(replace(scene, contact="bilateral"), held.state)
    names = ["branch_1_force_1", "branch_1_force_2", "branch_1_shear_1", "branch_1_shear_2"]
    places = [model.states.index(name) for name in names]
    assert [model.state_units[k] for k in places] == ["N", "N", "m", "m"]
    # Small deviations of the states of branches decay as SciPy's exponential of A says.
    change = np.array([1e-6, -2e-6, 1e-9, 2e-9])
    start = replace(held.state, relaxation=run.relaxation[0] + change)
    bilateral = replace(scene, contact="bilateral", initial=start, duration=0.02)
    run = sp.simulate(bilateral, tolerance=1e-12, method="dop853", formulation="nullspace")
    deviation = np.zeros(len(model.states))
    deviation[places] = change
    found = run.relaxation[-1] - model.state_values[places]
    assert np.allclose(found, (expm(model.A * 0.02) @ deviation)[places], rtol=1e-4)


@pytest.mark.parametrize("law", LAWS)
def test_the_response_to_a_sine_is_that_of_standard_linear_solids(law: str) -> None:
    """Two tips hold a box: each is a spring, a damper and a branch for each Maxwell element."""
    d, c, m, omega = 0.004, 3.0, 0.02, np.geomspace(1.0, 1e4, 25)
    scene = squeezed([0.0], [d], law)
    hand = replace(scene.hand, tip=replace(scene.hand.tips[0], normal_viscosity=c, normal_mass=m))
    scene = replace(scene, hand=hand, initial=sp.equilibrium(replace(scene, hand=hand)).state)
    model = sp.linearize(scene, scene.start(), inputs="force", outputs="pose")
    size = np.eye(len(model.states))
    found = [(model.C @ np.linalg.solve(1j * w * size - model.A, model.B))[0, 0] for w in omega]
    s = 1j * omega
    branches = sum(one.share * s * one.time / (1.0 + s * one.time) for one in BRANCHES)
    stiffness = LAWS[law][2](d) * (1.0 + branches) + c * s
    mass = scene.grasped.mass + 2.0 * m
    expected = 1.0 / (mass * s**2 + 2.0 * stiffness)
    assert np.abs(np.array(found) / expected - 1.0).max() < 1e-10


def test_toml_paths_and_errors_name_the_branch() -> None:
    scene = lively()
    assert sp.Scene.from_toml(scene.to_toml()) == scene
    found = scene.with_({"hand.tip.left.relaxation.0.time": 0.5}).hand.tips[1].relaxation
    assert found == (sp.Maxwell(0.7, 0.5),)
    assert scene.vary_paths()["hand.tip.right.relaxation.0.time"][1] == "s"
    with pytest.raises(ValueError, match=r"Maxwell\.time = 0\.0: must be finite and > 0"):
        sp.Maxwell(0.5, 0.0)
    with pytest.raises(ValueError, match="one Maxwell or two"):
        sp.Fingertip(relaxation=(sp.Maxwell(0.1, 0.1),) * 3)
    with pytest.raises(TypeError, match="one Maxwell or two"):
        sp.Fingertip(relaxation=(0.5, 0.1))
    with pytest.raises(ValueError, match=r"initial\.relaxation.*must be 4 numbers"):
        sp.simulate(replace(scene, initial=sp.State(scene.start().q, relaxation=np.zeros(8))))
    with pytest.raises(ValueError, match=r'"radau5": must be one of the others with Maxwell bran'):
        sp.simulate(
            sp.Scene(hand=sp.Hand(tip=sp.Fingertip(relaxation=BRANCHES))),
            method="radau5",
            sensitivities=["grasped.mass"],
        )
    two = replace(scene, hand=sp.Hand(tip=sp.Fingertip(relaxation=BRANCHES)))
    with pytest.raises(ValueError, match=r"Maxwell branches of a tip = 2.*: must be fewer: beside"):
        sp.simulate(two, record="energy")
    assert sp.simulate(two).status == "completed"


@pytest.mark.filterwarnings("ignore::softpinch.StabilityWarning")
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("branches", [1, 2])
def test_steps_that_may_be_unstable_are_guarded_only_where_a_state_has_place_for_the_works(
    contact: str, moves: bool, branches: int
) -> None:
    """The guard is a ledger, for which a state of 32 numbers has no place beside two branches."""
    tip = sp.Fingertip(normal_mass=1e-3, tangential_mass=1e-3, relaxation=BRANCHES[:branches])
    scene = sp.Scene(
        hand=sp.Hand(tip=tip),
        contact=contact,
        friction=0.8,
        initial="touching",
        motion=sp.HandMotion.constant((1.0, 0.0)) if moves else None,
        duration=0.01,
    )
    dt = 0.98 * sp.max_stable_dt(scene).dt
    summaries = ("slip_distance", "final_state")
    for chosen in (summaries, summaries[1:]):
        many = sp.monte_carlo(scene, 2, vary={"friction": [0.8, 0.9]}, dt=dt, summaries=chosen)
        assert many.status.tolist() == ["completed"] * 2
        run = sp.simulate(scene, dt=dt)
        assert many["final_state"][0].tobytes() == np.r_[run.q[-1], run.p[-1]].tobytes()
    held = sp.Simulator(replace(scene, control=sp.Torque()), period=dt, dt=dt)
    assert held.step((0.1, 0.1)).status == "running"
