"""The null-space form compiled by Numba, and what runs on it: RK4, and numbalsoda where it is."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import carray, cfunc, config, njit

import numpy_model
from machine import evaluation_time
from null_space import NAMES, Floats, right_hand_side

try:
    from numbalsoda import dop853, lsoda, lsoda_sig
except (ImportError, AttributeError):
    # It is built from Fortran, which not every machine has a compiler for, and needs Numba's.
    dop853 = lsoda = None

PARAMETERS = len(NAMES)
# Python checks every division for zero, which is no part of the model.
_compiled = njit(error_model="numpy")
_inlined = njit(error_model="numpy", forceinline=True)
_plain, _ = right_hand_side(math.sin, math.cos, _inlined)


def unpacked(count: int) -> Callable[[Any], Any]:
    """An array's first numbers as a tuple, written out: slices of arrays Numba keeps in memory."""
    space: dict[str, Any] = {}
    exec(f"def numbers(a):\n    return ({', '.join(f'a[{k}]' for k in range(count))})", space)
    return _inlined(space["numbers"])


_state, _numbers = unpacked(14), unpacked(PARAMETERS)


@_inlined
def _rates(y, c):  # type: ignore[no-untyped-def]
    return _plain(_state(y), _numbers(c))


def compile_rk4(
    rates: Callable[..., Any],
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Two compiled functions of compiled rates: `fill`, which writes them, and `rk4`."""

    @_compiled
    def fill(y, c, out):  # type: ignore[no-untyped-def]
        """Writes the rates at y into `out`, one by one: Numba is slow at a tuple in a loop."""
        r = rates(y, c)
        out[0], out[1], out[2], out[3], out[4], out[5], out[6] = (
            r[0],
            r[1],
            r[2],
            r[3],
            r[4],
            r[5],
            r[6],
        )
        out[7], out[8], out[9], out[10] = r[7], r[8], r[9], r[10]
        out[11], out[12], out[13] = r[11], r[12], r[13]

    @_compiled
    def rk4(y0, c, duration, n):  # type: ignore[no-untyped-def]
        """The state after n equal steps."""
        h = duration / n
        y, z = y0.copy(), np.empty(14)
        k1, k2, k3, k4 = np.empty(14), np.empty(14), np.empty(14), np.empty(14)
        for _ in range(n):
            fill(y, c, k1)
            for i in range(14):
                z[i] = y[i] + 0.5 * h * k1[i]
            fill(z, c, k2)
            for i in range(14):
                z[i] = y[i] + 0.5 * h * k2[i]
            fill(z, c, k3)
            for i in range(14):
                z[i] = y[i] + h * k3[i]
            fill(z, c, k4)
            for i in range(14):
                y[i] += h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
        return y

    return fill, rk4


fill, rk4 = compile_rk4(_rates)


@_compiled
def slope(t, y, c):  # type: ignore[no-untyped-def]
    """As SciPy asks for it."""
    out = np.empty(14)
    fill(y, c, out)
    return out


@_compiled
def rates_into(t, y, rates, c):  # type: ignore[no-untyped-def]
    """As SUNDIALS asks for them."""
    fill(y, c, rates)


_terms = _compiled(numpy_model.terms)


@_compiled
def residual(t, y, rate, out, data):  # type: ignore[no-untyped-def]
    """(24) as a DAE of index one in (q, p, integral, lambda) (24,); data is (u, c) of `terms`."""
    u, c = data[:5], data[5:]
    p = y[9:18]
    masses, phi, force, gamma = _terms(y[:9], p, y[18:20], u, c)
    out[:9] = rate[:9] - p
    out[9:18] = masses * rate[9:18] - force - phi.T @ y[20:]
    out[18:20] = rate[18:20] - (y[3:5] - u[:2])
    out[20:] = phi @ rate[9:18] + gamma


@_compiled
def accelerations(y, data):  # type: ignore[no-untyped-def]
    """p' (9,) and lambda (4,) that (24) asks for at (q, p, integral): what IDA starts from."""
    masses, phi, force, gamma = _terms(y[:9], y[9:18], y[18:20], data[:5], data[5:])
    weighted = phi / masses
    multipliers = np.linalg.solve(weighted @ phi.T, -gamma - weighted @ force)
    return (force + phi.T @ multipliers) / masses, multipliers


@_compiled
def _evaluate(y, c, n):  # type: ignore[no-untyped-def]
    """Each evaluation needs the one before, or the compiler would take it out of the loop."""
    out = np.zeros(14)
    z = y.copy()
    for _ in range(n):
        for i in range(14):
            z[i] = y[i] + 1e-30 * out[i]
        fill(z, c, out)
    return out


def evaluated(y: Floats, c: Floats) -> float:
    """Time of one evaluation inside of compiled code, s."""
    # Where NUMBA_DISABLE_JIT leaves plain Python, a few evaluations are enough.
    n = 20 if config.DISABLE_JIT else 20_000
    return evaluation_time(lambda: _evaluate(y, c, n), n)


if lsoda is not None:

    @cfunc(lsoda_sig, error_model="numpy")
    def _callback(t, y, dy, data):  # type: ignore[no-untyped-def]
        fill(carray(y, (14,)), carray(data, (PARAMETERS,)), carray(dy, (14,)))

    _ADDRESS = _callback.address
    _MOST = 10_000_000

    # Called from compiled code: from Python ctypes would cost more than a good part of the run.
    @njit
    def numbalsoda_dop853(y0, c, duration, rtol, atol):  # type: ignore[no-untyped-def]
        ends = np.array([0.0, duration])
        states, good = dop853(_ADDRESS, y0, ends, c, rtol, atol, _MOST)
        return states[1] if good else np.full(14, np.nan)

    @njit
    def numbalsoda_lsoda(y0, c, duration, rtol, atol):  # type: ignore[no-untyped-def]
        ends = np.array([0.0, duration])
        states, good = lsoda(_ADDRESS, y0, ends, c, rtol, atol, _MOST)
        return states[1] if good else np.full(14, np.nan)
