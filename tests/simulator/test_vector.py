"""`VectorSimulator`: each of many runs goes as a `Simulator` steps it, and touches no other."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from stepped_scenes import DT, PERIOD, SCENE, torques


@pytest.mark.parametrize("method", ["rk4", "radau5", "rosenbrock"])
@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize(("n", "threads"), [(9, 1), (37, 3)])
def test_many_are_as_each_alone(method: str, contact: str, n: int, threads: int) -> None:
    scene = replace(SCENE, contact=contact, friction=0.5)
    how: dict[str, Any] = {"method": method}
    vary = {"grasped.mass": sp.Uniform(0.05, 0.15)}
    sims = sp.VectorSimulator(scene, n, PERIOD, DT, vary=vary, seed=3, threads=threads, **how)
    alone = [sp.Simulator(sims.scene(run), PERIOD, DT, **how) for run in range(n)]
    assert alone[0].scene.grasped.mass != alone[1].scene.grasped.mass
    rng = np.random.default_rng(5)
    for period in range(20):
        if period == 8:
            sims.set_force((2.0, 1.0), mask=np.arange(n) % 2 == 0)
            for sim in alone[::2]:
                sim.set_force((2.0, 1.0))
        if period == 12:
            mask = np.arange(n) % 5 == 1
            sims.reset(mask=mask)
            for sim in alone[1::5]:
                sim.reset()
        actions = 1.2 + 0.1 * rng.standard_normal((n, 2))
        t, q, p, multipliers, status = sims.step(actions)
        for run, sim in enumerate(alone):
            seen = sim.step(actions[run])
            assert (seen.t, seen.status) == (t[run], status[run])
            assert np.array_equal(seen.q, q[run])
            assert np.array_equal(seen.p, p[run])
            assert np.array_equal(seen.multipliers, multipliers[run])


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@pytest.mark.parametrize("vary", [{}, {"motion.tilt": sp.Uniform(-0.4, 0.4)}])
def test_each_hand_has_its_own_acceleration(contact: str, vary: dict[str, Any]) -> None:
    motion = sp.HandMotion.constant((0.5, 1.5), 0.3)
    scene = replace(SCENE, motion=motion, contact=contact, friction=0.6)
    sims = sp.VectorSimulator(scene, 9, PERIOD, DT, vary=vary, seed=3)
    alone = [sp.Simulator(sims.scene(run), PERIOD, DT) for run in range(9)]
    each = 3.0 * np.random.default_rng(5).standard_normal((9, 2))
    for given in (each, None, (2.0, 1.0), np.asfortranarray(each)):
        q = sims.step(np.full((9, 2), 1.2), acceleration=given).q
        for run, sim in enumerate(alone):
            own: Any = given[run] if isinstance(given, np.ndarray) else given
            assert np.array_equal(sim.step((1.2, 1.2), own).q, q[run])
    before = q.copy()
    for wrong in (each[:2], np.full((9, 2), np.inf), each[0, 0]):
        with pytest.raises(ValueError, match="acceleration"):
            sims.step(np.full((9, 2), 1.2), acceleration=wrong)
    assert np.array_equal(sims.observations.q, before)


def test_runs_that_have_ended_stay_as_they_are() -> None:
    sims = sp.VectorSimulator(replace(SCENE, duration=0.01), 4, PERIOD, DT)
    wild = np.array([[1.2, 1.2], [400.0, 0.0], [1.2, 1.2], [1.2, 1.2]])
    while (sims.step(wild).status == "running").any():
        ended = sims.observations.status[1] != "running"
        before = sims.observations.q[1].copy()
        sims.step(wild)
        assert not ended or np.array_equal(sims.observations.q[1], before)
    assert sims.observations.status.tolist() == [
        "completed",
        *sims.observations.status[1:].tolist(),
    ]
    assert sims.observations.status[1] not in ("running", "completed")
    assert sims.message(1)
    mask = np.array([False, True, False, False])
    assert sims.reset(mask=mask).status.tolist() == ["completed", "running", *["completed"] * 2]


def test_each_of_many_goes_on_from_its_own_state() -> None:
    sims = sp.VectorSimulator(SCENE, 9, PERIOD, DT, seed=1)
    actions = torques(9)
    sims.step(actions)
    middle = [sims.state(run) for run in range(9)]
    expected = sims.step(actions).q.copy()
    sims.set_state(middle)
    assert np.array_equal(sims.step(actions).q, expected)
    # From one state all runs go the same way under the same torques, but for their noise.
    quiet = sp.VectorSimulator(replace(SCENE, disturbances=()), 9, PERIOD, DT)
    quiet.set_state(middle[0])
    q = quiet.step(np.full((9, 2), 1.2)).q
    assert (q == q[0]).all()


def test_each_of_many_takes_its_own_force_and_start() -> None:
    sims = sp.VectorSimulator(SCENE, 4, PERIOD, DT)
    force, moment = torques(4), [0.0, 0.01, 0.0, 0.02]
    sims.set_force(force, moment)
    alone = [sp.Simulator(sims.scene(run), PERIOD, DT) for run in range(4)]
    actions = torques(4)
    seen = sims.step(actions)
    for run, sim in enumerate(alone):
        sim.set_force(force[run], moment[run])
        assert np.array_equal(sim.step(actions[run]).q, seen.q[run])
    # From its own state again, without its force, and only where the mask says so.
    states = [sims.state(run) for run in range(4)]
    sims.step(actions)
    sims.reset(states, mask=np.array([True, False, True, True]))
    seen = sims.step(actions)
    for run in (0, 2, 3):
        alone[run].reset(states[run])
        assert np.array_equal(alone[run].step(actions[run]).q, seen.q[run])
    assert seen.t[1] > seen.t[0]


def test_actions_may_be_any_numbers() -> None:
    actions = np.array([[1.25, 1.0], [1.0, 1.5], [1.5, 1.25]])
    expected = sp.VectorSimulator(SCENE, 3, PERIOD, DT).step(actions).q
    columns, twice = np.asfortranarray(actions), np.repeat(actions, 2, axis=0)
    for given_as in (actions.tolist(), actions.astype(np.float32), columns, twice[::2]):
        sims = sp.VectorSimulator(SCENE, 3, PERIOD, DT)
        assert np.array_equal(sims.step(given_as).q, expected)


def test_out_takes_the_results() -> None:
    sims = sp.VectorSimulator(SCENE, 3, PERIOD, DT)
    own = sims.observations
    out = sp.Observations(*(np.empty_like(each) for each in own))
    before = own.q.copy()
    assert sims.step(torques(3), out=out) is out
    assert np.array_equal(own.q, before)
    assert np.array_equal(out.q, sims.observations.q)


def test_arrays_that_cannot_take_results_are_refused_before_the_step() -> None:
    sims = sp.VectorSimulator(SCENE, 3, PERIOD, DT)
    good = sp.Observations(*(np.empty_like(each) for each in sims.observations))
    with pytest.raises(ValueError, match=r"out\.q: must be a contiguous array"):
        sims.step(torques(3), out=good._replace(q=good.q[:, ::-1]))
    held = np.full(27, 1.2)
    with pytest.raises(TypeError, match="already borrowed"):
        sims.step(held[:6].reshape(3, 2), out=good._replace(q=held.reshape(3, 9)))
    assert (sims.observations.t == 0.0).all()


def test_bad_arguments_name_their_run() -> None:
    sims = sp.VectorSimulator(SCENE, 5, PERIOD, DT)
    actions = torques(5)
    actions[3, 1] = np.nan
    with pytest.raises(ValueError, match=r"actions\[3, 1\] = nan: must be finite \(run 3\)"):
        sims.step(actions)
    with pytest.raises(ValueError, match=r"actions have shape \(4, 2\)"):
        sims.step(torques(4))
    with pytest.raises(ValueError, match="mask"):
        sims.reset(mask=[0, 1])
    state = sims.state(0)
    with pytest.raises(ValueError, match=r"run 2: State\.time = 9\.0"):
        sims.set_state([state, state, replace(state, time=9.0), state, state])
    with pytest.raises(IndexError, match="run = 5"):
        sims.state(5)
    with pytest.raises(ValueError, match="n = 0"):
        sp.VectorSimulator(SCENE, 0)
    assert (sims.observations.t == 0.0).all()
