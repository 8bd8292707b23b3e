"""The figure of a rare event, public as `softpinch.plot.rare_event`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..rare import RareEvent
from ..scene.fields import label
from ..study.tables import drawn_by_magnitude, number, shown
from ..support import checks
from . import style as s

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@s.styled()
def rare_event(found: RareEvent) -> Figure:
    """The levels on the way to a rare event, and the computed runs that have it.

    The left panel has the probability of each level over the distance to the event, with bars of
    two standard deviations, and the estimate with its interval at a distance of 0. The right panel
    has the runs with the event over the two numbers that matter most (`RareEvent.importance`), and
    a cross at the design point; axes of a LogUniform or LogNormal are logarithmic.
    """
    checks.instance("found", found, RareEvent)
    names, rows = list(found.importance)[:2], found.events
    both = len(names) == 2
    figure, axes = s.panels(1, 2 if both else 1, s.PAGE if both else s.COLUMN, 2.6)
    left = axes[0, 0]
    value = np.cumprod([level.probability for level in found.levels])
    spread = 2.0 * np.sqrt(np.cumsum([level.cov**2 for level in found.levels]))
    bars = value * (1.0 - np.exp(-spread)), value * (np.exp(spread) - 1.0)
    distance = [level.threshold for level in found.levels]
    left.errorbar(distance, value, bars, fmt="o-", color=s.BLUE, elinewidth=0.8, label="levels")
    low, high = found.interval
    name, marker = ("estimate, 95 %", "_") if found.probability else ("upper bound, 95 %", "v")
    left.plot([0.0, 0.0], [low or high, high], color=s.RED, marker=marker, label=name)
    left.set(yscale="log", xlabel="distance to the event", ylabel="probability [1]")
    left.legend()
    s.tag(left, "a", f"{found.probability:.3g}, {found.runs} runs")
    if both:
        right, ends = axes[0, 1], []
        for name, which in zip(names, "xy", strict=True):
            column, path = shown(number(rows, name)), rows._spec.schema.locate(name)[0]
            nearest = np.asarray(found.design_point[path])[None]
            point = shown(rows._spec.schema.entries[path].split(nearest)[name]).values
            ends.append((column.values, point))
            right.set(**{f"{which}label": label(name, column.unit)})
            if drawn_by_magnitude(rows, name):
                s.by_magnitude(right, which, column.values.min(), column.values.max())
        (x, u), (y, v) = ends
        right.plot(x, y, ".", color=s.BLUE, markersize=2.0, alpha=0.3, label="the event happens")
        right.plot(u, v, "X", color=s.RED, markersize=6.0, label="design point")
        right.legend()
        s.tag(right, "b", f"{rows.runs} runs")
    return figure
