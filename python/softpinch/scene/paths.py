"""Dotted paths into a scene: reading, listing and replacing the values at them.

A path consists of field names, the sides `right` and `left`, and indices of disturbances and
arrays. It ends at a number, a pair or an array: "grasped.mass", "hand.tip.left.radius",
"control.kp", "disturbances.0.force", "schedule.angles.1.0". A record that both fingers share
changes for both, unless the path names a side; then the record is split into a pair. So does the
number "friction", which both contacts share, by "friction.right" and "friction.left"; "friction"
is always one number, which both contacts take.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..support import SIDES, Record, Shown, checks, suggest
from .control import WRITTEN, SampledController
from .fields import Unit, spelt_out, units
from .parts import jaws, why_fixed

if TYPE_CHECKING:
    from .scene import Scene

# Numeric fields that cannot be varied, because they are no physical quantities.
_COUNTS = {"grid", "linearized", "controller", "seed", "run"}
# Numbers that may be None.
_OPTIONAL = {"normal_mass", "tangential_mass", "friction", "height", "duration", "foot", "span"}
_OPTIONAL |= {"rate_limit", "no_load_rate"}
# The field that holds either one number for both contacts or a pair (right, left), as path steps.
_FRICTION = ["friction"]
# Fields that hold one value for both fingers or contacts, or a pair, as steps of paths.
_SIDED = (["hand", "tip"], ["control"], _FRICTION)
# Entries of larger arrays have paths too, which are not listed.
_MOST_ENTRIES = 32
# An array with more numbers is printed as its shape.
_SHOWN = 4


def shared_fields(scene: Scene) -> Sequence[list[str]]:
    """Returns the fields of this scene that both fingers share, or that are pairs."""
    one = isinstance(scene.control, SampledController)
    return [steps for steps in _SIDED if not (one and steps == ["control"])]


def shapes_of(scene: Scene, paths: Iterable[str]) -> dict[str, tuple[int, ...]]:
    """Checks paths to numbers, and returns the shape of the value at each."""
    paths = list(paths)
    for path in paths:
        require_gains(scene, path)
    shapes = {path: np.shape(resolve(scene, path)) for path in paths}
    refuse_overlaps(list(shapes))
    return shapes


def require_gains(scene: Scene, path: str) -> None:
    """Refuses a path into the control of a scene whose fingers need no gains."""
    below = isinstance(path, str) and path.startswith("control.")
    if below and scene.law not in ("pid", "sampled"):
        raise ValueError(f"vary: {path!r}: with {WRITTEN[scene.law]} there is no PID")


def resolve(scene: Scene, path: str) -> Any:
    """Returns the value at a path, or 0.0 for an optional number that is None."""
    node, where = locate(scene, path)
    steps = path.split(".")
    if where.startswith("State.contact"):
        modes = f"the modes of contacts, {where}, are shared by all runs"
        why = "without them they follow from each run's own initial.q and initial.p"
        raise ValueError(f"vary: {checks.shown(path)}: {modes}; {why}")
    if steps == _FRICTION and isinstance(node, tuple):
        node = node[0]
    if reason := why_fixed(scene, path):
        raise ValueError(f"vary: {checks.shown(path)}: {reason}")
    if node is None and (steps[-1] in _OPTIONAL or steps[:-1] == _FRICTION):
        return 0.0
    number = isinstance(node, float | np.floating) or (
        isinstance(node, tuple | np.ndarray)
        and len(node) > 0
        and all(isinstance(item, float | np.floating | np.ndarray) for item in node)
    )
    if not number or _COUNTS & set(steps):
        raise ValueError(
            f"vary: {checks.shown(path)}: {where} is not a number, a pair or an array of numbers"
        )
    if steps[0] == "disturbances" and not all(step.isdecimal() for step in steps[3:]):
        rule = "can differ between runs, not those of records inside it"
        raise ValueError(f"vary: {checks.shown(path)}: only a disturbance's own fields {rule}")
    return node


def locate(scene: Scene, path: str) -> tuple[Any, str]:
    """Returns the value at a path, also a record or a text, and its place for error messages."""
    if not isinstance(path, str):
        raise TypeError(f'vary: {checks.shown(path)}: must be a path such as "grasped.mass"')
    node: Any = scene
    where = "Scene"
    steps, pairs = path.split("."), shared_fields(scene)
    for k, name in enumerate(steps):
        sided = steps[:k] in pairs
        if sided and name in SIDES:
            # Otherwise one record of both fingers, or one number of both contacts.
            if isinstance(node, tuple):
                node = node[SIDES.index(name)]
            where = f"{where}.{name}"
        elif isinstance(node, Record):
            if name not in node.__dataclass_fields__:
                lacks = f"{checks.shown(path)}: {where} has no field {checks.shown(name)}"
                known = f"it has {checks.quoted([f.name for f in fields(node)])}"
                raise ValueError(f"vary: {lacks}; {known}{_hint(scene, path)}")
            node, where = getattr(node, name), type(node).__name__ + "." + name
        elif sided and isinstance(node, tuple):
            rule = f"it has {checks.quoted(SIDES)}, not {checks.shown(name)}{_hint(scene, path)}"
            raise ValueError(f"vary: {checks.shown(path)}: {where} is a pair; {rule}")
        elif isinstance(node, tuple | np.ndarray) and name in map(str, range(len(node))):
            node, where = node[int(name)], f"{where}.{name}"
        elif isinstance(node, tuple | np.ndarray):
            places = f"has 0 to {len(node) - 1}" if len(node) > 1 else "has one entry, 0"
            lacks = f"{places}, not" if len(node) else "is empty, so there is no"
            raise ValueError(f"vary: {checks.shown(path)}: {where} {lacks} {checks.shown(name)}")
        else:
            start = "; give it a State, such as scene.start()" if where == "Scene.initial" else ""
            raise ValueError(
                f"vary: {checks.shown(path)}: {where} = {checks.shown(node)} has no parts{start}"
            )
    return node, where


def _hint(scene: Scene, path: str) -> str:
    """Returns a suggestion for a path with a symbol, "hand.tip.E", or with a misspelt name."""
    meant = spelt_out(path)
    for other in meant:
        with suppress(ValueError):
            locate(scene, other)
            return f'; did you mean "{other}"?'
    return suggest.hint(meant[-1] if meant else path, scene)


def at_path(scene: Scene, path: str) -> list[Any]:
    """The value at a path, or both values (right, left) if another path may have split it."""
    steps = path.split(".")
    for sided in shared_fields(scene):
        rest = steps[len(sided) :]
        inside = rest or steps == _FRICTION
        if steps[: len(sided)] == sided and inside and not set(rest[:1]) & set(SIDES):
            return [resolve(scene, ".".join([*sided, side, *rest])) for side in SIDES]
    return [resolve(scene, path)]


def with_numbers(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Returns a copy of a scene with numbers or arrays at paths, which are known to exist."""
    return replaced(scene, tree_of_numbers(values))  # type: ignore[no-any-return]


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
    """Returns a copy of a record, pair, array or value with new values from a tree of paths."""
    if not isinstance(tree, dict):
        return tree
    if isinstance(node, Record):
        known = node.__dataclass_fields__
        own = {name: replaced(getattr(node, name), tree[name]) for name in tree if name in known}
        # All at once, because some rules relate several fields. A law takes a modulus's place.
        usual = {"youngs_modulus": known["youngs_modulus"].default} if own.get("law") else {}
        record = replace(node, **{**usual, **own})
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
    return tuple(replaced(one, inside[k]) if k in inside else one for k, one in enumerate(node))


def refuse_overlaps(paths: Sequence[str]) -> None:
    """Refuses two paths to the same number: equal paths, or one into the other."""
    # The steps of each path on each side; a path that names no side leads to both. A finger and a
    # side of the object are fields of their own.
    steps = [
        ([side, *(b for a, b in pairwise(parts) if b not in SIDES or a in ("hand", "grasped"))], k)
        for k, parts in enumerate(["", *path.split(".")] for path in paths)
        for side in {*SIDES}.intersection(parts) or SIDES
    ]
    # In sorted order a path comes just before those that lead into it.
    for (outer, k), (inner, m) in pairwise(sorted(steps)):
        if inner[: len(outer)] == outer:
            earlier, later = paths[min(k, m)], paths[max(k, m)]
            raise ValueError(f"vary: {earlier!r} and {later!r} set the same number")


def changed(scene: Scene, values: object, named: Mapping[str, object]) -> Scene:
    """Returns a copy of a scene with other values at dotted paths; see `Scene.with_`."""
    if named:
        written = ", ".join(f'"{name}": {checks.shown(value)}' for name, value in named.items())
        rule = f"must map paths to values, as in with_({{{written}}})"
        raise TypeError(f"with_: {next(iter(named))} is given by name: {rule}")
    if not isinstance(values, Mapping):
        rule = 'must map paths to values, such as {"grasped.mass": 0.2}'
        raise TypeError(f"with_: {checks.shown(values)}: {rule}")
    with checks.reworded("with_: ", drop="vary: "):
        for path in values:
            require_gains(scene, path)
        taken = {path: _taken(path, locate(scene, path)[0], values[path]) for path in values}
        refuse_overlaps(list(taken))
    found: Scene = replaced(scene, tree_of(taken))
    for path in (path for path in taken if path.startswith("grasped.")):
        if reason := why_fixed(found, path):
            raise ValueError(f"with_: {checks.shown(path)}: {reason}")
    return found


def _taken(path: str, old: Any, value: Any) -> Any:
    """Checks a value where the constructors of the records would not, and returns it."""
    if isinstance(value, Mapping):
        given = f"{checks.shown(path)} = {checks.shown(value)}"
        advice = 'the parts of a record have paths of their own, such as "grasped.mass"'
        raise TypeError(f"{given}: must be a value, not a mapping; {advice}")
    steps = path.split(".")
    if steps[0] == "friction" and len(steps) == 2 and value is None:
        return np.inf  # no limit, as None for both
    if steps[-1].isdecimal() and isinstance(old, float | np.ndarray):
        # NumPy would broadcast one number to a whole row of an array.
        numbers = checks.numbers(path, value)
        if numbers.shape != np.shape(old):
            rule = f"must have the shape {np.shape(old)}" if np.ndim(old) else "must be one number"
            raise ValueError(f"{checks.shown(path)} = {checks.shown(value)}: {rule}")
        return numbers if numbers.ndim else float(numbers)
    return value


class PathTable(Shown, dict[str, tuple[Any, Unit]]):
    """Path -> (value, unit). It prints as a table with one line for each path."""

    def __init__(self, entries: Mapping[str, tuple[Any, Unit]], scene: Scene) -> None:
        super().__init__(entries)
        self._scene = scene  # for errors

    def __missing__(self, path: str) -> tuple[Any, Unit]:
        why = f"{path}: can be varied, but is not listed; its parts or the whole are"
        try:
            shapes_of(self._scene, [path])
        except (TypeError, ValueError) as error:
            why = str(error).removeprefix("vary: ")
        # A KeyError is printed as a quoted text, in which single quotes need backslashes.
        raise KeyError(why.replace("'", '"'))

    def __repr__(self) -> str:
        rows = [
            (path, _shown(value), unit if isinstance(unit, str) else ", ".join(dict.fromkeys(unit)))
            for path, (value, unit) in self.items()
        ]
        rows.insert(0, ("path", "value", "unit"))
        first, second = (max(len(row[k]) for row in rows) for k in (0, 1))
        return "\n".join(f"{a:<{first}}  {b:>{second}}  {c}".rstrip() for a, b, c in rows)


def paths_of(scene: Scene) -> PathTable:
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
        unit = units(path, shape, jaws(scene))
        if path.startswith("schedule.angles") and not scene.schedules_angles:
            # A controller of one's own may use the schedule for any quantity.
            unit = units("control.limits", (), jaws(scene)) if scene.law == "torque" else "unknown"
        if path == "motion.amplitude" and getattr(scene.motion, "axis", None) == "tilt":
            unit = "rad"
        found[path] = value, unit
    return PathTable(found, scene)


def _below(scene: Scene, node: Any, path: str) -> Iterator[str]:
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
    """True for sequences whose entries are listed: records, or a few numbers."""
    if isinstance(node, tuple):
        return any(isinstance(item, Record) for item in node) or len(node) <= _MOST_ENTRIES
    return isinstance(node, np.ndarray) and node.size <= _MOST_ENTRIES


def _shown(value: Any) -> str:
    if isinstance(value, tuple | np.ndarray):
        array = np.asarray(value)
        if array.ndim > 1 or array.size > _SHOWN:
            return f"array {array.shape}"
        return f"({', '.join(_shown(item) for item in value)})"
    return "None" if value is None else f"{value:.6g}"
