"""A hand that moves, in inertial coordinates: its roots are driven, and no force is fictitious.

The coordinates are absolute: place and angle of the object, angles of the fingers, compressions and
shears of the tips; of a jaw it is the travel. SymPy makes Lagrange's equations of the energies of
bodies and tips. Elastic forces, viscosity, PID and constraints are those of `lagrangian`, or of
`contact_parts`, at the coordinates in the hand's frame; these are functions of the absolute ones
and of time, which SymPy differentiates.

A finger's mass is at its length L from the root, as (16) has it, so that I_i - M_i L^2 is its
inertia about the centre of mass; that of a parallelogram's links is there, too, and that of a jaw
at the centre of its tip. The tips have no weight and move in the frame of their finger.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from math import cos, prod, sin
from typing import Any, NamedTuple

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

import softpinch
from softpinch.accuracy.segments import Driven, Inputs

from .evaluate import parameters
from .lagrangian import PARAMETERS, SHAPES, SIDES, compiled
from .trajectory import Reference, reference, start_state

Floats = NDArray[np.float64]

# What the motion of each kind of finger needs.
_LINKS = ("length", "root_offset", "mass", "inertia")
_OF_FINGERS: dict[type, tuple[str, ...]] = {
    softpinch.Finger: _LINKS,
    softpinch.Parallelogram: _LINKS,
    softpinch.Jaw: ("root_offset", "half_thickness", "height", "direction", "mass"),
}


class Inertial(NamedTuple):
    """The system at absolute coordinates w and rates w': mass w'' = force + what `lagrangian` has.

    The coordinates in the hand's frame are q and their rates p; q'' = jacobian w'' + bias.
    """

    mass: Floats  # (9, 9)
    force: Floats  # (9,)
    q: Floats  # (9,)
    p: Floats  # (9,)
    jacobian: Floats  # (9, 9)
    bias: Floats  # (9,)

    def forces(self) -> tuple[Floats, Floats]:
        """Mass matrix (9, 9) and forces (9,) of the motion and of weight, in the hand's frame."""
        back = np.linalg.inv(self.jacobian)
        mass = back.T @ self.mass @ back
        return mass, back.T @ self.force + mass @ self.bias


@dataclass(frozen=True)
class Bodies:
    """What has a mass in a scene.

    Attributes:
        kinds: Of the right finger and of the left one.
        numbers: By the dotted names of `PARAMETERS`, and those of a jaw; others do no harm.
    """

    kinds: tuple[type, type]
    numbers: dict[str, float]

    @classmethod
    def of(cls, scene: softpinch.Scene) -> Bodies:
        """Those of a scene."""
        fingers, grasped = (scene.hand.right, scene.hand.left), scene.grasped
        numbers = {"gravity": scene.gravity}
        numbers |= {f"grasped.{name}": getattr(grasped, name) for name in ("mass", "inertia")}
        for (side, _), finger, tip in zip(SIDES, fingers, scene.hand.tips, strict=True):
            own = {name: getattr(finger, name) for name in _OF_FINGERS[type(finger)]}
            numbers |= {f"hand.{side}.{name}": value for name, value in own.items()}
            for name in ("normal_mass", "tangential_mass"):
                mass = getattr(tip, name)
                numbers[f"hand.tip.{side}.{name}"] = grasped.mass if mass is None else mass
        return cls((type(fingers[0]), type(fingers[1])), {k: float(v) for k, v in numbers.items()})

    def at(self, w: Floats, v: Floats, frame: Floats) -> Inertial:
        """At coordinates and rates; the rows of `frame` (3, 3) are X, Y, phi, and their rates."""
        function, names = _inertial(self.kinds)
        values = [self.numbers[name] for name in names]
        flat = np.array(function(w.tolist(), v.tolist(), frame.tolist(), values))
        return Inertial(
            *(each.reshape(-1, 9).squeeze() for each in np.split(flat, [81, 90, 99, 108, 189]))
        )

    def absolute(self, q: Floats, p: Floats, frame: Floats) -> tuple[Floats, Floats]:
        """The absolute coordinates and their rates."""
        x, y, phi = frame[0]
        place = [x + q[0] * cos(phi) - q[1] * sin(phi), y + q[0] * sin(phi) + q[1] * cos(phi)]
        fingers = [
            z if kind is softpinch.Jaw else phi - s * z
            for kind, (_, s), z in zip(self.kinds, SIDES, q[3:5].tolist(), strict=True)
        ]
        w = np.array([*place, q[2] + phi, *fingers, *q[5:]])
        system = self.at(w, np.zeros(9), frame)
        return w, np.linalg.solve(system.jacobian, p - system.p)


@cache
def _inertial(kinds: tuple[type, type]) -> tuple[Callable[..., Sequence[float]], list[str]]:
    """The entries of `Inertial` as a function of w, w', the frame and numbers, and their names."""
    numbers: dict[str, Any] = {}

    def number(name: str) -> Any:
        return numbers.setdefault(name, sp.Symbol(name.replace(".", "_"), real=True))

    names = ("x", "y", "theta", "beta1", "beta2", "dn1", "dn2", "dt1", "dt2")
    w, v, a = (sp.symbols([f"{name}_{order}" for name in names], real=True) for order in range(3))
    frame = [sp.symbols([f"{n}_{k}" for n in ("X", "Y", "phi")], real=True) for k in range(3)]
    still = dict.fromkeys(a, 0)
    moving = dict(zip((*w, *v, *frame[0], *frame[1]), (*v, *a, *frame[1], *frame[2]), strict=True))

    def rate(expression: Any) -> Any:
        return sum((sp.diff(expression, x) * dx for x, dx in moving.items()), sp.Integer(0))

    def turned(angle: Any, x: Any, y: Any) -> Any:
        return sp.Matrix(2, 2, [sp.cos(angle), -sp.sin(angle), sp.sin(angle), sp.cos(angle)]) * (
            sp.Matrix([x, y])
        )

    (*origin, phi) = frame[0]
    mass, inertia, g = map(number, ("grasped.mass", "grasped.inertia", "gravity"))
    kinetic = (mass * (v[0] ** 2 + v[1] ** 2) + inertia * v[2] ** 2) / 2
    weight = mass * g * w[1]
    fingers = []
    for i, (side, s) in enumerate(SIDES):
        own = {name: number(f"hand.{side}.{name}") for name in _OF_FINGERS[kinds[i]]}
        root, z = -s * own["root_offset"], w[3 + i]
        if kinds[i] is softpinch.Jaw:
            across = s * (own["half_thickness"] + z * sp.cos(own["direction"]))
            up = own["height"] + z * sp.sin(own["direction"])
            center = sp.Matrix(origin) + turned(phi, root + across, up)
            fingers.append(z)
        else:
            center = sp.Matrix(origin) + turned(phi, root, 0) + turned(z, 0, own["length"])
            about_center = own["inertia"] - own["mass"] * own["length"] ** 2
            kinetic += about_center * v[3 + i] ** 2 / 2
            fingers.append(s * (phi - z))  # turned inward, clockwise for the left finger
        velocity = center.applyfunc(rate)
        kinetic += (
            own["mass"] * velocity.dot(velocity)
            + number(f"hand.tip.{side}.normal_mass") * v[5 + i] ** 2
            + number(f"hand.tip.{side}.tangential_mass") * v[7 + i] ** 2
        ) / 2
        weight += own["mass"] * g * center[1]
    place = turned(-phi, w[0] - origin[0], w[1] - origin[1])
    q = sp.Matrix([*place, w[2] - phi, *fingers, *w[5:]])
    p = q.applyfunc(rate)
    equations = sp.Matrix([
        rate(sp.diff(kinetic, dx)) - sp.diff(kinetic, x) + sp.diff(weight, x)
        for x, dx in zip(w, v, strict=True)
    ])  # fmt: skip
    parts = (equations.jacobian(a), -equations.subs(still), q, p, q.jacobian(w),
             p.applyfunc(rate).subs(still))  # fmt: skip
    arguments = (w, v, frame, tuple(numbers.values()))
    entries = [entry for part in parts for entry in part]
    function: Callable[..., Sequence[float]] = sp.lambdify(
        arguments, entries, modules="math", cse=True, docstring_limit=0
    )
    return function, list(numbers)


def published(q: Floats, p: Floats, frame: Floats, numbers: dict[str, float]) -> Floats:
    """The forces (9,) of the motion and of weight in the hand's frame, written by hand."""
    (_, _, phi), (_, _, omega), (away_x, away_y, turning) = frame
    up_x, up_y = away_x, away_y + numbers["gravity"]
    ax, ay = up_x * cos(phi) + up_y * sin(phi), -up_x * sin(phi) + up_y * cos(phi)
    x, y, *_ = q
    mass = numbers["grasped.mass"]
    force = np.zeros(9)
    force[0] = -mass * (ax - turning * y - 2 * omega * p[1] - omega**2 * x)
    force[1] = -mass * (ay + turning * x + 2 * omega * p[0] - omega**2 * y)
    force[2] = -numbers["grasped.inertia"] * turning
    for i, (side, s) in enumerate(SIDES):
        names = ("mass", "length", "root_offset", "inertia")
        own, length, offset, inertia = (numbers[f"hand.{side}.{name}"] for name in names)
        lever, sine, cosine = own * length, sin(q[3 + i]), cos(q[3 + i])
        force[3 + i] = (
            -lever * (s * ax * cosine - ay * sine)
            + s * turning * (inertia - lever * offset * sine)
            - omega**2 * lever * offset * cosine
        )
    return force


class Moving(NamedTuple):
    """A motion in the hand's frame at n instants: q (n, 9), p (n, 9), multipliers (n, 4)."""

    q: Floats
    p: Floats
    multipliers: Floats


def frames(motion: softpinch.HandMotion, left: float, right: float) -> Callable[[float], Floats]:
    """X, Y, phi, and their rates (3, 3) as a function of time, between two breakpoints."""
    *pieces, sines = motion.compile()
    channels: list[tuple[float, list[list[float]]]] = []
    for breaks, coefficients in pieces:
        k = int(np.searchsorted(breaks, (left + right) / 2, side="right"))
        origin = float(breaks[k - 1]) if k else 0.0
        for row in coefficients[k]:
            polynomial = np.polynomial.Polynomial(row)
            orders = [polynomial, polynomial.deriv(1), polynomial.deriv(2)]
            channels.append((origin, [order.coef[::-1].tolist() for order in orders]))
    waves = [wave.tolist() for wave in sines]

    def frame(t: float) -> Floats:
        result = np.zeros((3, 3))
        for channel, (origin, orders) in enumerate(channels):
            for order, falling in enumerate(orders):
                value = 0.0
                for coefficient in falling:
                    value = value * (t - origin) + coefficient
                result[order, channel] = value
        for omega, phase, *amplitudes in waves:
            s, c = sin(omega * t + phase), cos(omega * t + phase)
            result += np.outer([s, omega * c, -omega * omega * s], amplitudes)
        return result

    return frame


def moving(
    scene: softpinch.Scene,
    motion: softpinch.HandMotion,
    times: ArrayLike,
    inertial: bool = True,
    rtol: float = 1e-12,
) -> Moving:
    """Integrates a scene with bilateral contact and PIDs whose hand moves.

    Args:
        scene: Its external forces are in fixed axes; its start is in the hand's frame.
        motion: The motion of the hand.
        times: Increasing instants (n,) after the start.
        inertial: False integrates in the hand's frame, with the forces that are `published`.
        rtol: Relative tolerance of DOP853.
    """
    numbers = parameters(scene)
    values, bodies = tuple(numbers[name] for name in PARAMETERS), Bodies.of(scene)
    start, begin = start_state(scene)
    inputs = Inputs(scene, begin, begin + scene.duration)
    stops = np.asarray(times, dtype=np.float64)
    edges = np.unique([*inputs.edges, *motion.breakpoints(begin, inputs.edges[-1]), *stops])

    def rates(t: float, y: Floats, framed: Callable[[float], Floats], driven: Driven) -> Any:
        """The rates of the state, then q, p and the multipliers."""
        frame, (*target, fx, fy, moment) = framed(t), driven(t)
        w, v, integral = y[:9], y[9:18], y[18:]
        system = bodies.at(w, v, frame) if inertial else None
        q, p = (w, v) if system is None else (system.q, system.p)
        terms = _terms((*q, *p, *integral, *target, 0.0, 0.0, 0.0), values)
        phi, b = terms["constraint_matrix"], terms["constraint_rate"]
        own = terms["elastic"] + terms["viscous"] + terms["control"]
        if system is None:
            turn = frame[0, 2]
            load = [fx * cos(turn) + fy * sin(turn), fy * cos(turn) - fx * sin(turn), moment]
            mass, force = terms["mass_matrix"], own + published(q, p, frame, numbers)
            rows = phi
        else:
            load = [fx, fy, moment]
            mass, force = system.mass, system.force + system.jacobian.T @ own
            rows, b = phi @ system.jacobian, b + phi @ system.bias
        force[:3] += load
        whole = np.block([[mass, -rows.T], [rows, np.zeros((4, 4))]])
        found = np.linalg.solve(whole, np.concatenate([force, -b]))
        return np.concatenate([v, found[:9], q[3:5] - target]), (q, p, found[9:])

    y = start
    if inertial:
        frame = frames(motion, begin, float(edges[1]))(begin)
        y = np.concatenate([*bodies.absolute(start[:9], start[9:18], frame), start[18:]])
    found = []
    for left, right in pairwise(edges.tolist()):
        # Neither sees what follows its last instant.
        given = frames(motion, left, right), inputs.between(left, right)
        solved = solve_ivp(
            lambda t, y, given=given: rates(t, y, *given)[0],
            (left, right), y, "DOP853", rtol=rtol, atol=1e-3 * rtol,
        )  # fmt: skip
        y = solved.y[:, -1]
        if right in stops:
            found.append(rates(right, y, *given)[1])
    return Moving(*map(np.array, zip(*found, strict=True)))


def carried(scene: softpinch.Scene, times: Floats) -> Reference:
    """The trajectory of a scene whose hand is at rest at the first of the times, its start."""
    assert scene.motion is not None
    still = replace(scene, motion=None)
    start, found = reference(still, times[:1]), moving(still, scene.motion, times[1:])
    rows = [np.vstack([getattr(start, name)[:1], getattr(found, name)]) for name in found._fields]
    return Reference(times, *rows, np.full((len(times), 2), np.nan), 0)


def _terms(state: Sequence[float], values: Sequence[float]) -> dict[str, Floats]:
    flat, found, first = compiled("math")(state, values), {}, 0
    for name, shape in SHAPES.items():
        found[name] = np.array(flat[first : first + prod(shape)]).reshape(shape)
        first += prod(shape)
    return found
