"""How the cells of an equilibrium map are solved: each from a neighbour, by continuation."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..scene import units
from ..scene.control import require_known_torque
from ..scene.paths import resolve
from ..scene.scene import Scene
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Floats
from ..support.progress import Report, reporting
from .rest import Equilibrium, described, last_instant

Cell = tuple[int, ...]

# Name of an axis along the family -> kind of the member, and the tips whose number it is.
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


class Plan:
    """The checked arguments of `equilibrium_map`, and the scene and the member of each cell.

    Attributes:
        names: The names of the axes.
        values: The values of each axis.
        units: The unit of each axis.
        shape: The number of values of each axis.
        kind: The kind of the members, "grip" or "shear".
    """

    def __init__(
        self,
        scene: Scene,
        axes: Mapping[str, ArrayLike],
        *,
        time: float | None,
        grip: ArrayLike | None,
        shear: ArrayLike | None,
    ) -> None:
        """Checks the arguments; errors are those of `equilibrium_map`."""
        checks.instance("scene", scene, Scene)
        require_known_torque(scene.law, "equilibrium_map")
        checks.instance("axes", axes, Mapping, "a mapping of names to values")
        if not 1 <= len(axes) <= 2:
            raise ValueError(f"axes has {len(axes)} entries: must have one or two")
        for name in axes:
            if not isinstance(name, str):
                raise TypeError(f"axes: {checks.shown(name)}: names must be text")
        self.scene = scene
        self.time = None if time is None else checks.finite("time", time)
        self.names = tuple(axes)
        self.values = tuple(
            checks.increasing(f"axes[{checks.shown(name)}]", axes[name]) for name in axes
        )
        self.shape = tuple(len(values) for values in self.values)
        if int(np.prod(self.shape)) > _MOST:
            raise ValueError(f"axes: the map has {np.prod(self.shape)} cells: at most {_MOST}")
        self.kind, self._base = self._member(grip, shear)
        self._template = self._vary([name for name in axes if name not in FAMILY])
        self.units = tuple(self._unit(name) for name in self.names)

    def _member(self, grip: ArrayLike | None, shear: ArrayLike | None) -> tuple[str, Floats]:
        """The kind of the members, and the numbers that no axis sets."""
        given = {"grip": grip, "shear": shear}
        kinds = {kind for kind, numbers in given.items() if numbers is not None}
        kinds |= {FAMILY[name][0] for name in self.names if name in FAMILY}
        if len(kinds) > 1:
            raise ValueError(
                "grip and shear: give one of them, each chooses the member of the family"
            )
        tips = [tip for name in self.names if name in FAMILY for tip in FAMILY[name][1]]
        if len(tips) > len(set(tips)):
            raise ValueError(f"axes: {checks.quoted(self.names)} set the same number")
        kind = next(iter(kinds), "grip")
        numbers = given[kind]
        if numbers is not None and len(tips) == 2:
            raise ValueError(f"{kind} = {checks.shown(numbers)}: the axes set it already")
        return kind, np.zeros(2) if numbers is None else checks.array(kind, numbers, (2,))

    def _vary(self, paths: list[str]) -> SceneTemplate:
        """The scene with the numbers at these paths left open."""
        for path in paths:
            if path.split(".")[0] in _WITHOUT_EFFECT:
                raise ValueError(
                    f"axes: {checks.shown(path)} has no effect on where the scene rests"
                )
            if path.split(".")[0] in ("grip", "shear"):
                raise ValueError(
                    f"axes: {checks.shown(path)}: must be one of {checks.quoted(FAMILY)}"
                )
        try:
            template = SceneTemplate(self.scene, paths, 0)
        except (TypeError, ValueError) as error:
            text = str(error).removeprefix("vary: ")
            raise ValueError(f"axes: {text}; or one of {checks.quoted(FAMILY)}") from None
        for path, shape in template.shapes.items():
            if shape:
                raise ValueError(
                    f"axes: {checks.shown(path)}: must lead to one number, not to an array "
                    f"of shape {shape}"
                )
        return template

    def _unit(self, name: str) -> str:
        unit = "m" if name in FAMILY else units.units(name, ())
        assert isinstance(unit, str)
        return unit

    def scene_at(self, cell: Cell) -> Scene:
        """The scene of a cell.

        Raises:
            ValueError: A value breaks its rule; the message names axis, value and rule.
        """
        numbers = {n: float(v[k]) for n, v, k in zip(self.names, self.values, cell, strict=True)}
        own = {name: number for name, number in numbers.items() if name not in FAMILY}
        if not own:
            return self.scene
        try:
            return self._template.changed(own)
        except ValueError as error:
            where = ", ".join(f"{name} = {number:.6g}" for name, number in own.items())
            raise ValueError(f"axes: {where}: {error}") from None

    def member_at(self, cell: Cell) -> Floats:
        """The grips or shears of a cell (2,), m."""
        numbers = self._base.copy()
        for name, values, k in zip(self.names, self.values, cell, strict=True):
            if name in FAMILY:
                numbers[list(FAMILY[name][1])] = values[k]
        return numbers

    def by_distance(self) -> list[Cell]:
        """All cells, those nearest to the scene's own values first, by shares of the axes."""
        away: NDArray[np.float64] = np.zeros(self.shape)
        for axis, (name, values) in enumerate(zip(self.names, self.values, strict=True)):
            own = self._base[FAMILY[name][1][0]] if name in FAMILY else resolve(self.scene, name)
            share = (values - float(own)) / max(float(values[-1] - values[0]), np.finfo(float).tiny)
            one = np.ones(len(self.shape), dtype=np.intp)
            one[axis] = len(values)
            away = away + np.reshape(share, one) ** 2
        order = np.argsort(away, axis=None, kind="stable")
        return [tuple(int(k) for k in np.unravel_index(n, self.shape)) for n in order]


class Search:
    """Solves the cells of a plan.

    Attributes:
        plan: The plan.
        branch: The branch of each cell, -1 without one.
        seams: Pairs of neighbours of one branch that do not continue each other (k, 2, axes).
    """

    def __init__(self, plan: Plan) -> None:
        """Makes the scene of every cell, so that bad values are found first."""
        self.plan = plan
        self.branch = np.full(plan.shape, -1, dtype=np.int64)
        self.seams: NDArray[np.int64] = np.empty((0, 2, len(plan.shape)), dtype=np.int64)
        self._found: dict[Cell, Any] = {}
        self._reached_from: dict[Cell, Cell] = {}
        self._scenes: dict[Cell, Scene] = {}
        self._times: dict[Cell, float] = {}
        self._rests: dict[Cell, _core.RestScene] = {}
        for cell in np.ndindex(plan.shape):
            scene = plan.scene_at(cell)
            time = last_instant(scene) if plan.time is None else plan.time
            self._scenes[cell], self._times[cell] = scene, time
            self._rests[cell] = _core.RestScene(scene.parameters(), scene.inputs(), time)

    def run(self, progress: bool | Report) -> list[Equilibrium]:
        """Solves all cells, finds the seams, and returns the cells row by row."""
        count = 0
        with reporting(progress, "equilibria") as report:
            report(0, self._steps())
            for cell in self.plan.by_distance():
                if self.branch[cell] < 0:
                    kind, member = self.plan.kind, self.plan.member_at(cell)
                    self._found[cell] = self._rests[cell].equilibrium(kind, member, None)
                    if self._found[cell]["status"] == "at_rest":
                        self._spread(cell, count, report)
                        count += 1
                    report(len(self._found), self._steps())
            self._compare_neighbours(report)
        return [
            described(self._scenes[cell], self._times[cell], self._found[cell])
            for cell in np.ndindex(self.plan.shape)
        ]

    def _spread(self, first: Cell, number: int, report: Report) -> None:
        """Continues a new branch from its first cell to all cells without one that it reaches."""
        self.branch[first] = number
        queue = deque([first])
        while queue:
            cell = queue.popleft()
            for other in self._beside(cell):
                if self.branch[other] >= 0:
                    continue
                found = self._continued(cell, other)
                if found["status"] == "at_rest":
                    self._found[other], self._reached_from[other] = found, cell
                    self.branch[other] = number
                    queue.append(other)
                    report(len(self._found), self._steps())

    def _steps(self) -> int:
        """The largest number of steps: cells, and pairs of neighbours that may have a seam.

        A branch of n cells is a tree of n - 1 pairs that continue each other. If one branch has all
        cells, the other pairs are all to be compared; with more branches they are fewer.
        """
        return 1 + sum(self.branch.size // size * (size - 1) for size in self.plan.shape)

    def _beside(self, cell: Cell) -> Iterator[Cell]:
        """The neighbours of a cell."""
        for axis, size in enumerate(self.plan.shape):
            for k in (cell[axis] - 1, cell[axis] + 1):
                if 0 <= k < size:
                    yield (*cell[:axis], k, *cell[axis + 1 :])

    def _continued(self, cell: Cell, other: Cell) -> Any:
        """The equilibrium of another cell that continues the one of this cell."""
        return self._rests[other].continued(
            self.plan.kind,
            self.plan.member_at(other),
            self._rests[cell],
            self.plan.member_at(cell),
            self._found[cell]["q"],
        )

    def _compare_neighbours(self, report: Report) -> None:
        """Finds the seams."""
        pairs, done = [], len(self._found)
        for cell in np.ndindex(self.plan.shape):
            for other in self._beside(cell):
                known = (
                    self._reached_from.get(cell) == other or self._reached_from.get(other) == cell
                )
                apart = self.branch[cell] != self.branch[other]
                if other < cell or known or apart or self.branch[cell] < 0:
                    continue
                if not self._continue_each_other(cell, other):
                    pairs.append((cell, other))
                done += 1
                report(done, self._steps())
        self.seams = np.array(pairs, dtype=np.int64).reshape(-1, 2, len(self.plan.shape))
        if done < self._steps():
            report(self._steps(), self._steps())

    def _continue_each_other(self, cell: Cell, other: Cell) -> bool:
        found = self._continued(cell, other)
        if found["status"] != "at_rest":
            return False
        radius = min(tip.radius for tip in self._scenes[other].hand.tips)
        size = np.array([radius, radius, 1.0, 1.0, 1.0, *[radius] * 4])
        away = np.abs(found["q"] - self._found[other]["q"]) / size
        return bool(away.max() < _SAME)
