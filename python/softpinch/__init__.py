"""Simulation of a planar two-finger pinch with soft fingertips; every result states its error.

    >>> import softpinch as sp
    >>> run = sp.simulate(sp.paper.manipulation(), every=10)
    >>> run.status
    'completed'

All numbers are in SI units and radians. Finger 1 is the right finger and comes first.
"""

from typing import TYPE_CHECKING

from . import paper, run, scene
from ._core import __version__
from .run import *
from .scene import *
from .support import errors
from .support.errors import *
from .support.extras import lazily

# Room -> its public names, and modules. They are imported when they are asked for: they need
# extras, or a program that runs a scene does not need them, and `import softpinch` stays quick.
_LAZY = {
    "accuracy": (
        *("Advice", "Measurement", "Modes", "Peer", "StabilityMap", "StabilizationSweep"),
        *("StableStep", "WorkPrecision", "advise", "max_stable_dt", "modes", "stability_map"),
        *("stabilization_sweep", "work_precision"),
    ),
    "analysis": (
        *("CarryLimits", "Equilibrium", "EquilibriumMap", "Grip", "LinearModel", "Loop"),
        *("WrenchLimits", "carry_limits", "equilibrium", "equilibrium_map", "grip", "linearize"),
        *("loop", "wrench_limits"),
    ),
    "fitting": ("Fit", "LawFit", "fit", "fit_law"),
    "montecarlo": ("monte_carlo",),
    "rare": ("RareEvent", "rare_event"),
    "simulator": ("Observation", "Observations", "Simulator", "VectorSimulator"),
    "store": ("Study",),
    "study": (
        *("Capsule", "Choice", "Comparison", "Discretisation", "Distribution", "Effect"),
        *("Ensemble", "Estimate", "Gradients", "Level", "LogNormal", "LogUniform"),
        *("Lost", "Mean", "Normal", "Results", "TruncatedNormal"),
        *("Uniform", "compare", "sensitivity"),
    ),
}

__all__ = ["__version__", "paper", *run.__all__, *scene.__all__, *errors.__all__]
__all__ += [name for names in _LAZY.values() for name in names]
__all__.sort()

# Modules that users reach as attributes.
_LAZY |= {name: (name,) for name in ("gym", "jax", "plot", "reference", "strategies", "stress")}

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
    from .rare import RareEvent as RareEvent
    from .rare import rare_event as rare_event
    from .simulator import *
    from .store import *
    from .study import *
else:
    __getattr__ = lazily(__name__, _LAZY)


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for names in _LAZY.values() for name in names)})
