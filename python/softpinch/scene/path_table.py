"""`PathTable`, the paths of a scene that can be varied, with their values and units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, TypeAlias

import numpy as np

from ..support.display import Shown
from ..support.record import SIDES, Record
from .paths import locate, shapes_of, shared_fields
from .units import units

Unit: TypeAlias = str | tuple[str, ...]

# Entries of larger arrays have paths too, which are not listed.
_MOST_ENTRIES = 32
# An array with more numbers is printed as its shape.
_SHOWN = 4


class PathTable(Shown, Mapping[str, tuple[Any, Unit]]):
    """Path -> (value, unit). It prints as a table with one line for each path."""

    def __init__(self, entries: Mapping[str, tuple[Any, Unit]], scene: Record) -> None:
        """Keeps a copy of the entries, and the scene that has them, for its errors."""
        self._entries = dict(entries)
        self._scene = scene

    def __getitem__(self, path: str) -> tuple[Any, Unit]:
        """Returns the value at a path, and its unit.

        Raises:
            KeyError: The table does not have the path; the message suggests the closest.
        """
        if path in self._entries:
            return self._entries[path]
        why = f"{path}: can be varied, but is not listed; its parts or the whole are"
        try:
            shapes_of(self._scene, [path])
        except (TypeError, ValueError) as error:
            why = str(error).removeprefix("vary: ")
        # A KeyError is printed as a quoted text, in which single quotes would need backslashes.
        raise KeyError(why.replace("'", '"'))

    def __contains__(self, path: object) -> bool:
        """Whether the table has a path."""
        return path in self._entries

    def __iter__(self) -> Iterator[str]:
        """Iterates over the paths, in the order of the scene's fields."""
        return iter(self._entries)

    def __len__(self) -> int:
        """Returns the number of paths."""
        return len(self._entries)

    def __repr__(self) -> str:
        """Returns the table as text."""
        rows = [(path, _shown(value), _joined(unit)) for path, (value, unit) in self.items()]
        rows.insert(0, ("path", "value", "unit"))
        first, second = (max(len(row[k]) for row in rows) for k in (0, 1))
        return "\n".join(f"{a:<{first}}  {b:>{second}}  {c}".rstrip() for a, b, c in rows)


def paths_of(scene: Record) -> PathTable:
    """Lists the paths of a scene that `vary` accepts; see `Scene.vary_paths`."""
    found: dict[str, tuple[Any, Unit]] = {}
    for path in _below(scene, scene, ""):
        value, _ = locate(scene, path)
        if path == "friction" and isinstance(value, tuple):
            continue  # a study would give both contacts one number; each has a path of its own
        try:
            shape = shapes_of(scene, [path])[path]
        except ValueError:
            continue  # names of choices, whole records, and what all runs share
        found[path] = value, _unit(scene, path, shape)
    return PathTable(found, scene)


def _below(scene: Record, node: Any, path: str) -> Iterator[str]:
    """Yields the paths of a value and of all its parts, whether or not they lead to numbers."""
    if path:
        yield path
    parts: dict[str, Any] = {}
    shared = path.split(".") in shared_fields(scene)
    if isinstance(node, Record):
        parts = {f.name: getattr(node, f.name) for f in fields(node)}
    elif _is_short(node) and not shared:
        parts = {str(k): item for k, item in enumerate(node)}
    if shared:
        pair = node if isinstance(node, tuple) else (node, node)
        parts |= dict(zip(SIDES, pair, strict=True))
    for name, part in parts.items():
        yield from _below(scene, part, f"{path}.{name}" if path else name)


def _is_short(node: Any) -> bool:
    """Whether a value is a sequence whose entries are listed: records, or a few numbers."""
    if isinstance(node, tuple):
        return any(isinstance(item, Record) for item in node) or len(node) <= _MOST_ENTRIES
    return isinstance(node, np.ndarray) and node.size <= _MOST_ENTRIES


def _unit(scene: Any, path: str, shape: tuple[int, ...]) -> Unit:
    if path.startswith("schedule.angles") and not scene.schedules_angles:
        # A controller of one's own may use the schedule for any quantity.
        return "N m" if scene.law == "torque" else "unknown"
    return units(path, shape)


def _shown(value: Any) -> str:
    if isinstance(value, tuple | np.ndarray):
        array = np.asarray(value)
        if array.ndim > 1 or array.size > _SHOWN:
            return f"array {array.shape}"
        return f"({', '.join(_shown(item) for item in value)})"
    return "None" if value is None else f"{value:.6g}"


def _joined(unit: Unit) -> str:
    return unit if isinstance(unit, str) else ", ".join(dict.fromkeys(unit))
