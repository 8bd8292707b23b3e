"""What one evaluation of the right-hand side costs each peer inside of its own compiled code."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import null_space
import numpy_model
import peers
import softpinch as sp

_MANY = 20_000


def _best(work: Callable[[], Any], n: int = _MANY) -> float:
    """The quickest of eleven rounds of n evaluations, s each."""
    work()
    rounds = []
    for _ in range(11):
        begin = time.perf_counter()
        work()
        rounds.append((time.perf_counter() - begin) / n)
    return min(rounds)


def _jax(y: Any, c: Any) -> float:
    jax, jnp = peers.jax, peers.jnp
    rates, _ = null_space.right_hand_side(jnp.sin, jnp.cos)

    # Each evaluation needs the one before, or the compiler would take it out of the loop.
    @jax.jit
    def loop(y: Any, c: Any) -> Any:
        body = lambda _, z: jnp.stack(rates(y + 1e-30 * z, c))  # noqa: E731
        return jax.lax.fori_loop(0, _MANY, body, jnp.zeros(14))

    return _best(lambda: loop(y, c).block_until_ready())


def _heyoka(y: Any, c: Any) -> float:
    heyoka = peers.heyoka
    names = heyoka.make_vars(*(f"y{k}" for k in range(14)))
    rates, _ = null_space.right_hand_side(heyoka.sin, heyoka.cos)
    function = heyoka.cfunc(list(rates(names, c.tolist())), names)
    rows = np.repeat(y[:, None], _MANY, axis=1)
    out = np.zeros_like(rows)
    return _best(lambda: function(rows, outputs=out))


def _numpy(scene: sp.Scene) -> float:
    slope, at = numpy_model.right_hand_side(scene, 1000.0, 1000.0), scene.start()
    y, u = np.concatenate([at.q, at.p, at.integral]), null_space.parameters(scene)[-5:]
    return _best(lambda: slope(0.0, y, u), 1)


def evaluation_times(scene: sp.Scene) -> dict[str, float]:
    """By name, s."""
    y, c = null_space.start(scene), null_space.parameters(scene)
    found = {}
    if peers.numba_model is not None:
        found["Numba, null space"] = peers.numba_model.evaluation_time(y, c)
    if peers.heyoka is not None:
        found["heyoka, null space, in SIMD lanes (its Taylor run has none)"] = _heyoka(y, c)
    if peers.jax is not None:
        found["JAX, null space"] = _jax(y, c)
    found["NumPy, csm"] = _numpy(scene)
    return found
