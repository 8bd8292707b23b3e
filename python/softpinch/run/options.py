"""`Options`: the validated arguments of `simulate`, and checks that other functions share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..scene.stabilization import Stabilization
from ..support import Formulation, Method, Result, Violation, checks, plain

DT = 1e-4
STOP_ON: tuple[Violation, ...] = ("separated", "crushed", "folded")
# An upper limit on numbers of steps: more than any run takes, and within the core's integers.
MOST_STEPS = 2**62


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Options(Result):
    """The arguments of `simulate` apart from the scene, validated."""

    dt: float | None
    tolerance: float | None = None
    times: NDArray[np.float64] | None = None
    method: Method
    formulation: Formulation
    stabilization: Stabilization
    record: tuple[str, ...]
    every: int
    stop_on: tuple[str, ...]
    max_steps: int = _core.MAX_STEPS
    summaries_after: float | None = None

    @classmethod
    def checked(cls, *given: Any, **named: Any) -> Options:
        """Validates arguments of `simulate`, in its order, as far as possible without the scene.

        Omitted arguments take the defaults of `simulate`, except `record`, whose default is empty.
        """
        try:
            return _checked(*given, **named)
        except TypeError:  # an unhashable argument, which cannot be cached, or a wrong type
            return _checked.__wrapped__(*given, **named)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Options:
        """Makes options from the output of `to_dict`. Omitted entries take their defaults."""
        gains = {name: value for name, value in data.items() if name in GAINS}
        others = {name: value for name, value in data.items() if name not in GAINS}
        return cls.checked(**others, stabilization=Stabilization(**gains))

    def numerics(self) -> dict[str, Any]:
        """Returns the arguments that determine the numbers of a run, bit for bit."""
        how = ("dt", "tolerance", "max_steps", "method", "formulation", "stabilization", "stop_on")
        found = {name: getattr(self, name) for name in how}
        return found if self.tolerance is not None else found | {"max_steps": None}

    @cached_property
    def core(self) -> Mapping[str, Any]:
        """The options that `_core.Simulation` and `_core.Batch` share."""
        how = self.numerics() | {"max_steps": self.max_steps, "stop_on": list(self.stop_on)}
        gains: Stabilization = how.pop("stabilization")
        after = -np.inf if self.summaries_after is None else self.summaries_after
        return how | {"alpha": gains.alpha, "beta": gains.beta, "after": after}

    def to_dict(self) -> dict[str, Any]:
        """Converts `numerics` to plain data with the names in `NUMERICS`; omits None."""
        how = self.numerics()
        gains: dict[str, Any] = how.pop("stabilization").to_dict()
        return {name: plain(value) for name, value in how.items() if value is not None} | gains


GAINS = tuple(f.name for f in fields(Stabilization))
# The names in `Options.to_dict`, and so in study files, manifests and capsules: the names that are
# always present, and all names, of which "dt", "tolerance" and "max_steps" may be missing.
ALWAYS = ("method", "formulation", "stop_on", *GAINS)
NUMERICS = ("dt", "tolerance", "max_steps", *ALWAYS)


# The cache serves short runs that repeat the same options, because validation takes longer than a
# hundred steps. The key includes the types, because 1, 1.0 and True are equal.
@lru_cache(maxsize=64, typed=True)
def _checked(
    dt: float | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: str | Sequence[str] = (),
    every: int = 1,
    stop_on: str | Sequence[str] = STOP_ON,
    tolerance: float | None = None,
    times: ArrayLike | None = None,
    max_steps: int | None = None,
    summaries_after: float | None = None,
) -> Options:
    checks.instance("stabilization", stabilization, Stabilization)
    method = checks.choice("method", method, _core.METHODS)
    every = checks.integer("every", every, 1)
    if tolerance is None:
        dt = checks.positive("dt", DT if dt is None else dt)
    elif dt is not None:
        given = f"dt = {checks.shown(dt)} and tolerance = {checks.shown(tolerance)}"
        raise ValueError(f"{given}: give one of them")
    elif method not in _core.ADAPTIVE_METHODS:
        rule = f"tolerance goes with {checks.quoted(_core.ADAPTIVE_METHODS)}"
        raise ValueError(f"method = {method!r} has no error estimate: {rule}")
    else:
        tolerance = checks.number("tolerance", tolerance)
    if times is not None and every != 1:
        raise ValueError(f"every = {every} and times: give one of them")
    if max_steps is not None and tolerance is None:
        rule = "goes with tolerance; with dt the number of steps is known in advance"
        raise ValueError(f"max_steps = {checks.shown(max_steps)}: {rule}")
    if max_steps is not None:
        max_steps = checks.integer("max_steps", max_steps, 1, MOST_STEPS)
    if summaries_after is not None:
        summaries_after = checks.finite("summaries_after", summaries_after)
    return Options(
        dt=dt,
        tolerance=tolerance,
        times=None if times is None else checks.times("times", times),
        method=method,
        formulation=checks.choice("formulation", formulation, _core.FORMULATIONS),
        stabilization=stabilization,
        record=names("record", record, _core.RECORDABLE),
        every=every,
        stop_on=names("stop_on", stop_on, _core.VIOLATIONS),
        max_steps=_core.MAX_STEPS if max_steps is None else max_steps,
        summaries_after=summaries_after,
    )


def names(
    field: str, value: str | Sequence[str], allowed: Sequence[checks.Name]
) -> tuple[checks.Name, ...]:
    """Converts one name or several to a tuple in the order of `allowed`, without repeats."""
    given = (value,) if isinstance(value, str) else value
    if not isinstance(given, Sequence | set | frozenset):
        rule = f"must be names out of {checks.quoted(allowed)}"
        raise TypeError(f"{field} = {checks.shown(value)}: {rule}")
    found = {checks.choice(field, name, allowed) for name in given}
    return tuple(name for name in allowed if name in found)


def in_place(**settings: Any) -> dict[str, Any]:
    """Returns the settings that override earlier ones; None keeps the earlier value.

    `dt` and `tolerance` clear each other, and `dt` also `max_steps`, which belongs to a tolerance.
    """
    given = {name: value for name, value in settings.items() if value is not None}
    for name, other in (("dt", "tolerance"), ("tolerance", "dt")):
        if name in given and other not in given:
            given[other] = None
    if given.get("dt") is not None:
        given.setdefault("max_steps", None)
    return given
