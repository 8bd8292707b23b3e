"""`changed`: a copy of a scene with other values at dotted paths, for `Scene.with_`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from ..support import checks
from ..support.record import Record
from .paths import locate, refuse_overlaps, replaced, require_gains, tree_of

SceneType = TypeVar("SceneType", bound=Record)


def changed(scene: SceneType, values: object, named: Mapping[str, object]) -> SceneType:
    """Returns a copy of a scene with other values at dotted paths; see `Scene.with_`."""
    if named:
        written = ", ".join(f'"{name}": {checks.shown(value)}' for name, value in named.items())
        raise TypeError(
            f"with_: {next(iter(named))} is given by name: must map paths to values, as in "
            f"with_({{{written}}})"
        )
    if not isinstance(values, Mapping):
        raise TypeError(
            f"with_: {checks.shown(values)}: must map paths to values, such as "
            '{"grasped.mass": 0.2}'
        )
    try:
        for path in values:
            require_gains(scene, path)
        taken = {path: _taken(path, locate(scene, path)[0], values[path]) for path in values}
        refuse_overlaps(list(taken))
    except (TypeError, ValueError) as error:
        raise type(error)(f"with_: {str(error).removeprefix('vary: ')}") from None
    result: SceneType = replaced(scene, tree_of(taken))
    return result


def _taken(path: str, old: Any, value: Any) -> Any:
    """Checks a value where the constructors of the records would not, and returns it."""
    if isinstance(value, Mapping):
        raise TypeError(
            f"{checks.shown(path)} = {checks.shown(value)}: must be a value, not a mapping; the "
            'parts of a record have paths of their own, such as "grasped.mass"'
        )
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
