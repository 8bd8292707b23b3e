"""The part of a run that `check` and `check_contact` use, and their failure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn, Protocol

from ..scene.scene import Scene, State
from ..support.arrays import Floats
from .contact import ContactChange


class Ledger(Protocol):
    """The part of `EnergyLedger` that the checks use."""

    @property
    def friction_loss(self) -> Floats:
        """The energy that friction took so far (n,), J."""

    @property
    def impact_loss(self) -> Floats:
        """The energy that impacts took so far (n,), J."""

    @property
    def closure(self) -> Floats:
        """The ledger's error (n,), J."""

    @property
    def exchanged(self) -> float:
        """The energy that scales the ledger's error, J."""


class Finished(Protocol):
    """The part of `Run` that the checks use. Importing `Run` here would be a circular import."""

    scene: Scene
    t: Floats
    status: str
    violations: dict[str, float]
    holds: bool
    record: tuple[str, ...]
    stop_on: tuple[str, ...]

    @property
    def q(self) -> Floats:
        """Coordinates (n, 9)."""

    @property
    def p(self) -> Floats:
        """Rates of the coordinates (n, 9)."""

    @property
    def multipliers(self) -> Floats:
        """Multipliers (n, 4)."""

    @property
    def residuals(self) -> Floats:
        """Constraint residuals (n, 4)."""

    @property
    def contact_changes(self) -> list[ContactChange]:
        """The changes of the contacts' modes."""

    @property
    def energy(self) -> Ledger:
        """The energy ledger."""

    @property
    def success(self) -> bool:
        """Whether the run reached its end time."""

    def arrays(self) -> Mapping[str, Floats]:
        """The recorded arrays by name."""

    def state(self, k: int = -1) -> State:
        """The state at row `k`."""


def fail(run: Finished, invariant: str, row: int, finding: str) -> NoReturn:
    """Raises the AssertionError of a broken invariant, with the time of the row."""
    row %= len(run.t)
    raise AssertionError(f"{invariant}: {finding} at t = {run.t[row]} s (row {row})")


def radius(run: Finished, side: int) -> float:
    """Returns the radius of the right (0) or the left (1) fingertip, m."""
    return run.scene.hand.tips[side].radius
