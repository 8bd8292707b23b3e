"""Quantities derived from the recorded arrays of runs, for figures and verdicts.

An operation is the interval of the schedule between two switches of its targets. In a row at a
switch, the state belongs to the operation that ends and the multipliers to the one that begins.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from ..scene.control import WRITTEN
from ..support import SIDES, Floats
from .contact import ContactMode, active, known_modes
from .run import Run

# The last share of an operation, in which the grasp must be at rest to count as settled.
LAST = 0.25
# The interval after a switch that counts as the switching point, s: residuals decay with the time
# constant 1 / alpha = 1 ms of the stabilisation (19, 20), and the fingers arrive within 20 ms.
AROUND_SWITCH = 0.05


def operations(run: Run) -> list[tuple[float, float]]:
    """Returns the scheduled begin and end of each operation, s. The run may have ended earlier."""
    start = run.scene.start().time
    end = start + run.scene.duration
    breaks = run.scene.schedule.compile()[0]
    edges = [start, *breaks[(breaks > start) & (breaks < end)].tolist(), end]
    return list(itertools.pairwise(edges))


def settled(run: Run) -> Floats:
    """Returns q at the end of each operation (operations, 9); nan if the run ended before it."""
    rows = np.searchsorted(run.t, [end for _, end in operations(run)])
    # A row beyond the last one is of an operation whose end the run has not reached.
    return np.vstack([run.q, np.full(9, np.nan)])[rows]


def drift(run: Run) -> Floats:
    """Returns the ranges of x, y, theta over each operation's last quarter; nan without its end."""
    return np.array([_late_range(run, *piece) for piece in operations(run)])


def _late_range(run: Run, begin: float, end: float) -> Floats:
    """Returns the ranges of x, y, theta over the last quarter of an interval; nan if it is cut."""
    if run.t[-1] < end:
        return np.full(3, np.nan)
    late = (run.t >= end - LAST * (end - begin)) & (run.t <= end)
    return np.asarray(np.ptp(run.q[late, :3], axis=0))


def settling_times(run: Run, distance: float, angle: float) -> Floats:
    """Returns the time from each switch until the pose stays near its final one, s, or nan (k,)."""
    times = np.full(len(operations(run)), np.nan)
    for k, ((begin, end), final) in enumerate(zip(operations(run), settled(run), strict=True)):
        rows = (run.t > begin) & (run.t <= end)
        away = np.abs(run.q[rows, :3] - final[:3]) > [distance, distance, angle]
        if np.isfinite(final).all():
            outside = np.flatnonzero(away.any(axis=1))
            times[k] = run.t[rows][outside[-1]] - begin if outside.size else 0.0
    return times


def finger_errors(run: Run) -> Floats:
    """Returns |theta_i - theta_i^d| at the end of each operation (operations, 2), rad."""
    if not run.scene.schedules_angles:
        law = WRITTEN[run.scene.law]
        raise ValueError(f"Scene.{law}: the schedule has no angles to compare with")
    middles = np.array([0.5 * (begin + end) for begin, end in operations(run)])
    # At the end of an operation the schedule already has the next target, so use the middle.
    return np.asarray(np.abs(settled(run)[:, 3:5] - run.scene.schedule.target(middles)))


def target_angles(run: Run) -> Floats | None:
    """Returns the scheduled angles in each row (n, 2), rad; None if the schedule has others."""
    return run.scene.schedule.target(run.t) if run.scene.schedules_angles else None


def near_switches(run: Run) -> NDArray[np.bool_]:
    """Returns whether each row (n,) is within `AROUND_SWITCH` after the begin of an operation."""
    begins = np.array([begin for begin, _ in operations(run)])[:, None]
    near = (run.t >= begins) & (run.t <= begins + AROUND_SWITCH)
    return np.asarray(near.any(axis=0))


def held_residuals(run: Run) -> Floats:
    """Returns |C^H|, m, and |C^N|, m/s, where they are `active_constraints`, else 0, (n, 4)."""
    return np.where(active_constraints(run), np.abs(run.residuals), 0.0)


def peak_residuals(run: Run, share: float = 0.0) -> Floats:
    """Returns the largest |C^H|, m, and |C^N|, m/s, after a share of each operation (k, 2)."""
    sizes, found = np.full((len(operations(run)), 2), np.nan), held_residuals(run)
    for k, (begin, end) in enumerate(operations(run)):
        rows = (run.t > begin + share * (end - begin)) & (run.t <= end)
        if rows.any():
            sizes[k] = found[rows, :2].max(), found[rows, 2:].max()
    return sizes


def least_pressing(run: Run) -> Floats:
    """Returns the smallest lambda^H of each operation (operations,), N; 0 where a tip is free."""
    forces = run.multipliers[:, :2]
    rows = [(run.t >= begin) & (run.t < end) for begin, end in operations(run)]
    return np.array([forces[own].min() if own.any() else np.nan for own in rows])


def jumps(run: Run) -> Floats:
    """Returns the instants at which an input may jump (k,), s, in order."""
    switches = run.scene.schedule.compile()[0]
    return np.unique([*switches, *(time for load in run.scene.loads() for time in load.instants())])


def impulses(run: Run) -> dict[float, Floats]:
    """Returns instant, s, in order -> the sum of the impulses then (3,), N s and N m s."""
    start = run.scene.start().time
    found: dict[float, Floats] = {}
    rows = (row.tolist() for load in run.scene.loads() for row in load.impulses)
    for time, *push in sorted(rows):
        if start <= time < start + run.scene.duration:
            found[time] = found.get(time, np.zeros(3)) + push
    return found


def pulling_intervals(run: Run, side: int) -> list[tuple[float, float]]:
    """Returns begin and end, s, of each interval in which a fingertip pulls (lambda^H < 0)."""
    # lambda^H is interpolated linearly between rows, except across a jump of an input.
    t, force, jump = run.t, run.multipliers[:, side], np.isin(run.t, jumps(run))
    pulls = np.concatenate([[False], force < 0.0, [False]])
    edges = np.flatnonzero(pulls[1:] != pulls[:-1])
    found = []
    for first, after in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        begin, end = t[first], t[min(after, len(t) - 1)]
        if first > 0 and not jump[first]:
            begin = _zero(t, force, first)
        if after < len(t) and not jump[after]:
            end = _zero(t, force, after)
        found.append((float(begin), float(end)))
    return found


def _zero(t: Floats, force: Floats, row: int) -> float:
    """Returns the time, s, at which the line between the previous row and `row` crosses zero."""
    before, now = force[row - 1], force[row]
    return float(t[row - 1] + (t[row] - t[row - 1]) * before / (before - now))


def longest_pull(run: Run, begin: float, end: float) -> float:
    """Returns the longest duration, s, of a tip's pull that begins in [begin, end); 0 if none."""
    pulls = [pull for side in (0, 1) for pull in pulling_intervals(run, side)]
    return max((stop - start for start, stop in pulls if begin <= start < end), default=0.0)


def contact_spans(run: Run, side: int) -> list[tuple[float, float, ContactMode]]:
    """Returns begin and end, s, and the mode of each interval in which a contact keeps its mode."""
    changes = [change for change in run.contact_changes if change.finger == SIDES[side]]
    rows = known_modes(run._result)
    assert rows is not None
    modes = [changes[0].before if changes else ContactMode(rows[-1, side])]
    modes += [change.after for change in changes]
    edges = [run.scene.start().time, *(change.time for change in changes), float(run.t[-1])]
    found: list[tuple[float, float, ContactMode]] = []
    for (begin, end), mode in zip(itertools.pairwise(edges), modes, strict=True):
        if found and found[-1][2] is mode:
            begin = found.pop()[0]
        if end > begin or not found:
            found.append((begin, end, mode))
    return found


def contact_modes(run: Run) -> NDArray[np.uint8]:
    """Returns the modes of both contacts in each row (n, 2), as codes of `ContactMode`.

    A row at the instant of a change has the mode before it, to which the row's state belongs;
    `Run.contact` has the mode after it, to which the row's multipliers belong.
    """
    columns = []
    for side in (0, 1):
        spans = contact_spans(run, side)
        ends = [end for _, end, _ in spans[:-1]]
        codes = np.array([mode for _, _, mode in spans], dtype=np.uint8)
        columns.append(codes[np.searchsorted(ends, run.t, side="left")])
    return np.column_stack(columns)


def active_constraints(run: Run) -> NDArray[np.bool_]:
    """Returns which of C_1^H, C_2^H, C_1^N, C_2^N constrain the motion in each row (n, 4)."""
    return active(contact_modes(run) if run.scene.contact == "unilateral" else None, len(run.t))


def friction_demand(run: Run) -> Floats:
    """Returns |lambda^N| / lambda^H, which no slip requires (n, 2); inf of a pull, 0 if free."""
    pressing, along = run.multipliers[:, :2], np.abs(run.multipliers[:, 2:])
    presses = pressing > 0.0
    ratio = np.full(pressing.shape, np.inf)
    np.divide(along, pressing, out=ratio, where=presses)
    # A tip without any contact force needs no friction.
    ratio[(pressing == 0.0) & (along == 0.0)] = 0.0
    return ratio


def onset(run: Run) -> float:
    """Returns the time at which the first disturbance begins, s, or the run's start without one."""
    begins = [load.instants()[0] for load in run.scene.loads()]
    return max(min(begins, default=float(run.t[0])), float(run.t[0]))


def lasting(run: Run) -> bool:
    """True if a force or a moment on the object never ends."""
    return any(
        any(np.any(coefficients[-1] != 0.0) for _, coefficients in load.forces)
        or any(np.isinf(sine[1]) for sine in load.sines)
        or any(np.isinf(row[5]) for row, _, _ in load.noises)
        for load in run.scene.loads()
    )


def since_onset(run: Run) -> NDArray[np.bool_]:
    """Returns whether each row (n,) is at the onset or later; the last row always is."""
    return np.asarray(run.t >= min(onset(run), float(run.t[-1])))


def response(run: Run, undisturbed: Run | None = None) -> tuple[Floats, Floats]:
    """Returns times since a disturbance's onset, s, and changes of q, from then or another run."""
    rows = since_onset(run)
    t, q = run.t[rows], run.q[rows]
    start = min(onset(run), float(t[0]))
    still = q[0]
    if undisturbed is not None:
        # Linear between rows, because figures must not compute a run once more.
        columns = [np.interp(t, undisturbed.t, column) for column in undisturbed.q.T]
        still = np.stack(columns, axis=1)
    return t - start, q - still


def drift_since(run: Run) -> Floats:
    """Returns the ranges of x, y, theta over the last quarter since the onset; nan if it failed."""
    if not run.success:
        return np.full(3, np.nan)
    return _late_range(run, onset(run), float(run.t[-1]))


def swing(run: Run, undisturbed: Run | None = None) -> Floats:
    """Returns the ranges of x, y and theta in the response to a disturbance (3,), m and rad."""
    return np.asarray(np.ptp(response(run, undisturbed)[1][:, :3], axis=0))


def swing_back(run: Run, undisturbed: Run | None = None) -> Floats:
    """Returns the overshoot of x, y, theta beyond the final value, as a share of the peak (3,)."""
    change = response(run, undisturbed)[1][:, :3]
    change = change - change[-1]
    peak = np.take_along_axis(change, np.abs(change).argmax(axis=0)[None], axis=0)[0]
    back = np.max(-np.sign(peak) * change, axis=0)
    return np.asarray(np.divide(back, np.abs(peak), out=np.zeros(3), where=peak != 0.0))


def busy(t: Floats, change: Floats) -> float:
    """Returns the time until the pose stays near its final value, s, from the result of `response`.

    Near means within 0.5 % of the largest distance from it. The time is rounded up to 0.05 s.
    """
    pose = np.abs(change[:, :3] - change[-1, :3])
    moving = np.flatnonzero((pose > 0.005 * pose.max(axis=0, initial=0.0)).any(axis=1))
    last = float(t[moving[-1]]) if moving.size else float(t[-1])
    return min(float(t[-1]), float(np.ceil(20.0 * last) / 20.0))
