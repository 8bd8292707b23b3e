"""`equilibrium_map`: where a grasp comes to rest over one or two numbers of its scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..scene.coordinates import COORDINATE_UNITS, COORDINATES
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats, read_only
from ..support.progress import Report
from ..support.result import Result
from ..support.table import save_by_suffix, save_csv, save_npz
from .equilibrium_search import Plan, Search
from .ports import MULTIPLIERS
from .rest import Equilibrium

Bools = NDArray[np.bool_]
Integers = NDArray[np.int64]
Texts = NDArray[np.str_]

_POSE = COORDINATES[:3]
# The arrays over the cells, with the names of the entries of each cell and their units.
_ENTRIES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "status": (("status",), ("",)),
    "branch": (("branch",), ("1",)),
    "q": (COORDINATES, COORDINATE_UNITS),
    "multipliers": (MULTIPLIERS, ("N",) * 4),
    "friction_needed": (("friction_needed_1", "friction_needed_2"), ("1", "1")),
    "friction_margin": (("friction_margin",), ("1",)),
    "stiffness": (
        tuple(f"stiffness_{force}_{by}" for force in _POSE for by in _POSE),
        ("N/m", "N/m", "N/rad", "N/m", "N/m", "N/rad", "N", "N", "N m/rad"),
    ),
    "stable": (("stable",), ("1",)),
    "minimum": (("minimum",), ("1",)),
    "growth": (("growth",), ("1/s",)),
    "energy": (("energy",), ("J",)),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EquilibriumMap(Result):
    """Equilibria over one axis (m,) or two axes (m, n); all arrays have a cell for each value.

    Cells without an equilibrium have the branch -1 and nan in all numbers; `status` and
    `equilibrium(i, j).message` have the reason.

    Attributes:
        axes: Names of one or two axes.
        units: Unit of each axis.
        values: Values of each axis, increasing.
        status: "at_rest", or why there is no equilibrium, as `Equilibrium.status` (m, n).
        branch: Number of the branch (m, n), -1 without equilibrium. The equilibria of a branch
            continue each other from cell to cell without a fold; the branch 0 begins at the cell
            nearest to the scene's own values. Another number means that no cell of the branches
            before it continues to this one; branches may be connected outside the map. In
            unilateral contact, cells whose sticking tips would pull, slip or leave their face have
            a branch, but no equilibrium.
        seams: Pairs of neighbouring cells (k, 2, axes) of one branch that do not continue each
            other: the branch reaches both, but around the end of a fold that lies between them.
        q: Coordinates at rest (m, n, 9), m and rad.
        multipliers: lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N (m, n, 4), N.
        friction_needed: |lambda^N| / lambda^H of both contacts (m, n, 2); inf where a tip pulls.
        friction_margin: The smallest mu - |lambda^N| / lambda^H (m, n); inf without friction.
        stiffness: The stiffness of the grasp (m, n, 3, 3), N/m, N and N m/rad.
        stable: Whether the grasp is stable (m, n), as `Equilibrium.stable`.
        minimum: Whether the energy has a minimum (m, n), as `Equilibrium.minimum`.
        growth: Spectral abscissa without the two zeros (m, n), 1/s, as `Equilibrium.growth`.
        energy: Elastic energy (5) plus energy of gravity (16) (m, n), J.
        scene: The scene that the axes vary.
        cells: The equilibria, row by row.
    """

    axes: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[Floats, ...]
    status: Texts
    branch: Integers
    seams: Integers
    q: Floats
    multipliers: Floats
    friction_needed: Floats
    friction_margin: Floats
    stiffness: Floats
    stable: Bools
    minimum: Bools
    growth: Floats
    energy: Floats
    scene: Scene
    cells: tuple[Equilibrium, ...]

    def __post_init__(self) -> None:
        """Makes the arrays read-only."""
        super().__post_init__()
        for values in self.values:
            read_only(values)

    @property
    def rotation(self) -> Floats:
        """The object's angle at rest (m, n), rad."""
        return self.q[..., 2]

    @property
    def position(self) -> Floats:
        """The place of the object's centre of gravity at rest (m, n, 2), m."""
        return self.q[..., :2]

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values on each axis."""
        return self.status.shape

    def equilibrium(self, i: int, j: int | None = None) -> Equilibrium:
        """The whole `Equilibrium` of a cell, or the reason why it has none.

        Args:
            i: Index on the first axis; negative ones count from the end.
            j: Index on the second axis, if there is one.

        Raises:
            ValueError: An index is outside the map, or there is no second axis.
            TypeError: An index is no integer, or the second one is missing.
        """
        place = [i] if j is None and len(self.axes) == 1 else [i, j]
        if len(place) > len(self.axes):
            raise ValueError(f"j = {checks.shown(j)}: the map has one axis")
        sized = zip("ij", place, self.shape, strict=False)
        index = [checks.integer(name, k, -size, size - 1) for name, k, size in sized]
        number = np.arange(len(self.cells)).reshape(self.shape)[tuple(index)]
        return self.cells[int(number)]

    def __repr__(self) -> str:
        """Shows the axes, and how many cells ended in which way."""
        axes = " x ".join(
            f"{name} ({len(values)})" for name, values in zip(self.axes, self.values, strict=True)
        )
        parts = [f"{int((self.status == 'at_rest').sum())} of {self.status.size} at rest"]
        parts += [f"{int(self.stable.sum())} stable"]
        if self.branch.max() > 0:
            parts += [f"{int(self.branch.max()) + 1} branches"]
        for name in np.unique(self.status[self.status != "at_rest"]).tolist():
            parts += [f"{name.replace('_', ' ')} {int((self.status == name).sum())}"]
        return f"<EquilibriumMap {axes}: {', '.join(parts)}>"

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Name -> array: the values of the axes by their names, `seams`, the arrays over cells."""
        axes = dict(zip(self.axes, self.values, strict=True))
        return {**axes, "seams": self.seams, **{name: getattr(self, name) for name in _ENTRIES}}

    def provenance(self) -> dict[str, Any]:
        """Version and scene with which this map was computed, as plain data."""
        return {
            "softpinch": _core.__version__,
            "results_version": _core.RESULTS_VERSION,
            "scene": self.scene.to_dict(),
            "axes": list(self.axes),
            "units": list(self.units),
        }

    def save(self, path: str | Path) -> Path:
        """Writes the map as .csv, with a row for each cell, or as .npz with `to_dict()`.

        Raises:
            ValueError: The suffix is neither .csv nor .npz.
            OSError: The file cannot be written.
        """
        path = checks.path("path", path)
        return save_by_suffix(path, {".npz": self._save_npz, ".csv": self._save_csv})

    def _save_npz(self, path: Path) -> None:
        save_npz(path, self.to_dict(), self.provenance())

    def _save_csv(self, path: Path) -> None:
        header = [f"{name} [{unit}]" for name, unit in zip(self.axes, self.units, strict=True)]
        for names, units in _ENTRIES.values():
            header += [f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=True)]

        def row(index: tuple[int, ...]) -> list[Any]:
            found = [float(v[k]) for v, k in zip(self.values, index, strict=True)]
            for name in _ENTRIES:
                found += np.ravel(getattr(self, name)[index]).tolist()
            return found

        save_csv(path, header, (row(index) for index in np.ndindex(self.shape)))


def equilibrium_map(
    scene: Scene,
    axes: Mapping[str, ArrayLike],
    *,
    time: float | None = None,
    grip: ArrayLike | None = None,
    shear: ArrayLike | None = None,
    progress: bool | Report = True,
) -> EquilibriumMap:
    """Finds where a grasp comes to rest over one or two numbers of its scene.

    The first cell is the one nearest to the scene's own values that has an equilibrium, found as
    `equilibrium` finds it. From there on each cell continues the equilibrium of a solved neighbour
    (pseudo-arclength continuation of the straight way between the scenes), so that the map does not
    jump to other equilibria at a fold. What no neighbour reaches is searched anew, and what is
    found there is another `branch`, which is continued likewise. Remaining cells have the reason
    that `equilibrium` gives.

    Args:
        scene: The scene that the axes vary.
        axes: Name of an axis -> its values, increasing; one or two axes. A name is a path to one
            number as in `vary` of `monte_carlo`, such as "grasped.mass", "friction" or
            "schedule.angles.0.0"; or a number of the family's member: "grip.right", "grip.left" or
            "grip" (of both tips), "shear.right", "shear.left" or "shear", m.
        time: The instant whose targets and forces hold, s, as for `equilibrium`.
        grip: Where the tips hold the object's faces (2,), m above its centre of gravity, unless an
            axis says it; None means the centre of gravity.
        shear: The shears (2,), m, instead of `grip`, unless an axis says them.
        progress: True draws a bar on a terminal; False draws none; or a function that is called
            with the number of finished steps and of all steps: the cells, and the pairs of
            neighbours that are compared for `seams`.

    Raises:
        ValueError: A path does not lead to one number, or has no effect on where the scene rests;
            values do not increase or break the rule of their field; or grip and shear are mixed.
            All are found before anything is computed.
        TypeError: An argument is of the wrong kind.
        KeyboardInterrupt: Ctrl-C, within a second. Nothing is kept.
    """
    search = Search(Plan(scene, axes, time=time, grip=grip, shear=shear))
    cells = search.run(progress)
    shape = search.plan.shape

    def array(of: Any) -> NDArray[Any]:
        found = np.array([of(cell) for cell in cells])
        return found.reshape(shape + found.shape[1:])

    return EquilibriumMap(
        axes=search.plan.names,
        units=search.plan.units,
        values=search.plan.values,
        status=array(lambda cell: cell.status),
        branch=search.branch,
        seams=search.seams,
        q=array(lambda cell: np.full(9, np.nan) if cell.state is None else cell.state.q),
        multipliers=array(lambda cell: cell.multipliers),
        friction_needed=array(lambda cell: cell.friction_needed),
        friction_margin=array(lambda cell: cell.friction_margin),
        stiffness=array(lambda cell: cell.stiffness),
        stable=array(lambda cell: cell.stable),
        minimum=array(lambda cell: cell.minimum),
        growth=array(lambda cell: cell.growth),
        energy=array(lambda cell: cell.energy),
        scene=scene,
        cells=tuple(cells),
    )
