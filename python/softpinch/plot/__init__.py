"""Figures for print, of runs, ensembles and measurements: `plot.save(plot.motion(run), path)`.

Each function returns a matplotlib `Figure` without a window, so it works without a screen. A figure
can only show recorded quantities: see `simulate(record=...)`. A function with one panel takes `ax`,
axes to draw on; None makes a figure. All need the extra `plot`, and raise an ImportError that names
it; an argument of a wrong type raises a TypeError.
"""

from .accuracy_plots import stability_map, stabilization_sweep, work_precision
from .ensemble_plot import failure_times, histogram, importance, success_map
from .equilibrium_plots import carry_limits, equilibria, wrench_limits
from .film import animate, snapshot, snapshots
from .fit_plot import fit, law
from .mode_shapes import compliance, modes
from .rare_plot import rare_event
from .run_plots import (
    contact,
    contact_models,
    disturbances,
    forces,
    motion,
    residuals,
    run,
    tilt_coupling,
)
from .style import save, styled

__all__ = ["animate", "carry_limits", "compliance", "contact", "contact_models", "disturbances"]
__all__ += ["equilibria", "failure_times", "fit", "forces", "histogram", "importance", "law"]
__all__ += ["modes", "motion", "rare_event", "residuals", "run", "save", "snapshot", "snapshots"]
__all__ += ["stability_map", "stabilization_sweep", "styled", "success_map", "tilt_coupling"]
__all__ += ["work_precision", "wrench_limits"]
