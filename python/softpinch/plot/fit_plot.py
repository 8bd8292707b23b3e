"""The figure of a fit, public as `softpinch.plot.fit`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..fitting.law import LawFit
from ..fitting.result import Fit
from ..scene.fields import label
from ..study.rows import Column
from ..study.tables import shown
from ..support import checks
from .style import BLACK, COLUMN, GREY, LETTERS, MM, PAGE, RED, panels, shared_legend, styled, tag

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A figure has at most this many columns of measurements; more would not be legible.
_MOST = 12
_ROW = 1.35
_MEASURED: dict[str, Any] = {
    "fmt": "o", "markersize": 2.5, "color": BLACK, "ecolor": GREY, "elinewidth": 0.6
}  # fmt: skip


@styled()
def fit(fit: Fit) -> Figure:
    """Measurements with their noise as bars, the fitted motion, and the residuals.

    Each row shows a measured column: left the measurements and the fitted motion through the
    measured instants, right the residuals in standard deviations of the noise, where two of three
    are within the grey band. If there are more than twelve columns, the first twelve are shown.
    """
    checks.instance("fit", fit, Fit)
    several = len(fit.experiments) > 1
    # Name, times, data, fitted values and noise of each column.
    every: list[tuple[Any, ...]] = []
    for number, each in enumerate(fit.experiments):
        for k, (name, unit) in enumerate(zip(each.columns, each.units, strict=True)):
            noise = np.full(len(each.times), each.noise[k])
            table = np.column_stack([each.data[:, k], each.fitted[:, k], noise])
            column = shown(Column(table, unit))
            title = label(name, column.unit) + (f" ({number})" if several else "")
            every.append((title, each.times, *column.values.T))
    found = every[:_MOST]
    height, shared = 0.6 + _ROW * len(found), False if several else "col"
    figure, axes = panels(len(found), 2, PAGE, height, sharex=shared, width_ratios=[3, 2])
    for letter, panel, (left, right) in zip(LETTERS, found, axes, strict=False):
        name, times, data, fitted, noise = panel
        left.errorbar(times, data, yerr=noise, label="measured", **_MEASURED)
        left.plot(times, fitted, color=RED, zorder=3.0, label="fitted")
        left.set_ylabel(name)
        right.axhspan(-1.0, 1.0, color="0.9", linewidth=0.0)
        right.axhline(0.0, color=GREY, linewidth=0.6)
        rest = (data - fitted) / noise
        right.plot(times, rest, "o", markersize=2.0, color=BLACK)
        reach = 1.1 * max(3.0, float(np.nanmax(np.abs(rest), initial=0.0)))
        right.set_ylim(-reach, reach)
        tag(left, letter)
    some = f", {len(found)} of {len(every)} columns" if len(every) > len(found) else ""
    axes[0, 1].set_title(f"residual / noise{some}")
    for each in axes[-1]:
        each.set_xlabel("$t$ [s]")
    shared_legend(figure, axes[0], "outside upper left")
    return figure


@styled()
def law(fit: LawFit) -> Figure:
    """Measured forces of a tip over its compression, and the fitted law."""
    checks.instance("fit", fit, LawFit)
    figure, axes = panels(1, 1, COLUMN, 2.4)
    depth = MM.per_si * fit.compression
    axes[0, 0].plot(depth, fit.force, "o", markersize=3.0, color=BLACK, label="measured")
    between = np.linspace(0.0, fit.compression[-1], 101)
    misfit = f"misfit {100.0 * fit.misfit:.2g} %"
    axes[0, 0].plot(MM.per_si * between, fit._curve(between), color=RED, label=misfit)
    axes[0, 0].set(xlabel="$d_n$ [mm]", ylabel="force [N]")
    axes[0, 0].legend()
    return figure
