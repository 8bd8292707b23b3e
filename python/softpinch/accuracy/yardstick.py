"""What `advise` compares its trials with: the motion by adaptive steps at a smaller tolerance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from .. import _core
from ..run import scaled_error
from ..run.error_estimate import QUANTITIES
from ..run.options import STOP_ON, Options
from ..run.own_steps import ending_at
from ..run.run import Run
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support.arrays import Floats
from ..support.choices import Formulation, Method
from .linear_modes import along_run
from .precision_runs import sampled_rows, switching
from .stability import trusted_run
from .trial_run import TrialRun

RECORD = ("state", "multipliers")
# The tolerances of the runs that stand for the exact motion, as shares of the required accuracy,
# and their lower bounds. The error of "rosenbrock" is about its tolerance, and it needs many steps.
_TIGHTER = {"dop853": (1e-3, 1e-13), "radau5": (1e-2, 1e-13), "rosenbrock": (1e-2, 1e-12)}
# The scene is cut where the trusted run has taken this many steps: some tens of milliseconds.
MOST_STEPS = 20_000
# A second method confirms if it takes at most this many times as long as the first.
_AFFORDABLE = 20.0
# Differences below this share of the largest component with the same unit are round-off.
_ROUND_OFF = 1e-12
# Number of instants at which a trial is compared, beside those after switches.
_ROWS = 64
# Number of instants at which the motion is linearised.
_INSTANTS = 40


class Yardstick:
    """The exact motion of a scene, as far as the trials need it.

    Attributes:
        whole: The scene.
        scene: The scene, cut where the trusted run took too many steps.
        trusted: The run by a stiff method with adaptive steps, with which statuses are compared.
        methods: The methods that give the exact motion, the quicker one first.
        overhead: CPU time of a run of one step, s.
    """

    def __init__(self, scene: Scene, tolerance: float, stabilization: Stabilization) -> None:
        """Computes the motion.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        self.whole = self.scene = scene
        self.tolerance = tolerance
        self.stabilization = stabilization
        # "csm" here is a fallback: `trusted_run` uses it only for a start off the constraints.
        self.trusted = trusted_run(scene, "csm", stabilization, record=RECORD, max_steps=MOST_STEPS)
        if self.trusted.status == "too_many_steps":
            reached = float(self.trusted.t[-1]) - scene.start().time
            self.scene = replace(scene, duration=reached)
            self.trusted = trusted_run(self.scene, "csm", stabilization, record=RECORD)
        self.switches = switching(self.scene)
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
        self._limits: dict[tuple[str, str], float] = {}
        self.methods = self._methods()
        short = replace(scene, duration=min(scene.duration, 1e-9))
        once = Options.checked(dt=1.0, formulation=self.trusted.formulation, record=RECORD)
        self.overhead = min(TrialRun.of(short, once).time for _ in range(3))

    @property
    def share(self) -> float:
        """The tried part of the scene, as a share of its duration."""
        return self.scene.duration / self.whole.duration

    def _methods(self) -> tuple[str, ...]:
        """The stiff method and the explicit one, if that is not too slow, by time."""
        stiff = TrialRun.of(self.scene, self._tight("radau5"))
        # An explicit step takes about half as long as an implicit one.
        most = int(2 * _AFFORDABLE * stiff.result["stats"]["steps"]) + 200
        explicit = TrialRun.of(self.scene, self._tight("dop853", max_steps=most))
        if explicit.result["status"] != stiff.result["status"]:
            return ("radau5",)
        return ("dop853", "radau5") if explicit.time < stiff.time else ("radau5", "dop853")

    def _tight(self, method: str, **how: Any) -> Options:
        share, least = _TIGHTER[method]
        return Options.checked(
            tolerance=max(share * self.tolerance, least),
            method=method,
            formulation=self.trusted.formulation,
            stabilization=self.stabilization,
            record=RECORD,
            stop_on=STOP_ON,
            **how,
        )

    def exact(self, t: Floats, method: str) -> Run:
        """The motion at increasing instants, by steps that end there.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        return TrialRun.of(ending_at(self.scene, t), self._tight(method, times=t)).run

    def errors(self, run: Run, rows: int = _ROWS) -> dict[str, float] | None:
        """The largest error of each quantity along a run; None if it does not end as it should.

        Args:
            run: The run, of `scene`.
            rows: Number of compared rows, beside those after switches.
        """
        if run.status != self.trusted.status:
            return None
        chosen = sampled_rows(run, self.switches, rows)
        if not run.success:
            # The instant of a violation depends on the steps.
            chosen = chosen[run.t[chosen] < min(run.t[-1], self.trusted.t[-1])]
        if len(chosen) < 2:
            return None
        t = run.t[chosen]
        right = self.exact(t, self.methods[0])
        n = len(right) - (not np.isin(right.t[-1], t))
        if n < 2 or not np.array_equal(right.t[:n], t[:n]):
            return None
        found = {
            name: float(
                scaled_error.by_row(
                    getattr(run, name)[chosen[:n]], getattr(right, name)[:n], self.scales[name]
                ).max()
            )
            for name in QUANTITIES
        }
        return found if all(map(math.isfinite, found.values())) else None

    def confirm(self, run: Run) -> tuple[float, str]:
        """The difference at the end from another method, and the method's name.

        If a violation ends the run, the states one step earlier are compared.
        """
        others = [method for method in self.methods if method != run.method]
        method = others[0] if others else "rosenbrock"
        last = -1 if run.success else -2
        if len(run) < 1 - last:
            return math.inf, method
        other = self.exact(run.t[last:][:1], method)
        if other.t[0] != run.t[last]:
            return math.inf, method
        apart = (
            scaled_error.by_row(
                getattr(run, name)[last], getattr(other, name)[0], self.scales[name]
            )
            for name in QUANTITIES
        )
        return float(max(apart)), method

    @property
    def limited(self) -> bool:
        """Whether the stability limit is known, for which the torques at a state must be known."""
        return self.scene.law != "sampled"

    def stable(self, formulation: Formulation, method: Method) -> float:
        """The longest stable step along the run, s; inf if it is not known."""
        if not self.limited:
            return math.inf
        key = formulation, method
        if key not in self._limits:
            along = along_run(self.trusted, formulation, self.stabilization, _INSTANTS)
            for each in _core.METHODS:
                self._limits[formulation, each] = float(
                    np.nanmin(along.stable_step(each), initial=np.inf)
                )
        return self._limits[key]
