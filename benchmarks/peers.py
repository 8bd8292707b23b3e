"""Other solvers of the same motion, each as a good user would call it; what is missing says so.

`PEERS` has them by name. One is prepared for a scene (compiled, warmed up by its first call) and
gives `solve(setting)`, the state at the end; `ends` reads q and p from it, outside of the time.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

import null_space
import numpy_model
import softpinch as sp
from null_space import SIZE, Floats, by_pieces, scipy_end

# One thread, as for everyone here. XLA reads this number when JAX is imported; its flags for the
# same purpose no longer keep a compiled loop from using every core.
os.environ["NPROC"] = "1"
Solve = Callable[[Any], Any]
# Loose to tight. A scalar absolute tolerance suits no unit in particular: let it be tried.
TOLERANCES = [10.0 ** (-k / 4) for k in range(8, 57)]
_PAIRS = [[(rtol, share * rtol) for rtol in TOLERANCES] for share in (1.0, 0.1, 1e-2, 1e-3, 1e-4)]
_STEPS = [int(20 * 2 ** (k / 4)) for k in range(64)]
# alpha and beta of those that need them, 1/s.
GAINS = (1000.0, 1000.0)
_MOST_STEPS = 10_000_000

# Name -> why it is not there.
MISSING: dict[str, str] = {}


def _optional(name: str, *also: type[Exception]) -> Any:
    try:
        return import_module(name)
    except (ImportError, *also) as reason:
        absent = isinstance(reason, ModuleNotFoundError) and reason.name == name
        MISSING[name] = "not installed" if absent else str(reason)
        return None


# It needs Numba's compiler, which may be off.
numbalsoda = _optional("numbalsoda", AttributeError)
sksundae = _optional("sksundae")
heyoka, diffrax, jax = (_optional(name) for name in ("heyoka", "diffrax", "jax"))
numba_model = _optional("numba_model") if _optional("numba") else None
if jax is not None:
    jnp = import_module("jax.numpy")
    jax.config.update("jax_enable_x64", True)
if heyoka is not None:
    # A compiled function that is given many runs would share them among all cores.
    heyoka.set_nthreads(1)
if sksundae is not None:
    import_module("sksundae.cvode"), import_module("sksundae.ida")
_NAMES = {"sksundae": "scikit-sundae"}
_ALL = ("numba", "numbalsoda", "heyoka", "diffrax", "jax", "sksundae")
LIBRARIES = [_NAMES.get(name, name) for name in _ALL if name not in MISSING]


@dataclass(frozen=True)
class Peer:
    """A solver: `ladders` are settings from loose to tight, `for_stiff` whether it may manage."""

    prepare: Callable[[sp.Scene], Solve]
    ladders: Sequence[Sequence[Any]]
    for_stiff: bool = False
    ends: Callable[[Any, Floats], tuple[Floats, Floats]] = null_space.spread


def _steps(n: int, duration: float, scene: sp.Scene) -> int:
    """Number of steps of a piece, of n steps in all."""
    return max(1, round(n * duration / scene.duration))


def _numba_rk4(scene: sp.Scene) -> Solve:
    def advance(y: Floats, c: Floats, duration: float, n: int) -> Any:
        return numba_model.rk4(y, c, duration, _steps(n, duration, scene))

    return by_pieces(scene, null_space.start(scene), advance)


def _numbalsoda(name: str) -> Callable[[sp.Scene], Solve]:
    def prepare(scene: sp.Scene) -> Solve:
        run = getattr(numba_model, name)
        advance = lambda y, c, duration, pair: run(y, c, duration, *pair)  # noqa: E731
        return by_pieces(scene, null_space.start(scene), advance)

    return prepare


def _scipy_numba(method: str) -> Callable[[sp.Scene], Solve]:
    def prepare(scene: sp.Scene) -> Solve:
        def advance(y: Floats, c: Floats, duration: float, rtol: float) -> Floats:
            return scipy_end(numba_model.slope, y, duration, method, rtol, SIZE, c)

        return by_pieces(scene, null_space.start(scene), advance)

    return prepare


def _scipy_numpy(method: str) -> Callable[[sp.Scene], Solve]:
    return lambda scene: numpy_model.by_scipy(scene, method, *GAINS)


def _cvode(method: str) -> Callable[[sp.Scene], Solve]:
    """CVODE on the null-space form; its rates are Numba's, called from Cython by way of Python."""

    def prepare(scene: sp.Scene) -> Solve:
        def advance(y: Floats, c: Floats, duration: float, rtol: float) -> Floats:
            solver = sksundae.cvode.CVODE(
                lambda t, y, rates: numba_model.rates_into(t, y, rates, c),
                method=method,
                rtol=rtol,
                atol=rtol * SIZE,
                max_num_steps=_MOST_STEPS,
            )
            solver.init_step(0.0, y)
            return _ended(solver.step(duration, tstop=duration), len(y))

        return by_pieces(scene, null_space.start(scene), advance)

    return prepare


def _ida(scene: sp.Scene) -> Solve:
    """IDA on (24), 24 unknowns, its residuals Numba's.

    Of index one, as the paper reduces and stabilises it (19, 20): what IDA is made for. Of index
    two (GGL, with two more multipliers) its error test would have to leave lambda and mu out, and
    its Newton matrix gets worse with 1/h.
    """
    fixed = numpy_model.numbers(scene, *GAINS)
    size = np.concatenate([numpy_model.SIZE, np.full(4, 50.0)])

    def advance(y: Floats, c: Floats, duration: float, rtol: float) -> Floats:
        data = np.concatenate([c[-5:], fixed])
        # lambda jumps at a switch, and with it p'.
        p_rate, multipliers = numba_model.accelerations(y[:20], data)
        state = np.concatenate([y[:20], multipliers])
        rate = np.concatenate([y[9:18], p_rate, y[3:5] - c[-5:-3], np.zeros(4)])
        solver = sksundae.ida.IDA(
            lambda t, y, rate, out: numba_model.residual(t, y, rate, out, data),
            algebraic_idx=list(range(20, 24)),
            rtol=rtol,
            atol=rtol * size,
            max_num_steps=_MOST_STEPS,
        )
        solver.init_step(0.0, state, rate)
        return _ended(solver.step(duration, tstop=duration), 24)

    return by_pieces(scene, numpy_model.start(scene), advance)


def _ended(done: Any, states: int) -> Floats:
    return np.asarray(done.y).reshape(-1) if done.success else np.full(states, np.nan)


def _heyoka(scene: sp.Scene) -> Solve:
    names = heyoka.make_vars(*(f"y{k}" for k in range(14)))
    rates, _ = null_space.right_hand_side(heyoka.sin, heyoka.cos)
    first = null_space.parameters(scene)
    # What differs from piece to piece.
    given = [*first[:-5].tolist(), *(heyoka.par[k] for k in range(5))]
    system = list(zip(names, rates(names, given), strict=True))

    @cache
    def integrator(tolerance: float) -> Any:
        zeros = {"state": np.zeros(14), "pars": np.zeros(5)}
        return heyoka.taylor_adaptive(sys=system, tol=tolerance, **zeros)

    def advance(y: Floats, c: Floats, duration: float, tolerance: float) -> Floats:
        taylor = integrator(tolerance)
        taylor.time = 0.0
        taylor.state[:], taylor.pars[:] = y, c[-5:]
        taylor.propagate_until(duration)
        return np.array(taylor.state)

    return by_pieces(scene, null_space.start(scene), advance)


@cache
def _diffrax_run(name: str) -> Callable[[Any, Any, float, float], Any]:
    """One for all scenes, whose numbers are arguments: JAX compiles it once."""
    rates, _ = null_space.right_hand_side(jnp.sin, jnp.cos)
    term = diffrax.ODETerm(lambda t, y, c: jnp.stack(rates(y, c)))
    solver = getattr(diffrax, name)()

    @jax.jit  # type: ignore[untyped-decorator]
    def run(y: Any, c: Any, end: float, rtol: float) -> Any:
        control = diffrax.PIDController(rtol=rtol, atol=rtol * jnp.asarray(SIZE))
        options = {"stepsize_controller": control, "max_steps": 2_000_000, "throw": False}
        whole = diffrax.SaveAt(t1=True)
        adjoint = diffrax.ForwardMode()
        done = diffrax.diffeqsolve(
            *(term, solver, 0.0, end, None, y),
            args=c,
            saveat=whole,
            adjoint=adjoint,
            **options,
        )
        return done.ys[-1]

    return run  # type: ignore[no-any-return]


def _diffrax(name: str) -> Callable[[sp.Scene], Solve]:
    def prepare(scene: sp.Scene) -> Solve:
        solve = by_pieces(scene, null_space.start(scene), _diffrax_run(name))
        return lambda rtol: solve(rtol).block_until_ready()

    return prepare


def _apart(state: Any, c: Floats) -> tuple[Floats, Floats]:
    return np.asarray(state[:9]), np.asarray(state[9:18])


def _table() -> dict[str, Peer]:
    peers = {}
    if numba_model is not None and numbalsoda is not None:
        for method, stiff in {"dop853": False, "lsoda": True}.items():
            run = _numbalsoda(f"numbalsoda_{method}")
            peers[f"numbalsoda {method.upper()}"] = Peer(run, _PAIRS, stiff)
    if numba_model is not None and sksundae is not None:
        peers["CVODE Adams, Numba"] = Peer(_cvode("Adams"), [TOLERANCES])
        peers["CVODE BDF, Numba"] = Peer(_cvode("BDF"), [TOLERANCES], True)
        peers["IDA, Numba csm"] = Peer(_ida, [TOLERANCES], True, _apart)
    if heyoka is not None:
        peers["heyoka Taylor"] = Peer(_heyoka, [TOLERANCES])
    if numba_model is not None:
        peers["Numba RK4"] = Peer(_numba_rk4, [_STEPS])
    if diffrax is not None:
        peers["diffrax Tsit5"] = Peer(_diffrax("Tsit5"), [TOLERANCES])
        peers["diffrax Kvaerno5"] = Peer(_diffrax("Kvaerno5"), [TOLERANCES], True)
    for method, stiff in {"DOP853": False, "LSODA": True, "Radau": True}.items():
        if numba_model is not None:
            peers[f"SciPy {method}, Numba"] = Peer(_scipy_numba(method), [TOLERANCES], stiff)
        peers[f"SciPy {method}, NumPy csm"] = Peer(_scipy_numpy(method), [TOLERANCES], ends=_apart)
    return peers


PEERS = _table()
