"""The invariants of a run, for `Run.check`. A failure names the invariant, row and excess."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import numpy as np

from .. import _core
from ..scene.fields import QUANTITIES
from ..scene.outline import contacts
from ..scene.parts import half_lengths, lever
from ..support import SIDES, Bools, checks
from .contact import ContactMode, Modes, active

if TYPE_CHECKING:
    from .run import Run

_RESIDUALS = QUANTITIES["residuals"].symbols
# The core's tolerance for "separated", as a share of the tip's radius: round-off may make the
# compression of a point contact negative.
_SEPARATION = 1e-9
# Violation -> the mode that shows it.
SHOWN_BY = {"slipping": ContactMode.SLIP, "opened": ContactMode.FREE}
# This share of the largest multiplier, or of the largest energy, along the run is round-off.
_ROUND_OFF = 1e-12
# So much is the error of a multiplier that starts from zero at an event, which is located.
_AT_EVENT = 1e-8
# A loss may fall by this share of the exchanged energy, the default limit of the ledger's error: an
# excursion that begins and ends within a step is not seen, and a method's stages may lie beyond the
# end of a slip.
_LOSS = 1e-4
# A run is lost where a contact comes to an end of its face; the place there has this relative
# error, because the event is located.
AT_END = 1e-6


def check_run(run: Run, modes: Modes | None, *, residual: float, closure: float) -> None:
    """Checks every invariant of a run with `known_modes`; `Run.check` explains the tolerances."""
    for name, value in {"residual": residual, "closure": closure}.items():
        checks.number_that(name, value, lambda x: x >= 0.0, "must be >= 0")
    for row in _first(~(np.diff(run.t) > 0)):
        fail(run, "times increase", row + 1, f"the row before is at {run.t[row]} s")
    for name, values in {"t": run.t, **run.arrays()}.items():
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            row, *component = map(int, bad[0])
            fail(run, "finite", row, f"{name}{component or ''} is {values[row, *component]}")
    if modes is not None:
        _check_modes(run, modes)
        _check_end(run)
        if len(modes) == len(run.t) and "multipliers" in run.record:
            _check_multipliers(run, modes)
        if "energy" in run.record:
            _check_losses(run)
    _check_residuals(run, modes, residual)
    _check_closure(run, closure)
    _check_status(run, modes)


def _limit(tolerance: float, scale: float) -> float:
    """Returns the allowed value; an infinite tolerance allows any, also where the scale is zero."""
    return tolerance * scale if np.isfinite(tolerance) else np.inf


def _check_residuals(run: Run, modes: Modes | None, tolerance: float) -> None:
    has_state = "state" in run.record
    if "residuals" in run.record:
        residuals = run.residuals
    elif has_state:
        residuals = _core.residuals(run.scene.parameters(), run.q, run.p)
    else:
        return
    if modes is not None and len(modes) < len(run.t):
        return  # without modes the active constraints are unknown
    held = active(modes, len(run.t))
    if has_state:
        # The largest speed of the object or of a fingertip's centre.
        arms = [lever(finger) for finger in (run.scene.hand.right, run.scene.hand.left)]
        speed = max(np.hypot(*run.p[:, :2].T).max(), (np.abs(run.p[:, 3:5]) * arms).max())
    for k, name in enumerate(_RESIDUALS):
        if k < 2:
            scale, unit, what = run.scene.hand.tips[k].radius, "m", "the fingertip's radius"
        elif has_state:
            scale, unit, what = float(speed), "m/s", "the largest speed"
        else:
            return
        allowed = _limit(tolerance, scale)
        sizes = np.where(held[:, k], np.abs(residuals[:, k]), 0.0)
        row = int(np.argmax(sizes))
        if not sizes[row] <= allowed:
            excess = f"{sizes[row]:.3e} {unit}, more than {allowed:.3e}, {tolerance:g} of {what}"
            fail(run, f"constraint {name}", row, excess)
        if modes is not None and k < 2 and has_state:
            # A free tip is outside of the object, unless it passes beside the face.
            reach = np.abs(contacts(run.scene, run.q).places[:, k])
            beside = reach < (1.0 - AT_END) * half_lengths(run.scene)[k]
            free = (modes[:, k] == ContactMode.FREE) & beside
            for row in _first(free & (residuals[:, k] < -allowed)):
                where = f"the free tip is at {residuals[row, k]:.3e} m"
                fail(run, f"gap >= 0 ({name})", row, where)


def _check_closure(run: Run, tolerance: float) -> None:
    if "energy" not in run.record:
        return
    closure, exchanged = run.energy.closure, run.energy.exchanged
    row = int(np.argmax(np.abs(closure)))
    stored = abs(run.energy.kinetic) + abs(run.energy.elastic) + abs(run.energy.gravity)
    # A run that ends as it starts exchanges no more than the round-off of its energies.
    allowed = _limit(tolerance, exchanged) + _ROUND_OFF * float(stored.max())
    if not abs(closure[row]) <= allowed:
        excess = f"{closure[row]:.3e} J, more than {tolerance:g} of the {exchanged:.3e} J exchanged"
        fail(run, "energy ledger closes", row, excess)


def _shown(run: Run, modes: Modes | None) -> dict[str, Bools]:
    """Returns violation -> whether each recorded row shows it; only the last row if q is missing.

    "rim" is left out, where the rounding of a sine may decide. Free tips show none.
    """
    q = run.q if "state" in run.record else run.state(-1).q[None]
    radii = np.array([tip.radius for tip in run.scene.hand.tips])
    by_side: dict[str, Bools] = {
        "crushed": q[:, 5:7] >= radii,
        "folded": np.abs(contacts(run.scene, q).tilts) >= np.pi / 2,
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


def _check_status(run: Run, modes: Modes | None) -> None:
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


def _check_modes(run: Run, modes: Modes) -> None:
    """Checks that the rows have the modes to which the changes lead, and `violations`, `holds`."""
    first = len(run.t) - len(modes)
    for side, finger in enumerate(SIDES):
        changes = [change for change in run.contact_changes if change.finger == finger]
        mode = changes[0].before if changes else ContactMode(modes[0, side])
        expected = np.full(len(run.t), mode)
        for change in changes:
            if change.before != mode:
                row = int(np.searchsorted(run.t, change.time))
                found = f"the {finger} tip leaves {change.before.name} at {change.time} s in"
                fail(run, "contact changes", row, f"{found} {mode.name}")
            mode = change.after
            expected[run.t >= change.time] = mode
        # A row at the very instant of a change may have either mode.
        settled = ~np.isin(run.t[first:], [change.time for change in changes])
        for row in _first((expected[first:] != modes[:, side]) & settled):
            names = ContactMode(modes[row, side]).name, ContactMode(expected[first + row]).name
            finding = f"the {finger} tip is {names[0]}, its changes lead to {names[1]}"
            fail(run, "contact modes", first + row, finding)
    for name, time in _first_times(run, modes).items():
        if run.violations.get(name) != time:
            finding = f"the modes show it at {time} s first, the run reported"
            fail(run, f"violation {name}", 0, f"{finding} {run.violations.get(name)}")
    held = run.success and not (modes[-1] == ContactMode.FREE).any()
    if run.holds != held:
        fail(run, "holds", -1, f"it is {run.holds}, the status and the last modes say {held}")


def _first_times(run: Run, modes: Modes) -> dict[str, float | None]:
    """Returns violation -> the first time at which a mode shows it and lasts, s, or None."""
    start = run.scene.start().time
    first = {change.finger: change for change in reversed(run.contact_changes)}
    at_start = [
        first[finger].before if finger in first else modes[0, side]
        for side, finger in enumerate(SIDES)
        if finger not in first or first[finger].time > start
    ]
    found: dict[str, float | None] = {}
    for name, mode in SHOWN_BY.items():
        times = [change.time for change in run.contact_changes if change.after == mode]
        found[name] = start if mode in at_start else min(times, default=None)
    return found


def _check_end(run: Run) -> None:
    """Checks that a run ended with the step that `stop_on` ends, and why it is lost."""
    before = run.t[-2] if len(run.t) > 1 else run.scene.start().time
    for name in SHOWN_BY:
        time = run.violations.get(name, np.inf)
        if name in run.stop_on and time < before:
            fail(run, f"status {run.status}", -1, f"{name} at {time} s should have ended the run")
        if name == run.status and not time >= before:
            fail(run, f"status {name}", -1, f"it began at {time} s, before the last step")
    reach = np.abs(contacts(run.scene, run.state(-1).q).places)
    least = (1.0 - AT_END) * np.array(half_lengths(run.scene))
    if run.status == "lost" and not (reach >= least).any():
        fail(run, "status lost", -1, "both contacts are within the faces")


def _check_multipliers(run: Run, modes: Modes) -> None:
    normal, tangential = run.multipliers[:, :2], run.multipliers[:, 2:]
    limit = np.broadcast_to(np.asarray(run.scene.friction, dtype=float), (2,)) * normal
    begins = np.zeros(normal.shape, dtype=bool)
    for change in run.contact_changes:
        begins[:, SIDES.index(change.finger)] |= run.t == change.time
    least = np.where(begins, _AT_EVENT, _ROUND_OFF) * float(np.abs(run.multipliers).max())
    untouched = (modes == ContactMode.FREE) | (modes == ContactMode.GRAZE)
    slips = modes == ContactMode.SLIP
    off = {
        "lambda^H >= 0": (-normal, least, True),
        "no force without contact": (np.maximum(abs(normal), abs(tangential)), 0.0, untouched),
        "|lambda^N| <= mu lambda^H": (abs(tangential) - limit, least, True),
        "|lambda^N| = mu lambda^H in slip": (abs(abs(tangential) - limit), least, slips),
    }
    for invariant, (excess, allowed, rows) in off.items():
        broken = np.argwhere((excess > allowed) & rows)
        if len(broken):
            row, side = map(int, broken[0])
            mode = ContactMode(modes[row, side]).name
            forces = f"lambda^H = {normal[row, side]:.3e} N, lambda^N = {tangential[row, side]:.3e}"
            fail(run, invariant, row, f"the {SIDES[side]} tip is in {mode} with {forces} N")


def _check_losses(run: Run) -> None:
    kicks = np.sort([time for load in run.scene.loads() for time, *_ in load.impulses])
    # An impulse that turns a slip round does work and takes energy; only their sum has a sign.
    kicked = np.searchsorted(kicks, run.t[:-1]) < np.searchsorted(kicks, run.t[1:])
    least = _LOSS * run.energy.exchanged
    for name, exempt in (("friction_loss", False), ("impact_loss", kicked)):
        falls = -np.diff(getattr(run.energy, name))
        for row in _first((falls > least) & ~np.asarray(exempt)):
            fail(run, f"{name} never falls", row + 1, f"it falls by {falls[row]:.3e} J")


def _first(broken: Bools) -> list[int]:
    """Returns the first row of an array (n,) that breaks an invariant; none if no row does."""
    return [int(row) for row in np.flatnonzero(broken)[:1]]


def fail(run: Run, invariant: str, row: int, finding: str) -> NoReturn:
    """Raises the AssertionError of a broken invariant, with the time of the row."""
    row %= len(run.t)
    raise AssertionError(f"{invariant}: {finding} at t = {run.t[row]} s (row {row})")
