"""Which formulation, method and step a scene needs: found by trying, on the scene itself."""

from __future__ import annotations

import math
import statistics
import time
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from .. import _core
from ..run import scaled_error
from ..run.error_estimate import QUANTITIES, ErrorEstimate, estimate
from ..run.options import Options, some_names
from ..run.simulate import whole
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.errors import StabilityWarning
from .advice import Advice, Trial
from .stability import along_run, trusted_run

_RECORD = ("state", "multipliers")

# The pilot is the busiest window of the run, of this share, between these lengths, s.
_PILOT, _SHORTEST, _LONGEST = 0.05, 0.02, 0.2
# Estimates aim at this share of the tolerance, and must stay below the second.
_AIM, _SAFE = 0.3, 0.6
# How often a step is changed before a pair is given up.
_ROUNDS = 12
# So many of the pilot's cheapest pairs are tried on the whole scene.
_FINALISTS = 3
# Explicit methods keep this far from where they would let a mode grow.
_STABLE = 0.8
# No more rows are kept of a run: errors between them do not differ.
_ROWS = 100_000
# No trial takes more steps than this, before they are halved.
_MOST_STEPS = 5_000_000
# A pair that takes so many times as long as the best one so far is given up.
_HOPELESS = 4.0
# And so are the others with its method, where one formulation takes so many times as long.
_SLOW = 2.0
# Differences below this share of the largest with their unit are round-off.
_ROUND_OFF = 1e-12
# Errors below this share of the tolerance need not fall with the step: round-off does not.
_NOTHING = 0.01
# The run that confirms has this share of the tolerance, but no less than the second.
_TIGHTER, _TIGHTEST = 1e-3, 1e-13
# Most often the best come first, so that the others are given up early.
_PROMISING = ("dop853", "radau5", "rk4", "rosenbrock", "implicit_midpoint")


def advise(
    scene: Scene,
    tolerance: float = 1e-6,
    *,
    formulations: str | Sequence[str] = _core.FORMULATIONS,
    methods: str | Sequence[str] = _core.METHODS,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
) -> Advice:
    """The cheapest formulation, method and step with which a scene meets a tolerance.

    A stiff run with free steps finds the busiest window of the scene, the pilot. There the step of
    every pair is changed until its error, estimated by halving and quartering the step, is below
    the tolerance; the three cheapest are then tried in the same way on the whole scene, so that a
    disturbance after the pilot counts. The best of them is compared with a run by another method.

    It takes some dozens of times as long as the run that it advises.

    Args:
        scene: What is to be simulated.
        tolerance: The largest error of q, p and lambda along the run, each component against its
            largest size; from 1e-11 to 0.1.
        formulations: Which may be advised.
        methods: Which may be advised.
        stabilization: The gains of (19) and (20), for "csm".

    Raises:
        ValueError: An argument breaks its rule, or the scene's start does.
        TypeError: An argument is of the wrong kind.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    tolerance = checks.number("tolerance", tolerance)
    if not 1e-11 <= tolerance <= 0.1:
        raise ValueError(f"tolerance = {tolerance}: must be from 1e-11 to 0.1")
    kept = some_names("formulations", formulations, _core.FORMULATIONS)
    stepped = some_names("methods", methods, _core.METHODS)
    if not scene.start().check and kept != ("csm",):
        raise ValueError(
            f"formulations = {kept}: a start off the constraints (check=False) is for 'csm' only"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StabilityWarning)
        return _Advisor(scene, tolerance, stabilization).advise(
            [(formulation, method) for formulation in kept for method in stepped]
        )


class _Advisor:
    """What all pairs of a scene are judged by."""

    def __init__(self, scene: Scene, tolerance: float, stabilization: Stabilization) -> None:
        self.scene = scene
        self.tolerance = tolerance
        self.stabilization = stabilization
        # By "csm" only from a start that may be off the constraints, which is one for that alone.
        self.trusted = trusted_run(scene, "csm", stabilization, record=_RECORD)
        # What is round-off of the largest with its unit, or of what is usual, is no error.
        usual = scaled_error.usual(scene)
        self.scales = {
            name: np.maximum(
                scaled_error.scales(name, getattr(self.trusted, name), usual),
                _ROUND_OFF
                / tolerance
                * scaled_error.common(name, getattr(self.trusted, name), usual),
            )
            for name in QUANTITIES
        }
        self.pilot = self._busiest()
        self.limits: dict[str, Floats] = {}
        self.quickest = math.inf
        self.spent = 0.0

    def _busiest(self) -> Scene:
        """The window of the run in which the stiff method took the most steps."""
        duration, t = self.scene.duration, self.trusted.t
        length = min(max(_PILOT * duration, _SHORTEST), _LONGEST)
        if length >= duration or len(t) < 4:
            return self.scene
        last = np.searchsorted(t, t + length)
        first = int(np.argmax(np.where(t + length <= t[0] + duration, last - np.arange(len(t)), 0)))
        state = replace(self.trusted.state(first), grid=None, linearized=None)
        return replace(self.scene, initial=state, duration=length)

    def stable(self, formulation: str, method: str) -> float:
        """The longest step that lets no mode grow along the run, s."""
        if formulation not in self.limits:
            along = along_run(self.trusted, formulation, self.stabilization)
            steps = [np.nanmin(along.stable_step(each), initial=np.inf) for each in _core.METHODS]
            self.limits[formulation] = np.array(steps)
        return float(self.limits[formulation][_core.METHODS.index(method)])

    def options(self, pair: tuple[str, str], scene: Scene, dt: float) -> Options:
        formulation, method = pair
        return Options(
            dt=dt,
            method=method,
            formulation=formulation,
            stabilization=self.stabilization,
            record=_RECORD,
            every=max(1, math.ceil(scene.duration / dt / _ROWS)),
            stop_on=_core.STOPPABLE,
        )

    def judge(self, pair: tuple[str, str], scene: Scene, dt: float) -> ErrorEstimate | None:
        """What a step's error is, on this scene; None where the run does not end as it should."""
        again = partial(whole, scene, self.options(pair, scene, dt))
        begin = time.thread_time()
        result = again(1)
        self.spent = (time.thread_time() - begin) * self.scene.duration / scene.duration
        if self.hopeless:
            return None
        if scene is self.scene and result["status"] != self.trusted.status:
            return None
        found = estimate(result, again, pair[1], _RECORD, scaled_error.usual(scene), self.scales)
        return found if math.isfinite(max(found.largest.values())) else None

    def search(
        self, pair: tuple[str, str], scene: Scene, dt: float
    ) -> tuple[float, ErrorEstimate | None, str]:
        """The longest step that is good enough, its error, or why there is none."""
        longest = min(_STABLE * self.stable(*pair), scene.duration)
        dt = min(dt, longest)
        best: tuple[float, ErrorEstimate | None, str] = (math.nan, None, "no step was good enough")
        too_long = math.inf
        for _ in range(_ROUNDS):
            if best[1] is None and self.hopeless:
                return math.nan, None, f"over {_HOPELESS:g} times as slow as the best"
            if scene.duration / dt > _MOST_STEPS:
                return best if best[1] else (math.nan, None, "it would take too many steps")
            found = self.judge(pair, scene, dt)
            error = math.inf if found is None else max(found.largest.values())
            # An error that hardly falls with the step is not one that halving it can tell.
            tiny = error <= _NOTHING * self.tolerance
            told = found is not None and (found.order >= 1.0 or tiny)
            if told and error <= _SAFE * self.tolerance:
                if best[1] is None or dt > best[0]:
                    best = (dt, found, "")
                if error >= 0.1 * _AIM * self.tolerance or dt >= longest:
                    break
            else:
                too_long = min(too_long, dt)
            # `order` falls back on the method's where the observed one says nothing.
            order = float(_core.ORDERS[pair[1]])
            if found is not None and math.isfinite(found.order) and not tiny:
                order = min(order, max(found.order, 1.0))
            change = (_AIM * self.tolerance / error) ** (1.0 / order) if error else 4.0
            if found is not None and not told:
                change = 0.5
            step = min(dt * float(np.clip(change, 1.0 / 8.0, 4.0)), longest)
            if step >= too_long:
                step = math.sqrt(best[0] * too_long) if best[1] else too_long / 2
            if best[1] is not None and abs(step / best[0] - 1.0) < 0.05:
                break
            self.spent *= dt / step
            dt = step
        return best

    @property
    def hopeless(self) -> bool:
        """Whether the pair that is being tried is far from the best so far."""
        return self.spent > _HOPELESS * self.quickest

    def first_step(self) -> float:
        """Where the search begins: the length of the stiff method's steps in the pilot."""
        t, start = self.trusted.t, self.pilot.start().time
        inside = (t >= start) & (t <= start + self.pilot.duration)
        count = max(int(inside.sum()), 8)
        return max(self.pilot.duration / count, np.finfo(float).tiny)

    def clock(self, pair: tuple[str, str], scene: Scene, dt: float) -> float:
        """How long a run takes that keeps its last state, s: the median of three."""
        options = replace(self.options(pair, scene, dt), record=(), every=2**62)
        spent = []
        for _ in range(3):
            begin = time.thread_time()
            whole(scene, options)
            spent.append(time.thread_time() - begin)
        return statistics.median(spent)

    def try_pilot(self, pair: tuple[str, str]) -> tuple[Trial, ErrorEstimate | None]:
        self.spent = 0.0
        dt, found, note = self.search(pair, self.pilot, self.first_step())
        if found is None:
            return _trial(pair, note=note), None
        share = self.scene.duration / self.pilot.duration
        spent = share * self.clock(pair, self.pilot, dt)
        self.quickest = min(self.quickest, spent)
        return _trial(
            pair,
            dt=dt,
            error=max(found.largest.values()),
            time=spent,
            whole=self.pilot is self.scene,
        ), found

    def try_whole(self, trial: Trial) -> tuple[Trial, ErrorEstimate | None]:
        pair = (trial.formulation, trial.method)
        self.spent, self.quickest = 0.0, math.inf
        dt, found, note = self.search(pair, self.scene, trial.dt)
        if found is None:
            note = f"good in the pilot; on the whole scene {note}"
            return _trial(pair, whole=True, note=note), None
        spent = self.clock(pair, self.scene, dt)
        return _trial(pair, dt=dt, error=max(found.largest.values()), time=spent, whole=True), found

    def advise(self, pairs: Iterable[tuple[str, str]]) -> Advice:
        waiting: list[tuple[Trial, ErrorEstimate | None]] = []
        slow: dict[str, float] = {}
        for pair in sorted(pairs, key=_promise):
            if slow.get(pair[1], 0.0) > _SLOW * self.quickest:
                note = f"{pair[1]} is over {_SLOW:g} times as slow as the best elsewhere"
                waiting.append((_trial(pair, note=note), None))
                continue
            waiting.append(self.try_pilot(pair))
            slow[pair[1]] = waiting[-1][0].time
        waiting.sort(key=_cheapest)
        done: list[tuple[Trial, ErrorEstimate | None]] = []
        # A pair that fails on the whole scene leaves its place to the next.
        while waiting and sum(found is not None for _, found in done) < _FINALISTS:
            trial, found = waiting.pop(0)
            # Where the pilot is the whole scene, there is nothing left to try.
            done.append((trial, found) if trial.whole or found is None else self.try_whole(trial))
        done.sort(key=_cheapest)
        trials = tuple(trial for trial, _ in (*done, *waiting))
        best, found = done[0]
        if found is None:
            return self._unmet(trials)
        apart, free = self._confirm(best)
        margin = self.stable(best.formulation, best.method) / best.dt
        return Advice(
            scene=self.scene,
            tolerance=self.tolerance,
            met=apart <= self.tolerance,
            formulation=best.formulation,
            method=best.method,
            dt=best.dt,
            error=found.largest,
            time=best.time,
            margin=margin,
            confirmed=apart,
            stabilization=self.stabilization,
            trials=trials,
            message=_message(best, found, margin, apart, free),
        )

    def _confirm(self, best: Trial) -> tuple[float, str]:
        """How far another method, with free steps, ends from it, and a word if that is quicker."""
        options = self.options((best.formulation, best.method), self.scene, best.dt)
        mine = whole(self.scene, options)
        # A violation ends a run at the end of a step: it is compared at the one before.
        last = -1 if self.trusted.success else -2
        until = replace(self.scene, duration=float(mine["t"][last] - self.scene.start().time))
        method = "radau5" if best.method != "radau5" else "rosenbrock"
        formulation = self.trusted.formulation
        tight = max(_TIGHTER * self.tolerance, _TIGHTEST)
        free = replace(
            options, dt=None, method=method, formulation=formulation, every=2**62, tolerance=tight
        )
        other = whole(until, free)
        apart = math.inf
        if other["status"] == "completed":
            apart = max(
                float(scaled_error.by_row(mine[name][last], other[name][-1], self.scales[name]))
                for name in QUANTITIES
            )
        begin = time.thread_time()
        whole(self.scene, replace(free, record=(), tolerance=0.1 * self.tolerance))
        spent = time.thread_time() - begin
        if spent > best.time / 3:
            return apart, ""
        return apart, (
            f'. Equal steps have to resolve what is over at once: method="{method}", '
            f'formulation="{formulation}", tolerance={0.1 * self.tolerance:.0e} takes '
            f"{1e3 * spent:.3g} ms, which has no such estimate"
        )

    def _unmet(self, trials: tuple[Trial, ...]) -> Advice:
        """Nothing meets the tolerance: what came closest, by the stiff run's own measure."""
        reasons = "; ".join(
            f"{trial.formulation} {trial.method}: {trial.note}" for trial in trials if trial.note
        )
        return Advice(
            scene=self.scene,
            tolerance=self.tolerance,
            met=False,
            formulation=self.trusted.formulation,
            method=self.trusted.method,
            dt=float(np.min(np.diff(self.trusted.t), initial=self.scene.duration)),
            error=dict.fromkeys(QUANTITIES, math.inf),
            time=math.inf,
            margin=math.inf,
            confirmed=math.inf,
            stabilization=self.stabilization,
            trials=trials,
            message=f"no pair meets {self.tolerance:g} here: {reasons}",
        )


def _trial(pair: tuple[str, str], **known: Any) -> Trial:
    formulation, method = pair
    return Trial(formulation=formulation, method=method, **known)


def _cheapest(tried: tuple[Trial, ErrorEstimate | None]) -> float:
    return tried[0].time


def _promise(pair: tuple[str, str]) -> tuple[int, bool]:
    formulation, method = pair
    return _PROMISING.index(method), formulation != "nullspace"


def _message(best: Trial, found: ErrorEstimate, margin: float, apart: float, free: str) -> str:
    sizes = ", ".join(f"{name} {size:.1e}" for name, size in found.largest.items())
    room = "any dt is stable" if math.isinf(margin) else f"stable up to {margin:.3g} times that"
    checked = f"a stiff run with free steps ends {apart:.1e} from it"
    if math.isinf(apart):
        checked = "but a stiff run with free steps ends otherwise"
    return (
        f'take formulation="{best.formulation}", method="{best.method}", dt={best.dt:.3g}: '
        f"expected error {sizes}; {1e3 * best.time:.3g} ms a run; {room}; {checked}{free}"
    )
