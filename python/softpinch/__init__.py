"""A planar two-finger pinch with soft fingertips: fast, and honest about its error.

    >>> import softpinch as sp
    >>> run = sp.simulate(sp.paper.manipulation(), every=10)
    >>> run.status
    'completed'

SI units and radians throughout; finger 1 is the right one and comes first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import paper
from ._core import __version__
from ._usual import SuspiciousValueWarning
from .disturbance import Disturbance, Impulse, Noise, Pulse, Sampled, Sine, Step
from .error_estimate import ErrorEstimate
from .evaluate import Energies, Evaluation, Forces, evaluate
from .hand import Finger, Fingertip, GraspedObject, Hand, Pid
from .run import EnergyLedger, NotRecordedError, Run
from .scene import Scene, Stabilization, State
from .schedule import Schedule
from .simulate import StabilityWarning, simulate

if TYPE_CHECKING:
    from . import plot as plot
    from . import reference as reference
    from . import strategies as strategies
    from . import stress as stress
    from .advice import Advice, advise
    from .capsule import Capsule
    from .distributions import (
        Choice,
        Distribution,
        LogNormal,
        LogUniform,
        Normal,
        TruncatedNormal,
        Uniform,
    )
    from .effects import Effect, sensitivity
    from .ensemble import Ensemble
    from .estimates import Discretisation, Estimate, Mean
    from .explanation import Explanation, Term, explain
    from .gains import StabilizationSweep, stabilization_sweep
    from .measurements import Measurement, Peer, WorkPrecision
    from .montecarlo import monte_carlo
    from .precision import work_precision
    from .results import Lost, LostRunsWarning, Results, StoreError, VersionMismatchError
    from .stability import Modes, StableStep, max_stable_dt, modes
    from .stability_maps import StabilityMap, stability_map
    from .store import Study

# Module -> names. Imported when they are asked for: they need extras, or a program that runs a
# scene does not need them, and `import softpinch` stays quick (tests/test_import.py). A function
# has another name than its module, which importing puts into this one.
_MODULES = {
    "advice": ("Advice", "advise"),
    "capsule": ("Capsule",),
    "distributions": (
        "Choice",
        "Distribution",
        "LogNormal",
        "LogUniform",
        "Normal",
        "TruncatedNormal",
        "Uniform",
    ),
    "effects": ("Effect", "sensitivity"),
    "ensemble": ("Ensemble",),
    "estimates": ("Discretisation", "Estimate", "Mean"),
    "explanation": ("Explanation", "Term", "explain"),
    "gains": ("StabilizationSweep", "stabilization_sweep"),
    "measurements": ("Measurement", "Peer", "WorkPrecision"),
    "montecarlo": ("monte_carlo",),
    "plot": ("plot",),
    "precision": ("work_precision",),
    "reference": ("reference",),
    "results": ("Lost", "LostRunsWarning", "Results", "StoreError", "VersionMismatchError"),
    "stability": ("Modes", "StableStep", "max_stable_dt", "modes"),
    "stability_maps": ("StabilityMap", "stability_map"),
    "strategies": ("strategies",),
    "stress": ("stress",),
    "store": ("Study",),
}
_LAZY = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Advice",
    "Capsule",
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
    "Explanation",
    "Finger",
    "Fingertip",
    "Forces",
    "GraspedObject",
    "Hand",
    "Impulse",
    "LogNormal",
    "LogUniform",
    "Lost",
    "LostRunsWarning",
    "Mean",
    "Measurement",
    "Modes",
    "Noise",
    "Normal",
    "NotRecordedError",
    "Peer",
    "Pid",
    "Pulse",
    "Results",
    "Run",
    "Sampled",
    "Scene",
    "Schedule",
    "Sine",
    "StabilityMap",
    "StabilityWarning",
    "Stabilization",
    "StabilizationSweep",
    "StableStep",
    "State",
    "Step",
    "StoreError",
    "Study",
    "SuspiciousValueWarning",
    "Term",
    "TruncatedNormal",
    "Uniform",
    "VersionMismatchError",
    "WorkPrecision",
    "__version__",
    "advise",
    "evaluate",
    "explain",
    "max_stable_dt",
    "modes",
    "monte_carlo",
    "paper",
    "sensitivity",
    "simulate",
    "stability_map",
    "stabilization_sweep",
    "work_precision",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from ._extras import load

    module = load(f"{__name__}.{_LAZY[name]}")
    return module if name == _LAZY[name] else getattr(module, name)


def __dir__() -> list[str]:
    return sorted({*__all__, *_LAZY})
