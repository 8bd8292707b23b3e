"""The terms of motion of other parts: jaws and parallelograms, tilted faces and arcs, other laws.

What is written down here is where things are: the centre and the direction of a tip's base, the
point and the outward normal of the side that is nearest to that centre, the velocities there of two
rigid bodies, the tip's base and the object, and the energy of the springs of the tip. Rows, biases,
the rate of the tilt, forces and couples come out of these by differentiation. Nothing is taken from
the paper's hand of `lagrangian`, so that a link on a parallel face compares both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from math import comb, factorial, inf
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

import softpinch

from .contact_terms import SIGNS, Terms
from .lagrangian import turn

# Numbers of each kind, in the order in which the functions below take them.
MECHANISMS: dict[type, tuple[str, ...]] = {
    softpinch.Finger: ("length", "root_offset", "half_thickness"),
    softpinch.Jaw: ("root_offset", "half_thickness", "height", "direction", "angle"),
    softpinch.Parallelogram: ("length", "root_offset", "half_thickness", "angle"),
}
FACE, ARC = ("middle", "tilt"), ("radius", "center_x", "center_y")
LAWS = {
    "springs": ("youngs_modulus",),
    "power": ("coefficient", "exponent"),
    "power with a foot": ("coefficient", "exponent", "foot"),
    "measured": ("reach", *(f"density{k}" for k in range(10))),
}
# How an arc softens the tip: exponents of 1 + a/R.
SOFTENED = {"flat": 0.0, "cylinder": -0.5, "sphere": -1.0}

# The coordinates of one contact: those of the object, the finger's, the compression and the shear.
_q = sp.symbols("x y theta z d_n d_t", real=True)
_p = sp.symbols("x_rate y_rate theta_rate z_rate d_n_rate d_t_rate", real=True)
_s, _a, _tilt, _chi, _kappa, _eta = sp.symbols("s a tilt chi kappa eta", real=True)


def _rate(expression: Any) -> Any:
    return sum(sp.diff(expression, q) * p for q, p in zip(_q, _p, strict=True))


def _direction(angle: Any) -> Any:
    return sp.Matrix([sp.cos(angle), sp.sin(angle)])


class Placed(NamedTuple):
    """What a mechanism does with its coordinate.

    Attributes:
        centre: Of the tip's base (2,).
        angle: By which the base is turned inward from upright.
        weight: The height of the mass.
    """

    centre: Any
    angle: Any
    weight: Any


def _placed(kind: type, numbers: dict[str, Any]) -> Placed:
    z, inward, up = _q[3], sp.Matrix([_s, 0]), sp.Matrix([0, 1])
    root = -numbers["root_offset"] * inward
    if kind is softpinch.Jaw:
        # It travels along a line, which is turned from the inward axis.
        way = sp.cos(numbers["direction"]) * inward + sp.sin(numbers["direction"]) * up
        centre = root + numbers["half_thickness"] * inward + numbers["height"] * up + z * way
        return Placed(centre, numbers["angle"], centre[1])
    along = sp.sin(z) * inward + sp.cos(z) * up
    joint = root + numbers["length"] * along
    if kind is softpinch.Parallelogram:
        return Placed(joint + numbers["half_thickness"] * inward, numbers["angle"], joint[1])
    across = sp.cos(z) * inward - sp.sin(z) * up
    return Placed(joint + numbers["half_thickness"] * across, z, joint[1])


class Foot(NamedTuple):
    """The point of a side that is nearest to the centre of a tip.

    Attributes:
        distance: From the centre to it, negative within the object.
        outward: The side's normal there (2,).
        place: How far up the side it is from the side's middle.
    """

    distance: Any
    outward: Any
    place: Any


def _foot(centre: Any, side: tuple[str, ...], numbers: dict[str, Any]) -> Foot:
    x, y, theta = _q[:3]
    right, up = _direction(theta), turn(_direction(theta))
    to_side = -_s * right
    if side == ARC:
        middle = sp.Matrix([x, y]) + numbers["center_x"] * right + numbers["center_y"] * up
        ray = centre - middle
        length = sp.sqrt(ray.dot(ray))
        around = sp.atan2(ray.dot(up), ray.dot(to_side))
        return Foot(length - numbers["radius"], ray / length, numbers["radius"] * around)
    middle = sp.Matrix([x, y]) + numbers["middle"] * to_side
    # The upper end is further out where the object is wider there.
    upward = sp.cos(numbers["tilt"]) * up + sp.sin(numbers["tilt"]) * to_side
    outward = sp.cos(numbers["tilt"]) * to_side - sp.sin(numbers["tilt"]) * up
    return Foot((centre - middle).dot(outward), outward, (centre - middle).dot(upward))


@cache
def geometry(kind: type, side: tuple[str, ...]) -> Callable[..., list[float]]:
    """`geometry_terms` as a function of floats."""
    return _compiled(*geometry_terms(kind, side))


@cache
def geometry_terms(kind: type, side: tuple[str, ...]) -> tuple[tuple[Any, ...], list[Any]]:
    """(q, p, s, a, numbers of the mechanism, numbers of the side) of one contact -> its terms.

    These are rows H and N of Phi and T by x, y, theta and z, twelve numbers, both biases, the gap,
    the place on the side, the tilt, and the derivative of the height of the finger's mass.
    """
    own = {name: sp.Symbol(f"mechanism_{name}", real=True) for name in MECHANISMS[kind]}
    shape = {name: sp.Symbol(f"side_{name}", real=True) for name in side}
    mechanism = _placed(kind, own)
    centre = mechanism.centre
    foot = _foot(centre, side, shape)
    outward = foot.outward
    up = -_s * turn(outward)  # the side is on the left of the object for s = 1

    radius = _a - _q[4]
    gap = foot.distance - radius
    # Where the deformed tip ends, as a point of the object and as one of the tip's base.
    contact = centre - radius * outward
    of_object = sp.Matrix(_p[:2]) + _p[2] * turn(contact - sp.Matrix(_q[:2]))
    # A base that turns inward by an angle turns by -s times that angle, counter-clockwise.
    turning = -_s * _rate(mechanism.angle)
    of_base = sp.Matrix([_rate(c) for c in centre]) + turning * turn(contact - centre)
    slip = (of_object - of_base).dot(up) + _p[5]

    facing = _s * sp.cos(mechanism.angle), -sp.sin(mechanism.angle)
    tilt = sp.atan2(-sp.Matrix(facing).dot(up), -sp.Matrix(facing).dot(outward))
    rows = [[sp.diff(_rate(gap), p) for p in _p], [sp.diff(slip, p) for p in _p]]
    assert [row[4:] for row in rows] == [[1, 0], [0, 1]]
    values = [
        *rows[0][:4],
        *rows[1][:4],
        *(sp.diff(tilt, q) for q in _q[:4]),
        *(sum(_rate(v) * p for v, p in zip(row, _p, strict=True)) for row in rows),
        gap,
        foot.place,
        tilt,
        sp.diff(mechanism.weight, _q[3]),
    ]
    return (_q, _p, _s, _a, tuple(own.values()), tuple(shape.values())), values


def potential(law: str, d: Any, numbers: dict[str, Any]) -> Any:
    """The work of pressing the upright tip on a flat side, whose derivative is the force F(d).

    Below d = 0, where only stages of a step are, and beyond a measured range its springs go on as
    dense as they are there.
    """
    if law == "springs":
        return sp.pi * numbers["youngs_modulus"] * d**3 / 3
    if law == "measured":
        reach, densities = numbers["reach"], [numbers[f"density{k}"] for k in range(10)]
        x, end, beyond = d / reach, sum(densities), d - reach
        # Work, force and stiffness of the density of the springs, a polynomial of x.
        within, force, stiffness = (
            sum(c * reach**n * factorial(k) / factorial(k + n) * x ** (k + n)
                for k, c in enumerate(densities))
            for n in (3, 2, 1)
        )  # fmt: skip
        work = sum(v.subs(d, reach) * beyond**k / factorial(k)
                   for k, v in enumerate((within, force, stiffness)))  # fmt: skip
        return sp.Piecewise(
            (densities[0] * d**3 / 6, d < 0),
            (within, d <= reach),
            (work + end * beyond**3 / 6, True),
        )
    c, n = numbers["coefficient"], numbers["exponent"]
    if law == "power":
        return sp.Piecewise((c * d ** (n + 1) / (n + 1), d > 0), (0, True))
    foot = numbers["foot"]
    above = ((d + foot) ** (n + 1) - foot ** (n + 1)) / (n + 1)
    above -= foot**n * d + n * foot ** (n - 1) * d**2 / 2
    return c * sp.Piecewise((above, d > 0), (n * (n - 1) * foot ** (n - 2) * d**3 / 6, True))


def densities(law: softpinch.MeasuredLaw) -> list[float]:
    """The polynomial F'' of a measured law, whose weights are Bernstein's, by powers of d / range.

    The powers are summed exactly, because their coefficients have alternating signs.
    """
    sums = [Fraction(0)] * 10
    for k, weight in enumerate(law.weights.tolist()):
        for j in range(10 - k):
            sums[k + j] += Fraction(weight) * comb(9, k) * comb(9 - k, j) * (-1) ** j
    return [float(each) for each in sums]


@cache
def springs(law: str) -> Callable[..., list[float]]:
    """`spring_terms` as a function of floats."""
    return _compiled(*spring_terms(law))


@cache
def spring_terms(law: str) -> tuple[tuple[Any, ...], list[Any]]:
    """(d_n, d_t, tilt, (chi, kappa, eta), numbers of the law) -> P and its three derivatives.

    The derivatives are by d_n, d_t and the tilt.
    """
    own = {name: sp.Symbol(name, real=True) for name in LAWS[law]}
    d, shear = _q[4:]
    work = potential(law, d, own)
    pressed, stiffness = sp.diff(work, d), sp.diff(work, d, 2)
    # The sum of (4), whose springs have the density F'', along the base and across it.
    energy = _chi * (
        work / sp.cos(_tilt) ** 2
        + _kappa * pressed * shear * sp.tan(_tilt)
        + _eta * stiffness * shear**2 / 2
    )
    values = [energy, *(sp.diff(energy, each) for each in (d, shear, _tilt))]
    if law == "power":
        # d^n / d^2 would divide by zero where a tip is not compressed.
        values = [sp.powsimp(each, deep=True) for each in values]
    return (d, shear, _tilt, (_chi, _kappa, _eta), tuple(own.values())), values


def _compiled(arguments: Any, values: list[Any]) -> Callable[..., list[float]]:
    function: Callable[..., list[float]] = sp.lambdify(
        arguments, values, modules="math", cse=True, docstring_limit=0
    )
    return function


class PartsContact:
    """One contact of a scene as functions of floats.

    Attributes:
        half: Half the length of the side, m.
        kinds: Of the finger, and the name of the law.
        inertia: Of the finger in its coordinate.
        weight: Of the finger, N.
    """

    def __init__(self, scene: Any, i: int) -> None:
        """Reads the parts of finger i = 0, 1 from the scene."""
        self.i, self.s = i, SIGNS[i]
        finger = (scene.hand.right, scene.hand.left)[i]
        tip, grasped = scene.hand.tips[i], scene.grasped
        shape, law = (grasped.right, grasped.left)[i], tip.law
        self.radius = float(tip.radius)
        self.inertia = float(finger.mass if type(finger) is softpinch.Jaw else finger.inertia)
        self.weight = float(finger.mass * scene.gravity)
        self._mechanism = tuple(float(getattr(finger, n)) for n in MECHANISMS[type(finger)])
        softened = 1.0
        if isinstance(shape, softpinch.Arc):
            self.side, self._side = ARC, (shape.radius, *shape.center)
            self.half = shape.radius * (np.pi if shape.span is None else shape.span) / 2
            softened = (1 + self.radius / shape.radius) ** SOFTENED[shape.counterface]
        else:
            height = getattr(shape, "height", None) or grasped.height
            self.half = inf if height is None else height / 2
            middle = grasped.width / 2 + self.s * grasped.com_offset
            self.side, self._side = FACE, (middle, getattr(shape, "tilt", 0.0))
        if isinstance(law, softpinch.PowerLaw):
            foot = () if law.foot is None else (law.foot,)
            name = "power with a foot" if foot else "power"
            numbers = (law.coefficient, law.exponent, *foot)
        elif isinstance(law, softpinch.MeasuredLaw):
            name, numbers = "measured", (law.compression[-1], *densities(law))
        else:
            name, numbers = "springs", (tip.youngs_modulus,)
        self.kinds = type(finger), name
        self._law = tuple(map(float, numbers))
        self._factors = softened, float(tip.tilt_coupling), float(getattr(law, "shear_factor", 1.0))
        self._last: tuple[Sequence[float], list[float]] = ((), [])
        self._geometry, self._springs = geometry(type(finger), self.side), springs(name)

    def own(self, nine: Sequence[float]) -> tuple[float, ...]:
        """Of nine coordinates or rates those of this contact."""
        return (*nine[:3], nine[3 + self.i], nine[5 + self.i], nine[7 + self.i])

    def symbolic(
        self, q: Sequence[Any], p: Sequence[Any], tilt: Any
    ) -> tuple[list[Any], list[Any]]:
        """What `at` and `energy` return, with these nine coordinates, rates and the tilt in P."""
        kind, law = self.kinds
        found = []
        for (arguments, values), numbers in (
            (
                geometry_terms(kind, self.side),
                (self.own(q), self.own(p), self.s, self.radius, self._mechanism, self._side),
            ),
            (
                spring_terms(law),
                (q[5 + self.i], q[7 + self.i], tilt, self._factors, self._law),
            ),
        ):
            given: dict[Any, Any] = {}
            for symbol, number in zip(arguments, numbers, strict=True):
                pairs = zip(symbol, number, strict=True) if isinstance(symbol, tuple) else None
                given |= dict(pairs) if pairs is not None else {symbol: number}
            found.append([value.subs(given, simultaneous=True) for value in values])
        return found[0], found[1]

    def at(self, state: Sequence[float]) -> list[float]:
        """What `geometry` returns, at q and p."""
        if state is not self._last[0]:
            q, p = self.own(state[:9]), self.own(state[9:18])
            numbers = self._mechanism, self._side
            self._last = state, self._geometry(q, p, self.s, self.radius, *numbers)
        return self._last[1]

    def energy(self, state: Sequence[float], tilt: float) -> list[float]:
        """What `springs` returns."""
        return self._springs(state[5 + self.i], state[7 + self.i], tilt, self._factors, self._law)


class PartsMechanics:
    """`Mechanics` of a scene with any parts.

    Attributes:
        masses: The diagonal of the mass matrix (9,).
        radii: Of the two tips, m.
        lengths: The coordinates that are lengths.
        halves: Half the lengths of both sides, m.
    """

    def __init__(self, scene: Any) -> None:
        """Reads the scene."""
        self.contacts = [PartsContact(scene, i) for i in range(2)]
        self.radii = [contact.radius for contact in self.contacts]
        self.halves = [contact.half for contact in self.contacts]
        tips, grasped = scene.hand.tips, scene.grasped
        # (14): the paper gives the tips the object's mass.
        surfaces = [
            [grasped.mass if mass is None else mass for mass in pair]
            for pair in ([t.normal_mass for t in tips], [t.tangential_mass for t in tips])
        ]
        body = [grasped.mass, grasped.mass, grasped.inertia]
        own = [contact.inertia for contact in self.contacts]
        self.masses = np.array([*body, *own, *surfaces[0], *surfaces[1]], dtype=np.float64)
        self._viscosities = [float(tip.normal_viscosity) for tip in tips]
        self._viscosities += [float(tip.tangential_viscosity) for tip in tips]
        control = scene.control
        pids = control if isinstance(control, tuple) else (control, control)
        self._gains = [(0.0,) * 3] * 2
        if scene.fingers != "driven":
            self._gains = [(pid.kp, pid.kd, pid.ki) for pid in pids]
        self._weight = float(grasped.mass * scene.gravity)
        fingers = scene.hand.right, scene.hand.left
        jaws = [3 + i for i in range(2) if isinstance(fingers[i], softpinch.Jaw)]
        self.lengths = (0, 1, *jaws, 5, 6, 7, 8)

    def term_function(self) -> tuple[Callable[..., list[float]], list[list[float]]]:
        """As `contact_terms.term_function`, and dtheta_pi/dq, where that is constant.

        Of upright tips on upright faces, whose tilt is zero where the coordinates are.
        """
        names = ("q:9", "p:9", "i:2", "a:2", "f:3", "w:2")
        q, p, integral, target, load, tilts = (sp.symbols(name, real=True) for name in names)
        parts = [c.symbolic(q, p, tilts[c.i]) for c in self.contacts]
        force = [load[0], load[1] - self._weight, load[2], 0, 0]
        turning = []
        for i, ((place, _), (kp, kd, ki)) in enumerate(zip(parts, self._gains, strict=True)):
            force[3 + i] = -kp * (q[3 + i] - target[i]) - kd * p[3 + i] - ki * integral[i]
            force[3 + i] -= self.contacts[i].weight * place[17]
            row = [0.0] * 9
            row[:3], row[3 + i] = map(float, map(sp.simplify, place[8:11])), float(place[11])
            turning.append(row)
        loads = [parts[i][1][k] for k in (1, 2) for i in range(2)]
        damped = zip(self._viscosities, p[5:], loads, strict=True)
        force += [-c * rate - load for c, rate, load in damped]
        entries = [parts[row % 2][0][4 * (row // 2) + k] for row in range(4) for k in range(4)]
        biases = [parts[i][0][12 + k] for k in range(2) for i in range(2)]
        values = [
            *entries,
            *biases,
            *force,
            *(part[1][3] for part in parts),
            *(part[0][14] for part in parts),
        ]
        function = _compiled(((*q, *p, *integral, *target, *load), tilts, ()), values)
        return function, turning

    def tilts(self, state: Sequence[float]) -> list[float]:
        """theta_p of both tips as they are."""
        return [contact.at(state)[16] for contact in self.contacts]

    def terms(
        self, state: Sequence[float], asked: Sequence[float], tilts: Sequence[float]
    ) -> Terms:
        """The terms at one state, as `Mechanics.terms` returns them."""
        rates = state[9:18]
        rows: list[list[float]] = [[0.0] * 9 for _ in range(6)]  # H, N and T of both
        drives, weights, loads = [0.0, 0.0], [0.0, 0.0], [0.0] * 4
        b, couples, gaps, places = [0.0] * 4, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
        for i, contact in enumerate(self.contacts):
            found = contact.at(state)
            for k in range(3):
                (*rows[2 * k + i][:3], rows[2 * k + i][3 + i]) = found[4 * k : 4 * k + 4]
            rows[i][5 + i] = rows[2 + i][7 + i] = 1.0
            b[i], b[2 + i], gaps[i], places[i] = found[12:16]
            _, loads[i], loads[2 + i], couples[i] = contact.energy(state, tilts[i])
            kp, kd, ki = self._gains[i]
            drives[i] = -kp * (state[3 + i] - asked[i]) - kd * rates[3 + i] - ki * state[18 + i]
            weights[i] = -contact.weight * found[17]
        damping = [-c * v for c, v in zip(self._viscosities, rates[5:], strict=True)]
        x, y, moment = asked[2:5]
        force = [x, y - self._weight, moment, drives[0] + weights[0], drives[1] + weights[1]]
        force += [c - load for c, load in zip(damping, loads, strict=True)]
        powers = [
            drives[0] * rates[3] + drives[1] * rates[4],
            x * rates[0] + y * rates[1] + moment * rates[2],
            sum(c * v for c, v in zip(damping, rates[5:], strict=True)),
        ]
        every = np.array(rows)
        found_b, found_force = np.array(b), np.array(force)
        return Terms(every[:4], found_b, found_force, couples, gaps, places, powers, every[4:])

    def energies(self, state: Sequence[float], tilts: Sequence[float]) -> list[float]:
        """Kinetic energy and the elastic energies of the right and the left tip, J.

        That of gravity is left out: it does not jump.
        """
        kinetic = float(self.masses @ np.square(state[9:18])) / 2
        return [kinetic, *(c.energy(state, tilts[i])[0] for i, c in enumerate(self.contacts))]
