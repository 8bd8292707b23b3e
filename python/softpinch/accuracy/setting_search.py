"""The search for the loosest setting of one pair with which the error is small enough."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .. import _core
from ..run.options import MOST_STEPS, STOP_ON, Options
from ..support.choices import Formulation, Method
from .trial_run import TrialRun, cpu_times
from .yardstick import RECORD, Yardstick

# The search aims at the first share of the accuracy, and accepts errors up to the second.
AIM, SAFE = 0.3, 0.6
# The search ends where a looser setting would save less than this share of the time.
_ENOUGH = 0.25
# A pair is given up after this many changes of its setting.
_ROUNDS = 10
# Steps stay below this share of the stability limit.
_STABLE = 0.8
# At most this many rows of a run are kept: between them errors hardly differ.
_MOST_ROWS = 100_000
# Number of steps of the run that shows how long a step takes.
_FEW = 100
# The shortest time of a step of any method, s.
_SHORTEST = 5e-7
# Number of timed repetitions of a run.
_REPEATS = 5
# Smaller errors count as this one, whose inverse has a square that does not overflow.
_LEAST = 1e-100
# The range of the tolerances of adaptive steps.
_TIGHTEST, _LOOSEST = 1e-13, 1e-2


@dataclass(frozen=True, kw_only=True)
class Found:
    """A setting whose error is small enough.

    Attributes:
        value: dt, s, or the tolerance of adaptive steps.
        error: Quantity -> its largest error.
        time: CPU time of a run over the scene of the yardstick, s.
    """

    value: float
    error: Mapping[str, float]
    time: float


class SettingSearch:
    """The search for one pair of formulation and method, with equal or with adaptive steps.

    Attributes:
        formulation: How the constraints are kept.
        method: How time is stepped.
        kind: "dt" or "tolerance".
        predicted: The predicted time of the run with which the search gave up, s; 0 if it did not.
    """

    def __init__(self, yardstick: Yardstick, pair: tuple[Formulation, Method], kind: str) -> None:
        """Takes what to search; runs nothing yet."""
        self.yardstick = yardstick
        self.formulation, self.method = self.pair = pair
        self.kind = kind
        self.predicted = 0.0
        self._step_time = 0.0

    @property
    def name(self) -> str:
        """Formulation, method and the kind of the setting in words."""
        return f"{self.formulation} {self.method}, {self.kind}"

    @property
    def longest(self) -> float:
        """The longest step to try, s, or the largest tolerance."""
        if self.kind == "tolerance":
            return _LOOSEST
        return min(
            _STABLE * self.yardstick.stable(*self.pair), float(self.yardstick.scene.duration)
        )

    def least_time(self) -> float:
        """The least time of a run, by the stability limit, s; 0 for adaptive steps.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        if self.kind == "tolerance":
            return 0.0
        if self.yardstick.scene.duration / self.longest <= _FEW:
            return 0.0
        self._measure(self.longest)
        return self._expected(self.longest)

    def options(self, value: float, most: float = math.inf) -> Options:
        """One setting; adaptive steps stop after about `most` s."""
        how: dict[str, Any] = {self.kind: value}
        if self.kind == "dt":
            steps = self.yardstick.scene.duration / value
            how["every"] = max(1, math.ceil(steps / _MOST_ROWS))
        elif most < math.inf:
            how["max_steps"] = int(min(100 + most / _SHORTEST, MOST_STEPS))
        return Options.checked(
            method=self.method,
            formulation=self.formulation,
            stabilization=self.yardstick.stabilization,
            record=RECORD,
            stop_on=STOP_ON,
            **how,
        )

    def loosest(self, first: float, most: float, deadline: float) -> tuple[Found | None, str]:
        """Searches the loosest setting whose error is small enough.

        Args:
            first: The first setting.
            most: A run that takes longer is given up, s.
            deadline: When to end the search, by `time.perf_counter`, s.

        Returns:
            The setting and ""; or None and the reason why none was found.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        accuracy = self.yardstick.tolerance
        order = 1.0 if self.kind == "tolerance" else float(_core.ORDERS[self.method])
        # Time grows with the inverse of dt, and about with this power of 1 / tolerance.
        power = 1.0 / (_core.ORDERS[self.method] if self.kind == "tolerance" else 1)
        value = min(first, self.longest)
        needed = 0.0
        if self.kind == "dt":
            self._measure(value)
            # Begin with the shortest step that is not too expensive, if the first one is.
            needed = self._expected(value)
            value = min(max(value, 1.01 * value * needed / most), self.longest)
        best: Found | None = None
        reason = "no setting was good enough"
        too_loose = math.inf
        seen: list[tuple[float, float]] = []
        for _ in range(_ROUNDS):
            if time.perf_counter() > deadline:
                reason = "the budget ended before a setting was good enough"
                break
            if self._expected(value) > most:
                needed = max(needed, self._expected(value))
                reason = f"dt = {value:.2g} s or less would take {1e3 * needed:.2g} ms a run"
                break
            trial = TrialRun.of(self.yardstick.scene, self.options(value, most))
            self._note(trial)
            found = self.yardstick.errors(trial.run)
            error = math.inf if found is None else max(found.values())
            if trial.result["status"] == "too_many_steps" and best is None:
                needed = trial.time
                reason = f"tolerance = {value:.2g} takes over {1e3 * needed:.2g} ms a run"
                break
            if found is not None and error <= SAFE * accuracy:
                if best is None or value > best.value:
                    best = Found(value=value, error=found, time=trial.time)
                gain = (AIM * accuracy / max(error, _LEAST)) ** (power / order)
                if gain < 1.0 + _ENOUGH or value >= 0.99 * self.longest:
                    break
            else:
                too_loose = min(too_loose, value)
            seen.append((value, error))
            change = 0.1 if self.kind == "tolerance" else 0.25
            if error < math.inf:
                change = (AIM * accuracy / max(error, _LEAST)) ** (1.0 / _slope(seen, order))
                needed = self._expected(value * change)
                change = float(np.clip(change, 1.0 / 30.0, 30.0))
            following = min(value * change, self.longest)
            if following >= too_loose:
                following = math.sqrt(best.value * too_loose) if best else too_loose / 2.0
            if best is not None and abs(math.log(following / best.value)) * power < _ENOUGH / 2:
                break
            if self.kind == "tolerance" and following < _TIGHTEST:
                reason = f"even tolerance = {value:.2g} is not enough: error {error:.1e}"
                break
            value = following
        if best is not None:
            return best, ""
        self.predicted = needed
        return None, reason

    def clock(self, value: float, once: float) -> float:
        """CPU time of a run that keeps only its last state, s; `once` if that is long.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        if once > 0.05:
            return once
        return statistics.median(cpu_times(self.yardstick.scene, self.options(value), _REPEATS))

    def _expected(self, value: float) -> float:
        """The expected time of a run, s, as far as it is known."""
        if self.kind == "tolerance":
            return 0.0
        # A step ends at each switch of an input.
        steps = max(self.yardstick.scene.duration / value, len(self.yardstick.switches))
        return self.yardstick.overhead + self._step_time * steps

    def _measure(self, value: float) -> None:
        """Measures how long a step takes, unless that is known."""
        if self._step_time:
            return
        steps = min(_FEW, self.yardstick.scene.duration / value)
        short = replace(self.yardstick.scene, duration=steps * value)
        trial = TrialRun.of(short, self.options(value))
        taken = int(trial.result["stats"]["steps"])
        # A run that fails soon says little.
        steps_time = (trial.time - self.yardstick.overhead) / max(taken, _FEW // 2)
        self._step_time = max(steps_time, _SHORTEST)

    def _note(self, trial: TrialRun) -> None:
        steps = int(trial.result["stats"]["steps"])
        if steps >= _FEW:
            self._step_time = max((trial.time - self.yardstick.overhead) / steps, _SHORTEST)


def _slope(seen: list[tuple[float, float]], order: float) -> float:
    """The power with which the error falls: that of the last two settings, if it is plausible."""
    if len(seen) < 2 or not all(0.0 < error < math.inf for _, error in seen[-2:]):
        return order
    (one, first), (two, second) = seen[-2:]
    if one == two:
        return order
    found = math.log(first / second) / math.log(one / two)
    return float(np.clip(found, 0.5 * order, 2.0 * order)) if math.isfinite(found) else order
