"""The derivatives of a run, and the state from which another run continues them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import _core
from ..scene.directions import (
    by_path,
    count,
    directions,
    listed,
    require_derivatives,
    shapes,
)
from ..scene.scene import Scene, State
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.display import Shown, ShownTable
from ..support.errors import NotRecordedError, StabilityWarning, warn
from ..support.result import Result
from .ledger import LEDGER
from .options import Options

# The columns of the energy ledger in bilateral contact.
_ENERGIES = LEDGER[:7]
# Quantity of the core's result -> the group of `record` that it belongs to.
_GROUPS = {"multipliers": "multipliers", "torque": "torque", "energy": "energy"}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SensitivityState(Result):
    """The derivatives of a run's state at one instant, from which another run continues them.

    Attributes:
        shapes: Path -> the shape of the value there.
        derivatives: (20, d), of q, p and the integrals of the angle errors, by the d numbers at the
            paths.
    """

    shapes: Mapping[str, tuple[int, ...]]
    derivatives: Floats

    def __post_init__(self) -> None:
        """Checks the derivatives.

        Raises:
            ValueError: The shape is wrong.
            TypeError: A value is not a number.
        """
        found = checks.numbers("SensitivityState.derivatives", self.derivatives)
        wanted = (20, count(self.shapes))
        if found.shape != wanted:
            raise ValueError(
                f"SensitivityState.derivatives has shape {found.shape}: must have {wanted}"
            )
        object.__setattr__(self, "derivatives", found)
        super().__post_init__()


class Sensitivity(Shown, Mapping[str, Floats]):
    """The derivatives of a run's recorded rows by numbers of its scene.

    It is a mapping: `run.sensitivity[path]` has the derivatives of q (columns 0 to 8) and p (9 to
    17) by the value at `path`, (n, 18), or (n, 18, ...) if that is a pair or an array. Units are
    those of the coordinate or rate over that of the value. `multipliers`, `torque`, `integral` and
    `energy` are mappings of the same kind. Derivatives of other quantities follow from the chain
    rule.

    They are the derivatives of the numbers that the run computed, exact to round-off, with the
    number and the lengths of its steps held: where a path moves a breakpoint, the motion is that of
    the exact equations in the time by which it moves. With `tolerance` the error control is held
    too, so that the derivatives have the errors of the run's own accuracy, and at instants of
    `times` inside a step they are those of a step that ends there. At a switch or an impulse a row
    has the derivatives just before it. A path that names no side is both sides' together.
    """

    def __init__(
        self,
        shapes: Mapping[str, tuple[int, ...]],
        found: Mapping[str, Floats],
        record: Sequence[str],
    ) -> None:
        """Takes the derivatives (n, numbers, d) by quantity; users get them from `simulate`."""
        self._shapes = dict(shapes)
        self._found = {name: read_only(value) for name, value in found.items()}
        self._record = tuple(record)

    def _of(self, quantity: str) -> dict[str, Floats]:
        """Returns path -> the derivatives of a quantity, (n, numbers, ...)."""
        return by_path(self._found[quantity], self._shapes)

    def _recorded(self, quantity: str) -> dict[str, Floats]:
        group = _GROUPS[quantity]
        if group not in self._record:
            raise NotRecordedError(
                f"sensitivity.{quantity}: {group!r} was not recorded: add it to record"
            )
        return self._of(quantity)

    def __getitem__(self, path: str) -> Floats:
        """Returns the derivatives of q and p by the value at a path, (n, 18, ...).

        Raises:
            KeyError: The run has no derivatives by this path.
        """
        if path not in self._shapes:
            raise KeyError(f"{path!r}: the run has derivatives by {checks.quoted(self._shapes)}")
        return self._of("state")[path]

    def __iter__(self) -> Iterator[str]:
        """Iterates over the paths."""
        return iter(self._shapes)

    def __len__(self) -> int:
        """Returns the number of paths."""
        return len(self._shapes)

    @property
    def integral(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the integrals of the angle errors (n, 2, ...)."""
        return self._of("integral")

    @property
    def multipliers(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the multipliers (n, 4, ...), if these were recorded.

        Raises:
            NotRecordedError: The multipliers were not recorded.
        """
        return self._recorded("multipliers")

    @property
    def torque(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the torques on the fingers (n, 2, ...), if recorded.

        Raises:
            NotRecordedError: The torques were not recorded.
        """
        return self._recorded("torque")

    @property
    def energy(self) -> Mapping[str, Mapping[str, Floats]]:
        """Name of a column of `EnergyLedger` -> path -> its derivatives (n, ...), if recorded.

        The columns are kinetic, elastic, gravity, controller_work, external_work, viscous_loss and
        constraint_work; bilateral contact has no other.

        Raises:
            NotRecordedError: The energies were not recorded.
        """
        found = self._recorded("energy")
        return {
            name: {path: value[:, k] for path, value in found.items()}
            for k, name in enumerate(_ENERGIES)
        }

    def at(self, k: int = -1) -> SensitivityState:
        """Returns the derivatives of the state at recorded row `k`.

        A run from `run.state(k)` with `sensitivities=run.sensitivity.at(k)` continues them; with
        `dt` it gives the same bits as an uninterrupted run.

        Raises:
            IndexError: The run has no row `k`.
            TypeError: `k` is not an integer.
        """
        rows = len(self._found["state"])
        k = checks.integer("k", k)
        if not -rows <= k < rows:
            raise IndexError(f"k = {checks.shown(k)}: the run has only {rows} recorded rows")
        whole = np.concatenate([self._found["state"][k], self._found["integral"][k]])
        return SensitivityState(shapes=self._shapes, derivatives=whole)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles through the constructor, because an unpickled array would be writable."""
        return Sensitivity, (self._shapes, self._found, self._record)

    def _tables(self) -> Iterator[ShownTable]:
        yield ShownTable(("by", "derivatives"), tuple(self.items()))

    def __repr__(self) -> str:
        """Shows the paths and the number of rows."""
        return f"<Sensitivity of {len(self._found['state'])} rows by {', '.join(self._shapes)}>"


def checked(
    scene: Scene, asked: str | Sequence[str] | SensitivityState
) -> tuple[dict[str, tuple[int, ...]], Floats | None]:
    """Checks `sensitivities` of `simulate`: path -> shape, and derivatives of the start if given.

    Raises:
        ValueError: The scene has no derivatives, or a path has none.
        TypeError: `sensitivities` is neither a path, paths, nor a `SensitivityState`.
    """
    seeds = None
    if isinstance(asked, SensitivityState):
        seeds = asked.derivatives
        paths = list(asked.shapes)
        if not isinstance(scene.initial, State):
            raise ValueError(
                "sensitivities: a SensitivityState goes with the State of the same row"
            )
        checks.require_finite("sensitivities.derivatives", seeds)
    else:
        paths = listed(asked)
    if paths:
        require_derivatives(scene)
    found = shapes(scene, paths)
    if seeds is not None and found != asked.shapes:  # type: ignore[union-attr]
        raise ValueError("sensitivities: the SensitivityState is that of another scene")
    return found, seeds


def differentiated(
    scene: Scene,
    simulation: _core.Simulation,
    t: Floats,
    wanted: tuple[dict[str, tuple[int, ...]], Floats | None],
    options: Options,
) -> Sensitivity:
    """Computes the derivatives of a run at its recorded times `t`.

    Raises:
        KeyboardInterrupt: Ctrl-C.
        ValueError: A number of a disturbance has no derivative, or the equations of an implicit
            step were not solved again.
    """
    paths, seeds = wanted
    along = directions(scene, list(paths), seeds=seeds)
    found, failed = _core.sensitivities(simulation, along, t)
    if failed is not None:
        warn(f"{failed}. The derivatives from there on are NaN", StabilityWarning)
    ends = np.cumsum(list(_core.SENSITIVITIES.values()))[:-1]
    parts = dict(zip(_core.SENSITIVITIES, np.split(found, ends, axis=1), strict=True))
    # Copies, so that the memory of what was not recorded can be used again.
    kept = {
        name: part.copy()
        for name, part in parts.items()
        if name not in _GROUPS or name in options.record
    }
    return Sensitivity(paths, kept, options.record)
