"""One scene in depth: where it comes to rest, and what a small deviation from there does.

`rest` finds where it comes to rest, `equilibrium_maps` does so over one or two numbers of the
scene, `grip_targets` finds how the fingers must close for a given force, `wrench` how hard the
object can be pushed, and `carry` how fast the hand may move. `linearization` linearises the motion
about a state; `states` names the states, inputs and outputs of linear models.
"""

from .carry import CarryLimits, carry_limits
from .equilibrium_maps import EquilibriumMap, equilibrium_map
from .grip_targets import Grip, grip
from .linearization import LinearModel, linearize
from .rest import Equilibrium, equilibrium
from .wrench import WrenchLimits, wrench_limits

__all__ = [
    "CarryLimits",
    "Equilibrium",
    "EquilibriumMap",
    "Grip",
    "LinearModel",
    "WrenchLimits",
    "carry_limits",
    "equilibrium",
    "equilibrium_map",
    "grip",
    "linearize",
    "wrench_limits",
]
