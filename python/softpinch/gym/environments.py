"""`PinchEnv` and `PinchVectorEnv`: one pinch and many as environments of Gymnasium."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ..plot.drawing import Frames
from ..run.run import Run
from ..simulator.tasks import LIMIT, Episodes, HoldAgainstPushes, Outcome, Task, of_one
from ..support import Recordable, checks

Observed: TypeAlias = NDArray[np.float64]
Actions: TypeAlias = NDArray[np.float32]
Flags: TypeAlias = NDArray[np.bool_]
Stepped: TypeAlias = tuple[Observed, NDArray[np.float64], Flags, Flags, dict[str, Any]]

# A film of one frame a step of 2 ms is ten times slower than the motion.
_FPS = 50
_NOTHING = 'render: there is nothing to draw without a "render_mode"'


def _prepared(task: Task | None) -> tuple[Task, Box, Box]:
    """The task, by default the usual one, and the spaces of observations and actions."""
    task = HoldAgainstPushes() if task is None else task
    checks.instance("task", task, Task, "a Task, such as HoldAgainstPushes()")
    observed = Box(-LIMIT, LIMIT, (len(task.measures),), np.float64)
    return task, observed, Box(-1.0, 1.0, (2,), np.float32)


def _draw(frames: Frames, episodes: Episodes, k: int) -> None:
    seen = episodes.simulator.observations
    frames.draw(seen.q[k], episodes.target(k), episodes.force(k), f"t = {seen.t[k]:.3f} s")


class PinchEnv(gymnasium.Env[Observed, Actions]):
    """One pinch whose finger torques an agent sets, period by period.

    The action is (right, left) in [-1, 1]; larger ones are clipped. Action 0 is the torque of the
    settled grasp, see `Task.torques`. The observation is a float64 vector whose entries
    `task.measures` names, with units and scales; each is clipped to [-10, 10] after scaling. The
    info has "time" (s), "status", "torque" (2,) N m, and after a step each term of the reward as
    "reward_<name>".

    Render modes: "rgb_array" returns a frame from `render()`, "human" shows each step in a window
    of Matplotlib. Both need the extra `plot`.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": _FPS}  # noqa: RUF012

    def __init__(self, task: Task | None = None, render_mode: str | None = None) -> None:
        """Makes an environment; the task None is `HoldAgainstPushes()`."""
        if render_mode is not None:
            checks.choice("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.task, observed, acted = _prepared(task)
        self.observation_space, self.action_space = observed, acted  # type: ignore[assignment]
        self._episodes = Episodes(self.task, 1)
        self._frames: Frames | None = None
        if render_mode is not None:
            self._frames = Frames(self.task.scene, window=render_mode == "human")
            if render_mode == "human" and not self._frames.has_window:
                text = 'render_mode = "human": this backend of Matplotlib shows no window'
                gymnasium.logger.warn(text)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Starts an episode in the settled grasp, and returns observation (entries,) and info.

        The seed None goes on with the environment's generator as it is. There are no options.
        """
        super().reset(seed=seed)
        checks.refuse_unknown("options", {} if options is None else options, (), "")
        outcome = self._episodes.start(np.ones(1, bool), [self.np_random])
        self._show()
        return outcome.observation[0], of_one(outcome.info)

    def step(self, action: ArrayLike) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Holds the torques of an action (2,) for one period.

        Returns:
            Observation (entries,), reward, whether the grasp has failed (terminated), whether the
            episode has reached its end (truncated), and info.

        Raises:
            ResetNeeded: There has been no reset, or the episode has ended.
        """
        if self._episodes.ended[0]:
            raise ResetNeeded("the episode has ended, or has not begun: call reset()")
        outcome = self._episodes.step([checks.pair("action", action)])
        self._show()
        observation, reward, lost, over = (each[0] for each in outcome[:4])
        return observation, float(reward), bool(lost), bool(over), of_one(outcome.info)

    def run(
        self, record: Recordable | Sequence[Recordable] = ("state", "multipliers", "torque")
    ) -> Run:
        """Computes the episode so far again as a `Run`; `record` is that of `sp.simulate`."""
        return self._episodes.run(0, record)

    def render(self) -> NDArray[np.uint8] | None:
        """Returns a frame (height, width, 3) with "rgb_array"; with "human" it only draws."""
        if self._frames is None:
            gymnasium.logger.warn(_NOTHING)
            return None
        _draw(self._frames, self._episodes, 0)
        return self._frames.pixels() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._frames is not None:
            self._frames.close()

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()


class PinchVectorEnv(VectorEnv[Observed, Actions, NDArray[Any]]):
    """Many pinches in the lanes of one simulator, each with the bits of a `PinchEnv` of its seed.

    Observations and rewards are those of `PinchEnv`, with the environments as the first axis. The
    info has arrays of n entries and masks of them, as Gymnasium's vector environments have. Each
    environment keeps 64 bytes for each period of its episode.
    """

    metadata = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": _FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        task: Task | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        threads: int = 1,
    ) -> None:
        """Makes the environments; the task None is `HoldAgainstPushes()`.

        Args:
            autoreset_mode: When an environment that has ended starts its next episode: at the next
                step ("NextStep"), in the same step ("SameStep"), or by
                `reset(options={"reset_mask": ...})` ("Disabled").
            threads: Largest number of threads of a step, as for `sp.VectorSimulator`.
        """
        self.task, self.single_observation_space, self.single_action_space = _prepared(task)
        self.num_envs = checks.integer("num_envs", num_envs, 1)
        if not isinstance(autoreset_mode, AutoresetMode):
            known = [mode.value for mode in AutoresetMode]
            autoreset_mode = AutoresetMode(checks.choice("autoreset_mode", autoreset_mode, known))
        self.autoreset_mode = autoreset_mode
        self.metadata = {**type(self).metadata, "autoreset_mode": autoreset_mode}
        if render_mode is not None:
            checks.choice("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._episodes = Episodes(self.task, self.num_envs, threads)
        seeded = [seeding.np_random() for _ in range(self.num_envs)]
        self._randoms, self._seeds = [each[0] for each in seeded], [each[1] for each in seeded]
        self._frames = Frames(self.task.scene) if render_mode == "rgb_array" else None

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators of the environments."""
        return tuple(self._randoms)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the environments."""
        return tuple(self._seeds)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observed, dict[str, Any]]:
        """Starts episodes in the settled grasp; returns all observations (n, entries), and infos.

        Args:
            seed: One for each environment; an integer s is s, s + 1, ...; None goes on with the
                generators as they are.
            options: `{"reset_mask": mask}` resets only some environments, of which the infos are;
                mask is an array of booleans (n,) with at least one True.
        """
        n = self.num_envs
        options = {} if options is None else options
        checks.refuse_unknown("options", options, ("reset_mask",), "")
        mask = checks.read("options['reset_mask']", options.get("reset_mask", np.ones(n, bool)))
        if mask.dtype != np.bool_ or mask.shape != (n,) or not mask.any():
            rule = f"must be {n} booleans, and at least one True"
            raise ValueError(f"options['reset_mask'] = {checks.shown(mask)}: {rule}")
        mask = mask.copy()
        if seed is not None and not isinstance(seed, list | tuple | np.ndarray):
            first = checks.integer("seed", seed, 0)
            seed = range(first, first + n)
        seeds = [None] * n if seed is None else list(seed)
        if len(seeds) != n:
            raise ValueError(f"seed has {len(seeds)} entries: must have one for each of {n}")
        for k in np.flatnonzero(mask):
            if seeds[k] is not None:
                given = checks.integer(f"seed[{k}]", seeds[k], 0)
                self._randoms[k], self._seeds[k] = seeding.np_random(given)
        outcome = self._episodes.start(mask, self._randoms)
        return outcome.observation, _masked(outcome.info, mask)

    def step(self, actions: ArrayLike) -> Stepped:
        """Holds the torques of the actions (n, 2) for one period.

        Those of an environment that starts anew in this step are not used, but must be finite.

        Returns:
            Observations (n, entries), rewards (n,), terminations (n,), truncations (n,) and infos.

        Raises:
            ResetNeeded: There has been no reset, or, with "Disabled", an episode has ended.
        """
        episodes, mode = self._episodes, self.autoreset_mode
        waiting = episodes.ended.copy()
        unfit = waiting if mode is AutoresetMode.DISABLED else ~episodes.started
        if unfit.any():
            first = int(np.flatnonzero(unfit)[0])
            raise ResetNeeded(f"environment {first} has ended, or has not begun: call reset()")
        outcome = episodes.step(actions)
        if mode is AutoresetMode.SAME_STEP and episodes.ended.any():
            return self._restarted(outcome, episodes.ended.copy(), final=True)
        if waiting.any():
            return self._restarted(outcome, waiting, final=False)
        return (*outcome[:4], _masked(outcome.info, np.ones(self.num_envs, bool)))

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns a frame (height, width, 3) of each environment, with "rgb_array"."""
        if self._frames is None:
            gymnasium.logger.warn(_NOTHING)
            return None
        frames = []
        for k in range(self.num_envs):
            _draw(self._frames, self._episodes, k)
            frames.append(self._frames.pixels())
        return tuple(frames)

    def _restarted(self, ended: Outcome, mask: Flags, final: bool) -> Stepped:
        """Starts the next episodes of some environments, and merges that with a step's outcome."""
        first = self._episodes.start(mask, self._randoms)
        infos = _masked(ended.info, ~mask)
        for name, each in first.info.items():
            infos[name][mask] = each[mask]
            infos[f"_{name}"] |= mask
        if final:
            last = np.full(self.num_envs, None, dtype=object)
            for k in np.flatnonzero(mask):
                last[k] = ended.observation[k]
            infos |= {"final_obs": last, "_final_obs": mask}
            infos |= {"final_info": _masked(ended.info, mask), "_final_info": mask.copy()}
        observation = np.where(mask[:, None], first.observation, ended.observation)
        return observation, ended.reward, ended.terminated, ended.truncated, infos


def _masked(info: Mapping[str, NDArray[Any]], mask: Flags) -> dict[str, Any]:
    """Returns infos with their masks; entries of other environments are zero or empty."""
    infos: dict[str, Any] = {}
    for name, each in info.items():
        infos[name] = np.zeros_like(each)
        infos[name][mask] = each[mask]
        infos[f"_{name}"] = mask.copy()
    return infos
