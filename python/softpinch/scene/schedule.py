"""What the fingers are asked to do, and the piecewise polynomials that every input becomes.

A piecewise polynomial is `(breaks, coefficients)`: breaks (m,) in seconds, coefficients
(m + 1, channels, degree + 1) in ascending powers of the time since the piece's own break. Row 0
holds before the first break and is constant; the last row goes on for ever. What makes one makes
many as well: where times, values or both have axes in front (runs, ...), so has what comes out.
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
# Which fields a kind has beside times and angles.
_OWN = {"minimum_jerk": "move_time", "sampled": "hold"}
# Moves that meet within this share of the time have been scheduled back to back.
_ROUND_OFF = 4 * float(np.finfo(np.float64).eps)
# Later than any run ends.
_NEVER = 2.0**1022


def held(times: Floats, values: Floats, before: Floats) -> Piecewise:
    """`values[k]` (k, channels) from `times[k]` on, `before` (channels,) ahead of the first."""
    return _joined(times, _behind(before, values)[..., None])


def linear(times: Floats, values: Floats, before: Floats) -> Piecewise:
    """Straight lines between the knots, `before` ahead of them, the last value after them."""
    with np.errstate(over="ignore", invalid="ignore"):
        slopes = np.diff(values, axis=-2) / np.diff(times)[..., None]
    flat = np.zeros((*slopes.shape[:-2], 1, slopes.shape[-1]))
    slopes = np.concatenate([flat, slopes, flat], axis=-2)
    return _joined(times, np.stack(np.broadcast_arrays(_behind(before, values), slopes), axis=-1))


def _behind(before: Floats, values: Floats) -> Floats:
    """`before` (..., channels) as a row ahead of `values` (..., k, channels)."""
    row = np.broadcast_to(before[..., None, :], (*values.shape[:-2], 1, values.shape[-1]))
    return np.concatenate([row, values], axis=-2)


def _joined(times: Floats, coefficients: Floats) -> Piecewise:
    """Both with the same axes in front."""
    front = np.broadcast_shapes(times.shape[:-1], coefficients.shape[:-3])
    times = np.broadcast_to(times, (*front, times.shape[-1]))
    return times, np.broadcast_to(coefficients, (*front, *coefficients.shape[-3:]))


def padded(pieces: Sequence[Piecewise]) -> Piecewise:
    """Several as one with an axis in front; breaks that never come fill up the shorter ones."""
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
    """Refuses pieces whose coefficients overflow: knots too close for the values between them."""
    if not np.isfinite(piecewise[1]).all():
        raise ValueError(f"{name}: too short for the values to change in, the rates overflow")
    return piecewise


def _moves(times: Floats, angles: Floats, move_time: float) -> Piecewise:
    """Quintic moves (10 s^3 - 15 s^4 + 6 s^5) that start at times[1:], each held until the next.

    Only the angles may have axes in front: how many pieces there are follows from the times.
    """
    breaks: list[float] = []
    front = angles.shape[:-2]
    rows = [np.zeros((*front, 2, 6))]
    rows[0][..., 0] = angles[..., 0, :]
    # In turn, not by move_time**5, so that very short and long moves overflow as late as can be.
    powers = np.array([10.0, -15.0, 6.0]) / move_time / move_time / move_time
    powers[1:] /= move_time
    powers[2:] /= move_time
    for k in range(1, len(times)):
        move = np.zeros((*front, 2, 6))
        move[..., 0] = angles[..., k - 1, :]
        move[..., 3:] = (angles[..., k, :] - angles[..., k - 1, :])[..., None] * powers
        breaks.append(times[k])
        rows.append(move)
        end = times[k] + move_time
        if k + 1 < len(times) and times[k + 1] - end <= _ROUND_OFF * abs(times[k + 1]):
            continue
        if np.isfinite(end):
            rest = np.zeros((*front, 2, 6))
            rest[..., 0] = angles[..., k, :]
            breaks.append(end)
            rows.append(rest)
    return _joined(np.array(breaks), np.stack(rows, axis=-3))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Schedule(Record):
    """The angles that the fingers are asked for, over time.

    Made by `Schedule.steps`, `.ramps`, `.minimum_jerk` or `.sampled`. Before the first time the
    first angles hold, after the last the last.

    Attributes:
        kind: "steps", "ramps", "minimum_jerk" or "sampled".
        times: (k,), s, increasing.
        angles: (k, 2), rad, columns right and left (theta_1^d and theta_2^d of (39)).
        move_time: How long each move takes, s; minimum_jerk only.
        hold: "zero" or "linear"; sampled only.
    """

    kind: str
    times: NDArray[np.float64]
    angles: NDArray[np.float64]
    move_time: float | None = None
    hold: str | None = None

    def __post_init__(self) -> None:
        """Checks everything, the compiled polynomials too."""
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
        """Angles (k, 2) in rad that jump: `angles[k]` from `times[k]` (k,) in s on.

        Raises:
            ValueError: A shape is wrong, a number not finite, or the times do not increase.
            TypeError: Something is no number.
        """
        return cls(kind="steps", times=times, angles=angles)  # type: ignore[arg-type]

    @classmethod
    def ramps(cls, times: ArrayLike, angles: ArrayLike) -> Self:
        """Straight lines between the knots `times` (k,) in s and `angles` (k, 2) in rad.

        Raises:
            ValueError: As `steps`.
            TypeError: As `steps`.
        """
        return cls(kind="ramps", times=times, angles=angles)  # type: ignore[arg-type]

    @classmethod
    def minimum_jerk(cls, times: ArrayLike, angles: ArrayLike, move_time: float) -> Self:
        """Smooth moves: the one to `angles[k]` starts at `times[k]` and takes `move_time`.

        With s = (t - times[k]) / move_time the way is 10 s^3 - 15 s^4 + 6 s^5, at rest and without
        acceleration at both ends. `angles[0]` holds until `times[1]`.

        Args:
            times: (k,), s.
            angles: (k, 2), rad.
            move_time: s.

        Raises:
            ValueError: As `steps`; or moves overlap.
            TypeError: As `steps`.
        """
        return cls(
            kind="minimum_jerk",
            times=times,  # type: ignore[arg-type]
            angles=angles,  # type: ignore[arg-type]
            move_time=move_time,
        )

    @classmethod
    def sampled(cls, times: ArrayLike, angles: ArrayLike, hold: str = "zero") -> Self:
        """Samples `angles` (k, 2) in rad at `times` (k,) in s, from a file or another program.

        Args:
            times: (k,), s.
            angles: (k, 2), rad.
            hold: "zero" keeps each until the next, "linear" joins them.

        Raises:
            ValueError: As `steps`; or `hold` is neither.
            TypeError: As `steps`.
        """
        return cls(kind="sampled", times=times, angles=angles, hold=hold)  # type: ignore[arg-type]

    def compile(self) -> Piecewise:
        """The piecewise polynomial (breaks (m,), coefficients (m + 1, 2, degree + 1))."""
        if self.move_time is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                return _moves(self.times, self.angles, self.move_time)
        if self.kind == "ramps" or self.hold == "linear":
            return linear(self.times, self.angles, self.angles[..., 0, :])
        # Nothing happens at the first time: no break, so no step needs to end there.
        return held(self.times[..., 1:], self.angles[..., 1:, :], self.angles[..., 0, :])

    def compile_runs(self, values: Mapping[str, Floats]) -> Piecewise:
        """The piecewise polynomials of many runs.

        Args:
            values: Fields that differ between runs -> (runs, ...).

        Raises:
            ValueError: As the constructor, for the first run that breaks a rule.
        """
        if self.move_time is None:
            times = values.get("times", self.times[None])
            # The first time is no break, so the core does not see it.
            late = np.flatnonzero((times[:, 1:] <= times[:, :-1]).any(axis=1))
            list(runs_of(self, values, late[:1].tolist()))
            return bare(self, values).compile()
        if values.keys() == {"angles"}:
            return _moves(self.times, values["angles"], self.move_time)
        return padded([run.compile() for run in runs_of(self, values)])

    def target(self, t: ArrayLike) -> NDArray[np.float64]:
        """The angles (..., 2) in rad asked for at `t` (...) in s; at a jump those after it.

        Raises:
            ValueError: A time is not finite.
            TypeError: Something is no number.
        """
        t = checks.numbers("t", t)
        checks.require_finite("t", t)
        breaks, coefficients = self.compile()
        piece = np.searchsorted(breaks, t, side="right")
        tau = t - np.concatenate([[0.0], breaks])[piece]
        # Row 0 is constant; its powers are zero, but infinity times zero is not.
        tau = np.where(piece == 0, 0.0, tau)[..., None]
        result = np.zeros((*t.shape, 2))
        for k in reversed(range(coefficients.shape[2])):
            result = result * tau + coefficients[piece, :, k]
        return result

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """Accepts `angles_deg` in the place of `angles`."""
        if isinstance(data, Mapping) and "angles_deg" in data:
            if "angles" in data:
                where = checks.at(path)
                raise ValueError(f"Schedule.angles_deg{where}: must not stand beside angles")
            rest = {name: value for name, value in data.items() if name != "angles_deg"}
            try:
                degrees = checks.array("Schedule.angles_deg", data["angles_deg"], ("k", 2))
            except (TypeError, ValueError) as error:
                raise type(error)(f"{error}{checks.at(path)}") from None
            data = {**rest, "angles": np.deg2rad(degrees)}
        return super()._parse(data, path)
