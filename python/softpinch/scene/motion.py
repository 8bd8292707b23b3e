"""Motions of the hand: position and tilt of its frame over time; each kind is a class.

Every kind compiles itself to piecewise polynomials and sines of X, Y and phi. Velocity and
acceleration are their derivatives, so that the three always agree. A new kind is a class with
`compile`, a constructor of `HandMotion` and a line in `MOTIONS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..support import Floats, Result, checks, read_csv
from ..support.record import Kinded, runs_of
from .piecewise import ROUND_OFF, Piecewise, derivative, evaluate, moves, padded, through

# Pieces of a move: the duration, s, and the share of the way in ascending powers of the time.
_Profile: TypeAlias = Sequence[tuple[Any, Sequence[Any]]]
_AXES = ("x", "y", "tilt")
# Shares of the time of a move below this are round-off.
_NEAR = 1e-14


class CompiledMotion(NamedTuple):
    """A compiled motion. For many runs every array has the runs as its first axis."""

    position: Piecewise  # X and Y, m
    tilt: Piecewise  # phi, rad, in one channel
    # Added at all times, (5,) each: angular frequency, 1/s; phase at time 0, rad; amplitudes of X
    # and Y, m, and of phi, rad.
    sines: tuple[Floats, ...] = ()

    @property
    def acceleration(self) -> Piecewise:
        """Piecewise polynomial of the accelerations of X and Y in fixed axes, m/s^2."""
        return derivative(derivative(self.position))

    def map(self, change: Callable[[Floats], Floats]) -> CompiledMotion:
        """Applies a function to every array."""
        (breaks, rows), (turns, tilts) = self.position, self.tilt
        sines = tuple(map(change, self.sines))
        return CompiledMotion((change(breaks), change(rows)), (change(turns), change(tilts)), sines)

    def core(self) -> tuple[Piecewise, Piecewise, Floats]:
        """The accelerations, the tilt and the sine of many runs, as the core takes them."""
        sine = np.zeros((len(self.tilt[0]), 5))
        if self.sines:
            sine = self.sines[0] * 1.0
            sine[:, 2:4] *= -(sine[:, :1] ** 2)
        arrays = (*self.acceleration, *self.tilt)
        times, accelerations, turns, tilts = map(np.ascontiguousarray, arrays)
        return (times, accelerations), (turns, tilts), sine


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HandState(Result):
    """Place and motion of the hand's frame at instants (...), in fixed axes.

    Attributes:
        position: Place of the frame's origin, the middle of the finger roots (..., 2), m.
        velocity: Its rate (..., 2), m/s; `acceleration` is the next, m/s^2, at a jump after it.
        tilt: Angle phi of the frame, counter-clockwise (...), rad.
        tilt_rate: Its rate (...), rad/s; `tilt_acceleration`, rad/s^2, likewise.
    """

    position: Floats
    velocity: Floats
    acceleration: Floats
    tilt: Floats
    tilt_rate: Floats
    tilt_acceleration: Floats


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class HandMotion(Kinded):
    """The motion of the hand's frame, whose origin is the middle of the finger roots.

    Make one with `HandMotion.minimum_jerk`, `.trapezoid`, `.jerk_limited`, `.sampled`, `.from_csv`,
    `.sine` or `.constant`. All kinds take positions and accelerations in fixed axes, x to the right
    and y upwards (k, 2), m and m/s^2; tilts counter-clockwise (k,), or one constant tilt, rad (None
    is zero); and increasing times (k,) on the clock of the scene, s, before and after which the
    hand rests. No kind has a jump of velocity.
    """

    @staticmethod
    def minimum_jerk(
        times: ArrayLike, points: ArrayLike, tilts: ArrayLike | None = None
    ) -> HandMotion:
        """Moves from point to point, with rest at each time; equal points are a pause.

        With s from 0 to 1 over the time of a move, the fraction of the way is 10 s^3 - 15 s^4 +
        6 s^5 (Flash and Hogan, J. Neurosci. 5, 1985), for the tilt too. The acceleration has no
        jumps, and is zero at every time.

            >>> import softpinch as sp
            >>> motion = sp.HandMotion.minimum_jerk([0.0, 0.5], [[0.0, 0.0], [0.5, 0.25]])
            >>> motion.at(0.25).position.tolist()
            [0.25, 0.125]
        """
        return MinimumJerkMotion(times=times, points=points, tilts=tilts)  # type: ignore[arg-type]

    @staticmethod
    def trapezoid(
        times: ArrayLike, points: ArrayLike, acceleration: float, tilts: ArrayLike | None = None
    ) -> HandMotion:
        """Straight moves with the acceleration constant, then zero, then minus that constant.

        Each move takes all of its time, at the lowest top speed that this leaves (Biagiotti and
        Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 3.2). The
        jumps of the acceleration, whose size is `acceleration`, m/s^2, are breakpoints. The hand
        rests at the points (k, 2) at the times (k,). Tilts move by minimum jerk.

        Raises:
            ValueError: A way of length D has less time than 2 sqrt(D / acceleration).
        """
        return TrapezoidMotion(times=times, points=points, tilts=tilts, acceleration=acceleration)  # type: ignore[arg-type]

    @staticmethod
    def jerk_limited(
        times: ArrayLike,
        points: ArrayLike,
        acceleration: float,
        jerk: float,
        tilts: ArrayLike | None = None,
    ) -> HandMotion:
        """As `trapezoid`, but the acceleration has no jumps: it rises and falls at the rate `jerk`.

        A move has seven segments (Biagiotti and Melchiorri, section 3.4), or five where the speed
        is reached before `acceleration` is. `jerk` is in m/s^3.
        """
        values = {"times": times, "points": points, "tilts": tilts}
        return JerkLimitedMotion(**values, acceleration=acceleration, jerk=jerk)  # type: ignore[arg-type]

    @staticmethod
    def sampled(
        times: ArrayLike,
        positions: ArrayLike | None = None,
        accelerations: ArrayLike | None = None,
        tilts: ArrayLike | None = None,
        hold: bool = False,
    ) -> HandMotion:
        """A measured motion, such as the log of a robot, with positions or accelerations.

        The hand passes positions and tilts without stopping, on quintic polynomials with the least
        integral of the squared jerk, from rest to rest; derivatives up to the fourth have no jumps.
        Accelerations, without gravity, are interpolated linearly and integrated from rest at the
        origin; after the last sample they are zero, and the hand keeps the velocity it has. With
        `hold` each is held until the next time instead, and the last one from then on.

            >>> import softpinch as sp
            >>> motion = sp.HandMotion.sampled([0.0, 0.1], positions=[[0.0, 0.0], [0.01, 0.0]])
        """
        values = {"positions": positions, "accelerations": accelerations, "tilts": tilts}
        return SampledMotion(times=times, **values, hold=hold)  # type: ignore[arg-type]

    @staticmethod
    def from_csv(path: str | Path, kind: str = "positions", hold: bool = False) -> HandMotion:
        """Reads a log for `sampled`, of the columns time, x, y and perhaps tilt, below a heading.

        `kind` is "positions" or "accelerations". Positions and tilts rest at both ends, so a log
        that is cut in a move is refused: in its first and in its last interval the speed may be at
        most half of that in the interval beside it, or 5 % of the largest one.
        """
        checks.choice("kind", kind, ("positions", "accelerations"))
        table = read_csv(path, (3, 4), "three or four columns of numbers: time, x, y and tilt")
        times, values, tilts = np.split(table, [1, 3], axis=1)
        given: dict[str, Any] = {kind: values, "tilts": tilts[:, 0] if tilts.size else None}
        motion = SampledMotion(times=times[:, 0], **given, hold=hold)
        for rows in (values * (kind == "positions"), tilts):
            speeds = np.sqrt((np.diff(rows, axis=0) ** 2).sum(axis=1)) / np.diff(motion.times)
            for which, ends in (("first", speeds[:2]), ("last", speeds[:-3:-1])):
                if len(ends) > 1 and ends[0] > max(0.5 * ends[1], 0.05 * speeds.max()):
                    moves = f"moves at {ends[0]:.3g} m/s or rad/s in its {which} interval"
                    raise ValueError(f"{path}: {moves}, must begin and end at rest")
        return motion

    @staticmethod
    def sine(
        amplitude: float, frequency: float, axis: str | float, phase: float = 0.0, tilt: float = 0.0
    ) -> HandMotion:
        """Shaking at all times: amplitude sin(2 pi frequency t + phase) along or about one axis.

        The peak acceleration is amplitude (2 pi frequency)^2. Unless a run starts at a peak, the
        hand is already moving then, and an object at rest in its frame moves with it.

        Args:
            amplitude: Amplitude of the position, m; about the axis "tilt" that of the tilt, rad.
            frequency: Frequency, Hz.
            axis: "x", "y" or "tilt"; or the angle from x to the direction, counter-clockwise, rad.
            phase, tilt: Phase at time 0 and mean tilt, rad.
        """
        values = {"amplitude": amplitude, "frequency": frequency, "phase": phase, "tilt": tilt}
        return SineMotion(**values, axis=axis)

    @staticmethod
    def constant(acceleration: ArrayLike = (0.0, 0.0), tilt: float = 0.0) -> HandMotion:
        """Constant acceleration (2,), m/s^2, and tilt, rad, at all times; at rest at time 0."""
        return ConstantMotion(acceleration=acceleration, tilt=tilt)  # type: ignore[arg-type]

    def at(self, t: ArrayLike) -> HandState:
        """Returns place and motion of the frame at times `t` (...), s."""
        t = checks.numbers("t", t)
        checks.require_finite("t", t)
        position, tilt, sines = self.compile()
        orders = []
        for order in range(3):
            values = np.concatenate([evaluate(position, t), evaluate(tilt, t)], axis=-1)
            for omega, phase, *amplitudes in sines:
                angle = omega * t + phase
                wave = (np.sin(angle), np.cos(angle), -np.sin(angle))[order]
                values += np.multiply.outer(omega**order * wave, amplitudes)
            orders.append(values)
            position, tilt = derivative(position), derivative(tilt)
        place, velocity, acceleration = orders
        return HandState(
            position=place[..., :2],
            velocity=velocity[..., :2],
            acceleration=acceleration[..., :2],
            tilt=place[..., 2],
            tilt_rate=velocity[..., 2],
            tilt_acceleration=acceleration[..., 2],
        )

    def breakpoints(self, begin: float, end: float) -> Floats:
        """Returns the instants (k,), s, between `begin` and `end` at which polynomials change."""
        begin, end = checks.finite("begin", begin), checks.finite("end", end)
        position, tilt, _ = self.compile()
        instants = np.unique(np.concatenate([position[0], tilt[0]]))
        return instants[(begin < instants) & (instants < end)]

    def compile(self) -> CompiledMotion:
        """Returns the motion as polynomials and sines."""
        raise NotImplementedError

    def compile_runs(self, values: Mapping[str, Floats]) -> CompiledMotion:
        """As `compile`, of runs that differ in `values` (runs, ...), the first axis of arrays."""
        position, tilt, sines = zip(*(run.compile() for run in runs_of(self, values)), strict=True)
        stacked = tuple(map(np.stack, zip(*sines, strict=True)))
        return CompiledMotion(padded(position), padded(tilt), stacked)

    def _call(self) -> tuple[str, dict[str, Any]]:
        names = {cls: f"HandMotion.{kind}" for kind, cls in MOTIONS.items()}
        function, arguments = super()._call()
        return names.get(type(self), function), arguments

    def _check(self, rule: Callable[[str, Any], Any], *names: str) -> None:
        for name in names:
            self._set(name, rule(f"HandMotion.{name}", getattr(self, name)))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TimedMotion(HandMotion):
    """A motion with rows for increasing times; the tilt moves between them, or is one number."""

    times: Floats
    tilts: float | Floats = 0.0

    def __post_init__(self) -> None:
        self._check(checks.times, "times")
        if self.tilts is None:
            self._set("tilts", 0.0)
        if checks.read("HandMotion.tilts", self.tilts).ndim == 0:
            self._check(checks.finite, "tilts")
        else:
            self._check_rows("tilts", "k")
        self._check_own()
        with np.errstate(all="ignore"):
            position, tilt, _ = self.compile()
        for breaks, rows in (position, tilt):
            if not np.isfinite(rows).all() or (np.diff(breaks) <= 0.0).any():
                why = "too close together, pieces have no length or overflow"
                raise ValueError(f"HandMotion.times: {why}")

    def _check_own(self) -> None:
        raise NotImplementedError

    def _check_rows(self, name: str, *shape: int | str) -> None:
        """Checks an array with a row for each time."""
        rows = checks.array(f"HandMotion.{name}", getattr(self, name), shape, "a row for each time")
        checks.same_length(f"HandMotion.{name}", rows, "HandMotion.times", len(self.times))
        self._set(name, rows)

    def _tilt(self, join: Callable[[Floats, Floats], Piecewise]) -> Piecewise:
        tilts = np.asarray(self.tilts)
        return join(self.times, tilts[:, None]) if tilts.ndim else _constant(tilts)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MinimumJerkMotion(TimedMotion):
    """See `HandMotion.minimum_jerk`."""

    points: Floats

    def _check_own(self) -> None:
        self._check_rows("points", "k", 2)

    def compile(self) -> CompiledMotion:
        """Returns one quintic for each move."""
        return CompiledMotion(_quintics(self.times, self.points), self._tilt(_quintics))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class TrapezoidMotion(MinimumJerkMotion):
    """See `HandMotion.trapezoid`."""

    acceleration: float

    def _limits(self) -> tuple[float, float]:
        """The largest acceleration, m/s^2, and the largest jerk, m/s^3."""
        return self.acceleration, math.inf

    def _check_own(self) -> None:
        super()._check_own()
        self._check(checks.positive, "acceleration")
        acceleration, jerk = self._limits()
        lag = acceleration / jerk
        for k, way in enumerate(_lengths(self.points).tolist()):
            least = lag + math.sqrt(lag**2 + 4.0 * way / acceleration)
            if way < 2.0 * acceleration * lag**2:
                least = math.cbrt(32.0 * way / jerk)
            begin, end = self.times[k : k + 2].tolist()
            if end - begin < least - ROUND_OFF * max(abs(begin), abs(end)):
                why = f"the way of {way} m from points[{k}] on takes {least} s"
                rule = f"must be at least {begin + least}, because {why}"
                raise ValueError(f"HandMotion.times[{k + 1}] = {end}: {rule}")

    def compile(self) -> CompiledMotion:
        """Returns up to three pieces for each move, or seven if the jerk is limited."""
        moves = zip(_lengths(self.points), np.diff(self.times), strict=True)
        profiles = [_limited(way, time, *self._limits()) for way, time in moves]
        return CompiledMotion(_moves(self.times, self.points, profiles), self._tilt(_quintics))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JerkLimitedMotion(TrapezoidMotion):
    """See `HandMotion.jerk_limited`."""

    jerk: float

    def _limits(self) -> tuple[float, float]:
        return self.acceleration, self.jerk

    def _check_own(self) -> None:
        self._check(checks.positive, "jerk")
        super()._check_own()


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SampledMotion(TimedMotion):
    """See `HandMotion.sampled`."""

    positions: Floats | None = None
    accelerations: Floats | None = None
    hold: bool = False

    def _check_own(self) -> None:
        given = [n for n in ("positions", "accelerations") if getattr(self, n) is not None]
        if len(given) == 2:
            raise ValueError("HandMotion.accelerations: must not be given together with positions")
        if not given and isinstance(self.tilts, float):
            raise ValueError("HandMotion.positions: are missing; so are accelerations and tilts")
        for name in given:
            self._check_rows(name, "k", 2)
        self._check(checks.boolean, "hold")
        if self.hold and self.accelerations is None:
            raise ValueError("HandMotion.hold = True: holds accelerations, which are not given")

    def compile(self) -> CompiledMotion:
        """Returns quintics through positions and tilts, and cubics from accelerations."""
        position = _constant(0.0, 0.0)
        if self.positions is not None:
            position = through(self.times, self.positions)
        elif self.accelerations is not None:
            position = _integrated(self.times, self.accelerations, self.hold)
        return CompiledMotion(position, self._tilt(through))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SineMotion(HandMotion):
    """See `HandMotion.sine`."""

    amplitude: float
    frequency: float
    axis: str | float
    phase: float = 0.0
    tilt: float = 0.0

    def __post_init__(self) -> None:
        self._check(checks.finite, "amplitude", "phase", "tilt")
        self._check(checks.positive, "frequency")
        if isinstance(self.axis, str):
            checks.choice("HandMotion.axis", self.axis, _AXES)
        else:
            self._check(checks.finite, "axis")
        if not math.isfinite(self.amplitude * math.tau**2 * self.frequency * self.frequency):
            rule = "the acceleration must be finite"
            raise ValueError(f"HandMotion.frequency = {self.frequency}: {rule}")

    def compile(self) -> CompiledMotion:
        """Returns one sine, about a constant tilt."""
        if isinstance(self.axis, str):
            direction = np.eye(3)[_AXES.index(self.axis)]
        else:
            direction = np.array([np.cos(self.axis), np.sin(self.axis), 0.0])
        sine = np.array([math.tau * self.frequency, self.phase, *(self.amplitude * direction)])
        return CompiledMotion(_constant(0.0, 0.0), _constant(self.tilt), (sine,))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ConstantMotion(HandMotion):
    """See `HandMotion.constant`."""

    acceleration: tuple[float, float] = (0.0, 0.0)
    tilt: float = 0.0

    def __post_init__(self) -> None:
        self._check(checks.pair, "acceleration")
        self._check(checks.finite, "tilt")

    def compile(self) -> CompiledMotion:
        """Returns a parabola without breaks, whose time is that of the clock."""
        breaks, accelerations = _constant(*self.acceleration)
        return CompiledMotion((breaks, accelerations * [0.0, 0.0, 0.5]), _constant(self.tilt))


def _constant(*values: Any) -> Piecewise:
    return np.zeros(0), np.array(values)[None, :, None]


def _lengths(points: Floats) -> Floats:
    return np.asarray(np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1)))


def _quintics(times: Floats, points: Floats) -> Piecewise:
    """Moves by minimum jerk from each of the points (k, channels) to the next."""
    return moves(times[:-1], points, np.diff(times))


def _limited(way: Any, time: Any, acceleration: Any, jerk: Any) -> _Profile:
    """The move over `way`, m, with the lowest top speed that is possible in `time`, s.

    The acceleration rises during `ramp`, is constant during `held` and falls during `ramp`; the
    speed is constant during `cruise`; then follows the same with the opposite sign. The top speed
    is v = acceleration (ramp + held), and way = v (time - 2 ramp - held). Comparisons take real
    parts, because derivatives of inputs come from complex numbers (directions.py).
    """
    if not np.real(way):
        return [(time, [0.0])]
    lag = acceleration / jerk
    excess = way - acceleration * lag * (time - 2.0 * lag)
    if np.real(excess) > 0.0 and np.real(time - 4.0 * lag) >= 0.0:
        inner = time - lag
        square = inner * inner - 4.0 * way / acceleration
        root = np.sqrt(square) if np.real(square - lag * lag) > _NEAR * np.real(time) ** 2 else lag
        ramp, held, cruise = lag, 2.0 * way / acceleration / (inner + root) - lag, root - lag
    else:
        # The acceleration stays below its limit: way = jerk ramp^2 (time - 2 ramp), solved for the
        # smallest root in terms of its sine.
        share = way / jerk / time / time / time
        third = np.arcsin(np.sqrt(27.0 * share)) / 3.0
        ramp = 2.0 / 3.0 * time * np.sin(third) * np.sin(third + math.pi / 3.0)
        held, cruise = 0.0, time - 4.0 * ramp
    # These follow from the durations, so that the end is met to round-off.
    peak = 1.0 / (ramp + held) / (time - 2.0 * ramp - held)
    rise = peak / ramp if np.real(ramp) else 0.0
    starts = [0.0, peak, peak, 0.0, 0.0, -peak, -peak]
    slopes = [rise, 0.0, -rise, 0.0, -rise, 0.0, rise]
    durations = [ramp, held, ramp, cruise, ramp, held, ramp]
    place, speed, pieces = 0.0, 0.0, list[tuple[Any, Sequence[Any]]]()
    for duration, start, slope in zip(durations, starts, slopes, strict=True):
        if np.real(duration) > _NEAR * np.real(time):
            pieces.append((duration, [place, speed, start / 2.0, slope / 6.0]))
            place += duration * (speed + duration * (start / 2.0 + duration * slope / 6.0))
            speed += duration * (start + duration * slope / 2.0)
    return pieces


def _moves(times: Floats, points: Floats, profiles: Sequence[_Profile]) -> Piecewise:
    """Moves from each of the points (k, channels) to the next, and rest before and after them."""
    width = max((len(share) for profile in profiles for _, share in profile), default=1)

    def row(place: Floats, way: Floats, share: Sequence[Any]) -> Floats:
        coefficients = np.outer(way, [*share, *[0.0] * (width - len(share))])
        coefficients[:, 0] += place
        return coefficients

    breaks, rows, still = [], [], np.zeros_like(points[0])
    moves = zip(times[:-1], points[:-1], np.diff(points, axis=0), profiles, strict=True)
    for start, place, way, profile in moves:
        for duration, share in profile:
            breaks.append(start)
            rows.append(row(place, way, share))
            start = start + duration
    rows = [row(points[0], still, []), *rows, row(points[-1], still, [])]
    return np.array([*breaks, times[-1]]), np.array(rows)


def _integrated(times: Floats, accelerations: Floats, hold: bool) -> Piecewise:
    """The motion from rest at zero with accelerations (k, channels) that are linear, or held."""
    h, before = np.diff(times)[:, None], accelerations[:-1]
    after = before if hold else accelerations[1:]
    rows = np.zeros((len(times) + 1, 2, 4), np.result_type(times, accelerations))
    rows[2:, :, 1] = np.cumsum(h * (before + after) / 2.0, axis=0)
    rows[2:, :, 0] = np.cumsum(h * (rows[1:-1, :, 1] + h * (2.0 * before + after) / 6.0), axis=0)
    rows[1:-1, :, 2], rows[1:-1, :, 3] = before / 2.0, (after - before) / h / 6.0
    if hold:
        rows[-1, :, 2] = accelerations[-1] / 2.0
    return times, rows


# The entry `kind` of a scene file, and the name of the constructor -> class.
MOTIONS: dict[str, type[HandMotion]] = {
    "minimum_jerk": MinimumJerkMotion,
    "trapezoid": TrapezoidMotion,
    "jerk_limited": JerkLimitedMotion,
    "sampled": SampledMotion,
    "sine": SineMotion,
    "constant": ConstantMotion,
}
HandMotion._kinds = MOTIONS
