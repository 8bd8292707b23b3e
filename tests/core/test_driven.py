"""Fingers that follow their schedule exactly: beside SymPy's equations, stiff control, themselves.

The oracle's null-space form has five velocities; with two of them prescribed three are left, and
what their rows lack is the torque. The schedule's polynomial is written here once more.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from ensembles import require_alone
from oracle.evaluate import parameters
from oracle.lagrangian import PARAMETERS
from oracle.trajectory import null_space
from scenes import uneven
from softpinch import _core, strategies

EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque")
START, MOVE = 0.0137, 0.0411
FROM, TO = np.deg2rad([5.0, 6.0]), np.deg2rad([8.0, 4.0])
PAIRS = [(f, m) for f in _core.FORMULATIONS for m in _core.METHODS]


def moving(**changes: Any) -> sp.Scene:
    """Different fingers, tips and gains on one smooth move, pushed on the way."""
    scene = replace(
        uneven(),
        fingers="driven",
        initial=None,
        schedule=sp.Schedule.minimum_jerk([0.0, START], [FROM, TO], move_time=MOVE),
        disturbances=(
            sp.Step(time=0.0231, force=(3.0, -2.0), moment=0.01),
            sp.Impulse(time=0.0333, impulse=(0.004, -0.003), angular_impulse=2e-5),
        ),
        duration=0.08,
    )
    return replace(scene, **changes)


def way(t: float) -> tuple[float, float, float]:
    """The share of the move that is done at t, and its two derivatives."""
    s = min(max((t - START) / MOVE, 0.0), 1.0)
    return (
        s**3 * (10.0 + s * (6.0 * s - 15.0)),
        30.0 * s**2 * (s - 1.0) ** 2 / MOVE,
        60.0 * s * (s - 1.0) * (2.0 * s - 1.0) / MOVE**2,
    )


def solved(
    scene: sp.Scene, t: float, y: np.ndarray, push: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """The object's accelerations, the fingers' torques and the shears' rates at x, y, theta, d_t1,
    d_t2 and the rates of the first three."""
    done, rate, acceleration = way(t)
    change = TO - FROM
    state = [*y[:3], *(FROM + done * change), *y[3:5], 0.0, 0.0, *y[5:], *(rate * change)]
    free = replace(scene, control=sp.Pid(kp=0.0, kd=0.0, ki=0.0))
    numbers = parameters(free)
    values = tuple(numbers[name] for name in PARAMETERS)
    terms = null_space()[0](state, (0.0, 0.0, *push), values)
    matrix, right = np.array(terms[:25]).reshape(5, 5), np.array(terms[25:30])
    asked = acceleration * change
    object_ = np.linalg.solve(matrix[:3, :3], right[:3] - matrix[:3, 3:] @ asked)
    torque = matrix[3:, :3] @ object_ + matrix[3:, 3:] @ asked - right[3:]
    return object_, torque, list(terms[30:32])


def exact(scene: sp.Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, y, theta and their rates at the end, and the torques there, by SciPy; of `moving`."""
    start = scene.start()
    y = np.array([*start.q[:3], *start.q[7:], *start.p[:3]])
    edges = [0.0, START, 0.0231, 0.0333, START + MOVE, scene.duration]
    push = (0.0, 0.0, 0.0)
    for left, right in pairwise(edges):
        if left == 0.0231:
            push = (3.0, -2.0, 0.01)
        if left == 0.0333:
            # What the impulse would give as a force, with nothing else acting: the difference.
            kick = [a + b for a, b in zip(push, (0.004, -0.003, 2e-5), strict=True)]
            y[5:] += solved(scene, left, y, tuple(kick))[0] - solved(scene, left, y, push)[0]

        def slope(t: float, y: np.ndarray, push: tuple[float, ...] = push) -> np.ndarray:
            object_, _, slip = solved(scene, t, y, push)
            return np.array([*y[5:], *slip, *object_])

        found = scipy.integrate.solve_ivp(
            slope, (left, right), y, method="DOP853", rtol=1e-12, atol=1e-14
        )
        y = found.y[:, -1]
    return y[:3], y[5:], solved(scene, scene.duration, y, push)[1]


@pytest.fixture(scope="module")
def reference() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return exact(moving())


@pytest.mark.parametrize(("formulation", "method"), PAIRS)
def test_the_motion_and_the_torques_are_those_of_the_oracle(
    formulation: str, method: str, reference: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    dt = 2e-6 if method == "implicit_midpoint" else 2e-5
    run = sp.simulate(moving(), dt=dt, method=method, formulation=formulation, record=EVERYTHING)
    assert run.success, run.message
    allowed = 1e-7 if method == "implicit_midpoint" else 1e-9
    for ours, theirs in zip((run.q[-1, :3], run.p[-1, :3], run.torque[-1]), reference, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=allowed, atol=allowed)
    done, rate, _ = np.array([way(t) for t in run.t]).T
    np.testing.assert_allclose(run.q[:, 3:5], FROM + done[:, None] * (TO - FROM), atol=1e-15)
    np.testing.assert_allclose(run.p[:, 3:5], rate[:, None] * (TO - FROM), atol=1e-12)
    run.check()


def test_stiff_control_of_heavy_fingers_comes_to_the_same() -> None:
    """The cause of the fingers' motion does not matter if nothing slows it."""
    scene = moving()
    hand = replace(
        scene.hand,
        right=replace(scene.hand.right, inertia=1e3),
        left=replace(scene.hand.left, inertia=1e3),
    )
    how: dict[str, Any] = {"method": "radau5", "formulation": "nullspace", "tolerance": 1e-9}
    stiff = replace(scene, fingers="pid", hand=hand, control=sp.Pid(kp=1e11, kd=2e7, ki=0.0))
    stiff = replace(stiff, initial=scene.start())
    ours, theirs = sp.simulate(scene, **how), sp.simulate(stiff, **how)
    assert ours.success
    assert theirs.success
    np.testing.assert_allclose(ours.q[-1], theirs.q[-1], atol=1e-6)


def test_torque_of_pid_fingers_is_the_control_law() -> None:
    scene = uneven()
    run = sp.simulate(scene, record=("state", "torque"), every=40)
    pids = scene.control
    assert isinstance(pids, tuple)
    for t, q, p, integral, torque in zip(
        run.t[:-1], run.q, run.p, run.integral, run.torque, strict=False
    ):
        target = sp.evaluate(scene, t, q, p, integral).target
        for i, pid in enumerate(pids):
            law = -pid.kp * (q[3 + i] - target[i]) - pid.kd * p[3 + i] - pid.ki * integral[i]
            assert math.isclose(torque[i], law, rel_tol=1e-12, abs_tol=1e-12)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_evaluate_has_the_torque(formulation: str) -> None:
    """With the constraints kept, forces and multipliers leave each finger its own acceleration."""
    scene = moving()
    run = sp.simulate(scene, formulation=formulation, record=EVERYTHING, every=70)
    for k, t in enumerate(run.t[:-1]):
        terms = sp.evaluate(scene, t, run.q[k], run.p[k], formulation=formulation)
        _, _, acceleration = way(t)
        np.testing.assert_allclose(terms.accelerations[3:5], acceleration * (TO - FROM), atol=1e-9)
        balance = terms.forces.total + terms.constraint_matrix.T @ terms.multipliers
        motion = terms.mass_matrix @ terms.accelerations
        np.testing.assert_allclose(balance, motion, atol=1e-11 * np.abs(balance).max() + 1e-11)
        if not any(abs(t - edge) < 1e-12 for edge in (0.0231, 0.0333)):
            np.testing.assert_allclose(terms.forces.control[3:5], run.torque[k], atol=1e-9)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
@pytest.mark.parametrize(
    "how",
    [
        {"dt": 1e-4},
        {"dt": 2e-4, "method": "dop853"},
        {"dt": 2e-4, "method": "rosenbrock"},
        {"dt": 2e-4, "method": "radau5"},
        {"tolerance": 1e-6, "method": "dop853"},
        {"tolerance": 1e-6, "method": "rosenbrock"},
    ],
    ids=str,
)
def test_a_lane_is_a_lone_run_to_the_bit(formulation: str, how: dict[str, Any]) -> None:
    scene = replace(moving(), disturbances=(*moving().disturbances, sp.Sine(frequency_hz=70.0)))
    many = sp.monte_carlo(
        scene,
        runs=11,
        seed=3,
        vary={
            "grasped.mass": sp.Normal(0.08, 0.02),
            "schedule.move_time": sp.Uniform(0.02, 0.06),
            "disturbances.0.force": sp.Uniform((-40.0, -40.0), (40.0, 40.0)),
            "disturbances.1.time": sp.Uniform(0.02, 0.07),
        },
        summaries=("final_state", "max_residual", "energy_closure"),
        formulation=formulation,
        progress=False,
        **how,
    )
    for number in range(11):
        require_alone(many, number)


@settings(max_examples=40)
@given(
    scene=strategies.scenes(duration=0.1, fingers="driven"),
    formulation=st.sampled_from(_core.FORMULATIONS),
)
def test_ledger_and_constraints_hold_whatever_the_scene(scene: sp.Scene, formulation: str) -> None:
    how: dict[str, Any] = {"method": "dop853", "tolerance": 1e-10}
    run = sp.simulate(scene, formulation=formulation, record=EVERYTHING, **how)
    run.check()
    assert np.isfinite(run.torque).all()


REFUSED = [
    (
        {"schedule": sp.Schedule.steps([0.0, 0.05], [[0.1, 0.1], [0.2, 0.1]])},
        r"schedule steps at t = 0.05 s: .*minimum_jerk",
    ),
    (
        {"schedule": sp.Schedule.ramps([0.0, 0.05], [[0.1, 0.1], [0.2, 0.1]])},
        r"schedule kinks at t = 0.05 s: .*minimum_jerk",
    ),
    ({"initial": "touching"}, r'Scene.initial = "touching"'),
    (
        {"initial": sp.State.consistent(sp.Scene(), fingers=[0.3, 0.2])},
        r"initial.q\[3\] = 0.3: .*0.0872",
    ),
    ({"initial": replace(moving().start(), p=np.zeros(9), time=0.03)}, r"initial.q\[3\]"),
    ({"fingers": "loose"}, r'Scene.fingers = \'loose\': must be one of "pid", "driven"'),
    ({"grasped": sp.GraspedObject(width=0.01)}, "does not reach the object"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED, ids=range(len(REFUSED)))
def test_schedules_and_starts_that_fingers_cannot_follow_are_refused(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        sp.simulate(moving(**changes), formulation="nullspace")


def test_samples_that_hold_one_value_are_smooth() -> None:
    held = sp.Schedule.sampled([0.0, 0.02, 0.05], np.full((3, 2), 0.1))
    assert sp.simulate(moving(schedule=held)).success


def test_a_jump_after_the_run_is_allowed() -> None:
    schedule = sp.Schedule.steps([0.0, 0.5], [FROM, TO])
    assert sp.simulate(moving(schedule=schedule)).success


def test_the_run_whose_schedule_kinks_is_named() -> None:
    scene = moving(schedule=sp.Schedule.ramps([0.0, 0.5, 0.6], [FROM, FROM, TO]), duration=0.1)
    times = np.full((3, 3), [0.0, 0.5, 0.6])
    times[1] = [0.0, 0.05, 0.2]
    with pytest.raises(ValueError, match=r"run 1: schedule kinks at t = 0.05 s"):
        sp.monte_carlo(scene, runs=3, vary={"schedule.times": times}, progress=False)


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_the_step_that_is_stable_is_predicted(formulation: str) -> None:
    scene = moving(duration=0.4, disturbances=())
    found = sp.max_stable_dt(scene, "rk4", formulation)
    assert found.measured is not None
    # It may be shorter: what grows at some instants only decays again. And a little longer: a run
    # is unstable as soon as its ledger is open.
    assert 0.8 < found.predicted / found.measured < 1.1, found.message
    start = scene.start()
    modes = sp.modes(
        scene, [0.0], start.q[None], start.p[None], [start.integral], formulation=formulation
    )
    assert len(modes.states) == modes.rates.shape[1] == (8 if formulation == "nullspace" else 14)


def test_the_reference_refuses_driven_fingers() -> None:
    with pytest.raises(ValueError, match=r'Scene.fingers="driven": the reference'):
        sp.reference.solve(moving())


@pytest.mark.parametrize("formulation", _core.FORMULATIONS)
def test_equal_modes_are_found(formulation: str) -> None:
    """Two equal sides have pairs of equal modes, where a QR iteration may fail to converge."""
    move = sp.Schedule.minimum_jerk([0.0, 0.1], np.deg2rad([[6, 6], [8, 6]]), move_time=0.2)
    scene = sp.Scene(fingers="driven", schedule=move, duration=0.3)
    run = sp.simulate(scene, tolerance=1e-8, method="dop853")
    modes = sp.modes(scene, run.t, run.q, run.p, run.integral, formulation=formulation)
    sizes = np.abs(modes.rates).max(axis=1)
    for power in (1, 2):
        traces = np.trace(np.linalg.matrix_power(modes.jacobian, power), axis1=1, axis2=2)
        sums = (modes.rates**power).sum(axis=1)
        # Eigenvalues that meet move by the root of round-off, their sums do not.
        assert (np.abs(sums - traces) / sizes**power).max() < 1e-9


def test_a_crushed_start_is_named_as_the_start() -> None:
    flat = sp.Scene(fingers="driven", schedule=sp.Schedule.steps([0.0], [[0.8, 0.8]]))
    run = sp.simulate(flat)
    assert run.status == "crushed"
    assert run.message.endswith(": this is the state in which the run starts")
    many = sp.monte_carlo(flat, 3, vary={"grasped.mass": [0.1, 0.2, 0.3]}, progress=False)
    assert set(many.message) == {run.message}
