"""The motion with which `advise` compares its trials: adaptive steps at a smaller tolerance."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ..run import Options, Request, Run, computed, scaled_error
from ..run.error_estimate import ending_at
from ..scene import ESTIMATED, Scene, Stabilization
from ..support import Floats, Formulation, Method
from .precision import sampled_rows, switch_instants
from .runs import accurate_run, timed_run
from .stability import Modes, along_run

_RECORD = ("state", "multipliers")
# The tolerances of the runs that stand for the exact motion, as shares of the required accuracy,
# and their lower bounds. The error of "rosenbrock" is about its tolerance, and it needs many steps.
_TIGHTER = {"dop853": (1e-3, 1e-13), "radau5": (1e-2, 1e-13), "rosenbrock": (1e-2, 1e-12)}
# The scene is cut where the accurate run has taken this many steps: some tens of milliseconds.
MOST_STEPS = 20_000
# A second method confirms if it takes at most this many times as long as the first.
_AFFORDABLE = 20.0
# Differences below this share of the largest component with the same unit are round-off.
_ROUND_OFF = 1e-12
# Number of instants at which a trial is compared, besides those after switches.
_ROWS = 64
# Number of instants at which the motion is linearised.
_INSTANTS = 40


class ReferenceMotion:
    """The exact motion of a scene, cut where the accurate run took too many steps."""

    def __init__(self, scene: Scene, tolerance: float, stabilization: Stabilization) -> None:
        self.full = self.scene = scene
        self.tolerance, self.stabilization = tolerance, stabilization
        # The run by a stiff method with adaptive steps, whose status a trial must have.
        # "csm" here is a fallback: only for a start off the constraints.
        how: dict[str, Any] = {"stabilization": stabilization, "record": _RECORD}
        self.run = accurate_run(scene, "csm", max_steps=MOST_STEPS, **how)
        if self.run.status == "too_many_steps":
            self.scene = replace(scene, duration=float(self.run.t[-1]) - scene.start().time)
            self.run = accurate_run(self.scene, "csm", **how)
        self.switches = switch_instants(self.scene)
        # Lower bounds of the scales keep round-off of large components from counting as error.
        usual = scaled_error.usual(scene)
        self.scales = {}
        for name in ESTIMATED:
            rows = getattr(self.run, name)
            least = _ROUND_OFF / tolerance * scaled_error.common(name, rows, usual)
            self.scales[name] = np.maximum(scaled_error.scales(name, rows, usual), least)
        self._modes: dict[str, Modes] = {}
        # The methods that give the exact motion, the quicker one first: the stiff one, and the
        # explicit one if that is not too slow. An explicit step takes about half an implicit one.
        stiff, stiff_time = timed_run(self._tight("radau5"))
        most = int(2 * _AFFORDABLE * stiff.stats["steps"]) + 200
        explicit, explicit_time = timed_run(self._tight("dop853", max_steps=most))
        self.methods = ["radau5"]
        if explicit.status == stiff.status:
            self.methods.insert(int(explicit_time >= stiff_time), "dop853")

    @property
    def share(self) -> float:
        """The tried part of the scene, as a share of its duration."""
        return self.scene.duration / self.full.duration

    def request(self, **how: Any) -> Request:
        """A run of the scene that can be compared with the motion."""
        how |= {"stabilization": self.stabilization, "record": _RECORD}
        return Request(self.scene, Options.checked(**how))

    def _tight(self, method: str, **how: Any) -> Request:
        share, least = _TIGHTER[method]
        how["tolerance"] = max(share * self.tolerance, least)
        return self.request(method=method, formulation=self.run.formulation, **how)

    def exact(self, t: Floats, method: str) -> Run:
        """The motion at increasing instants, by steps that end there."""
        return computed(self._tight(method, times=t).with_(ending_at(self.scene, t)))

    def errors(self, run: Run, rows: int = _ROWS) -> dict[str, float] | None:
        """The largest error of each quantity in some rows; None if it does not end as it should."""
        if run.status != self.run.status:
            return None
        chosen = sampled_rows(run, self.switches, rows)
        if not run.success:
            # The instant of a violation depends on the steps.
            chosen = chosen[run.t[chosen] < min(run.t[-1], self.run.t[-1])]
        if len(chosen) < 2:
            return None
        t = run.t[chosen]
        right = self.exact(t, self.methods[0])
        n = len(right) - (not np.isin(right.t[-1], t))
        if n < 2 or not np.array_equal(right.t[:n], t[:n]):
            return None
        found = {name: self._scaled(name, run, right, chosen[:n], slice(n)) for name in ESTIMATED}
        return found if all(map(math.isfinite, found.values())) else None

    def confirm(self, run: Run) -> tuple[float, str]:
        """The difference from another method at the end, or a step before a violation; its name."""
        others = [method for method in self.methods if method != run.method]
        method = others[0] if others else "rosenbrock"
        last = -1 if run.success else -2
        if len(run) < 1 - last:
            return math.inf, method
        other = self.exact(run.t[last:][:1], method)
        if other.t[0] != run.t[last]:
            return math.inf, method
        return max(self._scaled(name, run, other, last, 0) for name in ESTIMATED), method

    def _scaled(self, name: str, run: Run, right: Run, rows: Any, same: Any) -> float:
        """The largest error of a quantity in some rows of a run; `same` are those of the other."""
        value, exact = getattr(run, name)[rows], getattr(right, name)[same]
        return float(scaled_error.by_row(value, exact, self.scales[name]).max())

    def stable(self, formulation: Formulation, method: Method) -> float:
        """The longest stable step along the run, s; inf if the torques at a state are not known."""
        if self.scene.law == "sampled":
            return math.inf
        if formulation not in self._modes:
            modes = along_run(self.run, formulation, self.stabilization, _INSTANTS)
            self._modes[formulation] = modes
        return float(np.nanmin(self._modes[formulation].stable_step(method), initial=np.inf))
