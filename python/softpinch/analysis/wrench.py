"""`wrench_limits`: the largest force and moment that a grasp at rest bears in each direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..run.request import rest_scene
from ..run.run import Run
from ..scene.parts import width
from ..scene.scene import Scene, State
from ..support import Floats, Result, Texts, checks
from .rest import ROUND_OFF, Equilibrium, equilibrium

# Number of forces among the default directions.
_FORCES = 72
# The largest number of directions: each takes one to three milliseconds.
_MOST = 1_000_000


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
    given = None if directions is None else checked_directions(directions, 3)
    if length is not None:
        length = checks.positive("length", length)
    rest = equilibrium_of(grasp, time=time, shear=shear, near=near, grip=grip)
    length = 0.5 * width(rest.scene) if length is None else length
    if given is None:
        moments = np.array([[0.0, 0.0, length], [0.0, 0.0, -length]])
        given = np.vstack([np.column_stack([unit_directions(), np.zeros(_FORCES)]), moments])
    rows = np.ascontiguousarray(given)
    magnitude, limit, q = limits_of(rest, rows)
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


def equilibrium_of(grasp: object, **given: Any) -> Equilibrium:
    """The equilibrium that is meant: one, or that of a scene with these arguments."""
    if isinstance(grasp, Scene):
        return equilibrium(grasp, **given)
    if not isinstance(grasp, Equilibrium):
        raise TypeError(f"grasp = {checks.shown(grasp)}: must be a Scene or an Equilibrium")
    for name, value in given.items():
        if value is not None:
            raise ValueError(f"{name} = {checks.shown(value)}: the equilibrium has it already")
    return grasp


def unit_directions() -> Floats:
    """Vectors of length one in the default directions, from x counter-clockwise."""
    angles = np.arange(_FORCES // 4) * (2.0 * np.pi / _FORCES)
    x, y = np.cos(angles), np.sin(angles)
    # The other quarters are turned by exact right angles, so that mirror images agree to the bit.
    quarters = [(x, y), (-y, x), (-x, -y), (y, -x)]
    return np.vstack([np.column_stack(quarter) for quarter in quarters]) + 0.0


def checked_directions(directions: ArrayLike, width: int) -> Floats:
    """A user's directions (n, width), none of them zero."""
    rows = checks.array("directions", directions, ("n", width))
    if len(rows) > _MOST:
        raise ValueError(f"directions has {len(rows)} rows: must have at most {_MOST}")
    zero = np.flatnonzero((rows == 0.0).all(axis=1))
    if zero.size:
        raise ValueError(f"directions[{zero[0]}] = {(0,) * width}: must not be zero")
    return rows


def limits_of(rest: Equilibrium, loads: Floats) -> tuple[Floats, list[str], Floats]:
    """Multiples (n,) of wrenches (n, 3) or accelerations (n, 2), their limits, and q (n, 9)."""
    count = len(loads)
    if rest.state is None:
        return np.zeros(count), [rest.status] * count, np.full((count, 9), np.nan)
    if rest.growth > ROUND_OFF * np.abs(rest.eigenvalues).max():
        return np.zeros(count), ["unstable"] * count, np.tile(rest.state.q, (count, 1))
    return rest_scene(rest.scene, rest.time).limits(rest.state.q, loads)
