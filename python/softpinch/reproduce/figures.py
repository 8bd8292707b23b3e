"""The figures of a reproduction: Figures 4 to 7 of the paper, and five that it does not have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from .. import paper, plot
from ..plot.style import BLACK, DEG, LETTERS, LINES, PAGE, PALE, least_range, panels, styled, tag
from ..run import measures as m
from ..run.run import Run
from ..support.arrays import Floats
from . import energy_minimum
from .experiment import Progress, Runs

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Columns of panels in the figure of the energy.
_COLUMNS = 4


def draw(runs: Runs, out: Path, suffix: str, progress: Progress) -> list[Path]:
    """Draws and saves every figure."""
    pieces = m.operations(runs.operations)
    times = [pieces[0][0], *(end for _, end in pieces)]
    pairs = (f"({right:g}°, {left:g}°)" for right, left in paper.OPERATIONS)
    # Titles are printed, so they have a minus sign instead of a hyphen.
    angles = [pair.replace("-", "\N{MINUS SIGN}") for pair in pairs]
    titles = ["start", *(f"operation {k}: {pair}" for k, pair in enumerate(angles, 1))]
    makers: dict[str, Callable[[], Figure]] = {
        "figure4": lambda: plot.snapshots(runs.operations, times, titles),
        "figure5": lambda: plot.motion(runs.operations),
        "figure6": lambda: plot.residuals(runs.operations),
        "figure7": lambda: plot.disturbances(runs.cases, runs.held),
        "figure_forces": lambda: plot.forces(runs.operations),
        "figure_tilt_coupling": lambda: plot.tilt_coupling(
            runs.operations,
            runs.other_operations,
            runs.cases["i"],
            runs.other_cases["i"],
            "disturbance (i)",
        ),
        "figure_energy_minimum": lambda: energy_minima(energy_minimum.curves(runs.rests, angles)),
        "figure_contact_operations": lambda: plot.contact_models(
            {"the eight operations": _models(runs.operations, runs.real)}
        ),
        "figure_contact_disturbances": lambda: plot.contact_models(
            {
                f"disturbance ({case})": _models(runs.cases[case], real)
                for case, real in runs.real_cases.items()
            }
        ),
    }
    files = []
    for k, (name, make) in enumerate(makers.items()):
        progress(f"drawing {name}", 0.4 + 0.6 * k / len(makers))
        files.append(plot.save(make(), out / f"{name}.{suffix}"))
    return files


def energy_minima(curves: Mapping[str, Floats]) -> Figure:
    """Elastic energy and gravity while the object turns about its rests without slip."""
    with styled():
        rows = max(1, -(-len(curves) // _COLUMNS))
        figure, axes = panels(rows, _COLUMNS, PAGE, 0.5 + 1.75 * rows, sharey=True)
        for each in axes.ravel()[len(curves) :]:
            each.set_visible(False)
        for k, (each, (title, curve)) in enumerate(zip(axes.flat, curves.items(), strict=False)):
            angle, energy = DEG.per_si * curve[0], 1e3 * curve[1]
            each.axhline(0.0, color=PALE, linewidth=0.6, zorder=0.5)
            each.plot(angle, energy, **LINES[0])
            # The curve's middle is the rest.
            each.plot(angle[len(angle) // 2], 0.0, "o", color=BLACK)
            tag(each, LETTERS[k], title)
            if k >= len(curves) - _COLUMNS:
                each.set_xlabel(r"$\theta$ [deg]")
            if k % _COLUMNS == 0:
                each.set_ylabel(r"$P + P_g$ [mJ]")
        least_range(axes.flat[: len(curves)])
        what = r"energy while the object turns about its rest at the targets $(\theta_1, \theta_2)$"
        figure.suptitle(what, fontsize="medium")
        return figure


def _models(bilateral: Run, real: Mapping[float, Run]) -> dict[str, Run]:
    return {"bilateral": bilateral} | {f"$\\mu = {mu:g}$": run for mu, run in real.items()}
