"""Three tasks for controllers that learn: hold, follow a path, and hold with the least grip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..support import checks
from ..support.arrays import Floats
from .task import Episode, Task, Transition


@dataclass(frozen=True, kw_only=True, repr=False)
class HoldAgainstPushes(Task):
    """Keeps the object where it is while random pushes act on it.

    Reward of a period, with N periods in an episode and r = (x, y) - target:

        hold    1/N / (1 + |r|^2 / (2 mm)^2 + (theta - target)^2 / (0.1 rad)^2)
        effort  -effort_weight/N * (a_right^2 + a_left^2) / 2
        lost    -loss, once, if the grasp is lost

    A grasp that does not move at all returns 1, one that is lost at once -1.

    Attributes:
        effort_weight: What an action of full size costs in a whole episode.
    """

    effort_weight: float = 0.3

    def __post_init__(self) -> None:
        """Checks the fields."""
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


@dataclass(frozen=True, kw_only=True, repr=False)
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
        smooth_weight: What jerky torques cost in a whole episode, at most.
    """

    pushes: int = 0
    legs: int = 3
    reach: float = 8e-3
    smooth_weight: float = 0.2

    def __post_init__(self) -> None:
        """Checks the fields."""
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


@dataclass(frozen=True, kw_only=True, repr=False)
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
        return {
            "grip": self._closeness(np.maximum(force, 0.0) / self.grip_force),
            "lost": self._lost(now),
        }
