"""A planar two-finger pinch with soft fingertips: fast, and honest about its error.

    >>> import softpinch as sp
    >>> run = sp.simulate(sp.paper.manipulation(), every=10)
    >>> run.status
    'completed'

SI units and radians throughout; finger 1 is the right one and comes first.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from . import paper
from ._core import __version__
from .distributions import (
    Choice,
    Distribution,
    LogNormal,
    LogUniform,
    Normal,
    TruncatedNormal,
    Uniform,
)
from .disturbance import Disturbance, Impulse, Noise, Pulse, Sampled, Sine, Step
from .ensemble import Discretisation, Ensemble, Estimate, Failure
from .error_estimate import ErrorEstimate
from .evaluate import Energies, Evaluation, Forces, evaluate
from .hand import Finger, Fingertip, GraspedObject, Hand, Pid
from .montecarlo import monte_carlo
from .run import EnergyLedger, NotRecordedError, Run
from .scene import Scene, Stabilization, State
from .schedule import Schedule
from .sensitivity import Effect, sensitivity
from .simulate import StabilityWarning, simulate
from .stability import Modes, StableStep, max_stable_dt, modes

if TYPE_CHECKING:
    from . import plot as plot
    from . import strategies as strategies
    from . import stress as stress
    from .stability_maps import StabilityMap as StabilityMap
    from .stability_maps import stability_map as stability_map

# Imported when they are asked for: they need extras, or most programs do not need them. Modules,
# and what is in one whose name is another: importing a module of the same name would hide it.
_LAZY = ("plot", "strategies", "stress")
_LAZY_IN = {"StabilityMap": "stability_maps", "stability_map": "stability_maps"}

__all__ = [
    "Choice",
    "Discretisation",
    "Distribution",
    "Disturbance",
    "Effect",
    "Energies",
    "EnergyLedger",
    "Ensemble",
    "ErrorEstimate",
    "Estimate",
    "Evaluation",
    "Failure",
    "Finger",
    "Fingertip",
    "Forces",
    "GraspedObject",
    "Hand",
    "Impulse",
    "LogNormal",
    "LogUniform",
    "Modes",
    "Noise",
    "Normal",
    "NotRecordedError",
    "Pid",
    "Pulse",
    "Run",
    "Sampled",
    "Scene",
    "Schedule",
    "Sine",
    "StabilityWarning",
    "Stabilization",
    "StableStep",
    "State",
    "Step",
    "TruncatedNormal",
    "Uniform",
    "__version__",
    "evaluate",
    "max_stable_dt",
    "modes",
    "monte_carlo",
    "paper",
    "sensitivity",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return importlib.import_module(f"{__name__}.{name}")
    if name in _LAZY_IN:
        return getattr(importlib.import_module(f"{__name__}.{_LAZY_IN[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY, *_LAZY_IN})
