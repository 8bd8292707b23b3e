"""The gains of the constraint stabilisation."""

from __future__ import annotations

from dataclasses import dataclass

from ..support.record import Record


@dataclass(frozen=True, eq=False, repr=False)
class Stabilization(Record):
    """Gains of the constraint stabilisation (19, 20): numerics, so an argument of `simulate`.

    Attributes:
        alpha: Of the holonomic constraints (19), 1/s.
        beta: Of the nonholonomic constraints (20), 1/s.
    """

    alpha: float = 1000.0
    beta: float = 1000.0
