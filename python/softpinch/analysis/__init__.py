"""One scene in depth: where it comes to rest, and what a small deviation from there does.

`rest` finds where it comes to rest. `linearization` linearises the motion about a state; its result
is in `linear_model`. `ports` has the inputs and outputs of linear models, and `states` the names of
each formulation's states.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    from .linear_model import LinearModel
    from .linearization import linearize
    from .rest import Equilibrium, equilibrium
else:
    __getattr__ = lazily(
        __name__,
        {
            "linear_model": ("LinearModel",),
            "linearization": ("linearize",),
            "rest": ("Equilibrium", "equilibrium"),
        },
    )

__all__ = ["Equilibrium", "LinearModel", "equilibrium", "linearize"]
