"""`EnergyLedger`, the energies and works of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..support.display import ShownTable
from ..support.result import Result


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EnergyLedger(Result):
    """Energies and works of a run at its recorded instants, each (n,), J.

    The works start at zero at the run's start. Each is integrated separately, beside the state, so
    `closure` checks both the works and the motion.

    Attributes:
        kinetic: p^T M p / 2; `elastic` is P of (5), `gravity` P_g of (16), zero if the hand moves.
        controller_work: Work of the torques on the fingers, (39) or driving.
        external_work: Work of the disturbances, including impulses.
        viscous_loss: Energy dissipated in the fingertips (44, 45) and joints, positive.
        constraint_work: Integral of lambda^T Phi p, the work of drift off the constraints; with
            formulation "projected" also the energy change by the projections. It is zero on the
            constraints.
        friction_loss: Energy that slip takes, positive. This and the next two are zero in bilateral
            contact.
        impact_loss: Kinetic energy that impacts of tips on the object take, and the ends of the
            relaxation of free tips, positive.
        relaxation_work: Energy that P gains because the tilt of a free tip is frozen in it: at
            re-contact, and while a tip grazes; either sign.
        motion_work: Work of the forces of inertia and gravity in the frame of a hand that moves;
            zero if it is at rest.
        start: Kinetic, elastic and gravity energy at the run's start, J. They equal the first row,
            unless `times` left the start out.
    """

    kinetic: NDArray[np.float64]
    elastic: NDArray[np.float64]
    gravity: NDArray[np.float64]
    controller_work: NDArray[np.float64]
    external_work: NDArray[np.float64]
    viscous_loss: NDArray[np.float64]
    constraint_work: NDArray[np.float64]
    friction_loss: NDArray[np.float64]
    impact_loss: NDArray[np.float64]
    relaxation_work: NDArray[np.float64]
    motion_work: NDArray[np.float64]
    start: tuple[float, float, float]

    def _tables(self) -> Iterator[ShownTable]:
        if not len(self.kinetic):
            return
        entries = {**{name: getattr(self, name) for name in LEDGER}, "closure": self.closure}
        rows = [(k.replace("_", " "), v[0], v[-1], np.abs(v).max()) for k, v in entries.items()]
        columns = ("", "first row [J]", "last row [J]", "largest size [J]")
        yield ShownTable(columns, rows, "Energies and works; the closure is the ledger's error")

    @property
    def total(self) -> NDArray[np.float64]:
        """Kinetic, elastic and gravity energy together (n,), J."""
        with np.errstate(all="ignore"):
            return self.kinetic + self.elastic + self.gravity

    @property
    def closure(self) -> NDArray[np.float64]:
        """The ledger's error (n,), J: (energy - energy at the start) - (works - losses)."""
        # A run that overflowed has infinite energies, and a status that says so.
        with np.errstate(all="ignore"):
            change: NDArray[np.float64] = self.total - sum(self.start)
            works = self.controller_work + self.external_work + self.constraint_work
            works = works + self.motion_work
            by_contact = self.relaxation_work - (self.friction_loss + self.impact_loss)
            return change - ((works - self.viscous_loss) + by_contact)

    @property
    def exchanged(self) -> float:
        """The largest work or change of an energy along the run, J, which scales `closure`."""
        energies = (self.kinetic, self.elastic, self.gravity)
        pairs = zip(energies, self.start, strict=True)
        with np.errstate(all="ignore"):
            changes = [np.abs(energy - start).max() for energy, start in pairs]
        works = (getattr(self, name) for name in LEDGER[3:])
        return float(max(*changes, *(np.abs(work).max() for work in works)))


LEDGER = tuple(name for name in EnergyLedger.__dataclass_fields__ if name != "start")
