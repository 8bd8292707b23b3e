"""What a simulation with unilateral contact returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .contact_modes import FREE, GRAZE, SLIP_DOWN, SLIP_UP, STICK
from .contact_terms import Floats

CODES = {FREE: 0, STICK: 1, SLIP_UP: 2, SLIP_DOWN: 2, GRAZE: 3}


class Change(NamedTuple):
    """One finger's change of mode.

    Attributes:
        time: s.
        finger: "right" or "left".
        before: Mode: "stick", "slip+", "slip-", "graze" or "free".
        after: Mode.
        cause: The finger's own event ("cone", "stopped", "unloaded", "empty", "full", "gap",
            "stop"), "input", "impulse", or "other": an event of the other finger.
    """

    time: float
    finger: str
    before: str
    after: str
    cause: str


class Row(NamedTuple):
    """What is known of one instant; see `UnilateralReference`."""

    t: float
    q: Floats
    p: Floats
    multipliers: Floats
    modes: tuple[str, str]
    couples: Floats
    integral: Floats
    frozen: tuple[float, float]


@dataclass(frozen=True, eq=False)
class UnilateralReference:
    """A reference trajectory with unilateral contact.

    Attributes:
        t: Wanted instants that were reached (n,), s.
        q: (n, 9).
        p: (n, 9); at an impulse just before it.
        multipliers: (n, 4), N; at a break just after it, but at the end just before.
        modes: Of both fingers, n pairs; when as with the multipliers.
        couples: psi (n, 2): the share of each tip's couple that acts.
        integral: (n, 2), rad s.
        changes: Every change of mode.
        ledger: J. Works of "torque", "external", "viscous" (negative) and "impulse"; losses
            "friction", "impact" and "stop" (positive); gains "graze" and "relaxation", of either
            sign; "start" and "end", T + P + P_g.
        status: "completed", "crushed", "folded", "lost", "chattering", "no_mode", "not_finite".
        end: The last instant.
        worst: Along the ends of all steps: "normal" (least lambda^H of a closed finger, N), "cone"
            (most |lambda^N| - mu lambda^H, N), "gap" (least of a free finger, m), "position" and
            "velocity" (largest residual of an active constraint, m and m/s).
        exchanged: Sum of the absolute works and losses, J.
        evaluations: Of the equations of motion.
    """

    t: Floats
    q: Floats
    p: Floats
    multipliers: Floats
    modes: list[tuple[str, str]]
    couples: Floats
    integral: Floats
    changes: list[Change]
    ledger: dict[str, float]
    status: str
    end: Row
    worst: dict[str, float]
    exchanged: float
    evaluations: int

    @property
    def codes(self) -> NDArray[np.int64]:
        """Modes as in softpinch's ContactMode (n, 2): free 0, stick 1, slip 2, graze 3."""
        return np.array([[CODES[mode] for mode in pair] for pair in self.modes], dtype=np.int64)

    @property
    def holds(self) -> bool:
        """Whether the run is completed and no finger is free at its end."""
        return self.status == "completed" and FREE not in self.end.modes

    @property
    def imbalance(self) -> float:
        """What the ledger does not account for, J."""
        book = self.ledger
        gains = ("torque", "external", "viscous", "impulse", "graze", "relaxation")
        losses = ("friction", "impact", "stop")
        accounted = sum(book[g] for g in gains) - sum(book[loss] for loss in losses)
        return book["end"] - book["start"] - accounted
