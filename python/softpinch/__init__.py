"""Simulation of a planar two-finger pinch with soft fingertips; every result states its error.

    >>> import softpinch as sp
    >>> run = sp.simulate(sp.paper.manipulation(), every=10)
    >>> run.status
    'completed'

All numbers are in SI units and radians. Finger 1 is the right finger and comes first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

# The public names are those in the `__all__` of these rooms. A room's package is small: most
# import their modules when a name is asked for, so that `import softpinch` stays quick.
from . import accuracy, analysis, fitting, paper, run, scene, simulator, store, study, support
from ._core import __version__
from .run import *
from .scene import *
from .support import *
from .support.extras import lazily

if TYPE_CHECKING:
    from . import gym as gym
    from . import jax as jax
    from . import plot as plot
    from . import reference as reference
    from . import strategies as strategies
    from . import stress as stress
    from .accuracy import *
    from .analysis import *
    from .fitting import *
    from .montecarlo import monte_carlo as monte_carlo
    from .simulator import *
    from .store import *
    from .study import *

_EAGER = (run, scene, support)
# Module -> its names that are imported when they are asked for (tests/test_import.py).
_LAZY = {
    room.__name__.rpartition(".")[2]: tuple(room.__all__)
    for room in (accuracy, analysis, fitting, simulator, store, study)
}
_LAZY["montecarlo"] = ("monte_carlo",)

__all__ = ["__version__", "paper"]
__all__ += [name for room in _EAGER for name in room.__all__]
__all__ += [name for names in _LAZY.values() for name in names]
__all__.sort()

# Modules that users reach as attributes, and that need an extra or are seldom needed.
_LAZY |= {name: (name,) for name in ("gym", "jax", "plot", "reference", "strategies", "stress")}
if not TYPE_CHECKING:
    __getattr__ = lazily(__name__, _LAZY)


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for names in _LAZY.values() for name in names)})
