"""A scene with numbers that differ between runs: it makes one run's scene, or the core's batch."""

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
from .paths import replaced, shapes_of, tree_of_numbers
from .sampled_control import SampledController
from .scene import Scene, State

# The core's errors begin with the index of the run within its batch.
_RUN = re.compile(r"run (\d+): ")
# Errors with these beginnings concern options that all runs share, although they name a run.
_SHARED = ("tolerance = ", "method = ", "formulation = ")


class SceneTemplate:
    """A scene with numbers that differ between runs.

    Attributes:
        scene: The scene that all runs share, apart from the varied numbers.
        seed: The study's seed, which keys the noise of every run.
        shapes: Path of a varied value -> its shape: () of a number, (2,) of a pair, or an array's.
    """

    def __init__(self, scene: Scene, paths: Iterable[str], seed: int) -> None:
        """Checks the paths of the varied values.

        Raises:
            ValueError: A path does not exist or its value is not numeric; two paths set the same
                number; or a path leads to gains that the scene has not.
            TypeError: A path is not text.
        """
        self.scene = scene
        self.seed = seed
        self.shapes = shapes_of(scene, paths)

    def changed(self, values: Mapping[str, Any]) -> Scene:
        """Returns the scene with these values. Unlike `at`, it keeps the noise's seed and run."""
        scene: Scene = replaced(self.scene, tree_of_numbers(values))
        return scene

    def at(self, values: Mapping[str, Any], run: int) -> Scene:
        """Returns the scene of one run.

        Args:
            values: Path -> value.
            run: The run's number, which keys the noise.

        Raises:
            ValueError: A value breaks its rule.
            TypeError: A value has the wrong type.
        """
        scene = self.changed(values)
        control = scene.control
        if isinstance(control, SampledController):
            control = replace(control, seed=self.seed, run=run)
        disturbances = tuple(
            replace(one, seed=self.seed, run=run) if isinstance(one, Noise) else one
            for one in scene.disturbances
        )
        return replace(scene, disturbances=disturbances, control=control)

    def check(self, values: Mapping[str, Floats], numbers: NDArray[np.uint64]) -> None:
        """Refuses values that break the rule of their field.

        A rule on one number is an interval. So it is enough to check the runs with the smallest and
        the largest value of each component, and the first with a non-finite value. The core checks
        rules that relate two numbers in every run.

        Args:
            values: Path -> (runs, ...).
            numbers: The run numbers (runs,).

        Raises:
            ValueError: A value breaks its rule; the message names the run.
        """
        suspects: set[int] = set()
        for value in values.values():
            columns = value.reshape(len(value), -1)
            odd = np.flatnonzero(~np.isfinite(columns).all(axis=1))
            suspects |= {*columns.argmin(axis=0).tolist(), *columns.argmax(axis=0).tolist()}
            suspects |= set(odd[:1].tolist())
        for row in sorted(suspects):
            tree = tree_of_numbers({path: value[row] for path, value in values.items()})
            try:
                # Rebuilding only the changed parts takes a tenth of the time of a whole scene.
                for name, branch in tree.items():
                    if isinstance(branch, dict):
                        replaced(getattr(self.scene, name), branch)
                    else:
                        replaced(self.scene, {name: branch})
            except (TypeError, ValueError) as error:
                raise ValueError(f"run {int(numbers[row])}: {error}") from None

    def _explain(self, values: Mapping[str, Floats], numbers: NDArray[np.uint64], row: int) -> None:
        """Raises the error that building and starting one run's scene gives, if there is one."""
        run = int(numbers[row])
        try:
            self.at({path: value[row] for path, value in values.items()}, run).start()
        except (TypeError, ValueError) as error:
            raise ValueError(f"run {run}: {error}") from None

    def batch(
        self, values: Mapping[str, Floats], numbers: NDArray[np.uint64], **how: Any
    ) -> _core.Batch:
        """Makes the core's batch of runs, which checks them.

        Args:
            values: Path -> (runs, ...), of these runs.
            numbers: The run numbers (runs,), for noise and error messages.
            how: Further arguments of `_core.Batch`, such as `dt` and `method`.

        Raises:
            ValueError: A run breaks a rule; the message names the run, the field and the value.
        """
        try:
            return self._batch(values, numbers, **how)
        except ValueError as error:
            found = _RUN.match(str(error))
            if found is None:
                raise
            # Python's message for this run's scene, if it fails there too, names the field better.
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
            for path, slots in self.slots.items()
            for slot in slots
        ]
        moves = self._fields(scene.schedule, "schedule", values)
        loads = [
            self._fields(disturbance, f"disturbances.{k}", values)
            for k, disturbance in enumerate(scene.disturbances)
        ]
        control = scene.control
        gains: Mapping[str, Floats] = {}
        if isinstance(control, SampledController):
            gains = self._fields(control, "control", values)
        start = scene.initial if isinstance(scene.initial, State) else None
        kind = "state" if isinstance(scene.initial, State) else scene._start_kind
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
                scene.law,
                scene.control,
                gains=gains,
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
            contacts=None if start is None or start.contact is None else start.contact[None],
            controller=None if start is None else start.controller,
            contact=scene.contact,
            check=True if start is None else start.check,
            duration=np.ascontiguousarray(values.get("duration", np.array([scene.duration]))),
            **how,
        )

    @cached_property
    def slots(self) -> dict[str, list[int]]:
        """Path -> indices of the entries of `_core.PARAMETERS` that it sets."""
        outside = ["schedule", "disturbances", "initial", "duration"]
        outside += ["control"] if self.scene.law == "sampled" else []
        inner = [path for path in self.shapes if path.split(".")[0] not in outside]
        # Give each path a unique value that satisfies every rule, and find it in the parameters.
        marks = {path: 0.375_192_837 + k / 8192 for k, path in enumerate(inner)}
        found = self.at(marks, 0).parameters()
        return {path: np.flatnonzero(found == mark).tolist() for path, mark in marks.items()}

    def _fields(
        self, record: Record, place: str, values: Mapping[str, Floats]
    ) -> dict[str, Floats]:
        """Returns the fields of the record at `place` that differ between runs -> (runs, ...)."""
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
