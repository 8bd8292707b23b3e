"""A planar two-finger pinch with soft fingertips: fast, and honest about its error.

    >>> import softpinch as sp
    >>> run = sp.simulate(sp.paper.manipulation(), every=10)
    >>> run.status
    'completed'

SI units and radians throughout; finger 1 is the right one and comes first.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

from . import paper
from ._core import __version__
from .disturbance import Disturbance, Impulse, Pulse, Sampled, Sine, Step
from .evaluate import Energies, Evaluation, Forces, evaluate
from .hand import Finger, Fingertip, GraspedObject, Hand, Pid
from .run import EnergyLedger, NotRecordedError, Run
from .scene import Scene, Stabilization, State
from .schedule import Schedule
from .simulate import StabilityWarning, simulate

if TYPE_CHECKING:
    from . import plot as plot
    from . import strategies as strategies

# Imported when they are asked for: they need extras.
_LAZY = ("plot", "strategies")

__all__ = [
    "Disturbance",
    "Energies",
    "EnergyLedger",
    "Evaluation",
    "Finger",
    "Fingertip",
    "Forces",
    "GraspedObject",
    "Hand",
    "Impulse",
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
    "State",
    "Step",
    "__version__",
    "evaluate",
    "paper",
    "simulate",
]


def __getattr__(name: str) -> ModuleType:
    if name in _LAZY:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY})
