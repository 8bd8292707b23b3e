"""The result of `advise`: the cheapest settings for a scene, and the settings that were tried."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..run.run import Run
from ..run.simulate import simulate
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support.choices import Formulation, Method
from ..support.result import Result


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Trial(Result):
    """A pair of formulation and method that was tried, with equal or with adaptive steps.

    Attributes:
        formulation: How the constraints are kept.
        method: How time is stepped.
        dt: The longest step found whose error is small enough, s; nan if none was found, and with
            adaptive steps.
        step_tolerance: The largest tolerance of adaptive steps found whose error is small enough;
            nan if none was found, and with equal steps.
        error: Error with this setting, the largest of q, p and lambda; inf if none was found.
        time: CPU time of a run over the whole scene, s; inf if no setting was found. If only the
            scene's beginning was tried, the time is scaled up to the whole scene. In `Advice.equal`
            and `Advice.adaptive` it is a lower bound if no setting was found.
        whole: Whether the pair was tried on the whole scene, not only on its beginning.
        note: Why the pair was given up, or not tried; empty if it was not given up.
    """

    formulation: Formulation
    method: Method
    dt: float = math.nan
    step_tolerance: float = math.nan
    error: float = math.inf
    time: float = math.inf
    whole: bool = False
    note: str = ""

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
        met: Whether the advised settings meet the tolerance. If no pair met it in the trials, the
            settings are those of the stiff adaptive run with which the trials were compared, and
            the errors are inf.
        formulation: How the constraints are kept.
        method: How time is stepped.
        dt: The longest of equal steps, s. None if adaptive steps are advised, which have no dt but
            `step_tolerance`.
        step_tolerance: The tolerance of adaptive steps, `tolerance` of `simulate`. None if equal
            steps are advised, which have `dt`.
        error: "q", "p", "multipliers" -> error, the largest along the run, each component divided
            by its largest magnitude.
        time: CPU time of a run that keeps only its last state, s.
        margin: Factor by which dt may grow until the method becomes unstable; inf if it never does,
            and with adaptive steps; NaN with equal steps and a `SampledController`.
        confirmed: Difference at the end from a run by another method with adaptive steps at a
            smaller tolerance, the largest of q, p and lambda. If a violation ends the run, the
            states one step earlier are compared. The tolerance is met only if this difference is
            within it.
        equal: The quickest pair with equal steps. If none was found, the pair that was given up
            with the least predicted time, which is a lower bound, in `time`; or None.
        adaptive: The quickest pair with adaptive steps, or the one given up, likewise.
        tried: Length of the part of the scene, from its start, on which the pairs were tried, s.
        untried: The pairs that the budget did not allow to try, such as "csm rk4, dt".
        stabilization: The gains with which "csm" was tried.
        trials: Every pair: first those tried on the whole scene, then the others, each by time. A
            method that has adaptive steps appears twice.
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

        Args:
            options: Further arguments of `simulate`, such as `record` and `every`; not those that
                the advice chooses.

        Raises:
            TypeError: An option is one that the advice chooses.
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
