"""Trajectories to compare with; `softpinch.reference` is what users see of it.

SciPy integrates the null-space form of `null_space`, with the inputs of `driven`, break by break.
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
from .integrate import METHODS, Problem, Rough, Way
from .null_space import PARAMETERS, Equations, parameters, right_hand_side

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

# SciPy asks for no less than 100 times round-off.
_TIGHTEST = 2.3e-14
# What an explicit method, and a second one that is to do better, may cost in evaluations.
_MOST_EXPLICIT = 2_000_000
# Where stability costs an explicit method so many times what the rough pass takes, it is stiff.
_STIFF = 50
_MOST_TIGHTER = 150_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference(Result):
    """A reference trajectory; its n rows are the wanted instants.

    Attributes:
        t: (n,), s.
        q: (n, 9), m and rad.
        p: (n, 9), m/s and rad/s; at an impulse just before it.
        multipliers: (n, 4), N; at a break just after it, but at the end just before.
        integral: (n, 2), of the angles' errors in (39), rad s.
        method: How it was solved, and confirmed.
        evaluations: Of the right-hand side, those of Jacobians and of the confirmation included.
        scales: By "q" (9,), "p" (9,) and "multipliers" (4,) how large each component gets at the
            ends of all steps, rows or not: what errors are divided by.
        own_error: By the same names the largest difference to the second method, so divided; None
            where there was none.
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
    """Integrates a scene from break to break of its inputs.

    One-step methods end a step on every wanted instant: nothing is interpolated, as DOP853's dense
    output is of order 7. LSODA's rows are of its own polynomial, which is what it integrates.

    Args:
        scene: The physics; friction plays no part.
        times: (n,), s, on the clock of schedule and disturbances, within the run, in any order;
            None is the start, every break and the end.
        method: One of SciPy's, of `METHODS`.
        rtol: Relative tolerance of a step, 2.3e-14 if less. The absolute one is a hundredth of it
            (LSODA a tenth, Radau and BDF the same) of each state's own size along the run, which a
            rough pass finds.
        most: Evaluations of the right-hand side.
        tolerance: How far the start may be off the constraints, of the terms that they are made of.
        rates: Stands in for `right_hand_side().rates`, compiled perhaps; it gets tuples.

    Raises:
        ValueError: The start is off the constraints, or an instant is outside of the run.
        TypeError: An argument is of the wrong kind.
        RuntimeError: The motion runs away (a lost grasp, often) or takes more than `most`; the
            message has the time.
        ImportError: SciPy is not installed.
    """
    method = checks.choice("method", method, METHODS)
    rtol = max(checks.positive("rtol", rtol), _TIGHTEST)
    most = checks.integer("most", most, 1)
    problem = Problem(scene, times, tolerance, rates)
    rough = problem.rough(most)
    return _solved(problem, rough, Way(problem, method, rtol, rough.sizes, most))


def confirmed(
    scene: Scene,
    times: ArrayLike | None = None,
    *,
    rtol: float = 1e-12,
    most: int = 5_000_000,
    tolerance: float = 1e-10,
    rates: Callable[..., Any] | None = None,
) -> Reference:
    """Solves a scene by two methods and says by how much they differ.

    The first, which is returned, is DOP853; Radau where, by the eigenvalues along a rough pass,
    it is stability that would make an explicit method's steps short. The second is LSODA (Adams and
    BDF), at a tenth of the tolerance where that is cheap; or where LSODA does not get there the
    first at ten times the tolerance, which confirms less. `method` says which it was.

    Args:
        scene: As `solve`.
        times: As `solve`.
        rtol: As `solve`.
        most: Evaluations of the right-hand side, by each.
        tolerance: As `solve`.
        rates: As `solve`.

    Returns:
        With `own_error`: both methods' errors together, in effect, and LSODA's for the most part.

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
    first = _solved(problem, rough, Way(problem, name, rtol, rough.sizes, most))
    tighter = max(0.1 * rtol, _TIGHTEST), min(most, _MOST_TIGHTER)
    attempts = (("LSODA", *tighter), ("LSODA", rtol, most), (name, 10.0 * rtol, most))
    ways = [Way(problem, *how[:2], rough.sizes, how[2]) for how in attempts]
    second = _first_to_finish(problem, rough, ways)
    return replace(
        first,
        method=f"{first.method}, confirmed by {second.method}",
        evaluations=first.evaluations + sum(way.evaluations for way in ways),
        own_error=scaled_error.largest(second, first),
    )


def _first_to_finish(problem: Problem, rough: Rough, ways: Sequence[Way]) -> Reference:
    for way in ways[:-1]:
        try:
            return _solved(problem, rough, way)
        except RuntimeError:
            continue
    return _solved(problem, rough, ways[-1])


def _solved(problem: Problem, rough: Rough, way: Way) -> Reference:
    wanted = np.unique(problem.wanted)
    path = [(t, y, driven(t)) for t, y, driven in way.walk(wanted.tolist())]
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
        method=way.name,
        evaluations=way.evaluations + rough.evaluations,
        scales={
            name: read_only(scaled_error.scales(name, along[name], usual))
            for name in scaled_error.UNITS
        },
    )
