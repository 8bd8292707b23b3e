"""Piecewise polynomials that represent inputs over time: held, linear and smooth ones.

A piecewise polynomial is `(breaks, coefficients)`: breaks (m,) in seconds, coefficients
(m + 1, channels, degree + 1) in ascending powers of the time since the start of the piece. Row 0 is
constant and holds before the first break; the last row has no end. All functions here also make
many at once: if times or values have extra first axes (runs, ...), the result has them too.
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ..support.arrays import Floats

Piecewise: TypeAlias = tuple[Floats, Floats]

# A gap or overlap below this share of the time is round-off between consecutive moves.
ROUND_OFF = 4 * float(np.finfo(np.float64).eps)
# Breaks from this time on, s, are later than the end of any run.
_NEVER = 2.0**1022


def held(times: Floats, values: Floats, before: Floats) -> Piecewise:
    """Holds `values[k]` (k, channels) from `times[k]` on; before times[0], `before` (channels,)."""
    return _joined(times, _behind(before, values)[..., None])


def linear(times: Floats, values: Floats, before: Floats) -> Piecewise:
    """Interpolates linearly between knots; holds `before` ahead of them, the last value after."""
    with np.errstate(over="ignore", invalid="ignore"):
        slopes = np.diff(values, axis=-2) / np.diff(times)[..., None]
    flat = np.zeros((*slopes.shape[:-2], 1, slopes.shape[-1]))
    slopes = np.concatenate([flat, slopes, flat], axis=-2)
    return _joined(times, np.stack(np.broadcast_arrays(_behind(before, values), slopes), axis=-1))


def _behind(before: Floats, values: Floats) -> Floats:
    """Prepends `before` (..., channels) as a row to `values` (..., k, channels)."""
    row = np.broadcast_to(before[..., None, :], (*values.shape[:-2], 1, values.shape[-1]))
    return np.concatenate([row, values], axis=-2)


def _joined(times: Floats, coefficients: Floats) -> Piecewise:
    """Broadcasts the first axes (runs, ...) of breaks and coefficients to a common shape."""
    front = np.broadcast_shapes(times.shape[:-1], coefficients.shape[:-3])
    times = np.broadcast_to(times, (*front, times.shape[-1]))
    return times, np.broadcast_to(coefficients, (*front, *coefficients.shape[-3:]))


def padded(pieces: Sequence[Piecewise]) -> Piecewise:
    """Stacks polynomials along a new first axis; missing breaks are later than any run's end."""
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


def require_finite(name: str, piecewise: Piecewise) -> None:
    """Refuses coefficients that overflow, because knots are too close for the change of value."""
    if not np.isfinite(piecewise[1]).all():
        raise ValueError(f"{name}: too short, the rates of change overflow")


def evaluate(piecewise: Piecewise, t: Floats) -> Floats:
    """Returns the values (..., channels) at times `t` (...), s; at a break those after it."""
    breaks, coefficients = piecewise
    piece = np.searchsorted(breaks, t, side="right")
    tau = (t - np.concatenate([[0.0], breaks])[piece])[..., None]
    result = np.zeros((*t.shape, coefficients.shape[1]))
    for k in reversed(range(coefficients.shape[2])):
        result = result * tau + coefficients[piece, :, k]
    return result


def derivative(piecewise: Piecewise) -> Piecewise:
    """Returns the derivative by time, with as many coefficients; jumps have no part in it."""
    breaks, coefficients = piecewise
    # The product is zero for the power zero, whose place becomes that of the highest power.
    return breaks, np.roll(coefficients * np.arange(coefficients.shape[-1]), -1, axis=-1)


def moves(starts: Floats, points: Floats, lasting: float | Floats) -> Piecewise:
    """Quintic moves (10 s^3 - 15 s^4 + 6 s^5) from each point to the next, with rest between them.

    Only the points may have extra first axes, because the times determine the number of pieces.
    """
    lasting = np.broadcast_to(lasting, len(starts))
    each, ends = lasting[:, None], starts + lasting
    # Derivatives of inputs come from complex numbers (directions.py).
    rest = np.zeros((*points.shape, 6), np.result_type(starts, points, lasting))
    rest[..., 0] = points
    # Divide repeatedly, because the fifth power overflows or underflows for extreme durations.
    powers = np.array([10.0, -15.0, 6.0]) / each / each / each
    powers[:, 1:] /= each
    powers[:, 2:] /= each
    move = rest[..., :-1, :, :].copy()
    move[..., 3:] = np.diff(points, axis=-2)[..., None] * powers[:, None]
    # No rest follows a move that ends with the start of the next one, or later than any run.
    rests = np.isfinite(ends)
    rests[:-1] &= (starts[1:] - ends[:-1]).real > ROUND_OFF * abs(starts[1:])
    kept = np.column_stack([np.ones_like(rests), rests]).ravel()
    pieces = np.stack([move, rest[..., 1:, :, :]], axis=-3)
    pieces = pieces.reshape(*move.shape[:-3], -1, *move.shape[-2:])[..., kept, :, :]
    breaks = np.column_stack([starts, ends]).ravel()[kept]
    return _joined(breaks, np.concatenate([rest[..., :1, :, :], pieces], axis=-3))


def through(times: Floats, angles: Floats) -> Piecewise:
    """The motion with least jerk that passes each row of the angles at its time, in quintics.

    It rests at both ends. The optimum (Flash and Hogan, J. Neurosci. 5, 1985) is of degree five
    between the knots, with derivatives up to the fourth that are continuous at them. So each piece
    is fixed by the velocities v and the accelerations a at its two knots (Hermite), and the jumps
    of jerk and snap at the inner knots vanish. Only the angles may have extra first axes.
    """
    if len(times) == 1:
        return held(times[1:], angles[..., 1:, :], angles[..., 0, :])
    # In units of the whole duration, whose powers would overflow for extreme times.
    span = times[-1] - times[0]
    h = np.diff(times) / span
    knots = np.moveaxis(angles, -2, 0)
    x = knots.reshape(len(times), -1)
    v, a = _at_knots(h, np.diff(x, axis=0))
    by, half = h[:, None], 0.5 / h[:, None] ** 3
    way, v0, v1, a0, a1 = np.diff(x, axis=0), v[:-1] * by, v[1:] * by, a[:-1] * by**2, a[1:] * by**2
    pieces = [
        x[:-1],
        v[:-1],
        0.5 * a[:-1],
        (20.0 * way - 12.0 * v0 - 8.0 * v1 - 3.0 * a0 + a1) * half,
        (-30.0 * way + 16.0 * v0 + 14.0 * v1 + 3.0 * a0 - 2.0 * a1) * half / by,
        (12.0 * way - 6.0 * (v0 + v1) + a1 - a0) * half / by / by,
    ]
    rows = np.zeros((len(times) + 1, x.shape[1], 6), np.result_type(times, angles))
    for k in range(6):
        for _ in range(k):
            pieces[k] = pieces[k] / span
        rows[1:-1, :, k] = pieces[k]
    rows[0, :, 0], rows[-1, :, 0] = x[0], x[-1]
    return _joined(times, np.moveaxis(rows.reshape(-1, *knots.shape[1:], 6), 0, -3))


def _at_knots(h: Floats, ways: Floats) -> tuple[Floats, Floats]:
    """The velocities and accelerations (k, channels) at all knots, which are zero at both ends."""
    count, kind = len(h) + 1, np.result_type(h, ways)
    found = np.zeros((count, 2, ways.shape[1]), kind)
    ahead = np.zeros((count, 2, 2), kind)
    for i in range(1, count - 1):
        left, right = 1.0 / h[i - 1], 1.0 / h[i]
        both, odd = left**3 + right**3, right**2 - left**2
        # Rows: the jump of the snap, and of the jerk; columns: v and a.
        own = np.array([[16.0 * both, 3.0 * odd], [3.0 * odd, 0.75 * (left + right)]])
        before = np.array([[14.0 * left**3, 2.0 * left**2], [-2.0 * left**2, -0.25 * left]])
        after = np.array([[14.0 * right**3, -2.0 * right**2], [2.0 * right**2, -0.25 * right]])
        snap = 30.0 * (ways[i] * right**4 + ways[i - 1] * left**4)
        jumps = np.array([snap, 5.0 * (ways[i] * right**3 - ways[i - 1] * left**3)])
        own = own - before @ ahead[i - 1]
        ((p, q), (r, s)) = own
        inverse = np.array([[s, -q], [-r, p]]) / (p * s - q * r)
        ahead[i] = inverse @ after
        found[i] = inverse @ (jumps - before @ found[i - 1])
    for i in range(count - 2, 0, -1):
        found[i] -= ahead[i] @ found[i + 1]
    return found[:, 0], found[:, 1]
