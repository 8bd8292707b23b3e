"""Simulation of a planar two-finger pinch with soft fingertips; every result states its error.

    >>> import softpinch as sp
    >>> run = sp.simulate(sp.paper.manipulation(), every=10)
    >>> run.status
    'completed'

All numbers are in SI units and radians. Finger 1 is the right finger and comes first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from . import paper
from ._core import __version__
from .run.error_estimate import ErrorEstimate
from .run.evaluate import Energies, Evaluation, Forces, evaluate
from .run.run import EnergyLedger, Run
from .run.simulate import simulate
from .scene.disturbance import Disturbance, Impulse, Noise, Pulse, Sampled, Sine, Step
from .scene.hand import Finger, Fingertip, GraspedObject, Hand, Pid
from .scene.scene import Scene, State
from .scene.schedule import Schedule
from .scene.stabilization import Stabilization
from .support.errors import (
    LostRunsWarning,
    NotRecordedError,
    StabilityWarning,
    StoreError,
    SuspiciousValueWarning,
    VersionMismatchError,
)

if TYPE_CHECKING:
    from . import plot as plot
    from . import reference as reference
    from . import strategies as strategies
    from . import stress as stress
    from .accuracy.advice import Advice
    from .accuracy.advisor import advise
    from .accuracy.gains import StabilizationSweep, stabilization_sweep
    from .accuracy.measurements import Measurement, Peer, WorkPrecision
    from .accuracy.precision import work_precision
    from .accuracy.stability import Modes, StableStep, max_stable_dt, modes
    from .accuracy.stability_maps import StabilityMap, stability_map
    from .montecarlo import monte_carlo
    from .run.explanation import Explanation, Term, explain
    from .store import Study
    from .study.capsule import Capsule
    from .study.distributions import (
        Choice,
        Distribution,
        LogNormal,
        LogUniform,
        Normal,
        TruncatedNormal,
        Uniform,
    )
    from .study.effects import Effect, sensitivity
    from .study.estimates import Discretisation, Estimate, Mean
    from .study.outcome import Lost
    from .study.results import Ensemble, Results

# Module -> names that `__getattr__` imports on first access. They need extras, or most programs do
# not need them; so `import softpinch` stays quick (tests/test_import.py). A function must not have
# the name of a module in this folder: importing the module would replace the function here.
_MODULES = {
    "accuracy.advice": ("Advice",),
    "accuracy.advisor": ("advise",),
    "accuracy.gains": ("StabilizationSweep", "stabilization_sweep"),
    "accuracy.measurements": ("Measurement", "Peer", "WorkPrecision"),
    "accuracy.precision": ("work_precision",),
    "accuracy.stability": ("Modes", "StableStep", "max_stable_dt", "modes"),
    "accuracy.stability_maps": ("StabilityMap", "stability_map"),
    "montecarlo": ("monte_carlo",),
    "plot": ("plot",),
    "reference": ("reference",),
    "run.explanation": ("Explanation", "Term", "explain"),
    "store": ("Study",),
    "strategies": ("strategies",),
    "stress": ("stress",),
    "study.capsule": ("Capsule",),
    "study.distributions": (
        "Choice",
        "Distribution",
        "LogNormal",
        "LogUniform",
        "Normal",
        "TruncatedNormal",
        "Uniform",
    ),
    "study.effects": ("Effect", "sensitivity"),
    "study.estimates": ("Discretisation", "Estimate", "Mean"),
    "study.outcome": ("Lost",),
    "study.results": ("Ensemble", "Results"),
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
    from .support.extras import load

    module = load(f"{__name__}.{_LAZY[name]}")
    return module if name == _LAZY[name] else getattr(module, name)


def __dir__() -> list[str]:
    return sorted({*__all__, *_LAZY})
