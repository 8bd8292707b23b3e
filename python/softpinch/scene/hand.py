"""The hand and the grasped object of a scene.

The default values are ours, because the available text of the paper lacks its Tables I and II; see
`softpinch.paper.PARAMETER_NOTE`. All units are SI, angles are radians. Finger 1 of the paper is the
right finger and always comes first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Self

from ..support import checks
from ..support.record import SIDES, Kinded, Parser, Record, array_of
from .parts import (
    Arc,
    Face,
    Jaw,
    Maxwell,
    Mechanism,
    ObjectSide,
    Parallelogram,
    ParallelSprings,
    TipLaw,
    refuse_others,
)

if TYPE_CHECKING:
    from .scene import Scene

# Most Maxwell branches of a tip, as many as the core has.
_BRANCHES = 2


def one_or_pair(cls: type[Record]) -> Parser:
    """Returns a parser of one record for both fingers, or of a table with `right` and `left`."""

    def parse(data: Any, path: str) -> Any:
        if not (isinstance(data, Mapping) and data and set(data) <= set(SIDES)):
            return cls._parse(data, path)
        return tuple(cls._parse(data.get(side, {}), checks.below(path, side)) for side in SIDES)

    return parse


def links(scene: Scene, name: str) -> tuple[Finger, Finger]:
    """The fingers of a scene with the paper's parts; refuses others, in the name of the caller."""
    refuse_others(scene, name)
    right, left = scene.hand.right, scene.hand.left
    assert isinstance(right, Finger) and isinstance(left, Finger)
    return right, left


def name_sides(value: Any, data: dict[str, Any], name: str) -> dict[str, Any]:
    """Replaces a pair in `data` by a table with the keys `right` and `left`."""
    if isinstance(value, tuple):
        data[name] = dict(zip(SIDES, data[name], strict=True))
    return data


def take_one_or_pair(name: str, value: object, cls: type[Record]) -> object:
    """Checks a field for one record or a pair of records, which becomes a tuple (right, left)."""
    members = tuple(value) if isinstance(value, tuple | list) else (value,)
    if isinstance(value, cls) or (len(members) == 2 and all(isinstance(m, cls) for m in members)):
        return value if isinstance(value, cls) else members
    rule = f"must be a {cls.__name__} or a pair of them, (right, left)"
    raise TypeError(f"{name} = {checks.shown(value)}: {rule}")


def or_other(paper: Parser, others: type[Kinded]) -> Parser:
    """Returns a parser of the paper's part, or of another one, whose table has a `kind`."""

    def parse(data: Any, path: str) -> Any:
        other = isinstance(data, Mapping) and "kind" in data
        return others._parse(data, path) if other else paper(data, path)

    return parse


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Finger(Record):
    """A rigid finger that rotates about its root.

    Attributes:
        length: L, distance from the root to the fingertip's centre along the finger, m.
        root_offset: W_f, distance from the middle of the hand to the root, m.
        half_thickness: d_f, half the finger's thickness, m.
        mass: M_i, which enters gravity (16) and, if the hand moves, the forces of inertia, kg.
        inertia: I_i, moment of inertia about the root, kg m^2.
        joint_friction: f of dry friction, -f w / sqrt(w^2 + v^2) at the rate w, N m. None is none.
        creep_rate: v, rad/s, with which a joint creeps under 0.7 f. None is 0.01.
    """

    length: float = 0.0762
    root_offset: float = 0.049
    half_thickness: float = 0.0045
    mass: float = 0.1
    inertia: float = 5.8e-4
    joint_friction: float | None = None
    creep_rate: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fingertip(Record):
    """A hemispherical soft fingertip with elastic energy (5) and Voigt viscosity (44, 45).

    Attributes:
        radius: a, m.
        youngs_modulus: E, Pa.
        normal_viscosity: c_n, as `tangential_viscosity` is c_t, N s/m.
        tilt_coupling: kappa, the factor of d_n^2 d_t tan(theta_p) in (5). +1 is the printed
            equation, -1 follows from the paper's springs together with its kinematics, 0 omits
            the term.
        normal_mass: m_n, the mass that moves with the compression d_n, as `tangential_mass`, m_t,
            with the shear d_t (14), kg. None uses the object's mass, as the paper does, and follows
            its changes.
        law: A `PowerLaw` or another law, which takes the place of (5). None is (5), and so is
            `ParallelSprings`, whose modulus becomes that of the tip.
        relaxation: One `Maxwell` branch or two, with which forces relax. None is a tip that
            remembers nothing.
    """

    radius: float = 0.020
    youngs_modulus: float = 0.30e6
    normal_viscosity: float = 100.0
    tangential_viscosity: float = 100.0
    tilt_coupling: float = 1.0
    normal_mass: float | None = None
    tangential_mass: float | None = None
    law: TipLaw | None = None
    relaxation: tuple[Maxwell, ...] | None = None

    _parsers: ClassVar[Mapping[str, Parser]] = {
        "law": TipLaw._parse,
        "relaxation": array_of(Maxwell, "Fingertip.relaxation"),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law is not None:
            checks.instance("Fingertip.law", self.law, TipLaw)
            own = getattr(self.law, "youngs_modulus", Fingertip.youngs_modulus)
            if self.youngs_modulus not in (own, Fingertip.youngs_modulus):
                rule = f"give this modulus or law = {checks.shown(self.law)}, not both"
                raise ValueError(f"Fingertip.youngs_modulus = {self.youngs_modulus}: {rule}")
        if isinstance(self.law, ParallelSprings):
            self._set("youngs_modulus", self.law.youngs_modulus)
            self._set("law", None)
        if self.relaxation is not None:
            given, rule = self.relaxation, "must be one Maxwell or two of them"
            branches = given if isinstance(given, tuple | list) else (given,)
            if not all(isinstance(branch, Maxwell) for branch in branches):
                raise TypeError(f"Fingertip.relaxation = {checks.shown(given)}: {rule}")
            if not 1 <= len(branches) <= _BRANCHES:
                raise ValueError(f"Fingertip.relaxation = {checks.shown(given)}: {rule}")
            self._set("relaxation", tuple(branches))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Hand(Record):
    """Two fingers with their fingertips.

    Attributes:
        right: Finger 1, as `left` is finger 2: a `Finger`, a `Jaw` or a `Parallelogram`.
        tip: One fingertip for both fingers, or a pair (right, left).
    """

    right: Finger | Jaw | Parallelogram = field(default_factory=Finger)
    left: Finger | Jaw | Parallelogram = field(default_factory=Finger)
    tip: Fingertip | tuple[Fingertip, Fingertip] = field(default_factory=Fingertip)

    _parsers: ClassVar[Mapping[str, Parser]] = {
        "right": or_other(Finger._parse, Mechanism),
        "left": or_other(Finger._parse, Mechanism),
        "tip": one_or_pair(Fingertip),
    }

    def __post_init__(self) -> None:
        for side in SIDES:
            kinds, words = (Finger, Mechanism), "a Finger, a Jaw or a Parallelogram"
            checks.instance(f"Hand.{side}", getattr(self, side), kinds, words)
        self._set("tip", take_one_or_pair("Hand.tip", self.tip, Fingertip))

    @property
    def tips(self) -> tuple[Fingertip, Fingertip]:
        """The right and the left fingertip, which may be one and the same."""
        return self.tip if isinstance(self.tip, tuple) else (self.tip, self.tip)

    def to_dict(self) -> dict[str, Any]:
        """Converts to a dictionary; a pair of tips becomes a table with `right` and `left`."""
        return name_sides(self.tip, super().to_dict(), "tip")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class GraspedObject(Record):
    """The grasped object: a rigid body between two sides, which are parallel faces unless given.

    `box`, `cylinder`, `disc` and `wedge` compute the inertia and the sides of uniform bodies.
    `inertia` is a value of its own, which does not follow changes of mass and width:
    `simulate` warns if it is less than that of a uniform box of the mass and the width, or more
    than bodies of the mass between the faces usually have.

    Attributes:
        width: W, distance between the faces, m.
        mass: M, kg.
        inertia: I, moment of inertia about the centre of gravity, about the axis normal to the
            plane, kg m^2. The default is that of a cube with the default width and mass.
        com_offset: w, distance of the centre of gravity from the middle of the object, positive
            towards finger 1, m.
        height: Height of the faces, half of it on each side of the centre of gravity, m. A contact
            beyond their ends is reported as the violation "off_face"; it changes nothing in the
            motion. None is faces without an end.
        right: The side that finger 1 touches, as `left` is that of finger 2: a `Face` or an `Arc`.
            None is a face parallel to the other one.
    """

    width: float = 0.049
    mass: float = 0.1
    inertia: float = 4.0e-5
    com_offset: float = 0.0
    height: float | None = None
    right: ObjectSide | None = None
    left: ObjectSide | None = None

    _parsers: ClassVar[Mapping[str, Parser]] = dict.fromkeys(SIDES, ObjectSide._parse)

    def __post_init__(self) -> None:
        super().__post_init__()
        for side in SIDES:
            if (own := getattr(self, side)) is not None:
                checks.instance(f"GraspedObject.{side}", own, ObjectSide, "a Face or an Arc")

    @classmethod
    def disc(cls, diameter: float, mass: float) -> Self:
        """A uniform disc or cylinder held by its round side: a bottle or a can from above.

        The diameter 2 R is in m, the mass M in kg, and the inertia is M R^2 / 2.

            >>> import softpinch as sp
            >>> sp.GraspedObject.disc(diameter=0.06, mass=0.2).right
            Arc(radius=0.03)
        """
        radius = 0.5 * checks.positive("diameter", diameter)
        mass = checks.positive("mass", mass)
        side, inertia = Arc(radius), 0.5 * mass * radius * radius
        return cls(width=2.0 * radius, mass=mass, inertia=inertia, right=side, left=side)

    @classmethod
    def wedge(cls, width: float, height: float, mass: float, angle: float) -> Self:
        """A uniform wedge, whose faces are both tilted.

        Contacts are on the faces up to half the height above and below the centre of gravity.

        Args:
            width: Distance between the faces at the height of the centre of gravity, m.
            height, mass: H, from its lower to its upper end, m; M, kg.
            angle: Tilt of each face, positive where the object is wider at its upper end, rad.
        """
        width, height = checks.positive("width", width), checks.positive("height", height)
        mass, rule = checks.positive("mass", mass), "must be between -pi/2 and pi/2"
        angle = checks.number_that("angle", angle, lambda x: abs(x) < 0.5 * math.pi, rule)
        rise = math.tan(angle) * height
        # W = m + rise^2 / (3 m), where the width halfway up is m.
        root = width * width - 4.0 / 3.0 * rise * rise
        middle = 0.5 * (width + math.sqrt(max(root, 0.0)))
        if root < 0.0 or middle <= abs(rise):
            rule = f"must leave a width at both ends of an object {width:g} m wide"
            raise ValueError(f"angle = {angle}: {rule}")
        offset = rise * height / (6.0 * middle)
        square = (middle * middle + rise * rise + height * height) / 12.0 - offset * offset
        face = Face(tilt=angle, height=height / math.cos(angle))
        inertia = mass * square
        return cls(width=width, mass=mass, inertia=inertia, height=height, right=face, left=face)

    @classmethod
    def box(cls, width: float, height: float, mass: float) -> Self:
        """A uniform box with a width W between its faces of height H, m, and the mass M, kg.

        The inertia about the axis normal to the plane is M (W^2 + H^2) / 12.

            >>> import softpinch as sp
            >>> sp.GraspedObject.box(width=0.04, height=0.08, mass=0.3)
            GraspedObject(width=0.04, mass=0.3, inertia=0.0002, height=0.08)
        """
        width, height = checks.positive("width", width), checks.positive("height", height)
        mass = checks.positive("mass", mass)
        inertia = mass * (width * width + height * height) / 12.0
        return cls(width=width, mass=mass, inertia=inertia, height=height)

    @classmethod
    def cylinder(cls, length: float, radius: float, mass: float) -> Self:
        """A uniform cylinder of length L and radius R, m, and mass M, kg, held by its flat ends.

        The width is the length, and the height is the diameter of the ends. `disc` is held by
        its round side. The inertia about the axis normal to the plane is M (3 R^2 + L^2) / 12.

            >>> import softpinch as sp
            >>> sp.GraspedObject.cylinder(length=0.04, radius=0.02, mass=0.12)
            GraspedObject(width=0.04, mass=0.12, inertia=2.8e-05, height=0.04)
        """
        length, radius = checks.positive("length", length), checks.positive("radius", radius)
        mass = checks.positive("mass", mass)
        inertia = mass * (3.0 * radius * radius + length * length) / 12.0
        return cls(width=length, mass=mass, inertia=inertia, height=2.0 * radius)
