"""A scene of which some numbers differ between runs: the scene of one run, the arrays of many."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support.arrays import Floats
from ..support.record import Record
from .compilation import inputs
from .disturbance import Noise
from .paths import refuse_overlaps, replaced, resolve, tree_of
from .scene import Scene, State

# Runs of the core's errors.
_RUN = re.compile(r"run (\d+): ")
# What such an error may be about although it is no run's own.
_SHARED = ("tolerance = ", "method = ")


class SceneTemplate:
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
        self.shapes = {path: np.shape(resolve(scene, path)) for path in paths}
        for path in self.shapes:
            if scene.fingers == "driven" and path.split(".")[0] == "control":
                raise ValueError(f'vary: {path!r}: fingers="driven" have no PID to change')
        refuse_overlaps(list(self.shapes))

    def changed(self, values: Mapping[str, Any]) -> Scene:
        """The scene with these values, its noise as it was; arguments and errors as of `at`."""
        scene: Scene = replaced(self.scene, tree_of(values))
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
            tree = tree_of({path: value[row] for path, value in values.items()})
            try:
                # The parts of the scene, not the whole: it takes a tenth of the time.
                for name, branch in tree.items():
                    if isinstance(branch, dict):
                        replaced(getattr(self.scene, name), branch)
                    else:
                        replaced(self.scene, {name: branch})
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
        moves = self._fields(scene.schedule, "schedule", values)
        loads = [
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
            inputs(
                scene.schedule,
                scene.disturbances,
                scene.fingers,
                moves=moves,
                loads=loads,
                numbers=numbers,
                seed=self.seed,
            ),
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
