"""Which step and method to take: references, stability, and error against time.

The reference solution is SciPy's on equations that are typed in once more; nothing of the core's
mechanics. Stability is predicted from eigenvalues and measured; `advise` says what to take.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    from .advice import Advice
    from .advisor import advise
    from .gains import StabilizationSweep, stabilization_sweep
    from .measurements import Measurement, Peer, WorkPrecision
    from .precision import work_precision
    from .stability import Modes, StableStep, max_stable_dt, modes
    from .stability_maps import StabilityMap, stability_map
else:
    __getattr__ = lazily(
        __name__,
        {
            "advice": ("Advice",),
            "advisor": ("advise",),
            "gains": ("StabilizationSweep", "stabilization_sweep"),
            "measurements": ("Measurement", "Peer", "WorkPrecision"),
            "precision": ("work_precision",),
            "stability": ("Modes", "StableStep", "max_stable_dt", "modes"),
            "stability_maps": ("StabilityMap", "stability_map"),
        },
    )

__all__ = [
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
]
