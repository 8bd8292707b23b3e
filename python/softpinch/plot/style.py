"""The style of the figures: legible in a printed column, in grey, and for every colour vision.

Matplotlib is an extra, so it is imported only inside functions.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..scene.fields import DISPLAY_UNITS
from ..support import Floats, checks, require

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

# Widths of one and of two columns of a paper, inches.
COLUMN = 3.4
PAGE = 7.0
# Of the panels of a figure.
LETTERS = "abcdefghijklmnopqrstuvwxyz"

# Okabe and Ito's colours, distinct for every colour vision; dashes keep lines distinct in grey.
BLACK, BLUE, RED, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE = "#CC79A7"
GREY, PALE = "0.55", "0.88"
# Line styles. The first is always for the right finger, the second for the left finger.
LINES: tuple[dict[str, Any], ...] = (
    {"color": BLUE, "linestyle": "-"},
    {"color": RED, "linestyle": (0, (4, 1.5))},
    {"color": GREEN, "linestyle": (0, (5, 1.2, 1.2, 1.2))},
    {"color": BLACK, "linestyle": (0, (1.2, 1.2))},
    {"color": PURPLE, "linestyle": (0, (7, 1.2, 1.2, 1.2, 1.2, 1.2))},
)
# A perceptually uniform colour map, for every colour vision and in grey.
HEAT = "cividis"
TARGET: dict[str, Any] = {"color": RED, "linestyle": (0, (3, 1.5)), "linewidth": 0.8}

# A linear axis whose values differ by less than this, in its unit or relative to the largest, shows
# round-off: that of a run is below 1e-12 deg, mm, N or J.
_ROUND_OFF = 1e-9

# Fonts that come with matplotlib make figures equal on every machine. Sizes are in points.
_AXES = {
    **dict.fromkeys(("labelsize", "titlesize"), 9.0),
    **{"linewidth": 0.6, "formatter.use_mathtext": True, "formatter.useoffset": False},
    **{"autolimit_mode": "data", "ymargin": 0.12, "unicode_minus": True},
}
_TICKS = {"labelsize": 8.0, "direction": "in", "major.width": 0.6, "minor.width": 0.4}
_LEGEND = {"fontsize": 8.0, "frameon": False, "handlelength": 2.4, "borderaxespad": 0.3}
_RC: dict[str, Any] = {
    **{"font.family": "STIXGeneral", "mathtext.fontset": "stix", "font.size": 9.0},
    **{f"axes.{name}": value for name, value in _AXES.items()},
    **{f"{axis}tick.{name}": value for axis in "xy" for name, value in _TICKS.items()},
    **{f"legend.{name}": value for name, value in _LEGEND.items()},
    **{"lines.linewidth": 1.0, "lines.markersize": 3.5, "hatch.linewidth": 0.5},
    **{"pdf.fonttype": 42, "svg.hashsalt": "softpinch"},
}


class Unit(NamedTuple):
    """A unit of figures: its name in labels, and the number of these in one SI unit."""

    name: str
    per_si: float

    def finer(self, peak: float) -> Unit:
        """The unit, or its thousandth if `peak`, in SI units, is below a tenth of the unit."""
        if peak * self.per_si >= 0.1:
            return self
        return Unit({"mm": "µm", "deg": "mdeg"}[self.name], 1e3 * self.per_si)


MM, DEG = Unit(*DISPLAY_UNITS["m"]), Unit(*DISPLAY_UNITS["rad"])


@contextmanager
def styled() -> Iterator[None]:
    """Applies the style of these figures inside `with plot.styled():`, or to a function."""
    matplotlib = require("matplotlib", extra="plot", purpose="figures")
    colors = [style["color"] for style in LINES]
    with matplotlib.rc_context():
        matplotlib.rcParams.update(_RC)
        matplotlib.rcParams["axes.prop_cycle"] = matplotlib.cycler(color=colors)
        yield


def save(figure: Figure, path: str | Path) -> Path:
    """Saves a figure in the format of the path's suffix, and returns the path.

    Equal figures give equal files.

    Raises:
        ValueError: Matplotlib does not support the format; the message lists supported ones.
        OSError: The file cannot be written.
    """
    require("matplotlib", extra="plot", purpose="figures")
    from matplotlib.figure import Figure

    path = checks.path("path", path)
    checks.instance("figure", figure, Figure)
    kind = path.suffix.lower().removeprefix(".")
    known = sorted(figure.canvas.get_supported_filetypes())
    if kind not in known:
        raise ValueError(f"path = {str(path)!r}: must end in .{', .'.join(known)}")
    # Without dates in their metadata, files of equal figures are equal.
    dates: Mapping[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with styled():
        figure.savefig(path, format=kind, dpi=300, metadata=dates.get(kind))
    return path


def new(width: float, height: float) -> Figure:
    """An empty figure without a window; width and height in inches."""
    from .shown_figure import ShownFigure

    figure = ShownFigure(figsize=(width, height), layout="constrained")
    figure.rc = _RC
    return figure


def panels(
    rows: int, columns: int, width: float, height: float, **options: Any
) -> tuple[Figure, NDArray[Any]]:
    """A figure and its axes (rows, columns); width and height in inches."""
    figure = new(width, height)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


@contextmanager
def panels_or_given(
    ax: Axes | None, rows: int, columns: int, width: float, height: float, **options: Any
) -> Iterator[tuple[Figure, NDArray[Any]]]:
    """Yields a figure and its axes (rows, columns); the user's own axes `ax` keep their style."""
    require("matplotlib", extra="plot", purpose="figures")
    from matplotlib.axes import Axes

    if ax is None:
        with styled():
            yield panels(rows, columns, width, height, **options)
        return
    checks.instance("ax", ax, Axes, "axes of matplotlib")
    if rows * columns > 1:
        raise ValueError(f"ax: must be None for a figure of {rows} x {columns} panels")
    whole = ax.get_figure()
    # Axes in a part of a figure belong to the whole one too.
    while getattr(whole, "figure", whole) is not whole:
        whole = whole.figure  # type: ignore[union-attr]
    yield whole, np.array([[ax]])  # type: ignore[misc]


@contextmanager
def one_panel(ax: Axes | None, width: float, height: float) -> Iterator[tuple[Figure, Any]]:
    """As `panels_or_given` with one panel: yields the figure and its only axes."""
    with panels_or_given(ax, 1, 1, width, height) as (figure, axes):
        yield figure, axes[0, 0]


def tag(axes: Axes, letter: str, title: str = "") -> None:
    """Labels a panel (a), (b), ... with a title; without one, left of the upper left corner."""
    if title:
        axes.set_title(f"({letter}) {title}", loc="left", pad=3.0)
        return
    place = (0.0, 1.0), (-2.0, 2.0), "axes fraction", "offset points"
    axes.annotate(f"({letter})", *place, ha="right", va="bottom")


def legend(axes: Axes) -> None:
    """Draws a legend at the right end of the title's line, where it hides no curve."""
    handles, labels = axes.get_legend_handles_labels()
    crowded, full = len(labels) > 3, len(labels) > 4
    how: dict[str, Any] = {"ncols": len(labels), "borderaxespad": 0.0, "borderpad": 0.15}
    how["handletextpad"] = 0.3 if crowded else 0.4
    how["handlelength"] = 1.1 if full else 1.4 if crowded else 1.7
    how["columnspacing"] = 0.4 if full else 0.6 if crowded else 0.8
    axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), **how)


def shared_legend(
    figure: Figure, axes: Iterable[Axes], loc: Any = "outside upper right", **options: Any
) -> None:
    """Draws one legend outside the panels, with every label of their axes once."""
    entries: dict[str, Any] = {}
    for each in axes:
        for handle, label in zip(*each.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    options = {"ncols": len(entries), **options}
    figure.legend(list(entries.values()), list(entries), loc=loc, **options)


def colorbar(figure: Figure, mesh: Any, axes: Any, label: str, **options: Any) -> Colorbar:
    """Adds a scale of colours beside axes."""
    bar = figure.colorbar(mesh, ax=axes, **{"pad": 0.02, **options})
    bar.set_label(label)
    bar.outline.set_linewidth(0.6)
    return bar


def by_magnitude(axes: Axes, which: str, low: float, high: float) -> None:
    """Makes axis "x" or "y" from `low` to `high` logarithmic; a few decades have plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    if high < 1e3 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(NullFormatter())


def least_range(panels: Iterable[Axes], round_off: float = _ROUND_OFF) -> None:
    """Shows values that differ by round-off only as equal ones, on linear axes without limits."""
    for axes in panels:
        if not axes.get_autoscaley_on() or axes.get_yscale() != "linear":
            continue
        shared = axes.get_shared_y_axes().get_siblings(axes)
        within = np.array([each.dataLim.intervaly for each in shared])
        if (limits := constant_limits(within, round_off)) is not None:
            axes.set_ylim(*limits)


def constant_limits(values: Floats, round_off: float) -> tuple[float, float] | None:
    """Limits of an axis whose values differ by round-off only, else None."""
    known = values[np.isfinite(values)]
    size = max(1.0, float(np.abs(known).max(initial=0.0)))
    if not known.size or np.ptp(known) > round_off * size:
        return None
    # Round-off about zero is zero.
    middle = float(known.mean()) if np.abs(known).max() > round_off else 0.0
    return middle - 0.05 * size, middle + 0.05 * size


def whole_decades(axes: Axes, labels: int = 6) -> None:
    """Makes the vertical axis logarithmic over whole decades; exact zeros are not drawn."""
    from matplotlib.ticker import LogLocator, NullLocator

    values = np.concatenate([np.asarray(each.get_ydata(), float) for each in axes.get_lines()])
    values = values[np.isfinite(values) & (values > 0)]
    decades = np.log10(values) if values.size else np.zeros(1)
    # Limits, and the ticks which matplotlib tries beyond them, stay within a float's range. Limits
    # come before the scale, which would otherwise choose its own.
    low, high = np.clip([np.floor(decades.min()), np.ceil(decades.max())], -150.0, 149.0)
    axes.set_ylim(10.0**low, 10.0 ** max(high, low + 1.0))
    axes.set_yscale("log", nonpositive="mask")
    axes.yaxis.set_major_locator(LogLocator(numticks=labels))
    axes.yaxis.set_minor_locator(NullLocator())


def color_cells(
    axes: Axes, edges: Sequence[Floats], values: Floats, low: float, high: float, colors: str = HEAT
) -> QuadMesh:
    """Draws cells (m, n) between edges (m + 1,) and (n + 1,) in the colours of their values."""
    axes.set(xlim=edges[0][[0, -1]], ylim=edges[1][[0, -1]])
    return axes.pcolormesh(*edges, values.T, cmap=colors, vmin=low, vmax=high, rasterized=True)


def cell_edges(centres: Floats) -> Floats:
    """The edges (n + 1,) of cells around their centres (n,); a lone cell is one wide."""
    half = 0.5 * np.diff(centres) if len(centres) > 1 else np.array([0.5])
    ends = [centres[:1] - half[:1], centres[:-1] + half[: len(centres) - 1]]
    return np.concatenate([*ends, centres[-1:] + half[-1:]])


# The colour and the hatch of a cell.
Face: TypeAlias = tuple[str, str]


def fill_cells(
    axes: Axes, kinds: NDArray[Any], left: Floats, bottom: Floats, faces: Mapping[str, Face]
) -> None:
    """Fills cells between edges (m + 1,), (n + 1,) that have a face; equal neighbours as one."""
    for column, sides in zip(kinds.tolist(), itertools.pairwise(left), strict=True):
        for kind, cells in itertools.groupby(range(len(column)), key=column.__getitem__):
            if kind in faces:
                rows, (face, hatch) = list(cells), faces[kind]
                axes.fill_between(
                    sides, bottom[rows[0]], bottom[rows[-1] + 1], facecolor=face, edgecolor="0.3",
                    hatch=hatch, linewidth=0.0, zorder=0.9,
                )  # fmt: skip


def cell_patch(face: Face, label: str) -> Patch:
    """The entry of a legend for cells with a face colour and hatch."""
    from matplotlib.patches import Patch

    color, hatch = face
    return Patch(facecolor=color, edgecolor="0.3", hatch=hatch, linewidth=0.4, label=label)
