"""The invariants of a run, for `Run.check`: what broke, where and by how much."""

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
# As the core's monitor has it: point contact may be negative by round-off.
_SEPARATION = 1e-9


class Ledger(Protocol):
    """What is asked of an `EnergyLedger`."""

    @property
    def closure(self) -> Floats:
        """Its error (n,), J."""

    @property
    def exchanged(self) -> float:
        """The scale of its error, J."""


class Finished(Protocol):
    """What is asked of a `Run`, which calls this module and so stands above it."""

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
        """Their rates (n, 9)."""

    @property
    def residuals(self) -> Floats:
        """Of the constraints (n, 4)."""

    @property
    def energy(self) -> Ledger:
        """The energy ledger."""

    @property
    def success(self) -> bool:
        """Whether it reached the end."""

    def arrays(self) -> Mapping[str, Floats]:
        """What was recorded, by name."""

    def state(self, k: int = -1) -> State:
        """The state at a row."""


def check_run(run: Finished, *, residual: float, closure: float) -> None:
    """Raises AssertionError for the first invariant that broke."""
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
        value, allowed = abs(residuals[row, k]), tolerance * scale
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
    if not abs(closure[row]) <= tolerance * exchanged:
        excess = f"{closure[row]:.3e} J, more than {tolerance:g} of the {exchanged:.3e} J exchanged"
        _fail(run, "energy ledger closes", row, excess)


def _shown(run: Finished) -> dict[str, NDArray[np.bool_]]:
    """Which rows show what can end a run; the last row alone where no others are there."""
    q = run.q if "state" in run.record else run.state(-1).q[None]
    radii = np.array([_radius(run, 0), _radius(run, 1)])
    tilt = q[:, 3:5] + q[:, 2:3] * [-1.0, 1.0]
    by_side: dict[str, NDArray[np.bool_]] = {
        "separated": q[:, 5:7] < -_SEPARATION * radii,
        "crushed": q[:, 5:7] >= radii,
        "folded": np.abs(tilt) >= np.pi / 2,
    }
    return {name: sides[:, 0] | sides[:, 1] for name, sides in by_side.items()}


def _check_status(run: Finished) -> None:
    # With `times` the first row may be long after the start; the last instant is always a row.
    first, last = run.scene.start().time, run.t[-1]
    for name, time in run.violations.items():
        if not first <= time <= last:
            _fail(run, f"violation {name}", -1, f"first noted at {time} s, outside the run")
    shown = _shown(run)
    for name, rows in shown.items():
        if run.status == name and not rows[-1]:
            _fail(run, f"status {name}", -1, "the last state does not show it")
        if not rows.any():
            continue
        row = int(np.argmax(rows)) + len(run.t) - len(rows)
        if not run.violations.get(name, np.inf) <= run.t[row]:
            _fail(run, f"violation {name}", row, "the state shows it, unnoted")
        if name in run.stop_on and (row < len(run.t) - 1 or run.status not in shown):
            _fail(
                run, f"status {run.status}", row, f"the state is {name}, which should have ended it"
            )
    end = run.scene.start().time + run.scene.duration
    if run.success and last != end:
        _fail(run, "status completed", -1, f"the run should have reached {end} s")
