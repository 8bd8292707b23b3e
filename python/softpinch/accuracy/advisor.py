"""`advise`: finds formulation, method and step for a scene by trial runs of that scene."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from .. import _core
from ..run import Request, Run, computed, simulate
from ..run.options import MOST_STEPS
from ..scene import ESTIMATED, Scene, Stabilization
from ..support import Formulation, Method, Report, Result, checks, reporting
from .reference_motion import ReferenceMotion
from .runs import cpu_times, largest_that_holds, pairs_of, timed_run

# A run may take this many times as long as the best of its kind, and this share of the time left.
_TOO_SLOW, _OF_TIME_LEFT = 3.0, 0.1
# Share of the budget after which no new pair is tried: the rest is for the check of the best.
_SEARCH = 0.75
# The search aims at the first share of the accuracy, and accepts errors up to the second.
_AIM, _SAFE = 0.3, 0.6
# The search ends where a looser setting would save less than this share of the time.
_LEAST_SAVING = 0.25
# From one setting to the next, the time of a run changes by at most about this factor.
_FACTOR = 1.5
# A pair is given up after this many runs.
_MOST_TRIALS = 12
# Steps stay below this share of the stability limit.
_STABLE = 0.8
# At most this many rows of a run are kept: between them errors hardly differ.
_MOST_ROWS = 100_000
# Number of steps of the run that shows how long a step takes.
_FEW = 300
# The shortest time of a step of any method, s.
_SHORTEST = 5e-7
# Number of timed repetitions of a run, and the time, s, from which the run is not repeated.
_REPEATS, _LONG = 5, 0.05
# Smaller errors count as this one, whose inverse has a square that does not overflow.
_LEAST = 1e-100
# The range of the tolerances of adaptive steps.
_TIGHTEST, _LOOSEST = 1e-13, 1e-2
# The advised run is compared at this many rows, and its setting is tightened at most so often.
_ROWS, _TIGHTENINGS = 1000, 4
_KINDS = ("tolerance", "dt")
# The methods that are usually best come first, so that the search gives the others up early.
_PROMISING: Mapping[str, tuple[Method, ...]] = {
    "tolerance": ("radau5", "dop853", "rosenbrock"),
    "dt": ("dop853", "radau5", "rk4", "rosenbrock", "implicit_midpoint"),
}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trial(Result):
    """A pair of formulation and method that was tried, with equal or with adaptive steps."""

    formulation: Formulation
    method: Method
    # The longest step, s, or the largest tolerance found whose error is small enough; nan if none
    # was found, and of the other kind of steps.
    dt: float = math.nan
    step_tolerance: float = math.nan
    error: float = math.inf  # with this setting, the largest of q, p and lambda; inf without one
    # CPU time of a run, s, scaled up to the whole scene; if no setting was found inf, but in
    # `Advice.equal` and `Advice.adaptive` a lower bound.
    time: float = math.inf
    whole: bool = False  # tried on the whole scene, not only on its beginning
    note: str = ""  # why the pair was given up, or not tried; empty if it was not given up

    @property
    def found(self) -> bool:
        """Whether a setting was found whose error is small enough."""
        return math.isfinite(self.error)

    @property
    def setting(self) -> str:
        """The setting as an argument of `simulate`, such as "dt=0.0001"; "" if none was found."""
        if not self.found:
            return ""
        if math.isnan(self.dt):
            return f"tolerance={self.step_tolerance:.3g}"
        return f"dt={self.dt:.3g}"

    @property
    def summary(self) -> str:
        """Pair, setting and time, or the lower bound of the time if no setting was found."""
        pair = f"{self.formulation} {self.method}"
        if not self.found:
            return f"none found, at least {1e3 * self.time:.3g} ms ({pair})"
        return f"{pair} {self.setting}, {1e3 * self.time:.3g} ms"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Advice(Result):
    """The cheapest formulation, method and step for a scene and an accuracy.

    Attributes:
        scene: The scene to simulate.
        tolerance: The required accuracy.
        met: Whether the advised settings meet the tolerance. If no pair met it, they are those of
            the run with which the trials were compared, and the errors are inf.
        formulation: As of `simulate`, and so is `method`.
        dt: The longest of equal steps, s; None if adaptive steps are advised.
        step_tolerance: The tolerance of adaptive steps; None if equal steps are advised.
        error: "q", "p", "multipliers" -> error, the largest along the run, each component divided
            by its largest magnitude.
        time: CPU time of a run that keeps only its last state, s.
        margin: Factor by which dt may grow until the method becomes unstable; inf if it never does,
            and with adaptive steps; NaN with equal steps and a `SampledController`.
        confirmed: Difference at the end (if a violation ends the run, a step earlier) from a run by
            another method with adaptive steps at a smaller tolerance, the largest of q, p and
            lambda. The tolerance is met only if this difference is within it.
        equal: The quickest pair with equal steps, as `adaptive` with adaptive steps; or the one
            given up with the least predicted time; or None.
        tried: Length of the part of the scene, from its start, on which the pairs were tried, s.
        untried: The pairs that the budget did not allow to try, such as "csm rk4, dt".
        stabilization: The gains with which "csm" was tried.
        trials: Every pair, first those tried on the whole scene, by time; a method with adaptive
            steps appears twice.
        message: The advice in words.
    """

    scene: Scene
    tolerance: float
    met: bool
    formulation: Formulation
    method: Method
    dt: float | None
    step_tolerance: float | None
    error: Mapping[str, float]
    time: float
    margin: float
    confirmed: float
    equal: Trial | None
    adaptive: Trial | None
    tried: float
    untried: tuple[str, ...]
    stabilization: Stabilization
    trials: tuple[Trial, ...]
    message: str

    def simulate(self, **options: Any) -> Run:
        """Simulates the scene as advised, with `dt` or with `step_tolerance`.

        Options are further arguments of `simulate`, such as `record` and `every`. One that the
        advice chooses is a TypeError.
        """
        return simulate(
            self.scene,
            dt=self.dt,
            tolerance=self.step_tolerance,
            method=self.method,
            formulation=self.formulation,
            stabilization=self.stabilization,
            **options,
        )

    def _facts(self) -> dict[str, Any]:
        """The setting before everything else, with dt and the tolerance in one entry."""
        values = self._values()
        dt, tolerance = values.pop("dt"), values.pop("step_tolerance")
        steps = f"adaptive: dt = None, step_tolerance = {tolerance}"
        if dt is not None:
            steps = f"equal: dt = {dt:.5g}, step_tolerance = None"
        first = ("formulation", "method", "tolerance", "met", "error", "time")
        return {"steps": steps, **{name: values[name] for name in first}, **values}

    def __str__(self) -> str:
        return self.message


def advise(
    scene: Scene,
    tolerance: float = 1e-6,
    *,
    formulations: Formulation | Sequence[Formulation] | None = None,
    methods: Method | Sequence[Method] = _core.METHODS,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    budget: float = 2.0,
    progress: bool | Report = True,
) -> Advice:
    """Finds the cheapest formulation, method and step with which a scene meets a tolerance.

    Every pair of formulation and method is tried with equal steps (`dt`) and, if it has them, with
    adaptive steps (`tolerance`). A bisection finds the loosest setting that is accurate enough. The
    error of a trial is its difference from a run at a much smaller tolerance, whose steps end at
    the compared instants. Not tried is what would take three times as long as the best run, nor
    steps beyond the stability limit of the eigenvalues along the motion, which is not known with a
    `SampledController`. The quickest pair is advised, and compared with a run by another method.

    Args:
        scene: The scene to simulate. If the motion takes over 20 000 adaptive steps at a tolerance
            of 1e-8, its beginning up to there is tried; `Advice.tried` says how long that is.
        tolerance: The largest accepted error of q, p and lambda along the run, each component
            divided by its largest magnitude; from 1e-11 to 0.1.
        formulations, methods: What to try; None tries all formulations that the scene allows, "csm"
            and "projected" in unilateral contact, "csm" alone for a start off the constraints.
        stabilization: As for `simulate`.
        budget: Time for the search, s; infinity tries everything. `Advice.untried` and the message
            have the pairs that it does not allow to try.
        progress: As for `monte_carlo`; it counts pairs.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    rule = "must be from 1e-11 to 0.1"
    tolerance = checks.number_that("tolerance", tolerance, lambda x: 1e-11 <= x <= 0.1, rule)
    budget = checks.number_that("budget", budget, lambda x: x > 0.0, "must be > 0")
    on_constraints = scene.start().check
    if formulations is None and not on_constraints:
        formulations = "csm"
    pairs = pairs_of(scene, formulations, methods)
    if not on_constraints and {formulation for formulation, _ in pairs} != {"csm"}:
        why = "a start off the constraints (check=False) is for 'csm' only"
        raise ValueError(f"formulations = {formulations}: {why}")
    stop = perf_counter() + _SEARCH * budget
    motion = ReferenceMotion(scene, tolerance, stabilization)
    with reporting(progress, "trying pairs") as report:
        return _Advisor(motion, budget, stop).advise(pairs, report)


class _GivenUp(Exception):
    """The search for a setting ended; the message has the reason."""


class _Search:
    """The search for the loosest setting, "dt" or "tolerance", of one pair that is good enough.

    `least_time` is a lower bound of the CPU time of a run, s, if the search gave up; else 0.
    """

    def __init__(
        self, motion: ReferenceMotion, formulation: Formulation, method: Method, kind: str
    ) -> None:
        self.motion, self.kind = motion, kind
        self.pair: dict[str, Any] = {"formulation": formulation, "method": method}
        order = float(_core.ORDERS[method])
        # The error grows with this power of the setting. Time falls with the inverse of dt, and
        # about with this root of a tolerance.
        self.order, self._root = (order, 1.0) if kind == "dt" else (1.0, order)
        self.least_time = 0.0
        self._duration = float(motion.scene.duration)
        self._step_time = 0.0
        # Setting -> its error; inf if the run does not end as it should.
        self._errors: dict[float, float] = {}

    @cached_property
    def longest(self) -> float:
        """The longest step to try, s, or the largest tolerance."""
        if self.kind == "tolerance":
            return _LOOSEST
        return min(_STABLE * self.motion.stable(**self.pair), self._duration)

    def request(self, value: float, most: float = math.inf) -> Request:
        """A run with one setting; adaptive steps stop after about `most` s."""
        how = {**self.pair, self.kind: value}
        if self.kind == "dt":
            how["every"] = max(1, math.ceil(self._duration / value / _MOST_ROWS))
        elif most < math.inf:
            how["max_steps"] = int(min(100 + most / _SHORTEST, MOST_STEPS))
        return self.motion.request(**how)

    def loosest(self, first: float, most: float, deadline: float) -> Trial:
        """Finds the loosest setting that is accurate enough, by runs of `most`, s, or less."""
        accuracy, longest = self.motion.tolerance, self.longest
        least = _TIGHTEST if self.kind == "tolerance" else 0.0

        def error(value: float) -> float:
            if value not in self._errors:
                self._errors[value] = self._error(value, most, deadline)
            return self._errors[value]

        value = min(first, longest)
        if self.kind == "dt":
            # If the first step is too expensive, begin with the shortest that is not.
            value = min(max(value, 1.01 * value * self.expected(value) / most), longest)
        try:
            # Two steps by the method's order come close to the limit, and bisection finds it.
            for _ in range(2):
                found, change = error(value), 0.25
                if found < math.inf:
                    change = (_AIM * accuracy / max(found, _LEAST)) ** (1.0 / self.order)
                value = min(max(value * min(max(change, 1.0 / 30.0), 30.0), least), longest)
            largest_that_holds(
                lambda value: error(value) <= _SAFE * accuracy,
                value,
                least,
                longest,
                factor=_FACTOR**self._root,
                accuracy=(1.0 + _LEAST_SAVING) ** self._root - 1.0,
            )
            note = f"even {self.kind} = {least:.2g} is not enough"
        except _GivenUp as reason:
            note = str(reason)
        good = [value for value, found in self._errors.items() if found <= _SAFE * accuracy]
        if not good:
            return self.trial(note=note)
        value = max(good)
        return self.trial(value, error=self._errors[value], time=self.whole_time(value))

    def trial(self, value: float = math.nan, note: str = "", **found: Any) -> Trial:
        """The result of the search: a setting with its error and time, or why there is none."""
        found["dt" if self.kind == "dt" else "step_tolerance"] = value
        whole = self.motion.share == 1.0 and not note.startswith("not tried")
        return Trial(**self.pair, **found, note=note, whole=whole)

    def whole_time(self, value: float) -> float:
        """The measured CPU time of a run, s, scaled up to the whole scene."""
        request = self.request(value)
        once = timed_run(request.with_(record=()))[1]
        spent = once if once > _LONG else statistics.median(cpu_times(request, _REPEATS))
        return spent / self.motion.share

    def _error(self, value: float, most: float, deadline: float) -> float:
        """The largest error of a run; raises `_GivenUp` if it would take too long."""
        if perf_counter() > deadline:
            raise _GivenUp("the budget ended before a setting was good enough")
        if len(self._errors) == _MOST_TRIALS:
            raise _GivenUp("no setting was good enough")
        if self.kind == "dt" and (least := self.expected(value)) > most:
            self.least_time = least
            raise _GivenUp(f"dt = {value:.2g} s or less would take {1e3 * least:.2g} ms a run")
        run, spent = timed_run(self.request(value, most))
        if run.status == "too_many_steps":
            self.least_time = spent
            raise _GivenUp(f"tolerance = {value:.2g} takes over {1e3 * spent:.2g} ms a run")
        if run.stats["steps"] >= _FEW:
            self._step_time = max(spent / run.stats["steps"], _SHORTEST)
        errors = self.motion.errors(run)
        return math.inf if errors is None else max(errors.values())

    def expected(self, dt: float) -> float:
        """The expected CPU time of a run with equal steps, s."""
        if not self._step_time:
            short = replace(self.motion.scene, duration=min(_FEW * dt, self._duration))
            run, spent = timed_run(self.request(dt).with_(short))
            # A run that fails soon says little.
            self._step_time = max(spent / max(run.stats["steps"], _FEW // 2), _SHORTEST)
        # A step ends at each switch of an input.
        return self._step_time * max(self._duration / dt, len(self.motion.switches))


class _Advisor:
    """The search over all pairs of one scene, until the instant `stop`, by `perf_counter`, s."""

    def __init__(self, motion: ReferenceMotion, budget: float, stop: float) -> None:
        self.motion, self.budget, self.stop = motion, budget, stop
        self.found: list[tuple[_Search, Trial]] = []
        self.trials: list[Trial] = []
        self.untried: list[str] = []
        # Kind of setting -> the quickest pair so far, or the one given up with the least time.
        self.best: dict[str, Trial | None] = dict.fromkeys(_KINDS)

    def advise(self, pairs: Sequence[tuple[Formulation, Method]], report: Report) -> Advice:
        # The formulation without drift comes first, and within a formulation adaptive steps.
        searches = [
            _Search(self.motion, formulation, method, kind)
            for other in (False, True)
            for kind in _KINDS
            for method in _PROMISING[kind]
            for formulation in _core.FORMULATIONS
            if (formulation, method) in pairs
            and (formulation != self.motion.run.formulation) == other
        ]
        # A run that is over at once has no step.
        steps = np.diff(self.motion.run.t) if len(self.motion.run) > 1 else [math.inf]
        first = {"tolerance": self.motion.tolerance, "dt": float(np.median(steps))}
        for search in searches:
            self._add(search, self._search_unless_hopeless(search, first[search.kind]))
            report(len(self.trials), len(searches))
        self.found.sort(key=lambda each: each[1].time)
        self.trials.sort(key=lambda trial: (not trial.whole, trial.time))
        for search, trial in self.found:
            advice = self._verified(search, trial)
            if advice is not None:
                return advice
        # No pair meets the tolerance: the settings of the stiff adaptive run.
        accurate = self.motion.run
        return self._advice(
            [
                f"no pair meets {self.motion.tolerance:g} here",
                *(f"{one.formulation} {one.method}: {one.note}" for one in self.trials if one.note),
            ],
            met=False,
            formulation=accurate.formulation,
            method=accurate.method,
            dt=None,
            step_tolerance=accurate.tolerance,
            error=dict.fromkeys(ESTIMATED, math.inf),
            **dict.fromkeys(("time", "margin", "confirmed"), math.inf),
        )

    def _search_unless_hopeless(self, search: _Search, first: float) -> Trial:
        """Searches the setting of one pair, unless it cannot be the best."""
        known = self.best[search.kind]
        best = known.time * self.motion.share if known and known.found else math.inf
        left = self.stop - perf_counter()
        least = 0.0
        # Adaptive or few steps may take no time to speak of.
        worth = search.kind == "dt" and (left > 0 or known is None)
        if worth and self.motion.scene.duration > _FEW * search.longest:
            least = search.least_time = search.expected(search.longest)
        if least > _TOO_SLOW * best:
            cost = f"at least {1e3 * least:.2g} ms a run"
            slow = f"{cost}, over {_TOO_SLOW:g} times as slow as the best"
            return search.trial(note=f"stable up to dt = {search.longest:.2g} s only: {slow}")
        if left <= 0 or least > _OF_TIME_LEFT * left:
            self.untried.append(f"{' '.join(search.pair.values())}, {search.kind}")
            why = f", at least {1e3 * least:.2g} ms a run" if least else ""
            return search.trial(note=f"not tried within the budget of {self.budget:g} s{why}")
        return search.loosest(first, min(_TOO_SLOW * best, _OF_TIME_LEFT * left), self.stop)

    def _add(self, search: _Search, trial: Trial) -> None:
        self.trials.append(trial)
        if trial.found:
            self.found.append((search, trial))
        elif search.least_time > 0.0:
            trial = replace(trial, time=search.least_time / self.motion.share)
        else:
            return
        known = self.best[search.kind]
        if known is None or (not trial.found, trial.time) < (not known.found, known.time):
            self.best[search.kind] = trial

    def _verified(self, search: _Search, trial: Trial) -> Advice | None:
        """Checks a setting at many rows, and makes it tighter, but not by much: else None."""
        equal, accuracy = search.kind == "dt", self.motion.tolerance
        value = first = trial.dt if equal else trial.step_tolerance
        for _ in range(_TIGHTENINGS):
            run = computed(search.request(value))
            errors = self.motion.errors(run, _ROWS)
            if errors is None:
                return None
            largest = max(errors.values())
            if largest <= _SAFE * accuracy:
                break
            change = (0.5 * _SAFE * accuracy / largest) ** (1 / search.order)
            value *= float(np.clip(change, 0.01, 0.9))
        else:
            return None
        spent = trial.time if value == first else search.whole_time(value)
        trial = self.best[search.kind] = search.trial(value, error=largest, time=spent)
        margin, stability = math.inf, "any dt is stable"
        if equal and self.motion.scene.law == "sampled":
            margin = math.nan
            stability = "the longest stable dt is not known with a SampledController"
        elif equal and math.isfinite(limit := self.motion.stable(**search.pair)):
            margin = limit / value
            stability = f"stable up to {margin:.3g} times that"
        apart, method = self.motion.confirm(run)
        sizes = ", ".join(f"{name} {size:.1e}" for name, size in errors.items())
        found = {kind: best.summary if best else "none" for kind, best in self.best.items()}
        parts = [
            f'take formulation="{trial.formulation}", method="{trial.method}", {trial.setting}: '
            f"error {sizes}; {1e3 * trial.time:.3g} ms a run",
            f"the best equal steps: {found['dt']}",
            f"the best adaptive steps: {found['tolerance']}",
            *([stability] if equal else []),
            f"a run by {method} ends otherwise"
            if math.isinf(apart)
            else f"a run by {method} at a smaller tolerance ends {apart:.1e} from it",
        ]
        return self._advice(
            parts,
            met=apart <= accuracy,
            **search.pair,
            dt=value if equal else None,
            step_tolerance=None if equal else value,
            error=errors,
            time=trial.time,
            margin=margin,
            confirmed=apart,
        )

    def _advice(self, parts: list[str], **found: Any) -> Advice:
        tried = self.motion.scene.duration
        if self.motion.share < 1.0:
            parts.append(f"only the first {tried:.3g} s were tried, and times are scaled up")
        if self.untried:
            count = len(self.untried)
            pairs = "1 pair was" if count == 1 else f"{count} pairs were"
            some = ", ".join(self.untried[:4]) + (", ..." if count > 4 else "")
            parts.append(f"{pairs} not tried within {self.budget:g} s ({some})")
        return Advice(
            scene=self.motion.full,
            tolerance=self.motion.tolerance,
            equal=self.best["dt"],
            adaptive=self.best["tolerance"],
            tried=tried,
            untried=tuple(self.untried),
            stabilization=self.motion.stabilization,
            trials=tuple(self.trials),
            message="; ".join(parts),
            **found,
        )
