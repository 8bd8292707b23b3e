"""Schedules of target angles, which compile themselves to piecewise polynomials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support import Floats, checks
from ..support.choices import Hold, ScheduleKind
from ..support.record import Record, bare, runs_of
from . import piecewise

HOLDS = ("zero", "linear")
KINDS = ("steps", "ramps", "minimum_jerk", "via_points", "sampled")
# Kind -> the field that this kind needs in addition to times and angles.
_OWN = {"minimum_jerk": "move_time", "sampled": "hold"}
# Kinds whose times determine the number of pieces.
_SMOOTH = ("minimum_jerk", "via_points")
_ROWS = "a row (right, left) for each time, such as [[0.1, 0.1]]"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Schedule(Record):
    """The target angles of the fingers over time.

    Make one with `Schedule.steps`, `.ramps`, `.minimum_jerk` or `.sampled`, or with angles in
    degrees by `Schedule.in_degrees`. The first angles hold before the first time, and the last
    angles after the last time.

    Attributes:
        kind: "steps", "ramps", "minimum_jerk", "via_points" or "sampled".
        times: Increasing instants (k,), s.
        angles: Target angles (k, 2), rad; columns right and left (theta_1^d and theta_2^d of (39)).
            Of a `Jaw` the target is its travel, m.
        move_time: Duration of a move, or of each (k - 1,), s; only for "minimum_jerk".
        hold: "zero" or "linear"; only for "sampled".
    """

    kind: ScheduleKind
    times: NDArray[np.float64]
    angles: NDArray[np.float64]
    move_time: float | NDArray[np.float64] | None = None
    hold: Hold | None = None
    # Whether degrees were given, which the coordinate of a jaw does not have.
    given_in_degrees: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        checks.choice("Schedule.kind", self.kind, KINDS)
        self._set("times", checks.times("Schedule.times", self.times))
        self._set("angles", checks.array("Schedule.angles", self.angles, ("k", 2), _ROWS))
        checks.same_length("Schedule.angles", self.angles, "Schedule.times", len(self.times))
        for kind, name in _OWN.items():
            given = getattr(self, name) is not None
            if given != (self.kind == kind):
                rule = f"belongs to {kind}" if given else "is missing"
                raise ValueError(f"Schedule.{name}: {rule}")
        if self.move_time is not None:
            name, moved = "Schedule.move_time", len(self.times) - 1
            lasting = checks.number_or_array(name, self.move_time, checks.positive)
            if not isinstance(lasting, float) and lasting.shape != (moved,):
                rule = f"must be one number, or have shape ({moved},), one for each move"
                first = "no move goes to the first angles"
                raise ValueError(f"{name} has shape {lasting.shape}: {rule}; {first}")
            self._set("move_time", lasting)
            self._refuse_overlaps()
        if self.hold is not None:
            checks.choice("Schedule.hold", self.hold, HOLDS)
        piecewise.require_finite(f"Schedule.{_OWN.get(self.kind, 'times')}", self.compile())

    def _refuse_overlaps(self) -> None:
        starts = self.times[1:]
        lasting = np.broadcast_to(np.asarray(self.move_time), starts.shape)
        ends = starts + lasting

        def called(k: int) -> str:
            each = "" if isinstance(self.move_time, float) else f"[{k}]"
            return f"Schedule.move_time{each} = {lasting[k]}"

        short = np.flatnonzero(ends <= starts)
        if short.size:
            raise ValueError(f"{called(short[0])}: must be long enough to end later than it starts")
        late = np.flatnonzero(ends[:-1] - starts[1:] > piecewise.ROUND_OFF * np.abs(starts[1:]))
        if late.size:
            k = int(late[0])
            gap = f"times[{k + 2}] comes {starts[k + 1] - starts[k]} s after times[{k + 1}]"
            raise ValueError(f"{called(k)}: moves would overlap, {gap}")

    @classmethod
    def steps(cls, times: ArrayLike, angles: ArrayLike) -> Self:
        """Angles (k, 2), rad, that jump: `angles[k]` holds from `times[k]` on; times (k,), s."""
        return cls(kind="steps", times=times, angles=angles)  # type: ignore[arg-type]

    @classmethod
    def ramps(cls, times: ArrayLike, angles: ArrayLike) -> Self:
        """Linear interpolation between knots: angles (k, 2), rad, at increasing times (k,), s."""
        return cls(kind="ramps", times=times, angles=angles)  # type: ignore[arg-type]

    @classmethod
    def minimum_jerk(
        cls, times: ArrayLike, angles: ArrayLike, move_time: ArrayLike | None = None
    ) -> Self:
        """Smooth moves with stops between them, or one smooth motion through all angles.

        With `move_time`, the move to `angles[k]` starts at `times[k]` and takes `move_time`, or
        `move_time[k - 1]` if each move has its own. With s = (t - times[k]) / move_time, the
        fraction of the way is 10 s^3 - 15 s^4 + 6 s^5. Velocity and acceleration are zero at both
        ends. `angles[0]` holds until `times[1]`.

            >>> import numpy as np, softpinch as sp
            >>> angles = np.deg2rad([[6, 6], [15, -5], [6, 6]])
            >>> there_and_back = sp.Schedule.minimum_jerk([0.0, 0.1, 0.5], angles, [0.3, 0.6])

        Without `move_time`, the angles are via points: the fingers pass `angles[k]` at `times[k]`
        without stopping, and rest before the first and after the last time. The integral of the
        squared jerk is least (Flash and Hogan, J. Neurosci. 5, 1985): quintic pieces with
        derivatives that are continuous up to the fourth. On such a way the angles may exceed those
        of the via points.

            >>> round_trip = sp.Schedule.minimum_jerk([0.0, 0.4, 1.0], angles)
            >>> round_trip.kind
            'via_points'

        Raises:
            ValueError: Moves overlap, or the angular rates overflow.
        """
        kind = "via_points" if move_time is None else "minimum_jerk"
        return cls(kind=kind, times=times, angles=angles, move_time=move_time)  # type: ignore[arg-type]

    @classmethod
    def sampled(cls, times: ArrayLike, angles: ArrayLike, hold: Hold = "zero") -> Self:
        """Angles (k, 2), rad, at times (k,), s; `hold` is "zero" (until the next) or "linear"."""
        return cls(kind="sampled", times=times, angles=angles, hold=hold)  # type: ignore[arg-type]

    @classmethod
    def in_degrees(
        cls,
        kind: ScheduleKind,
        times: ArrayLike,
        angles: ArrayLike,
        *,
        move_time: ArrayLike | None = None,
        hold: Hold | None = None,
    ) -> Self:
        """A schedule of any kind, with its angles in degrees.

            >>> import softpinch as sp
            >>> sp.Schedule.in_degrees("steps", [0.0, 0.5], [[6, 6], [15, -5]])
            Schedule.in_degrees(kind='steps', times=[0.0, 0.5], angles=[[6.0, 6.0], [15.0, -5.0]])
            >>> moves = sp.Schedule.in_degrees("minimum_jerk", [0.0], [[6, 6]], move_time=0.2)

        A `move_time` that is None makes "minimum_jerk" "via_points", and `hold` is "zero" if None.
        """
        if checks.choice("kind", kind, KINDS) == "sampled" and hold is None:
            hold = "zero"
        elif kind == "minimum_jerk" and move_time is None:
            kind = "via_points"
        radians = np.deg2rad(checks.array("angles", angles, ("k", 2), _ROWS))
        found = cls(kind=kind, times=times, angles=radians, move_time=move_time, hold=hold)  # type: ignore[arg-type]
        found._set("given_in_degrees", True)
        return found

    def _call(self) -> tuple[str, dict[str, Any]]:
        """A call in degrees, where it makes the same angles to the bit."""
        function, arguments = super()._call()
        degrees = np.rad2deg(self.angles).round(12)
        if degrees.any() and np.array_equal(np.deg2rad(degrees), self.angles):
            return f"{function}.in_degrees", {**arguments, "angles": degrees}
        return function, arguments

    @property
    def end(self) -> float:
        """The instant from which the last angles hold, s."""
        last = 0.0 if self.move_time is None else np.ravel(self.move_time)[-1]
        return float(self.times[-1] + last)

    def compile(self) -> piecewise.Piecewise:
        """Returns the piecewise polynomial (breaks (m,), coefficients (m + 1, 2, degree + 1))."""
        if self.kind in _SMOOTH:
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                return self._smooth(self.angles)
        if self.kind == "ramps" or self.hold == "linear":
            return piecewise.linear(self.times, self.angles, self.angles[..., 0, :])
        # The first angles also hold before the first time, so it needs no break and no step's end.
        return piecewise.held(self.times[..., 1:], self.angles[..., 1:, :], self.angles[..., 0, :])

    def _smooth(self, angles: Floats) -> piecewise.Piecewise:
        if self.move_time is None:
            return piecewise.through(self.times, angles)
        return piecewise.moves(self.times[1:], angles, self.move_time)

    def compile_runs(self, values: Mapping[str, Floats]) -> piecewise.Piecewise:
        """As `compile`, of runs that differ in `values` (runs, ...), the first axis of arrays."""
        if self.kind not in _SMOOTH:
            times = values.get("times", self.times[None])
            # Check the order of all times here: where times[0] is no break, the core never sees it.
            late = np.flatnonzero((times[:, 1:] <= times[:, :-1]).any(axis=1))
            list(runs_of(self, values, late[:1].tolist()))
            return bare(self, values).compile()
        if values.keys() == {"angles"}:
            return self._smooth(values["angles"])
        return piecewise.padded([run.compile() for run in runs_of(self, values)])

    def target(self, t: ArrayLike) -> NDArray[np.float64]:
        """Returns target angles (..., 2), rad, at times `t` (...), s; at a jump those after it."""
        t = checks.numbers("t", t)
        checks.require_finite("t", t)
        return piecewise.evaluate(self.compile(), t)

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """Accepts `angles_deg`, in degrees, instead of `angles`."""
        if isinstance(data, Mapping) and "angles_deg" in data:
            if "angles" in data:
                place = f"Schedule.angles_deg{checks.at(path)}"
                raise ValueError(f"{place}: must not be given together with angles")
            rest = {name: value for name, value in data.items() if name != "angles_deg"}
            with checks.reworded(after=checks.at(path)):
                degrees = checks.array("Schedule.angles_deg", data["angles_deg"], ("k", 2))
            found = super()._parse({**rest, "angles": np.deg2rad(degrees)}, path)
            found._set("given_in_degrees", True)
            return found
        return super()._parse(data, path)


def default_schedule() -> Schedule:
    """The schedule of a scene that is given none: both fingers stand at 6 degrees."""
    return Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]]))
