"""`carry_limits`: the largest acceleration at which a hand may carry a grasp, in each direction."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..run import Run, simulate
from ..scene import HandMotion, Scene, State
from ..support import Floats, Result, Texts, checks
from .rest import Equilibrium
from .wrench import checked_directions, equilibrium_of, limits_of, unit_directions

Profile: TypeAlias = Literal["trapezoid", "minimum_jerk"]
# The duration of a move over a distance D with the peak acceleration a is this times sqrt(D / a).
_DURATIONS = {"trapezoid": 2.0, "minimum_jerk": math.sqrt(10.0 / math.sqrt(3.0))}
# The relative width at which a bisection ends.
_CLOSE = 1e-3
# The first move is as fast as this multiple of the slow limit, m/s^2 the fastest that is tried.
_FIRST, _FASTEST = 2.0, 1e5


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CarryLimits(Result):
    """The largest acceleration of the hand that a grasp bears in each of n directions.

    With an array of m tilts, `limit` and `cause` are (m, n), and there are m equilibria.

    Attributes:
        equilibrium: The equilibrium from which the hand is accelerated, or one for each tilt.
        direction: Direction of the acceleration along fixed axes (n, 2), of length one.
        limit: The largest acceleration (n,), m/s^2; inf if nothing gives way.
        cause: What gives way first (n,): as `WrenchLimits.limit`; of moves, the status of a run
            that is lost, or a violation; "none" if nothing does.
        profile: The shape of the moves; None for an acceleration that grows slowly.
        tilt: The tilt of the hand, or the tilts (m,), rad.
    """

    equilibrium: Equilibrium | tuple[Equilibrium, ...]
    direction: Floats
    limit: Floats
    cause: Texts
    profile: Profile | None
    tilt: float | Floats

    def __repr__(self) -> str:
        k = int(np.argmin(self.limit))
        x, y = self.direction[k % len(self.direction)]
        how = "growing slowly" if self.profile is None else f"moves by {self.profile}"
        limit = f"{self.limit.flat[k]:.6g} m/s^2 at ({x:.4g}, {y:.4g}), {self.cause.flat[k]}"
        return f"<CarryLimits of {len(self.direction)} directions, {how}: weakest {limit}>"


def carry_limits(
    grasp: Scene | Equilibrium,
    directions: ArrayLike | None = None,
    *,
    profile: Profile | None = None,
    distance: float = 0.2,
    settle: float = 0.1,
    tilt: ArrayLike = 0.0,
    time: float | None = None,
    shear: ArrayLike | None = None,
    near: State | Run | None = None,
    grip: ArrayLike | None = None,
) -> CarryLimits:
    """Finds the largest acceleration of the hand that a grasp at rest bears.

    Without a `profile` the acceleration of the hand's frame grows from zero so slowly that the
    grasp stays in equilibrium, until a contact gives way, as the wrench does in `wrench_limits`:
    inertial forces act on object and fingers. With a `profile` the hand moves over `distance` from
    rest to rest and stays there for `settle`; a bisection finds, to 0.1 %, the peak acceleration
    above which the grasp no longer holds (`Run.holds`). A fast move ends before a grasp is lost,
    and excites it, so this limit may lie above the slow one or below it.

        >>> import softpinch as sp
        >>> scene = sp.Scene(friction=0.8, schedule=sp.Schedule.in_degrees("steps", [0], [[8, 8]]))
        >>> limits = sp.carry_limits(scene, [[1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        >>> limits.cause.tolist()
        ['slipping', 'slipping', 'slipping']

    Args:
        grasp: A scene, whose `equilibrium` is found first, or an equilibrium.
        directions: Directions along fixed axes (n, 2), of any length but zero. None takes 72, from
            the direction x counter-clockwise.
        profile: None, "trapezoid" (constant acceleration, then the opposite), or "minimum_jerk".
        distance: Length of a move, m.
        settle: Time after a move, s, in which the grasp has to hold too.
        tilt: Tilt of the hand, or several (m,), rad, counter-clockwise; only with a scene without a
            motion. Directions stay those along fixed axes.
        time, shear, near, grip: As for `equilibrium`; only with a scene.

    Raises:
        ValueError: The scene has a motion that is not constant, or a bilateral contact (which is
            never lost) with a `profile`.
    """
    distance = checks.positive("distance", distance)
    settle = checks.non_negative("settle", settle)
    if profile is not None:
        checks.choice("profile", profile, tuple(_DURATIONS))
    if directions is None:
        rows = unit_directions()
    else:
        rows = checked_directions(directions, 2)
        rows = rows / np.hypot(*rows.T)[:, None]
    tilts = checks.array("tilt", tilt, ("m",) if np.ndim(tilt) else ())
    if tilts.ndim:
        how: dict[str, Any] = {"time": time, "shear": shear, "near": near, "grip": grip}
        how |= {"distance": distance, "settle": settle, "profile": profile}
        each = [carry_limits(grasp, directions, tilt=t, **how) for t in tilts.tolist()]
        all_tilts: dict[str, Any] = {"equilibrium": tuple(one.equilibrium for one in each)}
        all_tilts |= {k: np.stack([getattr(one, k) for one in each]) for k in ("limit", "cause")}
        return CarryLimits(**all_tilts, direction=rows, profile=profile, tilt=tilts)
    tilt = float(tilts)
    if tilt:
        if isinstance(grasp, Equilibrium):
            raise ValueError(f"tilt = {tilt}: the equilibrium has it already")
        checks.instance("grasp", grasp, Scene, "a Scene or an Equilibrium")
        if grasp.motion is not None:
            raise ValueError(f"tilt = {tilt}: the scene has a motion already")
        grasp = grasp.with_({"motion": HandMotion.constant(tilt=tilt)})
    rest = equilibrium_of(grasp, time=time, shear=shear, near=near, grip=grip)
    if profile is not None and rest.scene.contact != "unilateral":
        raise ValueError('profile: needs contact = "unilateral", a bilateral one is never lost')
    if rest.scene.motion is not None:
        tilt = float(rest.scene.motion.at(rest.time).tilt)
    limit, cause, _ = limits_of(rest, rows)
    if profile is not None:
        move = partial(_move, rest, profile, settle, tilt)
        ways = zip(distance * rows, limit, strict=True)
        found = [_fastest(partial(move, way), slow) for way, slow in ways]
        limit, cause = np.array([a for a, _ in found]), [name for _, name in found]
    causes = np.array(cause)
    return CarryLimits(
        equilibrium=rest, direction=rows, limit=limit, cause=causes, profile=profile, tilt=tilt
    )


def _move(
    rest: Equilibrium, profile: Profile, settle: float, tilt: float, way: Floats, peak: float
) -> Run:
    """The run of a move along `way` (2,), m, with a peak acceleration, m/s^2."""
    duration = _DURATIONS[profile] * math.sqrt(np.hypot(*way) / peak)
    times, points = [rest.time, rest.time + duration], np.outer([0.0, 1.0], way)
    if profile == "trapezoid":
        motion = HandMotion.trapezoid(times, points, peak, tilt)
    else:
        motion = HandMotion.minimum_jerk(times, points, tilt)
    changes = {"initial": rest.state, "duration": duration + settle, "motion": motion}
    return simulate(rest.scene.with_(changes))


def _fastest(run: Callable[[float], Run], slow: float) -> tuple[float, str]:
    """The largest acceleration of a move that is held, and what gives way above it."""
    if not slow:
        return 0.0, run(1.0).status
    low, high = 0.0, _FIRST * min(slow, _FASTEST / _FIRST)
    lost = run(high)
    while lost.holds:
        if high >= _FASTEST:
            return math.inf, "none"
        low, high = high, _FIRST * high
        lost = run(high)
    while high - low > _CLOSE * high:
        middle = 0.5 * (low + high)
        tried = run(middle)
        if tried.holds:
            low = middle
        else:
            high, lost = middle, tried
    return low, lost.status if lost.status != "completed" else next(iter(lost.violations), "lost")
