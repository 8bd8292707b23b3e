"""A run at any instants: coordinates, modes, forces on the object, violations.

The core computes the run once more, which takes less time than to draw a frame.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..run import measures as measures
from ..run.contact import ContactMode
from ..run.evaluate import evaluate
from ..run.request import Request
from ..run.run import Run
from ..scene import outline
from ..scene.control import Pid
from ..scene.scene import Scene
from ..support.arrays import Floats

# An impulse is shown for this share of the run's time.
_SHOWN = 0.05


class Instant(NamedTuple):
    """A run at one instant. Forces are zero where they are not wanted.

    Attributes:
        time: s.
        q: Coordinates (9,), m and rad.
        modes: Modes of the right and the left contact; None in bilateral contact.
        contact: Forces of the right and the left tip on the object (2, 2), N.
        external: Force and moment of the disturbances (3,), N and N m.
        impulse: The last impulse (3,), N s and N m s, if it was since the instant before, or less
            than `_SHOWN` of the run's time ago; else zero.
        status: Names of the violations since the instant before; at the end of the run its status.
    """

    time: float
    q: Floats
    modes: tuple[ContactMode, ContactMode] | None
    contact: Floats
    external: Floats
    impulse: Floats
    status: tuple[str, ...]


def instants(run: Run, times: Floats, forces: bool) -> list[Instant]:
    """The run at instants (k,), s, between its first and its last row, as the core records them."""
    asked, place = np.unique(times, return_inverse=True)
    found = Request(run.scene, run._options).rows_at(asked, "multipliers", "contact")
    # Events at asked instants of the last step may end the repeated run there.
    place = np.minimum(place, len(found["t"]) - 1)
    q = found["q"][place]
    contact, external = np.zeros((len(times), 2, 2)), np.zeros((len(times), 3))
    pushes: dict[float, Floats] = {}
    if forces:
        contact = _contact_forces(found["multipliers"][place], q[:, 2])
        external = _external(run.scene, times)
        pushes = measures.impulses(run)
    modes: list[Any] = [None] * len(times)
    if run.scene.contact == "unilateral":
        modes = [(ContactMode(a), ContactMode(b)) for a, b in found["contact"][place].tolist()]
    seen = []
    for k, time in enumerate(times.tolist()):
        since = times[k - 1] if k else time
        push, status = _impulse(run, pushes, since, time), _status(run, since, time)
        seen.append(Instant(time, q[k], modes[k], contact[k], external[k], push, status))
    return seen


def _contact_forces(multipliers: Floats, theta: Floats) -> Floats:
    """Forces of the tips on the object (k, 2, 2), N: the rows of (25) for x and y."""
    across = np.column_stack([np.cos(theta), np.sin(theta)])
    along = np.column_stack([-np.sin(theta), np.cos(theta)])
    sides = [
        outline.SIGNS[k] * multipliers[:, k, None] * across + multipliers[:, 2 + k, None] * along
        for k in (0, 1)
    ]
    return np.stack(sides, axis=1)


def _external(scene: Scene, times: Floats) -> Floats:
    """Force and moment of the disturbances (k, 3), without impulses."""
    # They do not depend on the state, nor on what moves the fingers.
    plain = replace(scene, contact="bilateral", fingers="pid", control=Pid(), initial=None)
    q = np.zeros(9)
    return np.array([evaluate(plain, t, q, q).forces.external[:3] for t in times.tolist()])


def _impulse(run: Run, pushes: dict[float, Floats], since: float, time: float) -> Floats:
    """The last impulse, if it is still shown."""
    begun = [each for each in pushes if each <= time]
    shown = _SHOWN * float(run.t[-1] - run.t[0])
    if begun and (begun[-1] > since or time - begun[-1] <= shown):
        return pushes[begun[-1]]
    return np.zeros(3)


def _status(run: Run, since: float, time: float) -> tuple[str, ...]:
    """The violations from `since` to `time`; at the run's end its status."""
    if time >= run.t[-1]:
        return (run.status,)
    return tuple(
        name
        for name, spans in run.violation_intervals.items()
        if ((spans[:, 1] >= since) & (spans[:, 0] <= time)).any()
    )
