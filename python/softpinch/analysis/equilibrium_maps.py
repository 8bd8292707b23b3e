"""`equilibrium_map`: where a grasp comes to rest over one or two numbers of its scene."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run.request import rest_scene
from ..scene.control import require_known_torque
from ..scene.fields import COORDINATE_UNITS, COORDINATES, QUANTITIES, of_column, units
from ..scene.parts import jaws
from ..scene.paths import resolve
from ..scene.scene import Scene
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Bools, Floats, Texts, read_only
from ..support.display import ShownTable
from ..support.progress import Report, reporting
from ..support.result import Result
from ..support.table import save_map
from .rest import Equilibrium, from_core, last_instant

Integers = NDArray[np.int64]
Cell = tuple[int, ...]

# Axis along the family -> kind of the member, and indices of the tips that the axis sets.
FAMILY: dict[str, tuple[str, tuple[int, ...]]] = {
    f"{kind}{side}": (kind, tips)
    for kind in ("grip", "shear")
    for side, tips in (("", (0, 1)), (".right", (0,)), (".left", (1,)))
}
# Fields of a scene on which its equilibria do not depend.
_WITHOUT_EFFECT = ("initial", "duration")
# The most cells of a map; each has an `Equilibrium` of several kB.
_MOST = 100_000
# Two equilibria are one if their coordinates differ by less, as a share of a tip's radius or in
# rad. The balance is solved to 1e-11; at a fold, coordinates have the square root of its error.
_SAME = 1e-5

_POSE = COORDINATES[:3]
# The arrays over the cells, with the names of the entries of each cell and their units.
_ENTRIES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "status": (("status",), ("",)),
    "branch": (("branch",), ("1",)),
    "q": (COORDINATES, COORDINATE_UNITS),
    "multipliers": (QUANTITIES["multipliers"].symbols, ("N",) * 4),
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
            continue each other from cell to cell without a fold, those of the branch 0 from the
            cell nearest to the scene's own values; branches may be connected outside the map. In
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
        """
        if len(self.axes) == 1 and j is not None:
            raise ValueError(f"j = {checks.shown(j)}: the map has one axis")
        sized = zip("ij", (i, j), self.shape, strict=False)
        index = [checks.integer(name, k, -size, size - 1) for name, k, size in sized]
        return self.cells[int(np.ravel_multi_index(index, self.shape, mode="wrap"))]

    def __repr__(self) -> str:
        pairs = zip(self.axes, self.values, strict=True)
        axes = " x ".join(f"{name} ({len(values)})" for name, values in pairs)
        parts = [f"{int((self.status == 'at_rest').sum())} of {self.status.size} at rest"]
        parts += [f"{int(self.stable.sum())} stable"]
        if self.branch.max() > 0:
            parts += [f"{int(self.branch.max()) + 1} branches"]
        for name in np.unique(self.status[self.status != "at_rest"]).tolist():
            parts += [f"{name.replace('_', ' ')} {int((self.status == name).sum())}"]
        return f"<EquilibriumMap {axes}: {', '.join(parts)}>"

    def _tables(self) -> Iterator[ShownTable]:
        """The place of the object in each cell; a map has too many cells for whole equilibria."""
        columns = [f"{name} [{unit}]" for name, unit in zip(self.axes, self.units, strict=True)]
        columns += ["status", "x [m]", "y [m]", "theta [rad]", "stable"]
        rows = []
        for k in np.ndindex(self.shape):
            place = [values[i] for values, i in zip(self.values, k, strict=True)]
            rows.append((*place, str(self.status[k]), *self.q[k][:3], self.stable[k]))
        yield ShownTable(tuple(columns), rows, f"{len(rows)} cells", folded=True)

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
        """Writes the map as .csv, with a row for each cell, or as .npz with `to_dict()`."""
        header = [f"{name} [{unit}]" for name, unit in zip(self.axes, self.units, strict=True)]
        for names, plain in _ENTRIES.values():
            own = [of_column(n, u, jaws(self.scene)) for n, u in zip(names, plain, strict=True)]
            header += [f"{n} [{u}]" if u else n for n, u in zip(names, own, strict=True)]

        def row(index: tuple[int, ...]) -> list[Any]:
            found = [float(v[k]) for v, k in zip(self.values, index, strict=True)]
            for name in _ENTRIES:
                found += np.ravel(getattr(self, name)[index]).tolist()
            return found

        rows = (row(index) for index in np.ndindex(self.shape))
        return save_map(path, header, rows, self.to_dict(), self.provenance())


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
    jump to other equilibria at a fold. What no neighbour reaches is searched anew, and is another
    `branch`. Cells without an equilibrium have the reason that `equilibrium` gives.

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
        progress: As for `monte_carlo`; it counts cells, and the pairs of neighbours that are
            compared for `seams`.

    Raises:
        ValueError: A path does not lead to one number, or has no effect on where the scene rests;
            values do not increase or break the rule of their field; or grip and shear are mixed.
            All are found before anything is computed.
    """
    search = _Search(scene, axes, time, grip, shear)
    cells = search.run(progress)

    def array(name: str) -> NDArray[Any]:
        found = np.array([getattr(cell, name) for cell in cells])
        return found.reshape(search.shape + found.shape[1:])

    q = np.array([np.full(9, np.nan) if cell.state is None else cell.state.q for cell in cells])
    return EquilibriumMap(
        axes=search.names,
        units=search.units,
        values=search.values,
        branch=search.branch,
        seams=search.seams,
        q=q.reshape(*search.shape, 9),
        scene=scene,
        cells=tuple(cells),
        **{name: array(name) for name in _ENTRIES if name not in ("branch", "q")},
    )


class _Search:
    """Checks the arguments of `equilibrium_map`, solves all cells, and finds branches and seams."""

    def __init__(
        self,
        scene: Scene,
        axes: Mapping[str, ArrayLike],
        time: float | None,
        grip: ArrayLike | None,
        shear: ArrayLike | None,
    ) -> None:
        checks.instance("scene", scene, Scene)
        require_known_torque(scene.law, "equilibrium_map")
        checks.instance("axes", axes, Mapping, "a mapping of names to values")
        if not 1 <= len(axes) <= 2:
            raise ValueError(f"axes has {len(axes)} entries: must have one or two")
        for name in axes:
            checks.instance("axes", name, str, "a mapping of texts to values")
        self.scene = scene
        self.time = None if time is None else checks.finite("time", time)
        self.names = tuple(axes)
        self.values = tuple(checks.increasing(f"axes[{checks.shown(k)}]", axes[k]) for k in axes)
        self.shape = tuple(len(values) for values in self.values)
        if int(np.prod(self.shape)) > _MOST:
            raise ValueError(f"axes: the map has {np.prod(self.shape)} cells: at most {_MOST}")
        self.kind, self._base = self._member(grip, shear)
        paths = [name for name in axes if name not in FAMILY]
        for path in paths:
            if path.split(".")[0] in _WITHOUT_EFFECT:
                raise ValueError(f"axes: {path!r} has no effect on where the scene rests")
        others = f"; or one of {checks.quoted(FAMILY)}"
        with checks.reworded("axes: ", others, drop="vary: ", kind=ValueError):
            self._template = SceneTemplate(scene, paths, 0)
        self._template.require_numbers("axes")
        self.units = tuple("m" if k in FAMILY else str(units(k, (), jaws(scene))) for k in axes)
        self.branch = np.full(self.shape, -1, dtype=np.int64)
        self.seams: Integers = np.empty((0, 2, len(self.shape)), dtype=np.int64)
        self._found: dict[Cell, Any] = {}
        self._reached_from: dict[Cell, Cell] = {}
        # All scenes are made first, so that bad values are refused before any search.
        self._scenes = {cell: self._scene_at(cell) for cell in np.ndindex(self.shape)}
        self._rests = {cell: rest_scene(s, self._time(s)) for cell, s in self._scenes.items()}

    def _member(self, grip: ArrayLike | None, shear: ArrayLike | None) -> tuple[str, Floats]:
        """The kind of the members, and the numbers that no axis sets."""
        given = {"grip": grip, "shear": shear}
        kinds = {kind for kind, numbers in given.items() if numbers is not None}
        kinds |= {FAMILY[name][0] for name in self.names if name in FAMILY}
        if len(kinds) > 1:
            rule = "give one of them, each chooses the member of the family"
            raise ValueError(f"grip and shear: {rule}")
        tips = [tip for name in self.names if name in FAMILY for tip in FAMILY[name][1]]
        if len(tips) > len(set(tips)):
            raise ValueError(f"axes: {checks.quoted(self.names)} set the same number")
        kind = next(iter(kinds), "grip")
        numbers = given[kind]
        if numbers is not None and len(tips) == 2:
            raise ValueError(f"{kind} = {checks.shown(numbers)}: the axes set it already")
        return kind, np.zeros(2) if numbers is None else checks.array(kind, numbers, (2,))

    def _scene_at(self, cell: Cell) -> Scene:
        """The scene of a cell; an error names axis, value and rule."""
        numbers = {n: float(v[k]) for n, v, k in zip(self.names, self.values, cell, strict=True)}
        own = {name: number for name, number in numbers.items() if name not in FAMILY}
        where = ", ".join(f"{name} = {number:.6g}" for name, number in own.items())
        with checks.reworded(f"axes: {where}: "):
            return self._template.changed(own) if own else self.scene

    def _member_at(self, cell: Cell) -> Floats:
        """The grips or shears of a cell (2,), m."""
        numbers = self._base.copy()
        for name, values, k in zip(self.names, self.values, cell, strict=True):
            if name in FAMILY:
                numbers[list(FAMILY[name][1])] = values[k]
        return numbers

    def _by_distance(self) -> list[Cell]:
        """All cells, those nearest to the scene's own values first, by shares of the axes."""
        shares = []
        for name, values in zip(self.names, self.values, strict=True):
            own = self._base[FAMILY[name][1][0]] if name in FAMILY else resolve(self.scene, name)
            shares.append((values - float(own)) / (float(values[-1] - values[0]) or 1.0))
        away = np.square(np.meshgrid(*shares, indexing="ij")).sum(axis=0)
        order = np.argsort(away, axis=None, kind="stable")
        return list(zip(*(k.tolist() for k in np.unravel_index(order, self.shape)), strict=True))

    def _time(self, scene: Scene) -> float:
        return last_instant(scene) if self.time is None else self.time

    def run(self, progress: bool | Report) -> list[Equilibrium]:
        """Solves all cells, finds the seams, and returns the cells row by row."""
        count = 0
        with reporting(progress, "equilibria") as report:
            report(0, self._steps())
            for cell in self._by_distance():
                if self.branch[cell] < 0:
                    member = self._member_at(cell)
                    self._found[cell] = self._rests[cell].equilibrium(self.kind, member, None)
                    if self._found[cell]["status"] == "at_rest":
                        self._continue_branch(cell, count, report)
                        count += 1
                    report(len(self._found), self._steps())
            self._compare_neighbours(report)
        return [
            from_core(scene, self._time(scene), self._found[cell], self.kind, self._member_at(cell))
            for cell, scene in self._scenes.items()
        ]

    def _continue_branch(self, first: Cell, number: int, report: Report) -> None:
        """Continues a new branch from its first cell to all cells without one that it reaches."""
        self.branch[first] = number
        queue = deque([first])
        while queue:
            cell = queue.popleft()
            for other in self._neighbours(cell):
                if self.branch[other] >= 0:
                    continue
                found = self._continued(cell, other)
                if found["status"] == "at_rest":
                    self._found[other], self._reached_from[other] = found, cell
                    self.branch[other] = number
                    queue.append(other)
                    report(len(self._found), self._steps())

    def _steps(self) -> int:
        """The largest number of steps: cells, and pairs of neighbours that may have a seam."""
        return 1 + sum(self.branch.size // size * (size - 1) for size in self.shape)

    def _neighbours(self, cell: Cell) -> Iterator[Cell]:
        for axis, size in enumerate(self.shape):
            for k in (cell[axis] - 1, cell[axis] + 1):
                if 0 <= k < size:
                    yield (*cell[:axis], k, *cell[axis + 1 :])

    def _continued(self, cell: Cell, other: Cell) -> Any:
        """The equilibrium of another cell that continues the one of this cell."""
        to, begin = self._member_at(other), self._member_at(cell)
        rest, q = self._rests[cell], self._found[cell]["q"]
        return self._rests[other].continued(self.kind, to, rest, begin, q)

    def _compare_neighbours(self, report: Report) -> None:
        pairs, done = [], len(self._found)
        for cell in np.ndindex(self.shape):
            for other in self._neighbours(cell):
                before = self._reached_from
                known = before.get(cell) == other or before.get(other) == cell
                apart = self.branch[cell] != self.branch[other]
                if other < cell or known or apart or self.branch[cell] < 0:
                    continue
                found, away = self._continued(cell, other), np.inf
                if found["status"] == "at_rest":
                    radius = min(tip.radius for tip in self._scenes[other].hand.tips)
                    size = np.array([radius, radius, 1.0, 1.0, 1.0, *[radius] * 4])
                    away = np.abs((found["q"] - self._found[other]["q"]) / size).max()
                if not away < _SAME:
                    pairs.append((cell, other))
                done += 1
                report(done, self._steps())
        self.seams = np.array(pairs, dtype=np.int64).reshape(-1, 2, len(self.shape))
        if done < self._steps():
            report(self._steps(), self._steps())
