"""Figures of accuracy: `work_precision`, `stabilization_sweep` and `stability_map`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..accuracy.measurements import WHERE, Measurement, StabilizationSweep, WorkPrecision
from ..accuracy.stability_maps import NO_REFERENCE, NOT_RUN, StabilityMap
from ..scene.fields import words
from ..support import Floats, checks
from . import style as s

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Curves = dict[tuple[str, str], list[Measurement]]
# Colour and marker of each method. Curves with adaptive steps are dashed and have hollow markers.
_METHODS: dict[str, tuple[str, str]] = {
    "rk4": (s.BLACK, "o"),
    "dop853": (s.BLUE, "s"),
    "implicit_midpoint": (s.PURPLE, "^"),
    "radau5": (s.RED, "D"),
    "rosenbrock": (s.GREEN, "v"),
}
_PEERS = ("#E69F00", "#56B4E9", "#8C564B", s.GREY, "#7F3C8D", "#11A579", "#3969AC", "#80BA5A")
_CURVE: dict[str, Any] = {"markersize": 3.0, "markeredgewidth": 0.7, "linewidth": 0.9}
# Nine markers and eight colours make 72 different combinations for peers.
_MARKERS = "P*X<>hpd8"
# The error at which the upper panels, with loose errors, and the lower ones meet.
_MEET = 1e-6
_LOOSEST, _TIGHTEST = 1.0, 1e-13
_LABELS = {"along": r"along the run, of q, p, $\lambda$", "end": "at the end, of q and p"}


@s.styled()
def work_precision(result: WorkPrecision, peers: bool = False, where: str | None = None) -> Figure:
    """Error over CPU time, both logarithmic; loose errors in the upper row, tight ones below.

    Solid lines are equal steps, dashed lines adaptive steps, dotted lines peers. Crosses on the
    upper edge are failed runs, at the time that they took. In the grey band errors are below the
    error of the reference itself and have no meaning.

    Args:
        peers: Whether to show one column with "nullspace" and the peers, instead of a column for
            each formulation.
        where: "along" for the largest error of q, p and lambda along the run; "end" for the error
            of q and p at the end, with a title that says so if the motion has settled by then. None
            is "along", or "end" with `peers`, which have no other.
    """
    checks.instance("result", result, WorkPrecision)
    peers = checks.boolean("peers", peers)
    where = checks.choice("where", WHERE[peers] if where is None else where, WHERE)
    along = where == "along"
    curves = result.curves()
    parts: dict[str, Curves] = {
        name: {key: rows for key, rows in curves.items() if rows[0].formulation == name}
        for name in _core.FORMULATIONS
    }
    columns = {name: part for name, part in parts.items() if part}
    if peers:
        others = {key: rows for key, rows in curves.items() if not rows[0].method}
        columns = {"nullspace, and others": parts["nullspace"] | others}
    floor = max(size for name, size in result.floor.items() if along or name != "multipliers")
    width, height = (s.COLUMN * 1.35, 6.2) if peers else (s.PAGE, 5.2)
    figure, axes = s.panels(2, len(columns), width, height, sharex=True, sharey="row")
    for (upper, lower), (title, part) in zip(axes.T, columns.items(), strict=True):
        _work_precision_panel(upper, part, (_MEET, _LOOSEST), floor, along)
        _work_precision_panel(lower, part, (_TIGHTEST, _MEET), floor, along)
        upper.set_title(title)
        lower.set_xlabel("CPU time [s]")
    axes[0, 0].set_ylabel(f"error {_LABELS[where]}")
    axes[1, 0].set_ylabel("small errors")
    if not along:
        figure.suptitle("\n".join(wrap(result.settled(), 60)), fontsize=8.0)
    below: dict[str, Any] = {"ncols": 2 if peers else 4, "fontsize": 7.5}
    s.shared_legend(figure, axes.flat, "outside lower center", **below)
    return figure


def _work_precision_panel(
    axes: Axes, curves: Curves, limits: tuple[float, float], floor: float, along: bool
) -> None:
    axes.set(xscale="log", yscale="log", ylim=limits)
    others = 0
    for (solver, setting), rows in curves.items():
        method = rows[0].method
        if method:
            color, marker = _METHODS[method]
            name = f"{method}, {'equal' if setting == 'dt' else 'free'} steps"
        else:
            color, marker = _PEERS[others % len(_PEERS)], _MARKERS[others % len(_MARKERS)]
            name, others = solver, others + 1
        free = setting == "tolerance"
        sizes = [row.along if along else row.error for row in rows]
        good = [(row.time, size) for row, size in zip(rows, sizes, strict=True) if size < math.inf]
        times, shown = [time for time, _ in good], [max(size, _TIGHTEST) for _, size in good]
        face, line = ("white", "--") if free else (color, "-" if method else ":")
        look = {**_CURVE, "color": color, "marker": marker, "markerfacecolor": face}
        axes.plot(times, shown, **look, linestyle=line, label=name)
        failed = [row.time for row in rows if row.error == math.inf and math.isfinite(row.time)]
        if failed and limits[1] == _LOOSEST:
            axes.plot(
                failed, [0.97] * len(failed), linestyle="none", marker="x", color=color,
                markersize=4.0, transform=axes.get_xaxis_transform(), clip_on=False, label="failed",
            )  # fmt: skip
    if floor > 0.0:
        axes.axhspan(limits[0], max(floor, limits[0]), color="0.9", zorder=0, linewidth=0)
    axes.grid(True, which="major", color="0.9", linewidth=0.4)


@s.styled()
def stabilization_sweep(results: StabilizationSweep | Sequence[StabilizationSweep]) -> Figure:
    """Drift of the constraints, and error of the motion, over alpha dt = beta dt.

    The vertical line is the method's stability limit on the real axis. The horizontal line is the
    error of "nullspace", which has no gains. Of several sweeps each has a column.
    """
    sweeps = [results] if isinstance(results, StabilizationSweep) else results
    checks.instance("results", sweeps, Sequence, "a StabilizationSweep, or several")
    for k, sweep in enumerate(sweeps):
        checks.instance(f"results[{k}]", sweep, StabilizationSweep)
    if not sweeps:
        raise ValueError("results is empty: must have a StabilizationSweep")
    width = min(s.PAGE, s.COLUMN * len(sweeps))
    figure, axes = s.panels(2, len(sweeps), width, 4.6, sharex=True, sharey="row")
    dashed = {"color": s.RED, "linestyle": "--"}
    for (drift, motion), sweep in zip(axes.T, sweeps, strict=True):
        finite = np.isfinite(sweep.holonomic)
        x = sweep.product[finite]
        drift.plot(x, sweep.holonomic[finite], color=s.BLUE, label="largest $|C^H|$ [m]")
        drift.plot(x, sweep.nonholonomic[finite], **dashed, label="$|C^N|$ [m/s]")
        drift.set_title(f"{sweep.method}, dt = {sweep.dt:g} s")
        motion.plot(x, sweep.error[finite], color=s.BLUE, label="q and p")
        motion.plot(x, sweep.multipliers[finite], **dashed, label=r"$\lambda$")
        own = sweep.without["q and p"]
        motion.axhline(own, color=s.GREY, linewidth=0.7, label="q and p of nullspace")
        limit = float(_core.stable_step(sweep.method, np.array([-1.0 + 0.0j]))[0])
        for each in (drift, motion):
            each.set(xscale="log", yscale="log", xlim=(sweep.product[0], sweep.product[-1]))
            if math.isfinite(limit):
                each.axvline(limit, color=s.BLACK, linewidth=0.7, linestyle=":")
        motion.set_xlabel(r"$\alpha\,$dt = $\beta\,$dt")
    axes[0, 0].set_ylabel("drift")
    axes[1, 0].set_ylabel("largest error along the run")
    for each in axes[:, 0]:
        each.legend()
    return figure


# Colour range of errors in maps, as powers of ten: from round-off to a whole magnitude.
_BEST, _WORST = -12, 0
# Face colour and hatch of each kind of cell without an error, distinct in grey too.
_ENDED = "ends early, as it should"
_MISSED = "completes, should not"
_KINDS: dict[str, tuple[str, str]] = {
    _ENDED: ("#A6D5BC", ""),
    _MISSED: ("#E69F00", "xxxx"),
    "separated": ("#F6D5C3", "////"),
    "crushed": ("#E4C3DA", "\\\\\\\\"),
    "folded": ("#BFDDF0", "----"),
    "not_finite": ("#606060", ""),
    "unstable": ("#606060", "...."),
    "newton_failed": ("#B4B4B4", "||||"),
    "step_too_small": ("#B4B4B4", "++"),
    NO_REFERENCE: ("#FFFFFF", "xx"),
    NOT_RUN: ("#FFFFFF", ""),
}
# Ticks of the scales that matplotlib's own locators would crowd.
_TICKS = {"logit": (0.01, 0.5, 0.99), "right_angle": (0.0, 80.0, 89.0)}
_DOT: dict[str, Any] = {"marker": "o", "markersize": 2.2, "color": s.RED, "markeredgewidth": 0.0}
# The predicted step: white on black, which is visible on every colour.
_LINES: tuple[dict[str, Any], ...] = (
    {"color": s.BLACK, "linewidth": 2.2, "zorder": 3.0, "solid_capstyle": "butt"},
    {"color": "white", "linewidth": 1.0, "zorder": 3.1, "solid_capstyle": "butt"},
)


def stability_map(map: StabilityMap, ax: Axes | None = None) -> Figure:
    """Panels of steps over the map's axis, one for each formulation (row) and method (column).

    The colour of a cell is the error at the end. Cells without an error show by face colour and
    hatch how the run ended. Dots mark runs that complete with an error above 0.1. The line is the
    longest stable step that the eigenvalues predict. With `ax`, for a map of a single pair, the
    scale of colours is beside these axes and the legend below.
    """
    checks.instance("map", map, StabilityMap)
    rows = [name for name in _core.FORMULATIONS if name in {pair[0] for pair in map.pairs}]
    columns = [name for name in _core.METHODS if name in {pair[1] for pair in map.pairs}]
    kinds = _kinds(map)
    with np.errstate(divide="ignore"):
        powers = np.where(map.error == 0.0, _BEST, np.log10(map.error))
    powers = np.ma.masked_invalid(powers)
    width = s.PAGE if len(columns) > 2 else s.COLUMN
    height = 1.25 * len(rows) + 1.25
    grid = s.panels_or_given(ax, len(rows), len(columns), width, height, sharex=True, sharey=True)
    with grid as (figure, axes):
        if ax is None:
            # The panels share their scales, so they need little space between them.
            spaces = {"w_pad": 0.02, "h_pad": 0.02, "wspace": 0.02, "hspace": 0.02}
            figure.set_layout_engine("constrained", **spaces)
        _set_scales(axes[0, 0], map)
        left, bottom = _edges(axes[0, 0].xaxis, map.values), _edges(axes[0, 0].yaxis, map.dt)
        for (i, row), (j, column) in itertools.product(enumerate(rows), enumerate(columns)):
            each: Axes = axes[i, j]
            if i == 0:
                each.set_title(words(column), pad=3.0)
            if j == len(columns) - 1:
                each.annotate(
                    words(row), (1.0, 0.5), (4.0, 0.0), "axes fraction", "offset points",
                    rotation=-90, ha="left", va="center",
                )  # fmt: skip
            if (row, column) not in map.pairs:
                each.text(0.5, 0.5, "not asked for", ha="center", va="center", fontsize=8.0,
                          transform=each.transAxes)  # fmt: skip
                continue
            k = map.pairs.index((row, column))
            mesh = s.color_cells(each, (left, bottom), powers[k], _BEST, _WORST)
            s.fill_cells(each, kinds[k], left, bottom, _KINDS)
            v, d = np.nonzero(map.misleading()[k] & (map.expected == "completed")[:, None])
            each.plot(map.values[v], map.dt[d], linestyle="", **_DOT)
            # The predicted step goes through the cells' centres, or across a lone cell.
            known = (map.predicted[k] > 0.0) & np.isfinite(map.predicted[k])
            steps = np.where(known, map.predicted[k], np.nan)
            line = (left, steps[[0, 0]]) if len(map.values) == 1 else (map.values, steps)
            for style in _LINES:
                each.plot(*line, **style)
        across, up = f"{map.label} [{map.unit}]", "step $dt$ [s]"
        if axes.size > 1:
            figure.supxlabel(across, fontsize=9.0)
            figure.supylabel(up, fontsize=9.0)
        else:
            axes[0, 0].set(xlabel=across, ylabel=up)
        options = {"pad": 0.01, "aspect": 40, "extend": "both", "fraction": 0.04}
        bar = s.colorbar(figure, mesh, axes, "error at the end [1]", **options)
        ticks = range(_BEST, _WORST + 1, 3)
        bar.set_ticks(list(ticks), labels=[f"$10^{{{k}}}$" for k in ticks])
        entries = {"handles": list(_legend(kinds, map)), "handlelength": 1.8, "columnspacing": 1.4}
        if ax is None:
            entries["ncols"] = 5 if width == s.PAGE else 2
            figure.legend(**entries, loc="outside upper center")
        else:
            # A legend inside would hide cells.
            ax.legend(**entries, loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize="small")
        return figure


def _set_scales(axes: Axes, map: StabilityMap) -> None:
    """Sets the scales and ticks of the axes, which all panels share."""
    from matplotlib.ticker import NullLocator, SymmetricalLogLocator

    axes.set_yscale("log")
    _set_decades(axes.yaxis, map.dt, 4)
    if map.scale == "logit":
        axes.set_xscale("logit")
    elif map.scale == "right_angle":
        axes.set_xscale("function", functions=(_from_right_angle, lambda x: 90.0 - 10.0**-x))
    elif map.scale == "log" and map.values[0] > 0.0:
        axes.set_xscale("log")
        _set_decades(axes.xaxis, map.values, 3)
    elif map.scale == "log" and map.values[0] == 0.0 and len(map.values) > 1:
        # Zero is about as far from the smallest other value as a tenth of that is.
        axes.set_xscale("symlog", linthresh=map.values[1])
        decades = SymmetricalLogLocator(base=10.0, linthresh=map.values[1])
        decades.set_params(numticks=3)
        axes.xaxis.set_major_locator(decades)
    else:
        axes.locator_params(axis="x", nbins=3)
    if map.scale in _TICKS:
        low, high = map.values[[0, -1]]
        ticks = [tick for tick in _TICKS[map.scale] if low <= tick <= high] or [low, high]
        axes.set_xticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_locator(NullLocator())


def _set_decades(axis: Axis, values: Floats, most: int) -> None:
    """Puts ticks at powers of ten; without one among the cells, at the first and the last value."""
    from matplotlib.ticker import FixedLocator, LogLocator, StrMethodFormatter

    low, high = np.floor(np.log10(_edges(axis, values)[[0, -1]]))
    if low < high:
        axis.set_major_locator(LogLocator(numticks=most))
    else:
        axis.set_major_locator(FixedLocator([values[0], values[-1]]))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))


def _from_right_angle(degrees: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return -np.log10(90.0 - degrees)


def _edges(axis: Axis, values: Floats) -> Floats:
    """The edges (n + 1,) of cells around values (n,), halfway between them on the axis' scale."""
    scale = axis.get_transform()
    return np.asarray(scale.inverted().transform(s.cell_edges(scale.transform(values))))


def _kinds(map: StabilityMap) -> np.ndarray:
    """Kind of each cell (pairs, v, d): a key of `_KINDS`, or "" if it shows an error's colour."""
    kinds = map.status.astype("U40")
    expected = np.broadcast_to(map.expected[:, None], map.status.shape)
    completed = map.status == "completed"
    kinds[completed & (expected == "completed")] = ""
    kinds[completed & (expected != "completed")] = _MISSED
    kinds[map.agrees & ~completed] = _ENDED
    kinds[(expected == NO_REFERENCE) & (map.status != NOT_RUN)] = NO_REFERENCE
    return kinds


def _legend(kinds: np.ndarray, map: StabilityMap) -> Iterator[Any]:
    from matplotlib.lines import Line2D

    if np.isfinite(map.predicted).any():
        yield Line2D([], [], **{**_LINES[1], "color": s.BLACK}, label="predicted longest step")
    if map.misleading().any():
        yield Line2D([], [], linestyle="", **_DOT, label="completes, error above 0.1")
    seen = set(kinds.ravel().tolist())
    for kind, face in _KINDS.items():
        if kind in seen:
            yield s.cell_patch(face, words(kind))
