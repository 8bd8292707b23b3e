"""Simulation of a planar two-finger pinch with soft fingertips; every result states its error.

    >>> import softpinch as sp
    >>> run = sp.simulate(sp.paper.manipulation(), every=10)
    >>> run.status
    'completed'

All numbers are in SI units and radians. Finger 1 is the right finger and comes first.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from . import paper
from ._core import __version__
from .run import (
    ContactChange,
    ContactMode,
    Energies,
    EnergyLedger,
    ErrorEstimate,
    Evaluation,
    Forces,
    Run,
    Sensitivity,
    SensitivityState,
    evaluate,
    simulate,
)
from .scene import (
    Disturbance,
    Finger,
    Fingertip,
    GraspedObject,
    Hand,
    Impulse,
    Noise,
    Pid,
    Pulse,
    Sampled,
    SampledController,
    Scene,
    Schedule,
    Sine,
    Stabilization,
    State,
    Step,
    Torque,
)
from .support import (
    LostRunsWarning,
    NotRecordedError,
    StabilityWarning,
    StoreError,
    SuspiciousValueWarning,
    VersionMismatchError,
)
from .support.extras import lazily

# Room -> names, and modules. Imported when they are asked for: they need extras, or a program that
# runs a scene does not need them, and `import softpinch` stays quick (tests/test_import.py). A
# function has another name than its module, which importing puts into this one.
_LAZY = {
    "accuracy": (
        "Advice",
        "Measurement",
        "Modes",
        "Peer",
        "StabilityMap",
        "StabilizationSweep",
        "StableStep",
        "WorkPrecision",
        "advise",
        "max_stable_dt",
        "modes",
        "stability_map",
        "stabilization_sweep",
        "work_precision",
    ),
    "analysis": (
        "Equilibrium",
        "EquilibriumMap",
        "Grip",
        "LinearModel",
        "WrenchLimits",
        "equilibrium",
        "equilibrium_map",
        "grip",
        "linearize",
        "wrench_limits",
    ),
    "fitting": ("Fit", "fit"),
    "gym": ("gym",),
    "jax": ("jax",),
    "montecarlo": ("monte_carlo",),
    "plot": ("plot",),
    "reference": ("reference",),
    "run": ("Explanation", "Term", "explain"),
    "simulator": ("Observation", "Observations", "Simulator", "VectorSimulator"),
    "store": ("Study",),
    "strategies": ("strategies",),
    "stress": ("stress",),
    "study": (
        "Capsule",
        "Choice",
        "Discretisation",
        "Distribution",
        "Effect",
        "Ensemble",
        "Estimate",
        "Gradients",
        "LogNormal",
        "LogUniform",
        "Lost",
        "Mean",
        "Normal",
        "Results",
        "TruncatedNormal",
        "Uniform",
        "sensitivity",
    ),
}

if TYPE_CHECKING:
    from . import gym as gym
    from . import jax as jax
    from . import plot as plot
    from . import reference as reference
    from . import strategies as strategies
    from . import stress as stress
    from .accuracy import (
        Advice,
        Measurement,
        Modes,
        Peer,
        StabilityMap,
        StabilizationSweep,
        StableStep,
        WorkPrecision,
        advise,
        max_stable_dt,
        modes,
        stability_map,
        stabilization_sweep,
        work_precision,
    )
    from .analysis import (
        Equilibrium,
        EquilibriumMap,
        Grip,
        LinearModel,
        WrenchLimits,
        equilibrium,
        equilibrium_map,
        grip,
        linearize,
        wrench_limits,
    )
    from .fitting import Fit, fit
    from .montecarlo import monte_carlo
    from .run import Explanation, Term, explain
    from .simulator import Observation, Observations, Simulator, VectorSimulator
    from .store import Study
    from .study import (
        Capsule,
        Choice,
        Discretisation,
        Distribution,
        Effect,
        Ensemble,
        Estimate,
        Gradients,
        LogNormal,
        LogUniform,
        Lost,
        Mean,
        Normal,
        Results,
        TruncatedNormal,
        Uniform,
        sensitivity,
    )
else:
    __getattr__ = lazily(__name__, _LAZY)

__all__ = [
    "Advice",
    "Capsule",
    "Choice",
    "ContactChange",
    "ContactMode",
    "Discretisation",
    "Distribution",
    "Disturbance",
    "Effect",
    "Energies",
    "EnergyLedger",
    "Ensemble",
    "Equilibrium",
    "EquilibriumMap",
    "ErrorEstimate",
    "Estimate",
    "Evaluation",
    "Explanation",
    "Finger",
    "Fingertip",
    "Fit",
    "Forces",
    "Gradients",
    "GraspedObject",
    "Grip",
    "Hand",
    "Impulse",
    "LinearModel",
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
    "Observation",
    "Observations",
    "Peer",
    "Pid",
    "Pulse",
    "Results",
    "Run",
    "Sampled",
    "SampledController",
    "Scene",
    "Schedule",
    "Sensitivity",
    "SensitivityState",
    "Simulator",
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
    "Torque",
    "TruncatedNormal",
    "Uniform",
    "VectorSimulator",
    "VersionMismatchError",
    "WorkPrecision",
    "WrenchLimits",
    "__version__",
    "advise",
    "equilibrium",
    "equilibrium_map",
    "evaluate",
    "explain",
    "fit",
    "grip",
    "linearize",
    "max_stable_dt",
    "modes",
    "monte_carlo",
    "paper",
    "sensitivity",
    "simulate",
    "stability_map",
    "stabilization_sweep",
    "work_precision",
    "wrench_limits",
]


def __dir__() -> list[str]:
    return sorted({*__all__, *(name for names in _LAZY.values() for name in names)})
