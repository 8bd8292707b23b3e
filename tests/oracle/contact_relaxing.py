"""Unilateral contact of tips that relax: one Maxwell branch beside the springs of (4).

A branch remembers a force r and a shear zeta, which follow those of the springs within its time. It
resists compression by the share of F(d_n) - r, and shear by that of F'(d_n) (d_t - zeta), which is
what its springs meet; its energy decreases with d_n by the shear, too. It has no couple.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from .contact_modes import Motion
from .contact_system import STATES, Contact, ContactSystem
from .contact_terms import Floats, Terms


class Branch(NamedTuple):
    """What a tip has beside its law F = stiffness d^2, and the law's number."""

    share: float
    time: float
    stiffness: float

    def loads(self, d: float, shear: float, r: float, zeta: float) -> tuple[float, float]:
        """The forces against d_n and d_t, N."""
        sheared = shear - zeta
        pressed = self.stiffness * (d * d + sheared * sheared) - r
        return self.share * pressed, self.share * 2.0 * self.stiffness * d * sheared

    def rates(self, d: float, shear: float, r: float, zeta: float) -> tuple[float, float]:
        """Of r and zeta."""
        return (self.stiffness * d * d - r) / self.time, (shear - zeta) / self.time


class RelaxingSystem(ContactSystem):
    """`ContactSystem` with four more states: r of both tips, and zeta of both."""

    states = STATES + 4

    def __init__(self, scene: Any, *rest: Any, **more: Any) -> None:
        """Reads the branches from the scene; the others are those of `ContactSystem`."""
        super().__init__(*rest, **more)
        self.branches = []
        for tip in scene.hand.tips:
            (branch,) = tip.relaxation
            if tip.law is not None:
                raise ValueError("relaxation: only with the springs of (4)")
            stiffness = math.pi * float(tip.youngs_modulus)
            self.branches.append(Branch(float(branch.share), float(branch.time), stiffness))

    def relaxed(self, start: Floats) -> list[float]:
        """The states of branches that remember what the springs are."""
        force = [b.stiffness * start[5 + i] ** 2 for i, b in enumerate(self.branches)]
        return [*force, *start[7:9].tolist()]

    def _of(self, y: Floats, i: int) -> tuple[float, float, float, float]:
        return float(y[5 + i]), float(y[7 + i]), float(y[STATES + i]), float(y[STATES + 2 + i])

    def terms(self, y: Floats, asked: Sequence[float], contact: Contact) -> Terms:
        """As `ContactSystem.terms`, with the forces of the branches."""
        found = super().terms(y, asked, contact)
        for i, branch in enumerate(self.branches):
            normal, tangential = branch.loads(*self._of(y, i))
            found.force[5 + i] -= normal
            found.force[7 + i] -= tangential
        return found

    def rates_of(
        self, y: Floats, terms: Terms, found: Motion, asked: Sequence[float], contact: Contact
    ) -> Floats:
        """As `ContactSystem.rates_of`."""
        result = super().rates_of(y, terms, found, asked, contact)
        for i, branch in enumerate(self.branches):
            result[STATES + i], result[STATES + 2 + i] = branch.rates(*self._of(y, i))
        return result
