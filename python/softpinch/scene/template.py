"""A scene with numbers that differ between runs: it makes one run's scene, or the core's batch."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support import Floats, Record, checks
from .control import SampledController
from .disturbance import Noise
from .paths import replaced, shapes_of, tree_of_numbers, with_numbers
from .scene import Scene, State, inputs

# The core's errors begin with the index of the run within its batch.
_RUN = re.compile(r"run (\d+): ")
# Errors with these beginnings concern options that all runs share, although they name a run.
_SHARED = ("tolerance = ", "method = ", "formulation = ")


class SceneTemplate:
    """A scene with numbers that differ between runs."""

    def __init__(self, scene: Scene, paths: Iterable[str], seed: int) -> None:
        self.scene = scene  # which all runs share, apart from the varied numbers
        self.seed = seed  # of the study, which keys the noise of every run
        self.shapes = shapes_of(scene, paths)  # path of a varied value -> its shape

    def require_numbers(self, name: str) -> None:
        """Refuses a path to a pair or an array, in an error about the argument `name`."""
        for path, shape in self.shapes.items():
            if shape:
                example = ".".join([path, *["0"] * len(shape)])
                rule = f"must be one number, such as {example!r}"
                raise ValueError(f"{name}: {path!r} has shape {shape}: {rule}")

    def changed(self, values: Mapping[str, Any]) -> Scene:
        """Returns the scene with these values. Unlike `at`, it keeps the noise's seed and run."""
        return with_numbers(self.scene, values)

    def at(self, values: Mapping[str, Any], run: int) -> Scene:
        """Returns the scene of one run, from its values (path -> value) and its number."""
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
        """Refuses values, path -> (runs, ...), that break the rule of their field.

        A rule on one number is an interval. So it is enough to check the runs with the smallest and
        the largest value of each component, and the first with a non-finite value. The core checks
        rules that relate two numbers in every run.
        """
        suspects: set[int] = set()
        for value in values.values():
            columns = value.reshape(len(value), -1)
            odd = np.flatnonzero(~np.isfinite(columns).all(axis=1))
            suspects |= {*columns.argmin(axis=0).tolist(), *columns.argmax(axis=0).tolist()}
            suspects |= set(odd[:1].tolist())
        for row in sorted(suspects):
            tree = tree_of_numbers({path: value[row] for path, value in values.items()})
            with checks.reworded(f"run {int(numbers[row])}: ", kind=ValueError):
                # Rebuilding only the changed parts takes a tenth of the time of a whole scene.
                for name, branch in tree.items():
                    if isinstance(branch, dict):
                        replaced(getattr(self.scene, name), branch)
                    else:
                        replaced(self.scene, {name: branch})

    def batch(
        self, values: Mapping[str, Floats], numbers: NDArray[np.uint64] | None, **how: Any
    ) -> _core.Batch:
        """Makes the core's batch of runs, which checks them; errors name the run, field and value.

        `values` are path -> (runs, ...), `numbers` the run numbers (runs,), for noise and messages;
        with None each noise keeps its own seed and run, and without values there is one run.
        """
        try:
            return self._batch(values, numbers, **how)
        except ValueError as error:
            found = _RUN.match(str(error))
            if found is None:
                raise
            row, text = int(found[1]), str(error)[found.end() :]
            if text.startswith(_SHARED):
                raise ValueError(text) from None
            run = row if numbers is None else int(numbers[row])
            try:
                self.at({path: value[row] for path, value in values.items()}, run).start()
            except (TypeError, ValueError) as better:
                text = str(better)  # it names the field
            raise ValueError(f"run {run}: {text}") from None

    def _batch(
        self, values: Mapping[str, Floats], numbers: NDArray[np.uint64] | None, **how: Any
    ) -> _core.Batch:
        scene = self.scene
        columns: list[tuple[int, Floats]] = []
        for path, slots in self.slots.items():
            columns += [(slot, np.ascontiguousarray(values[path])) for slot in slots]
        moves = self._fields(scene.schedule, "schedule", values)
        loads = [
            self._fields(disturbance, f"disturbances.{k}", values)
            for k, disturbance in enumerate(scene.disturbances)
        ]
        carries = {} if scene.motion is None else self._fields(scene.motion, "motion", values)
        control = scene.control
        gains = {}
        if isinstance(control, SampledController):
            gains = {path: self._fields(one, path, values) for path, one in control.blocks()}
        # Other kinds of start have no use for the numbers of a state.
        given = isinstance(scene.initial, State)
        start = scene.initial if isinstance(scene.initial, State) else State(np.zeros(9))
        own = self._fields(start, "initial", values)

        def rows(name: str) -> Floats:
            one = np.asarray(getattr(start, name), dtype=np.float64)
            return np.ascontiguousarray(own.get(name, one[None]))

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
                motion=scene.motion,
                carries=carries,
                numbers=numbers,
                seed=self.seed,
            ),
            runs=len(next(iter(values.values()), [0])) if numbers is None else len(numbers),
            start="state" if given else scene._start_kind,
            initial=start,
            time=rows("time"),
            q=rows("q"),
            p=rows("p"),
            integral=rows("integral"),
            contact=scene.contact,
            duration=np.ascontiguousarray(values.get("duration", np.array([scene.duration]))),
            **how,
        )

    @cached_property
    def slots(self) -> dict[str, list[int]]:
        """Path -> indices of the entries of `_core.PARAMETERS` that it sets."""
        outside = ["schedule", "disturbances", "initial", "duration", "motion"]
        outside += ["control"] if self.scene.law == "sampled" else []
        inner = [path for path in self.shapes if path.split(".")[0] not in outside]
        # Give each path a unique value that satisfies every rule, and find it in the parameters.
        marks = {path: 1.375_192_837 + k / 8192 for k, path in enumerate(inner)}
        found = self.at(marks, 0).parameters()
        return {path: np.flatnonzero(found == mark).tolist() for path, mark in marks.items()}

    def _fields(self, record: Record, place: str, values: Mapping[str, Floats]) -> dict[str, Any]:
        """Returns the fields of the record at `place` that differ between runs -> (runs, ...)."""
        found: dict[str, Any] = {}
        for path, value in values.items():
            if not path.startswith(f"{place}."):
                continue
            name, *index = path.removeprefix(f"{place}.").split(".")
            if isinstance(inside := getattr(record, name), Record):
                if not isinstance(inside, SampledController):  # it has a place of its own
                    found[name] = found.get(name) or self._fields(inside, f"{place}.{name}", values)
            elif index:
                whole = np.asarray(getattr(record, name), dtype=np.float64)
                runs = (len(value), *whole.shape)
                whole = found.setdefault(name, np.broadcast_to(whole, runs).copy())
                np.moveaxis(whole, 0, -1)[tuple(int(k) for k in index)] = np.moveaxis(value, 0, -1)
            else:
                found[name] = value
        return found
