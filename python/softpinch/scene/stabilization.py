"""The gains of the constraint stabilisation."""

from dataclasses import dataclass

from ..support.record import Record


@dataclass(frozen=True, eq=False, repr=False)
class Stabilization(Record):
    """Gains of the constraint stabilisation (19, 20).

    They are an argument of `simulate` and no part of `Scene`, because they belong to the numerics.

    Attributes:
        alpha: Gain for the holonomic constraints (19), 1/s.
        beta: Gain for the nonholonomic constraints (20), 1/s.
    """

    alpha: float = 1000.0
    beta: float = 1000.0
