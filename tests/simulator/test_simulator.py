"""Stepping from outside: `Simulator` and `VectorSimulator` have the bits of `simulate`."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from alarms import alarm
from stepped_scenes import DT, PERIOD, PUSHES, SCENE, torques

METHODS = ("rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock")


def by_schedule(scene: sp.Scene, held: np.ndarray, force: np.ndarray, **how: Any) -> sp.Run:
    """One run whose schedule has the torques (k, 2), and a disturbance the forces (k, 3)."""
    times = PERIOD * np.arange(len(held))
    pushed = sp.Sampled(times=times, force=force[:, :2], moment=force[:, 2])
    scene = replace(
        scene,
        schedule=sp.Schedule.steps(times, held),
        disturbances=(*scene.disturbances, pushed),
        duration=min(scene.duration, PERIOD * len(held)),
    )
    return sp.simulate(scene, DT, record=("state", "multipliers"), **how)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("formulation", ["csm", "projected", "nullspace"])
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_periods_have_the_bits_of_one_run(method: str, formulation: str, contact: str) -> None:
    if (contact, formulation) == ("unilateral", "nullspace"):
        return
    scene = replace(SCENE, contact=contact, friction=0.6)
    how: dict[str, Any] = {"method": method, "formulation": formulation}
    sim = sp.Simulator(scene, PERIOD, DT, **how)
    held, force = torques(30), np.zeros((30, 3))
    force[10:] = (3.0, -2.0, 0.02)
    seen = []
    while sim.observation.status == "running":
        if len(seen) == 10:
            sim.set_force(force[10, :2], force[10, 2])
        seen.append(sim.step(held[len(seen)]))
    last = seen[-1]
    one = by_schedule(scene, held, force, **how)
    assert (last.status, last.t) == (one.status, one.t[-1]) == ("completed", 0.03)
    for name in ("q", "p", "multipliers"):
        assert np.array_equal(getattr(one, name)[-1], getattr(last, name)), name
    if contact == "bilateral":
        # Events of contact may change the state at the start of a period.
        rows = np.searchsorted(one.t, [each.t for each in seen])
        assert np.array_equal(one.q[rows], [each.q for each in seen])
    again = sim.run()
    assert np.array_equal(again.q, one.q)
    assert np.array_equal(again.p, one.p)
    again.check(residual=1e-3, closure=1e-2)


def test_a_run_ends_where_one_run_does() -> None:
    scene = replace(SCENE, duration=1.0, disturbances=())
    sim = sp.Simulator(scene, PERIOD, DT)
    while sim.observation.status == "running":
        sim.step((5.0, 0.0))
    last, run = sim.observation, sim.run()
    assert (run.status, run.t[-1], run.message) == (last.status, last.t, sim.message)
    assert run.status != "completed"
    with pytest.raises(ValueError, match="has ended with status"):
        sim.step((1.0, 1.0))
    assert sim.reset().status == "running"


def test_a_pid_takes_its_target_angles() -> None:
    scene = replace(SCENE, control=sp.Pid(), disturbances=())
    sim = sp.Simulator(scene, PERIOD, DT)
    targets = 0.1 + 0.01 * torques(30)
    for target in targets:
        last = sim.step(target)
    one = by_schedule(scene, targets, np.zeros((30, 3)))
    assert np.array_equal(one.q[-1], last.q)


def test_states_come_back_to_the_bit() -> None:
    sim = sp.Simulator(replace(SCENE, contact="unilateral", friction=0.5), PERIOD, DT)
    held = torques(30)
    for torque in held[:10]:
        sim.step(torque)
    middle = sim.state()
    first = [sim.step(torque) for torque in held[10:20]]
    assert sim.set_state(middle).t == middle.time
    second = [sim.step(torque) for torque in held[10:20]]
    for a, b in zip(first, second, strict=True):
        assert a.t == b.t
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(a.p, b.p)
    assert np.array_equal(sim.run().q[-1], second[-1].q)
    # Another run from the same state, on its own clock.
    sim.reset(middle)
    third = [sim.step(torque) for torque in held[10:20]]
    np.testing.assert_allclose(third[-1].q, second[-1].q, rtol=0, atol=1e-12)
    assert sim.run().t[0] == middle.time


@pytest.mark.parametrize("start", ["scene", "reset", "set_state"])
@pytest.mark.parametrize("method", ["rk4", "radau5"])
def test_a_start_between_the_breakpoints_of_a_run_begins_a_period(method: str, start: str) -> None:
    scene = replace(SCENE, schedule=sp.Schedule.steps([0.0], [[1.2, 1.2]]), disturbances=PUSHES[2:])
    state = sp.simulate(scene, DT, method).state(7)
    assert state.grid == (0.0, 7)
    if start == "scene":
        sim = sp.Simulator(replace(scene, initial=state), PERIOD, DT, method)
    else:
        sim = sp.Simulator(scene, PERIOD, DT, method)
        getattr(sim, start)(state)
    for torque in torques(5):
        last = sim.step(torque)
    run = sim.run("state")
    assert run.t[0] == state.time
    assert np.array_equal(run.q[-1], last.q)
    assert np.array_equal(run.p[-1], last.p)


def carried(tilt: float, contact: str = "bilateral") -> sp.Scene:
    """The scene in a hand with this tilt, and with an acceleration upwards."""
    motion = sp.HandMotion.constant((0.0, 1.5), tilt)
    return replace(SCENE, motion=motion, contact=contact, friction=0.6)


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize("method", METHODS)
def test_periods_with_one_acceleration_are_a_run_with_that_motion(
    method: str, contact: str
) -> None:
    """To the bit in an upright hand, in whose axes the acceleration is that along fixed ones."""
    along, how = np.array([3.0, -1.0]), {"method": method}
    for tilt in (0.0, 0.4):
        turn = np.array([[np.cos(tilt), -np.sin(tilt)], [np.sin(tilt), np.cos(tilt)]])
        scene, held = carried(tilt, contact), torques(30)
        sim = sp.Simulator(scene, PERIOD, DT, **how)  # type: ignore[arg-type]
        for torque in held:
            last = sim.step(torque, along)
        constant = replace(scene, motion=sp.HandMotion.constant(turn @ along, tilt))
        one = by_schedule(constant, held, np.zeros((30, 3)), **how)
        near = {"rtol": 0.0, "atol": 0.0 if tilt == 0.0 else 1e-10}
        assert last.status == one.status == "completed"
        for name in ("q", "p", "multipliers"):
            ours, theirs = getattr(last, name), getattr(one, name)[-1]
            np.testing.assert_allclose(ours, theirs, **near)  # type: ignore[arg-type]
        usual = by_schedule(scene, held, np.zeros((30, 3)), **how)
        assert np.abs(usual.p[-1] - last.p).max() > 1e-3


def test_a_run_has_the_accelerations_of_its_periods() -> None:
    accelerations = [None, (3.0, -1.0), (0.0, 0.0), None, (-2.0, 4.0)]
    for tilt in (0.0, 0.4):
        sim = sp.Simulator(carried(tilt), PERIOD, DT)
        seen = [sim.step((1.2, 1.2), along) for along in accelerations]
        run = sim.run()
        rows = np.searchsorted(run.t, [each.t for each in seen])
        assert np.array_equal(run.q[rows], [each.q for each in seen])
        assert np.array_equal(run.p[rows], [each.p for each in seen])
        cos, sin = np.cos(tilt), np.sin(tilt)
        assert run.hand is not None
        x, y = run.hand.acceleration[rows - 1].T
        found = np.stack([x * cos + y * sin, y * cos - x * sin], axis=-1)
        usual = (1.5 * sin, 1.5 * cos)
        expected = [usual if along is None else along for along in accelerations]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
        # Without accelerations it is the scene's motion, and a step counts no longer after a reset.
        sim.reset()
        again = [sim.step((1.2, 1.2)) for _ in range(3)]
        assert sim.run().scene.motion == sim.scene.motion
        np.testing.assert_array_equal(again[0].q, seen[0].q)


@pytest.mark.parametrize(
    "motion", [None, sp.HandMotion.minimum_jerk([0.0, 0.1], [[0.0, 0.0], [0.1, 0.0]])]
)
def test_an_acceleration_needs_a_constant_motion(motion: sp.HandMotion | None) -> None:
    for sim in (sp.Simulator, sp.VectorSimulator):
        n = (2,) if sim is sp.VectorSimulator else ()
        own: Any = sim(replace(SCENE, motion=motion), *n, PERIOD, DT)
        with pytest.raises(ValueError, match=r"acceleration: .*HandMotion\.constant\(\.\.\.\)"):
            own.step(np.full((*n, 2), 1.2), acceleration=(1.0, 0.0))


@pytest.mark.parametrize("wrong", [(1.0,), (1.0, np.nan), [[1.0, 2.0]], "up"])
def test_a_bad_acceleration_is_refused_before_the_step(wrong: Any) -> None:
    sim = sp.Simulator(carried(0.0), PERIOD, DT)
    before = sim.step((1.2, 1.2), (1.0, 2.0))
    with pytest.raises((ValueError, TypeError), match="acceleration"):
        sim.step((1.2, 1.2), wrong)
    assert sim.observation is before
    assert len(sim.run("state").t) == 6


def test_an_interrupted_step_is_no_part_of_the_run() -> None:
    scene = replace(SCENE, control=sp.Pid(), disturbances=(), duration=1e3)
    sim = sp.Simulator(scene, period=5.0, dt=1e-5)
    last = sim.step((0.1, 0.1))
    with pytest.raises(KeyboardInterrupt), alarm(KeyboardInterrupt(), 0.01):
        sim.step((0.1, 0.1))
    assert sim.observation is last
    run = sim.run("state", every=10**9)
    assert run.t[-1] == last.t == 5.0
    assert np.array_equal(run.q[-1], last.q)


@pytest.mark.parametrize("repeat", [copy.copy, copy.deepcopy, pickle.dumps])
def test_simulators_are_not_copied(repeat: Any) -> None:
    """A shallow copy would share the state in the core, but not what has been done to it."""
    for sim in (sp.Simulator(SCENE, PERIOD, DT), sp.VectorSimulator(SCENE, 2, PERIOD, DT)):
        with pytest.raises(TypeError, match=r"Simulator cannot be copied.*set_state"):
            repeat(sim)


BAD_SIMULATORS = [
    ({"period": 1e-20}, "period"),
    ({"method": "euler"}, "method"),
    ({"scene": replace(SCENE, control=sp.Pid(), fingers="driven")}, "driven"),
]


@pytest.mark.parametrize(("changed", "named"), BAD_SIMULATORS)
def test_bad_arguments_are_refused(changed: dict[str, Any], named: str) -> None:
    given: dict[str, Any] = {"scene": SCENE, "period": PERIOD, "dt": DT} | changed
    with pytest.raises(ValueError, match=named):
        sp.Simulator(**given)
    with pytest.raises(ValueError, match=named):
        sp.VectorSimulator(n=3, **given)


def test_refused_actions_forces_and_states_change_nothing() -> None:
    sim = sp.Simulator(SCENE, PERIOD, DT)
    before = sim.observation
    for bad in ((1.0,), (1.0, np.nan)):
        with pytest.raises(ValueError, match="torque"):
            sim.step(bad)
    for bad in ("ab", (None, 1.0)):
        with pytest.raises(TypeError, match="torque"):
            sim.step(bad)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="no step"):
        sim.run()
    with pytest.raises(ValueError, match="force"):
        sim.set_force((np.nan, 0.0))
    with pytest.raises(TypeError, match="state"):
        sim.reset(3)  # type: ignore[arg-type]
    start = sim.state()
    for wrong, words in (
        (replace(start, time=9.0), "between the run's start and its end"),
        (replace(start, controller=np.zeros(5)), r"state\.controller.*must be None"),
        (replace(start, q=start.q + 0.1, check=True), "inconsistent"),
    ):
        with pytest.raises(ValueError, match=words):
            sim.set_state(wrong)
    assert sim.observation is before
    fresh = sp.Simulator(SCENE, PERIOD, DT)
    assert np.array_equal(sim.step((1.2, 1.2)).q, fresh.step((1.2, 1.2)).q)


SLIPPERY = sp.Scene(
    control=sp.Torque(),
    schedule=sp.Schedule.steps([0.0], [[0.6, 0.3]]),
    duration=3e-3,
    disturbances=(sp.Pulse(time=0.0, duration=0.01, force=(6.0, -9.0)),),
    contact="unilateral",
    friction=0.02,
)


def test_the_first_multipliers_are_those_of_the_modes_that_a_run_chooses() -> None:
    first = sp.simulate(SLIPPERY, 1e-4, record="multipliers").multipliers[0]
    assert abs(first[2]) == pytest.approx(0.02 * first[0])
    for seen in (
        sp.Simulator(SLIPPERY, PERIOD, 1e-4).observation.multipliers,
        sp.VectorSimulator(SLIPPERY, 3, PERIOD, 1e-4).observations.multipliers[1],
    ):
        np.testing.assert_allclose(seen, first, rtol=1e-12)
    pick = np.hstack([np.zeros((2, 2)), np.eye(2)])
    for how in ({"dt": 1e-4}, {"tolerance": 1e-6, "method": "dop853"}):
        control = sp.SampledController(
            1e-3, D=pick, measures=("multipliers",), initial_torque=(0.6, 0.3)
        )
        run = sp.simulate(replace(SLIPPERY, control=control), record="torque", **how)
        np.testing.assert_allclose(run.torque[0], first[2:], rtol=1e-12)


def test_a_rest_of_round_off_is_no_period() -> None:
    scene = sp.Scene(control=sp.Torque(), duration=0.055)
    sim = sp.Simulator(scene, 0.011)
    periods = 0
    while sim.observation.status == "running":
        sim.step((1.2, 1.2))
        periods += 1
    assert (periods, sim.observation.t) == (5, 0.055)


def test_a_reset_to_the_end_of_a_run_begins_another_one() -> None:
    sim = sp.Simulator(SCENE, PERIOD, DT)
    sims = sp.VectorSimulator(SCENE, 2, PERIOD, DT)
    while sim.observation.status == "running":
        sim.step((1.2, 1.2))
        sims.step(np.full((2, 2), 1.2))
    end = sim.observation.t
    assert sim.reset(sim.state()).status == "running"
    assert sims.reset(sims.state(0)).status.tolist() == ["running"] * 2
    while sim.observation.status == "running":
        sim.step((1.2, 1.2))
    assert sim.observation.t == pytest.approx(2 * end)


@pytest.mark.parametrize("many", [False, True])
def test_two_threads_in_one_simulator_are_refused(many: bool) -> None:
    long = replace(SCENE, duration=2.0, disturbances=())
    sim: Any = sp.VectorSimulator(long, 64, 0.5, 5e-6) if many else sp.Simulator(long, 0.5, 2e-7)
    actions, which = (np.full((64, 2), 1.2), (0,)) if many else (np.full(2, 1.2), ())
    line = r"^this simulator is in use by another thread; make one for each thread$"
    with ThreadPoolExecutor(1) as pool:
        step = pool.submit(sim.step, actions)
        while not step.done():
            try:
                sim.state(*which)
            except RuntimeError:
                break
        for call in (sim.reset, sim.set_force, lambda: sim.step(actions)):
            with pytest.raises(RuntimeError, match=line):
                call()
        assert np.all(step.result().t == 0.5)
    assert np.all(sim.step(actions).t == 1.0)
