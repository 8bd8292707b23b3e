"""PLACEHOLDER (finite differences) of the derivatives of a run; the real one replaces this file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..scene.scene import Scene, State
from ..scene.template import SceneTemplate
from ..support.arrays import Floats


class Sensitivity(Mapping[str, Floats]):
    """The derivatives of a run: path -> (n, 18, ...), of q and p by the value at the path."""

    def __init__(self, of: Mapping[str, Mapping[str, Floats]]) -> None:
        """Takes the derivatives by quantity and path."""
        self._of = of

    def __getitem__(self, path: str) -> Floats:
        """Returns the derivatives of q and p by the value at a path, (n, 18, ...)."""
        return self._of["state"][path]

    def __iter__(self) -> Iterator[str]:
        """Iterates over the paths."""
        return iter(self._of["state"])

    def __len__(self) -> int:
        """Returns the number of paths."""
        return len(self._of["state"])

    @property
    def multipliers(self) -> Mapping[str, Floats]:
        """Path -> (n, 4, ...)."""
        return self._of["multipliers"]

    @property
    def torque(self) -> Mapping[str, Floats]:
        """Path -> (n, 2, ...)."""
        return self._of["torque"]

    @property
    def integral(self) -> Mapping[str, Floats]:
        """Path -> (n, 2, ...)."""
        return self._of["integral"]


def placeholder(scene: Scene, paths: tuple[str, ...], again: Any, record: tuple[str, ...]) -> Sensitivity:
    """Central differences."""
    if any(path.startswith("initial.") for path in paths) and not isinstance(scene.initial, State):
        scene = replace(scene, initial=replace(scene.start(), check=False))
    template = SceneTemplate(scene, paths, 0)
    found: dict[str, dict[str, Floats]] = {}
    for path, shape in template.shapes.items():
        from ..scene.paths import resolve

        value = np.asarray(resolve(scene, path), dtype=float)
        columns: dict[str, list[Floats]] = {}
        for index in np.ndindex(*shape):
            h = 1e-5 * max(abs(float(value[index])), 1e-2)
            runs = []
            for sign in (1, -1):
                moved = value.copy()
                moved[index] += sign * h
                runs.append(again(template.changed({path: moved if shape else float(moved)})))
            pairs = {"state": lambda r: np.hstack([r.q, r.p]), "integral": lambda r: r.integral}
            if "multipliers" in record:
                pairs["multipliers"] = lambda r: r.multipliers
            if "torque" in record:
                pairs["torque"] = lambda r: r.torque
            for name, of in pairs.items():
                n = min(len(runs[0]), len(runs[1]))
                slope = (of(runs[0])[:n] - of(runs[1])[:n]) / (2 * h)
                columns.setdefault(name, []).append(slope)
        for name, slopes in columns.items():
            stacked = np.stack(slopes, axis=-1)
            found.setdefault(name, {})[path] = stacked.reshape(*stacked.shape[:2], *shape)
    return Sensitivity(found)
