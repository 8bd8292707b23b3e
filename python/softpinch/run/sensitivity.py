"""The derivatives of a run, and the state from which another run continues them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np

from .. import _core
from ..scene.directions import by_path, count, directions, listed, require_derivatives, shapes
from ..scene.parts import branches
from ..scene.scene import State
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.display import Shown, ShownTable
from ..support.errors import NotRecordedError, StabilityWarning, warn
from ..support.result import Result
from .contact import ContactMode
from .ledger import LEDGER
from .request import Request

# The columns of the energy ledger in bilateral contact.
_ENERGIES = LEDGER[:7]
# Quantities that are kept only if `record` has them.
_RECORDED = ("multipliers", "torque", "energy")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SensitivityState(Result):
    """The derivatives of a run's state at one instant, from which another run continues them.

    Attributes:
        shapes: Path -> the shape of the value there.
        derivatives: (20 + k, d), of q, p, the integrals of the angle errors and the k states of
            `Maxwell` branches, by the d numbers at the paths.
    """

    shapes: Mapping[str, tuple[int, ...]]
    derivatives: Floats

    def __post_init__(self) -> None:
        name, columns = "SensitivityState.derivatives", count(self.shapes)
        found = checks.numbers(name, self.derivatives)
        if found.shape not in ((20, columns), (24, columns), (28, columns)):
            rule = f"must have {(20, columns)}, and 4 more rows for each Maxwell branch"
            raise ValueError(f"{name} has shape {found.shape}: {rule}")
        object.__setattr__(self, "derivatives", found)
        super().__post_init__()


class Sensitivity(Shown, Mapping[str, Floats]):
    """The derivatives of a run's recorded rows by numbers of its scene.

    It is a mapping: `run.sensitivity[path]` has the derivatives of q (columns 0 to 8) and p (9 to
    17) by the value at `path`, (n, 18), or (n, 18, ...) if that is a pair or an array. Units are
    those of the coordinate or rate over that of the value. `multipliers`, `torque`, `integral`,
    `relaxation` and `energy` are mappings of the same kind.

    They are the derivatives of the numbers that the run computed, exact to round-off, with the
    number and the lengths of its steps held, with `tolerance` its error control too: where a path
    moves a breakpoint, the motion is that of the exact equations in the time by which it moves. At
    a switch or an impulse a row has the derivatives just before it. A path that names no side is
    both sides' together.

    In unilateral contact they jump at the events of contacts, whose times have derivatives
    (`ContactChange.sensitivity`). Where an event only just happens, or coincides with another one
    or with a breakpoint, there are none: from there on they are NaN, with a warning. Those by a
    number that moves a breakpoint are NaN from a change of modes at it on; the others stay.
    """

    def __init__(
        self,
        shapes: Mapping[str, tuple[int, ...]],
        found: Mapping[str, Floats],
        record: Sequence[str],
    ) -> None:
        self._shapes = dict(shapes)
        self._found = {name: read_only(value) for name, value in found.items()}
        self._record = tuple(record)

    def _of(self, quantity: str) -> dict[str, Floats]:
        """Returns path -> the derivatives of a quantity, (n, numbers, ...)."""
        return by_path(self._found[quantity], self._shapes)

    def _changes(self, count: int) -> list[dict[str, Floats]]:
        """Returns path -> the derivatives of the time, of each of so many changes of contacts."""
        known = self._found["contact_changes"]
        missing = np.full((count - len(known), *known.shape[1:]), np.nan)
        found = by_path(np.concatenate([known, missing]), self._shapes)
        return [{path: value[k] for path, value in found.items()} for k in range(count)]

    def _recorded(self, quantity: str) -> dict[str, Floats]:
        if quantity not in self._record:
            why = f"{quantity!r} was not recorded: add it to record"
            raise NotRecordedError(f"sensitivity.{quantity}: {why}")
        return self._of(quantity)

    def __getitem__(self, path: str) -> Floats:
        if path not in self._shapes:
            raise KeyError(f"{path!r}: the run has derivatives by {checks.quoted(self._shapes)}")
        return self._of("state")[path]

    def __iter__(self) -> Iterator[str]:
        return iter(self._shapes)

    def __len__(self) -> int:
        return len(self._shapes)

    @property
    def integral(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the integrals of the angle errors (n, 2, ...)."""
        return self._of("integral")

    @property
    def relaxation(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the states of `Maxwell` branches (n, k, ...)."""
        return self._of("relaxation")

    @property
    def multipliers(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the multipliers (n, 4, ...), if these were recorded."""
        return self._recorded("multipliers")

    @property
    def torque(self) -> Mapping[str, Floats]:
        """Path -> the derivatives of the torques on the fingers (n, 2, ...), if recorded."""
        return self._recorded("torque")

    @property
    def energy(self) -> Mapping[str, Mapping[str, Floats]]:
        """Name of a column of `EnergyLedger` -> path -> its derivatives (n, ...), if recorded.

        The columns are kinetic, elastic, gravity, controller_work, external_work, viscous_loss and
        constraint_work; bilateral contact has no other.
        """
        found = self._recorded("energy")
        pairs = enumerate(_ENERGIES)
        return {name: {path: value[:, k] for path, value in found.items()} for k, name in pairs}

    def at(self, k: int = -1) -> SensitivityState:
        """Returns the derivatives of the state at recorded row `k`.

        A run from `run.state(k)` with `sensitivities=run.sensitivity.at(k)` continues them; with
        `dt` it gives the same bits as an uninterrupted run.
        """
        rows = len(self._found["state"])
        k = checks.integer("k", k)
        if not -rows <= k < rows:
            raise IndexError(f"k = {checks.shown(k)}: the run has only {rows} recorded rows")
        parts = ("state", "integral", "relaxation")
        whole = np.concatenate([self._found[name][k] for name in parts])
        lost = [path for path, own in by_path(whole, self._shapes).items() if np.isnan(own).any()]
        if lost:
            why = f"the derivatives by {checks.quoted(lost)} are NaN in this row"
            raise ValueError(f"sensitivity.at: k = {k}: {why}, so none go on from it")
        return SensitivityState(shapes=self._shapes, derivatives=whole)

    def __reduce__(self) -> tuple[Any, ...]:
        # Unpickled arrays would be writable.
        return Sensitivity, (self._shapes, self._found, self._record)

    def _tables(self) -> Iterator[ShownTable]:
        yield ShownTable(("by", "derivatives"), tuple(self.items()))

    def __repr__(self) -> str:
        return f"<Sensitivity of {len(self._found['state'])} rows by {', '.join(self._shapes)}>"


def checked(
    request: Request, asked: str | Sequence[str] | SensitivityState
) -> tuple[dict[str, tuple[int, ...]], _core.Directions | None]:
    """Checks `sensitivities` before the run: path -> shape, and the directions, if any."""
    scene, seeds = request.scene, None
    if isinstance(asked, SensitivityState):
        seeds = asked.derivatives
        paths = list(asked.shapes)
        if not isinstance(scene.initial, State):
            rule = "a SensitivityState goes with the State of the same row"
            raise ValueError(f"sensitivities: {rule}")
        contact = scene.initial.contact
        if contact is not None and (contact[:2] == ContactMode.FREE).any():
            # The derivative of its frozen tilt is not kept.
            rule = "a SensitivityState goes on only from a row in which no tip is free"
            raise ValueError(f"sensitivities: {rule}")
        checks.require_finite("sensitivities.derivatives", seeds)
    else:
        paths = listed(asked)
    if not paths:
        return {}, None
    require_derivatives(scene)
    found = shapes(scene, paths)
    rows = 20 + 4 * branches(scene)
    if seeds is not None and (found, rows) != (asked.shapes, len(seeds)):  # type: ignore[union-attr]
        raise ValueError("sensitivities: the SensitivityState is that of another scene")
    along = directions(scene, paths, seeds=seeds)
    # Without rows, the core only refuses what has no derivatives.
    _core.sensitivities(request.simulation(), along, np.empty(0))
    return found, along


def differentiated(
    request: Request, t: Floats, wanted: tuple[dict[str, tuple[int, ...]], _core.Directions | None]
) -> Sensitivity | None:
    """Computes the derivatives of a run at its recorded times `t`; `wanted` is from `checked`."""
    paths, along = wanted
    if along is None:
        return None
    found, followed = _core.sensitivities(request.simulation(), along, t)
    failed, times = zip(*followed, strict=True)
    # Times of changes after the last that is known are NaN.
    changes = np.array(list(zip_longest(*times, fillvalue=np.nan))).reshape(-1, len(times))
    lost = by_path(np.array([failed], dtype=object), paths)
    for reason in dict.fromkeys(filter(None, failed)):
        own = [path for path, reasons in lost.items() if (reasons == reason).any()]
        by = "" if len(own) == len(paths) else f" by {checks.quoted(own)}"
        warn(f"{reason}{by}. The derivatives from there on are NaN", StabilityWarning)
    ends = np.cumsum(list(_core.SENSITIVITIES.values()))[:-1]
    split = np.split(np.moveaxis(found, 0, -1), ends, axis=1)
    parts = dict(zip(_core.SENSITIVITIES, split, strict=True))
    parts["relaxation"] = parts["relaxation"][:, : 4 * branches(request.scene)]
    # Copies, so that the memory of what was not recorded can be used again.
    left_out = {*_RECORDED} - {*request.options.record}
    kept = {name: part.copy() for name, part in parts.items() if name not in left_out}
    return Sensitivity(paths, kept | {"contact_changes": changes}, request.options.record)
