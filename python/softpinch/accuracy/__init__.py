"""Choice of step and method: reference solutions, stability, and error against run time.

`trial_run` makes and times one run with one setting, for the others. `advisor` finds the cheapest
settings that meet a tolerance, reported as `advice`. `precision` (with `precision_runs`,
`measurements`) measures error against run time, `gains` the effect of alpha and beta. `stability`
(with `linear_modes`, `bisection`) finds the longest stable step; `stability_maps` (with the other
`stability_*` modules) maps how runs end. `reference` solves an independent statement of the
equations (`null_space`, `driven`, `integrate`) with SciPy; `own_reference` stands in for it in
unilateral contact.
"""

from typing import TYPE_CHECKING

from ..support.lazy import lazily

if TYPE_CHECKING:
    from .advice import Advice
    from .advisor import advise
    from .gains import StabilizationSweep, stabilization_sweep
    from .linear_modes import Modes, modes
    from .measurements import Measurement, Peer, WorkPrecision
    from .precision import work_precision
    from .stability import StableStep, max_stable_dt
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
            "linear_modes": ("Modes", "modes"),
            "stability": ("StableStep", "max_stable_dt"),
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
