"""Dotted paths into a scene: reading the value at a path, and replacing values.

A path consists of field names, the sides `right` and `left`, and indices of disturbances and
arrays. It ends at a number, a pair or an array: "grasped.mass", "hand.tip.left.radius",
"control.kp", "disturbances.0.force", "schedule.angles.1.0". A record that both fingers share
changes for both, unless the path names a side; then the record is split into a pair. So does the
number "friction", which both contacts share, by "friction.right" and "friction.left"; "friction"
is always one number, which both contacts take.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ..support import checks, suggest
from ..support.record import SIDES, Record
from .control import WRITTEN
from .sampled_control import SampledController
from .symbols import spelt_out

# Numeric fields that cannot be varied, because they are no physical quantities.
_COUNTS = {"grid", "linearized", "controller", "seed", "run"}
# The field that holds either one number for both contacts or a pair (right, left), as path steps.
_FRICTION = ["friction"]
# The same of records for both fingers.
_SIDED = (["hand", "tip"], ["control"], _FRICTION)


def shared_fields(scene: Record) -> Sequence[list[str]]:
    """Returns the fields of this scene that both fingers share, or that are pairs."""
    one = isinstance(getattr(scene, "control", None), SampledController)
    return [steps for steps in _SIDED if not (one and steps == ["control"])]


def shapes_of(scene: Record, paths: Iterable[str]) -> dict[str, tuple[int, ...]]:
    """Checks paths to numbers, and returns the shape of the value at each.

    Raises:
        ValueError: A path does not exist or its value is not numeric; two paths set the same
            number; or a path leads to gains that the scene has not.
        TypeError: A path is not text.
    """
    paths = list(paths)
    for path in paths:
        require_gains(scene, path)
    shapes = {path: np.shape(resolve(scene, path)) for path in paths}
    refuse_overlaps(list(shapes))
    return shapes


def require_gains(scene: Any, path: str) -> None:
    """Refuses a path into the control of a scene whose fingers need no gains."""
    below = isinstance(path, str) and path.startswith("control.")
    if below and scene.law not in ("pid", "sampled"):
        raise ValueError(f"vary: {path!r}: with {WRITTEN[scene.law]} there is no PID")


def resolve(scene: Record, path: str) -> Any:
    """Returns the value at a path, or 0.0 for an optional number that is None.

    The value at "friction", which is always one number, is that of the right contact.

    Raises:
        ValueError: The path does not exist, its value is not numeric, or it leads into a record
            inside a disturbance.
        TypeError: The path is not text.
    """
    node, where = locate(scene, path)
    shown = checks.shown(path)
    steps = path.split(".")
    if where.startswith("State.contact"):
        raise ValueError(
            f"vary: {shown}: the modes of contacts, {where}, are shared by all runs; "
            "without them they follow from each run's own initial.q and initial.p"
        )
    if steps == _FRICTION and isinstance(node, tuple):
        node = node[0]
    optional = ("normal_mass", "tangential_mass", "friction", "height", "duration")
    if node is None and (steps[-1] in optional or steps[:-1] == _FRICTION):
        return 0.0
    number = isinstance(node, float | np.floating) or (
        isinstance(node, tuple | np.ndarray)
        and len(node) > 0
        and all(isinstance(item, float | np.floating | np.ndarray) for item in node)
    )
    if not number or _COUNTS & set(steps):
        raise ValueError(f"vary: {shown}: {where} is not a number, a pair or an array of numbers")
    if steps[0] == "disturbances" and not all(step.isdecimal() for step in steps[3:]):
        raise ValueError(
            f"vary: {shown}: only a disturbance's own fields can differ between runs, not those "
            "of records inside it"
        )
    return node


def locate(scene: Record, path: str) -> tuple[Any, str]:
    """Returns whatever is at a path, also records and text, and its place for error messages.

    Raises:
        ValueError: The path does not exist.
        TypeError: The path is not text.
    """
    if not isinstance(path, str):
        raise TypeError(f'vary: {checks.shown(path)}: must be a path such as "grasped.mass"')
    shown = checks.shown(path)
    node: Any = scene
    where = "Scene"
    steps = path.split(".")
    for k, name in enumerate(steps):
        sided = steps[:k] in shared_fields(scene)
        if isinstance(node, Record):
            names = [f.name for f in fields(node)]
            if sided and name in SIDES:
                where = f"{where}.{name}"  # one record of both fingers
                continue
            if name not in names:
                raise ValueError(
                    f"vary: {shown}: {where} has no field {checks.shown(name)}; it has "
                    f"{checks.quoted(names)}{_hint(scene, path)}"
                )
            node, where = getattr(node, name), type(node).__name__ + "." + name
        elif sided and name in SIDES and not isinstance(node, tuple):
            where = f"{where}.{name}"  # one number of both contacts
        elif sided and name in SIDES:
            node, where = node[SIDES.index(name)], f"{where}.{name}"
        elif sided and isinstance(node, tuple):
            raise ValueError(
                f"vary: {shown}: {where} is a pair; it has {checks.quoted(SIDES)}, not "
                f"{checks.shown(name)}{_hint(scene, path)}"
            )
        elif isinstance(node, tuple | np.ndarray) and name in map(str, range(len(node))):
            node, where = node[int(name)], f"{where}.{name}"
        elif isinstance(node, tuple | np.ndarray):
            raise ValueError(f"vary: {shown}: {where} {_without(len(node), name)}")
        else:
            start = "; give it a State, such as scene.start()" if where == "Scene.initial" else ""
            raise ValueError(f"vary: {shown}: {where} = {checks.shown(node)} has no parts{start}")
    return node, where


def _hint(scene: Record, path: str) -> str:
    """Returns '; did you mean "hand.tip.youngs_modulus"?' for "hand.tip.E" and what is misspelt."""
    meant = spelt_out(path)
    for other in meant:
        with suppress(ValueError):
            locate(scene, other)
            return f'; did you mean "{other}"?'
    return suggest.hint(meant[-1] if meant else path, scene)


def _without(entries: int, name: str) -> str:
    """Describes the valid indices of a sequence, for an error about the missing entry `name`."""
    asked = checks.shown(name)
    if entries == 0:
        return f"is empty, so there is no {asked}"
    return f"has {'one entry, 0' if entries == 1 else f'0 to {entries - 1}'}, not {asked}"


def at_path(scene: Record, path: str) -> list[Any]:
    """Returns the values at a path as a list, which has one entry or one for each side.

    "friction", or a path into `hand.tip` or `control` that names no side, gives two values (right,
    left), because another path may have split the shared number or record into a pair.

    Raises:
        ValueError: The path does not exist, or its value is not numeric.
    """
    steps = path.split(".")
    for sided in shared_fields(scene):
        rest = steps[len(sided) :]
        inside = rest or steps == _FRICTION
        if steps[: len(sided)] == sided and inside and not set(rest[:1]) & set(SIDES):
            return [resolve(scene, ".".join([*sided, side, *rest])) for side in SIDES]
    return [resolve(scene, path)]


def tree_of_numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Converts path -> number or array to a tree (`tree_of`) of floats and arrays."""
    arrays = {path: np.asarray(value) for path, value in values.items()}
    return tree_of({path: one if one.ndim else float(one) for path, one in arrays.items()})


def tree_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Converts path -> value to nested dictionaries, one level for each step of the path."""
    tree: dict[str, Any] = {}
    for path, value in values.items():
        *branches, leaf = path.split(".")
        node = tree
        for name in branches:
            node = node.setdefault(name, {})
        node[leaf] = value
    return tree


def replaced(node: Any, tree: Any) -> Any:
    """Returns a copy of `node` with new values.

    The values of one record are replaced together, because some rules relate several fields. What
    both fingers share stays shared if a value for one side changes nothing.

    Args:
        node: A record, a pair, an array or a single value.
        tree: Name or index -> the tree of that child; or the new value itself.
    """
    if not isinstance(tree, dict):
        return tree
    if isinstance(node, Record):
        known = {f.name for f in fields(node)}
        own = {name: replaced(getattr(node, name), tree[name]) for name in tree if name in known}
        record = replace(node, **own)
        if own.keys() == tree.keys():
            return record
        # The tree names sides, so split the shared record into a pair.
        pair = tuple(replaced(record, tree.get(side, {})) for side in SIDES)
        return record if pair == (record, record) else pair
    if isinstance(node, np.ndarray):
        changed = node.copy()
        for name, branch in tree.items():
            changed[int(name)] = replaced(node[int(name)], branch)
        return changed
    if not isinstance(node, tuple):
        # One coefficient of friction, which becomes a pair; None does not limit the friction.
        one = np.inf if node is None else node
        pair = replaced((one, one), tree)
        return node if pair == (one, one) else pair
    inside = {SIDES.index(k) if k in SIDES else int(k): branch for k, branch in tree.items()}
    return tuple(
        replaced(item, inside.get(k, {})) if k in inside else item for k, item in enumerate(node)
    )


def refuse_overlaps(paths: Sequence[str]) -> None:
    """Refuses two paths to the same number, in time linear in the number of paths."""

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
