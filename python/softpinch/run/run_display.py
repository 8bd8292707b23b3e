"""What a run shows in a notebook: hand and object at three instants, and a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..scene.scene import Scene
from ..scene.svg import drawings
from ..support.arrays import Floats
from ..support.display import ShownTable


def run_picture(scene: Scene, t: Floats, q: Floats | None) -> str:
    """Drawings at the first, middle and last row, as SVG; without rows of q, of the start."""
    if q is None or not len(t):
        return scene._picture()
    rows = sorted({0, len(t) // 2, len(t) - 1} & set(np.flatnonzero(np.isfinite(q).all(axis=1))))
    return drawings(scene, [q[k] for k in rows], [f"t = {t[k]:.4g} s" for k in rows])


def run_tables(facts: Mapping[str, Any], violations: Mapping[str, float]) -> Iterator[ShownTable]:
    """The result of a run with counts of its work, and the first times of violations."""
    # Of counts that are zero, explicit methods have several.
    yield ShownTable(("", ""), [item for item in facts.items() if item[1] != 0 or item[1] is False])
    if violations:
        columns = ("violation", "first at [s]")
        yield ShownTable(columns, tuple(violations.items()))
