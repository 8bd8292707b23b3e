"""Schedules of target angles, and the piecewise polynomials that represent inputs over time.

A piecewise polynomial is `(breaks, coefficients)`: breaks (m,) in seconds, coefficients
(m + 1, channels, degree + 1) in ascending powers of the time since the start of the piece. Row 0 is
constant and holds before the first break; the last row has no end. All functions here also make
many at once: if times or values have extra first axes (runs, ...), the result has them too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support import checks
from ..support.arrays import Floats
from ..support.record import Record, bare, runs_of

Piecewise: TypeAlias = tuple[Floats, Floats]

HOLDS = ("zero", "linear")
KINDS = ("steps", "ramps", "minimum_jerk", "sampled")
# Kind -> the field that this kind needs in addition to times and angles.
_OWN = {"minimum_jerk": "move_time", "sampled": "hold"}
# A gap or overlap below this share of the time is round-off between consecutive moves.
_ROUND_OFF = 4 * float(np.finfo(np.float64).eps)
# Breaks from this time on, s, are later than the end of any run.
_NEVER = 2.0**1022


def held(times: Floats, values: Floats, before: Floats) -> Piecewise:
    """Holds `values[k]` (k, channels) from `times[k]` on; before times[0], `before` (channels,)."""
    return _joined(times, _behind(before, values)[..., None])


def linear(times: Floats, values: Floats, before: Floats) -> Piecewise:
    """Interpolates linearly between knots; holds `before` ahead of them, the last value after."""
    with np.errstate(over="ignore", invalid="ignore"):
        slopes = np.diff(values, axis=-2) / np.diff(times)[..., None]
    flat = np.zeros((*slopes.shape[:-2], 1, slopes.shape[-1]))
    slopes = np.concatenate([flat, slopes, flat], axis=-2)
    return _joined(times, np.stack(np.broadcast_arrays(_behind(before, values), slopes), axis=-1))


def _behind(before: Floats, values: Floats) -> Floats:
    """Prepends `before` (..., channels) as a row to `values` (..., k, channels)."""
    row = np.broadcast_to(before[..., None, :], (*values.shape[:-2], 1, values.shape[-1]))
    return np.concatenate([row, values], axis=-2)


def _joined(times: Floats, coefficients: Floats) -> Piecewise:
    """Broadcasts the first axes (runs, ...) of breaks and coefficients to a common shape."""
    front = np.broadcast_shapes(times.shape[:-1], coefficients.shape[:-3])
    times = np.broadcast_to(times, (*front, times.shape[-1]))
    return times, np.broadcast_to(coefficients, (*front, *coefficients.shape[-3:]))


def padded(pieces: Sequence[Piecewise]) -> Piecewise:
    """Stacks piecewise polynomials along a new first axis.

    Missing breaks are placed beyond the end of any run; missing powers get zero coefficients.
    """
    most = max(len(breaks) for breaks, _ in pieces)
    degrees = max(coefficients.shape[-1] for _, coefficients in pieces)
    all_breaks, all_coefficients = [], []
    for breaks, coefficients in pieces:
        missing = most - len(breaks)
        never = _NEVER * (1.0 + np.arange(missing) / (missing + 1))
        all_breaks.append(np.concatenate([breaks, never]))
        last = np.repeat(coefficients[-1:], missing, axis=0)
        whole = np.concatenate([coefficients, last])
        whole = np.pad(whole, [(0, 0), (0, 0), (0, degrees - whole.shape[-1])])
        all_coefficients.append(whole)
    return np.stack(all_breaks), np.stack(all_coefficients)


def require_finite(name: str, piecewise: Piecewise) -> Piecewise:
    """Refuses coefficients that overflow, because knots are too close for the change of value."""
    if not np.isfinite(piecewise[1]).all():
        raise ValueError(f"{name}: too short, the rates of change overflow")
    return piecewise


def _moves(times: Floats, angles: Floats, move_time: float) -> Piecewise:
    """Quintic moves (10 s^3 - 15 s^4 + 6 s^5) that start at times[1:], each held until the next.

    Only the angles may have extra first axes, because the times determine the number of pieces.
    """
    breaks: list[float] = []
    front = angles.shape[:-2]
    # Derivatives of a schedule come from complex numbers (directions.py).
    kind = np.result_type(times, angles, move_time)
    rows = [np.zeros((*front, 2, 6), kind)]
    rows[0][..., 0] = angles[..., 0, :]
    # Divide repeatedly, because move_time**5 overflows or underflows for extreme durations.
    powers = np.array([10.0, -15.0, 6.0]) / move_time / move_time / move_time
    powers[1:] /= move_time
    powers[2:] /= move_time
    for k in range(1, len(times)):
        move = np.zeros((*front, 2, 6), kind)
        move[..., 0] = angles[..., k - 1, :]
        move[..., 3:] = (angles[..., k, :] - angles[..., k - 1, :])[..., None] * powers
        breaks.append(times[k])
        rows.append(move)
        end = times[k] + move_time
        late = times[k + 1 :][:1]
        if late.size and (late - end).real <= _ROUND_OFF * abs(late):
            continue
        if np.isfinite(end):
            rest = np.zeros((*front, 2, 6), kind)
            rest[..., 0] = angles[..., k, :]
            breaks.append(end)
            rows.append(rest)
    return _joined(np.array(breaks), np.stack(rows, axis=-3))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Schedule(Record):
    """The target angles of the fingers over time.

    Make one with `Schedule.steps`, `.ramps`, `.minimum_jerk` or `.sampled`. The first angles hold
    before the first time, and the last angles after the last time.

    Attributes:
        kind: "steps", "ramps", "minimum_jerk" or "sampled".
        times: Increasing instants (k,), s.
        angles: Target angles (k, 2), rad; columns right and left (theta_1^d and theta_2^d of (39)).
        move_time: Duration of each move, s; only for "minimum_jerk".
        hold: "zero" or "linear"; only for "sampled".
    """

    kind: str
    times: NDArray[np.float64]
    angles: NDArray[np.float64]
    move_time: float | None = None
    hold: str | None = None

    def __post_init__(self) -> None:
        """Checks all fields, and that the compiled polynomials are finite."""
        super().__post_init__()
        checks.choice("Schedule.kind", self.kind, KINDS)
        self._set("times", checks.times("Schedule.times", self.times))
        self._set("angles", checks.array("Schedule.angles", self.angles, ("k", 2)))
        checks.same_length("Schedule.angles", self.angles, "Schedule.times", len(self.times))
        for kind, name in _OWN.items():
            given = getattr(self, name) is not None
            if given != (self.kind == kind):
                rule = f"belongs to {kind}" if given else "is missing"
                raise ValueError(f"Schedule.{name}: {rule}")
        if self.move_time is not None:
            move_time = checks.positive("Schedule.move_time", self.move_time)
            self._set("move_time", move_time)
            self._refuse_overlaps(move_time)
        if self.hold is not None:
            checks.choice("Schedule.hold", self.hold, HOLDS)
        require_finite(f"Schedule.{_OWN.get(self.kind, 'times')}", self.compile())

    def _refuse_overlaps(self, move_time: float) -> None:
        starts = self.times[1:]
        ends = starts + move_time
        if (ends <= starts).any():
            raise ValueError(
                f"Schedule.move_time = {move_time}: must be long enough to end later than it starts"
            )
        late = np.flatnonzero(ends[:-1] - starts[1:] > _ROUND_OFF * np.abs(starts[1:]))
        if late.size:
            k = int(late[0])
            raise ValueError(
                f"Schedule.move_time = {move_time}: moves would overlap, "
                f"times[{k + 2}] comes {starts[k + 1] - starts[k]} s after times[{k + 1}]"
            )

    @classmethod
    def steps(cls, times: ArrayLike, angles: ArrayLike) -> Self:
        """Angles that jump: `angles[k]` holds from `times[k]` on.

        Args:
            times: Increasing instants (k,), s.
            angles: Target angles (k, 2), rad.

        Raises:
            ValueError: A shape is wrong, a number is not finite, or the times do not increase.
            TypeError: A value is not a number.
        """
        return cls(kind="steps", times=times, angles=angles)  # type: ignore[arg-type]

    @classmethod
    def ramps(cls, times: ArrayLike, angles: ArrayLike) -> Self:
        """Linear interpolation between knots.

        Args:
            times: Increasing instants of the knots (k,), s.
            angles: Target angles at the knots (k, 2), rad.

        Raises:
            ValueError: As in `steps`; or the angular rates overflow.
            TypeError: As in `steps`.
        """
        return cls(kind="ramps", times=times, angles=angles)  # type: ignore[arg-type]

    @classmethod
    def minimum_jerk(cls, times: ArrayLike, angles: ArrayLike, move_time: float) -> Self:
        """Smooth moves: the move to `angles[k]` starts at `times[k]` and takes `move_time`.

        With s = (t - times[k]) / move_time, the fraction of the way is 10 s^3 - 15 s^4 + 6 s^5.
        Velocity and acceleration are zero at both ends. `angles[0]` holds until `times[1]`.

        Args:
            times: Increasing start times (k,), s.
            angles: Target angles (k, 2), rad.
            move_time: Duration of each move, s.

        Raises:
            ValueError: As in `steps`; or moves overlap, `move_time` is too short for the start
                times, or the angular rates overflow.
            TypeError: As in `steps`.
        """
        return cls(
            kind="minimum_jerk",
            times=times,  # type: ignore[arg-type]
            angles=angles,  # type: ignore[arg-type]
            move_time=move_time,
        )

    @classmethod
    def sampled(cls, times: ArrayLike, angles: ArrayLike, hold: str = "zero") -> Self:
        """Sampled angles, for example from a file or another program.

        Args:
            times: Increasing instants (k,), s.
            angles: Target angles (k, 2), rad.
            hold: "zero" holds each sample until the next; "linear" interpolates between samples.

        Raises:
            ValueError: As in `steps`; or `hold` is unknown, or the angular rates overflow.
            TypeError: As in `steps`.
        """
        return cls(kind="sampled", times=times, angles=angles, hold=hold)  # type: ignore[arg-type]

    def compile(self) -> Piecewise:
        """Returns the piecewise polynomial (breaks (m,), coefficients (m + 1, 2, degree + 1))."""
        if self.move_time is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                return _moves(self.times, self.angles, self.move_time)
        if self.kind == "ramps" or self.hold == "linear":
            return linear(self.times, self.angles, self.angles[..., 0, :])
        # The first angles also hold before the first time, so it needs no break and no step's end.
        return held(self.times[..., 1:], self.angles[..., 1:, :], self.angles[..., 0, :])

    def compile_runs(self, values: Mapping[str, Floats]) -> Piecewise:
        """Returns the piecewise polynomials of many runs, with the runs as the first axis.

        Args:
            values: Fields that differ between runs -> (runs, ...).

        Raises:
            ValueError: A run's value breaks a rule of the constructor; the message names the run.
        """
        if self.move_time is None:
            times = values.get("times", self.times[None])
            # Check the order of all times here: where times[0] is no break, the core never sees it.
            late = np.flatnonzero((times[:, 1:] <= times[:, :-1]).any(axis=1))
            list(runs_of(self, values, late[:1].tolist()))
            return bare(self, values).compile()
        if values.keys() == {"angles"}:
            return _moves(self.times, values["angles"], self.move_time)
        return padded([run.compile() for run in runs_of(self, values)])

    def target(self, t: ArrayLike) -> NDArray[np.float64]:
        """Returns the target angles (..., 2), rad, at times `t` (...), s.

        At a jump they are the angles after the jump.

        Raises:
            ValueError: A time is not finite.
            TypeError: A time is not a number.
        """
        t = checks.numbers("t", t)
        checks.require_finite("t", t)
        breaks, coefficients = self.compile()
        piece = np.searchsorted(breaks, t, side="right")
        tau = t - np.concatenate([[0.0], breaks])[piece]
        # Row 0 is constant, so its time does not matter; zero avoids NaN from zero times infinity.
        tau = np.where(piece == 0, 0.0, tau)[..., None]
        result = np.zeros((*t.shape, 2))
        for k in reversed(range(coefficients.shape[2])):
            result = result * tau + coefficients[piece, :, k]
        return result

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """Accepts `angles_deg`, in degrees, instead of `angles`."""
        if isinstance(data, Mapping) and "angles_deg" in data:
            if "angles" in data:
                where = checks.at(path)
                raise ValueError(
                    f"Schedule.angles_deg{where}: must not be given together with angles"
                )
            rest = {name: value for name, value in data.items() if name != "angles_deg"}
            try:
                degrees = checks.array("Schedule.angles_deg", data["angles_deg"], ("k", 2))
            except (TypeError, ValueError) as error:
                raise type(error)(f"{error}{checks.at(path)}") from None
            data = {**rest, "angles": np.deg2rad(degrees)}
        return super()._parse(data, path)
