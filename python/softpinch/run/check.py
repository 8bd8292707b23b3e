"""The invariants of a run, for `Run.check`. A failure names the invariant, row and excess."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn, Protocol

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..scene.scene import Scene, State
from ..support import checks
from ..support.arrays import Floats

_RESIDUALS = ("C_1^H", "C_2^H", "C_1^N", "C_2^N")
# The core's tolerance for "separated", as a share of the tip's radius: round-off may make the
# compression of a point contact negative.
_SEPARATION = 1e-9


class Ledger(Protocol):
    """The part of `EnergyLedger` that the checks use."""

    @property
    def closure(self) -> Floats:
        """The ledger's error (n,), J."""

    @property
    def exchanged(self) -> float:
        """The energy that scales the ledger's error, J."""


class Finished(Protocol):
    """The part of `Run` that the checks use. Importing `Run` here would be a circular import."""

    scene: Scene
    t: Floats
    status: str
    violations: dict[str, float]
    record: tuple[str, ...]
    stop_on: tuple[str, ...]

    @property
    def q(self) -> Floats:
        """Coordinates (n, 9)."""

    @property
    def p(self) -> Floats:
        """Rates of the coordinates (n, 9)."""

    @property
    def multipliers(self) -> Floats:
        """Multipliers (n, 4)."""

    @property
    def residuals(self) -> Floats:
        """Constraint residuals (n, 4)."""

    @property
    def energy(self) -> Ledger:
        """The energy ledger."""

    @property
    def success(self) -> bool:
        """Whether the run reached its end time."""

    def arrays(self) -> Mapping[str, Floats]:
        """The recorded arrays by name."""

    def state(self, k: int = -1) -> State:
        """The state at row `k`."""


def check_run(run: Finished, *, residual: float, closure: float) -> None:
    """Checks every invariant of a run; `Run.check` explains the tolerances.

    Raises:
        AssertionError: An invariant is broken; the message is about the first one.
        ValueError: A tolerance is negative or NaN.
        TypeError: A tolerance is not a number.
    """
    _check_times(run)
    _check_finite(run)
    _check_residuals(run, _tolerance("residual", residual))
    _check_closure(run, _tolerance("closure", closure))
    _check_status(run)


def _tolerance(name: str, value: float) -> float:
    value = checks.number(name, value)
    if not value >= 0:
        raise ValueError(f"{name} = {value}: must be >= 0")
    return value


def _limit(tolerance: float, scale: float) -> float:
    """Returns the allowed value; an infinite tolerance allows any, also where the scale is zero."""
    return tolerance * scale if np.isfinite(tolerance) else np.inf


def _fail(run: Finished, invariant: str, row: int, finding: str) -> NoReturn:
    row %= len(run.t)
    raise AssertionError(f"{invariant}: {finding} at t = {run.t[row]} s (row {row})")


def _check_times(run: Finished) -> None:
    late = np.flatnonzero(~(np.diff(run.t) > 0))
    if late.size:
        row = int(late[0]) + 1
        _fail(run, "times increase", row, f"the row before is at {run.t[row - 1]} s")


def _check_finite(run: Finished) -> None:
    for name, values in {"t": run.t, **run.arrays()}.items():
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            row, *component = map(int, bad[0])
            _fail(run, "finite", row, f"{name}{component or ''} is {values[row, *component]}")


def _speed(run: Finished) -> float:
    """The largest speed of the object or of a fingertip's centre along the run, m/s."""
    hand = run.scene.hand
    arms = [np.hypot(finger.length, finger.half_thickness) for finger in (hand.right, hand.left)]
    object_speed = np.hypot(run.p[:, 0], run.p[:, 1])
    return float(max(object_speed.max(), (np.abs(run.p[:, 3:5]) * arms).max()))


def _check_residuals(run: Finished, tolerance: float) -> None:
    has_state = "state" in run.record
    if "residuals" in run.record:
        residuals = run.residuals
    elif has_state:
        residuals = _core.residuals(run.scene.parameters(), run.q, run.p)
    else:
        return
    for k, name in enumerate(_RESIDUALS):
        if k < 2:
            scale, unit, what = _radius(run, k), "m", "the fingertip's radius"
        elif has_state:
            scale, unit, what = _speed(run), "m/s", "the largest speed"
        else:
            return
        row = int(np.argmax(np.abs(residuals[:, k])))
        value, allowed = abs(residuals[row, k]), _limit(tolerance, scale)
        if not value <= allowed:
            excess = f"{value:.3e} {unit}, more than {allowed:.3e}, {tolerance:g} of {what}"
            _fail(run, f"constraint {name}", row, excess)


def _radius(run: Finished, side: int) -> float:
    tip = run.scene.hand.tip
    return (tip[side] if isinstance(tip, tuple) else tip).radius


def _check_closure(run: Finished, tolerance: float) -> None:
    if "energy" not in run.record:
        return
    closure, exchanged = run.energy.closure, run.energy.exchanged
    row = int(np.argmax(np.abs(closure)))
    if not abs(closure[row]) <= _limit(tolerance, exchanged):
        excess = f"{closure[row]:.3e} J, more than {tolerance:g} of the {exchanged:.3e} J exchanged"
        _fail(run, "energy ledger closes", row, excess)


def _shown(run: Finished) -> dict[str, NDArray[np.bool_]]:
    """Returns violation -> whether each recorded row shows it; only the last row if q is missing.

    "rim" is left out: it depends on a sine, whose rounding may decide.
    """
    q = run.q if "state" in run.record else run.state(-1).q[None]
    radii = np.array([_radius(run, 0), _radius(run, 1)])
    tilt = q[:, 3:5] + q[:, 2:3] * [-1.0, 1.0]
    by_side: dict[str, NDArray[np.bool_]] = {
        "separated": q[:, 5:7] < -_SEPARATION * radii,
        "crushed": q[:, 5:7] >= radii,
        "folded": np.abs(tilt) >= np.pi / 2,
    }
    if "multipliers" in run.record:
        normal, across = run.multipliers[:, :2], np.abs(run.multipliers[:, 2:])
        by_side["pulling"] = normal < 0.0
        if run.scene.friction is not None:
            by_side["slipping"] = np.asarray(run.scene.friction) * normal < across
    return {name: sides[:, 0] | sides[:, 1] for name, sides in by_side.items()}


def _check_status(run: Finished) -> None:
    # With `times` the first row may be long after the start, but the last instant is always a row.
    first, last = run.scene.start().time, run.t[-1]
    for name, time in run.violations.items():
        if not first <= time <= last:
            _fail(run, f"violation {name}", -1, f"first reported at {time} s, outside the run")
    shown = _shown(run)
    for name, rows in shown.items():
        if run.status == name and not rows[-1]:
            _fail(run, f"status {name}", -1, "the last state does not have this violation")
        if not rows.any():
            continue
        row = int(np.argmax(rows)) + len(run.t) - len(rows)
        if not run.violations.get(name, np.inf) <= run.t[row]:
            _fail(run, f"violation {name}", row, "the state has it, but the run did not report it")
        if name in run.stop_on and (row < len(run.t) - 1 or run.status not in shown):
            finding = f"the state is {name}, which should have ended the run"
            _fail(run, f"status {run.status}", row, finding)
    end = run.scene.start().time + run.scene.duration
    if run.success and last != end:
        _fail(run, "status completed", -1, f"the run should have reached {end} s")
