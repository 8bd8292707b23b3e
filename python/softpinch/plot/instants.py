"""A run at any instants: interpolated coordinates, modes, forces on the object, violations.

Only rows next to the instants are read, so that a film of a long run costs no more than its frames.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..run import measures as measures
from ..run.contact import ContactMode
from ..run.evaluate import evaluate
from ..run.run import Run
from ..run.simulate import simulate
from ..scene import outline
from ..scene.control import Pid
from ..scene.scene import Scene
from ..support.arrays import Floats

# Duration of the run that gives the forces at a state, s; only its first instant is used.
_MOMENT = 1e-6
# An impulse is shown for this share of the run's time.
SHOWN = 0.05


class Instant(NamedTuple):
    """A run at one instant.

    Attributes:
        time: s.
        q: Coordinates (9,), m and rad; NaN where the run's state is not finite.
        modes: Modes of the right and the left contact; None in bilateral contact.
        contact: Forces of the right and the left tip on the object (2, 2), N; None if not wanted,
            NaN where they are unknown.
        external: Force and moment of the disturbances (3,), N and N m; None if not wanted.
        impulse: The last impulse (3,), N s and N m s, if it was since the instant before, or less
            than `SHOWN` of the run's time ago; else, and if forces are not wanted, None.
        status: What is to be said of the instant: names of the violations since the instant before,
            or, at the end of the run, the run's status.
    """

    time: float
    q: Floats
    modes: tuple[ContactMode, ContactMode] | None
    contact: Floats | None
    external: Floats | None
    impulse: Floats | None
    status: tuple[str, ...]


def instants(run: Run, times: Floats, forces: bool) -> list[Instant]:
    """The run at some instants.

    Between rows, coordinates follow the cubic Hermite polynomial of q and p. Where a velocity jumps
    (an impulse, a change of a contact's mode), and in between of multipliers, they follow the
    straight line; multipliers keep a row's value up to a jump of an input or of a mode.

    Args:
        run: A run with "state" recorded.
        times: The instants (k,), s, increasing and within the recorded ones.
        forces: Whether forces are wanted. Multipliers that were not recorded are computed from the
            recorded states.

    Raises:
        NotRecordedError: The state was not recorded.
    """
    after = np.minimum(np.searchsorted(run.t, times, side="left"), len(run) - 1)
    before = np.where(run.t[after] > times, np.maximum(after - 1, 0), after)
    span = run.t[after] - run.t[before]
    share = np.divide(times - run.t[before], span, out=np.zeros(len(times)), where=span > 0.0)
    modes = measures.modes_at(run, times) if run.scene.contact == "unilateral" else None
    q = _coordinates(run, before, after, share)
    contact = _contact_forces(run, before, after, share, q[:, 2], times) if forces else None
    external = _external(run.scene, times) if forces else None
    pushes = impulses(run) if forces else {}
    found = []
    for k, time in enumerate(times.tolist()):
        since = times[k - 1] if k else time
        found.append(
            Instant(
                time,
                q[k],
                None if modes is None else (ContactMode(modes[k, 0]), ContactMode(modes[k, 1])),
                None if contact is None else contact[k],
                None if external is None else external[k],
                _impulse(run, pushes, since, time),
                _status(run, since, time),
            )
        )
    return found


def _coordinates(
    run: Run, before: NDArray[np.intp], after: NDArray[np.intp], share: Floats
) -> Floats:
    """Interpolated coordinates (k, 9)."""
    s, span = share[:, None], (run.t[after] - run.t[before])[:, None]
    low, high = run.q[before], run.q[after]
    with np.errstate(invalid="ignore", over="ignore"):
        line = (1.0 - s) * low + s * high
        # The difference from the straight line to the polynomial with the slopes p at both ends.
        bend = (1.0 - s) * (span * run.p[before] - (high - low))
        bend -= s * (span * run.p[after] - (high - low))
        smooth = line + s * (1.0 - s) * bend
    # A row at an impulse has the velocity before it.
    kinks = np.union1d(measures.impulses(run), _changes(run))
    first = np.searchsorted(kinks, run.t[before], side="left")
    jumps = first < np.searchsorted(kinks, run.t[after], side="right")
    found = np.where(jumps[:, None], line, smooth)
    exact = share == 0.0
    found[exact] = low[exact]
    return np.asarray(found)


def _changes(run: Run) -> Floats:
    """The instants at which a contact changes its mode (k,), s."""
    return np.array([change.time for change in run.contact_changes])


def _contact_forces(
    run: Run,
    before: NDArray[np.intp],
    after: NDArray[np.intp],
    share: Floats,
    theta: Floats,
    times: Floats,
) -> Floats:
    """Forces of the tips on the object (k, 2, 2), N, along the faces of its angles theta (k,)."""
    rows, place = np.unique(np.concatenate([before, after]), return_inverse=True)
    known = _multipliers(run, rows)
    low, high = known[place[: len(times)]], known[place[len(times) :]]
    jumps = np.union1d(measures.jumps(run), _changes(run))
    # The first jump after the row before, if it is not after the row after. The values of a row
    # hold from its jump on.
    first = np.append(jumps, np.inf)[np.searchsorted(jumps, run.t[before], side="right")]
    held = first <= run.t[after]
    part = np.where(held, (times >= first).astype(float), share)[:, None]
    with np.errstate(invalid="ignore", over="ignore"):
        found = np.where(part == 0.0, low, np.where(part == 1.0, high, low + part * (high - low)))
        across = np.column_stack([np.cos(theta), np.sin(theta)])
        along = np.column_stack([-np.sin(theta), np.cos(theta)])
        # The rows of (25) for x and y, times the multipliers.
        sides = [
            outline.SIGNS[k] * found[:, k, None] * across + found[:, 2 + k, None] * along
            for k in (0, 1)
        ]
    return np.stack(sides, axis=1)


def _multipliers(run: Run, rows: NDArray[np.intp]) -> Floats:
    """Multipliers in some rows (k, 4), N; computed from the states if they were not recorded."""
    if "multipliers" in run.record:
        return run.multipliers[rows]
    found = np.full((len(rows), 4), np.nan)
    direct = run.scene.contact == "bilateral" and run.scene.law != "sampled"
    for k, row in enumerate(rows.tolist()):
        if not (np.isfinite(run.q[row]).all() and np.isfinite(run.p[row]).all()):
            continue
        if direct:
            terms = evaluate(
                run.scene, run.t[row], run.q[row], run.p[row], run.integral[row],
                formulation=run.formulation, stabilization=run.stabilization,
            )  # fmt: skip
            found[k] = terms.multipliers
        else:
            found[k] = _begun(run, row)
    return found


def _begun(run: Run, row: int) -> Floats:
    """Multipliers at the start of a run from a row's state (4,); NaN if no run can start there."""
    # The state's position in its grid of steps concerns the continued run only.
    state = replace(run.state(row), check=False, grid=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            scene = replace(run.scene, initial=state, duration=_MOMENT)
            begun = simulate(
                scene, _MOMENT, record=("multipliers",),
                formulation=run.formulation, stabilization=run.stabilization,
            )  # fmt: skip
        except ValueError:
            return np.full(4, np.nan)
    return np.asarray(begun.multipliers[0])


def _external(scene: Scene, times: Floats) -> Floats | None:
    """Force and moment of the disturbances (k, 3), without impulses; None without disturbances."""
    if not scene.disturbances:
        return None
    # They do not depend on the state, nor on what moves the fingers.
    plain = replace(scene, contact="bilateral", fingers="pid", control=Pid(), initial=None)
    q = np.zeros(9)
    return np.array([evaluate(plain, t, q, q).forces.external[:3] for t in times.tolist()])


def impulses(run: Run) -> dict[float, Floats]:
    """Instant, s, of the impulses on the run -> their sum (3,), N s and N m s, in order of time."""
    start = run.scene.start().time
    compiled = [disturbance.compile().impulses for disturbance in run.scene.disturbances]
    found: dict[float, Floats] = {}
    for time, *push in sorted(np.asarray(each).tolist() for some in compiled for each in some):
        if start <= time < start + run.scene.duration:
            found[time] = found.get(time, np.zeros(3)) + push
    return found


def _impulse(run: Run, pushes: dict[float, Floats], since: float, time: float) -> Floats | None:
    """The last impulse, if it is still shown."""
    begun = [each for each in pushes if each <= time]
    shown = SHOWN * float(run.t[-1] - run.t[0])
    if begun and (begun[-1] > since or time - begun[-1] <= shown):
        return pushes[begun[-1]]
    return None


def _status(run: Run, since: float, time: float) -> tuple[str, ...]:
    """The violations from `since` to `time`; at the run's end its status."""
    if time >= run.t[-1]:
        return (run.status,)
    found = []
    for name, spans in run.violation_intervals.items():
        # Intervals are in the order of time.
        first = np.searchsorted(spans[:, 1], since, side="left")
        if first < len(spans) and spans[first, 0] <= time:
            found.append(name)
    return tuple(found)
