"""Dotted paths into a scene: what is at one, and a scene with other numbers there.

A path leads from `Scene` through fields, `right` and `left` of pairs and indices of disturbances
and arrays to a number, a pair or an array: "grasped.mass", "hand.tip.left.radius", "control.kp",
"disturbances.0.force", "schedule.angles.1.0". A record that stands for both fingers is varied as
one, or, where the path says `right` or `left`, becomes a pair.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ..support import checks, suggest
from ..support.record import SIDES, Record

# Fields whose numbers are no quantities.
_COUNTS = {"grid", "linearized", "seed", "run"}
# Where one record may stand for both fingers, or a pair for each.
_SIDED = (["hand", "tip"], ["control"])


def resolve(scene: Record, path: str) -> Any:
    """What is at a path, a number where None stands for one.

    Raises:
        ValueError: It leads nowhere, or to no number.
    """
    if not isinstance(path, str):
        raise TypeError(f'vary: {checks.shown(path)}: must be a path such as "grasped.mass"')
    shown = checks.shown(path)
    node: Any = scene
    where = "Scene"
    steps = path.split(".")
    for k, name in enumerate(steps):
        sided = steps[:k] in _SIDED
        if isinstance(node, Record):
            names = [f.name for f in fields(node)]
            if sided and name in SIDES and k + 1 < len(steps):
                continue
            if name not in names:
                hint = suggest.hint(path, scene)
                raise ValueError(
                    f"vary: {shown}: {where} has no field {checks.shown(name)}; it has "
                    f"{checks.quoted(names)}{hint}"
                )
            node, where = getattr(node, name), type(node).__name__ + "." + name
            if name in _COUNTS:
                node = "no quantity"
        elif sided and name in SIDES:
            node, where = node[SIDES.index(name)], f"{where}.{name}"
        elif sided:
            raise ValueError(
                f"vary: {shown}: {where} is a pair; it has {checks.quoted(SIDES)}, not "
                f"{checks.shown(name)}{suggest.hint(path, scene)}"
            )
        elif isinstance(node, tuple | np.ndarray) and name in map(str, range(len(node))):
            node, where = node[int(name)], f"{where}.{name}"
        elif isinstance(node, tuple | np.ndarray):
            raise ValueError(f"vary: {shown}: {where} {_without(len(node), name)}")
        else:
            raise ValueError(f"vary: {shown}: {where} = {checks.shown(node)} has nothing inside")
    if node is None and name in ("normal_mass", "tangential_mass", "friction", "duration"):
        return 0.0
    number = isinstance(node, float | np.floating) or (
        isinstance(node, tuple | np.ndarray)
        and len(node) > 0
        and all(isinstance(item, float | np.floating | np.ndarray) for item in node)
    )
    if not number:
        raise ValueError(f"vary: {shown}: {where} is not a number, a pair or an array of numbers")
    if steps[0] == "disturbances" and not all(step.isdecimal() for step in steps[3:]):
        raise ValueError(
            f"vary: {shown}: only a disturbance's own fields can differ between runs, not those "
            "of records inside it"
        )
    return node


def _without(entries: int, name: str) -> str:
    """What a sequence has, where a path asks for an entry that it does not have."""
    asked = checks.shown(name)
    if entries == 0:
        return f"is empty, so there is no {asked}"
    return f"has {'one entry, 0' if entries == 1 else f'0 to {entries - 1}'}, not {asked}"


def at_path(scene: Record, path: str) -> list[Any]:
    """What a path leads to: two things where one record has become a pair since it was given.

    Raises:
        ValueError: It leads nowhere, or to no number.
    """
    steps = path.split(".")
    for sided in _SIDED:
        rest = steps[len(sided) :]
        if steps[: len(sided)] == sided and rest and rest[0] not in SIDES:
            return [resolve(scene, ".".join([*sided, side, *rest])) for side in SIDES]
    return [resolve(scene, path)]


def tree_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values by the names of their paths, level by level."""
    tree: dict[str, Any] = {}
    for path, value in values.items():
        *branches, leaf = path.split(".")
        node = tree
        for name in branches:
            node = node.setdefault(name, {})
        node[leaf] = np.asarray(value)
    return tree


def replaced(node: Any, tree: Any) -> Any:
    """`node` with numbers replaced, those of a record all at once: their rules hold together.

    Args:
        node: A record, a pair, an array or a number.
        tree: Name or index -> the same of what is there; or a number or an array.
    """
    if not isinstance(tree, dict):
        return tree if np.ndim(tree) else float(tree)
    if isinstance(node, Record):
        known = {f.name for f in fields(node)}
        own = {name: replaced(getattr(node, name), tree[name]) for name in tree if name in known}
        record = replace(node, **own)
        if own.keys() == tree.keys():
            return record
        # It stands for both sides, which differ from now on.
        return tuple(replaced(record, tree.get(side, {})) for side in SIDES)
    if isinstance(node, np.ndarray):
        changed = node.copy()
        for name, branch in tree.items():
            changed[int(name)] = replaced(node[int(name)], branch)
        return changed
    inside = {SIDES.index(k) if k in SIDES else int(k): branch for k, branch in tree.items()}
    return tuple(
        replaced(item, inside.get(k, {})) if k in inside else item for k, item in enumerate(node)
    )


def refuse_overlaps(paths: Sequence[str]) -> None:
    """Refuses two paths to the same number. The time grows with the paths, not with their pairs."""

    def plain(path: str) -> tuple[str, ...]:
        return tuple(name for name in path.split(".") if name not in SIDES)

    def side(path: str) -> set[str]:
        return set(path.split(".")) & set(SIDES)

    by_plain: dict[tuple[str, ...], list[str]] = {}
    for path in paths:
        by_plain.setdefault(plain(path), []).append(path)
    for path in paths:
        names = plain(path)
        for k in range(1, len(names) + 1):
            for other in by_plain.get(names[:k], ()):
                apart = side(path) and side(other) and side(path) != side(other)
                if other != path and not apart:
                    first, second = sorted((other, path), key=paths.index)
                    raise ValueError(f"vary: {first!r} and {second!r} set the same number")
