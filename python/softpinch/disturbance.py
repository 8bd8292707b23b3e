"""What pushes the grasped object: forces in N at its centre of gravity and a moment in N m.

Every kind compiles itself to what the core knows: piecewise polynomials, sinusoids and impulses.
A new kind is a class with `compile` and a line in `DISTURBANCES`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import _record
from ._record import Record
from .schedule import HOLDS, Piecewise, held, linear, require_finite

Components: TypeAlias = tuple[float, float, float]
_NONE = np.zeros(3)


class Compiled(NamedTuple):
    """What the core makes of disturbances, as `_core.Inputs` takes it."""

    forces: tuple[Piecewise, ...] = ()
    sines: tuple[tuple[float, float, float, float, Components], ...] = ()
    impulses: tuple[tuple[float, Components], ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Disturbance(Record):
    """Base of the disturbances."""

    def compile(self) -> Compiled:
        """What the core makes of it."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """As a dictionary, with the `kind` that `from_dict` needs.

        Raises:
            TypeError: The class has no line in `DISTURBANCES`.
        """
        for kind, cls in DISTURBANCES.items():
            if type(self) is cls:
                return {"kind": kind, **super().to_dict()}
        raise TypeError(f"{type(self).__name__} has no kind: add it to disturbance.DISTURBANCES")

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """The class by `kind`; a class of its own needs none."""
        kinds = {kind: known for kind, known in DISTURBANCES.items() if issubclass(known, cls)}
        if not isinstance(data, Mapping) or ("kind" not in data and cls is not Disturbance):
            return super()._parse(data, path)
        where = f"Disturbance.kind{_record.at(path)}"
        if "kind" not in data:
            raise ValueError(f"{where}: is missing; must be one of {_record.quoted(kinds)}")
        found = kinds[_record.choice(where, data["kind"], kinds)]
        rest = {name: value for name, value in data.items() if name != "kind"}
        result: Self = super(Disturbance, found)._parse(rest, path)
        return result

    def _number(self, name: str, check: Any = _record.finite) -> float:
        value: float = check(f"{type(self).__name__}.{name}", getattr(self, name))
        self._set(name, value)
        return value

    def _pair(self, name: str) -> None:
        self._set(name, _record.pair(f"{type(self).__name__}.{name}", getattr(self, name)))

    def _end(self, time: float) -> None:
        """Checks `duration`: what ends must end later than it starts."""
        duration = self._number("duration", _record.positive)
        if time + duration <= time:
            raise ValueError(
                f"{type(self).__name__}.duration = {duration}: "
                f"must be long enough to end later than time = {time}"
            )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Step(Disturbance):
    """A force from `time` on, for ever.

    Attributes:
        time: s.
        force: (F_x, F_y), N.
        moment: N m, counter-clockwise.
    """

    time: float
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0

    def __post_init__(self) -> None:
        """Checks time, force and moment."""
        self._number("time")
        self._pair("force")
        self._number("moment")

    def compile(self) -> Compiled:
        """One break."""
        load = np.array([[*self.force, self.moment]])
        return Compiled(forces=(held(np.array([self.time]), load, _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Pulse(Disturbance):
    """A force from `time` until `time + duration`.

    Attributes:
        time: s.
        duration: s.
        force: (F_x, F_y), N.
        moment: N m, counter-clockwise.
    """

    time: float
    duration: float
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0

    def __post_init__(self) -> None:
        """Checks time, duration, force and moment."""
        self._end(self._number("time"))
        self._pair("force")
        self._number("moment")

    def compile(self) -> Compiled:
        """Two breaks; one where the end overflows."""
        breaks = np.array([self.time, self.time + self.duration])
        loads = np.array([[*self.force, self.moment], [0.0, 0.0, 0.0]])
        ends = np.isfinite(breaks)
        return Compiled(forces=(held(breaks[ends], loads[ends], _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Impulse(Disturbance):
    """An ideal impulse: the velocities jump at `time`, and the constraints hold on.

    It acts where start <= time < end; the row recorded at that instant is the one before the jump.

    Attributes:
        time: s.
        impulse: (J_x, J_y), N s.
        angular_impulse: N m s, counter-clockwise.
    """

    time: float
    impulse: tuple[float, float] = (0.0, 0.0)
    angular_impulse: float = 0.0

    def __post_init__(self) -> None:
        """Checks time and impulse."""
        self._number("time")
        self._pair("impulse")
        self._number("angular_impulse")

    def compile(self) -> Compiled:
        """One jump."""
        return Compiled(impulses=((self.time, (*self.impulse, self.angular_impulse)),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sine(Disturbance):
    """F sin(2 pi f (t - time) + phase) from `time` on, until `time + duration` or for ever.

    Attributes:
        frequency_hz: f, Hz.
        force: Amplitudes (F_x, F_y), N.
        moment: Amplitude, N m.
        phase: At `time`, rad.
        time: s.
        duration: s; None is for ever.
    """

    frequency_hz: float
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0
    phase: float = 0.0
    time: float = 0.0
    duration: float | None = None

    def __post_init__(self) -> None:
        """Checks every field."""
        frequency = self._number("frequency_hz", _record.positive)
        if not math.isfinite(math.tau * frequency):
            raise ValueError(f"Sine.frequency_hz = {frequency}: 2 pi times it must be finite")
        self._pair("force")
        self._number("moment")
        self._number("phase")
        time = self._number("time")
        if self.duration is not None:
            self._end(time)

    def compile(self) -> Compiled:
        """One sinusoid."""
        end = math.inf if self.duration is None else self.time + self.duration
        load = (*self.force, self.moment)
        return Compiled(sines=((self.time, end, math.tau * self.frequency_hz, self.phase, load),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sampled(Disturbance):
    """Samples of a force, from a file or another program: none before the first, the last held.

    Attributes:
        times: (k,), s, increasing.
        force: (k, 2), N.
        moment: (k,), N m; None is no moment.
        hold: "zero" keeps each until the next, "linear" joins them.
    """

    times: NDArray[np.float64]
    force: NDArray[np.float64]
    moment: NDArray[np.float64] | None = None
    hold: str = "zero"

    def __post_init__(self) -> None:
        """Checks every field, and that the rates between samples do not overflow."""
        self._set("times", _record.times("Sampled.times", self.times))
        self._set("force", _record.array("Sampled.force", self.force, ("k", 2)))
        moment = np.zeros(len(self.times)) if self.moment is None else self.moment
        moment = _record.array("Sampled.moment", moment, ("k",))
        self._set("moment", moment)
        _record.same_length("Sampled.force", self.force, "Sampled.times", len(self.times))
        _record.same_length("Sampled.moment", moment, "Sampled.times", len(self.times))
        _record.choice("Sampled.hold", self.hold, HOLDS)
        require_finite("Sampled.times", self.compile().forces[0])

    def compile(self) -> Compiled:
        """A break for each sample."""
        assert self.moment is not None  # __post_init__ has filled it in
        loads = np.column_stack([self.force, self.moment])
        join = linear if self.hold == "linear" else held
        return Compiled(forces=(join(self.times, loads, _NONE),))


# By the `kind` that stands in a scene file.
DISTURBANCES: dict[str, type[Disturbance]] = {
    "step": Step,
    "pulse": Pulse,
    "impulse": Impulse,
    "sine": Sine,
    "sampled": Sampled,
}
