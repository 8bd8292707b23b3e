"""`Episodes`: a task's random episodes in n environments on one simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..run.run import Run
from ..support import checks
from ..support.arrays import Floats
from ..support.choices import Recordable
from .simulator import Observations, Simulator, VectorSimulator, checked_actions
from .tasks import Mask, Task, Transition

# Observed values are clipped to this size, after scaling: a lost object may be anywhere.
LIMIT = 10.0
_TEXT = "<U16"


class Outcome(NamedTuple):
    """The result of one period in each of n environments."""

    observation: Floats  # scaled observations (n, entries)
    reward: Floats  # (n,)
    terminated: Mask  # which grasps have failed (n,)
    truncated: Mask  # which episodes have reached their end (n,)
    info: dict[str, NDArray[Any]]  # more by name, each with n as its first axis


class Episodes:
    """Episodes of a task in n environments on one simulator; `start` comes before `step`."""

    def __init__(self, task: Task, n: int, threads: int = 1) -> None:
        self.task, self.n = task, n
        self.simulator = VectorSimulator(task.scene, n, task.period, task.dt, threads=threads)
        self.measures = task.measures
        self._scales = np.array([measure.scale for measure in self.measures])
        self._step = np.zeros(n, np.int64)
        self._force = np.zeros((n, task.steps, 3))
        self._target = np.zeros((n, task.steps + 1, 3))
        self._torques = np.zeros((n, task.steps, 2))
        self._acting = np.zeros((n, 3))
        self._torque = np.tile(task.grip_torque, (n, 1))
        self._ahead = round(min(task.lookahead, task.duration) / task.period)
        # An environment that has never started needs a reset, as does one that has ended.
        self.ended = np.ones(n, bool)
        self.started = np.zeros(n, bool)

    def start(self, mask: Mask, random: Sequence[np.random.Generator]) -> Outcome:
        """Starts episodes in the environments of a mask (n,), and returns all n observations."""
        steps = self.task.steps
        for k in np.flatnonzero(mask).tolist():
            drawn = self.task.draw(random[k])
            self._force[k] = checks.array("draw().force", drawn.force, (steps, 3))
            self._target[k] = checks.array("draw().target", drawn.target, (steps + 1, 3))
        seen = self.simulator.reset(mask=mask)
        self._step[mask] = 0
        self._acting[mask] = 0.0
        self._torque[mask] = self.task.grip_torque
        self.ended[mask] = False
        self.started[mask] = True
        nothing = np.zeros((self.n, 2))
        return self._outcome(seen, nothing, self._torque, np.zeros(self.n, bool), paid=False)

    def step(self, actions: ArrayLike) -> Outcome:
        """Steps all by one period, with actions (n, 2); those that have ended get no reward."""
        action = np.clip(checked_actions(actions, self.n, "environment"), -1.0, 1.0)
        going = ~self.ended
        # A copy: a task may write to the same array at the next step, and a reset writes to ours.
        torque = _computed("torques()", self.task.torques(action), (self.n, 2)).copy()
        # Set the forces of the coming period where they change.
        k = np.minimum(self._step, self.task.steps - 1)
        force = self._force[np.arange(self.n), k]
        changed = (force != self._acting).any(axis=1)
        if changed.any():
            self.simulator.set_force(force[:, :2], force[:, 2], changed)
            self._acting[changed] = force[changed]
        before = self._torque
        seen = self.simulator.step(torque)
        self._torques[going, self._step[going]] = torque[going]
        self._step[going] += 1
        self._torque = torque
        outcome = self._outcome(seen, action, before, going)
        self.ended = self.ended | outcome.terminated | outcome.truncated
        return outcome

    def force(self, k: int) -> Floats:
        """Returns force and moment (3,) that act in environment k, N and N m."""
        return np.asarray(self._acting[k])

    def target(self, k: int) -> Floats:
        """Returns the wanted pose (3,) of environment k, m and rad."""
        return np.asarray(self._target[k, self._step[k]])

    def run(self, k: int, record: Recordable | Sequence[Recordable]) -> Run:
        """Computes the episode of environment k so far again, as a run with a recording."""
        simulator = Simulator(self.simulator.scene(k), self.task.period, self.task.dt)
        done = self._step[k]
        for torque, force in zip(self._torques[k, :done], self._force[k, :done], strict=True):
            simulator.set_force(force[:2], force[2])
            simulator.step(torque)
        return simulator.run(record)

    def _outcome(
        self, seen: Observations, action: Floats, before: Floats, going: Mask, paid: bool = True
    ) -> Outcome:
        task, every = self.task, np.arange(self.n)
        target = self._target[every, self._step]
        ahead = self._target[every, np.minimum(self._step + self._ahead, task.steps)]
        truncated = going & (seen.status == "completed")
        failed = (seen.status != "completed") & (seen.status != "running")
        strayed = ~failed & task.strayed(seen, target)
        lost = going & (failed | strayed)
        now = Transition(seen, target, ahead, action, self._torque, before, lost)
        shape = (self.n, len(self.measures))
        measured = _computed("measure()", task.measure(now), shape)
        observation = np.clip(measured / self._scales, -LIMIT, LIMIT)
        info: dict[str, NDArray[Any]] = {
            "time": seen.t.copy(),
            "status": np.where(strayed, "strayed", seen.status).astype(_TEXT),
            "torque": self._torque.copy(),
        }
        reward = np.zeros(self.n)
        if paid:
            for name, term in task.terms(now).items():
                term = np.where(going, _computed(f"terms()[{name!r}]", term, (self.n,)), 0.0)
                info[f"reward_{name}"] = term
                reward = reward + term
        return Outcome(observation, reward, lost, truncated & ~lost, info)


def _computed(name: str, values: object, shape: tuple[int, ...]) -> Floats:
    """Returns numbers that a task has computed, and refuses a wrong shape and infinite ones."""
    # This is called several times in a step, so the usual case has a short way.
    if type(values) is np.ndarray and values.dtype == np.float64 and values.shape == shape:
        checks.require_finite(name, values)
        return values
    return checks.array(name, values, shape)


def of_one(info: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Returns the info of a single environment: plain numbers and text, and arrays."""
    return {
        name: each[0].copy() if each.ndim > 1 else each[0].item() for name, each in info.items()
    }
