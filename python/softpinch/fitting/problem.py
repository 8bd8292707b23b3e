"""The numbers that a fit varies, and its least-squares problem in scaled coordinates."""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from ..run.options import Options
from ..scene.fields import units
from ..scene.parts import jaws
from ..scene.paths import resolve
from ..scene.scene import Scene
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Floats
from ..support.extras import require
from ..support.result import Result
from .experiment import Experiment, FailedRun, Motion

LOSSES = ("linear", "soft_l1")
# A search ends at these relative changes of the cost and of u. That of the cost leaves an error of
# a ten-thousandth of the standard error; that of u is for data without noise, whose cost tends to
# zero.
_OF_COST, _OF_STEP = 1e-8, 1e-10
# The largest number of simulations in a search from one start, without those for the Jacobian.
MOST_EVALUATIONS = 100
# Half the distance in u of the runs whose difference takes the place of a missing derivative.
_APART = 1e-3
# Bounds with at least this ratio are searched in the logarithm.
_DECADES = 10.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Parameter(Result):
    """A number that is fitted.

    The search has the coordinate u, which is 0 at `start` and grows by 1 over `span`. So a step of
    one is the whole allowed range, or if that is infinite a decade (with `log`) or the size of the
    start.
    """

    path: str
    unit: str
    low: float  # the least allowed value, which may be -inf
    high: float  # the largest allowed value, which may be inf
    start: float  # where the search starts
    log: bool  # whether u is proportional to the logarithm of the value
    span: float  # the change of the value, or of its natural logarithm, along a step of one in u

    def value(self, u: float) -> float:
        """Returns the value at the coordinate u, within the bounds."""
        with np.errstate(over="ignore"):
            step = np.float64(self.span) * u
            found = self.start * np.exp(step) if self.log else self.start + step
        return float(min(max(found, self.low), self.high))

    def slope(self, u: float) -> float:
        """Returns the derivative of the value by u."""
        return self.value(u) * self.span if self.log else self.span

    def coordinate(self, value: float) -> float:
        """Returns u of a value; -inf for 0 and `log`."""
        if not self.log:
            return (value - self.start) / self.span
        return math.log(value / self.start) / self.span if value > 0.0 else -math.inf

    @property
    def shown_unit(self) -> str:
        """Its unit after a space; empty for "1"."""
        return "" if self.unit == "1" else f" {self.unit}"

    @property
    def room(self) -> float:
        """The width of an interval of u from which on the number counts as not determined."""
        low, high = self.bounds
        return min(high - low, 3.0 if self.log else 1e3)

    @property
    def bounds(self) -> tuple[float, float]:
        """The bounds of u."""
        return self.coordinate(self.low), self.coordinate(self.high)


def parameters(
    scenes: Sequence[Scene], vary: Mapping[str, object], start: Mapping[str, object] | None
) -> tuple[Parameter, ...]:
    """Makes the parameters of a fit; the search starts at the values of the first scene."""
    if not isinstance(vary, Mapping):
        rule = "must map paths to bounds (low, high), or to None"
        raise TypeError(f"vary = {checks.shown(vary)}: {rule}")
    if not vary:
        raise ValueError("vary = {}: must have at least one path")
    for path in vary:
        if not isinstance(path, str):
            rule = "must be one path; one number for several paths is not supported"
            raise TypeError(f"vary: the key {checks.shown(path)} {rule}")
    templates = [SceneTemplate(scene, vary, 0) for scene in scenes]
    templates[0].require_numbers("vary")
    if start is not None and not isinstance(start, Mapping):
        raise TypeError(f"start = {checks.shown(start)}: must map paths of vary to numbers")
    for path in start or {}:
        checks.choice("start", path, vary)
    return tuple(_parameter(templates[0], path, ends, start or {}) for path, ends in vary.items())


def _parameter(
    template: SceneTemplate, path: str, bounds: object, start: Mapping[str, object]
) -> Parameter:
    name = f'vary["{path}"]'
    if path == "duration":
        raise ValueError('vary: "duration": the measured times determine it')
    # The scene's own value, which for a mass of a tip that is None is the mass of the object.
    slots, scene = template.slots.get(path), template.scene
    value = float(scene.parameters()[slots[0]] if slots else resolve(scene, path))
    low, high = (-math.inf, math.inf) if bounds is None else _bounds(name, bounds)
    log = low > 0.0 and math.log(high) - math.log(low) >= math.log(_DECADES)
    if bounds is None and value > 0.0:
        try:
            template.changed({path: -value})
        except ValueError:
            low, log = 0.0, True
    value = min(max(value, low), high)
    if path in start:
        value = checks.finite(f'start["{path}"]', start[path])
        if not low <= value <= high or (log and value <= 0.0):
            rule = f"must be within the bounds {low:g} and {high:g}"
            raise ValueError(f'start["{path}"] = {value}: {rule}')
    if log:
        finite = low > 0.0 and math.isfinite(high)
        span = math.log(high) - math.log(low) if finite else math.log(_DECADES)
    else:
        span = high - low if math.isfinite(high - low) else abs(value) or 1.0
    unit = units(path, (), jaws(scene))
    assert isinstance(unit, str)
    return Parameter(path=path, unit=unit, low=low, high=high, start=value, log=log, span=span)


def _bounds(name: str, given: object) -> tuple[float, float]:
    ends = checks.several(name, given, "bounds (low, high), or None")
    if len(ends) != 2:
        raise ValueError(f"{name} = {checks.shown(given)}: must be bounds (low, high), or None")
    low, high = checks.not_nan(f"{name}: low", ends[0]), checks.not_nan(f"{name}: high", ends[1])
    if not low < high:
        raise ValueError(f"{name}: high = {high:g}: must be above low = {low:g}")
    return low, high


def values(parameters: Sequence[Parameter], u: Floats) -> dict[str, float]:
    """Returns path -> value at the coordinates u (p,)."""
    return {each.path: each.value(at) for each, at in zip(parameters, u.tolist(), strict=True)}


def slopes(parameters: Sequence[Parameter], u: Floats) -> Floats:
    """Returns the derivatives of the values by u (p,)."""
    return np.array([each.slope(at) for each, at in zip(parameters, u.tolist(), strict=True)])


class Minimum(NamedTuple):
    """The end of a search."""

    u: Floats  # the coordinates of the parameters (p,)
    cost: float  # half the sum of the loss
    converged: bool  # whether the search ended because nothing changed any more


@dataclass
class Problem:
    """Residuals (model minus data, over noise) as functions of the coordinates u (p,)."""

    experiments: tuple[Experiment, ...]
    parameters: tuple[Parameter, ...]
    options: Options
    loss: str
    report: Callable[[int], object] = lambda _: None  # takes the number of evaluations
    evaluations: int = 0

    @property
    def bounds(self) -> Floats:
        """The bounds of u (2, p)."""
        return np.array([each.bounds for each in self.parameters]).T

    def weighted(self, noise: Sequence[Floats]) -> Self:
        """Returns this problem with other noise, (c,) for each experiment."""
        pairs = zip(self.experiments, noise, strict=True)
        return replace(self, experiments=tuple(replace(each, noise=own) for each, own in pairs))

    def motions(self, u: Floats, derivatives: bool = False, warns: bool = False) -> list[Motion]:
        """Simulates all experiments; derivatives are by u. It may warn as `simulate` does."""
        put = values(self.parameters, u)
        found: list[Motion] = []
        for each in self.experiments:
            motion = each.simulated(put, self.options, derivatives, warns)
            if motion.slope is not None:
                slope = motion.slope * slopes(self.parameters, u)
                motion = self._without_gaps(each, motion, slope, u)
            found.append(motion)
        self.evaluations += 1
        self.report(self.evaluations)
        return found

    def _without_gaps(self, of: Experiment, motion: Motion, slope: Floats, u: Floats) -> Motion:
        """Fills what has no derivatives, from an event of a contact on, by differences of runs."""
        gaps = np.isnan(slope.sum(axis=1, keepdims=True))
        missing = np.flatnonzero(gaps.any(axis=(0, 1)))
        for k in missing:
            runs = []
            for end in np.clip(u[k] + np.array([-_APART, 0.0, _APART]), *self.bounds[:, k]):
                moved = np.where(np.arange(len(u)) == k, end, u)
                with contextlib.suppress(FailedRun):  # the other side is left
                    run = of.simulated(values(self.parameters, moved), self.options, False)
                    runs.append((end, run.table))
            (low, before), (high, after) = runs[0], runs[-1]
            if low == high:
                raise FailedRun(f"no derivatives or differences by {self.parameters[k].path}")
            apart = (after - before) / (high - low)
            slope = np.where(gaps & (np.arange(len(u)) == k), apart[..., None], slope)
        return motion._replace(slope=slope, lost=tuple(self.parameters[k].path for k in missing))

    def residuals(self, motions: Sequence[Motion]) -> Floats:
        """Returns the weighted residuals of all measurements (N,)."""
        pairs = zip(self.experiments, motions, strict=True)
        return np.concatenate([((m.table - e.data) / e.noise)[e.known] for e, m in pairs])

    def jacobian(self, motions: Sequence[Motion]) -> Floats:
        """Returns the derivatives of the weighted residuals by u (N, p)."""
        rows = []
        for each, motion in zip(self.experiments, motions, strict=True):
            assert motion.slope is not None
            rows.append((motion.slope / each.noise[:, None])[each.known])
        return np.concatenate(rows)

    def minimum(self, start: Floats, held: int | None = None, loss: str | None = None) -> Minimum:
        """Searches from a start (p,) whose runs succeed, else `FailedRun`; `held` is kept."""
        loss = loss or self.loss
        optimize = require("scipy.optimize", extra="study", purpose="fit")
        free = np.array([k for k in range(len(start)) if k != held], dtype=int)
        low, high = self.bounds[:, free]
        u = start.copy()
        u[free] = np.clip(start[free], low, high)
        # SciPy's first trust region is as large as its start, which shall not depend on the origin
        # of u: beside zero it would be tiny, and the search could take its start for its end.
        shift = u[free] - 1.0 / np.sqrt(max(len(free), 1))

        def put(some: Floats) -> Floats:
            u[free] = np.clip(some + shift, low, high)
            return u

        def residuals(some: Floats) -> Floats:
            if np.array_equal(put(some), begin):
                return first
            try:
                return self.residuals(self.motions(put(some)))
            except FailedRun:
                return np.full(count, np.inf)  # SciPy shortens the step

        def jacobian(some: Floats) -> Floats:
            return self.jacobian(self.motions(put(some), derivatives=True))[:, free]

        begin, first = u.copy(), self.residuals(self.motions(u))
        count = len(first)
        if not len(free):
            return Minimum(start.copy(), 0.5 * float(losses(first, loss).sum()), True)
        ends = {"ftol": _OF_COST, "xtol": _OF_STEP, "gtol": _OF_STEP, "max_nfev": MOST_EVALUATIONS}
        bounds = low - shift, high - shift
        found: Any = optimize.least_squares(
            residuals, u[free] - shift, jac=jacobian, bounds=bounds, loss=loss, **ends
        )
        return Minimum(put(found.x).copy(), float(found.cost), found.status > 0)


def losses(residuals: Floats, loss: str) -> Floats:
    """Returns the loss of each residual r: r^2, or 2 (sqrt(1 + r^2) - 1) of "soft_l1"."""
    square = residuals * residuals
    return square if loss == "linear" else 2.0 * (np.sqrt(1.0 + square) - 1.0)


def influence(residuals: Floats, loss: str) -> tuple[Floats, Floats]:
    """Returns psi, half the derivative of the loss, and the derivative of psi."""
    if loss == "linear":
        return residuals, np.ones_like(residuals)
    root = np.sqrt(1.0 + residuals * residuals)
    return residuals / root, root**-3
