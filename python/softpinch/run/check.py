"""The invariants of a run, for `Run.check`. A failure names the invariant, row and excess."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _core
from ..support import checks
from ..support.arrays import Floats
from .check_contact import AT_END, check_contact, half_height, places
from .contact import ContactMode, Modes
from .finished import Finished, fail, radius

_RESIDUALS = ("C_1^H", "C_2^H", "C_1^N", "C_2^N")
# The core's tolerance for "separated", as a share of the tip's radius: round-off may make the
# compression of a point contact negative.
_SEPARATION = 1e-9


def check_run(run: Finished, modes: Modes | None, *, residual: float, closure: float) -> None:
    """Checks every invariant of a run; `Run.check` explains the tolerances.

    Args:
        run: The run.
        modes: The modes of the contacts in all rows (n, 2), or in the last row (1, 2) if no others
            are known; None in bilateral contact.
        residual: Largest constraint residual.
        closure: Largest error of the energy ledger.

    Raises:
        AssertionError: An invariant is broken; the message is about the first one.
        ValueError: A tolerance is negative or NaN.
        TypeError: A tolerance is not a number.
    """
    _check_times(run)
    _check_finite(run)
    if modes is not None:
        check_contact(run, modes)
    _check_residuals(run, modes, _tolerance("residual", residual))
    _check_closure(run, _tolerance("closure", closure))
    _check_status(run, modes)


def _tolerance(name: str, value: float) -> float:
    value = checks.number(name, value)
    if not value >= 0:
        raise ValueError(f"{name} = {value}: must be >= 0")
    return value


def _limit(tolerance: float, scale: float) -> float:
    """Returns the allowed value; an infinite tolerance allows any, also where the scale is zero."""
    return tolerance * scale if np.isfinite(tolerance) else np.inf


def _check_times(run: Finished) -> None:
    late = np.flatnonzero(~(np.diff(run.t) > 0))
    if late.size:
        row = int(late[0]) + 1
        fail(run, "times increase", row, f"the row before is at {run.t[row - 1]} s")


def _check_finite(run: Finished) -> None:
    for name, values in {"t": run.t, **run.arrays()}.items():
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            row, *component = map(int, bad[0])
            fail(run, "finite", row, f"{name}{component or ''} is {values[row, *component]}")


def _speed(run: Finished) -> float:
    """The largest speed of the object or of a fingertip's centre along the run, m/s."""
    hand = run.scene.hand
    arms = [np.hypot(finger.length, finger.half_thickness) for finger in (hand.right, hand.left)]
    object_speed = np.hypot(run.p[:, 0], run.p[:, 1])
    return float(max(object_speed.max(), (np.abs(run.p[:, 3:5]) * arms).max()))


def _check_residuals(run: Finished, modes: Modes | None, tolerance: float) -> None:
    has_state = "state" in run.record
    if "residuals" in run.record:
        residuals = run.residuals
    elif has_state:
        residuals = _core.residuals(run.scene.parameters(), run.q, run.p)
    else:
        return
    if modes is not None and len(modes) < len(run.t):
        return  # without the modes nobody knows what was held
    held = _held(run, modes)
    for k, name in enumerate(_RESIDUALS):
        if k < 2:
            scale, unit, what = radius(run, k), "m", "the fingertip's radius"
        elif has_state:
            scale, unit, what = _speed(run), "m/s", "the largest speed"
        else:
            return
        allowed = _limit(tolerance, scale)
        sizes = np.where(held[:, k], np.abs(residuals[:, k]), 0.0)
        row = int(np.argmax(sizes))
        if not sizes[row] <= allowed:
            excess = f"{sizes[row]:.3e} {unit}, more than {allowed:.3e}, {tolerance:g} of {what}"
            fail(run, f"constraint {name}", row, excess)
        if modes is not None and k < 2 and has_state:
            _check_gap(run, residuals[:, k], modes, k, allowed)


def _held(run: Finished, modes: Modes | None) -> NDArray[np.bool_]:
    """Returns which of the four constraints hold in each row (n, 4)."""
    if modes is None:
        return np.ones((len(run.t), 4), dtype=bool)
    closed, sticks = modes != ContactMode.FREE, modes == ContactMode.STICK
    return np.hstack([closed, sticks])


def _check_gap(run: Finished, gap: Floats, modes: Modes, side: int, allowed: float) -> None:
    """Checks that a free tip is outside of the object, unless it passes beside the face."""
    beside = np.abs(places(run, run.q)[:, side]) >= (1.0 - AT_END) * half_height(run)
    broken = np.flatnonzero((modes[:, side] == ContactMode.FREE) & ~beside & (gap < -allowed))
    if broken.size:
        row = int(broken[0])
        fail(run, f"gap >= 0 ({_RESIDUALS[side]})", row, f"the free tip is at {gap[row]:.3e} m")


def _check_closure(run: Finished, tolerance: float) -> None:
    if "energy" not in run.record:
        return
    closure, exchanged = run.energy.closure, run.energy.exchanged
    row = int(np.argmax(np.abs(closure)))
    if not abs(closure[row]) <= _limit(tolerance, exchanged):
        excess = f"{closure[row]:.3e} J, more than {tolerance:g} of the {exchanged:.3e} J exchanged"
        fail(run, "energy ledger closes", row, excess)


def _shown(run: Finished, modes: Modes | None) -> dict[str, NDArray[np.bool_]]:
    """Returns violation -> whether each recorded row shows it; only the last row if q is missing.

    "rim" is left out: it depends on a sine, whose rounding may decide. In unilateral contact only
    closed tips show violations; `check_contact` knows those that a mode is.
    """
    q = run.q if "state" in run.record else run.state(-1).q[None]
    radii = np.array([radius(run, 0), radius(run, 1)])
    tilt = q[:, 3:5] + q[:, 2:3] * [-1.0, 1.0]
    by_side: dict[str, NDArray[np.bool_]] = {
        "crushed": q[:, 5:7] >= radii,
        "folded": np.abs(tilt) >= np.pi / 2,
    }
    if modes is not None:
        closed = modes[-len(q) :] != ContactMode.FREE
        by_side = {name: sides & closed for name, sides in by_side.items()}
    else:
        by_side["separated"] = q[:, 5:7] < -_SEPARATION * radii
        if "multipliers" in run.record:
            normal, across = run.multipliers[:, :2], np.abs(run.multipliers[:, 2:])
            by_side["pulling"] = normal < 0.0
            if run.scene.friction is not None:
                by_side["slipping"] = np.asarray(run.scene.friction) * normal < across
    return {name: sides[:, 0] | sides[:, 1] for name, sides in by_side.items()}


def _check_status(run: Finished, modes: Modes | None) -> None:
    # With `times` the first row may be long after the start, but the last instant is always a row.
    first, last = run.scene.start().time, run.t[-1]
    for name, time in run.violations.items():
        if not first <= time <= last:
            fail(run, f"violation {name}", -1, f"first reported at {time} s, outside the run")
    if run.status in _core.VIOLATIONS and run.status not in run.violations:
        fail(run, f"status {run.status}", -1, "the run did not report this violation")
    shown = _shown(run, modes)
    for name, rows in shown.items():
        if run.status == name and not rows[-1]:
            fail(run, f"status {name}", -1, "the last state does not have this violation")
        if not rows.any():
            continue
        row = int(np.argmax(rows)) + len(run.t) - len(rows)
        if not run.violations.get(name, np.inf) <= run.t[row]:
            fail(run, f"violation {name}", row, "the state has it, but the run did not report it")
        if name in run.stop_on and (row < len(run.t) - 1 or run.status not in shown):
            finding = f"the state is {name}, which should have ended the run"
            fail(run, f"status {run.status}", row, finding)
    end = run.scene.start().time + run.scene.duration
    if run.success and last != end:
        fail(run, "status completed", -1, f"the run should have reached {end} s")
