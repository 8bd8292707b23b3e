"""Measures the longest step with which a run still ends correctly, by bisection with trial runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..run import scaled_error
from ..run.options import Options
from ..run.run import Run
from ..scene.scene import Scene, State
from ..scene.stabilization import Stabilization
from .trial_run import TrialRun

# A coordinate whose error exceeds this share of its largest magnitude follows another motion.
LOST = 0.5
# Relative accuracy of the longest step.
_SHARP = 0.005
# Least number of steps for a scene at rest, so that growth by a percent a step becomes visible.
_TIME_TO_GROW = 4000
# Displacement of a scene at rest, as a share of typical sizes: exact symmetry would hide unstable
# modes.
_NUDGE = 1e-9


class Bisection:
    """Search for the longest step with which a run ends as the trusted run does."""

    def __init__(
        self, scene: Scene, trusted: Run, how: tuple[str, str, Stabilization], predicted: float
    ) -> None:
        """Prepares the search, which begins at the predicted step.

        Args:
            scene: The scene; at rest it is slightly displaced, as exact symmetry hides unstable
                modes.
            trusted: An accurate run of the scene.
            how: Method, formulation and gains.
            predicted: The longest stable step by linear theory, s; infinite if there is no limit.
        """
        self.method, self.formulation, self.stabilization = how
        self.scales = scaled_error.scales("q", trusted.q, scaled_error.usual(trusted.scene))
        self.trusted = trusted
        self.scene = scene
        self.failure = ""
        moved = np.abs(trusted.q - trusted.q[0]) / self.scales
        quiet = not len(trusted.violations) and trusted.stats["segments"] == 1
        if quiet and float(moved.max()) < 1e-6 and math.isfinite(predicted):
            self.scene = self._nudged(_TIME_TO_GROW * predicted)
        self.first = predicted if math.isfinite(predicted) else scene.duration / 8
        self.first = min(self.first, self.scene.duration)

    def _nudged(self, duration: float) -> Scene:
        scene, start = self.scene, self.scene.start()
        shares = _NUDGE * np.array([1.0, -0.7, 0.5, 0.8, -0.6, 0.9, -0.4, 0.3, -1.0])
        q, p = np.array(start.q) + shares * self.scales, start.p + shares * self.scales
        # Off the constraints a tip of unilateral contact would be free.
        if self.formulation == "csm" and scene.contact == "bilateral":
            off = State(q, p, start.integral, start.time, check=False)
            return replace(scene, initial=off, duration=max(duration, scene.duration))
        on = State.consistent(
            scene,
            x=q[0],
            y=q[1],
            rotation=q[2],
            fingers=q[3:5],
            shear=q[7:],
            velocity=p[:3],
            finger_rates=p[3:5],
            integral=start.integral,
            time=start.time,
        )
        return replace(scene, initial=on, duration=max(duration, scene.duration))

    def holds(self, dt: float) -> bool:
        """Whether the run with step `dt` ends as the trusted run; sets `failure` if not."""
        options = Options.checked(
            dt=dt,
            method=self.method,
            formulation=self.formulation,
            stabilization=self.stabilization,
            record=("state",),
            every=max(1, int(self.scene.duration / dt) // 64),
        )
        run = TrialRun.of(self.scene, options).run
        expected = self.trusted
        if run.status != expected.status:
            self.failure = f"with dt = {dt:.3g} s the run ends as {run.status} at {run.t[-1]:.4g} s"
            return False
        outside = scaled_error.by_row(run.q, 0.0, self.scales).max()
        within = scaled_error.by_row(expected.q, 0.0, self.scales).max()
        off = scaled_error.at_end({"q": run.q[-1]}, expected, {"q": self.scales})["q"]
        if off >= LOST:
            self.failure = (
                f"with dt = {dt:.3g} s the run ends {off:.2g} times a coordinate's size from where "
                "it should"
            )
        elif outside >= within + LOST:
            self.failure = (
                f"with dt = {dt:.3g} s a coordinate swings to {outside:.2g} times its largest size"
            )
        else:
            return True
        return False

    def longest(self, max_steps: int) -> tuple[float | None, str]:
        """The longest step, s, and how a longer one failed; or None, and the reason.

        Args:
            max_steps: No trial run takes more steps.
        """
        least = self.scene.duration / max_steps
        good = max(self.first, least)
        while not self.holds(good):
            if good <= least:
                return None, f"even {max_steps} steps are not enough: {self.failure}"
            good = max(good / 1.25, least)
        bad = 1.25 * good
        while self.holds(bad):
            if bad >= self.scene.duration:
                return math.inf, ""
            good, bad = bad, 1.25 * bad
        while bad > (1.0 + _SHARP) * good:
            middle = math.sqrt(good * bad)
            if self.holds(middle):
                good = middle
            else:
                bad = middle
        return good, self.failure
