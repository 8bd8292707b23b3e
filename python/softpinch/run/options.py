"""How a scene is simulated, and the checks of those arguments that other functions take too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.record import plain
from ..support.result import Result

DT = 1e-4
# More steps than any run takes; it fits the core's integers.
MOST_STEPS = 2**62


@dataclass(frozen=True, kw_only=True, eq=False)
class Options(Result):
    """How a scene was simulated: the arguments of `simulate`."""

    dt: float | None
    tolerance: float | None = None
    times: NDArray[np.float64] | None = None
    method: str
    formulation: str
    stabilization: Stabilization
    record: tuple[str, ...]
    every: int
    stop_on: tuple[str, ...]
    max_steps: int = _core.MAX_STEPS

    def numerics(self) -> dict[str, Any]:
        """Those arguments that decide the bits: with them `simulate` gives the same run again."""
        return {
            "dt": self.dt,
            "tolerance": self.tolerance,
            "max_steps": None if self.tolerance is None else self.max_steps,
            "method": self.method,
            "formulation": self.formulation,
            "stabilization": self.stabilization,
            "stop_on": self.stop_on,
        }

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data, the gains among them by their names; None is left out."""
        how = self.numerics()
        gains: dict[str, Any] = how.pop("stabilization").to_dict()
        return {name: plain(value) for name, value in how.items() if value is not None} | gains


def names(field: str, value: str | Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """One name or several, each out of `allowed`, without repeats.

    Raises:
        ValueError: A name is unknown; the message has the closest and all that are allowed.
        TypeError: It is no text and no sequence of texts.
    """
    given = (value,) if isinstance(value, str) else value
    if not isinstance(given, Sequence | set | frozenset):
        raise TypeError(
            f"{field} = {checks.shown(value)}: must be names out of {checks.quoted(allowed)}"
        )
    found = {checks.choice(field, name, allowed) for name in given}
    return tuple(name for name in allowed if name in found)


def some_names(field: str, value: str | Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """The same, and there must be one.

    Raises:
        ValueError: A name is unknown, or there is none.
        TypeError: It is no text and no sequence of texts.
    """
    found = names(field, value, allowed)
    if not found:
        raise ValueError(f"{field} = (): must have at least one")
    return found


def steps(
    dt: float | None, tolerance: float | None, method: str
) -> tuple[float | None, float | None]:
    """The two that say how long steps are, checked; `dt` takes its default."""
    if tolerance is None:
        return checks.positive("dt", DT if dt is None else dt), None
    if dt is not None:
        given = f"dt = {checks.shown(dt)} and tolerance = {checks.shown(tolerance)}"
        raise ValueError(f"{given}: give one of them")
    if method not in _core.ADAPTIVE_METHODS:
        raise ValueError(
            f"method = {method!r} has no error estimate: tolerance goes with "
            f"{checks.quoted(_core.ADAPTIVE_METHODS)}"
        )
    return None, checks.number("tolerance", tolerance)


def most_steps(tolerance: float | None, max_steps: int | None) -> int:
    """How many steps a run may attempt, checked."""
    if max_steps is None:
        return _core.MAX_STEPS
    if tolerance is None:
        raise ValueError(
            f"max_steps = {checks.shown(max_steps)}: goes with tolerance; with dt the steps are "
            "known before"
        )
    return checks.integer("max_steps", max_steps, 1, MOST_STEPS)


def in_place(**settings: Any) -> dict[str, Any]:
    """Settings that take the place of others; None leaves one as it is.

    A step takes a tolerance's place, and that of `max_steps`, which goes with a tolerance.
    """
    given = {name: value for name, value in settings.items() if value is not None}
    for name, other in (("dt", "tolerance"), ("tolerance", "dt")):
        if name in given and other not in given:
            given[other] = None
    if given.get("dt") is not None:
        given.setdefault("max_steps", None)
    return given
