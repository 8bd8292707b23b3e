"""Figures over time, described as data: columns of panels with curves, above bands of modes.

A run with unilateral contact has two bands below its column, one for each tip.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..run import ContactMode, Run, measures
from ..scene import Scene, jaws
from ..scene import fields as units
from ..scene.outline import SKIN
from ..support import SIDES, Floats
from . import style as s

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _coordinates(
    *names: str, jaws: units.Jaws = (False, False)
) -> tuple[tuple[int, str, s.Unit], ...]:
    """Column of q, its symbol, and the unit to plot it in."""
    own = units.quantity("q", jaws).units
    return tuple(
        (k, units.label(name, jaws=jaws).strip("$"), s.Unit(*units.DISPLAY_UNITS[own[k]]))
        for name in names
        for k in [units.COORDINATES.index(name)]
    )


def fingers(scene: Scene) -> tuple[tuple[int, str, s.Unit], ...]:
    """The coordinates of both fingers, as `_coordinates` has them: angles, or travels of jaws."""
    return _coordinates("theta_1", "theta_2", jaws=jaws(scene))


POSE = _coordinates("x", "y", "theta")
COMPRESSIONS = _coordinates("d_n1", "d_n2")

# Colours of the modes, which differ for every colour vision and, by their lightness, in grey.
COLORS: Mapping[ContactMode, str] = {
    ContactMode.STICK: SKIN,
    ContactMode.SLIP: "#E69F00",
    ContactMode.GRAZE: s.BLACK,
    ContactMode.FREE: s.BLUE,
}
LABELS = dict(zip(COLORS, ("tip sticks", "slips", "grazes", "free"), strict=True))
# Modes that last too short to be seen are drawn as lines of this width, in points; where such lines
# meet, the mode that is later in `COLORS` hides the others.
_SHORTEST = 0.7
# Height of one band, and of the legend with the room around it, inches.
_BAND, LEGEND = 0.13, 0.3
# Share of a panel's height that its axes fill; the rest is for labels and titles.
_FILLED = 0.75


class Curve(NamedTuple):
    """Values (n,) over time (n,), with the style of their line and their entry in the legend."""

    t: Floats
    values: Floats
    style: Mapping[str, Any]
    label: str = ""


def lines(t: Floats, values: Floats, labels: Sequence[str]) -> list[Curve]:
    """A curve for each column of values (n, k), in the usual styles."""
    return [Curve(t, values[:, k], s.LINES[k], label) for k, label in enumerate(labels)]


def recorded(
    run: Run, array: str, columns: Sequence[int] = (), since_start: bool = False
) -> list[Curve]:
    """Curves of some columns of an array of the run, all without `columns`, in units of figures."""
    own, values = units.quantity(array, jaws(run.scene)), getattr(run, array)
    chosen = list(columns or range(len(own.columns)))
    names = [units.label(own.columns[k], jaws=jaws(run.scene)) for k in chosen]
    if since_start:
        values = values - values[0]
        names = [rf"$\Delta {name.strip('$')}$" for name in names]
    per_si = [units.DISPLAY_UNITS.get(own.units[k], ("", 1.0))[1] for k in chosen]
    return lines(run.t, values[:, chosen] * per_si, names)


class Panel(NamedTuple):
    """One panel of curves."""

    name: str  # name of the vertical axis, with its unit
    curves: Sequence[Curve]
    title: str = ""  # title beside the panel's letter
    zero: bool = False  # whether a thin line marks zero
    decades: int = 0  # largest number of labelled decades of a logarithmic axis; 0 for a linear one

    @classmethod
    def of(cls, symbol: str, unit: s.Unit, curves: Sequence[Curve], change: bool = False) -> Panel:
        """The panel of a coordinate, or of a change of it."""
        sign = r"\Delta " if change else ""
        return cls(f"${sign}{symbol}$ [{unit.name}]", curves, zero=change)

    def named(self, labels: Sequence[str]) -> Panel:
        """The panel with other names of its curves."""
        pairs = zip(self.curves, labels, strict=True)
        return self._replace(curves=[curve._replace(label=name) for curve, name in pairs])


class Column(NamedTuple):
    """Panels with one time axis, and the bands below them."""

    panels: Sequence[Panel]  # from top to bottom
    runs: Mapping[str, Run]  # name -> run; the bands are of those with unilateral contact
    limits: tuple[float | None, float | None]  # of the time axis; None chooses one
    time: str = "time [s]"  # name of the time axis, with its unit
    letters: str = s.LETTERS  # one for each panel; none for a zoom of the column beside it
    title: str = ""  # above the column
    # Name of a run -> the instant that is zero on the time axis, s; 0 of others.
    since: Mapping[str, float] = MappingProxyType({})
    switches: Iterable[float] = ()  # instants that thin lines mark

    @classmethod
    def of(cls, run: Run, panels: Sequence[Panel], letters: str = s.LETTERS) -> Column:
        """The column of a whole run, with the switches of its schedule."""
        limits = (float(run.t[0]), float(run.t[-1])) if len(run) > 1 else (None, None)
        inside = switches(run)
        # Sampled schedules have so many switches that their lines would fill the panel.
        few = inside if len(inside) <= 40 else []
        return cls(panels, {"": run}, limits, letters=letters, switches=few)

    def zoomed(self, begin: float, end: float, title: str = "") -> Column:
        """The column beside this one, with the instants from `begin` to `end` only, s."""
        panels = [panel.named([""] * len(panel.curves))._replace(name="") for panel in self.panels]
        return Column(panels, self.runs, (begin, end), letters="", title=title)


def draw(
    columns: Sequence[Column],
    width: float,
    height: float,
    legends: Literal["above", "panels", "none"] = "above",
    numbered: Run | None = None,  # whose operations have their numbers above the first panel
    **options: Any,
) -> tuple[Figure, NDArray[Any]]:
    """Draws columns, with bands below the `height`, inches; returns figure and panels' axes."""
    rows = max(len(column.panels) for column in columns)
    most = max(len(unilateral(column.runs)) for column in columns)
    if most:
        bands = 2 * most * _BAND
        options["height_ratios"] = [*[1.0] * rows, bands * rows / (_FILLED * height)]
        height += bands + LEGEND
    figure, axes = s.panels(rows + bool(most), len(columns), width, height, sharex="col", **options)
    for column, across in zip(columns, axes.T, strict=True):
        shown = list(across[: len(column.panels)])
        for panel, each in zip(column.panels, shown, strict=True):
            for curve in panel.curves:
                each.plot(curve.t, curve.values, **curve.style, label=curve.label)
            each.set_ylabel(panel.name)
            if panel.zero:
                each.axhline(0.0, color=s.GREY, linewidth=0.6, zorder=0.8)
            if panel.decades:
                s.whole_decades(each, panel.decades)
        for each, letter, panel in zip(shown, column.letters, column.panels, strict=False):
            s.tag(each, letter, panel.title)
            if legends == "panels":
                s.legend(each)
        s.least_range(shown)
        for each in across[len(shown) : rows]:
            each.set_visible(False)
        if column.title:
            across[0].set_title(column.title, pad=3.0)
        figure.align_ylabels(shown)
        if most:
            _draw_bands(across[-1], column, most)
            if column is not columns[0] and [*column.runs] == [*columns[0].runs]:
                across[-1].tick_params(labelleft=False)
            shown.append(across[-1])
        else:
            shown[-1].tick_params(labelbottom=True)
        for each, time in itertools.product(shown, column.switches):
            each.axvline(float(time), color=s.PALE, linewidth=0.6, zorder=0.5)
        shown[0].set_xlim(*column.limits)
        shown[-1].set_xlabel(column.time)
    if numbered is not None:
        _number_operations(axes[0, 0], numbered)
    if legends == "above":
        s.shared_legend(figure, axes[:rows].flat)
    if most:
        every = [run for column in columns for run in column.runs.values()]
        legend_of_modes(figure, occurring(every))
    return figure, axes[:rows]


def switches(run: Run) -> list[float]:
    """The instants inside the run at which the schedule switches, s."""
    return [begin for begin, _ in measures.operations(run)[1:] if begin < run.t[-1]]


def _number_operations(axes: Axes, run: Run) -> None:
    """Writes 1, 2, ... above the pieces of a schedule that has a few switches."""
    inside = switches(run)
    if not 1 <= len(inside) <= 12:
        return
    edges = np.array([run.t[0], *inside, run.t[-1]])
    for k, middle in enumerate(0.5 * (edges[1:] + edges[:-1])):
        place = (float(middle), 1.0), (0.0, 2.0), axes.get_xaxis_transform(), "offset points"
        axes.annotate(str(k + 1), *place, ha="center", va="bottom", fontsize=8.0, color="0.35")


def unilateral(runs: Mapping[str, Run]) -> dict[str, Run]:
    """The runs that have modes, by name."""
    return {label: run for label, run in runs.items() if run.scene.contact == "unilateral"}


def occurring(runs: Iterable[Run]) -> set[ContactMode]:
    """The modes that occur in those of the runs that have modes."""
    return {
        mode
        for run in runs
        if run.scene.contact == "unilateral"
        for side in (0, 1)
        for *_, mode in measures.contact_spans(run, side)
    }


def _draw_bands(axes: Axes, column: Column, room: int) -> None:
    """Draws two bands for each run with modes, right tip first, with room for `room` runs."""
    named = unilateral(column.runs)
    labels: dict[float, str] = {}
    for k, (name, run) in enumerate(named.items()):
        zero = column.since.get(name, 0.0)
        # Pairs follow from top to bottom, with a space between them.
        top = 2.4 * (len(named) - k)
        for side in (0, 1):
            low = top - 1.0 - side
            for layer, (mode, color) in enumerate(COLORS.items()):
                spans = [
                    (begin - zero, end - begin)
                    for begin, end, found in measures.contact_spans(run, side)
                    if found is mode
                ]
                # Bands that stick are the ground, which others must not be narrowed by.
                edge = 0.0 if mode is ContactMode.STICK else _SHORTEST
                place, order = (low + 0.06, 0.88), 1.0 + layer / 10
                axes.broken_barh(spans, place, color=color, linewidth=edge, zorder=order)
            if len(named) == 1:
                labels[low + 0.5] = SIDES[side]
        if len(named) > 1:
            labels[top - 1.0] = name
    top = 2.4 * len(named)
    axes.set_ylim(top + 0.4 - 2.4 * room, top)
    axes.set_yticks(list(labels), labels=list(labels.values()))
    axes.tick_params(axis="y", length=0.0)
    axes.tick_params(axis="x", direction="out")


def legend_of_modes(figure: Figure, modes: Collection[ContactMode], ax: Axes | None = None) -> None:
    """Draws a legend of these modes, if any: inside a user's axes, else below the figure."""
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor=COLORS[mode], edgecolor="0.15", linewidth=0.4, label=label)
        for mode, label in LABELS.items()
        if mode in modes
    ]
    if ax is not None and handles:
        ax.legend(handles=handles, loc="lower center", fontsize="small")
    elif handles:
        below: dict[str, Any] = {"loc": "outside lower center", "ncols": len(handles)}
        figure.legend(handles=handles, handlelength=1.4, **below)
