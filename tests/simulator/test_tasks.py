"""Tasks: observations, rewards and pushes by their documented formulas, written a second time."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from gymnasium.utils import seeding

import softpinch as sp
from softpinch import gym
from softpinch.gym import FollowPath, HoldAgainstPushes, HoldWithLeastGrip, PinchEnv, PinchVectorEnv
from softpinch.simulator.tasks import Episodes

SHORT: dict[str, Any] = {"duration": 0.06, "dt": 5e-4, "push_force": 5.0}


def played(task: gym.Task, seed: int) -> tuple[sp.Run, Any, Any, Any, gym.Episode]:
    """A run with what was done in it (k, 2), observed (k + 1, 21), paid (k,), and its draw."""
    env = PinchEnv(task)
    random = np.random.default_rng(seed)
    actions = [random.uniform(-1.5, 1.5, 2)]
    seen = [env.reset(seed=seed)[0]]
    ended, paid = False, []
    while not ended:
        observed, reward, terminated, truncated, _ = env.step(actions[-1])
        seen.append(observed)
        paid.append(reward)
        ended = terminated or truncated
        actions.append(random.uniform(-1.5, 1.5, 2))
    return (
        env.run(),
        np.clip(actions[:-1], -1.0, 1.0),
        np.array(seen),
        np.array(paid),
        task.draw(seeding.np_random(seed)[0]),
    )


@pytest.mark.parametrize("kind", [HoldAgainstPushes, FollowPath, HoldWithLeastGrip])
def test_observations_and_rewards_follow_from_the_run(kind: type[gym.Task]) -> None:
    task = kind(**SHORT, pushes=2, torque_span=0.2)
    run, actions, seen, paid, drawn = played(task, 5)
    k = len(actions)
    assert (k, run.status) == (30, "completed")
    rows = np.searchsorted(run.t, 2e-3 * np.arange(k + 1) - 1e-9)
    q, p = run.q[rows], run.p[rows]
    settled = sp.simulate(task.grasp, 5e-4, record=("state", "multipliers", "torque"))
    force = settled.multipliers[-1, :2].mean()
    torque = np.vstack([settled.torque[-1], settled.torque[-1] + 0.2 * actions])
    target = drawn.target[: k + 1]
    ahead = drawn.target[np.minimum(np.arange(k + 1) + 10, 30)]
    # A row of the run has the multipliers under the torques of the period that follows.
    multipliers = seen[:, 14:18] * 0.5 * force + [force, force, 0.0, 0.0]
    start = settled.q[-1]
    expected = np.column_stack(
        [
            (q[:, :3] - target) / [2e-3, 2e-3, 0.05],
            p[:, :3] / [0.1, 0.1, 2.0],
            (q[:, 3:5] - start[3:5]) / 0.05,
            p[:, 3:5] / 2.0,
            (q[:, 5:9] - start[5:9]) / 1e-3,
            seen[:, 14:18],
            (torque - torque[0]) / 0.2,
            (ahead[:, 0] - target[:, 0]) / 2e-3,
        ]
    )
    inside = (np.abs(seen) < 10.0).all(axis=1)
    assert inside.sum() >= 25
    np.testing.assert_allclose(seen[inside], expected[inside], rtol=0, atol=1e-9)
    # The contact forces are those of the run under the period's own torques.
    sim = sp.Simulator(task.scene, 2e-3, 5e-4)
    for row in range(k):
        sim.set_force(drawn.force[row, :2], drawn.force[row, 2])
        last = sim.step(torque[row + 1])
        if inside[row + 1]:
            np.testing.assert_allclose(multipliers[row + 1], last.multipliers, atol=1e-9)
    x, y, theta = (q - np.pad(target, ((0, 0), (0, 6))))[1:, :3].T
    jump = (np.diff(torque, axis=0) ** 2).mean(axis=1) / 1e-4
    rewards = {
        HoldAgainstPushes: 1 / (1 + (x**2 + y**2) / 4e-6 + theta**2 / 1e-2)
        - 0.3 * (actions**2).mean(axis=1),
        FollowPath: 1 / (1 + x**2 / 4e-8) - 0.2 * jump / (1 + jump),
        HoldWithLeastGrip: 1 / (1 + multipliers[1:, :2].mean(axis=1) / force),
    }
    wanted = rewards[kind] / 30
    paying = inside[1:]
    np.testing.assert_allclose(paid[paying], wanted[paying], rtol=0, atol=1e-12)


def test_pushes_are_as_documented() -> None:
    task = HoldAgainstPushes(pushes=1, push_force=7.0, push_moment=0.3, push_time=(0.01, 0.05))
    random = np.random.default_rng(0)
    forces, moments, firsts, lengths = [], [], [], []
    for _ in range(300):
        push = task.draw_pushes(random)
        assert push.shape == (500, 3)
        on = np.flatnonzero(push.any(axis=1))
        assert np.array_equal(on, np.arange(on[0], on[-1] + 1))
        assert (push[on] == push[on[0]]).all()
        forces.append(push[on[0], :2])
        moments.append(push[on[0], 2])
        firsts.append(2e-3 * on[0])
        lengths.append(2e-3 * len(on))
    size = np.hypot(*np.array(forces).T)
    for values, least, most in (
        (size, 0.0, 7.0),
        (np.array(moments), -0.3, 0.3),
        (np.array(firsts), 0.0, 0.99),
        (np.array(lengths), 0.01, 0.05),
    ):
        assert least - 1e-9 <= values.min() < least + 0.05 * (most - least)
        assert most + 1e-9 >= values.max() > most - 0.06 * (most - least)
        assert abs(values.mean() - 0.5 * (least + most)) < 0.06 * (most - least)
    assert np.abs(np.mean(forces, axis=0)).max() < 0.5


def test_a_path_leads_from_rest_to_rest() -> None:
    task = FollowPath(reach=5e-3)
    target = task.draw(np.random.default_rng(0)).target
    assert target.shape == (501, 3)
    assert np.array_equal(target[0], task.start[:3])
    assert (target[:, 1:] == task.start[1:3]).all()
    x = target[:, 0] - target[0, 0]
    assert 1e-3 < np.abs(x).max() <= 5e-3
    rate = np.abs(np.diff(x))
    for end in (0, 166, 333, 499):
        assert rate[end] < 0.02 * rate.max()


def test_an_object_beyond_the_leash_has_strayed() -> None:
    task = HoldAgainstPushes(duration=0.5, push_force=200.0, pushes=1, push_time=(0.1, 0.1))
    env = PinchEnv(task)
    env.reset(seed=0)
    away, terminated = [0.0], False
    while not terminated:
        observed, _, terminated, truncated, info = env.step((0.0, 0.0))
        away.append(float(np.hypot(*(env.run().q[-1, :2] - task.start[:2]))))
        assert not truncated
    assert info["status"] == "strayed"
    assert max(away[:-1]) <= task.leash < away[-1]
    assert np.abs(observed).max() == 10.0  # clipped
    # At the very end of an episode a failure counts, not the end.
    env = PinchEnv(HoldAgainstPushes(duration=2e-3, leash=1e-9, pushes=1, push_time=(2e-3, 2e-3)))
    env.reset(seed=0)
    assert env.step((0.5, 0.0))[2:4] == (True, False)


@dataclass(frozen=True, kw_only=True, repr=False)
class Steady(HoldAgainstPushes):
    """The same force all the time, in each episode."""

    def draw_pushes(self, random: np.random.Generator) -> np.ndarray:
        return np.tile([1.0, 0.0, 0.0], (self.steps, 1))


def test_a_reset_takes_forces_away_and_brings_them_back() -> None:
    envs = PinchVectorEnv(2, Steady(**SHORT), "Disabled")
    envs.reset(seed=0)
    first = [envs.step(np.zeros((2, 2)))[0] for _ in range(5)]
    only_one = np.array([False, True])
    envs.reset(options={"reset_mask": only_one})
    again = [envs.step(np.zeros((2, 2)))[0] for _ in range(5)]
    assert first[-1][1, 0] != first[0][1, 0]
    assert np.array_equal(np.array(first)[:, 1], np.array(again)[:, 1])


def test_periods_that_fall_short_of_the_duration_by_round_off_are_all() -> None:
    """5 * 0.011 is less than 0.055 in floating-point numbers."""
    task = gym.HoldAgainstPushes(duration=0.055, period=0.011, dt=5e-4, pushes=0)
    assert task.steps == 5
    assert task.steps * task.period < task.duration
    episodes = Episodes(task, 2)
    episodes.start(np.ones(episodes.n, bool), [np.random.default_rng(0)] * episodes.n)
    for step in range(5):
        outcome = episodes.step(np.zeros((episodes.n, 2)))
        assert (outcome.truncated == (step == 4)).all()


class InPlace(FollowPath):
    """Writes its torques to the same array at every step."""

    def torques(self, action: np.ndarray) -> np.ndarray:
        room: np.ndarray = self.__dict__.setdefault("room", np.empty_like(action))
        room[...] = super().torques(action)
        return room


def test_a_task_may_keep_the_array_of_its_torques() -> None:
    infos = []
    for kind in (FollowPath, InPlace):
        episodes = Episodes(kind(**SHORT), 1)
        episodes.start(np.ones(1, bool), [np.random.default_rng(0)])
        infos.append([episodes.step([[a, -a]]).info["reward_smooth"] for a in (0.01, 0.0, 0.02)])
    assert infos[1] == infos[0]
    assert all(infos[0])
