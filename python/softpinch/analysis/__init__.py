"""One scene in depth: where it comes to rest, and what a small deviation from there does.

`rest` finds where it comes to rest.
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
