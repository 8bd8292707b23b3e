"""Choice of step and method: reference solutions, stability, and error against run time.

`runs` makes and times runs for the others. `advisor` compares with a `reference_motion`;
`reference` solves an independent statement of the equations (`null_space`, `segments`).
"""

from .advisor import Advice, advise
from .measurements import Measurement, Peer, StabilizationSweep, WorkPrecision
from .precision import stabilization_sweep, work_precision
from .stability import Modes, StableStep, max_stable_dt, modes
from .stability_maps import StabilityMap, stability_map

__all__ = ["Advice", "Measurement", "Modes", "Peer", "StabilityMap", "StabilizationSweep"]
__all__ += ["StableStep", "WorkPrecision", "advise", "max_stable_dt", "modes", "stability_map"]
__all__ += ["stabilization_sweep", "work_precision"]
