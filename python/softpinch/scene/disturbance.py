"""Disturbances: forces in N at the grasped object's centre of gravity, and moments in N m.

Each class compiles itself to the input types of the core: piecewise polynomials, sinusoids,
impulses and noise. A new disturbance is a class with `compile` and a line in `DISTURBANCES`.
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
from ..support.choices import Hold
from ..support.kinds import chosen, kind_of
from ..support.record import Record, bare, runs_of
from .compiled import Compiled, stacked
from .piecewise import held, linear, require_finite
from .schedule import HOLDS

_NONE = np.zeros(3)
# The most samples that `Noise.samples` returns: ten times the most that one run may use; 2.4 GB.
_MOST_SAMPLES = 100_000_000


def _columns(*parts: Any) -> Floats:
    """Broadcasts numbers or arrays (...) and stacks them along a new last axis (..., parts)."""
    whole = np.stack(np.broadcast_arrays(*parts), axis=-1)
    # Derivatives of a disturbance come from complex numbers (directions.py).
    return whole.astype(np.result_type(np.float64, whole), copy=False)


def _load(force: Any, moment: Any) -> Floats:
    """Joins a force (..., 2) and a moment (...) to a load (..., 3)."""
    force = np.asarray(force)
    return _columns(force[..., 0], force[..., 1], moment)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Disturbance(Record):
    """Base class of the disturbances."""

    # Whether `compile` also accepts fields with the runs as a first axis. The flag is read from the
    # class itself and not inherited, because a derived class may only handle scalar fields.
    _compiles_many: ClassVar[bool] = False

    def compile(self) -> Compiled:
        """Returns the arrays for the core."""
        raise NotImplementedError

    def compile_runs(self, values: Mapping[str, Floats]) -> Compiled:
        """Returns the arrays for many runs, with the runs as the first axis of every array.

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
        """Converts to a dictionary with the entry `kind`, which `from_dict` needs.

        Raises:
            TypeError: The class is not in `DISTURBANCES`.
        """
        return {
            "kind": kind_of(self, DISTURBANCES, "disturbance.DISTURBANCES"),
            **super().to_dict(),
        }

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """Selects the class by `kind`, which is optional if `cls` is a derived class."""
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
        """Checks `duration`: it must not vanish in round-off when added to `time`."""
        duration = self._number("duration", checks.positive)
        if time + duration <= time:
            raise ValueError(
                f"{type(self).__name__}.duration = {duration}: "
                f"must be long enough to end later than time = {time}"
            )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Step(Disturbance):
    """A constant force and moment that start at `time` and never end.

    Attributes:
        time: Start, s.
        force: (F_x, F_y), N.
        moment: Moment, counter-clockwise, N m.
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
        """Returns a piecewise polynomial with one break."""
        load = _load(self.force, self.moment)
        return Compiled(forces=(held(_columns(self.time), load[..., None, :], _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Pulse(Disturbance):
    """A constant force and moment from `time` until `time + duration`.

    Attributes:
        time: Start, s.
        duration: Length, s.
        force: (F_x, F_y), N.
        moment: Moment, counter-clockwise, N m.
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
        """Returns a piecewise polynomial with two breaks. An overflowing end is never reached."""
        with np.errstate(over="ignore"):
            end = np.fmin(np.add(self.time, self.duration), np.finfo(np.float64).max)
        load = _load(self.force, self.moment)
        loads = np.stack([load, np.zeros_like(load)], axis=-2)
        return Compiled(forces=(held(_columns(self.time, end), loads, _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Impulse(Disturbance):
    """An ideal impulse: the velocities jump at `time` and still satisfy the constraints.

    It acts if the run's start <= `time` < the run's end. The row recorded at that instant is the
    state before the jump.

    Attributes:
        time: Instant, s.
        impulse: (J_x, J_y), N s.
        angular_impulse: Moment impulse, counter-clockwise, N m s.
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
        """Returns one impulse."""
        x, y, turn = np.moveaxis(_load(self.impulse, self.angular_impulse), -1, 0)
        return Compiled(impulses=(_columns(self.time, x, y, turn),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sine(Disturbance):
    """F sin(2 pi f (t - time) + phase) from `time` until `time + duration`, or without end.

    Attributes:
        frequency_hz: Frequency f, Hz.
        force: Amplitudes (F_x, F_y), N.
        moment: Amplitude of the moment, counter-clockwise, N m.
        phase: Phase at `time`, rad.
        time: Start, s.
        duration: Length, s; None never ends.
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
        """Returns one sinusoid."""
        omega = np.multiply(math.tau, self.frequency_hz)
        x, y, turn = np.moveaxis(_load(self.force, self.moment), -1, 0)
        end = _end(self.time, self.duration)
        return Compiled(sines=(_columns(self.time, end, omega, self.phase, x, y, turn),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sampled(Disturbance):
    """Samples of a force and a moment, for example measured data.

    The force is zero before the first sample; the last sample is held without end.

    Attributes:
        times: Increasing instants (k,), s.
        force: (F_x, F_y) at these instants (k, 2), N.
        moment: Moments, counter-clockwise, (k,), N m; None is zero moment.
        hold: "zero" holds each sample until the next; "linear" interpolates between samples.
    """

    times: NDArray[np.float64]
    force: NDArray[np.float64]
    moment: NDArray[np.float64] | None = None
    hold: Hold = "zero"

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
        """Returns a piecewise polynomial with a break at each sample."""
        assert self.moment is not None  # __post_init__ has filled it in
        loads = _load(self.force, self.moment)
        join = linear if self.hold == "linear" else held
        return Compiled(forces=(join(self.times, loads, _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Noise(Disturbance):
    """Gaussian white noise, sampled `rate_hz` times a second; each sample is held until the next.

    The random numbers come from the counter-based generator Philox 4x64: sample n depends only on
    `seed`, `run`, n and the disturbance's index in `Scene.disturbances`. In `monte_carlo` every run
    has its own noise, because `seed` becomes the study's seed and `run` the run's number. This
    includes classes derived from `Noise`, but no other disturbance whose `compile` returns noise.

    Attributes:
        force_std: Standard deviation of both F_x and F_y, N, or a pair with one for each.
        moment_std: Standard deviation of the moment, N m.
        rate_hz: Samples per second, Hz. Integration steps end at every sample.
        time: Start, s.
        duration: Length, s; None never ends.
        seed: Seed of the random numbers, from 0 to 2^64 - 1.
        run: Run number, from 0 to 2^64 - 1; noises of different runs are independent.
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
        """Returns one noise."""
        std = np.asarray(self.force_std)
        # With many runs every field has one more axis, so compare with the axes of a scalar field.
        pair = np.ndim(self.rate_hz) < std.ndim
        x, y = (std[..., 0], std[..., 1]) if pair else (std, std)
        end = _end(self.time, self.duration)
        row = _columns(x, y, self.moment_std, self.rate_hz, self.time, end)
        return Compiled(noises=((row, self.seed, self.run),))

    def samples(self, count: int, place: int = 0) -> Floats:
        """Returns the first samples of F_x, F_y, N, and moment, N m, (count, 3).

        Args:
            count: Number of samples, at most 100 million.
            place: Index of the disturbance in `Scene.disturbances`.

        Raises:
            ValueError: An argument is negative or too large.
            TypeError: An argument is not an integer.
        """
        count = checks.integer("count", count, 0, _MOST_SAMPLES)
        place = checks.integer("place", place, 0, 2**64 - 1)
        x, y, turn, *_ = self.compile().noises[0][0].tolist()
        return _core.noise((x, y, turn), (self.seed, self.run), place, 0, count)


def _end(time: Any, duration: Any) -> Any:
    """Returns the end time, s, which is infinite if `duration` is None."""
    with np.errstate(over="ignore"):
        return np.asarray(math.inf if duration is None else np.add(time, duration))


# The entry `kind` of a scene file -> class.
DISTURBANCES: dict[str, type[Disturbance]] = {
    "step": Step,
    "pulse": Pulse,
    "impulse": Impulse,
    "sine": Sine,
    "sampled": Sampled,
    "noise": Noise,
}
