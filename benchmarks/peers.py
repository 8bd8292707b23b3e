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
from scipy.integrate import solve_ivp

import null_space
import numpy_model
import softpinch as sp
from null_space import SIZE, Floats

# One thread, as for everyone here; it must be said before JAX is imported.
os.environ.setdefault(
    "XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
)
Solve = Callable[[Any], Any]
# Loose to tight. A scalar absolute tolerance suits no unit in particular: let it be tried.
TOLERANCES = [10.0 ** (-k / 4) for k in range(8, 57)]
_PAIRS = [[(rtol, share * rtol) for rtol in TOLERANCES] for share in (1.0, 0.1, 1e-2, 1e-3, 1e-4)]
_STEPS = [int(20 * 2 ** (k / 4)) for k in range(64)]
# Coordinates, rates and integrals of the NumPy model.
_SIZE_20 = np.array([0.02, 0.08, 0.2, 0.2, 0.2] + 4 * [8e-3] + [0.3, 0.3, 3, 6, 6] + 4 * [0.3])
_SIZE_20 = np.concatenate([_SIZE_20, [0.01, 0.01]])

# Name -> why it is not there.
MISSING: dict[str, str] = {}


def _optional(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as reason:
        MISSING[name] = str(reason)
        return None


numbalsoda = _optional("numbalsoda")
heyoka, diffrax, jax = (_optional(name) for name in ("heyoka", "diffrax", "jax"))
numba_model = _optional("numba_model") if _optional("numba") else None
if jax is not None:
    jnp = import_module("jax.numpy")
    jax.config.update("jax_enable_x64", True)
LIBRARIES = [n for n in ("numba", "numbalsoda", "heyoka", "diffrax", "jax") if n not in MISSING]


@dataclass(frozen=True)
class Peer:
    """A solver: `ladders` are settings from loose to tight, `for_stiff` whether it may manage."""

    prepare: Callable[[sp.Scene], Solve]
    ladders: Sequence[Sequence[Any]]
    for_stiff: bool = False
    ends: Callable[[Any, Floats], tuple[Floats, Floats]] = null_space.spread


def _numba_rk4(scene: sp.Scene) -> Solve:
    y, c = null_space.start(scene), null_space.parameters(scene)
    return lambda n: numba_model.rk4(y, c, scene.duration, n)


def _numbalsoda(name: str) -> Callable[[sp.Scene], Solve]:
    def prepare(scene: sp.Scene) -> Solve:
        y, c = null_space.start(scene), null_space.parameters(scene)
        run = getattr(numba_model, name)
        return lambda pair: run(y, c, scene.duration, *pair)

    return prepare


def _scipy_numba(method: str) -> Callable[[sp.Scene], Solve]:
    def prepare(scene: sp.Scene) -> Solve:
        y, c = null_space.start(scene), null_space.parameters(scene)
        return lambda rtol: _scipy(numba_model.slope, y, scene, method, rtol, SIZE, c)

    return prepare


def _scipy_numpy(method: str) -> Callable[[sp.Scene], Solve]:
    def prepare(scene: sp.Scene) -> Solve:
        slope = numpy_model.right_hand_side(scene, 1000.0, 1000.0)
        at, target = scene.start(), np.asarray(scene.schedule.angles)[0]
        y = np.concatenate([at.q, at.p, at.integral])
        return lambda rtol: _scipy(slope, y, scene, method, rtol, _SIZE_20, target)

    return prepare


def _scipy(
    slope: Any, y: Floats, scene: sp.Scene, method: str, rtol: float, size: Floats, given: Floats
) -> Floats:
    span = (0.0, scene.duration)
    # LSODA and Radau ask for no less than 100 times round-off, and would warn.
    done = solve_ivp(
        *(slope, span, y, method),
        t_eval=span[1:],
        args=(given,),
        rtol=max(rtol, 2.3e-14),
        atol=rtol * size,
    )
    return done.y[:, -1] if done.success else np.full(len(y), np.nan)


def _heyoka(scene: sp.Scene) -> Solve:
    y, c = null_space.start(scene), null_space.parameters(scene)
    names = heyoka.make_vars(*(f"y{k}" for k in range(14)))
    rates, _ = null_space.right_hand_side(heyoka.sin, heyoka.cos)
    system = list(zip(names, rates(names, c.tolist()), strict=True))

    @cache
    def integrator(tolerance: float) -> Any:
        return heyoka.taylor_adaptive(sys=system, state=y.copy(), tol=tolerance)

    def solve(tolerance: float) -> Floats:
        taylor = integrator(tolerance)
        taylor.time = 0.0
        taylor.state[:] = y
        taylor.propagate_until(scene.duration)
        return np.array(taylor.state)

    return solve


def _diffrax(name: str) -> Callable[[sp.Scene], Solve]:
    def prepare(scene: sp.Scene) -> Solve:
        y, c = null_space.start(scene), null_space.parameters(scene)
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

        return lambda rtol: run(y, c, scene.duration, rtol).block_until_ready()

    return prepare


def _apart(state: Any, c: Floats) -> tuple[Floats, Floats]:
    return np.asarray(state[:9]), np.asarray(state[9:18])


def _table() -> dict[str, Peer]:
    peers = {}
    if numba_model is not None and numbalsoda is not None:
        for method, stiff in {"dop853": False, "lsoda": True}.items():
            run = _numbalsoda(f"numbalsoda_{method}")
            peers[f"numbalsoda {method.upper()}"] = Peer(run, _PAIRS, stiff)
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
