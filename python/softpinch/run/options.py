"""How a scene is simulated, and the checks of those arguments that other functions take too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.record import plain
from ..support.result import Result

DT = 1e-4
STOP_ON = ("separated", "crushed", "folded")
# More steps than any run takes; it fits the core's integers.
MOST_STEPS = 2**62


@dataclass(frozen=True, kw_only=True, eq=False)
class Options(Result):
    """How a scene is simulated: the arguments of `simulate`, checked."""

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

    @classmethod
    def checked(cls, **given: Any) -> Options:
        """Some arguments of `simulate`, checked as far as they can be without the scene's numbers.

        What is left out has the default of `simulate`, but nothing is recorded.

        Raises:
            ValueError: An argument breaks its rule.
            TypeError: An argument is of the wrong kind.
        """
        try:
            return _checked(**given)
        except TypeError:  # an array, a list or a set is no key of a cache; or a wrong kind
            return _checked.__wrapped__(**given)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Options:
        """From what `to_dict` gives; what is left out has its default.

        Raises:
            ValueError: A value breaks its rule.
            TypeError: A value is of the wrong kind, or a name is unknown.
        """
        gains = {name: value for name, value in data.items() if name in _GAINS}
        others = {name: value for name, value in data.items() if name not in _GAINS}
        return cls.checked(**others, stabilization=Stabilization(**gains))

    def numerics(self) -> dict[str, Any]:
        """The arguments that decide the bits: with them `simulate` gives the same run again."""
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
        """`numerics` as plain data, `NUMERICS` by name; None is left out."""
        how = self.numerics()
        gains: dict[str, Any] = how.pop("stabilization").to_dict()
        return {name: plain(value) for name, value in how.items() if value is not None} | gains


_GAINS = tuple(f.name for f in fields(Stabilization))
# The names in `Options.to_dict`, which study files, manifests and capsules have: those that are
# always there, and those that are left out where they are None.
ALWAYS = ("method", "formulation", "stop_on", *_GAINS)
NUMERICS = ("dt", "tolerance", "max_steps", *ALWAYS)


# Short runs are often repeated with the same options, and checking them takes longer than a
# hundred steps do. The types belong to the key, since 1, 1.0 and True are equal.
@lru_cache(maxsize=64, typed=True)
def _checked(
    *,
    dt: float | None = None,
    tolerance: float | None = None,
    times: ArrayLike | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: str | Sequence[str] = (),
    every: int = 1,
    stop_on: str | Sequence[str] = STOP_ON,
    max_steps: int | None = None,
) -> Options:
    checks.instance("stabilization", stabilization, Stabilization)
    method = checks.choice("method", method, _core.METHODS)
    every = checks.integer("every", every, 1)
    dt, tolerance = steps(dt, tolerance, method)
    return Options(
        dt=dt,
        tolerance=tolerance,
        times=_times(tolerance, times, every),
        method=method,
        formulation=checks.choice("formulation", formulation, _core.FORMULATIONS),
        stabilization=stabilization,
        record=names("record", record, _core.RECORDABLE),
        every=every,
        stop_on=names("stop_on", stop_on, _core.STOPPABLE),
        max_steps=_most_steps(tolerance, max_steps),
    )


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


def _most_steps(tolerance: float | None, max_steps: int | None) -> int:
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


def _times(tolerance: float | None, times: ArrayLike | None, every: int) -> Floats | None:
    """The instants to keep, checked."""
    if times is None:
        return None
    if tolerance is None:
        raise ValueError("times goes with tolerance, not with dt: every keeps rows of a grid")
    if every != 1:
        raise ValueError(f"every = {every} and times: give one of them")
    return checks.times("times", times)
