"""The gains of the constraint stabilisation."""

from dataclasses import dataclass

from ..support.record import Record


@dataclass(frozen=True, eq=False, repr=False)
class Stabilization(Record):
    """Gains for the holonomic constraints, alpha (19), and the nonholonomic, beta (20), 1/s.

    They are an argument of `simulate` and no part of `Scene`, because they belong to the numerics.
    """

    alpha: float = 1000.0
    beta: float = 1000.0
