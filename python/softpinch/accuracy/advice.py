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
from ..support.result import Result


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial(Result):
    """A pair of formulation and method that was tried.

    Attributes:
        formulation: How the constraints are kept.
        method: How time is stepped.
        dt: The longest step found whose error is small enough, s; nan if none was found.
        error: Estimated error with this step, the largest of q, p and lambda; inf if none was
            found.
        time: CPU time of a run, s: measured on the whole scene if `whole`, else scaled up from the
            pilot window; inf if no step was found.
        whole: Whether the pair was tried on the whole scene, not only on the pilot window.
        note: Why the pair was given up; empty if it was not.
    """

    formulation: str
    method: str
    dt: float = math.nan
    error: float = math.inf
    time: float = math.inf
    whole: bool = False
    note: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
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
        dt: The longest step, s.
        error: "q", "p", "multipliers" -> estimated error, the largest along the run, each component
            divided by its largest magnitude.
        time: CPU time of a run that keeps only its last state, s.
        margin: Factor by which dt may grow until the method becomes unstable; inf if it never does.
        confirmed: Difference at the end from a run by another method with adaptive steps at a
            thousandth of the tolerance, the largest of q, p and lambda. If a violation ends the
            run, the states one step earlier are compared. The tolerance is met only if this
            difference is within it.
        stabilization: The gains with which "csm" was tried.
        trials: Every pair: first those tried on the whole scene, then the others, each by time.
        message: The advice in words.
    """

    scene: Scene
    tolerance: float
    met: bool
    formulation: str
    method: str
    dt: float
    error: Mapping[str, float]
    time: float
    margin: float
    confirmed: float
    stabilization: Stabilization
    trials: tuple[Trial, ...]
    message: str

    def simulate(self, **options: Any) -> Run:
        """Simulates the scene as advised; `options` are further arguments of `simulate`."""
        return simulate(
            self.scene,
            dt=self.dt,
            method=self.method,  # type: ignore[arg-type]
            formulation=self.formulation,  # type: ignore[arg-type]
            stabilization=self.stabilization,
            **options,
        )

    def __str__(self) -> str:
        """The advice in words."""
        return self.message
