"""What pushes the grasped object: forces in N at its centre of gravity and a moment in N m.

Every kind compiles itself to what the core knows: piecewise polynomials, sinusoids and impulses.
A new kind is a class with `compile` and a line in `DISTURBANCES`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support import checks
from ..support.arrays import Floats
from ..support.kinds import chosen, kind_of
from ..support.record import Record, bare, runs_of
from .compiled import Compiled, stacked
from .schedule import HOLDS, held, linear, require_finite

_NONE = np.zeros(3)
# Of a noise, to look at: ten times what a run may use, and 2.4 GB.
_MOST_SAMPLES = 100_000_000


def _columns(*parts: Any) -> Floats:
    """Numbers side by side, (..., parts)."""
    return np.stack(np.broadcast_arrays(*parts), axis=-1).astype(np.float64, copy=False)


def _load(force: Any, moment: Any) -> Floats:
    """Force (..., 2) and moment (...) as (..., 3)."""
    force = np.asarray(force)
    return _columns(force[..., 0], force[..., 1], moment)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Disturbance(Record):
    """Base of the disturbances."""

    # Whether `compile` makes many runs at once of fields that have an axis for them in front. It is
    # not inherited: what is derived may compute its fields one by one.
    _compiles_many: ClassVar[bool] = False

    def compile(self) -> Compiled:
        """What the core makes of it."""
        raise NotImplementedError

    def compile_runs(self, values: Mapping[str, Floats]) -> Compiled:
        """The same for many runs, an axis in front of every array.

        Args:
            values: Fields that differ between runs -> (runs, ...).

        Raises:
            ValueError: A run's value breaks a rule.
        """
        if vars(type(self)).get("_compiles_many", False):
            many = bare(self, values)
            if getattr(many, "duration", None) is not None:
                time, duration = np.broadcast_arrays(many.time, many.duration)  # type: ignore[attr-defined]
                with np.errstate(over="ignore", invalid="ignore"):
                    short = np.flatnonzero(~(time + duration > time))
                list(runs_of(self, values, short[:1].tolist()))
            return many.compile()
        runs = [run.compile() for run in runs_of(self, values)]
        return stacked(runs, type(self).__name__)

    def to_dict(self) -> dict[str, Any]:
        """As a dictionary, with the `kind` that `from_dict` needs.

        Raises:
            TypeError: The class has no line in `DISTURBANCES`.
        """
        return {
            "kind": kind_of(self, DISTURBANCES, "disturbance.DISTURBANCES"),
            **super().to_dict(),
        }

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """The class by `kind`; a class of its own needs none."""
        found, rest = chosen(Disturbance, cls, DISTURBANCES, data, path)
        result: Self = super(Disturbance, found)._parse(rest, path)
        return result

    def _number(self, name: str, check: Any = checks.finite) -> float:
        value: float = check(f"{type(self).__name__}.{name}", getattr(self, name))
        self._set(name, value)
        return value

    def _pair(self, name: str) -> None:
        self._set(name, checks.pair(f"{type(self).__name__}.{name}", getattr(self, name)))

    def _end(self, time: float) -> None:
        """Checks `duration`: what ends must end later than it starts."""
        duration = self._number("duration", checks.positive)
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

    _compiles_many: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Checks time, force and moment."""
        self._number("time")
        self._pair("force")
        self._number("moment")

    def compile(self) -> Compiled:
        """One break."""
        load = _load(self.force, self.moment)
        return Compiled(forces=(held(_columns(self.time), load[..., None, :], _NONE),))


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

    _compiles_many: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Checks time, duration, force and moment."""
        self._end(self._number("time"))
        self._pair("force")
        self._number("moment")

    def compile(self) -> Compiled:
        """Two breaks; an end that overflows never comes."""
        with np.errstate(over="ignore"):
            end = np.fmin(np.add(self.time, self.duration), np.finfo(np.float64).max)
        load = _load(self.force, self.moment)
        loads = np.stack([load, np.zeros_like(load)], axis=-2)
        return Compiled(forces=(held(_columns(self.time, end), loads, _NONE),))


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

    _compiles_many: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Checks time and impulse."""
        self._number("time")
        self._pair("impulse")
        self._number("angular_impulse")

    def compile(self) -> Compiled:
        """One jump."""
        x, y, turn = np.moveaxis(_load(self.impulse, self.angular_impulse), -1, 0)
        return Compiled(impulses=(_columns(self.time, x, y, turn),))


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

    _compiles_many: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Checks every field."""
        frequency = self._number("frequency_hz", checks.positive)
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
        omega = np.multiply(math.tau, self.frequency_hz)
        x, y, turn = np.moveaxis(_load(self.force, self.moment), -1, 0)
        end = _end(self.time, self.duration)
        return Compiled(sines=(_columns(self.time, end, omega, self.phase, x, y, turn),))


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

    _compiles_many: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Checks every field, and that the rates between samples do not overflow."""
        self._set("times", checks.times("Sampled.times", self.times))
        self._set("force", checks.array("Sampled.force", self.force, ("k", 2)))
        moment = np.zeros(len(self.times)) if self.moment is None else self.moment
        moment = checks.array("Sampled.moment", moment, ("k",))
        self._set("moment", moment)
        checks.same_length("Sampled.force", self.force, "Sampled.times", len(self.times))
        checks.same_length("Sampled.moment", moment, "Sampled.times", len(self.times))
        checks.choice("Sampled.hold", self.hold, HOLDS)
        require_finite("Sampled.times", self.compile().forces[0])

    def compile(self) -> Compiled:
        """A break for each sample."""
        assert self.moment is not None  # __post_init__ has filled it in
        loads = _load(self.force, self.moment)
        join = linear if self.hold == "linear" else held
        return Compiled(forces=(join(self.times, loads, _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Noise(Disturbance):
    """A Gaussian force, drawn anew `rate_hz` times a second and held between, without memory.

    Its random numbers come from a counter (Philox 4x64): sample n of a run depends on seed, run, n
    and the disturbance's place in `Scene.disturbances` alone. `monte_carlo` gives every run a noise
    of its own by setting `seed` to the study's and `run` to the run's number; also where a class is
    derived from this one, but not where another kind of disturbance compiles to noise.

    Attributes:
        force_std: Standard deviation of F_x and F_y, N, or one for each.
        moment_std: Standard deviation of the moment, N m.
        rate_hz: Samples a second, Hz. Steps of integration end at each.
        time: s.
        duration: s; None is for ever.
        seed: From 0 to 2^64 - 1.
        run: The same.
    """

    force_std: float | tuple[float, float]
    moment_std: float
    rate_hz: float
    time: float = 0.0
    duration: float | None = None
    seed: int = 0
    run: int = 0

    _compiles_many: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Checks every field."""
        if checks.read("Noise.force_std", self.force_std).ndim == 0:
            self._number("force_std", checks.non_negative)
        else:
            self._pair("force_std")
            for k, std in enumerate(np.atleast_1d(self.force_std)):
                checks.non_negative(f"Noise.force_std[{k}]", std)
        self._number("moment_std", checks.non_negative)
        self._number("rate_hz", checks.positive)
        time = self._number("time")
        if self.duration is not None:
            self._end(time)
        for name in ("seed", "run"):
            self._set(name, checks.integer(f"Noise.{name}", getattr(self, name), 0, 2**64 - 1))

    def compile(self) -> Compiled:
        """One noise."""
        std = np.asarray(self.force_std)
        # A lone standard deviation is that of both components; of many runs it has their axis.
        pair = np.ndim(self.rate_hz) < std.ndim
        x, y = (std[..., 0], std[..., 1]) if pair else (std, std)
        end = _end(self.time, self.duration)
        row = _columns(x, y, self.moment_std, self.rate_hz, self.time, end)
        return Compiled(noises=((row, self.seed, self.run),))

    def samples(self, count: int, place: int = 0) -> Floats:
        """The first samples of force and moment, (count, 3), N and N m.

        Args:
            count: How many, at most 100 million.
            place: Of the disturbance in `Scene.disturbances`.

        Raises:
            ValueError: An argument is negative or too large.
            TypeError: An argument is no integer.
        """
        count = checks.integer("count", count, 0, _MOST_SAMPLES)
        place = checks.integer("place", place, 0, 2**64 - 1)
        x, y, turn, *_ = self.compile().noises[0][0].tolist()
        return _core.noise((x, y, turn), (self.seed, self.run), place, 0, count)


def _end(time: Any, duration: Any) -> Any:
    """When it ends, s; never where `duration` is None."""
    with np.errstate(over="ignore"):
        return np.asarray(math.inf if duration is None else np.add(time, duration))


# By the `kind` that stands in a scene file.
DISTURBANCES: dict[str, type[Disturbance]] = {
    "step": Step,
    "pulse": Pulse,
    "impulse": Impulse,
    "sine": Sine,
    "sampled": Sampled,
    "noise": Noise,
}
