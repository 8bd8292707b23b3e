"""Discrete controllers in the core: beside SciPy, and beside the same torques as inputs."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from ensembles import require_alone
from sampled_blocks import PUSH, TURN, under_held_torques

DELAYED = sp.SampledController.pid(
    1e-3, 4.0, 0.05, 0.0, delay=1.4e-3, initial_torque=(0.42, 0.4), limits=(-3.0, 3.0)
)
SCENE = sp.Scene(control=DELAYED, schedule=TURN, disturbances=[PUSH], duration=0.04)
METHODS = ("rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock")


def breaks(control: sp.SampledController, end: float) -> tuple[np.ndarray, np.ndarray]:
    """The instants of samples, and those from which they act, as far as they are before `end`."""
    taken = np.arange(int(end / control.period) + 2) * control.period
    acting = taken + control.delay
    return taken[taken < end], acting[acting < end]


def gains(control: sp.SampledController) -> tuple[float, float]:
    assert control.D is not None
    return -control.D[0, 0], -control.D[0, 2]


def by_scipy(scene: sp.Scene) -> tuple[np.ndarray, np.ndarray]:
    """The last q and p, by SciPy between the instants at which the torques change."""
    control = scene.control
    assert isinstance(control, sp.SampledController)
    kp, kd = gains(control)
    taken, acting = breaks(control, scene.duration)
    instants = np.unique([*taken, *acting, scene.duration])
    torque, commands = np.array(control.initial_torque), []
    state = scene.start()
    for begin, end in pairwise(instants):
        if begin in taken:
            error = state.q[3:5] - scene.schedule.target(begin)
            commands.append(np.clip(-kp * error - kd * state.p[3:5], -3.0, 3.0))
        if begin in acting:
            torque = commands.pop(0)
        state = under_held_torques(scene, state, begin, end, torque)
    return state.q, state.p


def test_a_delayed_controller_is_that_of_scipy_with_order_four() -> None:
    q, p = by_scipy(SCENE)
    errors = []
    for dt in (2e-4, 1e-4, 5e-5):
        run = sp.simulate(SCENE, dt, formulation="projected")
        errors.append(max(np.abs(run.q[-1] - q).max() / 0.1, np.abs(run.p[-1] - p).max()))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert (orders > 3.5).all(), (errors, orders)
    exact = sp.simulate(SCENE, method="dop853", formulation="projected", tolerance=1e-12)
    for found, expected in ((exact.q[-1], q), (exact.p[-1], p)):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_the_limit_of_short_periods_is_the_pid() -> None:
    scene = replace(SCENE, duration=0.03)
    pid = sp.simulate(replace(scene, control=sp.Pid()), 1e-5)
    errors = []
    for period in (1e-4, 5e-5, 2.5e-5):
        sampled = replace(scene, control=sp.SampledController.pid(period))
        errors.append(np.abs(sp.simulate(sampled, 1e-5).q[-1] - pid.q[-1]).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert ((orders > 0.8) & (orders < 1.2)).all(), orders


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("formulation", ["csm", "projected", "nullspace"])
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize("adaptive", [False, True])
def test_the_same_torques_as_inputs_give_the_same_bits(
    method: str, formulation: str, contact: str, adaptive: bool
) -> None:
    """Also through events of contact, and with a delay that is no multiple of the period."""
    if (contact, formulation) == ("unilateral", "nullspace"):
        return
    if adaptive and method not in sp._core.ADAPTIVE_METHODS:
        return
    how: dict[str, Any] = {"tolerance": 1e-5} if adaptive else {"dt": 1e-4}
    how |= {"method": method, "formulation": formulation}
    scene = replace(SCENE, contact=contact, friction=0.3)
    run = sp.simulate(scene, record=("state", "torque", "energy"), **how)
    if method == "implicit_midpoint" and run.status == "newton_failed":
        return
    assert run.success, run
    changes = np.unique(np.concatenate(breaks(DELAYED, scene.duration)))
    # The row at a change has the torque after it.
    rows = np.searchsorted(run.t, changes)
    assert np.array_equal(run.t[rows], changes)
    held = sp.Schedule.steps(changes, run.torque[rows])
    again = sp.simulate(replace(scene, control=sp.Torque(), schedule=held), **how)
    assert np.array_equal(again.t, run.t)
    assert np.array_equal(again.q, run.q)
    assert np.array_equal(again.p, run.p)
    assert len(again.contact_changes) == len(run.contact_changes)
    assert contact == "bilateral" or run.contact_changes
    # The ledger has the work of the torques.
    assert run.energy.closure.max() < (1e-2 if adaptive else 1e-3) * run.energy.exchanged


@pytest.mark.parametrize("periods", [1, 2, 3, 5])
def test_a_delay_of_whole_periods_makes_no_instants_of_its_own(periods: int) -> None:
    """k T + delay and (k + m) T differ by round-off; a sample there comes before the action."""
    control = replace(DELAYED, delay=periods * 1e-3)
    run = sp.simulate(replace(SCENE, control=control, duration=0.1))
    assert np.diff(run.t).min() > 0.9e-4
    # The multipliers of sample k are those under the output of sample k - m - 1.
    pick = np.hstack([-0.01 * np.eye(2), np.zeros((2, 2))])
    force = sp.SampledController(
        1e-3, D=pick, measures=("multipliers",), delay=periods * 1e-3, initial_torque=(0.42, 0.4)
    )
    scene = replace(SCENE, control=force, duration=0.03, disturbances=())
    run = sp.simulate(scene, record=("state", "torque"))
    sim = sp.Simulator(replace(scene, control=sp.Torque()), 1e-3)
    outputs = []
    held = (0.42, 0.4)
    while sim.observation.status == "running" and len(outputs) < 29:
        first = not outputs and sim.observation.t == 0.0
        seen = sim.observation.multipliers[:2]
        if first:
            start = replace(scene, control=sp.Torque(), schedule=sp.Schedule.steps([0], [held]))
            seen = sp.Simulator(start, 1e-3).observation.multipliers[:2]
        outputs.append(-0.01 * seen)
        k = len(outputs) - 1 - periods
        held = tuple(outputs[k]) if k >= 0 else (0.42, 0.4)
        row = np.searchsorted(run.t, sim.observation.t)
        np.testing.assert_allclose(run.torque[row], held, rtol=1e-9)
        sim.step(held)


@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize("delay", [0.0, 1e-3, 3.3e-3])
def test_a_run_goes_on_from_any_row(formulation: str, delay: float) -> None:
    scene = replace(
        SCENE, control=replace(DELAYED, delay=delay), contact="unilateral", friction=0.3
    )
    run = sp.simulate(scene, formulation=formulation)
    for row in range(0, len(run) - 1, 7):
        state = run.state(row)
        rest = replace(scene, initial=state, duration=scene.duration - state.time)
        again = sp.simulate(rest, formulation=formulation)
        assert np.array_equal(again.q[-1], run.q[-1]), row
        assert np.array_equal(again.p[-1], run.p[-1]), row
        assert again.state() == run.state(), row


VARY = {
    "control.delay": sp.Uniform(0.0, 3e-3),
    "control.period": sp.Uniform(0.5e-3, 2e-3),
    "control.D.0.0": sp.Uniform(-5.0, -3.0),
    "grasped.mass": sp.Uniform(0.08, 0.12),
}


@pytest.mark.parametrize("method", ["rk4", "radau5", "rosenbrock"])
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize("adaptive", [False, True])
def test_runs_in_lanes_have_the_bits_that_they_have_alone(
    method: str, contact: str, adaptive: bool
) -> None:
    """The lanes sample at different instants, with noise of their own."""
    noisy = replace(DELAYED, measure_noise={"angle_error": 1e-3, "angle_rate": 0.1})
    scene = replace(SCENE, control=noisy, contact=contact, friction=0.3, duration=0.025)
    method = "dop853" if adaptive and method == "rk4" else method
    how: dict[str, Any] = {"tolerance": 1e-4} if adaptive else {"dt": 1e-4}
    found = sp.monte_carlo(
        scene, 21, seed=5, vary=VARY, method=method, progress=False, threads=2, **how
    )
    for run in range(21):
        control = require_alone(found, run).scene.control
        assert isinstance(control, sp.SampledController)
        assert (control.seed, control.run) == (5, run)


def static(gain: float, measure: str, **settings: Any) -> sp.SampledController:
    """The torque of the right finger is a gain times the first entry of a measure."""
    m = sp._core.MEASURES[measure]
    pick = np.zeros((2, m))
    pick[0, 0] = gain
    return sp.SampledController(1e-3, D=pick, measures=(measure,), **settings)


def at_samples(control: sp.SampledController) -> tuple[np.ndarray, SimpleNamespace]:
    """The right finger's torque after each sample, and t, q and p there."""
    run = sp.simulate(replace(SCENE, control=control), record=("state", "torque"))
    rows = np.searchsorted(run.t, breaks(control, run.t[-1])[0])
    return run.torque[rows, 0], SimpleNamespace(t=run.t[rows], q=run.q[rows], p=run.p[rows])


@pytest.mark.parametrize(
    ("measure", "of"),
    [
        ("angle", lambda at: at.q[:, 3]),
        ("angle_rate", lambda at: at.p[:, 3]),
        ("angle_error", lambda at: at.q[:, 3] - TURN.target(at.t)[:, 0]),
        ("target", lambda at: TURN.target(at.t)[:, 0]),
        ("target_rate", lambda at: 0.0 * at.t),
        ("position", lambda at: at.q[:, 0]),
        ("rotation", lambda at: at.q[:, 2]),
        ("velocity", lambda at: at.p[:, 0]),
        ("rotation_rate", lambda at: at.p[:, 2]),
        ("compression", lambda at: at.q[:, 5]),
        ("shear", lambda at: at.q[:, 7]),
    ],
)
def test_each_measure_is_what_it_says(measure: str, of: Any) -> None:
    torque, at = at_samples(static(0.1, measure))
    np.testing.assert_allclose(torque, 0.1 * of(at), rtol=1e-14, atol=1e-18)


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_an_inertial_sensor_reads_the_motion_of_the_frame_and_gravity(contact: str) -> None:
    """By derivatives of the frame's place and tilt, which the motion itself gives."""
    points, tilts = [[0.0, 0.0], [2e-3, 1e-3]], [0.3, 0.4]
    jumps = [0.0, 0.01, 0.02], None, [[1.0, 0.0], [0.0, 2.0], [-1.0, 0.0]]  # at samples
    for motion in (
        None,
        sp.HandMotion.minimum_jerk([0.0, 0.04], points, tilts),
        sp.HandMotion.sine(0.01, 20.0, "tilt", tilt=0.2),
        sp.HandMotion.sampled(*jumps, tilts=-0.3, hold=True),
    ):
        scene = replace(SCENE, motion=motion, gravity=9.5, contact=contact, friction=0.6)
        readings = []
        for measure, entry in (("accelerometer", 0), ("accelerometer", 1), ("gyroscope", 0)):
            pick = np.zeros((2, sp._core.MEASURES[measure]))
            pick[0, entry] = 1e-9
            control = sp.SampledController(1e-3, D=pick, measures=(measure,))
            run = sp.simulate(replace(scene, control=control), record=("state", "torque"))
            rows = np.searchsorted(run.t, breaks(control, run.t[-1])[0])
            readings.append(1e9 * run.torque[rows, 0])
        t = run.t[rows]
        still = sp.HandMotion.constant()
        at = (motion or still).at(t)
        cos, sin = np.cos(at.tilt), np.sin(at.tilt)
        felt = at.acceleration + np.array([0.0, 9.5])
        along = felt[:, 0] * cos + felt[:, 1] * sin, felt[:, 1] * cos - felt[:, 0] * sin
        np.testing.assert_allclose(readings, [*along, at.tilt_rate], rtol=1e-12, atol=1e-12)
        assert len(t) > 24


def test_multipliers_are_those_before_the_sample() -> None:
    torque, at = at_samples(static(0.05, "multipliers"))
    # Stepping from outside sees them at the ends of periods, under the torques of the period.
    scene = replace(SCENE, control=sp.Torque(), schedule=sp.Schedule.steps([0.0], [[0.0, 0.0]]))
    sim = sp.Simulator(scene, 1e-3)
    assert torque[0] == pytest.approx(0.05 * sim.observation.multipliers[0])
    for k in range(len(torque) - 1):
        seen = sim.step((torque[k], 0.0))
        assert np.array_equal(seen.q, at.q[k + 1])
        assert torque[k + 1] == pytest.approx(0.05 * seen.multipliers[0], rel=1e-14)


def test_resolution_rounds_what_a_sensor_measures() -> None:
    step = 2.0 * np.pi / 4096
    torque, at = at_samples(static(-4.0, "angle_error", resolution=step))
    counts = (torque / -4.0 + TURN.target(at.t)[:, 0]) / step
    np.testing.assert_allclose(counts, np.round(at.q[:, 3] / step), atol=1e-9)
    assert len(set(np.round(counts))) > 3


def test_noise_has_its_deviation_and_depends_on_seed_and_run() -> None:
    def noise(**settings: Any) -> np.ndarray:
        control = replace(static(1e-6, "rotation", measure_noise=0.2), period=1e-4, **settings)
        torque, at = at_samples(control)
        return torque / 1e-6 - at.q[:, 2]

    first = noise()
    assert 0.17 < first.std() < 0.23
    assert abs(first.mean()) < 0.04
    assert np.array_equal(first, noise())
    for other in (noise(seed=1), noise(run=1)):
        assert abs(np.corrcoef(first, other)[0, 1]) < 0.2


def test_anti_windup_holds_the_integral() -> None:
    """A PI controller against a target out of reach: its integral stays where the limit begins."""
    far = sp.Schedule.steps([0.0], [[0.5, 0.5]])
    limits = [[-1.0, 0.5], [-1.0, 0.6]]
    free = sp.SampledController.pid(1e-3, 1.0, 0.05, 50.0, limits=limits)
    kept = replace(free, anti_windup=True)
    ends = {}
    for name, control in (("free", free), ("kept", kept)):
        run = sp.simulate(replace(SCENE, control=control, schedule=far), record=("state", "torque"))
        assert run.torque[:, 0].max() == 0.5
        assert run.torque[:, 1].max() == 0.6
        row = run.state().controller
        assert row is not None
        ends[name] = row[5:7]
    assert (ends["free"] < -0.01).all()
    assert (np.abs(ends["kept"]) < 0.5 * np.abs(ends["free"])).all()


def test_the_initial_state_acts_at_the_first_sample() -> None:
    begun = replace(sp.SampledController.pid(1e-3, 1.0, 0.05, 50.0), initial_state=(-0.01, -0.004))
    run = sp.simulate(replace(SCENE, control=begun), record=("state", "torque"))
    error = run.q[0, 3:5] - TURN.target(0.0)
    np.testing.assert_allclose(run.torque[0], -error + [0.5, 0.2], rtol=1e-14)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_random_controllers_end_with_a_status_within_their_limits(data: st.DataObject) -> None:
    """Stable or not, with states that overflow: a run ends, in lanes with the same bits."""
    n = data.draw(st.integers(0, 3))
    names = data.draw(
        st.lists(st.sampled_from(sorted(sp._core.MEASURES)), min_size=1, max_size=4, unique=True)
    )
    m = sum(sp._core.MEASURES[name] for name in names)
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    size = 10.0 ** data.draw(st.floats(-3.0, 3.0))
    limited = data.draw(st.booleans())
    control = sp.SampledController(
        10.0 ** data.draw(st.floats(-4.0, -1.5)),
        size * rng.standard_normal((n, n)),
        size * rng.standard_normal((n, m)),
        size * rng.standard_normal((2, n)),
        size * rng.standard_normal((2, m)),
        measures=tuple(names),
        delay=data.draw(st.sampled_from([0.0, 1e-3, 2.7e-3, 0.1])),
        limits=[[-1.0, 2.0], [-0.5, 1.5]] if limited else None,
        anti_windup=data.draw(st.booleans()),
        measure_noise=data.draw(st.sampled_from([0.0, 1e-3])),
        resolution=data.draw(st.sampled_from([0.0, 1e-3])),
    )
    contact = data.draw(st.sampled_from(["bilateral", "unilateral"]))
    scene = replace(SCENE, control=control, contact=contact, friction=0.5, duration=0.02)
    run = sp.simulate(scene, 2e-4, record=("state", "torque"))
    assert run.status in sp._core.STATUSES
    assert np.isfinite(run.q).all()
    assert np.isfinite(run.torque).all()
    if limited:
        right, left = run.torque.T
        assert -1.0 <= right.min() <= right.max() <= 2.0
        assert -0.5 <= left.min() <= left.max() <= 1.5
    with pytest.MonkeyPatch.context() as patch:
        # Whether to warn of the loop, which takes an equilibrium, is another test's.
        patch.setattr("softpinch.study.compute._growth", lambda _: 0.0)
        many = sp.monte_carlo(scene, 3, dt=2e-4, seed=control.seed, progress=False, threads=1)
    assert many.status[0] == run.status
