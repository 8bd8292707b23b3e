"""softpinch as a differentiable layer of JAX: `jit`, `vmap`, `jvp`, `grad`. Needs the extra `jax`.

import jax
import softpinch as sp
import softpinch.jax

jax.config.update("jax_enable_x64", True)
layer = softpinch.jax.simulate(sp.Scene(), ("grasped.mass",), dt=1e-3)
slope = jax.grad(lambda mass: layer({"grasped.mass": mass}).q[-1, 1])(0.1)
"""

from ..support.extras import require

require("jax", extra="jax", purpose="softpinch.jax")

from .layers import STATUSES, FinalState, Trajectory, final_state, simulate  # noqa: E402

__all__ = ["STATUSES", "FinalState", "Trajectory", "final_state", "simulate"]
