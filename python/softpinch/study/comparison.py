"""Comparing two designs by studies with the same random numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from ..support import Result, checks
from .estimates import Estimate
from .results import Results
from .rows import checked_event


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Comparison(Result):
    """The difference of an event's probabilities in two studies, from pairs of runs.

    Attributes:
        event: The event, "holds" for example.
        difference: The probability in `study_a` minus that in `study_b`.
        low: Lower end of the confidence interval of the difference; `high` is the upper one.
        confidence: The confidence level of the interval.
        a: The probability in `study_a`, from the pairs alone; `b` is that in `study_b`.
        pairs: The number of runs that both studies have.
        only_a: The number of pairs in which the event happened in `study_a` only, as `only_b`.
    """

    event: str
    difference: float
    low: float
    high: float
    confidence: float
    a: Estimate
    b: Estimate
    pairs: int
    only_a: int
    only_b: int

    @property
    def likelier(self) -> str | None:
        """The study in which the event is likelier, "a" or "b"; None if both may be alike."""
        return "a" if self.low > 0.0 else "b" if self.high < 0.0 else None

    @property
    def better(self) -> str | None:
        """The better design, "a" or "b": there "holds" or "completed" is likelier, others less."""
        if self.event in ("holds", "completed") or self.likelier is None:
            return self.likelier
        return "b" if self.likelier == "a" else "a"

    @property
    def message(self) -> str:
        """The result in words."""
        verdict = f"design {self.better} is better" if self.better else "neither design is better"
        shares = f"{self.event} {self.a.value:.5g} in a, {self.b.value:.5g} in b"
        interval = f"{100 * self.confidence:g} %: {self.low:.3g} to {self.high:.3g}"
        return f"{verdict}: {shares}, difference {self.difference:.3g} ({interval})"

    def _facts(self) -> dict[str, Any]:
        return {"message": self.message, "better": self.better, **self._values()}


def compare(
    study_a: Results, study_b: Results, event: str = "holds", confidence: float = 0.95
) -> Comparison:
    """Compares the probabilities of an event in two designs that met the same random numbers.

    With the same `seed`, `sampler` and paths in `vary`, runs of the same number meet the same
    pushes, masses and so on, and are pairs. What both designs survive, or neither, cancels, so that
    far fewer runs tell them apart. Scenes and distributions may differ. The interval is the score
    interval of Tango, "Equivalence test and confidence interval for the difference in proportions
    for the paired-sample design", 1998.

    Args:
        study_a, study_b: The studies of both designs.
        event: "holds", a status, or a violation at any time, as for `Results.probability`.
        confidence: The confidence level of the interval.

    Raises:
        ValueError: The studies have another seed, sampler or paths, no run in common, or a
            `stop_when`, whose results decided which runs there are; or the event is unknown.
        TypeError: One of both is no study.
    """
    for field, study in (("study_a", study_a), ("study_b", study_b)):
        checks.instance(field, study, Results, "an Ensemble or a Study")
        checked_event("event", event, study.scene, study._spec.shapes)
        if study._spec.stop_when:
            rule = "must have a number of runs that was fixed before, for the interval to hold"
            raise ValueError(f"{field} was computed with stop_when: {rule}")
    for name in ("seed", "sampler"):
        _require_same(name, getattr(study_a, name), getattr(study_b, name))
    _require_same("paths in vary", dict(study_a._spec.shapes), dict(study_b._spec.shapes))
    if study_a.sampler == "latin_hypercube":  # its points depend on their number
        _require_same("runs", study_a._spec.draws.runs, study_b._spec.draws.runs)
    confidence = checks.share("confidence", confidence)
    shared, rows_a, rows_b = np.intersect1d(study_a.run, study_b.run, True, return_indices=True)
    if not len(shared):
        raise ValueError("study_a and study_b: must have runs in common, by their numbers")
    a, b = study_a.happened(event)[rows_a], study_b.happened(event)[rows_b]
    only_a, only_b = int((a & ~b).sum()), int((b & ~a).sum())
    return Comparison(
        event=event,
        difference=(only_a - only_b) / len(shared),
        low=-_greatest_difference(only_b, only_a, len(shared), confidence),
        high=_greatest_difference(only_a, only_b, len(shared), confidence),
        confidence=confidence,
        a=Estimate.of(a, confidence),
        b=Estimate.of(b, confidence),
        pairs=len(shared),
        only_a=only_a,
        only_b=only_b,
    )


def _require_same(name: str, a: object, b: object) -> None:
    if a != b:
        given = f"study_a has {checks.shown(a)}, study_b {checks.shown(b)}"
        raise ValueError(f"{name}: must be the same, for the runs to be pairs; {given}")


def _greatest_difference(only_a: int, only_b: int, n: int, confidence: float) -> float:
    """The largest difference that Tango's score test does not reject, by bisection."""
    z = -NormalDist().inv_cdf(0.5 * (1.0 - confidence))

    def rejected(delta: float) -> bool:
        # The maximum of the likelihood over the probability of "only b", given the difference.
        b = (2 * n - only_a + only_b) * delta - only_a - only_b
        c = -only_b * delta * (1.0 - delta)
        rest = (math.sqrt(max(b * b - 8 * n * c, 0.0)) - b) / (4 * n)
        variance = n * (2.0 * rest + delta * (1.0 - delta))
        return n * delta - (only_a - only_b) > z * math.sqrt(max(variance, 0.0))

    low, high = (only_a - only_b) / n, 1.0
    while high - low > 1e-14:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if rejected(middle) else (middle, high)
    return high
