"""The figure of a fit, public as `softpinch.plot.fit`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..fitting.experiment import Experiment
from ..fitting.result import Fit
from ..study.columns import Column
from ..study.labels import label, shown
from ..support import checks
from ..support.arrays import Floats
from .style import BLACK, GREY, PAGE, RED, panels, styled, tag

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# A figure has at most this many columns of measurements; more would not be legible.
_MOST = 12
_ROW = 1.35
# The name of a multiplier in a file -> in a figure.
_NAMES = {
    f"lambda_{i}{row}": rf"$\lambda_{i}^{{\mathrm{{{row}}}}}$" for i in (1, 2) for row in "HN"
} | {f"torque_{i}": rf"$\tau_{i}$" for i in (1, 2)}


class _Panel(NamedTuple):
    """A column of an experiment."""

    name: str
    unit: str
    times: Floats
    data: Floats
    fitted: Floats
    noise: float


def fit(fit: Fit) -> Figure:
    """What was measured, with the noise as bars, the fitted motion, and the residuals.

    Each row shows a measured column: left the measurements and the fitted motion through the
    measured instants, right the residuals in standard deviations of the noise, where two of three
    are within the grey band. If there are more than twelve columns, the first twelve are shown.

    Args:
        fit: The fit.

    Raises:
        TypeError: `fit` is not a Fit.
        ImportError: matplotlib is not installed.
    """
    checks.instance("fit", fit, Fit)
    every = [
        panel
        for k, each in enumerate(fit.experiments)
        for panel in _panels(each, k if len(fit.experiments) > 1 else None)
    ]
    found = every[:_MOST]
    with styled():
        figure, axes = panels(
            len(found), 2, PAGE, 0.6 + _ROW * len(found),
            sharex="col" if len(fit.experiments) == 1 else False,
            gridspec_kw={"width_ratios": [3, 2]},
        )  # fmt: skip
        for k, (panel, (left, right)) in enumerate(zip(found, axes, strict=True)):
            _motion(left, panel)
            _residuals(right, panel)
            tag(left, "abcdefghijkl"[k])
        some = f", {len(found)} of {len(every)} columns" if len(every) > len(found) else ""
        axes[0, 1].set_title(f"residual / noise{some}")
        for each in axes[-1]:
            each.set_xlabel("$t$ [s]")
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside upper left", ncols=2)
    return figure


def _panels(experiment: Experiment, number: int | None) -> list[_Panel]:
    found = []
    for k, (name, unit) in enumerate(zip(experiment.columns, experiment.units, strict=True)):
        table = np.column_stack([experiment.data[:, k], experiment.fitted[:, k]])
        column = shown(Column(table, unit))
        factor = shown(Column(np.array(1.0), unit)).values
        where = "" if number is None else f" ({number})"
        found.append(
            _Panel(
                _named(name, str(column.unit)) + where,
                str(column.unit),
                experiment.times,
                column.values[:, 0],
                column.values[:, 1],
                float(experiment.noise[k] * factor),
            )
        )
    return found


def _named(name: str, unit: str) -> str:
    if name in _NAMES:
        return f"{_NAMES[name]} [{unit}]"
    rate = name.startswith("rate of ")
    text = label(name.removeprefix("rate of "), unit)
    return f"rate of {text}" if rate else text


def _motion(axes: Axes, panel: _Panel) -> None:
    style: dict[str, Any] = {"fmt": "o", "markersize": 2.5, "color": BLACK}
    style |= {"ecolor": GREY, "elinewidth": 0.6}
    axes.errorbar(panel.times, panel.data, yerr=panel.noise, label="measured", **style)
    axes.plot(panel.times, panel.fitted, color=RED, zorder=3.0, label="fitted")
    axes.set_ylabel(panel.name)


def _residuals(axes: Axes, panel: _Panel) -> None:
    axes.axhspan(-1.0, 1.0, color="0.9", linewidth=0.0)
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    rest = (panel.data - panel.fitted) / panel.noise
    axes.plot(panel.times, rest, "o", markersize=2.0, color=BLACK)
    reach = 1.1 * max(3.0, float(np.nanmax(np.abs(rest), initial=0.0)))
    axes.set_ylim(-reach, reach)
