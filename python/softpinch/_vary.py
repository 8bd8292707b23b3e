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

from . import _core, _record
from ._record import SIDES, Floats, Record
from .disturbance import Noise
from .hand import Hand
from .scene import Scene, State, inputs

# Fields whose numbers are no quantities.
_COUNTS = {"grid", "linearized", "seed", "run"}
# Runs of the core's errors.
_RUN = re.compile(r"run (\d+): ")


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
        _refuse_overlaps(list(self.shapes))

    def at(self, values: Mapping[str, Any], run: int) -> Scene:
        """The scene of one run.

        Args:
            values: Path -> value.
            run: Its number, for noise.

        Raises:
            ValueError: A value breaks its rule.
            TypeError: A value is of the wrong kind.
        """
        scene: Scene = self.scene
        for path, value in values.items():
            scene = _with(scene, path.split("."), np.asarray(value))
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
            self._explain(values, numbers, row)

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
            run = int(numbers[int(found[1])])
            raise ValueError(f"run {run}: {str(error)[found.end() :]}") from None

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
        raise TypeError(f'vary: {path!r}: must be a path such as "grasped.mass"')
    node: Any = scene
    where = "Scene"
    for name in path.split("."):
        if isinstance(node, Record):
            names = [f.name for f in fields(node)]
            both = name in SIDES and not isinstance(node, Hand)
            if both and _stands_for_both(scene, path, name):
                continue
            if name not in names:
                hint = _record.hint(name, names)
                raise ValueError(
                    f"vary: {path!r}: {where} has no field {name!r}; it has "
                    f"{_record.quoted(names)}{hint}"
                )
            node, where = getattr(node, name), type(node).__name__ + "." + name
            if name in _COUNTS:
                node = "no quantity"
        elif isinstance(node, tuple) and node and isinstance(node[0], Record) and name in SIDES:
            node, where = node[SIDES.index(name)], f"{where}.{name}"
        elif isinstance(node, tuple | np.ndarray) and name.isdecimal() and int(name) < len(node):
            node, where = node[int(name)], f"{where}.{name}"
        elif isinstance(node, tuple | np.ndarray):
            known = f"0 to {len(node) - 1}" if len(node) else "nothing"
            raise ValueError(f"vary: {path!r}: {where} has {known}, not {name!r}")
        else:
            raise ValueError(f"vary: {path!r}: {where} = {node!r} has nothing inside")
    if node is None and name in ("normal_mass", "tangential_mass", "friction", "duration"):
        return 0.0
    number = isinstance(node, float | np.floating) or (
        isinstance(node, tuple | np.ndarray)
        and len(node) > 0
        and all(isinstance(item, float | np.floating | np.ndarray) for item in node)
    )
    if not number:
        raise ValueError(f"vary: {path!r}: {where} is not a number, a pair or an array of numbers")
    return node


def _stands_for_both(scene: Scene, path: str, side: str) -> bool:
    """Whether `side` in the path asks for one side of a record that stands for both fingers."""
    return path.startswith((f"hand.tip.{side}.", f"control.{side}."))


def _with(node: Any, names: Sequence[str], value: Any) -> Any:
    """`node` with the number at the path replaced."""
    if not names:
        return value if np.ndim(value) else float(value)
    name, *rest = names
    if isinstance(node, Record):
        if name in SIDES and not isinstance(node, Hand):
            node = (node, node)
        else:
            return replace(node, **{name: _with(getattr(node, name), rest, value)})
    if isinstance(node, np.ndarray):
        changed = node.copy()
        changed[int(name)] = _with(node[int(name)], rest, value)
        return changed
    k = SIDES.index(name) if name in SIDES else int(name)
    return tuple(_with(item, rest, value) if j == k else item for j, item in enumerate(node))


def _refuse_overlaps(paths: Sequence[str]) -> None:
    """Refuses two paths to the same number."""

    def plain(path: str) -> list[str]:
        return [name for name in path.split(".") if name not in SIDES]

    def side(path: str) -> set[str]:
        return set(path.split(".")) & set(SIDES)

    for k, path in enumerate(paths):
        for other in paths[:k]:
            shorter, longer = sorted((plain(path), plain(other)), key=len)
            apart = side(path) and side(other) and side(path) != side(other)
            if longer[: len(shorter)] == shorter and not apart:
                raise ValueError(f"vary: {other!r} and {path!r} set the same number")
