"""Trajectories to compare with: SciPy's methods on the equations that SymPy derives.

The four compressions and shears follow the other five coordinates (docs/integrators.md, "How the
constraints are kept", `nullspace`): no gain to choose, no drift. Fourteen states: x, y, theta,
theta_1, theta_2, the two shears, the two integrals of (39), and the five rates. The integration
between the breaks of the inputs, and the inputs, are those of softpinch.accuracy.segments:
tests/accuracy/test_segments.py compares the integration with an oscillator in closed form,
tests/core/test_oracle_inputs.py compares the inputs with numbers computed by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from softpinch import Scene
from softpinch.accuracy.segments import Inputs, System, integrate
from softpinch.run.scaled_error import UNITS, by_row, scales

from .evaluate import evaluate, parameters
from .lagrangian import FORCES, PARAMETERS, SHAPES, SIDES, compiled, model

Floats: TypeAlias = NDArray[np.float64]


def error(result: Any, expected: Any) -> dict[str, float]:
    """A run's error by quantity, of those that both have; the instants must be equal.

    tests/accuracy/test_reference.py has its definition in numbers.
    """
    if not np.array_equal(np.asarray(result.t), np.asarray(expected.t)):
        raise ValueError("error: the result's instants differ from those it is compared with")
    along = getattr(expected, "scales", None)
    found = {}
    for name in UNITS:
        if hasattr(result, name) and hasattr(expected, name):
            rows, right = (np.asarray(getattr(one, name), np.float64) for one in (result, expected))
            scale = along[name] if along else scales(name, right)
            found[name] = float(by_row(rows, right, scale).max(initial=0.0))
    return found


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
    scene: Scene,
    times: ArrayLike | None = None,
    method: str = "DOP853",
    rtol: float = 1e-12,
) -> Reference:
    """Integrates a scene from break to break of its inputs.

    Nothing is monitored: the motion goes on where the model has stopped holding.

    Args:
        scene: With bilateral contact and PIDs.
        times: (n,), s, within the run; None is the start, every break and the end.
        method: One of scipy.integrate's, an implicit one by finite differences.
        rtol: Relative tolerance; the absolute one is a share of it, of fixed sizes.
    """
    numbers = parameters(scene)
    values = tuple(numbers[name] for name in PARAMETERS)
    state, begin = _start(scene, numbers)
    inputs = Inputs(scene, begin, begin + float(scene.duration))
    instants, wanted = inputs.instants(times)
    length = max(numbers[f"hand.{side}.length"] for side, _ in SIDES)
    sizes = np.array([length, length, 1, 1, 1, length, length, 1, 1, length, length, 1, 1, 1])
    motion = integrate(
        System(_rates(values), lambda y, impulse: jump(y, values, impulse)),
        inputs,
        state,
        wanted,
        method=method,
        rtol=rtol,
        sizes=sizes,
        most=1_000_000,  # the paper's eight operations take 150 000
    )
    picked = np.searchsorted(motion.t, wanted)
    rows = [_row(motion.y[k], tuple(motion.u[k].tolist()), values) for k in picked]
    q, p, multipliers, integral = map(np.array, zip(*rows, strict=True))
    return Reference(instants, q, p, multipliers, integral, motion.evaluations)


def _start(scene: Scene, numbers: dict[str, float]) -> tuple[Floats, float]:
    """The fourteen states at the start, and its time."""
    start = scene.start()
    off = evaluate(numbers, start.q, start.p)
    zeros = {"residuals": np.zeros(4), "residual_rates": np.zeros(2)}
    if max(off.differences(zeros).values()) > 1e-10:
        raise ValueError("initial: off the constraints, which this form cannot be")
    state = np.concatenate([start.q[:5], start.q[7:], start.integral, start.p[:5]])
    return state, float(start.time)


def start_state(scene: Scene) -> tuple[Floats, float]:
    """q, p and the integrals (20,) at the start, which may be off the constraints, and its time."""
    start = scene.start()
    return np.concatenate([start.q, start.p, start.integral]), float(start.time)


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


def _rates(values: tuple[float, ...]) -> Callable[..., tuple[float, ...]]:
    motion = null_space()[0]

    def rates(state: tuple[float, ...], asked: tuple[float, ...]) -> tuple[float, ...]:
        terms = motion(state, asked, values)
        errors = (state[3] - asked[0], state[4] - asked[1])
        return (*state[9:], *terms[30:], *errors, *_accelerations(terms))

    return rates


def _row(y: Floats, asked: tuple[float, ...], values: tuple[float, ...]) -> tuple[Floats, ...]:
    """q, p, multipliers and integral at one instant."""
    motion, rest = null_space()
    state = y.tolist()
    terms = rest(state, asked, values, _accelerations(motion(state, asked, values)))
    q = np.array([*state[:5], *terms[:2], *state[5:7]])
    return q, np.array([*state[9:], *terms[2:6]]), np.array(terms[6:]), y[7:9].copy()


def jump(y: Floats, values: Sequence[float], impulse: Sequence[float]) -> Floats:
    """An ideal impulse: M dp = J + Phi^T Lambda, Phi dp = 0, as one system of thirteen."""
    asked = [0.0] * 5
    q = np.array([*y[:5], *null_space()[1](y.tolist(), asked, values, [0.0] * 5)[:2], *y[5:7]])
    flat = compiled("math")((*q.tolist(), *[0.0] * 9, *y[7:9], *asked), values)
    mass = np.array(flat[:81]).reshape(SHAPES["mass_matrix"])
    phi = np.array(flat[81:117]).reshape(SHAPES["constraint_matrix"])
    system = np.block([[mass, -phi.T], [phi, np.zeros((4, 4))]])
    jump = np.linalg.solve(system, np.concatenate([impulse, np.zeros(10)]))
    return np.asarray(y + np.concatenate([np.zeros(9), jump[:5]]))
