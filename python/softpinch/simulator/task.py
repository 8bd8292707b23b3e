"""`Task`, the base of tasks for controllers that learn: grasp, pushes, reward, observation.

A task is a frozen dataclass. To make another one, change fields, or derive a class and override
`draw`, `terms` or `measures`. All computations are over arrays whose first axis is environments, so
one implementation serves a single environment and thousands. Nothing here needs Gymnasium.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..run.simulate import simulate
from ..scene.control import Pid, Torque
from ..scene.hand import Fingertip, GraspedObject, Hand
from ..scene.scene import Scene
from ..scene.schedule import Schedule
from ..support import checks
from ..support.arrays import Floats
from .vector import Observations

Mask = NDArray[np.bool_]

# The rates of a grasp at rest are below this, m/s and rad/s.
_REST = 1e-5


def usual_grasp() -> Scene:
    """Returns the grasp of the tasks: a PID closes both fingers by 3 degrees and waits for rest.

    Tips push, never pull, and slip beyond a friction of 0.5, so that an object can be lost.
    """
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
    """One entry of the observation.

    Attributes:
        name: What is measured.
        unit: The unit of `scale`; "1" without one.
        scale: The value that is observed as 1.
    """

    name: str
    unit: str
    scale: float


class Episode(NamedTuple):
    """What is drawn at a reset, for each period of the episode.

    Attributes:
        force: Force (F_x, F_y) and moment on the object in each period (steps, 3), N and N m.
        target: Wanted pose x, y, theta at the start and at the end of each period (steps + 1, 3),
            m and rad.
    """

    force: Floats
    target: Floats


class Transition(NamedTuple):
    """What a task sees of the period that has just ended, in each of n environments.

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


@dataclass(frozen=True, kw_only=True)
class Task:
    """What all tasks share; a task of your own derives from this class or from one of the others.

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
        loss: What is taken from the return when the grasp is lost.
        pushes: Number of random pushes in an episode.
        push_force: Largest force of a push, N. Each push draws its force uniformly from 0 on, and
            its direction from the full circle.
        push_moment: Largest moment of a push, N m, drawn uniformly with either sign.
        push_time: Shortest and longest duration of a push, s, drawn uniformly.

    Raises:
        ValueError: A number breaks its rule, or the grasp does not come to rest.
        TypeError: A value has the wrong type.
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

    _POSITIVE: ClassVar[tuple[str, ...]] = ("duration", "period", "dt", "torque_span", "leash")

    def __post_init__(self) -> None:
        """Checks the fields."""
        name = type(self).__name__
        checks.instance(f"{name}.grasp", self.grasp, Scene)
        if self.grasp.law != "pid":
            raise ValueError(
                f"{name}.grasp: its fingers are {checks.shown(self.grasp.law)}: must have a PID, "
                "which brings the grasp to rest"
            )
        for each in self._POSITIVE:
            checks.positive(f"{name}.{each}", getattr(self, each))
        for each in ("lookahead", "loss", "push_force", "push_moment"):
            checks.non_negative(f"{name}.{each}", getattr(self, each))
        checks.integer(f"{name}.pushes", self.pushes, 0, 10_000)
        shortest, longest = checks.pair(f"{name}.push_time", self.push_time)
        if not 0.0 < shortest <= longest:
            raise ValueError(
                f"{name}.push_time = {checks.shown(self.push_time)}: must be the shortest and the "
                "longest duration, both above 0"
            )
        if self.period > self.duration:
            raise ValueError(
                f"{name}.period = {self.period}: must be at most the duration, {self.duration}"
            )

    @cached_property
    def scene(self) -> Scene:
        """The scene of an episode: the settled grasp, with torques as inputs.

        Raises:
            ValueError: The grasp does not come to rest.
        """
        run = simulate(self.grasp, self.dt, record=("state", "multipliers", "torque"))
        speed = float(np.abs(run.p[-1]).max())
        if not run.success or speed > _REST:
            raise ValueError(
                f"{type(self).__name__}.grasp: must come to rest within its duration; its status "
                f"is {run.status!r} and its largest rate at t = {run.t[-1]:g} s is {speed:.2g}"
            )
        start = replace(run.state(-1), time=0.0, integral=(0.0, 0.0), grid=None, linearized=None)
        return replace(
            self.grasp,
            control=Torque(),
            schedule=Schedule.steps([0.0], [run.torque[-1]]),
            initial=start,
            duration=self._length,
        )

    @cached_property
    def steps(self) -> int:
        """Number of periods of an episode; the last one may be shorter."""
        return int(np.ceil(self.duration / self.period * (1.0 - 1e-12)))

    @property
    def _length(self) -> float:
        """The duration, s, or the end of the last period if that differs by round-off only.

        Otherwise the simulator would need one more period of no length: 5 * 0.011 < 0.055.
        """
        end = self.steps * self.period
        return end if math.isclose(end, self.duration, rel_tol=1e-12) else self.duration

    @cached_property
    def grip_torque(self) -> Floats:
        """Torques of the settled grasp, (right, left), N m: those of action 0."""
        return np.asarray(self.scene.schedule.angles[0])

    @cached_property
    def grip_force(self) -> float:
        """Mean normal force of both tips in the settled grasp, N."""
        run = simulate(replace(self.scene, duration=self.dt), self.dt, record=("multipliers",))
        return float(0.5 * (run.multipliers[0, 0] + run.multipliers[0, 1]))

    @property
    def start(self) -> Floats:
        """Coordinates of the settled grasp (9,), m and rad."""
        return np.asarray(self.scene.start().q)

    def draw(self, random: np.random.Generator) -> Episode:
        """Draws the pushes and the wanted poses of one episode; all randomness comes from here.

        Args:
            random: The generator of the environment.
        """
        target = np.tile(self.start[:3], (self.steps + 1, 1))
        return Episode(self.draw_pushes(random), target)

    def draw_pushes(self, random: np.random.Generator) -> Floats:
        """Draws constant pushes that may overlap; they start and end with periods.

        Returns:
            Force and moment in each period (steps, 3), N and N m.
        """
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
        far: Mask = away[:, 0] ** 2 + away[:, 1] ** 2 > self.leash**2
        return far

    @property
    def measures(self) -> tuple[Measure, ...]:
        """The entries of the observation, in their order."""
        sides = ("right", "left")
        pose = [Measure("x - target", "m", 2e-3), Measure("y - target", "m", 2e-3)]
        pose += [Measure("theta - target", "rad", 0.05)]
        pose += [Measure("rate of x", "m/s", 0.1), Measure("rate of y", "m/s", 0.1)]
        pose += [Measure("rate of theta", "rad/s", 2.0)]
        kinds = (
            ("angle from the settled grasp", "rad", 0.05),
            ("rate of the angle", "rad/s", 2.0),
            ("compression from the settled grasp", "m", 1e-3),
            ("shear from the settled grasp", "m", 1e-3),
            ("normal force from the settled grasp", "N", 0.5 * self.grip_force),
            ("tangential force", "N", 0.5 * self.grip_force),
            ("last torque from the settled grasp", "N m", self.torque_span),
        )
        both = [
            Measure(f"{side} {kind}", unit, scale) for kind, unit, scale in kinds for side in sides
        ]
        ahead = [Measure("x of the target ahead - target", "m", 2e-3)]
        return (*pose, *both, *ahead)

    def measure(self, now: Transition) -> Floats:
        """Measures the entries of the observation in SI units (n, entries), as `measures` lists."""
        _, q, p, multipliers, _ = now.seen
        start = self.start
        normal = multipliers[:, :2] - self.grip_force
        return np.hstack(
            (
                q[:, :3] - now.target,
                p[:, :3],
                q[:, 3:5] - start[3:5],
                p[:, 3:5],
                q[:, 5:9] - start[5:9],
                normal,
                multipliers[:, 2:],
                now.torque - self.grip_torque,
                now.ahead[:, :1] - now.target[:, :1],
            )
        )

    def terms(self, now: Transition) -> dict[str, Floats]:
        """Returns the terms of the reward by their names, each (n,); the reward is their sum.

        A task of your own overrides this. Multiply running terms by `1 / steps`, so that a return
        does not depend on the period.
        """
        raise NotImplementedError(f"{type(self).__name__} must define terms(transition)")

    def _lost(self, now: Transition) -> Floats:
        return np.where(now.lost, -self.loss, 0.0)

    def _closeness(self, error: Floats) -> Floats:
        """Returns 1 for no error, 1/2 where the scaled squared error is 1, and then towards 0."""
        return 1.0 / (1.0 + error) / self.steps

    def __repr__(self) -> str:
        """Shows the fields that differ from their defaults."""
        usual = {each.name: each.default for each in fields(self) if each.name != "grasp"}
        own = {name: repr(getattr(self, name)) for name in usual}
        changed = [f"{name}={own[name]}" for name in usual if own[name] != repr(usual[name])]
        return f"{type(self).__name__}({', '.join(changed)})"
