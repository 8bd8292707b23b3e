"""The invariants of a run with unilateral contact, for `Run.check`."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..support.arrays import Floats
from .contact import ContactMode, Modes
from .finished import Finished, fail

Rows: TypeAlias = NDArray[np.bool_]

SIDES = ("right", "left")
# Violation -> the mode that shows it.
SHOWN_BY = {"slipping": ContactMode.SLIP, "opened": ContactMode.FREE}
# Multipliers up to this share of their largest magnitude along the run are round-off.
_ROUND_OFF = 1e-12
# A loss may fall by this share of the exchanged energy: where a slip stops, a method's stages may
# lie a little beyond the stop.
_LOSS = 1e-9
# A run is lost where a contact comes to an end of its face; the place there has this relative
# error, because the event is located.
AT_END = 1e-6


def check_contact(run: Finished, modes: Modes) -> None:
    """Checks modes, multipliers and losses of a run with unilateral contact.

    Args:
        run: The run.
        modes: The modes of all rows (n, 2), or of the last row (1, 2) if no others are known.

    Raises:
        AssertionError: An invariant is broken.
    """
    _check_modes(run, modes)
    _check_end(run)
    if len(modes) == len(run.t) and "multipliers" in run.record:
        _check_multipliers(run, modes)
    if "energy" in run.record:
        _check_losses(run)


def changing(run: Finished) -> Rows:
    """Returns where a tip's mode changes at the very instant of a row (n, 2).

    Such a row has the state before the change, and the mode after it; but at an impulse the mode
    before it.
    """
    found = np.zeros((len(run.t), 2), dtype=bool)
    for change in run.contact_changes:
        found[run.t == change.time, SIDES.index(change.finger)] = True
    return found


def places(run: Finished, q: Floats) -> Floats:
    """Returns the places G_i (11) of the contacts on their faces, from the middle up (n, 2), m."""
    hand, signs, theta = run.scene.hand, np.array([-1.0, 1.0]), q[:, 2:3]
    length, thick, root = (
        np.array([getattr(finger, name) for finger in (hand.right, hand.left)])
        for name in ("length", "half_thickness", "root_offset")
    )
    tilt = q[:, 3:5] + signs * theta
    middle = q[:, 1:2] * np.cos(theta) - q[:, :1] * np.sin(theta)
    tip = length * np.cos(tilt) - thick * np.sin(tilt) + signs * root * np.sin(theta)
    return np.asarray(middle - tip)


def half_height(run: Finished) -> float:
    """Returns half the height of the object's faces, m; inf if they are endless."""
    height = run.scene.grasped.height
    return np.inf if height is None else 0.5 * height


def _check_modes(run: Finished, modes: Modes) -> None:
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
        settled = ~changing(run)[first:, side]
        wrong = np.flatnonzero((expected[first:] != modes[:, side]) & settled)
        if wrong.size:
            row = int(wrong[0])
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


def _first_times(run: Finished, modes: Modes) -> dict[str, float | None]:
    """Returns violation -> the first time at which a mode shows it, s, or None."""
    begun = {change.finger: change.before for change in reversed(run.contact_changes)}
    at_start = [begun.get(finger, modes[0, side]) for side, finger in enumerate(SIDES)]
    found: dict[str, float | None] = {}
    for name, mode in SHOWN_BY.items():
        times = [change.time for change in run.contact_changes if change.after == mode]
        found[name] = run.scene.start().time if mode in at_start else min(times, default=None)
    return found


def _check_end(run: Finished) -> None:
    """Checks that a run ended with the step that `stop_on` ends, and why it is lost."""
    before = run.t[-2] if len(run.t) > 1 else run.scene.start().time
    for name in SHOWN_BY:
        time = run.violations.get(name, np.inf)
        if name in run.stop_on and time < before:
            fail(run, f"status {run.status}", -1, f"{name} at {time} s should have ended the run")
        if name == run.status and not time >= before:
            fail(run, f"status {name}", -1, f"it began at {time} s, before the last step")
    reach = np.abs(places(run, run.state(-1).q[None])).max()
    if run.status == "lost" and not reach >= (1.0 - AT_END) * half_height(run):
        fail(run, "status lost", -1, "both contacts are within the faces")


def _check_multipliers(run: Finished, modes: Modes) -> None:
    normal, tangential = run.multipliers[:, :2], run.multipliers[:, 2:]
    limit = np.broadcast_to(np.asarray(run.scene.friction, dtype=float), (2,)) * normal
    least = _ROUND_OFF * float(np.abs(run.multipliers).max())
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


def _check_losses(run: Finished) -> None:
    compiled = [disturbance.compile() for disturbance in run.scene.disturbances]
    kicks = np.sort([time for one in compiled for time, *_ in one.impulses])
    # An impulse that turns a slip round does work and takes energy; only their sum has a sign.
    kicked = np.searchsorted(kicks, run.t[:-1]) < np.searchsorted(kicks, run.t[1:])
    least = _LOSS * run.energy.exchanged
    for name, exempt in (("friction_loss", False), ("impact_loss", kicked)):
        falls = -np.diff(getattr(run.energy, name))
        broken = np.flatnonzero((falls > least) & ~np.asarray(exempt))
        if broken.size:
            row = int(broken[0]) + 1
            fail(run, f"{name} never falls", row, f"it falls by {falls[row - 1]:.3e} J")
