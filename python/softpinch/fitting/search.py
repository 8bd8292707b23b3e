"""`fit`, which finds numbers of a scene from measured motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..run.options import Options
from ..run.request import Request
from ..run.sensitivity import checked
from ..scene.directions import move_breakpoints
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.choices import Formulation, Method, Violation
from ..support.extras import require
from ..support.progress import Report, reporting
from . import problem as problems
from .experiment import Experiment, FailedRun
from .problem import Minimum, Parameter, Problem
from .result import LEVEL, Fit, correlations, reach, sandwich, sentences, uncertainty

# Estimates of the noise of several columns are repeated until none changes by more than this
# share, and at most this often.
_SETTLED, _ROUNDS = 1e-2, 10
# The median of |r| of normal noise, in standard deviations.
_MEDIAN = 0.6744897501960817
_MOST_STARTS = 10_000
# Costs within this share of the lowest one are the same minimum.
_SAME = 1e-3
# A value closer to a bound than this, in spans, counts as at the bound.
_AT_BOUND = 1e-5


def fit(
    scene: Scene | Sequence[Scene],
    times: ArrayLike | Sequence[ArrayLike],
    measured: Mapping[str, ArrayLike] | Sequence[Mapping[str, ArrayLike]],
    vary: Mapping[str, Sequence[float] | None],
    *,
    noise: Any = None,
    loss: str = "linear",
    start: Mapping[str, float] | None = None,
    multistart: int = 0,
    seed: int = 0,
    dt: float | None = None,
    method: Method = "rk4",
    formulation: Formulation = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    stop_on: Violation | Sequence[Violation] = (),
    tolerance: float | None = None,
    max_steps: int | None = None,
    progress: bool | Report = True,
) -> Fit:
    """Fits numbers of a scene to measured motions by weighted least squares.

    If the search does not converge, `Fit.converged` says so. SciPy's `least_squares` (trust region
    reflective) gets the derivatives of the simulation, see `sensitivities` of `simulate`, through
    slips, openings and impacts too. Numbers whose bounds are positive and at least a factor of ten
    apart are searched in their logarithm, in which their intervals are symmetric too. Where the
    derivatives end at an event of a contact, central differences of runs go on; `Fit.messages` says
    so of the fitted motion.

    Standard errors, covariance and intervals are those of the problem linearised at the minimum;
    `Fit.profile` has intervals without this approximation. A number whose 95 % interval would be
    as wide as its bounds (without two finite bounds: as three decades, or as a thousand times the
    start) is not determined: its standard error is infinite, its interval is the bounds, and
    `Fit.undetermined` says what the data leave open.

    Args:
        scene: The scene, or the scenes of several experiments that share the fitted numbers.
        times: The measured instants (n,), s, increasing, on the clock of the scene's start; or a
            sequence with one array for each experiment. Between the steps of `dt` the method itself
            gives the values, with a shorter step; between those of `tolerance` its own polynomial.
        measured: Observable -> what was measured, (n,) or (n, k), in SI units; NaN marks a missing
            measurement, which is left out. Or a sequence of such mappings. The observables are the
            arrays "q" (n, 9), "p" (n, 9), "multipliers" (n, 4) and "torque" (n, 2); "pose" (n, 3),
            "position" (n, 2), "rotation" (n,), "fingers", "compressions" and "shears" (n, 2) and
            "rates" (n, 5), of which `sp.linearize` has the same names; and the single columns of
            these arrays, with the names in the files of `Run.save`: "x", "theta_1", "rate of x",
            "lambda_1H", "torque_2" and so on.
        vary: Dotted path of a number -> its bounds (low, high), which may be infinite, or None,
            which allows every value, above zero if the scene refuses negative ones.
        noise: The standard deviation of the measurements' noise: a number for all observables, or
            observable -> a number or numbers (k,). What is None or missing is estimated from the
            residuals, for each column of its own; then the residuals cannot tell whether the model
            is right, and intervals are Student's. Noise is independent and normal.
        loss: "linear" is least squares. "soft_l1", 2 (sqrt(1 + r^2) - 1) of a residual r in
            standard deviations, limits the influence of outliers; estimated noise then follows
            from the median of |r|.
        start: Path -> the value at which the search starts. By default that is the value of the
            (first) scene, or the bound next to it.
        multistart: The number of further starts, from a Latin hypercube over the bounds, or over a
            decade (twice the size of the start, if that is not searched in the logarithm) around
            the start where there is no bound. Starts whose runs fail are left out.
        seed: The seed of the Latin hypercube.
        dt, method, formulation, stabilization, tolerance, max_steps: As for `simulate`.
        stop_on: The violations that end a run. A run that ends before the last measured instant has
            failed, and the search does not go there. By default none does, so that a search finds
            its way from a far start; `Fit.messages` tells of a fitted motion with violations.
        progress: As for `monte_carlo`; it counts simulations, of the most that the search from all
            starts may need.

    Raises:
        ValueError: An argument breaks its rule, the run at the start fails, or there are not more
            measurements than parameters and noise is to be estimated. Or a scene has no derivatives
            (`simulate`, `sensitivities`), or the time of an input is fitted with `dt`.

    Warns:
        StabilityWarning: `dt` is too long for the method at the start or at the minimum.
        SuspiciousValueWarning: A number of one of these scenes is far from its usual range.
    """
    how = {"stop_on": stop_on, "tolerance": tolerance, "max_steps": max_steps}
    options = Options.checked(dt, method, formulation, stabilization, **how)
    loss = checks.choice("loss", loss, problems.LOSSES)
    multistart = checks.integer("multistart", multistart, 0, _MOST_STARTS)
    seed = checks.integer("seed", seed, 0, 2**64 - 1)
    experiments = _experiments(scene, times, measured, noise)
    scenes = [each.scene for each in experiments]
    found = problems.parameters(scenes, vary, start)
    count = sum(int(each.known.sum()) for each in experiments)
    if any(each.estimated.any() for each in experiments) and count <= len(found):
        what = f"{len(found)} parameters and the noise; give the noise, or measure more"
        raise ValueError(f"measured: {count} numbers cannot determine {what}")
    paths = [each.path for each in found]
    for each in scenes:
        checked(Request(each, options), paths)
        if options.tolerance is None and move_breakpoints(each, paths):
            rule = "is fitted with tolerance=, not with dt"
            why = "between the steps on both sides of it the motion is not smooth"
            raise ValueError(f"vary: the time of a jump, a kink or an impulse {rule}: {why}")
    require("scipy.optimize", extra="study", purpose="fit")
    most = problems.MOST_EVALUATIONS * (1 + multistart)
    with reporting(progress, "fitting") as report:
        problem = Problem(experiments, found, options, loss, lambda n: report(min(n, most), most))
        problem = _with_first_noise(problem)
        best, starts, same = _best(problem, _starts(found, multistart, seed))
        problem, best = _with_estimated_noise(problem, best)
        fitted = _result(problem, best, starts, same)
        report(most, most)
    return fitted


def _experiments(scene: Any, times: Any, measured: Any, noise: Any) -> tuple[Experiment, ...]:
    if isinstance(scene, Scene):
        return (Experiment.checked(scene, times, measured, noise),)
    scenes = checks.several("scene", scene, "a Scene, or a sequence of scenes")
    if not scenes:
        raise ValueError("scene = []: must have at least one")
    for k, each in enumerate(scenes):
        checks.instance(f"scene[{k}]", each, Scene)
    if not isinstance(noise, list | tuple):
        noise = [noise] * len(scenes)
    rows = []
    for name, given in (("times", times), ("measured", measured), ("noise", noise)):
        one = checks.several(name, given, "a sequence with an entry for each scene")
        if len(one) != len(scenes):
            rule = f"must have one for each scene, {len(scenes)}"
            raise ValueError(f"{name} has {len(one)} entries: {rule}")
        rows.append(one)
    return tuple(
        Experiment.checked(one, instants, data, own, f"[{k}]")
        for k, (one, instants, data, own) in enumerate(zip(scenes, *rows, strict=True))
    )


def _with_first_noise(problem: Problem) -> Problem:
    """Checks the runs at the start; noise that is to be estimated begins as the data's spread."""
    u = np.zeros(len(problem.parameters))
    try:
        motions = problem.motions(u, derivatives=True, warns=True)
    except FailedRun as error:
        at = ", ".join(f"{k} = {v:g}" for k, v in problems.values(problem.parameters, u).items())
        raise ValueError(f"start: the run at {at} fails: {error}") from None
    noise = []
    for each, motion in zip(problem.experiments, motions, strict=True):
        own = each.noise.copy()
        for k in np.flatnonzero(each.estimated):
            known = each.known[:, k]
            data = each.data[known, k]
            sizes = [np.std(data), np.std(motion.table[known, k] - data)] if known.any() else []
            own[k] = max(sizes, default=1.0) or 1.0
        noise.append(np.maximum(own, np.where(each.estimated, each.least_noise, 0.0)))
    return problem.weighted(noise)


def _starts(found: Sequence[Parameter], multistart: int, seed: int) -> list[Floats]:
    starts = [np.zeros(len(found))]
    if multistart:
        qmc = require("scipy.stats.qmc", extra="study", purpose="multistart")
        low, high = np.array([each.bounds for each in found]).T
        low = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high - 1.0, -0.5))
        high = np.where(np.isfinite(high), high, low + 1.0)
        points = qmc.LatinHypercube(len(found), rng=np.random.default_rng(seed)).random(multistart)
        starts += list(low + points * (high - low))
    return starts


def _best(problem: Problem, starts: Sequence[Floats]) -> tuple[Minimum, int, int]:
    """Returns the lowest minimum, the number of starts used, and of those that ended there."""
    found, failed = [], ""
    for u in starts:
        try:
            # A robust loss is flat far away: least squares first, which outliers do not keep far.
            if problem.loss != "linear":
                u = problem.minimum(u, loss="linear").u
            found.append(problem.minimum(u))
        except FailedRun as error:
            failed = str(error)
    if not found:  # the runs at the first start succeed, but not all derivatives on the way
        raise ValueError(f"vary: no search came to its end: {failed}")
    best = min(found, key=lambda each: each.cost)
    limit = best.cost + _SAME * max(best.cost, 1.0)
    return best, len(found), sum(each.cost <= limit for each in found)


def _with_estimated_noise(problem: Problem, best: Minimum) -> tuple[Problem, Minimum]:
    """Estimates noise and repeats the fit with it until the noise does not change any more."""
    unknown = sum(int(each.estimated.sum()) for each in problem.experiments)
    if not unknown:
        return problem, best
    # Least squares with one common noise has the same minimum for every noise.
    columns = sum(len(each.columns) for each in problem.experiments)
    once = problem.loss == "linear" and unknown == columns == 1
    for _ in range(_ROUNDS):
        noise = _estimated(problem, best.u)
        changes = [
            np.abs(np.log(new / each.noise)).max(initial=0.0)
            for new, each in zip(noise, problem.experiments, strict=True)
        ]
        problem = problem.weighted(noise)
        if max(changes) < _SETTLED:
            break
        if not once:
            best = problem.minimum(best.u)
    else:
        best = best._replace(converged=False)
    return problem, best


def _estimated(problem: Problem, u: Floats) -> list[Floats]:
    """Estimates the noise of each column whose noise is not given, in each experiment."""
    total = sum(int(each.known.sum()) for each in problem.experiments)
    # The parameters take a share of all degrees of freedom from each column.
    share = total / (total - len(u))
    noise = []
    for each, motion in zip(problem.experiments, problem.motions(u), strict=True):
        own = each.noise.copy()
        for k in np.flatnonzero(each.estimated & each.known.any(axis=0)):
            rest = (motion.table - each.data)[each.known[:, k], k]
            size = np.sqrt(np.mean(rest * rest))
            if problem.loss != "linear":
                size = np.median(np.abs(rest)) / _MEDIAN
            own[k] = max(size * np.sqrt(share), each.least_noise[k])
        noise.append(own)
    return noise


def _result(problem: Problem, best: Minimum, starts: int, same: int) -> Fit:
    loss = problem.loss
    motions = problem.motions(best.u, derivatives=True, warns=True)
    residuals, jacobian = problem.residuals(motions), problem.jacobian(motions)
    inflation = sandwich(*problems.influence(residuals, loss)) if loss != "linear" else 1.0
    experiments = tuple(
        replace(each, fitted=motion.table, violations=motion.violations)
        for each, motion in zip(problem.experiments, motions, strict=True)
    )
    degrees = len(residuals) - len(best.u)
    guessed = any(each.estimated.any() for each in experiments)
    width = reach(LEVEL, degrees if guessed else None)
    known = uncertainty(jacobian, problem.parameters, inflation, width)
    errors = np.where(known.determined, np.sqrt(np.diag(known.covariance)), np.inf)
    low, high = problem.bounds
    bound = (best.u - low < _AT_BOUND) | (high - best.u < _AT_BOUND)
    paths = [each.path for each in problem.parameters]
    return Fit(
        converged=best.converged,
        parameters=problem.parameters,
        estimate=best.u,
        scaled_errors=errors,
        correlations=correlations(known.covariance),
        singular_values=known.singular_values,
        directions=known.directions,
        undetermined=tuple(sentences(known, problem.parameters)),
        at_bound=tuple(path for path, there in zip(paths, bound, strict=True) if there),
        by_differences=tuple(p for p in paths if any(p in motion.lost for motion in motions)),
        experiments=experiments,
        options=problem.options,
        loss=loss,
        chi_squared=float(residuals @ residuals),
        degrees_of_freedom=degrees,
        starts=starts,
        same_minimum=same,
        evaluations=problem.evaluations,
    )
