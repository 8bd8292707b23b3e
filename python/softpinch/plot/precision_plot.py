"""Figures of `work_precision` and `stabilization_sweep`, public in `softpinch.plot`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _core
from ..accuracy.measurements import WHERE, Measurement, StabilizationSweep, WorkPrecision
from ..support import checks
from .style import BLACK, BLUE, COLUMN, GREEN, GREY, PAGE, RED, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Curves = dict[tuple[str, str], list[Measurement]]
# Colour and marker of each method. Curves with adaptive steps are dashed and have hollow markers.
_METHODS: dict[str, tuple[str, str]] = {
    "rk4": (BLACK, "o"),
    "dop853": (BLUE, "s"),
    "implicit_midpoint": ("#CC79A7", "^"),
    "radau5": (RED, "D"),
    "rosenbrock": (GREEN, "v"),
}
_PEERS = ("#E69F00", "#56B4E9", "#8C564B", GREY, "#7F3C8D", "#11A579", "#3969AC", "#80BA5A")
# Nine markers and eight colours make 72 different combinations for peers.
_MARKERS = "P*X<>hpd8"
# The error at which the upper panels, with loose errors, and the lower ones, with tight errors,
# meet.
_MEET = 1e-6
_LOOSEST, _TIGHTEST = 1.0, 1e-13
_LABELS = {"along": r"along the run, of q, p, $\lambda$", "end": "at the end, of q and p"}


@styled()
def work_precision(result: WorkPrecision, peers: bool = False, where: str | None = None) -> Figure:
    """Error over CPU time, both logarithmic; loose errors in the upper row, tight ones below.

    Solid lines are equal steps, dashed lines adaptive steps, dotted lines peers. Crosses on the
    upper edge are failed runs, at the time that they took. In the grey band errors are below the
    error of the reference itself and have no meaning.

    Args:
        result: The measurements.
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
    ours = {key: rows for key, rows in curves.items() if rows[0].method}
    parts: dict[str, Curves] = {
        name: {key: rows for key, rows in ours.items() if rows[0].formulation == name}
        for name in _core.FORMULATIONS
    }
    columns = {name: part for name, part in parts.items() if part}
    if peers:
        others = {key: rows for key, rows in curves.items() if not rows[0].method}
        columns = {"nullspace, and others": parts["nullspace"] | others}
    floor = max(size for name, size in result.floor.items() if along or name != "multipliers")
    width, height = (COLUMN * 1.35, 6.2) if peers else (PAGE, 5.2)
    figure, axes = panels(2, len(columns), width, height, sharex=True, sharey="row")
    entries: dict[str, Any] = {}
    for (upper, lower), (title, part) in zip(axes.T, columns.items(), strict=True):
        _panel(upper, part, (_MEET, _LOOSEST), floor, entries, along)
        _panel(lower, part, (_TIGHTEST, _MEET), floor, entries, along)
        upper.set_title(title)
        lower.set_xlabel("CPU time [s]")
    axes[0, 0].set_ylabel(f"error {_LABELS[where]}")
    axes[1, 0].set_ylabel("the same, tight")
    if not along:
        figure.suptitle("\n".join(wrap(result.settled(), 60)), fontsize=8.0)
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        ncols=2 if peers else 4,
        fontsize=7.5,
    )
    return figure


def _panel(
    axes: Axes,
    curves: Curves,
    limits: tuple[float, float],
    floor: float,
    entries: dict[str, Any],
    along: bool,
) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(*limits)
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
        good = [(row, size) for row, size in zip(rows, sizes, strict=True) if size < math.inf]
        (handle,) = axes.plot(
            [row.time for row, _ in good],
            [max(size, _TIGHTEST) for _, size in good],
            color=color,
            marker=marker,
            markersize=3.0,
            markerfacecolor="white" if free else color,
            markeredgewidth=0.7,
            linestyle="--" if free else "-" if method else ":",
            linewidth=0.9,
        )
        entries.setdefault(name, handle)
        failed = [row.time for row in rows if row.error == math.inf and math.isfinite(row.time)]
        if failed and limits[1] == _LOOSEST:
            (crosses,) = axes.plot(
                failed, [0.97] * len(failed), linestyle="none", marker="x", color=color,
                markersize=4.0, transform=axes.get_xaxis_transform(), clip_on=False,
            )  # fmt: skip
            entries.setdefault("failed", crosses)
    if floor > 0.0:
        axes.axhspan(limits[0], max(floor, limits[0]), color="0.9", zorder=0, linewidth=0)
    axes.grid(True, which="major", color="0.9", linewidth=0.4)


@styled()
def stabilization_sweep(results: StabilizationSweep | Sequence[StabilizationSweep]) -> Figure:
    """Drift of the constraints, and error of the motion, over alpha dt = beta dt.

    The vertical line is the method's stability limit on the real axis. The horizontal line is the
    error of "nullspace", which has no gains.

    Args:
        results: One sweep or several; each has a column.
    """
    sweeps = [results] if isinstance(results, StabilizationSweep) else results
    checks.instance("results", sweeps, Sequence, "a StabilizationSweep, or several")
    for k, sweep in enumerate(sweeps):
        checks.instance(f"results[{k}]", sweep, StabilizationSweep)
    if not sweeps:
        raise ValueError("results is empty: must have a StabilizationSweep")
    width = min(PAGE, COLUMN * len(sweeps))
    figure, axes = panels(2, len(sweeps), width, 4.6, sharex=True, sharey="row")
    dashed = {"color": RED, "linestyle": "--"}
    for (drift, motion), sweep in zip(axes.T, sweeps, strict=True):
        finite = np.isfinite(sweep.holonomic)
        x = sweep.product[finite]
        drift.plot(x, sweep.holonomic[finite], color=BLUE, label="largest $|C^H|$ [m]")
        drift.plot(x, sweep.nonholonomic[finite], **dashed, label="$|C^N|$ [m/s]")
        drift.set_title(f"{sweep.method}, dt = {sweep.dt:g} s")
        motion.plot(x, sweep.error[finite], color=BLUE, label="q and p")
        motion.plot(x, sweep.multipliers[finite], **dashed, label=r"$\lambda$")
        motion.axhline(
            sweep.without["q and p"], color=GREY, linewidth=0.7, label="q and p of nullspace"
        )
        limit = float(_core.stable_step(sweep.method, np.array([-1.0 + 0.0j]))[0])
        for each in (drift, motion):
            each.set(xscale="log", yscale="log", xlim=(sweep.product[0], sweep.product[-1]))
            if math.isfinite(limit):
                each.axvline(limit, color=BLACK, linewidth=0.7, linestyle=":")
        motion.set_xlabel(r"$\alpha\,$dt = $\beta\,$dt")
    axes[0, 0].set_ylabel("drift")
    axes[1, 0].set_ylabel("largest error along the run")
    for each in axes[:, 0]:
        each.legend()
    return figure
