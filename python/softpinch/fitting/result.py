"""`Fit`, the result of `fit`: values, errors, and what the data leave open."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..run.options import STOP_ON, Options
from ..scene.paths import with_numbers
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats
from ..support.extras import require
from ..support.result import Result
from ..support.table import Table, save_by_suffix
from .experiment import Experiment, FailedRun
from .problem import Parameter, Problem, influence, slopes, values

LEVEL = 0.95
# Residuals as large as these, or larger, have this probability if model and noise are right.
_RARE = 1e-3
# Singular values below this share of the largest are round-off, as are small entries of directions.
_ROUND_OFF = 1e-9
_DUST = 1e-6
# A parameter takes part in a direction if its entry has at least this share of the largest.
_SHARE = 0.1
# The first step, in standard errors, and the largest one, in spans.
_FIRST, _LARGEST = 0.5, 0.125
_MOST_STEPS = 60
# Shortest step that is tried after a failed run, as a share of the first one.
_SHORTEST = 1e-3
# The ends of the interval are exact to this share of their distance from the minimum.
_PRECISION = 1e-4


def reach(level: float, degrees: int | None) -> float:
    """Returns half the width of a two-sided interval, Student's or for None normal, in errors."""
    stats = require("scipy.stats", extra="study", purpose="fit")
    share = 0.5 + 0.5 * level
    return float(stats.norm.ppf(share) if degrees is None else stats.t.ppf(share, degrees))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fit(Result):
    """Numbers of a scene, fitted to measured motions.

    Attributes:
        converged: Whether the search ended because nothing changed any more.
        parameters: The p fitted numbers with their bounds and scaled coordinates.
        estimate: The coordinates u of the minimum (p,), see `Parameter`.
        scaled_errors: The standard errors of u (p,); inf of what is not determined.
        correlations: Correlations of the estimates (p, p), from -1 to 1; finite in any case.
        singular_values: Singular values of the Jacobian of the data, over their noise, by u (p,),
            the largest first: how far a step of one in u along each of `directions` changes the
            data, in standard deviations of the noise.
        directions: The singular directions, one a row (p, p).
        undetermined: A sentence for each combination of parameters that the data do not determine.
        at_bound: The paths whose values are at a bound. Their errors are those of the linearised
            problem without bounds, and too large on the side of the bound.
        by_differences: The paths whose errors rest on differences of runs, as `messages` say.
        experiments: Each experiment with data, noise and fitted motion.
        options: How the runs were simulated; `loss` is that of `fit`.
        chi_squared: The sum of the squared residuals over their noise, without the loss.
        degrees_of_freedom: The number of measurements minus p.
        starts: The number of starts whose runs did not fail.
        same_minimum: The number of these that ended in the minimum found.
        evaluations: How often all experiments were simulated, with or without derivatives.
    """

    converged: bool
    parameters: tuple[Parameter, ...]
    estimate: Floats
    scaled_errors: Floats
    correlations: Floats
    singular_values: Floats
    directions: Floats
    undetermined: tuple[str, ...]
    at_bound: tuple[str, ...]
    by_differences: tuple[str, ...]
    experiments: tuple[Experiment, ...]
    options: Options
    loss: str
    chi_squared: float
    degrees_of_freedom: int
    starts: int
    same_minimum: int
    evaluations: int

    @property
    def values(self) -> dict[str, float]:
        """Path -> fitted value."""
        return values(self.parameters, self.estimate)

    @property
    def standard_errors(self) -> dict[str, float]:
        """Path -> standard error of the value; inf if the data do not determine it."""
        sizes = np.abs(slopes(self.parameters, self.estimate)) * self.scaled_errors
        return dict(zip(self.values, sizes.tolist(), strict=True))

    @property
    def covariance(self) -> Floats:
        """Covariance (p, p) of `values`; inf and NaN of what the data do not determine."""
        sizes = np.array(list(self.standard_errors.values()))
        sizes[np.isinf(sizes)] = np.nan
        found = self.correlations * np.outer(sizes, sizes)
        unknown = np.flatnonzero(np.isnan(sizes))
        found[unknown, unknown] = np.inf
        return found

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Path -> 95 % confidence interval (low, high), see `confidence`."""
        return self.confidence(LEVEL)

    def confidence(self, level: float = LEVEL) -> dict[str, tuple[float, float]]:
        """Returns path -> confidence interval (low, high), from the standard errors.

        An interval is symmetric about the estimate in u, and ends at the bounds; it is the bounds
        for what the data do not determine. It is Student's if noise was estimated.
        """
        half = self._reach(checks.share("level", level)) * self.scaled_errors
        found = {}
        for each, u, by in zip(self.parameters, self.estimate.tolist(), half.tolist(), strict=True):
            ends = (each.value(u - by), each.value(u + by)) if np.isfinite(by) else None
            found[each.path] = ends or (each.low, each.high)
        return found

    def profile(self, path: str, level: float = LEVEL) -> Profile:
        """Follows the profile likelihood of one number: its interval without linearisation.

        Along the profile the number has given values and all others are fitted again. The interval
        is where the sum of squares exceeds its minimum by less than the square of the normal or
        Student's quantile. It takes some ten to thirty fits of the other numbers.
        """
        index = list(self.values).index(checks.choice("path", path, self.values))
        level = checks.share("level", level)
        limit, u = self._reach(level) ** 2, self.estimate
        problem = Problem(self.experiments, self.parameters, self.options, self.loss)
        psi, slope = influence(problem.residuals(problem.motions(u)), self.loss)
        # A robust loss grows less than the sum of squares of its residuals.
        scale = 2.0
        if self.loss != "linear":
            scale /= sandwich(psi, slope) * float(np.mean(slope))
        least = problem.minimum(u, held=index).cost
        step = min(_FIRST * float(self.scaled_errors[index]), _LARGEST)
        (low, low_closed, before), (high, high_closed, after) = (
            _side(problem, u, index, way * step, scale, least, limit) for way in (-1.0, 1.0)
        )
        points = sorted({(u[index], 0.0), *before, *after})
        value = self.parameters[index].value
        return Profile(
            path=path,
            level=level,
            interval=(value(low), value(high)),
            closed=(low_closed, high_closed),
            values=np.array([value(float(at)) for at, _ in points]),
            increase=np.array([increase for _, increase in points]),
            limit=limit,
        )

    def _reach(self, level: float) -> float:
        return reach(level, self.degrees_of_freedom if self.noise_estimated else None)

    @property
    def noise_estimated(self) -> bool:
        """Whether some of the noise was estimated from the residuals."""
        return any(bool(each.estimated.any()) for each in self.experiments)

    @cached_property
    def scenes(self) -> tuple[Scene, ...]:
        """The scene of each experiment with the fitted values put in."""
        return tuple(with_numbers(each.scene, self.values) for each in self.experiments)

    @property
    def scene(self) -> Scene:
        """The scene with the fitted values put in; of several experiments take `scenes`."""
        self._only("scene", "scenes")
        return self.scenes[0]

    @property
    def residuals(self) -> dict[str, Floats]:
        """As `Experiment.residuals`; of several experiments take `experiments[k].residuals`."""
        return self._only("residuals", "experiments[k].residuals").residuals

    def _only(self, name: str, instead: str) -> Experiment:
        if (count := len(self.experiments)) > 1:
            raise ValueError(f"Fit.{name}: there are {count} experiments; take Fit.{instead}")
        return self.experiments[0]

    @property
    def messages(self) -> tuple[str, ...]:
        """Sentences that a reader of the values must know; empty if there are none."""
        found = [] if self.converged else ["the search did not converge"]
        found += self.undetermined
        found += [f"{path} is at its bound" for path in self.at_bound]
        ends = "has differences of runs for derivatives, which end at an event of a contact"
        found += [f"{path} {ends}" for path in self.by_differences]
        if not self.noise_estimated and self.degrees_of_freedom > 0 and self.loss == "linear":
            stats = require("scipy.stats", extra="study", purpose="fit")
            if stats.chi2.sf(self.chi_squared, self.degrees_of_freedom) < _RARE:
                ratio = np.sqrt(self.chi_squared / self.degrees_of_freedom)
                size = f"{ratio:.3g} times as large as the noise that was given"
                why = "the model or the noise is wrong, and so are the errors"
                found.append(f"the residuals are {size}: {why}")
        for k, each in enumerate(self.experiments):
            where = f" of experiment {k}" if len(self.experiments) > 1 else ""
            found += [
                f"the fitted motion{where} is {name} from t = {each.violations[name]:.6g} s on"
                for name in STOP_ON
                if name in each.violations
            ]
        if self.same_minimum < self.starts:
            found.append(f"{self.same_minimum} of {self.starts} starts ended in this minimum")
        return tuple(found)

    def table(self) -> Table:
        """Returns a table with a row for each number: value, error, interval and bounds."""
        errors, ends = self.standard_errors, self.intervals
        return Table(
            columns=("path", "unit", "value", "standard error", "low", "high",
                     "lower bound", "upper bound"),
            rows=tuple(
                (each.path, each.unit, self.values[each.path], errors[each.path],
                 *ends[each.path], each.low, each.high)
                for each in self.parameters
            ),
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Numbers, messages and scenes as plain data; infinite numbers are text, for JSON."""
        table = self.table()
        names = [name.replace(" ", "_") for name in table.columns]
        rows = [[str(e) if e in (np.inf, -np.inf) else e for e in row] for row in table.rows]
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "converged": self.converged,
            "messages": list(self.messages),
            "parameters": [dict(zip(names, row, strict=True)) for row in rows],
            "correlations": self.correlations.tolist(),
            "noise": [
                dict(zip(e.columns, e.noise.tolist(), strict=True)) for e in self.experiments
            ],
            "noise_estimated": self.noise_estimated,
            "chi_squared": self.chi_squared,
            "degrees_of_freedom": self.degrees_of_freedom,
            "loss": self.loss,
            "options": self.options.to_dict(),
            "scenes": [scene.to_dict() for scene in self.scenes],
        }

    def save(self, path: str | Path) -> Path:
        """Writes `to_dict` as a `.json` file, or `table` as a `.csv` file; returns the path."""

        def as_json(file: Path) -> None:
            text = json.dumps(self.to_dict(), indent=2, allow_nan=False, default=str)
            file.write_text(text + "\n", encoding="utf-8")

        return save_by_suffix(path, {".json": as_json, ".csv": self.table().save})

    def __repr__(self) -> str:
        count = len(self.experiments)
        measured = self.degrees_of_freedom + len(self.parameters)
        several = f" of {count} experiments" if count > 1 else ""
        noise = ", noise estimated" if self.noise_estimated else ""
        head = f"<Fit of {len(self.parameters)} numbers to {measured} measurements{several}{noise}"
        lines = [head, *self.lines(), *self.messages]
        return "\n  ".join(lines) + ">"

    def lines(self) -> list[str]:
        """Returns a line for each number: value, standard error, unit and 95 % interval."""
        width = max(len(each.path) for each in self.parameters)
        errors, ends = self.standard_errors, self.intervals
        found = []
        for each in self.parameters:
            value, error = self.values[each.path], errors[each.path]
            unit = each.shown_unit
            low, high = ends[each.path]
            digits = 6
            if value and error and np.isfinite(error):
                # The last digit is the second one of the error.
                digits = int(np.clip(np.floor(np.log10(abs(value) / error)) + 2, 3, 12))
            body = f"not determined within {low:g} to {high:g}{unit}"
            if np.isfinite(error):
                body = f"{value:.{digits}g} ± {error:.2g}{unit}, "
                body += f"95 %: {low:.{digits}g} to {high:.{digits}g}"
            found.append(f"{each.path:{width}}  {body}")
        return found


class Uncertainty(NamedTuple):
    """Uncertainty of the coordinates u in the linearised problem; see `Fit`."""

    covariance: Floats  # of u (p, p); large but finite where the data determine nothing
    singular_values: Floats  # of the weighted Jacobian by u (p,), the largest first
    directions: Floats  # the singular directions, one a row (p, p)
    determined: NDArray[np.bool_]  # whether each interval has less than its `room` (p,)


def uncertainty(
    jacobian: Floats, parameters: Sequence[Parameter], inflation: float, reach: float
) -> Uncertainty:
    """Evaluates derivatives (N, p) of residuals by u; a robust loss needs an `inflation`."""
    p = jacobian.shape[1]
    # Rows of zeros let fewer measurements than parameters have all p directions.
    padded = np.vstack([jacobian, np.zeros((max(0, p - len(jacobian)), p))])
    _, sizes, directions = np.linalg.svd(padded, full_matrices=False)
    # The largest entry of a direction is positive.
    signs = np.sign(directions[np.arange(p), np.abs(directions).argmax(axis=1)])
    directions = directions * signs[:, None]
    clean = np.where(np.abs(directions) < _DUST, 0.0, directions)
    least = max(_ROUND_OFF * sizes[0], 1e-150)
    covariance = inflation * (clean.T / np.maximum(sizes, least) ** 2) @ clean
    known = sizes > least
    exact = np.array([not clean[~known, k].any() for k in range(p)])
    room = np.array([each.room for each in parameters])
    determined = exact & (2.0 * reach * np.sqrt(np.diag(covariance)) < room)
    return Uncertainty(covariance, sizes, directions, determined)


def sandwich(psi: Floats, slope: Floats) -> float:
    """Returns the factor of an M-estimate's covariance (Huber and Ronchetti, 2009, 7.6)."""
    return float(np.mean(psi * psi) / np.mean(slope) ** 2)


def correlations(covariance: Floats) -> Floats:
    """Returns the correlations (p, p) of a covariance."""
    sizes = np.sqrt(np.diag(covariance))
    return np.asarray(np.clip(covariance / np.outer(sizes, sizes), -1.0, 1.0))


def sentences(found: Uncertainty, parameters: Sequence[Parameter]) -> Iterator[str]:
    """Says which combinations of parameters the data do not determine."""
    # They are the singular directions that give undetermined parameters most of their variance.
    least = _ROUND_OFF * max(float(found.singular_values[0]), 1e-150)
    entries = np.abs(found.directions)
    shares = entries / np.maximum(found.singular_values, least)[:, None]
    shares[entries < _SHARE * entries.max(axis=1, keepdims=True)] = 0.0
    weak = {int(shares[:, k].argmax()) for k in np.flatnonzero(~found.determined)}
    for which in sorted(weak):
        size, direction = found.singular_values[which], found.directions[which]
        largest = np.abs(direction).max()
        # The step along the direction that takes the foremost parameter through its whole span.
        change = float(size / largest)
        part = np.abs(direction) >= _SHARE * largest
        names = [each.path for each, has_part in zip(parameters, part, strict=True) if has_part]
        noise = f"changes the data by {change:.2g} standard deviations of the noise in all"
        if len(names) == 1:
            one = parameters[int(np.flatnonzero(part)[0])]
            whole = "a factor of ten" if one.log else f"a change by {one.span:g}{one.shown_unit}"
            if np.isfinite(one.high - one.low):
                whole = f"its whole range, {one.low:g} to {one.high:g}{one.shown_unit},"
            yield f"the data do not determine {names[0]}: {whole} {noise}, by the slope at the fit"
            continue
        joined = f"{', '.join(names[:-1])} and {names[-1]}"
        moves = _changes_in_words(parameters, np.where(part, direction, 0.0))
        effect = _step_for_a_tenth(parameters, direction) * float(size)
        noise = f"change the data by {effect:.2g} standard deviations of the noise in all"
        yield f"the data do not determine {joined} separately: {moves} together {noise}"


def _step_for_a_tenth(parameters: Sequence[Parameter], direction: Floats) -> float:
    """The step after which the foremost parameter has changed by a tenth of its value or span."""
    index = int(np.abs(direction).argmax())
    share = np.log(1.1) / parameters[index].span if parameters[index].log else 0.1
    return float(share / abs(direction[index]))


def _changes_in_words(parameters: Sequence[Parameter], direction: Floats) -> str:
    step = _step_for_a_tenth(parameters, direction) * direction
    texts = []
    for each, by in zip(parameters, step.tolist(), strict=True):
        if by == 0.0:
            continue
        if each.log:
            texts.append(f"{each.path} {100.0 * np.expm1(by * each.span):+.2g} %")
        else:
            texts.append(f"{each.path} {by * each.span:+.2g}{each.shown_unit}")
    return " and ".join(texts)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Profile(Result):
    """The profile likelihood of one fitted number.

    Attributes:
        path: Its path; `level` is that of the interval.
        interval: (low, high) of the number. An end may be its bound, which may be infinite; see
            `closed`.
        closed: Whether the interval ends before the bound, or before a value with failed runs, on
            either side.
        values: Values of the number along the profile (m,), increasing.
        increase: How far the sum of the squared residuals, over their noise, exceeds its minimum
            there, with all other numbers fitted (m,).
        limit: The increase at the ends of the interval.
    """

    path: str
    level: float
    interval: tuple[float, float]
    closed: tuple[bool, bool]
    values: Floats
    increase: Floats
    limit: float


def _side(
    problem: Problem, u: Floats, index: int, step: float, scale: float, least: float, limit: float
) -> tuple[float, bool, list[tuple[float, float]]]:
    """Returns the end of the interval on one side, whether it is closed, and the profile."""
    optimize = require("scipy.optimize", extra="study", purpose="fit")
    bound = float(problem.bounds[0 if step < 0.0 else 1, index])
    warm, points, first = u.copy(), [(float(u[index]), 0.0)], abs(step)

    def increase(at: float) -> float:
        start = warm.copy()
        start[index] = at
        end = problem.minimum(start, held=index)
        warm[:] = end.u
        found = scale * (end.cost - least)
        points.append((at, found))
        return found

    for _ in range(_MOST_STEPS):
        before = points[-1]
        at = before[0] + step
        at = max(at, bound) if step < 0.0 else min(at, bound)
        if at == before[0]:
            return bound, False, points
        try:
            now = increase(at)
        except FailedRun:
            step *= 0.5
            if abs(step) < _SHORTEST * first:
                return before[0], False, points
            continue
        if now >= limit:
            ends = {before[0]: before[1], at: now}

            def excess(x: float, ends: dict[float, float] = ends) -> float:
                """Nearly linear in u, because the increase is nearly a parabola."""
                found = ends[x] if x in ends else increase(x)
                return float(np.sqrt(max(found, 0.0)) - np.sqrt(limit))

            near = _PRECISION * abs(at - float(u[index]))
            root = optimize.brentq(excess, before[0], at, xtol=near)
            return float(root), True, points
        step = float(np.copysign(min(1.5 * abs(step), _LARGEST), step))
    return points[-1][0], False, points
