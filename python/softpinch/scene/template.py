"""Which numbers of a scene differ between runs: the scene of one run, the arrays of many.

A dotted path leads from `Scene` through fields, `right` and `left` of pairs and indices of
disturbances and arrays to a number, a pair or an array: "grasped.mass", "hand.tip.left.radius",
"control.kp", "disturbances.0.force", "schedule.angles.1.0". A record that stands for both fingers
is varied as one, or, where the path says `right` or `left`, becomes a pair.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support import checks, suggest
from ..support.arrays import Floats
from ..support.record import SIDES, Record
from .disturbance import Noise
from .scene import Scene, State, inputs

# Fields whose numbers are no quantities.
_COUNTS = {"grid", "linearized", "seed", "run"}
# Runs of the core's errors.
_RUN = re.compile(r"run (\d+): ")
# What such an error may be about although it is no run's own.
_SHARED = ("tolerance = ", "method = ")
# Where one record may stand for both fingers, or a pair for each.
_SIDED = (["hand", "tip"], ["control"])


class Varied:
    """A scene of which some numbers differ between runs.

    Attributes:
        scene: What all runs share.
        shapes: Path -> shape of the number there, () or (2,) or as the array.
    """

    def __init__(self, scene: Scene, paths: Iterable[str], seed: int) -> None:
        """Checks the paths; `seed` is that of held noise.

        Raises:
            ValueError: A path leads nowhere or to no number, or two lead to the same one.
        """
        self.scene = scene
        self.seed = seed
        self.shapes = {path: np.shape(_resolve(scene, path)) for path in paths}
        for path in self.shapes:
            if scene.fingers == "driven" and path.split(".")[0] == "control":
                raise ValueError(f'vary: {path!r}: fingers="driven" have no PID to change')
        _refuse_overlaps(list(self.shapes))

    def changed(self, values: Mapping[str, Any]) -> Scene:
        """The scene with these values, its noise as it was; arguments and errors as of `at`."""
        scene: Scene = _with(self.scene, _tree(values))
        return scene

    def at(self, values: Mapping[str, Any], run: int) -> Scene:
        """The scene of one run.

        Args:
            values: Path -> value.
            run: Its number, for noise.

        Raises:
            ValueError: A value breaks its rule.
            TypeError: A value is of the wrong kind.
        """
        scene = self.changed(values)
        disturbances = tuple(
            replace(one, seed=self.seed, run=run) if isinstance(one, Noise) else one
            for one in scene.disturbances
        )
        return replace(scene, disturbances=disturbances)

    def check(self, values: Mapping[str, Floats], numbers: NDArray[np.uint64]) -> None:
        """Refuses values that break the rule of their field, naming the run.

        A rule on one number is an interval, so the runs with the least and the greatest of each
        component, or with one that is not finite, answer for all. What two numbers must keep
        between them, the core asks of every run.

        Args:
            values: Path -> (runs, ...).
            numbers: Of the runs (runs,).
        """
        suspects: set[int] = set()
        for value in values.values():
            columns = value.reshape(len(value), -1)
            odd = np.flatnonzero(~np.isfinite(columns).all(axis=1))
            suspects |= {*columns.argmin(axis=0).tolist(), *columns.argmax(axis=0).tolist()}
            suspects |= set(odd[:1].tolist())
        for row in sorted(suspects):
            tree = _tree({path: value[row] for path, value in values.items()})
            try:
                # The parts of the scene, not the whole: it takes a tenth of the time.
                for name, branch in tree.items():
                    if isinstance(branch, dict):
                        _with(getattr(self.scene, name), branch)
                    else:
                        _with(self.scene, {name: branch})
            except (TypeError, ValueError) as error:
                raise ValueError(f"run {int(numbers[row])}: {error}") from None

    def _explain(self, values: Mapping[str, Floats], numbers: NDArray[np.uint64], row: int) -> None:
        """Raises what the scene of a run itself says against it, with the run's number."""
        run = int(numbers[row])
        try:
            self.at({path: value[row] for path, value in values.items()}, run).start()
        except (TypeError, ValueError) as error:
            raise ValueError(f"run {run}: {error}") from None

    def batch(
        self, values: Mapping[str, Floats], numbers: NDArray[np.uint64], **how: Any
    ) -> _core.Batch:
        """Runs as the core takes them, checked.

        Args:
            values: Path -> (runs, ...), of these runs.
            numbers: Of the runs (runs,), for noise and errors.
            how: What else `_core.Batch` takes.

        Raises:
            ValueError: A run breaks a rule; the message names the run, the field and the value.
        """
        try:
            return self._batch(values, numbers, **how)
        except ValueError as error:
            found = _RUN.match(str(error))
            if found is None:
                raise
            # The scene of that run may say it in its own words.
            self._explain(values, numbers, int(found[1]))
            text = str(error)[found.end() :]
            if text.startswith(_SHARED):
                raise ValueError(text) from None
            raise ValueError(f"run {int(numbers[int(found[1])])}: {text}") from None

    def _batch(
        self, values: Mapping[str, Floats], numbers: NDArray[np.uint64], **how: Any
    ) -> _core.Batch:
        scene = self.scene
        columns = [
            (slot, np.ascontiguousarray(values[path]))
            for path, slots in self._slots.items()
            for slot in slots
        ]
        schedule = self._fields(scene.schedule, "schedule", values)
        disturbances = [
            self._fields(disturbance, f"disturbances.{k}", values)
            for k, disturbance in enumerate(scene.disturbances)
        ]
        start = scene.initial if isinstance(scene.initial, State) else None
        kind = "state" if isinstance(scene.initial, State) else scene.initial or "contact"
        own = {} if start is None else self._fields(start, "initial", values)

        def rows(name: str, length: int) -> Floats:
            one = np.zeros(length) if start is None else np.asarray(getattr(start, name))
            return np.ascontiguousarray(own.get(name, one[None]))

        time = own.get("time", np.array([0.0 if start is None else start.time]))
        return _core.Batch(
            scene.parameters(),
            columns,
            inputs(scene, schedule, disturbances, numbers, self.seed),
            runs=len(numbers),
            start=kind,
            time=np.ascontiguousarray(time),
            q=rows("q", 9),
            p=rows("p", 9),
            integral=rows("integral", 2),
            grid=None if start is None else start.grid,
            linearized=None if start is None else start.linearized,
            check=True if start is None else start.check,
            duration=np.ascontiguousarray(values.get("duration", np.array([scene.duration]))),
            **how,
        )

    @cached_property
    def _slots(self) -> dict[str, list[int]]:
        """Path -> which of `_core.PARAMETERS` it sets."""
        inner = [
            path
            for path in self.shapes
            if path.split(".")[0] not in ("schedule", "disturbances", "initial", "duration")
        ]
        # Numbers that keep every rule and that no one else has show where they go.
        marks = {path: 0.375_192_837 + k / 8192 for k, path in enumerate(inner)}
        found = self.at(marks, 0).parameters()
        return {path: np.flatnonzero(found == mark).tolist() for path, mark in marks.items()}

    def _fields(
        self, record: Record, place: str, values: Mapping[str, Floats]
    ) -> dict[str, Floats]:
        """The fields of a record that differ between runs -> (runs, ...)."""
        found: dict[str, Floats] = {}
        for path, value in values.items():
            if not path.startswith(f"{place}."):
                continue
            name, *index = path.removeprefix(f"{place}.").split(".")
            if index:
                whole = np.asarray(getattr(record, name), dtype=np.float64)
                runs = (len(value), *whole.shape)
                whole = found.setdefault(name, np.broadcast_to(whole, runs).copy())
                np.moveaxis(whole, 0, -1)[tuple(int(k) for k in index)] = np.moveaxis(value, 0, -1)
            else:
                found[name] = value
        return found


def _resolve(scene: Scene, path: str) -> Any:
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


def at_path(scene: Scene, path: str) -> list[Any]:
    """What a path leads to: two things where one record has become a pair since it was given.

    Raises:
        ValueError: It leads nowhere, or to no number.
    """
    steps = path.split(".")
    for sided in _SIDED:
        rest = steps[len(sided) :]
        if steps[: len(sided)] == sided and rest and rest[0] not in SIDES:
            return [_resolve(scene, ".".join([*sided, side, *rest])) for side in SIDES]
    return [_resolve(scene, path)]


def _tree(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values by the names of their paths, level by level."""
    tree: dict[str, Any] = {}
    for path, value in values.items():
        *branches, leaf = path.split(".")
        node = tree
        for name in branches:
            node = node.setdefault(name, {})
        node[leaf] = np.asarray(value)
    return tree


def _with(node: Any, tree: Any) -> Any:
    """`node` with numbers replaced, those of a record all at once: their rules hold together.

    Args:
        node: A record, a pair, an array or a number.
        tree: Name or index -> the same of what is there; or a number or an array.
    """
    if not isinstance(tree, dict):
        return tree if np.ndim(tree) else float(tree)
    if isinstance(node, Record):
        known = {f.name for f in fields(node)}
        own = {name: _with(getattr(node, name), tree[name]) for name in tree if name in known}
        record = replace(node, **own)
        if own.keys() == tree.keys():
            return record
        # It stands for both sides, which differ from now on.
        return tuple(_with(record, tree.get(side, {})) for side in SIDES)
    if isinstance(node, np.ndarray):
        changed = node.copy()
        for name, branch in tree.items():
            changed[int(name)] = _with(node[int(name)], branch)
        return changed
    inside = {SIDES.index(k) if k in SIDES else int(k): branch for k, branch in tree.items()}
    return tuple(
        _with(item, inside.get(k, {})) if k in inside else item for k, item in enumerate(node)
    )


def _refuse_overlaps(paths: Sequence[str]) -> None:
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
