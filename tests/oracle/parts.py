"""Trajectories of other hands and objects: jaws, parallelograms, tilted faces, arcs, any law.

SymPy derives the equations of a scene from positions, rigid velocities and energies: the distance
between the centre of a tip and the side, the velocities of both bodies at the foot of this
distance, and the energy of the springs over the tilt between the side and the base of the tip. None
of the core's formulas for rows, biases and gradients is used. As in `trajectory`, the compressions
and shears follow five coordinates. A hand that moves adds the accelerations of its frame, at the
centre of mass of each body.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import inf, pi
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BPoly

from softpinch import (
    Arc,
    Face,
    Fingertip,
    Jaw,
    MeasuredLaw,
    Parallelogram,
    Pid,
    PowerLaw,
    Scene,
)
from softpinch.accuracy.segments import Inputs, System, integrate
from softpinch.scene.parts import others

from .lagrangian import turn
from .trajectory import Reference, reference

Floats = NDArray[np.float64]
Law = Callable[[float], float]
# Of the right side, whose outward normal is along x, and of the left one.
SIGNS = (-1, 1)


def law_of(tip: Fingertip) -> list[Law]:
    """The integral of the force F(d), F, F' and F'' at compressions d.

    F'' keeps its value below zero, and of a `MeasuredLaw` beyond its range.
    """
    law, end = tip.law, inf
    if isinstance(law, MeasuredLaw):
        end = float(law.compression[-1])
        density = BPoly(law.weights[:, None], [0.0, end])
        within: list[Any] = [density.antiderivative(k) for k in (3, 2, 1)] + [density]
    else:
        springs = PowerLaw(pi * tip.youngs_modulus, 2.0)
        c, n, foot = (getattr(law or springs, name) for name in ("coefficient", "exponent", "foot"))
        e = foot or 0.0
        start, slope = c * e**n, c * n * e ** (n - 1) if e else 0.0
        within = [
            lambda d: (
                c * ((d + e) ** (n + 1) - e ** (n + 1)) / (n + 1) - start * d - slope * d * d / 2
            ),
            lambda d: c * (d + e) ** n - start - slope * d,
            lambda d: c * n * (d + e) ** (n - 1) - slope,
            lambda d: c * n * (n - 1) * (d + e) ** (n - 2),
        ]

    def continued(order: int) -> Law:
        def value(d: float) -> float:
            near = min(max(d, 0.0), end)
            terms, beyond = [float(each(near)) for each in within[order:]], d - near
            series = (term * beyond**k / (1, 1, 2, 6)[k] for k, term in enumerate(terms))
            return sum(series) if beyond else terms[0]

        return value

    return [continued(order) for order in range(4)]


def derivatives(name: str) -> list[Any]:
    """Functions of SymPy of which each is the derivative of the one before."""
    made: list[Any] = [sp.Function(f"{name}_3")]
    for order in (2, 1, 0):
        after = made[0]
        body = {"fdiff": lambda self, argindex=1, after=after: after(self.args[0])}
        made.insert(0, type(f"{name}_{order}", (sp.Function,), body))
    return made


def turned(angle: Any, x: Any, y: Any) -> Any:
    """The vector (x, y) turned counter-clockwise."""
    along = sp.Matrix([sp.cos(angle), sp.sin(angle)])
    return x * along + y * turn(along)


class Contact(NamedTuple):
    """One finger, its tip and its side in symbols, as `PartsModel` describes them."""

    center: Any
    base: Any
    inertia: Any
    potential: Any
    outward: Any
    distance: Any
    softer: Any
    radius: Any
    kappa: Any
    factor: Any
    gains: tuple[Any, ...]
    friction: tuple[Any, ...]
    masses: tuple[Any, ...]
    viscosities: tuple[Any, ...]


U = sp.symbols("x y theta z1 z2", real=True)
V = sp.symbols("vx vy omega w1 w2", real=True)
TARGET = sp.symbols("target1 target2", real=True)
EXTERNAL = sp.symbols("force_x force_y moment", real=True)
# Of a hand that moves: its acceleration along fixed axes, tilt, and two rates of the tilt.
FRAME = sp.symbols("frame_x frame_y tilt turn spin", real=True)
LAWS = [f"law{i}_{k}" for i in range(2) for k in range(4)]


def rate(expression: Any) -> Any:
    return sum(sp.diff(expression, x) * w for x, w in zip(U, V, strict=True))


@cache
def equations(
    mass: tuple[Any, ...],
    g: Any,
    contacts: tuple[Contact, ...],
    bodies: tuple[Any, ...],
    numbers: tuple[Any, ...],
) -> tuple[FunctionType, FunctionType]:
    """The functions `motion` and `rest` of a model, but for the laws that they call.

    To derive them takes longer than to integrate them, and hands of the same kinds share them.

    Args:
        mass: Of the object, twice, and its moment of inertia.
        g: Gravity.
        contacts: Right and left.
        bodies: What `PartsModel.bodies` returns of a hand that moves, else nothing.
        numbers: All symbols of numbers.
    """
    dn, dt = (sp.symbols(f"{name}1 {name}2", real=True) for name in ("dn", "dt"))
    integral = sp.symbols("integral1 integral2", real=True)
    frame = FRAME if bodies else ()
    place = sp.Matrix(U[:2])
    all_mass = [*mass, *(contact.inertia for contact in contacts)]
    weight, elastic = mass[0] * g * U[1], sp.Integer(0)
    rows, shear_rows, depths, torques = [], [], [], []
    for i, (s, contact) in enumerate(zip(SIGNS, contacts, strict=True)):
        center, base, outward = contact.center, contact.base, contact.outward
        weight += contact.potential * g
        # The distance is the radius less the compression.
        depths.append(contact.radius - contact.distance)
        rows.append(sp.Matrix([contact.distance]).jacobian(U))
        foot = center - outward * contact.distance
        of_object = sp.Matrix(V[:2]) + V[2] * turn(foot - place)
        of_tip = center.applyfunc(rate) - s * rate(base) * turn(foot - center)
        along = turn(-s * outward)
        shear_rows.append(sp.Matrix([along.dot(of_object - of_tip)]).jacobian(V))
        # How far the side is turned from the base of the tip.
        normal = -s * outward
        tilt = base + s * sp.atan(normal[1] / normal[0])
        law = derivatives(f"law{i}")
        elastic += contact.softer * (
            law[0](dn[i]) / sp.cos(tilt) ** 2
            + contact.kappa * law[1](dn[i]) * dt[i] * sp.tan(tilt)
            + contact.factor * law[2](dn[i]) * dt[i] ** 2 / 2
        )
        gains, z, w = contact.gains, U[3 + i], V[3 + i]
        torques.append(-gains[0] * (z - TARGET[i]) - gains[1] * w - gains[2] * integral[i])
        if contact.friction:
            most, creep = contact.friction
            torques[i] -= most * w / sp.sqrt(w**2 + creep**2)
    mass_d = [contact.masses[k] for k in range(2) for contact in contacts]
    viscous = [contact.viscosities[k] for k in range(2) for contact in contacts]
    phi = sp.Matrix.vstack(*rows, *shear_rows)
    bias = phi.applyfunc(rate) * sp.Matrix(V)
    rates_d = -phi * sp.Matrix(V)
    d = (*dn, *dt)
    force_d = sp.Matrix([
        -sp.diff(elastic, x) - c * r for x, c, r in zip(d, viscous, rates_d, strict=True)
    ])  # fmt: skip
    fields = sp.Matrix([sp.diff(-weight, x) for x in U])
    pushed = sp.Matrix(EXTERNAL[:2])
    if frame:
        pushed = turned(-frame[2], *pushed)
        gravity = turned(-frame[2], frame[0], frame[1] + g)
        fields = sp.zeros(5, 1)
        for own, at, inertia, angle in bodies:
            # The acceleration of the body's centre beside that which its coordinates have.
            away = gravity + frame[4] * turn(at) + 2 * frame[3] * turn(at.applyfunc(rate))
            away -= frame[3] ** 2 * at
            fields -= own * at.jacobian(U).T * away
            fields -= inertia * frame[4] * sp.Matrix([sp.diff(angle, x) for x in U])
    force = sp.Matrix([*pushed, EXTERNAL[2], *torques]) + fields
    force -= sp.Matrix([sp.diff(elastic, x) for x in U])
    of_d = sp.diag(*mass_d)
    matrix = sp.diag(*all_mass) + phi.T * of_d * phi
    right = force - phi.T * (force_d + of_d * bias)
    pressed = dict(zip(dn, depths, strict=True))
    acceleration = sp.symbols("acceleration1:6", real=True)
    multipliers = -of_d * (phi * sp.Matrix(acceleration) + bias) - force_d
    given = ((*U, *dt, *integral, *V), (*TARGET, *EXTERNAL, *frame), numbers)
    motion = [entry.xreplace(pressed) for entry in (*matrix, *right, *rates_d[2:, 0])]
    rest = [entry.xreplace(pressed) for entry in (*depths, *rates_d, *multipliers)]
    return _compiled(given, motion), _compiled((*given, acceleration), rest)


def _compiled(arguments: tuple[Any, ...], values: list[Any]) -> FunctionType:
    # To put terms in order takes longer than the rest.
    found = sp.cse(values, order="none", list=True)
    modules = [dict.fromkeys(LAWS, float), "math"]
    function: FunctionType = sp.lambdify(
        arguments, found[1], modules=modules, cse=lambda _: found, docstring_limit=0
    )
    return function


class PartsModel:
    """The equations of a scene, and their integration."""

    def __init__(self, scene: Scene) -> None:
        self.values: dict[Any, float] = {}
        grasped, g = scene.grasped, self.number(scene.gravity)
        place = sp.Matrix(U[:2])
        mass = (*[self.number(grasped.mass)] * 2, self.number(grasped.inertia))
        contacts = tuple(self.contact(scene, i, place) for i in range(2))
        # Of matrices only those that cannot change have a hash.
        bodies = tuple(
            (own, at.as_immutable(), inertia, angle)
            for own, at, inertia, angle in (self.bodies(scene, place) if scene.motion else ())
        )
        self.asked = len(TARGET) + len(EXTERNAL) + len(FRAME) * bool(bodies)
        found = [law for tip in scene.hand.tips for law in law_of(tip)]
        laws = dict(zip(LAWS, found, strict=True))
        self.motion, self.rest = (
            FunctionType(made.__code__, made.__globals__ | laws)
            for made in equations(mass, g, contacts, bodies, tuple(self.values))
        )

    def contact(self, scene: Scene, i: int, place: Any) -> Contact:
        tip, finger = scene.hand.tips[i], (scene.hand.right, scene.hand.left)[i]
        center, base, inertia, potential = self.mechanism(scene, i)
        outward, distance, softer = self.side(scene, i, place, center)
        pid = scene.control[i] if isinstance(scene.control, tuple) else scene.control
        assert isinstance(pid, Pid)
        friction: tuple[Any, ...] = ()
        if finger.joint_friction is not None:
            creep = 0.01 if finger.creep_rate is None else finger.creep_rate
            friction = (self.number(finger.joint_friction), self.number(creep))
        heavy = scene.grasped.mass
        own = [heavy if m is None else m for m in (tip.normal_mass, tip.tangential_mass)]
        return Contact(
            center=center.as_immutable(),
            base=base,
            inertia=inertia,
            potential=potential,
            outward=outward.as_immutable(),
            distance=distance,
            softer=softer,
            radius=self.number(tip.radius),
            kappa=self.number(tip.tilt_coupling),
            factor=self.number(getattr(tip.law, "shear_factor", 1.0)),
            gains=tuple(self.number(gain) for gain in (pid.kp, pid.kd, pid.ki)),
            friction=friction,
            masses=tuple(map(self.number, own)),
            viscosities=tuple(map(self.number, (tip.normal_viscosity, tip.tangential_viscosity))),
        )

    def number(self, value: float) -> Any:
        """A symbol for a number of the scene."""
        symbol = sp.Symbol(f"number{len(self.values)}", real=True)
        self.values[symbol] = float(value)
        return symbol

    def bodies(self, scene: Scene, place: Any) -> list[tuple[Any, Any, Any, Any]]:
        """Mass, centre, moment of inertia about it and angle of each body, in the hand's frame."""
        grasped = scene.grasped
        found = [(self.number(grasped.mass), place, self.number(grasped.inertia), U[2])]
        for i, finger in enumerate((scene.hand.right, scene.hand.left)):
            s, z, mass = SIGNS[i], U[3 + i], self.number(finger.mass)
            if isinstance(finger, Jaw):
                found.append((mass, self.mechanism(scene, i)[0], sp.Integer(0), z))
                continue
            length, offset = self.number(finger.length), self.number(finger.root_offset)
            end = sp.Matrix([s * (length * sp.sin(z) - offset), length * sp.cos(z)])
            # What is not a mass at the links' end turns with them, inward.
            inertia = self.number(finger.inertia - finger.mass * finger.length**2)
            found.append((mass, end, inertia, -s * z))
        return found

    def mechanism(self, scene: Scene, i: int) -> tuple[Any, Any, Any, Any]:
        """Centre and tilt of the tip's base, inertia in the coordinate, and weight over g."""
        s, z = SIGNS[i], U[3 + i]
        finger = (scene.hand.right, scene.hand.left)[i]
        offset, thick, mass = map(
            self.number, (finger.root_offset, finger.half_thickness, finger.mass)
        )
        if isinstance(finger, Jaw):
            direction, height = self.number(finger.direction), self.number(finger.height)
            across = thick - offset + z * sp.cos(direction)
            up = height + z * sp.sin(direction)
            return sp.Matrix([s * across, up]), self.number(finger.angle), mass, mass * up
        length, inertia = self.number(finger.length), self.number(finger.inertia)
        lever = sp.Matrix([s * (length * sp.sin(z) - offset), length * sp.cos(z)])
        if isinstance(finger, Parallelogram):
            center, base = lever + sp.Matrix([s * thick, 0]), self.number(finger.angle)
        else:
            center, base = lever + thick * sp.Matrix([s * sp.cos(z), -sp.sin(z)]), z
        return center, base, inertia, mass * length * sp.cos(z)

    def side(self, scene: Scene, i: int, place: Any, center: Any) -> tuple[Any, Any, Any]:
        """The side's outward normal and distance at the tip's centre, and how soft it makes it."""
        s, theta, grasped = SIGNS[i], U[2], scene.grasped
        side = (grasped.right, grasped.left)[i]

        if isinstance(side, Arc):
            radius = self.number(side.radius)
            away = center - place - turned(theta, *map(self.number, side.center))
            length = sp.sqrt(away.dot(away))
            power = {"flat": 0.0, "cylinder": -0.5, "sphere": -1.0}[side.counterface]
            softer = self.number((1.0 + scene.hand.tips[i].radius / side.radius) ** power)
            return away / length, length - radius, softer
        tilt = self.number(side.tilt if isinstance(side, Face) else 0.0)
        # Wider above: the right face looks down, and so does the left one.
        outward = turned(theta, -s * sp.cos(tilt), -sp.sin(tilt))
        half, offset = self.number(0.5 * grasped.width), self.number(grasped.com_offset)
        middle = place + turned(theta, -s * half - offset, 0)
        return outward, (center - middle).dot(outward), sp.Integer(1)

    def accelerations(self, terms: Any) -> list[float]:
        """Accelerations of the five coordinates."""
        solved = np.linalg.solve(np.array(terms[:25]).reshape(5, 5), np.array(terms[25:30]))
        return [float(each) for each in solved]

    def rates(self, state: tuple[float, ...], asked: tuple[float, ...]) -> tuple[float, ...]:
        """Rates of the fourteen states."""
        terms = self.motion(state, asked, tuple(self.values.values()))
        errors = (state[3] - asked[0], state[4] - asked[1])
        return (*state[9:], *terms[30:], *errors, *self.accelerations(terms))

    def jump(self, state: Floats, impulse: tuple[float, ...]) -> Floats:
        """The states after an ideal impulse on the object."""
        asked = (0.0,) * self.asked
        terms = self.motion(tuple(state.tolist()), asked, tuple(self.values.values()))
        matrix = np.array(terms[:25]).reshape(5, 5)
        change = np.linalg.solve(matrix, np.array([*impulse, 0.0, 0.0]))
        return np.concatenate([state[:9], state[9:] + change])

    def row(self, state: Floats, asked: tuple[float, ...]) -> tuple[Floats, ...]:
        """q, p, multipliers and integral at one instant."""
        y, values = state.tolist(), tuple(self.values.values())
        found = self.rest(y, asked, values, self.accelerations(self.motion(y, asked, values)))
        q = np.array([*y[:5], *found[:2], *y[5:7]])
        return q, np.array([*y[9:], *found[2:6]]), np.array(found[6:]), state[7:9].copy()


def reference_of(
    scene: Scene, times: ArrayLike, method: str = "DOP853", rtol: float = 1e-12
) -> Reference:
    """The reference of a scene with any parts, whichever derivation has it."""
    return (parts_reference if others(scene) else reference)(scene, times, method=method, rtol=rtol)


def parts_reference(
    scene: Scene,
    times: ArrayLike,
    method: str = "DOP853",
    rtol: float = 1e-12,
    model: PartsModel | None = None,
) -> Reference:
    """Integrates a scene with other parts, as `trajectory.reference` does one with the paper's.

    Args:
        scene: With bilateral contact and PIDs.
        times: (n,), s, within the run.
        method: One of scipy.integrate's.
        rtol: Relative tolerance; the absolute one is a share of it, of fixed sizes.
        model: That of a scene whose numbers are the same, to save its derivation.
    """
    model, start = model or PartsModel(scene), scene.start()
    state = np.concatenate([start.q[:5], start.q[7:], start.integral, start.p[:5]])
    off = np.abs(model.row(state, (0.0,) * model.asked)[0] - start.q).max()
    if off > 1e-10:
        raise ValueError(f"initial: off the constraints by {off:g} m, which this form cannot be")
    begin = float(start.time)
    inputs = Inputs(scene, begin, begin + float(scene.duration))
    instants, wanted = inputs.instants(times)
    motion = integrate(
        System(model.rates, model.jump), inputs, state, wanted, method=method, rtol=rtol,
        sizes=np.array([0.1, 0.1, 1, 1, 1, 0.1, 0.1, 1, 1, 0.1, 0.1, 1, 1, 1]), most=1_000_000,
    )  # fmt: skip
    picked = np.searchsorted(motion.t, wanted)
    rows = [model.row(motion.y[k], tuple(motion.u[k].tolist())) for k in picked]
    q, p, multipliers, integral = map(np.array, zip(*rows, strict=True))
    return Reference(instants, q, p, multipliers, integral, motion.evaluations)
