"""Time of one evaluation of the right-hand side inside of each peer's own compiled code."""

from typing import Any

import numpy as np

import null_space
import numpy_model
import peers
import softpinch as sp
from machine import evaluation_time

_MANY = 5_000


def _jax(y: Any, c: Any) -> float:
    jax, jnp = peers.jax, peers.jnp
    rates, _ = null_space.right_hand_side(jnp.sin, jnp.cos)

    # Each evaluation needs the one before, or the compiler would take it out of the loop.
    @jax.jit
    def loop(y: Any, c: Any) -> Any:
        body = lambda _, z: jnp.stack(rates(y + 1e-30 * z, c))  # noqa: E731
        return jax.lax.fori_loop(0, _MANY, body, jnp.zeros(14))

    return evaluation_time(lambda: loop(y, c).block_until_ready(), _MANY)


def _heyoka(y: Any, c: Any) -> float:
    heyoka = peers.heyoka
    names = heyoka.make_vars(*(f"y{k}" for k in range(14)))
    rates, _ = null_space.right_hand_side(heyoka.sin, heyoka.cos)
    function = heyoka.cfunc(list(rates(names, c.tolist())), names)
    rows = np.repeat(y[:, None], _MANY, axis=1)
    out = np.zeros_like(rows)
    return evaluation_time(lambda: function(rows, outputs=out), _MANY)


def _numpy(scene: sp.Scene) -> float:
    slope, at = numpy_model.right_hand_side(scene, 1000.0, 1000.0), scene.start()
    y, u = np.concatenate([at.q, at.p, at.integral]), null_space.parameters(scene)[-5:]
    return evaluation_time(lambda: slope(0.0, y, u), 1)


def evaluation_times(scene: sp.Scene) -> dict[str, float]:
    """By name, s."""
    y, c = null_space.start(scene), null_space.parameters(scene)
    found = {}
    if peers.numba_model is not None:
        found["Numba, null space"] = peers.numba_model.evaluated(y, c)
    if peers.heyoka is not None:
        found["heyoka, null space, in SIMD lanes (its Taylor run has none)"] = _heyoka(y, c)
    if peers.jax is not None:
        found["JAX, null space"] = _jax(y, c)
    found["NumPy, csm"] = _numpy(scene)
    return found
