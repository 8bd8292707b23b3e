"""Numba's ways through an ensemble: a loop over the runs, and lanes by hand.

LLVM turns an inner loop over lanes into vectors if nothing in it is a call, so sine and cosine are
written out; and if it goes to 16 or more, as a shorter one may not check that arrays are apart.
"""

from typing import Any

import numpy as np
from numba import njit

from null_space import NAMES, right_hand_side
from numba_model import compile_rk4, unpacked

LANES = 64
_STATES, _PARAMETERS = 14, len(NAMES)
_compiled = njit(error_model="numpy")
# Fused multiply-add allowed, nothing else that changes results.
_inlined = njit(error_model="numpy", fastmath={"contract"}, forceinline=True)


@_inlined
def _sine_cosine(x):  # type: ignore[no-untyped-def]
    """Cody and Waite's reduction to +-pi/4, fdlibm's polynomials, and the quadrant."""
    k = (x * 0.6366197723675814 + 6755399441055744.0) - 6755399441055744.0
    r = (x - k * 1.5707963267948966) - k * 6.123233995736766e-17
    z = r * r
    w = z * z
    s = (-1.66666666666666324348e-01 + z * 8.33333333332248946124e-03) + w * (
        (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
        + w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    )
    c = (4.16666666666666019037e-02 + z * -1.38888888888741095749e-03) + w * (
        (2.48015872894767294178e-05 + z * -2.75573143513906633035e-07)
        + w * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    )
    return r + (r * z) * s, (1.0 - 0.5 * z) + w * c, int(k)


@_inlined
def _sine(x):  # type: ignore[no-untyped-def]
    sine, cosine, quadrant = _sine_cosine(x)
    value = cosine if quadrant & 1 else sine
    return -value if quadrant & 2 else value


@_inlined
def _cosine(x):  # type: ignore[no-untyped-def]
    sine, cosine, quadrant = _sine_cosine(x)
    value = sine if quadrant & 1 else cosine
    return -value if (quadrant + 1) & 2 else value


def _columns(rows: int) -> Any:
    """(array, lane) -> that lane's tuple: with its rows written out, as Numba likes it best."""
    values = ", ".join(f"a[{row * LANES} + lane]" for row in range(rows))
    space: dict[str, Any] = {}
    exec(f"def column(a, lane):\n    return {values}", space)
    return _inlined(space["column"])


_state, _parameters = _columns(_STATES), _columns(_PARAMETERS)
_rates, _ = right_hand_side(_sine, _cosine, _inlined)


@_inlined
def _fill(y, c, out):  # type: ignore[no-untyped-def]
    for lane in range(LANES):
        r = _rates(_state(y, lane), _parameters(c, lane))
        out[lane], out[LANES + lane], out[2 * LANES + lane] = r[0], r[1], r[2]
        out[3 * LANES + lane], out[4 * LANES + lane], out[5 * LANES + lane] = r[3], r[4], r[5]
        out[6 * LANES + lane], out[7 * LANES + lane], out[8 * LANES + lane] = r[6], r[7], r[8]
        out[9 * LANES + lane], out[10 * LANES + lane], out[11 * LANES + lane] = r[9], r[10], r[11]
        out[12 * LANES + lane], out[13 * LANES + lane] = r[12], r[13]


@njit(error_model="numpy", fastmath={"contract"})
def lanes(states, parameters, steps, h):  # type: ignore[no-untyped-def]
    """Advances states (14, runs) in place; the runs must divide by `LANES`."""
    size = _STATES * LANES
    y, z, k, total = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    c = np.empty(_PARAMETERS * LANES)
    for at in range(0, states.shape[1], LANES):
        for i in range(_PARAMETERS):
            c[i * LANES : (i + 1) * LANES] = parameters[i, at : at + LANES]
        for i in range(_STATES):
            y[i * LANES : (i + 1) * LANES] = states[i, at : at + LANES]
        for _ in range(steps):
            _fill(y, c, k)
            for i in range(size):
                total[i] = k[i]
                z[i] = y[i] + 0.5 * h * k[i]
            _fill(z, c, k)
            for i in range(size):
                total[i] += 2.0 * k[i]
                z[i] = y[i] + 0.5 * h * k[i]
            _fill(z, c, k)
            for i in range(size):
                total[i] += 2.0 * k[i]
                z[i] = y[i] + h * k[i]
            _fill(z, c, k)
            for i in range(size):
                y[i] += h / 6.0 * (total[i] + k[i])
        for i in range(_STATES):
            states[i, at : at + LANES] = y[i * LANES : (i + 1) * LANES]


_one_state, _one_parameters = unpacked(_STATES), unpacked(_PARAMETERS)


@_inlined
def _one(y, c):  # type: ignore[no-untyped-def]
    return _rates(_one_state(y), _one_parameters(c))


_one_fill, _one_rk4 = compile_rk4(_one)


@_compiled
def slope(t, y, c):  # type: ignore[no-untyped-def]
    """As SciPy asks for it."""
    out = np.empty(_STATES)
    _one_fill(y, c, out)
    return out


@_compiled
def loop(states, parameters, duration, steps):  # type: ignore[no-untyped-def]
    """The runs one after the other: states (14, runs) after the steps."""
    out = np.empty_like(states)
    for run in range(states.shape[1]):
        y, c = states[:, run].copy(), parameters[:, run].copy()
        out[:, run] = _one_rk4(y, c, duration, steps)
    return out
