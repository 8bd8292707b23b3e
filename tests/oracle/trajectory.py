"""Trajectories to compare with: DOP853 on the null-space form, and its own reading of scenes.

The four compressions and shears follow the other five coordinates (docs/integrators.md, "How the
constraints are kept", `nullspace`): no gain to choose, no drift. Fourteen states: x, y, theta,
theta_1, theta_2, the two shears, the two integrals of (39), and the five rates. A scene is read
from its plain attributes, not from what softpinch makes of them, so any object that has them will
do.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import scipy.integrate
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from .evaluate import evaluate, parameters
from .lagrangian import FORCES, PARAMETERS, SHAPES, SIDES, compiled, model

Floats: TypeAlias = NDArray[np.float64]
Driven: TypeAlias = Callable[[float], tuple[float, ...]]

# Instants closer than this many units in the last place are one.
_ULPS = 4
# Of q and of p: metres and radians.
_UNITS = ([0, 1, 5, 6, 7, 8], [2, 3, 4])


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference trajectory.

    Attributes:
        t: (n,), s.
        q: (n, 9).
        p: (n, 9); at an impulse just before it.
        multipliers: (n, 4), N; at a break just after it, but at the end just before.
        integral: (n, 2), of the angles' errors, rad s.
        evaluations: Calls of the right-hand side.
    """

    t: Floats
    q: Floats
    p: Floats
    multipliers: Floats
    integral: Floats
    evaluations: int


def reference(
    scene: Any,
    times: ArrayLike | None = None,
    method: str = "DOP853",
    rtol: float = 1e-12,
    tolerance: float = 1e-10,
    most: int = 1_000_000,
) -> Reference:
    """Integrates a scene from break to break of its inputs, ending a step on every wanted instant.

    Nothing is interpolated (DOP853's dense output is of order 7) and nothing monitored: the motion
    goes on where the model has stopped holding.

    Args:
        scene: hand, grasped, control, schedule, disturbances, gravity, duration, initial.
        times: (n,), s, not decreasing, within the run; None is the start, every break, the end.
        method: An explicit method of scipy.integrate, by its class.
        rtol: Relative tolerance; the absolute one is a hundredth of it, of each state's own size.
        tolerance: What the start may be off the constraints, of the sum of their absolute terms.
        most: Evaluations of the right-hand side (the paper's eight operations take 150_000).

    Raises:
        ValueError: The start is off the constraints, or an instant outside of the run.
        RuntimeError: The integrator gave up, or the motion ran away: a lost grasp, often.
    """
    numbers = parameters(scene)
    values = tuple(numbers[name] for name in PARAMETERS)
    state, begin = _start(scene, numbers, tolerance)
    end = begin + float(scene.duration)
    near = _ULPS * float(np.spacing(max(abs(begin), abs(end))))
    edges = _merged(begin, end, breaks(scene), near)
    instants = np.array(edges) if times is None else np.asarray(times, dtype=np.float64)
    wanted = [_snapped(float(t), edges, near) for t in instants]
    if min(wanted) < begin or max(wanted) > end:
        raise ValueError(f"times: must be from {begin} to {end}")
    impulses = {edge: np.zeros(3) for edge in edges[:-1]}
    for kick in (d for d in scene.disturbances if hasattr(d, "impulse")):
        edge = _snapped(float(kick.time), edges, near)
        if edge in impulses:
            impulses[edge] += [*kick.impulse, kick.angular_impulse]

    length = max(numbers[f"hand.{side}.length"] for side, _ in SIDES)
    sizes = np.array([length, length, 1, 1, 1, length, length, 1, 1, length, length, 1, 1, 1])
    rows: dict[float, tuple[Floats, ...]] = {}
    pending = sorted(set(wanted))
    evaluations = 0
    for left, right in pairwise(edges):
        driven = inputs(scene, left, right)
        slope = _slope(driven, values)
        if left in pending:
            rows[left] = _row(left, state, driven, values)
        if impulses[left].any():
            state = jump(state, driven(left), values, impulses[left])
        solver = getattr(scipy.integrate, method)(
            slope, left, state, right, rtol=rtol, atol=0.01 * rtol * sizes
        )
        stops = [t for t in pending if left < t < right]
        for stop in [*stops, right]:
            _advance(solver, stop, most - evaluations)
            if stop < right or (stop == end and end in pending):
                rows[stop] = _row(stop, solver.y, driven, values)
        state = solver.y
        evaluations += solver.nfev
    q, p, multipliers, integral = (np.array([rows[t][k] for t in wanted]) for k in range(4))
    return Reference(instants, q, p, multipliers, integral, evaluations)


def error(result: Any, expected: Reference) -> dict[str, float]:
    """A run's error: per name the largest |difference| over rows and components.

    Each component is scaled by its largest size along the reference. One that is round-off by
    symmetry, below 1e-9 of the largest with its unit, is scaled by that one.

    Args:
        result: Has t and q, p or multipliers; what is missing (AttributeError) is left out.
        expected: At the same times.

    Raises:
        ValueError: The times differ.
    """
    if not np.array_equal(np.asarray(result.t), expected.t):
        raise ValueError("error: the times differ")
    errors = {}
    for name in ("q", "p", "multipliers"):
        try:
            value = np.asarray(getattr(result, name), dtype=np.float64)
        except AttributeError:
            continue
        right = getattr(expected, name)
        scales = np.abs(right).max(axis=0)
        for unit in _UNITS if name != "multipliers" else ([0, 1, 2, 3],):
            largest = scales[unit].max()
            scales[unit] = np.where(scales[unit] < 1e-9 * largest, largest, scales[unit])
        # All at rest: an error of any size counts in full.
        scales[scales == 0] = 1.0
        errors[name] = float((np.abs(value - right) / scales).max())
    return errors


def _start(scene: Any, numbers: dict[str, float], tolerance: float) -> tuple[Floats, float]:
    """The fourteen states at the start, and its time."""
    initial = getattr(scene, "initial", None)
    if initial is not None and not isinstance(initial, str):
        q, p = np.asarray(initial.q, dtype=np.float64), np.asarray(initial.p, dtype=np.float64)
        off = evaluate(numbers, q, p)
        zeros = {"residuals": np.zeros(4), "residual_rates": np.zeros(2)}
        if max(off.differences(zeros).values()) > tolerance:
            raise ValueError("initial: off the constraints, which this form cannot be")
        integral = np.asarray(initial.integral, dtype=np.float64)
        return np.concatenate([q[:5], q[7:], integral, p[:5]]), float(initial.time)
    angles, heights = [], []
    for side, _ in SIDES:
        finger, tip = f"hand.{side}.", f"hand.tip.{side}.radius"
        length, thickness = numbers[finger + "length"], numbers[finger + "half_thickness"]
        # How far inward of its root the tip's centre stands when it just touches.
        inward = numbers[finger + "root_offset"] - numbers[tip] - numbers["grasped.width"] / 2
        angle = 0.0
        if initial == "touching":
            reach = math.hypot(length, thickness)
            angle = math.asin(inward / reach) - math.atan2(thickness, length)
        elif inward - thickness > 1e-9 * numbers[tip]:
            raise ValueError(f"initial: the {side} fingertip does not reach the object")
        angles.append(angle)
        heights.append(length * math.cos(angle) - thickness * math.sin(angle))
    state = np.zeros(14)
    # The object's middle between the roots, its centre of gravity as high as the tips are.
    state[:5] = numbers["grasped.com_offset"], sum(heights) / 2, 0.0, *angles
    if initial != "touching":
        state[1] = sum(numbers[f"hand.{side}.length"] for side, _ in SIDES) / 2
    return state, 0.0


def breaks(scene: Any) -> list[float]:
    """Every instant at which an input jumps or bends, in no order."""
    schedule = scene.schedule
    result = [float(t) for t in schedule.times]
    if schedule.kind == "minimum_jerk":
        result += [t + float(schedule.move_time) for t in result[1:]]
    for disturbance in scene.disturbances:
        if hasattr(disturbance, "times"):
            result += [float(t) for t in disturbance.times]
            continue
        result.append(float(disturbance.time))
        duration = getattr(disturbance, "duration", None)
        if duration is not None:
            result.append(float(disturbance.time) + float(duration))
    return result


def inputs(scene: Any, left: float, right: float) -> Driven:
    """t -> (theta_1^d, theta_2^d, F_x, F_y, moment), smooth, as it holds between two breaks.

    At `right` it gives the limit from the left: a stage there belongs to the step that ends.
    """
    inside = left + (right - left) / 2
    angles = _scheduled(scene.schedule, inside)
    loads = [_load(d, inside) for d in scene.disturbances if not hasattr(d, "impulse")]

    def driven(t: float) -> tuple[float, ...]:
        total = [load(t) for load in loads]
        return (*angles(t), *(sum(parts) for parts in zip((0.0, 0.0, 0.0), *total, strict=True)))

    return driven


def _scheduled(schedule: Any, inside: float) -> Driven:
    times = [float(t) for t in schedule.times]
    angles = [tuple(map(float, row)) for row in schedule.angles]
    if schedule.kind == "minimum_jerk":
        k = bisect_right(times, inside) - 1
        length = float(schedule.move_time)
        if k < 1 or inside >= times[k] + length:
            return lambda _: angles[max(k, 0)]

        def move(t: float) -> tuple[float, ...]:
            s = (t - times[k]) / length
            share = 10 * s**3 - 15 * s**4 + 6 * s**5
            return tuple(a + share * (b - a) for a, b in zip(angles[k - 1], angles[k], strict=True))

        return move
    joined = schedule.kind == "ramps" or getattr(schedule, "hold", None) == "linear"
    return _samples(times, angles, angles[0], joined, inside)


def _samples(
    times: Sequence[float],
    values: Sequence[tuple[float, ...]],
    before: tuple[float, ...],
    joined: bool,
    inside: float,
) -> Driven:
    k = bisect_right(times, inside) - 1
    if k < 0:
        return lambda _: before
    if not joined or k == len(times) - 1:
        return lambda _: values[k]

    def line(t: float) -> tuple[float, ...]:
        share = (t - times[k]) / (times[k + 1] - times[k])
        return tuple((1 - share) * a + share * b for a, b in zip(*values[k : k + 2], strict=True))

    return line


def _load(disturbance: Any, inside: float) -> Driven:
    """A disturbance that is a force; which one it is shows in its attributes."""
    none = (0.0, 0.0, 0.0)
    if hasattr(disturbance, "times"):
        times = [float(t) for t in disturbance.times]
        moments = [0.0] * len(times) if disturbance.moment is None else disturbance.moment
        values = [
            (float(x), float(y), float(m))
            for (x, y), m in zip(disturbance.force, moments, strict=True)
        ]
        return _samples(times, values, none, disturbance.hold == "linear", inside)
    begin = float(disturbance.time)
    duration = getattr(disturbance, "duration", None)
    if inside < begin or (duration is not None and inside >= begin + float(duration)):
        return lambda _: none
    force = (*map(float, disturbance.force), float(disturbance.moment))
    frequency = getattr(disturbance, "frequency_hz", None)
    if frequency is None:
        return lambda _: force

    def sine(t: float) -> tuple[float, ...]:
        swing = math.sin(2 * math.pi * float(frequency) * (t - begin) + float(disturbance.phase))
        return tuple(swing * f for f in force)

    return sine


def _merged(begin: float, end: float, instants: Sequence[float], near: float) -> list[float]:
    """Start, breaks within and end, those that are one instant taken once."""
    edges = [begin]
    for t in sorted(instants):
        if edges[-1] + near < t < end - near:
            edges.append(t)
    return [*edges, end]


def _snapped(t: float, edges: Sequence[float], near: float) -> float:
    closest = min(edges, key=lambda edge: abs(edge - t))
    return closest if abs(closest - t) <= near else t


@cache
def null_space() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Two functions of plain floats: of (state, inputs, parameters), and of these and v'.

    The first returns the 25 entries of M_5 + Phi_5^T M_d Phi_5, the 5 of f_5 - Phi_5^T (f_d + M_d
    b), and the rates of d_t (2). The second returns d_n (2), the rates of d_n and d_t (4), and
    lambda (4).
    """
    system = model()
    # C^H is linear in d_n, with factor one.
    pressed = dict.fromkeys(system.q[5:7], 0)
    compressions = [-c.subs(pressed) for c in system.terms["residuals"][:2]]
    depths = dict(zip(system.q[5:7], compressions, strict=True))
    phi = system.matrix("constraint_matrix")[:, :5].subs(depths)
    rates = -phi * sp.Matrix(system.p[:5])
    followers = dict(zip(system.p[5:], rates, strict=True))

    def reduced(name: str) -> Any:
        return system.matrix(name).subs(followers).subs(depths)

    b = reduced("constraint_rate")
    force = sum((reduced(name) for name in FORCES), sp.zeros(9, 1))
    mass = system.matrix("mass_matrix")
    mass_d = mass[5:, 5:]
    matrix = mass[:5, :5] + phi.T * mass_d * phi
    right = force[:5, 0] - phi.T * (force[5:, 0] + mass_d * b)
    accelerations = sp.symbols("acceleration1:6", real=True)
    multipliers = -mass_d * (phi * sp.Matrix(accelerations) + b) - force[5:, 0]

    state = (*system.q[:5], *system.q[7:], *system.integral, *system.p[:5])
    arguments = (state, (*system.target, *system.external), tuple(system.parameters.values()))
    results = ([*matrix, *right, *rates[2:, 0]], [*compressions, *rates, *multipliers])
    motion, rest = (
        sp.lambdify(given, values, modules="math", cse=True, docstring_limit=0)
        for given, values in zip((arguments, (*arguments, accelerations)), results, strict=True)
    )
    return motion, rest


def _accelerations(terms: Sequence[float]) -> list[float]:
    result = np.linalg.solve(np.array(terms[:25]).reshape(5, 5), np.array(terms[25:30]))
    return [float(v) for v in result]


def _slope(driven: Driven, values: tuple[float, ...]) -> Callable[[float, Floats], Floats]:
    motion = null_space()[0]

    def slope(t: float, y: Floats) -> Floats:
        state, asked = y.tolist(), driven(t)
        terms = motion(state, asked, values)
        errors = (state[3] - asked[0], state[4] - asked[1])
        return np.array([*state[9:], *terms[30:], *errors, *_accelerations(terms)])

    return slope


def _row(t: float, y: Floats, driven: Driven, values: tuple[float, ...]) -> tuple[Floats, ...]:
    """q, p, multipliers and integral at one instant."""
    motion, rest = null_space()
    state, asked = y.tolist(), driven(t)
    terms = rest(state, asked, values, _accelerations(motion(state, asked, values)))
    q = np.array([*state[:5], *terms[:2], *state[5:7]])
    return q, np.array([*state[9:], *terms[2:6]]), np.array(terms[6:]), y[7:9].copy()


def jump(y: Floats, asked: tuple[float, ...], values: Any, impulse: Floats) -> Floats:
    """An ideal impulse: M dp = J + Phi^T Lambda, Phi dp = 0, as one system of thirteen."""
    q = np.array([*y[:5], *null_space()[1](y.tolist(), asked, values, [0.0] * 5)[:2], *y[5:7]])
    flat = compiled("math")((*q.tolist(), *[0.0] * 9, *y[7:9], *asked), values)
    mass = np.array(flat[:81]).reshape(SHAPES["mass_matrix"])
    phi = np.array(flat[81:117]).reshape(SHAPES["constraint_matrix"])
    system = np.block([[mass, -phi.T], [phi, np.zeros((4, 4))]])
    jump = np.linalg.solve(system, np.concatenate([impulse, np.zeros(10)]))
    return np.asarray(y + np.concatenate([np.zeros(9), jump[:5]]))


def _advance(solver: Any, stop: float, most: int) -> None:
    """Steps until exactly `stop`, and keeps the step size that this cuts short."""
    solver.t_bound, solver.status = stop, "running"
    while solver.status == "running":
        proposed = solver.h_abs
        try:
            with np.errstate(over="raise", invalid="raise"):
                message = solver.step()
        except (ArithmeticError, ValueError) as trouble:
            raise RuntimeError(f"reference: ran away at t = {solver.t}") from trouble
        if solver.nfev > most:
            raise RuntimeError(f"reference: too much work at t = {solver.t}")
    if solver.status != "finished":
        raise RuntimeError(f"reference: {message} at t = {solver.t}")
    solver.h_abs = max(solver.h_abs, proposed)
