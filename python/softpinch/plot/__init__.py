"""Figures for print, of runs, ensembles and measurements: `plot.save(plot.motion(run), path)`.

Each function returns a matplotlib `Figure` without a window, so it works without a screen. A figure
can only show recorded quantities: see `simulate(record=...)`. `figures` has the paper's figures;
others are in `beyond`, `contact_plot`, `ensemble_plot`, `equilibrium_plot`, `film`, `fit_plot`,
`mode_shapes`, `precision_plot`, `stability_plot`, `success_plot` and `wrench_plot`. `drawing`
outlines hand and object, `instants` reads a run at any time, `picture` draws it, `writers` writes
films, `panels` has shared panels, `contact_bands` the bands of modes, `style` colours and fonts. A
function with one panel takes `ax`, axes to draw on. Needs the extra `plot`.
"""

from .beyond import forces, run, tilt_coupling
from .contact_plot import contact, contact_models
from .ensemble_plot import failure_times, histogram, importance
from .equilibrium_plot import equilibria
from .figures import disturbances, motion, residuals, snapshots
from .film import animate, snapshot
from .fit_plot import fit
from .mode_shapes import compliance, modes
from .precision_plot import stabilization_sweep, work_precision
from .stability_plot import stability_map
from .style import save, styled
from .success_plot import success_map
from .wrench_plot import wrench_limits

__all__ = [
    "animate",
    "compliance",
    "contact",
    "contact_models",
    "disturbances",
    "equilibria",
    "failure_times",
    "fit",
    "forces",
    "histogram",
    "importance",
    "modes",
    "motion",
    "residuals",
    "run",
    "save",
    "snapshot",
    "snapshots",
    "stability_map",
    "stabilization_sweep",
    "styled",
    "success_map",
    "tilt_coupling",
    "work_precision",
    "wrench_limits",
]
