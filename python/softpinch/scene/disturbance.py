"""Disturbances: forces in N at the grasped object's centre of gravity, and moments in N m.

Each class compiles itself to the input types of the core: piecewise polynomials, sinusoids,
impulses and noise. A new disturbance is a class with `compile` and a line in `DISTURBANCES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from .. import _core
from ..support import Floats, Hold, checks
from ..support.record import Kinded, bare, runs_of
from .piecewise import Piecewise, held, linear, padded, require_finite
from .schedule import HOLDS

_NONE = np.zeros(3)
# The checks of fields by their names, which have one meaning in all classes below.
_RULES: dict[str, Callable[[str, Any], Any]] = {
    "time": checks.finite,
    "duration": checks.positive,
    "force": checks.pair,
    "moment": checks.finite,
    "impulse": checks.pair,
    "angular_impulse": checks.finite,
    "frequency_hz": checks.positive,
    "phase": checks.finite,
    "moment_std": checks.non_negative,
    "rate_hz": checks.positive,
}
# The most samples that `Noise.samples` returns: ten times the most that one run may use; 2.4 GB.
_MOST_SAMPLES = 100_000_000


class Compiled(NamedTuple):
    """A compiled disturbance. For many runs every array has the runs as its first axis."""

    forces: tuple[Piecewise, ...] = ()  # F_x and F_y, N, and moment, N m
    # (7,) each: start and end, s; angular frequency, 1/s; phase, rad; amplitudes of the forces.
    sines: tuple[Floats, ...] = ()
    impulses: tuple[Floats, ...] = ()  # (4,) each: time, s; J_x and J_y, N s; J_theta, N m s
    # (6,) or (8,), seed and run, each: standard deviations of the forces; sample rate, Hz; start
    # and end, s; standard deviations of the hand's acceleration along fixed axes, m/s^2.
    noises: tuple[tuple[Floats, int, int], ...] = ()

    def map(self, function: Callable[[Floats], Floats]) -> Compiled:
        """Returns the loads with a function of each array."""
        return Compiled(
            forces=tuple((function(breaks), function(rows)) for breaks, rows in self.forces),
            sines=tuple(map(function, self.sines)),
            impulses=tuple(map(function, self.impulses)),
            noises=tuple((function(row), seed, run) for row, seed, run in self.noises),
        )

    def instants(self) -> list[float]:
        """Returns the sorted instants of one run at which a load begins, changes or ends, s."""
        times = [time for breaks, _ in self.forces for time in breaks.tolist()]
        times += [edge for sine in self.sines for edge in sine[:2].tolist()]
        times += [edge for row, _, _ in self.noises for edge in row[4:6].tolist()]
        return sorted(times + [float(impulse[0]) for impulse in self.impulses])


def stacked(runs: Sequence[Compiled], owner: str) -> Compiled:
    """Stacks a disturbance of class `owner`, compiled for each run, along a new first axis."""
    counts = [list(map(len, run)) for run in runs]
    for k, count in enumerate(counts):
        if count != counts[0]:
            rule = f"must give as many of {', '.join(Compiled._fields)} as in run 0, {counts[0]}"
            raise ValueError(f"run {k}: {owner}.compile gave {count}: {rule}")
    return Compiled(
        forces=tuple(map(padded, zip(*(run.forces for run in runs), strict=True))),
        sines=tuple(map(np.stack, zip(*(run.sines for run in runs), strict=True))),
        impulses=tuple(map(np.stack, zip(*(run.impulses for run in runs), strict=True))),
        noises=tuple(
            (np.stack([rows for rows, _, _ in same]), same[0][1], same[0][2])
            for same in zip(*(run.noises for run in runs), strict=True)
        ),
    )


def _columns(*parts: Any) -> Floats:
    """Stacks numbers or arrays (...) along a new last axis (..., parts)."""
    whole = np.stack(np.broadcast_arrays(*parts), axis=-1)
    # Derivatives of a disturbance come from complex numbers (directions.py).
    return whole.astype(np.result_type(np.float64, whole), copy=False)


def _load(force: Any, moment: Any, *before: Any) -> Floats:
    """Joins a force (..., 2) and a moment (...) to a load (..., 3), behind numbers `before` it."""
    force = np.asarray(force)
    return _columns(*before, force[..., 0], force[..., 1], moment)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Disturbance(Kinded):
    """Base class of the disturbances."""

    def compile(self) -> Compiled:
        """Returns the arrays for the core."""
        raise NotImplementedError

    def compile_runs(self, values: Mapping[str, Floats]) -> Compiled:
        """As `compile`, of runs that differ in `values` (runs, ...), the first axis of arrays."""
        # The built-in classes also compile fields with the runs as a first axis; others may only
        # handle the fields of one run.
        if type(self) in DISTURBANCES.values():
            many = bare(self, values)
            if getattr(many, "duration", None) is not None:
                time, duration = np.broadcast_arrays(many.time, many.duration)  # type: ignore[attr-defined]
                with np.errstate(over="ignore", invalid="ignore"):
                    short = np.flatnonzero(~(time + duration > time))
                list(runs_of(self, values, short[:1].tolist()))
            return many.compile()
        runs = [run.compile() for run in runs_of(self, values)]
        return stacked(runs, type(self).__name__)


class _Plain(Disturbance):
    """Base class of the disturbances whose fields are numbers and pairs."""

    def __post_init__(self) -> None:
        kind = type(self).__name__
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in _RULES and not (value is None and f.default is None):
                self._set(f.name, _RULES[f.name](f"{kind}.{f.name}", value))
        duration: float | None = getattr(self, "duration", None)
        if duration is None:
            return
        time: float = self.time  # type: ignore[attr-defined]
        if time + duration <= time:
            rule = f"must be long enough to end later than time = {time}"
            raise ValueError(f"{kind}.duration = {duration}: {rule}")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Step(_Plain):
    """A constant force (F_x, F_y), N, and counter-clockwise moment, N m, from `time`, s, on."""

    time: float
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0

    def compile(self) -> Compiled:
        """Returns a piecewise polynomial with one break."""
        load = _load(self.force, self.moment)
        return Compiled(forces=(held(_columns(self.time), load[..., None, :], _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Pulse(_Plain):
    """A force and a moment as of `Step`, but only until `time + duration`, s."""

    time: float
    duration: float
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0

    def compile(self) -> Compiled:
        """Returns a piecewise polynomial with two breaks. An overflowing end is never reached."""
        with np.errstate(over="ignore"):
            end = np.fmin(np.add(self.time, self.duration), np.finfo(np.float64).max)
        load = _load(self.force, self.moment)
        loads = np.stack([load, np.zeros_like(load)], axis=-2)
        return Compiled(forces=(held(_columns(self.time, end), loads, _NONE),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Impulse(_Plain):
    """An ideal impulse (J_x, J_y), N s, with a counter-clockwise angular impulse, N m s.

    The velocities jump at `time`, s, and still satisfy the constraints. It acts if the run's start
    <= `time` < the run's end. The row recorded at that instant is the state before the jump.
    """

    time: float
    impulse: tuple[float, float] = (0.0, 0.0)
    angular_impulse: float = 0.0

    def compile(self) -> Compiled:
        """Returns one impulse."""
        return Compiled(impulses=(_load(self.impulse, self.angular_impulse, self.time),))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sine(_Plain):
    """F sin(2 pi f (t - time) + phase) from `time` until `time + duration`, or without end.

    Attributes:
        frequency_hz: Frequency f, Hz; `phase`, rad, is at `time`.
        force: Amplitudes (F_x, F_y), N; `moment` is that of the counter-clockwise moment, N m.
        time: Start, s; a `duration`, s, of None never ends.
    """

    frequency_hz: float
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0
    phase: float = 0.0
    time: float = 0.0
    duration: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not math.isfinite(math.tau * self.frequency_hz):
            rule = "2 pi times it must be finite"
            raise ValueError(f"Sine.frequency_hz = {self.frequency_hz}: {rule}")

    def compile(self) -> Compiled:
        """Returns one sinusoid."""
        omega = np.multiply(math.tau, self.frequency_hz)
        wave = (self.time, _end(self.time, self.duration), omega, self.phase)
        return Compiled(sines=(_load(self.force, self.moment, *wave),))


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

    times: Floats
    force: Floats
    moment: Floats | None = None
    hold: Hold = "zero"

    def __post_init__(self) -> None:
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
class Noise(_Plain):
    """Gaussian white noise, sampled `rate_hz` times a second; each sample is held until the next.

    The random numbers come from the counter-based generator Philox 4x64: sample n depends only on
    `seed`, `run`, n and the disturbance's index in `Scene.disturbances`. In `monte_carlo` every run
    has its own noise, because `seed` becomes the study's seed and `run` the run's number. This
    includes classes derived from `Noise`, but no other disturbance whose `compile` returns noise.

    Attributes:
        force_std: Standard deviation of both F_x and F_y, N, or a pair with one for each.
        moment_std: Standard deviation of the moment, N m.
        acceleration_std: Standard deviation of the acceleration of the hand's frame along both
            fixed axes, m/s^2, or a pair with one for each: shaking of the base, beside the motion
            of a scene that has one. `Run.hand` is the motion without it.
        rate_hz: Samples per second, Hz. Integration steps end at every sample.
        time: Start, s; a `duration`, s, of None never ends.
        seed: Seed of the random numbers, from 0 to 2^64 - 1.
        run: Run number, from 0 to 2^64 - 1; noises of different runs are independent.
    """

    force_std: float | tuple[float, float] = 0.0
    moment_std: float = 0.0
    rate_hz: float
    acceleration_std: float | tuple[float, float] = 0.0
    time: float = 0.0
    duration: float | None = None
    seed: int = 0
    run: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("force_std", "acceleration_std"):
            field, value = f"Noise.{name}", getattr(self, name)
            if checks.read(field, value).ndim == 0:
                self._set(name, checks.non_negative(field, value))
                continue
            self._set(name, checks.pair(field, value))
            for k, std in enumerate(getattr(self, name)):
                checks.non_negative(f"{field}[{k}]", std)
        for name in ("seed", "run"):
            self._set(name, checks.integer(f"Noise.{name}", getattr(self, name), 0, 2**64 - 1))

    def compile(self) -> Compiled:
        """Returns one noise."""
        parts = []
        for std in map(np.asarray, (self.force_std, self.acceleration_std)):
            # With many runs every field has one more axis, so compare with those of a scalar field.
            pair = np.ndim(self.rate_hz) < std.ndim
            parts += [std[..., 0], std[..., 1]] if pair else [std, std]
        end = _end(self.time, self.duration)
        x, y, *shaking = parts
        row = _columns(x, y, self.moment_std, self.rate_hz, self.time, end, *shaking)
        return Compiled(noises=((row, self.seed, self.run),))

    def samples(self, count: int, place: int = 0) -> Floats:
        """Returns the first samples of F_x, F_y, N, and moment, N m, (count, 3), at most 10^8.

        They are those of the noise at the index `place` of `Scene.disturbances`.
        """
        count = checks.integer("count", count, 0, _MOST_SAMPLES)
        place = checks.integer("place", place, 0, 2**64 - 1)
        x, y, turn, *_ = self.compile().noises[0][0].tolist()
        return _core.noise((x, y, turn), (self.seed, self.run), place, 0, count)


def _end(time: Any, duration: Any) -> Any:
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
Disturbance._kinds = DISTURBANCES
