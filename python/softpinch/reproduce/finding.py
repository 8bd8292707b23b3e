"""What a verdict is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

HOLDS, FAILS, BEYOND = "holds", "does not hold", "not in the paper"

# Half width of the band for "converges", as far as the paper's figures can be read: for the
# object's settled pose, mm and degrees, and for the finger angles, degrees.
BAND = 0.05


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A claim of the paper, or an observation beyond it, with its verdict.

    Attributes:
        claim: The claim in a few words.
        source: Section or figure of the paper; empty for an observation beyond the paper.
        verdict: "holds", "does not hold", or "not in the paper".
        measure: Description of `value`, with its unit.
        value: The number that decides the verdict.
        limit: The number with which `value` is compared; nan for an observation beyond the paper.
        evidence: A sentence with the numbers.
    """

    claim: str
    source: str
    verdict: str
    measure: str
    value: float
    limit: float
    evidence: str


def beyond(claim: str, measure: str, value: float, evidence: str) -> Finding:
    """An observation beyond the paper."""
    return Finding(
        claim=claim,
        source="",
        verdict=BEYOND,
        measure=measure,
        value=value,
        limit=np.nan,
        evidence=evidence,
    )
