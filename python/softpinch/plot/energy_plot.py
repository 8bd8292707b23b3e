"""The energy around the rests of a manipulation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .panels import LETTERS
from .style import (
    BLACK,
    DEG,
    LINES,
    PAGE,
    PALE,
    Floats,
    least_range,
    legend_above,
    line,
    panels,
    styled,
    tag,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MILLI = 1e3
_COLUMNS = 4


class EnergyCurves(NamedTuple):
    """The energy around a rest, by the angle of the object, rad, and relative to the rest, J.

    Attributes:
        rest: The rest (2,): angle, energy.
        rolled: While the object turns about its centre of gravity without slip (2, n).
        family: Of other states of rest, which need slip (2, k).
        lowest: The one of these with the lowest energy (2,).
    """

    rest: Floats
    rolled: Floats
    family: Floats
    lowest: Floats


def energy_minima(curves: Mapping[str, EnergyCurves]) -> Figure:
    """Elastic energy and gravity around each rest: without slip, and along its family.

    Args:
        curves: Targets (theta_1, theta_2) of the fingers at each rest, as its title -> its curves.

    Raises:
        ImportError: matplotlib is not installed.
    """
    with styled():
        rows = max(1, -(-len(curves) // _COLUMNS))
        figure, axes = panels(rows, _COLUMNS, PAGE, 1.0 + 1.75 * rows, sharey=True)
        for each in axes.ravel()[len(curves) :]:
            each.set_visible(False)
        for k, (each, (title, found)) in enumerate(zip(axes.flat, curves.items(), strict=False)):
            scale = np.array([DEG.per_si, _MILLI])
            each.axhline(0.0, color=PALE, linewidth=0.6, zorder=0.5)
            line(each, *(found.rolled.T * scale).T, **LINES[0], label="turned without slip")
            line(each, *(found.family.T * scale).T, **LINES[1], label="other states of rest")
            # The dot is smaller, and visible where both are in the same place.
            for place, marker, size, face, label in (
                (found.lowest, "D", 5.0, "white", "lowest state of rest"),
                (found.rest, "o", 2.8, BLACK, "rest that is reached"),
            ):
                each.plot(
                    *(place * scale),
                    marker,
                    color=BLACK,
                    markersize=size,
                    markerfacecolor=face,
                    label=label,
                )
            tag(each, LETTERS[k], title)
            if k >= len(curves) - _COLUMNS:
                each.set_xlabel(r"$\theta$ [deg]")
            if k % _COLUMNS == 0:
                each.set_ylabel(r"$P + P_g$ [mJ]")
        least_range(axes.flat[: len(curves)])
        legend_above(figure, list(axes.flat))
        if curves:
            figure.text(0.012, 0.985, r"targets $(\theta_1, \theta_2)$:", va="top")
        return figure
