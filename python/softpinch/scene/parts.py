"""Other hands and objects than the paper's: jaws, parallelograms, faces, arcs, laws of the tip.

docs/own-hand.md says which kind is yours; the mathematics is in the core, `model/contact`. All
units are SI, angles are radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from ..support import SIDES, Floats, Kinded, Record, checks, extras, read_csv, read_only

if TYPE_CHECKING:
    from .hand import Finger, GraspedObject
    from .scene import Scene

# Number of parameters of a scene with the paper's parts, which come first in `_core.PARAMETERS`.
PAPERS = 38
# Number of weights of a measured law, as many as the core has: its law is a polynomial of F''.
_WEIGHTS = 10
# Resistance of the weights' second differences against noise, and the misfit beyond which no
# springs of (4) have such a force, as shares of the largest force.
_SMOOTHING, _MISFIT = 1e-3, 0.1
_LEAST = 3  # measurements
JOINT = ("joint_friction", "creep_rate")  # of dry friction


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(Kinded):
    """Base class of the mechanisms beside `Finger`."""


@dataclass(frozen=True, eq=False, repr=False)
class Jaw(Mechanism):
    """A jaw of a parallel gripper: its tip travels along a line and does not turn.

    Its coordinate is the travel towards the object, m; its torque is a force, N, and its gains are
    in N/m, N s/m and N/(m s). At the travel zero the tip's centre is at `root_offset` less
    `half_thickness` from the middle of the hand.

    Attributes:
        root_offset: From the middle of the hand to the jaw's middle, m.
        half_thickness: From there to the tip's centre, towards the object, m.
        mass: M_i, kg.
        height: Y_0, the height of the tip's centre above the hand's origin, m.
        direction: gamma, the direction of travel, upwards from that to the middle, rad.
        angle: phi_0, the angle of the tip's base to the upright, rad.
        joint_friction: As of `Finger`, N; and `creep_rate`, m/s.
    """

    root_offset: float = 0.049
    half_thickness: float = 0.0045
    mass: float = 0.1
    height: float = 0.0762
    direction: float = 0.0
    angle: float = 0.0
    joint_friction: float | None = None
    creep_rate: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Parallelogram(Mechanism):
    """A finger of two equal links that keep its tip's base at one angle.

    Its coordinate is the angle of the links, rad. The tip's centre moves on a circle.

    Attributes:
        length: L, of the links, m.
        root_offset: W_f, distance from the middle of the hand to the roots, m.
        half_thickness: d_f, from the links' end to the tip's centre, towards the object, m.
        mass: M_i, as of `Finger`, kg.
        inertia: I_i, in the coordinate, kg m^2.
        angle: phi_0, the angle of the tip's base to the upright, rad.
        joint_friction: As of `Finger`, N m; and `creep_rate`, rad/s.
    """

    length: float = 0.0762
    root_offset: float = 0.049
    half_thickness: float = 0.0045
    mass: float = 0.1
    inertia: float = 5.8e-4
    angle: float = 0.0
    joint_friction: float | None = None
    creep_rate: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class ObjectSide(Kinded):
    """Base class of the sides of a grasped object."""


@dataclass(frozen=True, eq=False, repr=False)
class Face(ObjectSide):
    """A flat side. Its middle is half the object's width from the middle of the object.

    Attributes:
        tilt: beta, positive where the object is wider at its upper end, rad.
        height: Length of the face, half of it on each side of its middle, m. None uses the
            object's height.
    """

    tilt: float = 0.0
    height: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Arc(ObjectSide):
    """A convex side, part of a circle: a bottle, a can, a rounded edge.

    Attributes:
        radius: R, m.
        center: The circle's centre from the centre of gravity, along the object's axes, m.
        span: Angle between the ends of the arc, half of it on each side of the point that is
            level with the centre, rad. None is half a turn.
        counterface: How the curvature softens the tip, whose energy (4) is that on a flat side.
            "cylinder", straight out of the plane: by (1 + a/R)^(-1/2). "sphere": by
            (1 + a/R)^(-1). "flat": not at all, for a law that was measured on the object itself.
    """

    radius: float
    center: tuple[float, float] = (0.0, 0.0)
    span: float | None = None
    counterface: str = "cylinder"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("center", checks.pair("Arc.center", self.center))
        checks.choice("Arc.counterface", self.counterface, COUNTERFACES)

    @property
    def opening(self) -> float:
        """The angle between the ends, rad: `span`, or half a turn."""
        return math.pi if self.span is None else self.span


@dataclass(frozen=True, eq=False, repr=False)
class TipLaw(Kinded):
    """Base class of the laws of a tip's force."""

    def _numbers(self) -> dict[str, float]:
        """The numbers of the law by their names in the core."""
        return {name: x for name, x in self._values().items() if isinstance(x, float)}

    def _stiffness(self, compression: Floats) -> Floats:
        """F' at compressions >= 0, N/m."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False, repr=False)
class ParallelSprings(TipLaw):
    """The paper's law (5), F = pi E d_n^2, E in Pa: as of `Fingertip(youngs_modulus=...)`."""

    youngs_modulus: float


@dataclass(frozen=True, eq=False, repr=False)
class PowerLaw(TipLaw):
    """A force F = c d_n^n of the upright tip, with shear and tilt as parallel springs have them.

    Attributes:
        coefficient: c, N/m^n.
        exponent: n, above 1. Below 2 the force of a sheared tip has a pole where it is released,
            in which a run can end; runs warn of it, and a `foot` removes it.
        foot: epsilon, m: F = c {(d + epsilon)^n - epsilon^n - n epsilon^(n-1) d}, whose relative
            change is about n epsilon / d. None is no foot.
        shear_factor: Stiffness against shear as a share of the normal stiffness F'.
    """

    coefficient: float
    exponent: float
    foot: float | None = None
    shear_factor: float = 1.0

    def _stiffness(self, compression: Floats) -> Floats:
        foot, power = self.foot or 0.0, self.exponent - 1.0
        change = np.abs(compression + foot) ** power - foot**power
        return np.asarray(self.coefficient * self.exponent * change)


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredLaw(TipLaw):
    """A measured force of the upright tip, with shear and tilt as parallel springs have them.

    F'' is the density of the springs (4), which cannot be negative. It is a polynomial of degree 9
    with weights >= 0 in Bernstein's form, fitted to the forces with a little smoothing (SciPy's
    non-negative least squares, extra `study`), so that F is smooth and convex. Beyond the last
    compression F'' keeps its last value.

    Attributes:
        compression: d_n, rising (k,), m; at least three above zero.
        force: F, above zero except in a first row (0, 0), N; it may scatter.
        shear_factor: Stiffness against shear as a share of the normal stiffness F'.

    Raises:
        ValueError: The best fit misses a force by more than a tenth of the largest one: no
            springs have such a curve, as one that saturates.
    """

    compression: Floats
    force: Floats
    shear_factor: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        compression, force = measured_curve("MeasuredLaw.", self.compression, self.force)
        self._set("compression", compression)
        self._set("force", force)
        if not self.misfit <= _MISFIT:
            k = int(np.abs(self.predicted(compression) - force).argmax())
            rule = "must be convex, without saturation or sharp bends"
            line = compression * (compression @ force / (compression @ compression))
            if np.abs(force - line).max() <= 0.5 * _MISFIT * force.max():
                rule = "a straight line from zero is the force of a flat-ended tip; F'(0) must be 0"
            raise ValueError(
                f"MeasuredLaw.force = {force[k]:g} N at {compression[k]:g} m: the best law of "
                f"springs misses it by {self.misfit:.0%} of the largest force: {rule}"
            )

    def __str__(self) -> str:
        return f"{self!r}, misfit {self.misfit:.2%}"

    @classmethod
    def from_csv(cls, path: str | Path, shear_factor: float = 1.0) -> Self:
        """Reads d_n (m) and F (N), the first columns of a CSV file; skips a heading and # lines."""
        table = read_csv(path, (2,), "two columns of numbers, in m and N", 2)
        return cls(table[:, 0], table[:, 1], shear_factor)

    @cached_property
    def weights(self) -> Floats:
        """The density of springs F'' in Bernstein polynomials over the range (10,), N/m^2."""
        optimize = extras.require("scipy.optimize", extra="study", purpose="MeasuredLaw")
        reach, largest = self.compression[-1], self.force.max()
        sizes = self.force + 0.05 * largest
        rows = _integrals(self.compression / reach, 2) * reach**2 / sizes[:, None]
        smooth = _SMOOTHING * np.diff(np.eye(_WEIGHTS), n=2, axis=0) * reach**2 / largest
        right = np.concatenate([self.force / sizes, np.zeros(len(smooth))])
        return read_only(optimize.nnls(np.concatenate([rows, smooth]), right)[0])

    def predicted(self, compression: Floats) -> Floats:
        """The fitted force at compressions within the range, N."""
        reach, given = self.compression[-1], checks.numbers("compression", compression)
        if not np.all((given >= 0.0) & (given <= reach)):
            rule = f"must be within the measured range, from 0 to {reach:g} m"
            raise ValueError(f"compression = {checks.shown(given.tolist())}: {rule}")
        return np.asarray(_integrals(given / reach, 2) @ self.weights * reach**2)

    def _numbers(self) -> dict[str, float]:
        return super()._numbers() | {"range": float(self.compression[-1])}

    def _stiffness(self, compression: Floats) -> Floats:
        reach = self.compression[-1]
        within = np.minimum(compression, reach)
        found = _integrals(within / reach, 1) @ self.weights * reach
        return np.asarray(found + (compression - within) * self.weights[-1])

    @cached_property
    def misfit(self) -> float:
        """The largest difference between fitted and measured forces over the largest force."""
        return float(np.abs(self.predicted(self.compression) - self.force).max() / self.force.max())


@dataclass(frozen=True, eq=False, repr=False)
class Maxwell(Record):
    """A Maxwell branch of a tip, with which its force relaxes: a standard linear solid.

    A quick deformation meets the tip's law and `share` of it besides, in compression and in shear.
    If it is held, the share fades as exp(-t / time). A start whose `State` says nothing else has
    relaxed, so that branches change no equilibrium.

    Attributes:
        share: g, what the branch adds at once, as a share of the law.
        time: tau, s.
    """

    share: float
    time: float


def measured_curve(owner: str, compression: object, force: object) -> tuple[Floats, Floats]:
    """Checks compressions and forces (k,) of a measured law; `owner` begins names in errors."""
    d = checks.increasing(f"{owner}compression", compression)
    f = checks.array(f"{owner}force", force, ("k",))
    checks.same_length(f"{owner}force", f, "compression", len(d))
    if d[0] == f[0] == 0.0:
        d, f = d[1:], f[1:]
    for name, values in (("compression", d), ("force", f)):
        if len(values) < _LEAST or not values.min() > 0.0:
            rule = f"must be at least {_LEAST} numbers above zero, after a first row (0, 0) if any"
            raise ValueError(f"{owner}{name} = {checks.shown(values.tolist())}: {rule}")
    return d, f


def _integrals(x: Floats, times: int) -> Floats:
    """Integrals of the Bernstein polynomials of degree 9, so many `times` (k, 10), 0 <= x <= 1."""
    n = _WEIGHTS - 1 + times
    found = np.stack([math.comb(n, k) * x**k * (1.0 - x) ** (n - k) for k in range(n + 1)], axis=-1)
    for degree in range(n, _WEIGHTS - 1, -1):
        # The integral of the k-th polynomial is the sum of those above it, of one degree more.
        found = found @ np.tril(np.ones((degree + 1, degree + 1)), -1)[:, :degree] / degree
    return np.asarray(found)


def sides_of(grasped: GraspedObject) -> tuple[ObjectSide | None, ObjectSide | None]:
    """The right and the left side of an object; None is a face parallel to the other one."""
    return grasped.right, grasped.left


def half_widths(scene: Scene) -> tuple[float, float]:
    """Distances from the centre of gravity to the middles of the right and the left side, m."""
    grasped = scene.grasped
    right, left = (
        side.radius + sign * side.center[0]
        if isinstance(side, Arc)
        else 0.5 * grasped.width - sign * grasped.com_offset
        for sign, side in zip((1.0, -1.0), sides_of(grasped), strict=True)
    )
    return right, left


def width(scene: Scene) -> float:
    """The distance between the middles of the object's sides, m."""
    arcs = any(isinstance(side, Arc) for side in sides_of(scene.grasped))
    return sum(half_widths(scene)) if arcs else scene.grasped.width


def half_lengths(scene: Scene) -> tuple[float, float]:
    """Half the length of the right and the left side, m; infinite of sides without ends."""
    height = scene.grasped.height or math.inf
    right, left = (
        side.radius * side.opening if isinstance(side, Arc) else getattr(side, "height", height)
        for side in sides_of(scene.grasped)
    )
    return 0.5 * (right or height), 0.5 * (left or height)


def refuse_crossed(scene: Scene) -> None:
    """Refuses sides of the object that cross; of arcs and endless faces only middles count."""
    apart, sides = sum(half_widths(scene)), sides_of(scene.grasped)
    tilts = [side.tilt if isinstance(side, Face) else 0.0 for side in sides]
    up = min(half * math.cos(tilt) for half, tilt in zip(half_lengths(scene), tilts, strict=True))
    ends = math.isfinite(up) and not any(isinstance(side, Arc) for side in sides)
    least = apart - (abs(sum(map(math.tan, tilts))) * up if ends else 0.0)
    if not least > 0.0:
        found = f"{1e3 * apart:.4g} mm apart at their middles, {1e3 * least:.4g} mm at least"
        raise ValueError(f"Scene.grasped: its sides are {found}: must not meet or cross")


def numbers(scene: Scene) -> dict[str, float]:
    """The numbers of parts that are not the paper's, by their paths in `_core.PARAMETERS`."""
    found: dict[str, float] = {}

    def put(place: str, kind: float, **own: float) -> None:
        found.update({f"{place}.{name}": number for name, number in {"kind": kind, **own}.items()})

    fingers = (scene.hand.right, scene.hand.left)
    for k, (name, side) in enumerate(zip(SIDES, sides_of(scene.grasped), strict=True)):
        finger, law = fingers[k], scene.hand.tips[k].law
        kind = 1.0 if isinstance(finger, Jaw) else 2.0 if isinstance(finger, Parallelogram) else 0.0
        own = finger._values() if kind else {key: getattr(finger, key) for key in JOINT}
        rubs = float(finger.joint_friction is not None)
        put(f"hand.{name}", kind, rubs=rubs, **{k: x for k, x in own.items() if x is not None})
        if isinstance(side, Face):
            put(f"grasped.{name}", 1.0, tilt=side.tilt, height=2.0 * half_lengths(scene)[k])
        if isinstance(side, Arc):
            x, y = side.center
            own = {"radius": side.radius, "center_x": x, "center_y": y, "span": side.opening}
            put(f"grasped.{name}", 2.0, counterface=COUNTERFACES[side.counterface], **own)
        if law is not None:
            # The core numbers the laws in the order of the table.
            kind = float([*TipLaw._kinds.values()].index(type(law)))
            put(f"hand.tip.{name}.law", kind, **law._numbers())
        branches = scene.hand.tips[k].relaxation or ()
        found[f"hand.tip.{name}.law.branches"] = float(len(branches))
        for n, branch in enumerate(branches):
            place = f"hand.tip.{name}.relaxation.{n}"
            found |= {f"{place}.share": branch.share, f"{place}.time": branch.time}
    return found


def others(scene: Scene) -> list[str]:
    """The parts of a scene that are not the paper's, in words."""
    fingers, laws = (scene.hand.right, scene.hand.left), (tip.law for tip in scene.hand.tips)
    found = [type(part).__name__ for part in (*fingers, *sides_of(scene.grasped), *laws)]
    found += ["Maxwell branch"] if branches(scene) else []
    found += ["joint_friction"] if not all(x.joint_friction is None for x in fingers) else []
    return [name for name in dict.fromkeys(found) if name not in ("Finger", "NoneType")]


def branches(scene: Scene) -> int:
    """The number of Maxwell branches of the tip that has more of them."""
    return max(len(tip.relaxation or ()) for tip in scene.hand.tips)


def stiffness(scene: Scene, side: int, compression: Floats) -> Floats:
    """The normal stiffness of an upright tip at compressions d_n >= 0, N/m: 2 pi E d_n by (5)."""
    tip, d = scene.hand.tips[side], np.asarray(compression)
    found = 2.0 * np.pi * tip.youngs_modulus * d if tip.law is None else tip.law._stiffness(d)
    return np.asarray(softened(scene)[side] * found)


def softened(scene: Scene) -> tuple[float, float]:
    """The shares of their energy (4) that the right and the left tip have on arcs."""
    right, left = (
        (1.0 + tip.radius / side.radius) ** _SOFTER[side.counterface]
        if isinstance(side, Arc)
        else 1.0
        for tip, side in zip(scene.hand.tips, sides_of(scene.grasped), strict=True)
    )
    return right, left


def lever(finger: Finger | Jaw | Parallelogram) -> float:
    """The most that a tip's centre moves for a unit of the finger's coordinate, m."""
    if isinstance(finger, Jaw):
        return 1.0
    thick = 0.0 if isinstance(finger, Parallelogram) else finger.half_thickness
    return math.hypot(finger.length, thick)


def refuse_others(scene: Scene, name: str) -> None:
    """Refuses a scene with other parts than the paper's, in the name of what lacks them."""
    found = others(scene)
    if found:
        one = f"{'an' if found[0][0] in 'AEIOU' else 'a'} {found[0]}"
        raise ValueError(
            f"scene: {name} does not take {one} yet; it has the paper's links, parallel faces and "
            'springs only (docs/own-hand.md, "What takes what")'
        )


def jaws(scene: Scene) -> tuple[bool, bool]:
    """Whether the right and the left finger is a jaw, whose coordinate is a length."""
    return isinstance(scene.hand.right, Jaw), isinstance(scene.hand.left, Jaw)


def why_fixed(scene: Scene, path: str) -> str | None:
    """Why a number of a scene has no effect, or cannot differ between runs; None if it can."""
    *owner, name = path.split(".")
    sides = [side for side in SIDES if side in owner] or SIDES
    laws = [tip.law for side, tip in zip(SIDES, scene.hand.tips, strict=True) if side in sides]
    if name == "youngs_modulus" and any(laws):
        return "a tip has a law of its own, without this modulus"
    if name in JOINT and getattr(getattr(scene.hand, owner[-1]), name) is None:
        return "is None; give it a value in the scene first"
    if name == "creep_rate" and getattr(scene.hand, owner[-1]).joint_friction is None:
        return "the joint has no friction"
    if "law" in owner and {"compression", "force"} & {*owner, name}:
        return "all runs share a measured curve; its shear_factor can differ"
    if owner[:1] == ["grasped"] and name == "center":
        return f"is a pair; {path}.0 and {path}.1 can differ"
    found = sides_of(scene.grasped)
    if path in ("grasped.width", "grasped.com_offset", "grasped.height"):
        if all(isinstance(side, Arc) for side in found):
            return "both sides of the object are arcs, which have places and ends of their own"
        ends = [isinstance(side, Arc) or getattr(side, "height", None) for side in found]
        if name == "height" and all(ends):
            return "both sides of the object have ends of their own"
    return None


def in_words(
    scene: Scene, coordinates: Sequence[float] | Floats, digits: str = ".4g", *, same: bool = True
) -> str:
    """Both fingers' coordinates in words, in degrees or mm; equal ones once if `same`."""
    own = jaws(scene)
    units = ["mm" if jaw else "degrees" for jaw in own]
    shown = [
        f"{round(1e3 * value if jaw else math.degrees(value), 6):{digits}}"
        for jaw, value in zip(own, coordinates, strict=True)
    ]
    if units[0] == units[1]:
        return f"{' and '.join(dict.fromkeys(shown) if same else shown)} {units[0]}"
    return f"{shown[0]} {units[0]} and {shown[1]} {units[1]}"


Mechanism._kinds = {"jaw": Jaw, "parallelogram": Parallelogram}
ObjectSide._kinds = {"face": Face, "arc": Arc}
TipLaw._kinds = {"springs": ParallelSprings, "power": PowerLaw, "measured": MeasuredLaw}
# The exponents of (1 + a/R) by which an arc softens a tip.
_SOFTER = {"flat": 0.0, "cylinder": -0.5, "sphere": -1.0}
# The numbers of the kinds, as the core has them.
COUNTERFACES: Mapping[str, float] = {"flat": 0.0, "cylinder": 1.0, "sphere": 2.0}
