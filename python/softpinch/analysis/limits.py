"""The largest wrench, and the largest acceleration of the hand, that a grasp at rest bears."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..run import Run, simulate
from ..run.request import rest_scene
from ..scene import HandMotion, Scene, State
from ..scene.parts import width
from ..support import Floats, Result, Texts, checks
from .rest import ROUND_OFF, Equilibrium, equilibrium

# Number of forces among the default directions.
_FORCES = 72
# The largest number of directions: each takes one to three milliseconds.
_MOST = 1_000_000
Profile: TypeAlias = Literal["trapezoid", "minimum_jerk"]
# The duration of a move over a distance D with the peak acceleration a is this times sqrt(D / a).
_DURATIONS = {"trapezoid": 2.0, "minimum_jerk": math.sqrt(10.0 / math.sqrt(3.0))}
# The relative width at which a bisection ends.
_CLOSE = 1e-3
# The first move is as fast as this multiple of the slow limit, m/s^2 the fastest that is tried.
_FIRST, _FASTEST = 2.0, 1e5


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WrenchLimits(Result):
    """The largest wrench that a grasp at rest bears in each of n directions.

    If there is no equilibrium, or if it is unstable, every magnitude is zero, and `limit` has the
    equilibrium's status, or "unstable".

    Attributes:
        equilibrium: The equilibrium at which the wrenches begin to grow.
        directions: Force in x and y and moment on the object (n, 3), N and N m.
        magnitude: The multiple of each direction at which something gives way (n,); inf if nothing
            does.
        wrench: Magnitude times direction (n, 3), N and N m.
        limit: The cause (n,): a contact, by "pulling", "slipping" or "off_face"; a tip, by
            "separated", "crushed" or "folded"; or the balance, by "unstable": the equilibrium ends
            in a fold, no longer resists a slow displacement, or an oscillation grows. "none" if
            nothing gives way, "lost" if the search failed at this magnitude.
        q: The coordinates at which it gives way (n, 9), m and rad; where nothing does, those of the
            equilibrium.
        length: The length by which moments compare with forces, m.
    """

    equilibrium: Equilibrium
    directions: Floats
    magnitude: Floats
    wrench: Floats
    limit: Texts
    q: Floats
    length: float

    @property
    def size(self) -> Floats:
        """The size of each limiting wrench (n,), N: the norm of force and moment / `length`."""
        return np.asarray(np.linalg.norm(self.wrench / [1.0, 1.0, self.length], axis=1))

    @property
    def weakest(self) -> float:
        """The size of the smallest limiting wrench, N: a measure of the grasp's quality.

        It is the radius of the largest ball of wrenches that the grasp bears, as far as the
        directions show. Ferrari and Canny's measure (1992) has the same form for rigid contacts;
        here the contact forces are those of the deformed grasp.
        """
        return float(self.size.min())

    def __repr__(self) -> str:
        x, y, moment = self.wrench[np.argmin(self.size)]
        names, counts = np.unique(self.limit, return_counts=True)
        pairs = zip(names.tolist(), counts.tolist(), strict=True)
        each = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in pairs)
        if not self.size.any():
            return f"<WrenchLimits: not even a small wrench is borne; {self.equilibrium.message}>"
        weakest = f"weakest {self.weakest:.6g} N at ({x:.6g} N, {y:.6g} N, {moment:.6g} N m)"
        return f"<WrenchLimits of {len(self.limit)} directions: {weakest}; {each}>"


def wrench_limits(
    grasp: Scene | Equilibrium,
    directions: ArrayLike | None = None,
    *,
    time: float | None = None,
    shear: ArrayLike | None = None,
    near: State | Run | None = None,
    grip: ArrayLike | None = None,
    length: float | None = None,
) -> WrenchLimits:
    """Finds the largest force and moment on the object that a grasp at rest bears.

    A wrench on the object, beside those of the scene, grows from zero until a contact gives way: a
    tip would have to pull, or to slip (`friction` of the scene; without it tips never slip), or a
    contact leaves its face. The grasp follows in equilibrium, under the no-slip constraint (12), by
    pseudo-arclength continuation, in bilateral and in unilateral contact; the eigenvalues of the
    whole motion are watched, because a PID can make a grasp oscillate long before its balance ends.
    This is the limit of a wrench that grows so slowly that inertia, viscosity and the controller's
    lag do not matter. A wrench that is applied suddenly overshoots, and can lose the grasp down to
    about half of it; a short one may be borne above it. A grasp that slips need not be lost: in
    unilateral contact it may stick again. A scene without equilibrium bears nothing.

    Args:
        grasp: A scene, whose `equilibrium` is found first, or an equilibrium.
        directions: Forces in x and y and moments (n, 3), N and N m, of any size but zero. None
            takes 72 forces of 1 N without moment, from the direction x counter-clockwise, and the
            moments +1 N and -1 N times `length`.
        time, shear, near, grip: As for `equilibrium`; only with a scene.
        length: The length by which moments compare with forces in `weakest`, m; None takes half the
            object's width.
    """
    given = None if directions is None else _checked_directions(directions, 3)
    if length is not None:
        length = checks.positive("length", length)
    rest = _equilibrium_of(grasp, time=time, shear=shear, near=near, grip=grip)
    length = 0.5 * width(rest.scene) if length is None else length
    if given is None:
        moments = np.array([[0.0, 0.0, length], [0.0, 0.0, -length]])
        given = np.vstack([np.column_stack([_unit_directions(), np.zeros(_FORCES)]), moments])
    rows = np.ascontiguousarray(given)
    magnitude, limit, q = _limits_of(rest, rows)
    with np.errstate(invalid="ignore"):
        # Of a direction without limit, the components that are zero stay so.
        wrench = np.where(rows == 0.0, 0.0, magnitude[:, None] * rows)
    return WrenchLimits(
        equilibrium=rest,
        directions=rows,
        magnitude=magnitude,
        wrench=wrench,
        limit=np.array(limit),
        q=q,
        length=length,
    )


def _equilibrium_of(grasp: object, **given: Any) -> Equilibrium:
    """The equilibrium that is meant: one, or that of a scene with these arguments."""
    if isinstance(grasp, Scene):
        return equilibrium(grasp, **given)
    if not isinstance(grasp, Equilibrium):
        raise TypeError(f"grasp = {checks.shown(grasp)}: must be a Scene or an Equilibrium")
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} = {checks.shown(value)}: the equilibrium has it already")
    return grasp


def _unit_directions() -> Floats:
    """Vectors of length one in the default directions, from x counter-clockwise."""
    angles = np.arange(_FORCES // 4) * (2.0 * np.pi / _FORCES)
    x, y = np.cos(angles), np.sin(angles)
    # The other quarters are turned by exact right angles, so that mirror images agree to the bit.
    quarters = [(x, y), (-y, x), (-x, -y), (y, -x)]
    return np.vstack([np.column_stack(quarter) for quarter in quarters]) + 0.0


def _checked_directions(directions: ArrayLike, width: int) -> Floats:
    """A user's directions (n, width), none of them zero."""
    rows = checks.array("directions", directions, ("n", width))
    if len(rows) > _MOST:
        raise ValueError(f"directions has {len(rows)} rows: must have at most {_MOST}")
    zero = np.flatnonzero((rows == 0.0).all(axis=1))
    if zero.size:
        raise ValueError(f"directions[{zero[0]}] = {(0,) * width}: must not be zero")
    return rows


def _limits_of(rest: Equilibrium, loads: Floats) -> tuple[Floats, list[str], Floats]:
    """Multiples (n,) of wrenches (n, 3) or accelerations (n, 2), their limits, and q (n, 9)."""
    count = len(loads)
    if rest.state is None:
        return np.zeros(count), [rest.status] * count, np.full((count, 9), np.nan)
    if rest.growth > ROUND_OFF * np.abs(rest.eigenvalues).max():
        return np.zeros(count), ["unstable"] * count, np.tile(rest.state.q, (count, 1))
    return rest_scene(rest.scene, rest.time).limits(rest.state.q, loads)


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
        rows = _unit_directions()
    else:
        rows = _checked_directions(directions, 2)
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
    rest = _equilibrium_of(grasp, time=time, shear=shear, near=near, grip=grip)
    if profile is not None and rest.scene.contact != "unilateral":
        raise ValueError('profile: needs contact = "unilateral", a bilateral one is never lost')
    if rest.scene.motion is not None:
        tilt = float(rest.scene.motion.at(rest.time).tilt)
    limit, cause, _ = _limits_of(rest, rows)
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
