"""What `advise` says: the cheapest way to simulate a scene, and what was tried."""

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
    """A pair that was tried.

    Attributes:
        formulation: How the constraints are kept.
        method: How time is stepped.
        dt: The longest step that was found good enough, s; nan where none was.
        error: Its estimated error, the largest of q, p and lambda; inf where none was.
        time: How long the run takes, s: of a finalist measured, of others from the pilot.
        whole: Whether it was tried on the whole scene.
        note: Why it was given up, or nothing.
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
    """The cheapest way to simulate a scene to an accuracy.

    Attributes:
        scene: What is to be simulated.
        tolerance: What was asked for.
        met: Whether it is met; if not, the rest is what came closest.
        formulation: How the constraints are kept.
        method: How time is stepped.
        dt: The longest step, s.
        error: "q", "p", "multipliers" -> expected error: the largest along the run, each component
            against its largest size.
        time: How long a run takes that records its last state, s.
        margin: By which factor dt may grow before the method lets a mode grow; inf where it never
            does.
        confirmed: How far a run by another method, with free steps to a thousandth of the
            tolerance, ends from it, the largest of q, p and lambda; where a violation ends the run,
            at the step before. More than the tolerance is not met.
        stabilization: The gains that "csm" was tried with.
        trials: Every pair, the cheapest first.
        message: What to do, in words.
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
            method=self.method,
            formulation=self.formulation,
            stabilization=self.stabilization,
            **options,
        )

    def __str__(self) -> str:
        """What to do."""
        return self.message
