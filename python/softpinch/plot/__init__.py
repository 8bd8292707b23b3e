"""Figures of runs and ensembles, to be printed: `plot.save(plot.motion(run), path)`.

Needs the extra `plot`. Each function returns a matplotlib `Figure` that belongs to no window, so
everything works without a screen. What a figure shows has to be recorded: `simulate(record=...)`.
"""

from .beyond import forces, run, tilt_coupling
from .ensemble_plot import failure_times, histogram, importance, success_map
from .figures import disturbances, motion, residuals, snapshots
from .precision_plot import stabilization_sweep, work_precision
from .stability_plot import stability_map
from .style import save, styled

__all__ = [
    "disturbances",
    "failure_times",
    "forces",
    "histogram",
    "importance",
    "motion",
    "residuals",
    "run",
    "save",
    "snapshots",
    "stability_map",
    "stabilization_sweep",
    "styled",
    "success_map",
    "tilt_coupling",
    "work_precision",
]
