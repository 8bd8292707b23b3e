"""`advise`: finds formulation, method and step for a scene by trial runs of that scene."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .. import _core
from ..run.error_estimate import QUANTITIES
from ..run.options import some_names
from ..scene.contact import formulations_of, require_formulations
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.choices import Formulation, Method
from ..support.progress import Report, reporting
from .advice import Advice, Trial
from .setting_search import SAFE, Found, SettingSearch
from .trial_run import TrialRun
from .yardstick import Yardstick

# A run is given up if it takes this many times as long as the best of its kind, or this share of
# the time that is left.
_HOPELESS, _GREEDY = 3.0, 0.1
# A method is skipped with further formulations if one formulation took this many times as long.
_SLOW = 2.0
# Share of the budget after which no new pair is tried: the rest is for the check of the best.
_SEARCH = 0.75
# The advised run is compared at this many of its rows, and its setting is made tighter at most so
# often.
_ROWS, _TIGHTENINGS = 1000, 4
# Below this duration, s, shares of it would underflow.
_BRIEFEST = 1e-300
_KINDS = ("tolerance", "dt")
# The methods that are usually best come first, so that the search gives the others up early.
_PROMISING = {
    "tolerance": ("radau5", "dop853", "rosenbrock"),
    "dt": ("dop853", "radau5", "rk4", "rosenbrock", "implicit_midpoint"),
}


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
    adaptive steps (`tolerance`). The error of a trial is its difference from the motion, which
    adaptive steps at a much smaller tolerance compute with steps that end at the compared instants.
    From trial to trial the setting changes as the method's order tells. What cannot be the best is
    not computed: steps that are shorter than those of the best pair by the stability limit of the
    eigenvalues along the motion, and runs that have taken three times as long as the best one. With
    a `SampledController`, whose torques depend on the run, that limit is not known and not used.

    The quickest pair of both kinds is advised. It is compared with a run by another method.

    Args:
        scene: The scene to simulate. If the motion takes over 20 000 adaptive steps at a tolerance
            of 1e-8, its beginning up to there is tried; `Advice.tried` says how long that is.
        tolerance: The largest accepted error of q, p and lambda along the run, each component
            divided by its largest magnitude; from 1e-11 to 0.1.
        formulations: Formulations to try; None tries all that the scene allows, which are "csm" and
            "projected" in unilateral contact, and "csm" alone for a start off the constraints.
        methods: Methods to try.
        stabilization: The gains of (19) and (20), for "csm".
        budget: Time for the search, s; infinity tries everything. `Advice.untried` and the message
            have the pairs that it does not allow to try.
        progress: As for `monte_carlo`; it counts pairs.

    Raises:
        ValueError: An argument breaks its rule, the scene's start does, or its duration is below
            1e-300 s.
        TypeError: An argument is of the wrong kind.
        KeyboardInterrupt: Ctrl-C.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    if not scene.duration >= _BRIEFEST:
        raise ValueError(f"Scene.duration = {scene.duration}: must be >= {_BRIEFEST} s for advise")
    tolerance = checks.number("tolerance", tolerance)
    if not 1e-11 <= tolerance <= 0.1:
        raise ValueError(f"tolerance = {tolerance}: must be from 1e-11 to 0.1")
    budget = checks.number("budget", budget)
    if not budget > 0:
        raise ValueError(f"budget = {budget}: must be > 0")
    on_constraints = scene.start().check
    if formulations is None:
        formulations = formulations_of(scene) if on_constraints else "csm"
    kept = some_names("formulations", formulations, _core.FORMULATIONS)
    require_formulations("formulations", kept, scene)
    stepped = some_names("methods", methods, _core.METHODS)
    if not on_constraints and kept != ("csm",):
        raise ValueError(
            f"formulations = {kept}: a start off the constraints (check=False) is for 'csm' only"
        )
    stop = time.perf_counter() + _SEARCH * budget
    yardstick = Yardstick(scene, tolerance, stabilization)
    pairs = [(formulation, method) for formulation in kept for method in stepped]
    with reporting(progress, "trying pairs") as report:
        return _Advisor(yardstick, budget, stop, report).advise(pairs)


class _Advisor:
    """The search over all pairs of one scene.

    Attributes:
        yardstick: What the trials are compared with.
        quickest: Kind of setting -> shortest CPU time of a pair so far, s.
        found: The pairs whose setting was found, with it.
        trials: One trial for each search, in the order in which they ended.
    """

    def __init__(self, yardstick: Yardstick, budget: float, stop: float, report: Report) -> None:
        """Takes the budget, s, and when no new pair is tried, by `time.perf_counter`, s."""
        self.yardstick, self.budget, self.stop, self.report = yardstick, budget, stop, report
        self.quickest = dict.fromkeys(_KINDS, math.inf)
        self.found: list[tuple[SettingSearch, Found]] = []
        self.trials: list[Trial] = []
        self.untried: list[str] = []
        # Kind of setting -> the pair given up with the least predicted time.
        self.predicted: dict[str, Trial] = {}
        # (kind, method) -> the shortest time with a formulation, s.
        self.by_method: dict[tuple[str, str], float] = {}

    def advise(self, pairs: Sequence[tuple[Formulation, Method]]) -> Advice:
        searches = [
            SettingSearch(self.yardstick, pair, kind)
            for pair in pairs
            for kind in _KINDS
            if kind == "dt" or pair[1] in _core.ADAPTIVE_METHODS
        ]
        first: float | None = None
        for search in sorted(searches, key=_promise):
            if search.kind == "tolerance":
                self._try(search, self.yardstick.tolerance)
            else:
                first = self._first_step() if first is None else first
                self._try(search, first, search.least_time())
            self.report(len(self.trials), len(searches))
        return self._result()

    def _first_step(self) -> float:
        """The step at which searches for equal steps begin: a short one of the adaptive steps."""
        t, share = self.yardstick.trusted.t, 0.5
        if self.found:
            search, found = min(self.found, key=lambda each: each[1].time)
            t = TrialRun.of(self.yardstick.scene, search.options(found.value)).result["t"]
            share = 0.25
        # A run that is over at once has no step.
        taken = np.diff(t)
        return float(np.quantile(taken, share)) if len(taken) else self.yardstick.scene.duration

    def _try(self, search: SettingSearch, first: float, least: float = 0.0) -> None:
        """Searches the setting of one pair, unless it cannot be the best."""
        best = self.quickest[search.kind]
        key = search.kind, search.method
        if self.by_method.get(key, 0.0) > _SLOW * best:
            note = f"{search.method} is over {_SLOW:g} times as slow as the best elsewhere"
            self._add(search, None, note)
            return
        if least > _HOPELESS * best:
            note = (
                f"stable up to dt = {search.longest:.2g} s only: at least "
                f"{1e3 * least:.2g} ms a run, over {_HOPELESS:g} times as slow as the best"
            )
            self._add(search, None, note, least)
            return
        left = self.stop - time.perf_counter()
        if left <= 0 or least > _GREEDY * left:
            self.untried.append(search.name)
            why = f", at least {1e3 * least:.2g} ms a run" if least else ""
            note = f"not tried within the budget of {self.budget:g} s{why}"
            self._add(search, None, note, least)
            return
        most = min(_HOPELESS * best, _GREEDY * left)
        found, note = search.loosest(first, most, self.stop)
        if found is not None:
            found = Found(
                value=found.value,
                error=found.error,
                time=search.clock(found.value, found.time),
            )
            self.quickest[search.kind] = min(best, found.time)
            self.by_method[key] = min(self.by_method.get(key, math.inf), found.time)
        self._add(search, found, note)

    def _add(
        self, search: SettingSearch, found: Found | None, note: str, least: float = 0.0
    ) -> None:
        trial = self._trial(search, found, note)
        self.trials.append(trial)
        if found is not None:
            self.found.append((search, found))
            return
        least = max(least, search.predicted)
        known = self.predicted.get(search.kind)
        if least > 0.0 and (known is None or least / self.yardstick.share < known.time):
            self.predicted[search.kind] = replace(trial, time=least / self.yardstick.share)

    def _trial(self, search: SettingSearch, found: Found | None, note: str = "") -> Trial:
        share = self.yardstick.share
        known: dict[str, Any] = {"note": note}
        if found is not None:
            known["dt" if search.kind == "dt" else "step_tolerance"] = found.value
            known |= {"error": max(found.error.values()), "time": found.time / share}
        return Trial(
            formulation=search.formulation,
            method=search.method,
            whole=share == 1.0 and not note.startswith(("not tried", search.method)),
            **known,
        )

    def _result(self) -> Advice:
        self.found.sort(key=lambda each: each[1].time)
        best: dict[str, Trial | None] = {kind: self.predicted.get(kind) for kind in _KINDS}
        for search, found in reversed(self.found):
            best[search.kind] = self._trial(search, found)
        self.trials.sort(key=lambda trial: (not trial.whole, trial.time))
        known: dict[str, Any] = {
            "scene": self.yardstick.whole,
            "tolerance": self.yardstick.tolerance,
            "equal": best["dt"],
            "adaptive": best["tolerance"],
            "tried": self.yardstick.scene.duration,
            "untried": tuple(self.untried),
            "stabilization": self.yardstick.stabilization,
            "trials": tuple(self.trials),
        }
        for search, found in self.found:
            verified = self._verified(search, found)
            if verified is not None:
                return self._advised(search, *verified, known)
        return self._unmet(known)

    def _verified(self, search: SettingSearch, found: Found) -> tuple[Found, float, str] | None:
        """Checks a setting at many rows, and makes it tighter until the error is small enough.

        Returns:
            The setting, the difference at the end from another method, and its name; None if no
            setting close to the first one is good enough.
        """
        order = 1.0 if search.kind == "tolerance" else float(_core.ORDERS[search.method])
        value, accuracy = found.value, self.yardstick.tolerance
        for _ in range(_TIGHTENINGS):
            trial = TrialRun.of(self.yardstick.scene, search.options(value))
            errors = self.yardstick.errors(trial.run, _ROWS)
            if errors is None:
                return None
            largest = max(errors.values())
            if largest <= SAFE * accuracy:
                spent = found.time
                if value != found.value:
                    spent = search.clock(value, trial.time)
                apart, method = self.yardstick.confirm(trial.run)
                return Found(value=value, error=errors, time=spent), apart, method
            value *= float(np.clip((0.5 * SAFE * accuracy / largest) ** (1 / order), 0.01, 0.9))
        return None

    def _advised(
        self, search: SettingSearch, found: Found, apart: float, method: str, known: dict[str, Any]
    ) -> Advice:
        equal = search.kind == "dt"
        trial = self._trial(search, found)
        known["equal" if equal else "adaptive"] = trial
        margin = math.inf
        if equal:
            margin = math.nan
            if self.yardstick.limited:
                margin = self.yardstick.stable(*search.pair) / found.value
        return Advice(
            **known,
            met=apart <= self.yardstick.tolerance,
            formulation=search.formulation,
            method=search.method,
            dt=found.value if equal else None,
            step_tolerance=None if equal else found.value,
            error=found.error,
            time=trial.time,
            margin=margin,
            confirmed=apart,
            message=self._message(trial, found, known, (margin, apart, method)),
        )

    def _message(
        self,
        trial: Trial,
        found: Found,
        known: dict[str, Any],
        checked: tuple[float, float, str],
    ) -> str:
        margin, apart, method = checked
        sizes = ", ".join(f"{name} {size:.1e}" for name, size in found.error.items())
        room = "any dt is stable" if math.isinf(margin) else f"stable up to {margin:.3g} times that"
        if math.isnan(margin):
            room = "the longest stable dt is not known with a SampledController"
        parts = [
            f'take formulation="{trial.formulation}", method="{trial.method}", {trial.setting}: '
            f"error {sizes}; {1e3 * trial.time:.3g} ms a run",
            f"the best equal steps: {_cost(known['equal'])}",
            f"the best adaptive steps: {_cost(known['adaptive'])}",
        ]
        if not math.isnan(trial.dt):
            parts.append(room)
        parts.append(
            f"a run by {method} ends otherwise"
            if math.isinf(apart)
            else f"a run by {method} at a smaller tolerance ends {apart:.1e} from it"
        )
        return "; ".join([*parts, *self._left_out()])

    def _left_out(self) -> list[str]:
        parts = []
        if self.yardstick.share < 1.0:
            parts.append(
                f"only the first {self.yardstick.scene.duration:.3g} s were tried, and times are "
                "scaled up"
            )
        if self.untried:
            some = ", ".join(self.untried[:4]) + (", ..." if len(self.untried) > 4 else "")
            parts.append(f"{_pairs(len(self.untried))} not tried within {self.budget:g} s ({some})")
        return parts

    def _unmet(self, known: dict[str, Any]) -> Advice:
        """The advice if no pair meets the tolerance: the settings of the stiff adaptive run."""
        trusted = self.yardstick.trusted
        reasons = [
            f"{trial.formulation} {trial.method}: {trial.note}"
            for trial in self.trials
            if trial.note
        ]
        tolerance = self.yardstick.tolerance
        return Advice(
            **known,
            met=False,
            formulation=trusted.formulation,
            method=trusted.method,
            dt=None,
            step_tolerance=trusted.tolerance,
            error=dict.fromkeys(QUANTITIES, math.inf),
            time=math.inf,
            margin=math.inf,
            confirmed=math.inf,
            message="; ".join([f"no pair meets {tolerance:g} here", *reasons, *self._left_out()]),
        )


def _pairs(count: int) -> str:
    return "1 pair was" if count == 1 else f"{count} pairs were"


def _cost(trial: Trial | None) -> str:
    if trial is None:
        return "none"
    if not trial.found:
        pair = f"{trial.formulation} {trial.method}"
        return f"none found, at least {1e3 * trial.time:.3g} ms ({pair})"
    return f"{trial.formulation} {trial.method} {trial.setting}, {1e3 * trial.time:.3g} ms"


def _promise(search: SettingSearch) -> tuple[bool, int, int, str]:
    """Sorts the formulation without drift first, and there adaptive steps first."""
    other = search.formulation != search.yardstick.trusted.formulation
    kind = _KINDS.index(search.kind)
    place = _PROMISING[search.kind].index(search.method)
    return other, kind, place, search.formulation
