"""`advise`: finds formulation, method and step for a scene by trial runs of that scene."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .. import _core
from ..run import scaled_error
from ..run.error_estimate import QUANTITIES, ErrorEstimate, estimate
from ..run.options import STOP_ON, Options, some_names
from ..scene.contact import formulations_of, require_formulations
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from .advice import Advice, Trial
from .linear_modes import along_run
from .stability import trusted_run
from .trial_run import TrialRun, cpu_times

_RECORD = ("state", "multipliers")

# Length of the pilot window as a share of the run, and its bounds, s.
_PILOT, _SHORTEST, _LONGEST = 0.05, 0.02, 0.2
# The search aims at the first share of the tolerance, and accepts errors up to the second.
_AIM, _SAFE = 0.3, 0.6
# A pair is given up after this many changes of its step.
_ROUNDS = 12
# This many of the cheapest pairs in the pilot are tried on the whole scene.
_FINALISTS = 3
# Steps stay below this share of the stability limit.
_STABLE = 0.8
# At most this many rows of a run are kept: between them errors hardly differ.
_ROWS = 100_000
# Number of timed repetitions of a run.
_REPEATS = 3
# A trial with more steps, before they are halved to estimate the error, is given up.
_MOST_STEPS = 5_000_000
# A pair is given up if it takes this many times as long as the best pair so far.
_HOPELESS = 4.0
# A method is skipped with further formulations if one formulation took this many times as long.
_SLOW = 2.0
# Differences below this share of the largest component with the same unit are round-off.
_ROUND_OFF = 1e-12
# Errors below this share of the tolerance need not fall with the step, as round-off does not.
_NOTHING = 0.01
# Tolerance of the confirming run as a share of the tolerance, and its lower bound.
_TIGHTER, _TIGHTEST = 1e-3, 1e-13
# The methods that are usually best come first, so that the search gives the others up early.
_PROMISING = ("dop853", "radau5", "rk4", "rosenbrock", "implicit_midpoint")


def advise(
    scene: Scene,
    tolerance: float = 1e-6,
    *,
    formulations: str | Sequence[str] | None = None,
    methods: str | Sequence[str] = _core.METHODS,
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
) -> Advice:
    """Finds the cheapest formulation, method and step with which a scene meets a tolerance.

    A run by a stiff method with adaptive steps shows where the motion is fastest; this window is
    the pilot. There the step of every pair of formulation and method is changed until its error,
    estimated from runs with half and a quarter of the step, is below the tolerance. The three
    cheapest pairs are then tried likewise on the whole scene, because the pilot misses later
    disturbances. The best pair is compared with a run by another method.

    The search takes some dozens of times as long as the advised run.

    Args:
        scene: The scene to simulate.
        tolerance: The largest accepted error of q, p and lambda along the run, each component
            divided by its largest magnitude; from 1e-11 to 0.1.
        formulations: Formulations to try; None tries all that the scene's contact allows, which are
            "csm" and "projected" in unilateral contact.
        methods: Methods to try.
        stabilization: The gains of (19) and (20), for "csm".

    Raises:
        ValueError: An argument breaks its rule, or the scene's start does.
        TypeError: An argument is of the wrong kind.
        KeyboardInterrupt: Ctrl-C.
    """
    checks.instance("scene", scene, Scene)
    checks.instance("stabilization", stabilization, Stabilization)
    tolerance = checks.number("tolerance", tolerance)
    if not 1e-11 <= tolerance <= 0.1:
        raise ValueError(f"tolerance = {tolerance}: must be from 1e-11 to 0.1")
    if formulations is None:
        formulations = formulations_of(scene)
    kept = some_names("formulations", formulations, _core.FORMULATIONS)
    require_formulations("formulations", kept, scene)
    stepped = some_names("methods", methods, _core.METHODS)
    if not scene.start().check and kept != ("csm",):
        raise ValueError(
            f"formulations = {kept}: a start off the constraints (check=False) is for 'csm' only"
        )
    return _Advisor(scene, tolerance, stabilization).advise(
        [(formulation, method) for formulation in kept for method in stepped]
    )


class _Advisor:
    """The search for one scene, with everything by which its trials are judged.

    Attributes:
        trusted: The run by a stiff method with adaptive steps, with which statuses are compared.
        scales: Quantity -> divisors of its components' differences (components,).
        pilot: The scene restricted to the window in which the motion is fastest.
        limits: Formulation -> longest stable step of each method, s.
        quickest: Shortest CPU time of a pair so far, for the whole scene, s.
        spent: CPU time of the current pair's latest trial, scaled up to the whole scene, s.
    """

    def __init__(self, scene: Scene, tolerance: float, stabilization: Stabilization) -> None:
        self.scene = scene
        self.tolerance = tolerance
        self.stabilization = stabilization
        # "csm" here is a fallback: `trusted_run` uses it only for a start off the constraints.
        self.trusted = trusted_run(scene, "csm", stabilization, record=_RECORD)
        # Lower bounds of the scales keep round-off of large components from counting as error.
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
        """The longest stable step along the run, s."""
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
            stop_on=STOP_ON,
        )

    def judge(self, pair: tuple[str, str], scene: Scene, dt: float) -> ErrorEstimate | None:
        """The error of a step on a scene; None if the run is too slow or does not end correctly."""
        run = TrialRun.of(scene, self.options(pair, scene, dt))
        self.spent = run.time * self.scene.duration / scene.duration
        if self.hopeless:
            return None
        if scene is self.scene and run.result["status"] != self.trusted.status:
            return None
        usual = scaled_error.usual(scene)
        found = estimate(run.result, run.refined, pair[1], _RECORD, usual, self.scales)
        return found if math.isfinite(max(found.largest.values())) else None

    def search(
        self, pair: tuple[str, str], scene: Scene, dt: float
    ) -> tuple[float, ErrorEstimate | None, str]:
        """Searches the longest step of a pair whose error is small enough, starting at `dt`.

        Returns:
            The step, s, its error and ""; or nan, None and the reason why none was found.
        """
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
            # Halving the step only shows the error if the error falls with the step.
            tiny = error <= _NOTHING * self.tolerance
            told = found is not None and (found.order >= 1.0 or tiny)
            if told and error <= _SAFE * self.tolerance:
                if best[1] is None or dt > best[0]:
                    best = (dt, found, "")
                if error >= 0.1 * _AIM * self.tolerance or dt >= longest:
                    break
            else:
                too_long = min(too_long, dt)
            # Predict with the observed order of convergence if it is known, else the method's.
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
        """Whether the current pair is much slower than the best so far."""
        return self.spent > _HOPELESS * self.quickest

    def first_step(self) -> float:
        """The step at which the search begins: the stiff run's mean step in the pilot, s."""
        t, start = self.trusted.t, self.pilot.start().time
        inside = (t >= start) & (t <= start + self.pilot.duration)
        count = max(int(inside.sum()), 8)
        return max(self.pilot.duration / count, np.finfo(float).tiny)

    def clock(self, pair: tuple[str, str], scene: Scene, dt: float) -> float:
        """CPU time of a run that keeps only its last state, s: the median of three."""
        return statistics.median(cpu_times(scene, self.options(pair, scene, dt), _REPEATS))

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
        # If a pair fails on the whole scene, the next cheapest takes its place.
        while waiting and sum(found is not None for _, found in done) < _FINALISTS:
            trial, found = waiting.pop(0)
            # A short scene is its own pilot and needs no second trial.
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
        """Compares the advised run with another method that has adaptive steps.

        Returns:
            The largest difference at the end; and, if adaptive steps are at least three times as
            fast, a sentence for the message, else "".
        """
        options = self.options((best.formulation, best.method), self.scene, best.dt)
        mine = TrialRun.of(self.scene, options).run
        # The instant of a violation depends on the steps, so compare the states one step earlier.
        last = -1 if self.trusted.success else -2
        until = replace(self.scene, duration=float(mine.t[last] - self.scene.start().time))
        method = "radau5" if best.method != "radau5" else "rosenbrock"
        formulation = self.trusted.formulation
        tight = max(_TIGHTER * self.tolerance, _TIGHTEST)
        free = replace(
            options, dt=None, method=method, formulation=formulation, every=2**62, tolerance=tight
        )
        other = TrialRun.of(until, free).run
        apart = math.inf
        if other.success:
            final = {name: getattr(mine, name)[last] for name in QUANTITIES}
            apart = max(scaled_error.at_end(final, other, self.scales).values())
        loose = replace(free, record=(), tolerance=0.1 * self.tolerance)
        spent = TrialRun.of(self.scene, loose).time
        if spent > best.time / 3:
            return apart, ""
        return apart, (
            f'. Equal steps have to resolve what is over at once: method="{method}", '
            f'formulation="{formulation}", tolerance={0.1 * self.tolerance:.0e} takes '
            f"{1e3 * spent:.3g} ms, which has no such estimate"
        )

    def _unmet(self, trials: tuple[Trial, ...]) -> Advice:
        """The advice if no pair meets the tolerance: the settings of the stiff adaptive run."""
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
