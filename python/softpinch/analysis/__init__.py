"""One scene in depth: where it comes to rest, and what a small deviation from there does.

`equilibrium` finds states of rest.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    from .equilibrium import Equilibrium, equilibrium
else:
    __getattr__ = lazily(__name__, {"equilibrium": ("Equilibrium", "equilibrium")})

__all__ = ["Equilibrium", "equilibrium"]
