"""Modes of the contacts in figures: bands over time, their colours, and their legend.

A run with bilateral contact has no modes; figures of such a run have neither bands nor legend.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from ..run import measures as measures
from ..run.contact import ContactMode
from ..run.run import Run
from .drawing import SKIN
from .style import BLACK, BLUE, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

# Colours of the modes, which differ for every colour vision and, by their lightness, in grey. A tip
# that sticks has the colour of skin, as in a drawing of a run with bilateral contact.
COLORS: Mapping[ContactMode, str] = {
    ContactMode.STICK: SKIN,
    ContactMode.SLIP: "#E69F00",
    ContactMode.GRAZE: BLACK,
    ContactMode.FREE: BLUE,
}
_LABELS: Mapping[ContactMode, str] = {
    ContactMode.STICK: "tip sticks",
    ContactMode.SLIP: "slips",
    ContactMode.GRAZE: "grazes",
    ContactMode.FREE: "free",
}
# Modes that last too short to be seen are drawn as lines of this width, in points; where such lines
# meet, the mode that is later in `COLORS` hides the others.
_SHORTEST = 0.7
# Height of one band, and of the legend with the room around it, inches.
_BAND, LEGEND = 0.13, 0.3
# Share of a panel's height that its axes fill; the rest is for labels and titles.
_FILLED = 0.75


def unilateral(runs: Mapping[str, Run]) -> dict[str, Run]:
    """The runs that have modes, by name."""
    return {label: run for label, run in runs.items() if run.scene.contact == "unilateral"}


def count(runs: Mapping[str, Run]) -> int:
    """The number of these runs that have modes."""
    return len(unilateral(runs))


def panels_over_bands(
    runs: Mapping[str, Run], rows: int, columns: int, width: float, height: float, **options: Any
) -> tuple[Figure, NDArray[Any], list[Axes]]:
    """A figure with panels, and below each column an axes for the bands of these runs.

    Args:
        runs: Name -> run; those with bilateral contact get no band.
        rows: Number of rows of panels.
        columns: Number of columns.
        width: Width of the figure, inches.
        height: Height of the panels, inches; the bands are added to it.
        options: Passed to `matplotlib.figure.Figure.subplots`.

    Returns:
        The figure, its panels (rows, columns), and the axes below them, none if no run has modes.
    """
    if not count(runs):
        return *panels(rows, columns, width, height, **options), []
    bands = 2 * count(runs) * _BAND
    ratios = [*[1.0] * rows, bands * rows / (_FILLED * height)]
    # The bands must not share the vertical axis of all panels.
    shared = options.pop("sharey", False)
    if shared is not True:
        options["sharey"] = shared
    figure, axes = panels(
        rows + 1, columns, width, height + bands + LEGEND, height_ratios=ratios, **options
    )
    if shared is True:
        first = axes[0, 0]
        for each in axes[:-1].flat:
            if each is not first:
                each.sharey(first)
    return figure, axes[:-1], list(axes[-1])


def draw_bands(
    axes: Axes,
    runs: Mapping[str, Run],
    since: Mapping[str, float] | float = 0.0,
    per: float = 1.0,
    room: int = 0,
) -> None:
    """Draws two bands for each run with modes: the upper one for the right tip.

    With one run the bands are labelled by their tips, else each pair by the name of its run.

    Args:
        axes: Axes below a column of panels.
        runs: Name -> run.
        since: The instant that is zero on the time axis, s; of all runs, or by name.
        per: Units of the time axis in a second.
        room: Number of runs for which the axes have room, if more than these have modes.
    """
    named = unilateral(runs)
    ticks, labels = [], []
    for k, (label, run) in enumerate(named.items()):
        zero = since[label] if isinstance(since, Mapping) else since
        # Pairs follow from top to bottom, with a space between them.
        top = 2.4 * (len(named) - k)
        for side in (0, 1):
            low = top - 1.0 - side
            for mode, color in COLORS.items():
                spans = [
                    (per * (begin - zero), per * (end - begin))
                    for begin, end, found in measures.contact_spans(run, side)
                    if found is mode
                ]
                # Bands that stick are the ground, which others must not be narrowed by.
                edge = 0.0 if mode is ContactMode.STICK else _SHORTEST
                axes.broken_barh(
                    spans,
                    (low + 0.06, 0.88),
                    facecolor=color,
                    edgecolor=color,
                    linewidth=edge,
                    zorder=1.0 + list(COLORS).index(mode) / 10.0,
                )
            if len(named) == 1:
                ticks.append(low + 0.5)
                labels.append(("right", "left")[side])
        if len(named) > 1:
            ticks.append(top - 1.0)
            labels.append(label)
    top = 2.4 * len(named)
    axes.set_ylim(top + 0.4 - 2.4 * max(room, len(named), 1), top)
    axes.set_yticks(ticks, labels=labels)
    axes.tick_params(axis="y", length=0.0)
    axes.tick_params(axis="x", direction="out")


def handles(modes: Collection[ContactMode]) -> list[Patch]:
    """Labelled patches of these modes for a legend, in the order of `COLORS`."""
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=COLORS[mode], edgecolor="0.15", linewidth=0.4, label=_LABELS[mode])
        for mode in COLORS
        if mode in modes
    ]


def legend_below(figure: Figure, modes: Collection[ContactMode]) -> None:
    """Draws a legend of these modes below the whole figure."""
    found = handles(modes)
    figure.legend(handles=found, loc="outside lower center", ncols=len(found), handlelength=1.4)


def legend_of_panel(figure: Figure, ax: Axes | None, modes: Collection[ContactMode]) -> None:
    """Draws a legend of these modes, if any: inside a user's axes, else below the figure."""
    if modes and ax is None:
        legend_below(figure, modes)
    elif ax is not None and modes:
        ax.legend(handles=handles(modes), loc="lower center", fontsize="small")


def occurring(runs: Mapping[str, Run]) -> list[ContactMode]:
    """The modes that occur in these runs."""
    each = unilateral(runs).values()
    spans = [span for run in each for side in (0, 1) for span in measures.contact_spans(run, side)]
    return sorted({mode for _, _, mode in spans})


def add_bands(figure: Figure, strips: Sequence[Axes], run: Run) -> None:
    """Draws a run's bands below every column of a figure whose time axes have s, and the legend."""
    for axes in strips:
        draw_bands(axes, {"": run})
    if strips:
        legend_below(figure, occurring({"": run}))
