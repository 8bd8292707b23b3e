"""`PinchVectorEnv`: many pinches as a vector environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from ..plot.frames import Frames
from ..simulator.episodes import Episodes, Outcome
from ..simulator.task import Task
from ..support import checks
from .common import FPS, Actions, Flags, Observed, checked_options, checked_task, draw, spaces


class PinchVectorEnv(VectorEnv[Observed, Actions, NDArray[Any]]):
    """Many pinches in the lanes of one simulator, each with the bits of a `PinchEnv` of its seed.

    What is observed and paid is that of `PinchEnv`, with the environments as the first axis. The
    info has arrays of n entries and masks of them, as Gymnasium's vector environments have. Each
    environment keeps 48 bytes for each period of its episode.
    """

    metadata = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": FPS,
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
        """Makes the environments; `reset` must come before `step`.

        Args:
            num_envs: Number of environments.
            task: What is to be done; None is `HoldAgainstPushes()`.
            autoreset_mode: When an environment that has ended starts its next episode: at the next
                step ("NextStep"), in the same step ("SameStep"), or by
                `reset(options={"reset_mask": ...})` ("Disabled").
            render_mode: "rgb_array" or None.
            threads: Largest number of threads of a step, as for `sp.VectorSimulator`.

        Raises:
            ValueError: An argument breaks its rule, or the task's grasp does not come to rest.
            TypeError: An argument has the wrong type.
            ImportError: Drawing needs the extra `plot`.
        """
        self.task = checked_task(task)
        self.num_envs = checks.integer("num_envs", num_envs, 1)
        if not isinstance(autoreset_mode, AutoresetMode):
            known = [mode.value for mode in AutoresetMode]
            autoreset_mode = AutoresetMode(checks.choice("autoreset_mode", autoreset_mode, known))
        self.autoreset_mode = autoreset_mode
        self.metadata = {**type(self).metadata, "autoreset_mode": autoreset_mode}
        if render_mode is not None:
            checks.choice("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.single_observation_space, self.single_action_space = spaces(self.task)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._episodes = Episodes.many(self.task, self.num_envs, threads)
        self._randoms: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds: list[int | None] = [None] * self.num_envs
        self._frames = Frames(self.task.scene) if render_mode == "rgb_array" else None

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators of the environments."""
        return tuple(self._generators())

    @property
    def np_random_seed(self) -> tuple[int | None, ...]:  # type: ignore[override]
        """The seeds of the environments."""
        self._generators()
        return tuple(self._seeds)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observed, dict[str, Any]]:
        """Starts episodes in the settled grasp.

        Args:
            seed: One for each environment; an integer s is s, s + 1, ...; None goes on with the
                generators as they are.
            options: `{"reset_mask": mask}` resets only some environments; mask is an array of
                booleans (n,) with at least one True.

        Returns:
            Observations of all environments (n, entries), and infos of those that were reset.

        Raises:
            ValueError: The number of seeds is wrong, an option is unknown, or the mask is empty or
                has a wrong shape.
            TypeError: A seed or the mask has the wrong type.
        """
        n = self.num_envs
        mask = self._mask(checked_options(options, ("reset_mask",)))
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
        outcome = self._episodes.begin(mask, self._generators())
        return outcome.observation, _masked(outcome.info, mask)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observed, NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """Holds the torques of the actions for one period.

        Args:
            actions: Right and left of each environment (n, 2), in [-1, 1]. Those of an environment
                that starts its next episode in this step are not used, but must be finite.

        Returns:
            Observations (n, entries), rewards (n,), terminations (n,), truncations (n,) and infos.

        Raises:
            ResetNeeded: There has been no reset, or, with "Disabled", an episode has ended.
            ValueError: The shape is wrong, or a number is not finite; the message names its
                environment.
            TypeError: `actions` are not numbers.
        """
        episodes, mode = self._episodes, self.autoreset_mode
        waiting = episodes.ended.copy()
        unfit = waiting if mode is AutoresetMode.DISABLED else ~episodes.begun
        if unfit.any():
            raise ResetNeeded(
                f"environment {int(np.flatnonzero(unfit)[0])} has ended, or has not begun: "
                "call reset()"
            )
        outcome = episodes.step(actions)
        if mode is AutoresetMode.SAME_STEP and episodes.ended.any():
            return self._begun(outcome, episodes.ended.copy(), final=True)
        if waiting.any():
            return self._begun(outcome, waiting, final=False)
        every = np.ones(self.num_envs, bool)
        return (
            outcome.observation,
            outcome.reward,
            outcome.terminated,
            outcome.truncated,
            _masked(outcome.info, every),
        )

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Returns a frame (height, width, 3) of each environment, with "rgb_array"."""
        if self._frames is None:
            gymnasium.logger.warn('render: there is nothing to draw without a "render_mode"')
            return None
        frames = []
        for k in range(self.num_envs):
            draw(self._frames, self._episodes, k)
            frames.append(self._frames.pixels())
        return tuple(frames)

    def _begun(
        self, ended: Outcome, mask: Flags, final: bool
    ) -> tuple[Observed, NDArray[np.float64], Flags, Flags, dict[str, Any]]:
        """Starts the next episodes of some environments, and merges that with a step's outcome."""
        first = self._episodes.begin(mask, self._generators())
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

    def _generators(self) -> list[np.random.Generator]:
        for k, random in enumerate(self._randoms):
            if random is None:
                self._randoms[k], self._seeds[k] = seeding.np_random()
        return [random for random in self._randoms if random is not None]

    def _mask(self, options: Mapping[str, Any]) -> Flags:
        if "reset_mask" not in options:
            return np.ones(self.num_envs, bool)
        mask = options["reset_mask"]
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError(
                f"options['reset_mask'] = {checks.shown(mask)}: must be an array of booleans"
            )
        if mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] = {checks.shown(mask)}: must have shape "
                f"({self.num_envs},) and at least one True"
            )
        return mask.copy()


def _masked(info: Mapping[str, NDArray[Any]], mask: Flags) -> dict[str, Any]:
    """Returns infos with their masks; entries of other environments are zero or empty."""
    infos: dict[str, Any] = {}
    for name, each in info.items():
        infos[name] = np.zeros_like(each)
        infos[name][mask] = each[mask]
        infos[f"_{name}"] = mask.copy()
    return infos
