"""One scene in depth: where it comes to rest, and what a small deviation from there does.

`rest` finds where it comes to rest, `grip_targets` how the fingers must close for that to have a
given force, and `equilibrium_maps` does so over one or two numbers of the
scene (`equilibrium_search` solves the cells), and `wrench` finds how hard it can be pushed.
`linearization` linearises the motion about a state; its result is in `linear_model`.
`core_matrices` gets the matrices of all linearisations from the core. `ports` has the inputs and
outputs of linear models, and `states` the names of each formulation's states.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    from .equilibrium_maps import EquilibriumMap, equilibrium_map
    from .grip_targets import Grip, grip
    from .linear_model import LinearModel
    from .linearization import linearize
    from .rest import Equilibrium, equilibrium
    from .wrench import WrenchLimits, wrench_limits
else:
    __getattr__ = lazily(
        __name__,
        {
            "equilibrium_maps": ("EquilibriumMap", "equilibrium_map"),
            "grip_targets": ("Grip", "grip"),
            "linear_model": ("LinearModel",),
            "linearization": ("linearize",),
            "rest": ("Equilibrium", "equilibrium"),
            "wrench": ("WrenchLimits", "wrench_limits"),
        },
    )

__all__ = [
    "Equilibrium",
    "EquilibriumMap",
    "Grip",
    "LinearModel",
    "WrenchLimits",
    "equilibrium",
    "equilibrium_map",
    "grip",
    "linearize",
    "wrench_limits",
]
