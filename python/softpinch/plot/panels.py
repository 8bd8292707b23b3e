"""Parts that several figures share: symbols and units of a run's quantities, and panels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..run import measures as measures
from ..run.contact import ContactMode
from ..run.run import Run
from .style import DEG, GREY, LINES, MILLIDEG, MM, PALE, UM, Unit, line, whole_decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
# Selection of the recorded rows that a panel shows.
Rows: TypeAlias = slice | NDArray[np.bool_]

X, Y, TILT = r"x_{\mathrm{obj}}", r"y_{\mathrm{obj}}", r"\theta_{\mathrm{obj}}"
# Column of q, its symbol, and the unit to plot it in.
POSE = ((0, X, MM), (1, Y, MM), (2, TILT, DEG))
ANGLES = ((3, r"\theta_1", DEG), (4, r"\theta_2", DEG))
COMPRESSIONS = ((5, "d_{n1}", MM), (6, "d_{n2}", MM))
CONSTRAINTS = (("C_1^H", "m"), ("C_2^H", "m"), ("C_1^N", "m/s"), ("C_2^N", "m/s"))
FINGERS = ("finger 1 (right)", "finger 2 (left)")
LETTERS = "abcdefghijklmnopqrstuvwxyz"
EVERYTHING = slice(None)
# Residuals below this, m or m/s, are round-off; they are drawn here, as zero has no logarithm.
ROUND_OFF = 1e-16


def name(symbol: str, unit: Unit, change: bool = False) -> str:
    """An axis label of symbol and unit; with a delta if the axis shows a change."""
    sign = r"\Delta " if change else ""
    return f"${sign}{symbol}$ [{unit.name}]"


def finer(unit: Unit, peak: float) -> Unit:
    """The unit, or its thousandth if `peak`, in SI units, is below a tenth of the unit."""
    thousandths = {MM: UM, DEG: MILLIDEG}
    return thousandths[unit] if peak * unit.per_si < 0.1 else unit


def switches(run: Run) -> Floats:
    """The instants inside the run at which the schedule switches (k,), s."""
    breaks = run.scene.schedule.compile()[0]
    return np.asarray(breaks[(breaks > run.t[0]) & (breaks < run.t[-1])])


def number_operations(axes: Axes, run: Run) -> None:
    """Writes 1, 2, ... above the pieces of a schedule that has a few switches."""
    inside = switches(run)
    if not 1 <= len(inside) <= 12:
        return
    edges = np.concatenate([[run.t[0]], inside, [run.t[-1]]])
    for k, middle in enumerate(0.5 * (edges[1:] + edges[:-1])):
        axes.annotate(
            str(k + 1),
            (float(middle), 1.0),
            xycoords=axes.get_xaxis_transform(),
            xytext=(0.0, 2.0),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.0,
            color="0.35",
        )


def time_axis(run: Run, axes: Sequence[Axes]) -> None:
    """Sets the time axis of a column of panels, and draws the switches as thin lines."""
    inside = switches(run)
    for each in axes:
        # Sampled schedules have so many switches that their lines would fill the panel.
        for time in inside if len(inside) <= 40 else []:
            each.axvline(float(time), color=PALE, linewidth=0.6, zorder=0.5)
        if len(run) > 1:
            each.set_xlim(float(run.t[0]), float(run.t[-1]))
    axes[-1].set_xlabel("time [s]")


def residual(axes: Axes, run: Run, columns: Sequence[int], **style: Any) -> None:
    """Draws the largest magnitude of some residuals; values below ROUND_OFF are drawn there.

    Residuals of constraints that do not act, such as that of a free tip, are left out.
    """
    sizes = np.where(measures.active_constraints(run), np.abs(run.residuals), np.nan)
    # Unlike the maximum, fmax ignores nan.
    size = np.fmax.reduce(sizes[:, list(columns)], axis=1)
    line(axes, run.t, np.maximum(size, ROUND_OFF), linewidth=0.6, **style)


def pressing(axes: Axes, run: Run, t: Floats, rows: Rows) -> None:
    """Draws lambda^H of both tips over `t`, N."""
    for k in (0, 1):
        line(axes, t, run.multipliers[rows, k], **LINES[k], label=FINGERS[k])
    axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0.8)
    axes.set_ylabel(r"$\lambda^H$ [N]")


def gap(axes: Axes, run: Run, t: Floats, rows: Rows) -> None:
    """Draws C^H of both tips over `t`, mm or um: of a free tip its gap, else about zero."""
    unit = finer(MM, float(np.abs(run.residuals[:, :2]).max()))
    for k in (0, 1):
        line(axes, t, run.residuals[rows, k] * unit.per_si, **LINES[k], label=f"$C_{k + 1}^H$")
    axes.set_ylabel(f"gap [{unit.name}]")


def slip(axes: Axes, run: Run, t: Floats, rows: Rows) -> None:
    """Draws C^N of both tips over `t`, m/s, the velocity of slip; not of a tip that is free."""
    touches = measures.contact_modes(run) != ContactMode.FREE
    for k in (0, 1):
        velocity = np.where(touches[:, k], run.residuals[:, 2 + k], np.nan)
        line(axes, t, velocity[rows], **LINES[k], label=f"$C_{k + 1}^N$")
    axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0.8)
    axes.set_ylabel("slip [m/s]")


def ledger(axes: Axes, run: Run, t: Floats, rows: Rows) -> None:
    """Draws stored energy, works and losses since the start over `t`, J.

    What is lost includes friction and impacts, which `contact_energy` draws apart.
    """
    energy = run.energy
    lost = energy.viscous_loss + (energy.friction_loss + energy.impact_loss)
    entries: tuple[tuple[Floats, str, dict[str, Any]], ...] = (
        (energy.total - sum(energy.start), "stored", LINES[3]),
        (energy.controller_work, "torques", LINES[0]),
        (lost, "lost", LINES[1]),
        (energy.external_work, "disturbances", LINES[2]),
    )
    for values, label, style in entries:
        # Many scenes have no disturbance; a line at zero would be useless.
        if values is not energy.external_work or np.abs(values).max() > 0.0:
            line(axes, t, values[rows], **style, label=label)
    axes.set_ylabel("energy [J]")


def contact_energy(axes: Axes, run: Run, t: Floats, rows: Rows) -> None:
    """Draws the energies that friction and impacts have taken, and the relaxation, over `t`, J."""
    energy = run.energy
    for values, label, style in (
        (energy.friction_loss, "friction", LINES[0]),
        (energy.impact_loss, "impacts", LINES[1]),
        (energy.relaxation_work, "relaxation", LINES[2]),
    ):
        line(axes, t, values[rows], **style, label=label)
    axes.set_ylabel("energy [J]")


def closure(axes: Axes, run: Run, t: Floats, rows: Rows) -> None:
    """Draws the error of the energy ledger over `t`, J, on a logarithmic axis."""
    size = np.abs(run.energy.closure)
    line(axes, t, np.where(size > 0.0, size, np.nan)[rows], color="black", label="|closure|")
    whole_decades(axes)
    axes.set_ylabel("|closure| [J]")
