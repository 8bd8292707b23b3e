"""Gymnasium's environments: its checks, the same bits alone and among many, seeds, resets."""

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import matplotlib
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import softpinch as sp
from softpinch import gym
from softpinch.gym import FollowPath, HoldAgainstPushes, HoldWithLeastGrip, PinchEnv, PinchVectorEnv
from softpinch.simulator.tasks import usual_grasp

N = 5
SEEDS = [11, 3, 3, 99, 2**40]
# Pushes so strong that some grasps fail within these 30 periods.
SHORT: dict[str, Any] = {"duration": 0.06, "dt": 5e-4, "pushes": 2, "push_force": 100.0}
TASKS = [HoldAgainstPushes, FollowPath, HoldWithLeastGrip]


def short(kind: type[gym.Task] = HoldAgainstPushes, **fields: Any) -> gym.Task:
    return kind(**(SHORT | fields))


def actions(steps: int, n: int = N) -> np.ndarray:
    return np.random.default_rng(1).uniform(-1.3, 1.3, (steps, n, 2)).astype(np.float32)


@pytest.fixture(autouse=True)
def headless() -> Iterator[None]:
    before = matplotlib.get_backend()
    matplotlib.use("agg")
    yield
    matplotlib.use(before)


def test_gymnasium_finds_nothing_wrong() -> None:
    name = "softpinch.gym:softpinch/Pinch-v0"
    env = gymnasium.make(name, task=short(), render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*shows no window")
        check_env(env.unwrapped)


def test_the_registered_environments_are_ours() -> None:
    env = gymnasium.make("softpinch/Pinch-v0")
    assert isinstance(env.unwrapped, PinchEnv)
    envs = gymnasium.make_vec(
        "softpinch/Pinch-v0", num_envs=3, vectorization_mode="vector_entry_point"
    )
    assert type(envs) is PinchVectorEnv
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert PinchVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert (envs.num_envs, envs.observation_space.shape) == (3, (3, 21))
    assert envs.single_observation_space == env.observation_space
    assert envs.single_action_space == env.action_space


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("kind", TASKS)
def test_each_has_the_bits_that_it_has_alone(kind: type[gym.Task], mode: AutoresetMode) -> None:
    """Gymnasium's own loop over single environments says what is right in each mode."""
    task = short(kind)
    many = PinchVectorEnv(N, task, mode)
    alone = SyncVectorEnv([lambda: PinchEnv(task)] * N, autoreset_mode=mode)
    ended = 0
    a, b = many.reset(seed=SEEDS), alone.reset(seed=SEEDS)
    assert same(a, b)
    for action in actions(80):
        a, b = many.step(action), alone.step(action)
        assert same(a, b)
        done = a[2] | a[3]
        ended += done.sum()
        if mode is AutoresetMode.DISABLED and done.any():
            a = many.reset(options={"reset_mask": done})
            assert same(a, alone.reset(options={"reset_mask": done}))
    assert ended > N
    many.close()


def same(ours: Any, theirs: Any) -> bool:
    """Compares all results to the bit, and infos where their masks say that they hold."""
    for a, b in zip(ours[:-1], theirs[:-1], strict=True):
        assert (a.dtype, a.shape) == (b.dtype, b.shape)
        assert np.array_equal(a, b)
    return same_infos(ours[-1], theirs[-1])


def same_infos(ours: dict[str, Any], theirs: dict[str, Any]) -> bool:
    names = {name for name in ours if not name.startswith("_") and ours[f"_{name}"].any()}
    assert names == {name for name in theirs if not name.startswith("_")}
    for name in names:
        mask = ours[f"_{name}"]
        assert np.array_equal(mask, theirs[f"_{name}"]), name
        if isinstance(ours[name], dict):
            assert same_infos(ours[name], theirs[name])
        elif name == "final_obs":
            assert all(np.array_equal(ours[name][k], theirs[name][k]) for k in range(N))
        else:
            assert np.array_equal(ours[name][mask], theirs[name][mask]), name
    return True


def test_seeds_give_the_same_episodes_again() -> None:
    def played(seed: Any, threads: int = 1) -> list[Any]:
        envs = PinchVectorEnv(N, short(), threads=threads)
        seen = [envs.reset(seed=seed)[0]]
        for action in actions(60):
            seen += envs.step(action)[:4]
        return seen

    first, again, other = played(4), played([4, 5, 6, 7, 8], 3), played(5)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(first, other, strict=True))
    # Without seeds the generators go on, so the second episode has other pushes.
    env = PinchEnv(short(push_force=10.0))
    env.reset(seed=1)
    one = [env.step((0.0, 0.0))[0] for _ in range(8)]
    env.reset()
    two = [env.step((0.0, 0.0))[0] for _ in range(8)]
    assert not np.array_equal(one, two)


def test_a_failed_grasp_terminates_and_a_held_one_is_truncated() -> None:
    calm = short(pushes=0)
    env = PinchEnv(calm)
    env.reset(seed=0)
    seen = [env.step((0.0, 0.0)) for _ in range(calm.steps)]
    assert [each[2:4] for each in seen] == [(False, False)] * 29 + [(False, True)]
    assert (seen[-1][4]["status"], seen[-1][4]["time"]) == ("completed", 0.06)
    assert sum(each[1] for each in seen) == pytest.approx(1.0, abs=1e-6)
    with pytest.raises(ResetNeeded):
        env.step((0.0, 0.0))

    wild = PinchEnv(short(pushes=1, push_force=500.0, push_time=(0.05, 0.05)))
    for seed, wanted in ((0, "strayed"), (1, "unstable")):
        wild.reset(seed=seed)
        total, terminated = 0.0, False
        while not terminated:
            _, reward, terminated, truncated, info = wild.step((0.0, 0.0))
            total += reward
        assert (info["status"], truncated, info["reward_lost"]) == (wanted, False, -1.0)
        assert total < 0.0

    open_hand = PinchEnv(short(HoldWithLeastGrip, pushes=0, duration=0.5, torque_span=3.0))
    open_hand.reset(seed=0)
    terminated = False
    while not terminated:
        _, _, terminated, _, info = open_hand.step((-1.0, -1.0))
    assert info["status"] not in ("running", "completed", "strayed")


@dataclass(frozen=True, kw_only=True, repr=False)
class Lift(HoldAgainstPushes):
    """A task of a user's own, with an observation of its own."""

    height: float = 2e-3

    def draw(self, random: np.random.Generator) -> gym.Episode:
        drawn = super().draw(random)
        return drawn._replace(target=drawn.target + np.array([0.0, self.height, 0.0]))

    @property
    def measures(self) -> tuple[gym.Measure, ...]:
        return super().measures[1:2]

    def measure(self, now: gym.Transition) -> np.ndarray:
        return super().measure(now)[:, 1:2]


@dataclass(frozen=True, kw_only=True, repr=False)
class Wrong(HoldAgainstPushes):
    pays: tuple[float, ...]

    def terms(self, now: gym.Transition) -> dict[str, np.ndarray]:
        return {"hold": np.array(self.pays)}


def test_a_task_can_be_derived() -> None:
    task = Lift(**SHORT)
    envs = gymnasium.make_vec("softpinch/Pinch-v0", num_envs=2, task=task)
    seen, _ = envs.reset(seed=0)
    np.testing.assert_allclose(seen, [[-1.0], [-1.0]], atol=1e-5)
    assert "Lift(" in repr(task) and "push_force=100.0" in repr(task)
    for wrong in (np.zeros(3), np.full(2, np.nan)):
        with pytest.raises(ValueError, match=r"terms\(\)\['hold'\]"):
            envs = PinchVectorEnv(2, Wrong(**SHORT, pays=tuple(wrong)))
            envs.reset(seed=0)
            envs.step(np.zeros((2, 2)))
    with pytest.raises(NotImplementedError, match=r"Task must define terms"):
        bare = PinchEnv(gym.Task(**SHORT))
        bare.reset()
        bare.step((0.0, 0.0))


BAD_TASKS = [
    ({"period": 2.0}, "HoldAgainstPushes.period = 2.0: must be at most the duration"),
    ({"push_time": (0.1, 0.01)}, "HoldAgainstPushes.push_time = "),
    ({"grasp": replace(usual_grasp(), control=sp.Torque())}, "HoldAgainstPushes.grasp: its fing"),
    ({"grasp": replace(usual_grasp(), duration=0.01)}, "HoldAgainstPushes.grasp: must come to re"),
]


@pytest.mark.parametrize(("changed", "message"), BAD_TASKS)
def test_bad_tasks_are_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=rf"^{re.escape(message)}"):
        PinchEnv(HoldAgainstPushes(**changed))


def test_a_step_needs_a_reset_and_a_reset_takes_seeds_and_a_mask() -> None:
    with pytest.raises(ResetNeeded):
        PinchEnv(short()).step((0.0, 0.0))
    envs = PinchVectorEnv(N, short(), AutoresetMode.DISABLED)
    with pytest.raises(ValueError, match="seed has 2 entries"):
        envs.reset(seed=[1, 2])
    for mask in ([1] * N, np.ones(3, bool), np.zeros(N, bool)):
        with pytest.raises(ValueError, match="reset_mask"):
            envs.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match=r"options\.state: unknown name"):
        PinchEnv(short()).reset(options={"state": 1})
    before = envs.np_random_seed[4]
    # A reset of some leaves the others as they are, also those that have not begun.
    first = np.arange(N) < 3
    envs.reset(seed=SEEDS, options={"reset_mask": first})
    assert envs.np_random_seed[2] == 3 and envs.np_random_seed[4] == before
    with pytest.raises(ResetNeeded, match="environment 3"):
        envs.step(actions(1)[0])


def test_frames_are_pictures_and_differ() -> None:
    env = PinchEnv(short(), render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    for _ in range(10):
        env.step((1.0, -1.0))
    after = env.render()
    assert before is not None and after is not None
    assert (before.dtype, before.shape) == (np.uint8, (480, 480, 3))
    assert before.std() > 20
    assert not np.array_equal(before, after)
    envs = PinchVectorEnv(2, short(), render_mode="rgb_array")
    envs.reset(seed=0)
    frames = envs.render()
    assert frames is not None and [frame.shape for frame in frames] == [(480, 480, 3)] * 2
    assert np.array_equal(frames[0], before)
    # Nothing of earlier frames is left.
    env.reset(seed=0)
    assert np.array_equal(env.render(), before)
    with pytest.warns(UserWarning, match="render_mode"):
        assert PinchEnv(short()).render() is None


def test_without_a_display_each_step_is_drawn_and_the_missing_window_is_said() -> None:
    with pytest.warns(UserWarning, match="shows no window"):
        env = PinchEnv(short(), render_mode="human")
    env.reset(seed=1)
    env.step(np.zeros(2))
    assert env.render() is None
    env.close()
