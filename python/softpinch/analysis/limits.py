"""The largest wrench, and the largest acceleration of the hand, that a grasp at rest bears."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..run import Run
from ..run.options import Options
from ..run.request import Request, rest_scene
from ..run.simulate import faults_of_steps
from ..scene import HandMotion, Scene, State, usual
from ..scene.control import require_known_torque
from ..scene.loop_matrix import NEUTRAL
from ..scene.motion import ConstantMotion
from ..scene.parts import width
from ..support import Floats, Formulation, Method, Result, Texts, checks
from .rest import ROUND_OFF, Equilibrium, equilibrium

# Number of forces among the default directions.
_FORCES = 72
# The largest number of directions: each takes one to three milliseconds.
_MOST = 1_000_000
Profile: TypeAlias = Literal["trapezoid", "minimum_jerk"]
# The duration of a move over a distance D with the peak acceleration a is this times sqrt(D / a).
_DURATIONS = {"trapezoid": 2.0, "minimum_jerk": math.sqrt(10.0 / math.sqrt(3.0))}
# Peaks of the first, slowest and fastest move, m/s^2; relative width at which a bisection ends.
_FIRST, _SLOWEST, _FASTEST, _CLOSE = 20.0, 1e-3, 1e5, 1e-3
_PEAKS = 30  # tried below a limit
# The statuses of runs that say nothing about the grasp.
_FAILED = ("not_finite", "unstable", "newton_failed", "step_too_small", "too_many_steps")


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
        grasp: A scene without a `SampledController`, or its equilibrium, which is found first.
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
    if _is_unstable(rest):
        return np.zeros(count), ["unstable"] * count, np.tile(rest.state.q, (count, 1))
    advice = "simulate and carry_limits(profile=...) take it"
    require_known_torque(rest.scene.law, "a load that grows slowly", advice)
    return rest_scene(rest.scene, rest.time).limits(rest.state.q, loads)


def _is_unstable(rest: Equilibrium) -> bool:
    round_off = NEUTRAL if rest.scene.law == "sampled" else ROUND_OFF
    return bool(rest.growth > round_off * np.abs(rest.eigenvalues).max())


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CarryLimits(Result):
    """The largest acceleration of the hand that a grasp bears in each of n directions.

    With an array of m tilts, `limit` and `cause` are (m, n), and there are m equilibria.

    Attributes:
        equilibrium: The equilibrium from which the hand is accelerated, or one for each tilt.
        direction: Direction of the acceleration along fixed axes (n, 2), of length one.
        limit: The largest acceleration (n,), m/s^2; inf if nothing gives way.
        cause: What gives way first (n,): as `WrenchLimits.limit`; of moves, the status of a run
            that is lost ("chattering" and "no_mode" too), or a violation; "none" if nothing does.
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
    dt: float | None = None,
    method: Method = "rk4",
    formulation: Formulation = "csm",
    tolerance: float | None = None,
) -> CarryLimits:
    """Finds the largest acceleration of the hand that a grasp at rest bears.

    Without a `profile` the acceleration of the hand's frame grows from zero so slowly that the
    grasp stays in equilibrium, until a contact gives way, as the wrench does in `wrench_limits`:
    inertial forces act on object and fingers. With a `profile` the hand moves over `distance` from
    rest to rest and stays there for `settle`; a bisection finds, to 0.1 %, the peak acceleration
    above which the grasp no longer holds (`Run.holds`). A fast move ends before a grasp is lost,
    and excites it, so this limit may lie above the slow one or below it. A slower move may be lost
    too: 30 peaks below a limit, evenly spaced, are tried, and a loss among them is it. Losses
    between two of these peaks can be missed, and some moves above the limit may be held.

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
        dt, method, formulation, tolerance: As for `simulate`, of the moves.

    Raises:
        ValueError: With a `profile`: the scene's motion is no constant tilt, its contact is
            bilateral, or a run fails numerically. Without: it has a `SampledController`.
    """
    options = Options.checked(dt, method, formulation, tolerance=tolerance)
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
        how |= {"distance": distance, "settle": settle, "profile": profile, "dt": dt}
        how |= {"method": method, "formulation": formulation, "tolerance": tolerance}
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
    motion = rest.scene.motion
    tilt = 0.0 if motion is None else float(motion.at(rest.time).tilt)
    if profile is not None and rest.scene.contact != "unilateral":
        raise ValueError('profile: needs contact = "unilateral", a bilateral one is never lost')
    if profile is None or rest.state is None or _is_unstable(rest):
        limit, cause, _ = _limits_of(rest, rows)
    elif not isinstance(motion, ConstantMotion | None) or (motion and any(motion.acceleration)):
        rule = "must be None or HandMotion.constant(tilt=...), whose place the move takes"
        raise ValueError(f"Scene.motion: with profile = {profile!r} it {rule}")
    else:
        usual.warn(rest.scene)
        start = Request(rest.scene.with_({"initial": rest.state}), options)
        loses = partial(_cause_of_loss, start, profile, settle, tilt)
        found = [_fastest(partial(loses, way)) for way in distance * rows]
        limit, cause = np.array([a for a, _ in found]), [name for _, name in found]
    causes = np.array(cause)
    return CarryLimits(
        equilibrium=rest, direction=rows, limit=limit, cause=causes, profile=profile, tilt=tilt
    )


def _cause_of_loss(
    start: Request, profile: Profile, settle: float, tilt: float, way: Floats, peak: float
) -> str:
    """What gives way in a move along `way` (2,), m, with a peak acceleration, m/s^2; or ""."""
    duration = _DURATIONS[profile] * math.sqrt(np.hypot(*way) / peak)
    times, points = start.scene.start().time + np.array([0.0, duration]), np.outer([0.0, 1.0], way)
    shape: dict[str, Any] = {"acceleration": peak} if profile == "trapezoid" else {}
    motion = getattr(HandMotion, profile)(times, points, tilts=tilt, **shape)
    changes = {"duration": duration + settle, "motion": motion}
    request = start.with_(start.scene.with_(changes))
    result = request.run_to_end()
    status, faults = result["status"], faults_of_steps(request, result)
    if faults or status in _FAILED:
        move = f"the run of a move by {way.tolist()} m with a peak of {peak:.6g} m/s^2"
        raise ValueError(f"profile: {move} failed: {'; '.join(faults) or result['message']}")
    cause = status if status != "completed" else next(iter(result["violations"]), "lost")
    return "" if result["holds"] else cause


def _fastest(loses: Callable[[float], str]) -> tuple[float, str]:
    """The largest peak below which no move is seen to be lost, and the cause of losses above it."""
    low, high = 0.0, _FIRST
    while not (cause := loses(high)):
        if high >= _FASTEST:
            return math.inf, "none"
        low, high = high, 2.0 * high
    low, cause = _bisect(loses, low, high, cause)
    peaks = np.linspace(0.0, low, _PEAKS + 2).tolist() if low else []
    for held, peak in pairwise(peaks[:-1]):
        if found := loses(peak):
            return _bisect(loses, held, peak, found)
    return low, cause


def _bisect(loses: Callable[[float], str], low: float, high: float, why: str) -> tuple[float, str]:
    """A peak that is held, just below one that is lost, and the cause of that loss."""
    while high - low > _CLOSE * high and high > _SLOWEST:
        middle = 0.5 * (low + high)
        if found := loses(middle):
            high, why = middle, found
        else:
            low = middle
    return low, why
