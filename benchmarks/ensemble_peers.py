"""Other ways through an ensemble, each as a good user would write it; what is missing says so.

`PEERS` has them by name. One is prepared for a work (compiled, warmed up by its first call) and
gives `solve(setting)`: the states at the end, (14, runs). All take the null-space form.
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

# Says what JAX must hear before its import.
import peers
from ensemble_work import Work
from null_space import NAMES, SIZE, Floats, right_hand_side
from peers import MISSING, heyoka, jax

ensemble_numba: Any = None
if "numba" not in MISSING:
    import ensemble_numba
# Name -> path, of the C++ compilers that are installed.
COMPILERS: dict[str, str] = {}
for _name, _command in {"gcc": "g++", "clang": "clang++"}.items():
    _path = shutil.which(_command)
    if _path is None:
        MISSING[_command] = "not installed"
    else:
        COMPILERS[_name] = _path

# How many runs a batch of heyoka's holds: as many as it recommends, and twice as many. It may
# recommend half of what an AVX-512 register holds, and twice as many were seen to be faster there.
WIDTHS = [] if heyoka is None else [k * heyoka.recommended_simd_size() for k in (1, 2)]
Solve = Callable[[float], Floats]
# (states (14, runs), parameters (40, runs), duration, setting) -> states.
Advance = Callable[[Floats, Floats, float, float], Floats]
# What differs from run to run or from switch to switch, as rows of the parameters.
_SOFTNESS = [NAMES.index(f"hand.tip.{side}.youngs_modulus") for side in ("right", "left")]
_ROWS = [*_SOFTNESS, *range(len(NAMES) - 5, len(NAMES))]
# lanes.cpp is of equal fingers: its rows are one finger's, the object's, the gains, g and inputs.
_LANES = [*range(12), *range(30, 34), 12, 13, 14, *range(34, 40)]
_STIFFNESS = 6


@dataclass(frozen=True)
class Peer:
    """A way through the runs.

    Attributes:
        make: Of a work, one segment's solver.
        setting: "dt" (RK4's, s) or "tolerance".
        width: Runs come in multiples of it, else the last is repeated.
        share: Takes so long that one run of so many is timed, and counted as such.
        races: Takes part at equal error; not where another does the same steps faster.
        orders: The order follows the tolerance, so a tighter one than needed may be faster.
    """

    make: Callable[[Work], Advance]
    setting: str
    width: int = 1
    share: int = 1
    races: bool = True
    orders: bool = False

    def prepare(self, work: Work) -> Solve:
        """Segment by segment, at each of which the targets switch."""
        missing = -work.runs % self.width
        start, c = (
            np.pad(table, ((0, 0), (0, missing)), mode="edge")
            for table in (work.states, work.parameters)
        )
        advance = self.make(work)

        def solve(setting: float) -> Floats:
            y = start.copy()
            for duration, targets in work.segments:
                c[-5], c[-4] = targets
                y = advance(y, c, duration, setting)
            return y[:, : work.runs]

        return solve


def _steps(duration: float, dt: float) -> tuple[int, float]:
    n = max(1, round(duration / dt))
    return n, duration / n


def _given(work: Work, rows: Sequence[Any]) -> list[Any]:
    """The parameters as numbers, but of `rows` what is given."""
    c: list[Any] = work.parameters[:, 0].tolist()
    for k, value in zip(_ROWS, rows, strict=True):
        c[k] = value
    return c


def _rk4_step(rates: Callable[[Any], Any], y: Any, h: Any) -> list[Any]:
    """One RK4 step of a list of states of any type."""
    k1 = rates(y)
    k2 = rates([a + 0.5 * h * k for a, k in zip(y, k1, strict=True)])
    k3 = rates([a + 0.5 * h * k for a, k in zip(y, k2, strict=True)])
    k4 = rates([a + h * k for a, k in zip(y, k3, strict=True)])
    slopes = zip(y, k1, k2, k3, k4, strict=True)
    return [a + h / 6.0 * (p + 2.0 * (q + r) + s) for a, p, q, r, s in slopes]


def _numpy(work: Work) -> Advance:
    rates, _ = right_hand_side(np.sin, np.cos)

    def advance(y: Floats, c: Floats, duration: float, dt: float) -> Floats:
        n, h = _steps(duration, dt)
        values, state = _given(work, c[_ROWS]), list(y)
        for _ in range(n):
            state = _rk4_step(lambda z: rates(z, values), state, h)
        return np.array(state)

    return advance


def _jax(work: Work) -> Advance:
    rates, _ = right_hand_side(peers.jnp.sin, peers.jnp.cos)

    def one(y: Any, rows: Any, n: int, h: float) -> Any:
        # Stages kept apart: fused, XLA would compute some things again for each of the 14 rates.
        values = _given(work, rows)
        slopes = lambda z: jax.lax.optimization_barrier(tuple(rates(z, values)))  # noqa: E731
        return jax.lax.fori_loop(0, n, lambda _, z: tuple(_rk4_step(slopes, z, h)), y)

    all_runs = jax.jit(jax.vmap(one, in_axes=(0, 0, None, None)))

    def advance(y: Floats, c: Floats, duration: float, dt: float) -> Floats:
        return np.array(all_runs(tuple(y), tuple(c[_ROWS]), *_steps(duration, dt)))

    return advance


def _numba_loop(work: Work) -> Advance:
    return lambda y, c, duration, dt: ensemble_numba.loop(y, c, duration, _steps(duration, dt)[0])


def _numba_lanes(work: Work) -> Advance:
    def advance(y: Floats, c: Floats, duration: float, dt: float) -> Floats:
        ensemble_numba.lanes(y, c, *_steps(duration, dt))
        return y

    return advance


def _cpp_lanes(compiler: str, work: Work) -> Advance:
    run = _library(compiler).rk4

    def advance(y: Floats, c: Floats, duration: float, dt: float) -> Floats:
        rows = c[_LANES]
        rows[_STIFFNESS] *= np.pi
        run(y, rows, y.shape[1], *_steps(duration, dt))
        return y

    return advance


@cache
def _library(compiler: str) -> ctypes.CDLL:
    flags = ["-O3", "-march=native", "-ffp-contract=fast", "-shared", "-fPIC"]
    with tempfile.TemporaryDirectory() as folder:
        target = str(Path(folder) / "lanes.so")
        source = str(Path(__file__).with_name("lanes.cpp"))
        subprocess.run([compiler, *flags, "-o", target, source], check=True)
        library = ctypes.CDLL(target)
    table = np.ctypeslib.ndpointer(np.float64, ndim=2, flags="C")
    library.rk4.argtypes = [table, table, ctypes.c_long, ctypes.c_long, ctypes.c_double]
    library.rk4.restype = None
    return library


def compiler_version(compiler: str) -> str:
    """The first line in which a compiler describes itself."""
    told = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True)
    return told.stdout.splitlines()[0]


def _symbols() -> Any:
    return heyoka.make_vars(*(f"y{k}" for k in range(14)))


def _heyoka_rk4(width: int, work: Work) -> Advance:
    """The whole step as one compiled function: the rates alone and NumPy are slower."""
    names, rows = _symbols(), [heyoka.par[k] for k in range(len(_ROWS))]
    rates, _ = right_hand_side(heyoka.sin, heyoka.cos)
    values, step = _given(work, rows), heyoka.par[len(_ROWS)]
    after = _rk4_step(lambda z: rates(z, values), names, step)
    function = heyoka.cfunc(after, names, batch_size=width)

    def advance(y: Floats, c: Floats, duration: float, dt: float) -> Floats:
        n, h = _steps(duration, dt)
        pars, out = np.vstack([c[_ROWS], np.full(y.shape[1], h)]), np.empty_like(y)
        for _ in range(n):
            function(y, pars=pars, outputs=out)
            y, out = out, y
        return y

    return advance


def _taylor(work: Work, width: int) -> Callable[[float], Any]:
    """Returns the integrator of `width` runs at a time for a tolerance, compiled once for each."""
    names, rows = _symbols(), [heyoka.par[k] for k in range(len(_ROWS))]
    rates, _ = right_hand_side(heyoka.sin, heyoka.cos)
    system = list(zip(names, rates(names, _given(work, rows)), strict=True))

    @cache
    def integrator(tolerance: float) -> Any:
        zeros = {"state": np.zeros((14, width)), "pars": np.zeros((len(rows), width))}
        return heyoka.taylor_adaptive_batch(sys=system, tol=tolerance, **zeros)

    return integrator


def _heyoka_batch(width: int, work: Work) -> Advance:
    """One integrator takes batch after batch."""
    integrator = _taylor(work, width)

    def advance(y: Floats, c: Floats, duration: float, tolerance: float) -> Floats:
        taylor, pars = integrator(tolerance), c[_ROWS]
        for at in range(0, y.shape[1], width):
            taylor.set_time(0.0)
            taylor.state[:], taylor.pars[:] = y[:, at : at + width], pars[:, at : at + width]
            taylor.propagate_until(duration)
            y[:, at : at + width] = taylor.state
        return y

    return advance


def _heyoka_ensemble(width: int, work: Work) -> Advance:
    """heyoka's ensemble mode, which copies the integrator for every batch."""
    integrator = _taylor(work, width)

    def advance(y: Floats, c: Floats, duration: float, tolerance: float) -> Floats:
        pars = c[_ROWS]
        parts = [slice(at, at + width) for at in range(0, y.shape[1], width)]

        def load(taylor: Any, batch: int) -> Any:
            taylor.state[:], taylor.pars[:] = y[:, parts[batch]], pars[:, parts[batch]]
            return taylor

        done = heyoka.ensemble_propagate_until_batch(
            integrator(tolerance), duration, len(parts), load, max_workers=1
        )
        for part, (taylor, *_) in zip(parts, done, strict=True):
            y[:, part] = taylor.state
        return y

    return advance


def _scipy(work: Work) -> Advance:
    def advance(y: Floats, c: Floats, duration: float, rtol: float) -> Floats:
        options = {"method": "DOP853", "rtol": max(rtol, 2.3e-14), "atol": rtol * SIZE}
        span, slope = (0.0, duration), ensemble_numba.slope
        for run in range(y.shape[1]):
            values = c[:, run].copy()
            done = solve_ivp(slope, span, y[:, run], args=(values,), t_eval=span[1:], **options)
            y[:, run] = done.y[:, -1] if done.success else np.nan
        return y

    return advance


def _table() -> dict[str, Peer]:
    found = {"NumPy over runs, RK4": Peer(_numpy, "dt", races=False)}
    if jax is not None:
        found["JAX vmap, RK4"] = Peer(_jax, "dt", races=False)
    if ensemble_numba is not None:
        found["Numba, a loop a run, RK4"] = Peer(_numba_loop, "dt", races=False)
        found["Numba, lanes by hand, RK4"] = Peer(_numba_lanes, "dt", ensemble_numba.LANES)
    for width in WIDTHS:
        found[f"heyoka compiled, {width} wide, RK4"] = Peer(partial(_heyoka_rk4, width), "dt")
    for name, path in COMPILERS.items():
        found[f"C++ {name} vector types, RK4"] = Peer(partial(_cpp_lanes, path), "dt", 8)
    for way, make in {"batch": _heyoka_batch, "ensemble": _heyoka_ensemble}.items():
        for width in WIDTHS:
            name = f"heyoka Taylor {way}, {width} wide"
            found[name] = Peer(partial(make, width), "tolerance", width, orders=True)
    if ensemble_numba is not None:
        found["SciPy DOP853, Numba, a loop"] = Peer(_scipy, "tolerance", share=32)
    return found


PEERS = _table()
