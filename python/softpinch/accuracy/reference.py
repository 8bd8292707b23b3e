"""Reference solutions: accurate trajectories to compare with, public as `softpinch.reference`.

SciPy integrates the null-space form of the equations (`null_space`), with the inputs of `driven`,
over each interval between two breaks of the inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..run import scaled_error
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.result import Result
from .integrate import Problem, Rough
from .null_space import PARAMETERS, Equations, parameters, right_hand_side
from .walker import METHODS, Walker

__all__ = [
    "METHODS",
    "PARAMETERS",
    "Equations",
    "Reference",
    "confirmed",
    "parameters",
    "right_hand_side",
    "solve",
]

# The smallest relative tolerance that SciPy accepts, 100 times round-off.
_TIGHTEST = 2.3e-14
# A scene counts as stiff if stability makes an explicit method need more evaluations than this, or
# more than this multiple of the evaluations of the rough pass.
_MOST_EXPLICIT = 2_000_000
_STIFF = 50
# The most evaluations of the confirming method at a tenth of the tolerance.
_MOST_TIGHTER = 150_000


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Reference(Result):
    """A reference trajectory with a row for each of n requested instants.

    Attributes:
        t: Instants (n,), s.
        q: Coordinates (n, 9), m and rad.
        p: Rates of the coordinates (n, 9), m/s and rad/s; at an impulse, just before it.
        multipliers: Multipliers (n, 4), N; at a break, just after it, but at the end just before.
        integral: Integrals of the angle errors in (39), (n, 2), rad s.
        method: The method that solved the scene, and the method that confirmed the solution.
        evaluations: Number of evaluations of the right-hand side, including those for Jacobians
            and for the confirmation.
        scales: "q" (9,), "p" (9,) and "multipliers" (4,) -> the largest magnitude of each component
            at the ends of all steps, by which errors are divided.
        own_error: "q", "p" and "multipliers" -> the largest scaled difference to the confirming
            method; None without confirmation.
    """

    t: Floats
    q: Floats
    p: Floats
    multipliers: Floats
    integral: Floats
    method: str
    evaluations: int
    scales: Mapping[str, Floats]
    own_error: Mapping[str, float] | None = None


def solve(
    scene: Scene,
    times: ArrayLike | None = None,
    *,
    method: str = "DOP853",
    rtol: float = 1e-12,
    most: int = 5_000_000,
    tolerance: float = 1e-10,
    rates: Callable[..., Any] | None = None,
) -> Reference:
    """Integrates a scene over each interval between two breaks of its inputs.

    One-step methods end a step at every requested instant instead of interpolating, because the
    dense output of DOP853 has only order 7. LSODA and BDF evaluate their own polynomials.

    Args:
        scene: The scene, with bilateral contact; its friction coefficient is not used.
        times: Requested instants (n,), s, on the clock of schedule and disturbances, within the
            run, in any order; None requests the start, every break and the end.
        method: A SciPy method, one of `METHODS`.
        rtol: Relative tolerance of a step, raised to 2.3e-14 if smaller. The absolute tolerance is
            a share of `rtol` times each state's magnitude along the run, which a rough pass
            determines: a hundredth, but a tenth for LSODA, and all of it for Radau and BDF.
        most: The largest number of evaluations of the right-hand side.
        tolerance: The largest constraint residual of the start, relative to the magnitudes of the
            terms in the constraint.
        rates: A function to use instead of `right_hand_side().rates`, for example a compiled one;
            its arguments are tuples.

    Raises:
        ValueError: The start violates the constraints, an instant is outside of the run, or the
            scene has unilateral contact or driven fingers.
        TypeError: An argument is of the wrong kind.
        RuntimeError: The motion diverges, often because the grasp is lost, or needs more than
            `most` evaluations; the message has the time.
        ImportError: SciPy is not installed.
    """
    method = checks.choice("method", method, METHODS)
    rtol = max(checks.positive("rtol", rtol), _TIGHTEST)
    most = checks.integer("most", most, 1)
    problem = Problem(scene, times, tolerance, rates)
    rough = problem.rough(most)
    return _solved(problem, rough, problem.walker(method, rtol, rough.sizes, most))


def confirmed(
    scene: Scene,
    times: ArrayLike | None = None,
    *,
    rtol: float = 1e-12,
    most: int = 5_000_000,
    tolerance: float = 1e-10,
    rates: Callable[..., Any] | None = None,
) -> Reference:
    """Solves a scene by two methods and compares the solutions.

    The first solution is returned. Its method is DOP853, or Radau if the eigenvalues along a rough
    pass show that stability would limit the steps of an explicit method. The second method is LSODA
    (Adams and BDF), at a tenth of the tolerance if that is cheap, and otherwise at the tolerance.
    If LSODA fails, the first method repeats the run at ten times the tolerance, which is a weaker
    confirmation. `Reference.method` names both methods.

    Args:
        scene: As `solve`.
        times: As `solve`.
        rtol: As `solve`.
        most: The largest number of evaluations of the right-hand side, for each method.
        tolerance: As `solve`.
        rates: As `solve`.

    Returns:
        The first solution with `own_error`, which includes the errors of both methods, mostly that
        of LSODA.

    Raises:
        ValueError: As `solve`.
        TypeError: As `solve`.
        RuntimeError: As `solve`.
        ImportError: As `solve`.
    """
    rtol = max(checks.positive("rtol", rtol), _TIGHTEST)
    most = checks.integer("most", most, 1)
    problem = Problem(scene, times, tolerance, rates)
    rough = problem.rough(most)
    stiff = rough.explicit > min(most, _MOST_EXPLICIT, _STIFF * rough.evaluations)
    name = "Radau" if stiff else "DOP853"
    first = _solved(problem, rough, problem.walker(name, rtol, rough.sizes, most))
    tighter = max(0.1 * rtol, _TIGHTEST), min(most, _MOST_TIGHTER)
    attempts = (("LSODA", *tighter), ("LSODA", rtol, most), (name, 10.0 * rtol, most))
    walkers = [
        problem.walker(method, tolerance, rough.sizes, limit)
        for method, tolerance, limit in attempts
    ]
    second = _first_to_finish(problem, rough, walkers)
    return replace(
        first,
        method=f"{first.method}, confirmed by {second.method}",
        evaluations=first.evaluations + sum(walker.evaluations for walker in walkers),
        own_error=scaled_error.largest(second, first),
    )


def _first_to_finish(problem: Problem, rough: Rough, walkers: Sequence[Walker]) -> Reference:
    for walker in walkers[:-1]:
        try:
            return _solved(problem, rough, walker)
        except RuntimeError:
            continue
    return _solved(problem, rough, walkers[-1])


def _solved(problem: Problem, rough: Rough, walker: Walker) -> Reference:
    wanted = np.unique(problem.wanted)
    path = [(t, y, driven(t)) for t, y, driven in walker.walk(wanted.tolist())]
    times, states, inputs = (np.array(column) for column in zip(*path, strict=True))
    along = problem.rows(states, inputs)
    usual = scaled_error.usual(problem.scene)
    picked = np.searchsorted(times, problem.wanted)
    rows = {name: read_only(column[picked]) for name, column in along.items()}
    return Reference(
        t=problem.t,
        q=rows["q"],
        p=rows["p"],
        multipliers=rows["multipliers"],
        integral=rows["integral"],
        method=walker.name,
        evaluations=walker.evaluations + rough.evaluations,
        scales={
            name: read_only(scaled_error.scales(name, along[name], usual))
            for name in scaled_error.UNITS
        },
    )
