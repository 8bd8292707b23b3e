"""One scene in depth: where it comes to rest, and what a small deviation from there does.

The others stand on `rest`, and linear models on the names of `states`.
"""

from .equilibrium_maps import EquilibriumMap, equilibrium_map
from .grip_targets import Grip, grip
from .limits import CarryLimits, WrenchLimits, carry_limits, wrench_limits
from .linearization import LinearModel, linearize
from .loops import Loop, loop
from .rest import Equilibrium, equilibrium

__all__ = ["CarryLimits", "Equilibrium", "EquilibriumMap", "Grip", "LinearModel", "Loop"]
__all__ += ["WrenchLimits", "carry_limits", "equilibrium", "equilibrium_map", "grip", "linearize"]
__all__ += ["loop", "wrench_limits"]
