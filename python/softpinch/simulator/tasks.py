"""Tasks for controllers that learn, and `Episodes`: a task's random episodes on one simulator.

A task is a frozen dataclass: grasp, pushes, reward, observation. To make another one, change
fields, or derive a class from `Task` and override `draw`, `terms` or `measures`. All computations
are over arrays whose first axis is environments. Nothing here needs Gymnasium.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..run import Options, Request, Run, computed
from ..scene import Fingertip, GraspedObject, Hand, Pid, Scene, Schedule, Torque, jaws
from ..support import SIDES, Floats, Record, Recordable, checks
from .simulator import Observations, Simulator, VectorSimulator, checked_actions

Mask = NDArray[np.bool_]

# The rates of a grasp at rest are below this, m/s and rad/s.
_REST = 1e-5
# Observed values are clipped to this size, after scaling: a lost object may be anywhere.
LIMIT = 10.0
_TEXT = "<U16"


def usual_grasp() -> Scene:
    """Returns the grasp of the tasks: a PID closes both fingers by 3 degrees and waits for rest."""
    # Tips push, never pull, and slip beyond a friction of 0.5, so that an object can be lost.
    return Scene(
        hand=Hand(tip=Fingertip(normal_mass=0.01, tangential_mass=0.01)),
        grasped=GraspedObject(height=0.049),
        contact="unilateral",
        friction=0.5,
        control=Pid(),
        schedule=Schedule.steps([0.0], np.deg2rad([[3.0, 3.0]])),
        duration=2.0,
    )


class Measure(NamedTuple):
    """An entry of the observation; its `scale`, in its `unit` ("1" for none), is observed as 1."""

    name: str
    unit: str
    scale: float


class Episode(NamedTuple):
    """Pushes and wanted poses, drawn at a reset for each period of the episode.

    Attributes:
        force: Force (F_x, F_y) and moment on the object in each period (steps, 3), N and N m.
        target: Wanted pose x, y, theta at the start and at the end of each period (steps + 1, 3),
            m and rad.
    """

    force: Floats
    target: Floats


class Transition(NamedTuple):
    """The period that has just ended, in each of n environments, as a task sees it.

    Attributes:
        seen: The simulator's observations at the end of the period.
        target: Wanted poses at the end of the period (n, 3), m and rad.
        ahead: Wanted poses `Task.lookahead` later (n, 3), m and rad.
        action: Actions of the period (n, 2), clipped to [-1, 1]; zero at a start.
        torque: Torques of the period (n, 2), N m; the grip's own at a start.
        torque_before: Torques of the period before (n, 2), N m.
        lost: Which grasps have failed (n,), as booleans.
    """

    seen: Observations
    target: Floats
    ahead: Floats
    action: Floats
    torque: Floats
    torque_before: Floats
    lost: Mask


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Task(Record):
    """The base of all tasks; a task of your own derives from this class or from one of the others.

    An episode starts in the settled grasp. Action a in [-1, 1]^2 sets the torques of right and left
    finger to `grip_torque + torque_span * a` for one period. An episode is truncated at the end of
    `duration`. It is terminated where the simulator ends the run (statuses "lost", "separated",
    "crushed", "folded" and others), and with status "strayed" where the object is more than
    `leash` away from its wanted position.

    Attributes:
        grasp: A scene with a PID that comes to rest within its duration; the episodes start there.
        duration: Length of an episode, s.
        period: Time for which an action is held, s.
        dt: Longest step of the simulation, s.
        torque_span: Change of torque for which an action of 1 stands, N m.
        leash: Largest distance of the object from its wanted position, m.
        lookahead: How far ahead the wanted pose is observed, s.
        loss: Amount taken from the return when the grasp is lost.
        pushes: Number of random pushes in an episode.
        push_force: Largest force of a push, N. Each push draws its force uniformly from 0 on, and
            its direction from the full circle.
        push_moment: Largest moment of a push, N m, drawn uniformly with either sign.
        push_time: Shortest and longest duration of a push, s, drawn uniformly.
    """

    grasp: Scene = field(default_factory=usual_grasp)
    duration: float = 1.0
    period: float = 2e-3
    dt: float = 2e-4
    torque_span: float = 1.0
    leash: float = 0.02
    lookahead: float = 0.02
    loss: float = 1.0
    pushes: int = 3
    push_force: float = 25.0
    push_moment: float = 0.2
    push_time: tuple[float, float] = (0.01, 0.05)

    def __post_init__(self) -> None:
        name = type(self).__name__
        checks.instance(f"{name}.grasp", self.grasp, Scene)
        if any(jaws(self.grasp)):
            raise ValueError(f"{name}.grasp: does not take a Jaw yet: it observes angles of links")
        if self.grasp.law != "pid":
            given = f"{name}.grasp: its fingers are {checks.shown(self.grasp.law)}"
            raise ValueError(f"{given}: must have a PID, which brings the grasp to rest")
        for each in ("duration", "period", "dt", "torque_span", "leash"):
            checks.positive(f"{name}.{each}", getattr(self, each))
        for each in ("lookahead", "loss", "push_force", "push_moment"):
            checks.non_negative(f"{name}.{each}", getattr(self, each))
        checks.integer(f"{name}.pushes", self.pushes, 0, 10_000)
        shortest, longest = checks.pair(f"{name}.push_time", self.push_time)
        if not 0.0 < shortest <= longest:
            rule = "must be the shortest and the longest duration, both above 0"
            raise ValueError(f"{name}.push_time = {checks.shown(self.push_time)}: {rule}")
        rule = f"must be at most the duration, {self.duration}"
        checks.number_that(f"{name}.period", self.period, lambda x: x <= self.duration, rule)

    @cached_property
    def scene(self) -> Scene:
        """The scene of an episode: the settled grasp, with torques as inputs."""
        run = self._settled(self.grasp, ("state", "torque"))
        speed = float(np.abs(run.p[-1]).max())
        if not run.success or speed > _REST:
            rate = f"its largest rate at t = {run.t[-1]:g} s is {speed:.2g}"
            rule = f"must come to rest within its duration; its status is {run.status!r} and {rate}"
            raise ValueError(f"{type(self).__name__}.grasp: {rule}")
        start = replace(run.state(-1), time=0.0, integral=(0.0, 0.0), grid=None, linearized=None)
        end = self.steps * self.period
        return replace(
            self.grasp,
            control=Torque(),
            schedule=Schedule.steps([0.0], [run.torque[-1]]),
            initial=start,
            # The end of the last period differs from it by round-off.
            duration=end if math.isclose(end, self.duration, rel_tol=1e-12) else self.duration,
        )

    def _settled(self, scene: Scene, record: tuple[str, ...]) -> Run:
        return computed(Request(scene, Options.checked(dt=self.dt, record=record)))

    @cached_property
    def steps(self) -> int:
        """Number of periods of an episode; the last one may be shorter."""
        return int(np.ceil(self.duration / self.period * (1.0 - 1e-12)))

    @cached_property
    def grip_torque(self) -> Floats:
        """Holding torques of the settled grasp, (right, left), N m: those of action 0."""
        return np.asarray(self.scene.schedule.angles[0])

    @cached_property
    def grip_force(self) -> float:
        """Mean normal force of both tips in the settled grasp, N."""
        run = self._settled(replace(self.scene, duration=self.dt), ("multipliers",))
        return float(0.5 * (run.multipliers[0, 0] + run.multipliers[0, 1]))

    @property
    def start(self) -> Floats:
        """Coordinates of the settled grasp (9,), m and rad."""
        return np.asarray(self.scene.start().q)

    def draw(self, random: np.random.Generator) -> Episode:
        """Draws the pushes and the wanted poses of one episode; all randomness comes from here."""
        return Episode(self.draw_pushes(random), np.tile(self.start[:3], (self.steps + 1, 1)))

    def draw_pushes(self, random: np.random.Generator) -> Floats:
        """Draws constant pushes that may overlap: force and moment in each period (steps, 3)."""
        force = np.zeros((self.steps, 3))
        for start, lasts, size, angle, moment in random.random((self.pushes, 5)):
            shortest, longest = self.push_time
            length = max(1, round((shortest + (longest - shortest) * lasts) / self.period))
            first = int(start * max(1, self.steps - length))
            newtons, turn = self.push_force * size, 2.0 * np.pi * angle
            push = (newtons * np.cos(turn), newtons * np.sin(turn))
            force[first : first + length, :2] += push
            force[first : first + length, 2] += self.push_moment * (2.0 * moment - 1.0)
        return force

    def torques(self, action: Floats) -> Floats:
        """Converts actions (n, 2) in [-1, 1] to torques (n, 2), N m."""
        return self.grip_torque + self.torque_span * action

    def strayed(self, seen: Observations, target: Floats) -> Mask:
        """Says in which environments (n,) the object is beyond the leash."""
        away = seen.q[:, :2] - target[:, :2]
        return np.asarray(away[:, 0] ** 2 + away[:, 1] ** 2 > self.leash**2)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """The entries of the observation, in their order."""
        rows = [("x - target", "m", 2e-3), ("y - target", "m", 2e-3)]
        rows += [("theta - target", "rad", 0.05)]
        rows += [("rate of x", "m/s", 0.1), ("rate of y", "m/s", 0.1)]
        rows += [("rate of theta", "rad/s", 2.0)]
        kinds = (
            ("angle from the settled grasp", "rad", 0.05),
            ("rate of the angle", "rad/s", 2.0),
            ("compression from the settled grasp", "m", 1e-3),
            ("shear from the settled grasp", "m", 1e-3),
            ("normal force from the settled grasp", "N", 0.5 * self.grip_force),
            ("tangential force", "N", 0.5 * self.grip_force),
            ("last torque from the settled grasp", "N m", self.torque_span),
        )
        rows += [(f"{side} {kind}", unit, scale) for kind, unit, scale in kinds for side in SIDES]
        rows += [("x of the target ahead - target", "m", 2e-3)]
        return tuple(Measure(*row) for row in rows)

    def measure(self, now: Transition) -> Floats:
        """Measures the entries of the observation in SI units (n, entries), as `measures` lists."""
        _, q, p, multipliers, _ = now.seen
        start = self.start
        entries = (
            q[:, :3] - now.target,
            p[:, :3],
            q[:, 3:5] - start[3:5],
            p[:, 3:5],
            q[:, 5:9] - start[5:9],
            multipliers[:, :2] - self.grip_force,
            multipliers[:, 2:],
            now.torque - self.grip_torque,
            now.ahead[:, :1] - now.target[:, :1],
        )
        return np.hstack(entries)

    def terms(self, now: Transition) -> dict[str, Floats]:
        """Returns the terms of the reward by their names, each (n,); the reward is their sum.

        A task of your own overrides this. Multiply running terms by `1 / steps`, so that a return
        does not depend on the period.
        """
        raise NotImplementedError(f"{type(self).__name__} must define terms(transition)")

    def _lost(self, now: Transition) -> Floats:
        return np.where(now.lost, -self.loss, 0.0)

    def _closeness(self, error: Floats) -> Floats:
        """1 for no error, 1/2 for a scaled squared error of 1; divided by the number of periods."""
        return 1.0 / (1.0 + error) / self.steps


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HoldAgainstPushes(Task):
    """Keeps the object where it is while random pushes act on it.

    Reward of a period, with N periods in an episode and r = (x, y) - target:

        hold    1/N / (1 + |r|^2 / (2 mm)^2 + (theta - target)^2 / (0.1 rad)^2)
        effort  -effort_weight/N * (a_right^2 + a_left^2) / 2
        lost    -loss, once, if the grasp is lost

    A grasp that does not move at all returns 1, one that is lost at once -1.

    Attributes:
        effort_weight: Cost of actions of full size in a whole episode.
    """

    effort_weight: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.non_negative("HoldAgainstPushes.effort_weight", self.effort_weight)

    def terms(self, now: Transition) -> dict[str, Floats]:
        """Returns the terms of the reward (n,)."""
        x, y, theta = (now.seen.q[:, :3] - now.target).T
        a = now.action
        effort = 0.5 * (a[:, 0] ** 2 + a[:, 1] ** 2)
        return {
            "hold": self._closeness((x**2 + y**2) / 2e-3**2 + theta**2 / 0.1**2),
            "effort": -self.effort_weight / self.steps * effort,
            "lost": self._lost(now),
        }


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FollowPath(Task):
    """Moves the object sideways along a random path, with torques that change smoothly.

    The path has `legs` legs of equal duration. Each leads from rest to rest by a minimum-jerk
    polynomial, to an x drawn uniformly within `reach` of the settled grasp. Reward of a period,
    with e = x - target and s = |change of the torques|^2 / 2 / (0.01 N m)^2:

        follow  1/N / (1 + e^2 / (0.2 mm)^2)
        smooth  -smooth_weight/N * s / (1 + s)
        lost    -loss, once, if the grasp is lost

    Only x is wanted: a hand of two fingers cannot choose the height and rotation that go with it.

    Attributes:
        legs: Number of legs.
        reach: Largest distance from the settled grasp, m.
        smooth_weight: Largest cost of jerky torques in a whole episode.
    """

    pushes: int = 0
    legs: int = 3
    reach: float = 8e-3
    smooth_weight: float = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.integer("FollowPath.legs", self.legs, 1, 10_000)
        checks.non_negative("FollowPath.reach", self.reach)
        checks.non_negative("FollowPath.smooth_weight", self.smooth_weight)

    def draw(self, random: np.random.Generator) -> Episode:
        """Draws the path, and then pushes if there are any."""
        ends = np.append(0.0, self.reach * (2.0 * random.random(self.legs) - 1.0))
        along = np.linspace(0.0, self.legs, self.steps + 1)
        leg = np.minimum(along.astype(int), self.legs - 1)
        s = along - leg
        blend = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
        target = np.tile(self.start[:3], (self.steps + 1, 1))
        target[:, 0] += ends[leg] + (ends[leg + 1] - ends[leg]) * blend
        return Episode(self.draw_pushes(random), target)

    def terms(self, now: Transition) -> dict[str, Floats]:
        """Returns the terms of the reward (n,)."""
        error = now.seen.q[:, 0] - now.target[:, 0]
        change = now.torque - now.torque_before
        jump = 0.5 * (change[:, 0] ** 2 + change[:, 1] ** 2) / 0.01**2
        return {
            "follow": self._closeness(error**2 / 2e-4**2),
            "smooth": -self.smooth_weight / self.steps * jump / (1.0 + jump),
            "lost": self._lost(now),
        }


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HoldWithLeastGrip(Task):
    """Holds the object against weak pushes with as little normal force as possible.

    Reward of a period, with F the mean normal force of both tips, F_0 that of the settled grasp:

        grip    1/N / (1 + F / F_0)
        lost    -loss, once, if the grasp is lost

    The settled grip for the whole episode returns 1/2, no force at all would return 1.
    """

    push_force: float = 1.0
    push_moment: float = 0.01
    leash: float = 0.01

    def terms(self, now: Transition) -> dict[str, Floats]:
        """Returns the terms of the reward (n,)."""
        force = 0.5 * (now.seen.multipliers[:, 0] + now.seen.multipliers[:, 1])
        # Tips that a bilateral scene lets pull are no gain.
        grip = self._closeness(np.maximum(force, 0.0) / self.grip_force)
        return {"grip": grip, "lost": self._lost(now)}


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
        measured = _computed("measure()", task.measure(now), (self.n, len(self.measures)))
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
    return {k: v[0].copy() if v.ndim > 1 else v[0].item() for k, v in info.items()}
