"""`PinchEnv`: one pinch as an environment of Gymnasium."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import ArrayLike, NDArray

from ..plot.frames import Frames
from ..run.run import Run
from ..simulator.episodes import Alone, Episodes, only
from ..simulator.task import Task
from ..support import checks
from ..support.choices import Recordable
from .common import FPS, Actions, Observed, checked_options, checked_task, draw, spaces


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

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": FPS}  # noqa: RUF012

    def __init__(self, task: Task | None = None, render_mode: str | None = None) -> None:
        """Makes an environment; `reset` must come before `step`.

        Args:
            task: What is to be done; None is `HoldAgainstPushes()`.
            render_mode: "rgb_array", "human" or None.

        Raises:
            ValueError: The render mode is unknown, or the task's grasp does not come to rest.
            TypeError: `task` is no `Task`.
            ImportError: Drawing needs the extra `plot`.
        """
        self.task = checked_task(task)
        if render_mode is not None:
            checks.choice("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        observed, acted = spaces(self.task)
        self.observation_space, self.action_space = observed, acted  # type: ignore[assignment]
        self._episodes = Episodes.alone(self.task)
        self._frames: Frames | None = None
        if render_mode is not None:
            self._frames = Frames(self.task.scene, window=render_mode == "human")
            if render_mode == "human" and not self._frames.has_window:
                gymnasium.logger.warn(
                    'render_mode = "human": this backend of Matplotlib shows no window'
                )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Starts an episode in the settled grasp.

        Args:
            seed: Seed of the environment's generator; None goes on with the generator as it is.
            options: None or empty; there are no options.

        Returns:
            Observation (entries,) and info.

        Raises:
            ValueError: An option is unknown.
        """
        super().reset(seed=seed)
        checked_options(options)
        outcome = self._episodes.begin(np.ones(1, bool), [self.np_random])
        self._show()
        return outcome.observation[0], only(outcome.info)

    def step(self, action: ArrayLike) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Holds the action's torques for one period.

        Args:
            action: Right and left (2,), in [-1, 1].

        Returns:
            Observation (entries,), reward, whether the grasp has failed (terminated), whether the
            episode has reached its end (truncated), and info.

        Raises:
            ResetNeeded: There has been no reset, or the episode has ended.
            ValueError: The shape is wrong, or a number is not finite.
            TypeError: `action` is not two numbers.
        """
        if self._episodes.ended[0]:
            raise ResetNeeded("the episode has ended, or has not begun: call reset()")
        outcome = self._episodes.step([checks.pair("action", action)])
        self._show()
        return (
            outcome.observation[0],
            float(outcome.reward[0]),
            bool(outcome.terminated[0]),
            bool(outcome.truncated[0]),
            only(outcome.info),
        )

    def run(
        self, record: Recordable | Sequence[Recordable] = ("state", "multipliers", "torque")
    ) -> Run:
        """Computes the episode so far again, with a recording, a ledger and all that a `Run` has.

        Args:
            record: Groups of quantities to record, as for `sp.simulate`.

        Raises:
            ValueError: There has been no step since the reset, or a group is unknown.
        """
        simulator = self._episodes.simulator
        assert isinstance(simulator, Alone)
        return simulator.simulator.run(record)

    def render(self) -> NDArray[np.uint8] | None:
        """Returns a frame (height, width, 3) with "rgb_array"; with "human" it only draws."""
        if self._frames is None:
            gymnasium.logger.warn('render: there is nothing to draw without a "render_mode"')
            return None
        draw(self._frames, self._episodes, 0)
        return self._frames.pixels() if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._frames is not None:
            self._frames.close()

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()
