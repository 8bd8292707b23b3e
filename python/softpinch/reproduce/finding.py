"""A claim of the paper, or an observation beyond it, with its verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..scene.fields import COORDINATE_UNITS, DISPLAY_UNITS

HOLDS, FAILS, BEYOND = "holds", "does not hold", "not in the paper"

# From x, y, theta in SI units to the units of tables and figures, mm and degrees.
POSE = np.array([DISPLAY_UNITS[unit][1] for unit in COORDINATE_UNITS[:3]])
# Half width of the band for "converges", as far as the paper's figures can be read: for the
# object's settled pose, mm and degrees, and for the finger angles, degrees.
BAND = 0.05
# Half width of the band for x and y, m, and theta, rad.
BANDS = np.array([1e-3 * BAND, 1e-3 * BAND, np.deg2rad(BAND)])


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A claim of the paper, or an observation beyond it, with its verdict."""

    claim: str  # in a few words
    source: str  # section or figure of the paper; empty for an observation
    verdict: str  # "holds", "does not hold", or "not in the paper"
    measure: str  # description of `value`, with its unit
    value: float  # the number that decides the verdict
    limit: float  # the number with which `value` is compared; nan for an observation
    evidence: str  # a sentence with the numbers


def observation(claim: str, measure: str, value: float, evidence: str) -> Finding:
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
