"""The figures of the paper: snapshots, motion, residuals and disturbances (4 to 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..run import measures as measures
from ..run.contact import ContactMode
from ..run.run import Run
from ..scene import outline
from ..support.checks import array, instance, integer, shown
from . import contact_bands, drawing
from .panels import (
    ANGLES,
    CONSTRAINTS,
    LETTERS,
    POSE,
    ROUND_OFF,
    finer,
    name,
    number_operations,
    residual,
    time_axis,
)
from .style import (
    BLACK,
    COLUMN,
    LINES,
    PAGE,
    PALE,
    TARGET,
    least_range,
    legend_above,
    line,
    panels_or_given,
    styled,
    tag,
    whole_decades,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Floats = NDArray[np.float64]

# The orders of magnitude of the residuals that the paper states for its Fig. 6, m and m/s.
_PAPER_ORDERS = (1e-8, 1e-8, 1e-6, 1e-6)
# The residual axis extends at least to this value, which is above the paper's orders of magnitude.
_RESIDUAL_TOP = 5e-4


def snapshots(
    run: Run,
    times: Sequence[float],
    titles: Sequence[str] = (),
    columns: int = 3,
    ax: Axes | None = None,
) -> Figure:
    """Hand and object at some instants, in mm, the tips drawn deformed (the paper's Fig. 4).

    In unilateral contact the colour of a tip is its mode; at the instant of a change, as at a
    switch of the targets, it is the mode before.

    Args:
        run: A run with "state" recorded; each instant shows the closest recorded row.
        times: The instants, s.
        titles: A title for each instant; by default the time.
        columns: Number of panels side by side.
        ax: The axes to draw a single instant on; None makes a figure.

    Raises:
        ValueError: There is no instant, the numbers of titles and instants differ, `columns` is
            less than 1, or `ax` is given with several instants.
        TypeError: An argument is of the wrong kind.
        NotRecordedError: The state was not recorded.
        ImportError: matplotlib is not installed.
    """
    instance("run", run, Run)
    instants = array("times", times, ("k",)).tolist()
    columns = min(integer("columns", columns, 1), len(instants))
    if isinstance(titles, str) or not isinstance(titles, Sequence):
        raise TypeError(f"titles = {shown(titles)}: must be texts, one for each time")
    titles = titles or [f"$t$ = {time:g} s" for time in instants]
    for title in titles:
        instance("titles", title, str, "texts, one for each time")
    if len(instants) != len(titles):
        raise ValueError(f"{len(titles)} titles for {len(instants)} times: must be one for each")
    found = [int(np.argmin(np.abs(run.t - time))) for time in instants]
    q = run.q[found]
    skins = [(drawing.SKIN, drawing.SKIN)] * len(instants)
    present: set[ContactMode] = set()
    if run.scene.contact == "unilateral":
        kept = [(ContactMode(a), ContactMode(b)) for a, b in measures.contact_modes(run)[found]]
        skins = [(contact_bands.COLORS[a], contact_bands.COLORS[b]) for a, b in kept]
        present = {mode for pair in kept for mode in pair}
    rows = -(-len(instants) // columns)
    left, right, bottom, top = outline.extent(run.scene, q)
    margin = 0.04 * (right - left)
    across, high = right - left + 2 * margin, top - bottom + 2 * margin
    width = PAGE if columns > 1 else COLUMN
    # Panels have the aspect ratio of the drawing, but within limits, because a hand may have any
    # shape. The constants leave room for a line of title above each panel.
    shape = min(max(high / across, 0.2), 4.0)
    height = rows * (width / columns * 0.9 * shape + 0.22) + 0.4
    height += contact_bands.LEGEND if present else 0.0
    grid = panels_or_given(ax, rows, columns, width, height, sharex=True, sharey=True)
    with grid as (figure, axes):
        for k, each in enumerate(axes.flat):
            if k >= len(instants):
                each.set_visible(False)
                continue
            drawing.draw(each, run.scene, q[k], skins[k])
            each.set_aspect("equal")
            each.set_xlim(left - margin, right + margin)
            each.set_ylim(bottom - margin, top + margin)
            if len(instants) > 1:
                tag(each, LETTERS[k % len(LETTERS)], titles[k])
            else:
                each.set_title(titles[k], loc="left", pad=3.0)
        for each in axes[-1]:
            each.set_xlabel("$x$ [mm]")
        for each in axes[:, 0]:
            each.set_ylabel("$y$ [mm]")
        contact_bands.legend_of_panel(figure, ax, present)
        return figure


def motion(run: Run) -> Figure:
    """Finger angles with their targets, and the object's pose, over time (the paper's Fig. 5).

    Args:
        run: A run with "state" recorded.

    Raises:
        TypeError: `run` is not a Run.
        NotRecordedError: The state was not recorded.
        ImportError: matplotlib is not installed.
    """
    instance("run", run, Run)
    target = measures.target_angles(run)
    with styled():
        figure, axes, strips = contact_bands.panels_over_bands(
            {"": run}, 5, 1, COLUMN, 6.2, sharex=True
        )
        column = axes[:, 0].tolist()
        for k, (index, symbol, unit) in enumerate(ANGLES + POSE):
            each = column[k]
            line(each, run.t, run.q[:, index] * unit.per_si, color=BLACK, label="simulated")
            if index >= 3 and target is not None:
                line(each, run.t, target[:, index - 3] * unit.per_si, **TARGET, label="target")
            each.set_ylabel(name(symbol, unit))
            tag(each, LETTERS[k])
        legend_above(figure, column)
        number_operations(column[0], run)
        contact_bands.add_bands(figure, strips, run)
        time_axis(run, [*column, *strips])
        least_range(column)
        figure.align_ylabels(column)
        return figure


def residuals(run: Run) -> Figure:
    """The constraint residuals (9, 12) over time, on logarithmic axes (the paper's Fig. 6).

    Values below 1e-16 are round-off and are drawn at 1e-16. Dashed lines are the orders of
    magnitude that the paper states. In unilateral contact the residuals of constraints that do not
    act are left out: C^H of a free tip, C^N of a tip that does not stick.

    Args:
        run: A run with "residuals" recorded.

    Raises:
        TypeError: `run` is not a Run.
        NotRecordedError: The residuals were not recorded.
        ImportError: matplotlib is not installed.
    """
    instance("run", run, Run)
    with styled():
        figure, axes, strips = contact_bands.panels_over_bands(
            {"": run}, 4, 1, COLUMN, 5.2, sharex=True, sharey=True
        )
        column = axes[:, 0].tolist()
        for k, each in enumerate(column):
            residual(each, run, [k], color=LINES[k % 2]["color"])
            symbol, unit = CONSTRAINTS[k]
            each.set_ylabel(f"$|{symbol}|$ [{unit}]")
            tag(each, LETTERS[k])
            level = _PAPER_ORDERS[k]
            each.axhline(level, color=BLACK, linewidth=0.7, linestyle=(0, (4, 2)), zorder=1.0)
            each.annotate(
                f"paper: $10^{{{round(np.log10(level))}}}$",
                (0.995, level),
                xycoords=each.get_yaxis_transform(),
                xytext=(0.0, 1.5),
                textcoords="offset points",
                ha="right",
                va="bottom",
                fontsize=8.0,
            )
        whole_decades(column[0], labels=4)
        column[0].set_ylim(ROUND_OFF, max(_RESIDUAL_TOP, column[0].get_ylim()[1]))
        number_operations(column[0], run)
        contact_bands.add_bands(figure, strips, run)
        time_axis(run, [*column, *strips])
        return figure


def disturbances(runs: Mapping[str, Run], undisturbed: Mapping[str, Run] | None = None) -> Figure:
    """Changes of finger angles and object pose after disturbances (the paper's Fig. 7).

    Where torques were recorded, two rows more show their changes: of the torques of the PID, of the
    schedule or of a controller, or those that drive the fingers. A case without them has no line
    there.

    Time counts from the onset. Lasting forces have a column of their own, left of transient ones,
    because their effects are larger by one or two orders of magnitude.

    Args:
        runs: Name of each case -> run with "state" recorded.
        undisturbed: Name of each case -> run without the disturbance, which the plotted change is
            relative to. Cases without such a run show the change since the onset, which includes
            any motion that had not settled by then.

    Raises:
        ValueError: There is no run.
        TypeError: An argument is of the wrong kind.
        NotRecordedError: A state was not recorded, or the torques of a case were, but not those of
            its undisturbed run.
        ImportError: matplotlib is not installed.
    """
    twins = {} if undisturbed is None else undisturbed
    for field, given in (("runs", runs), ("undisturbed", twins)):
        instance(field, given, Mapping, "a dictionary of runs")
        for case, each in given.items():
            instance(f"{field}[{shown(case)}]", each, Run)
    if not runs:
        raise ValueError("runs is empty: must have a run")
    answers = {case: measures.response(each, twins.get(case)) for case, each in runs.items()}
    stays = [case for case, each in runs.items() if measures.lasting(each)]
    passes = [case for case in runs if case not in stays]
    groups = {"forces that stay": stays, "forces that pass": passes}
    groups = {title: group for title, group in groups.items() if group}
    styles = {case: LINES[k % len(LINES)] for k, case in enumerate(runs)}
    torques = [case for case, each in runs.items() if "torque" in each.record]
    rows = len(ANGLES + POSE) + (2 if torques else 0)
    width = PAGE if len(groups) > 1 else COLUMN
    most = max(({case: runs[case] for case in g} for g in groups.values()), key=contact_bands.count)
    with styled():
        figure, axes, strips = contact_bands.panels_over_bands(
            most, rows, len(groups), width, 1.28 * rows, sharex="col"
        )
        for column, (title, group) in enumerate(groups.items()):
            for row, (index, symbol, unit) in enumerate(ANGLES + POSE):
                each = axes[row, column]
                peak = max(float(np.abs(answers[case][1][:, index]).max()) for case in group)
                fine = finer(unit, peak)
                for case in group:
                    t, change = answers[case]
                    values = change[:, index] * fine.per_si
                    line(each, t, values, **styles[case], label=f"({case})")
                each.axhline(0.0, color=PALE, linewidth=0.6, zorder=0.5)
                each.set_ylabel(name(symbol, fine, change=True))
                tag(each, LETTERS[len(axes) * column + row])
            for side, each in enumerate(axes[len(ANGLES + POSE) :, column]):
                for case in (case for case in group if case in torques):
                    values = measures.torque_response(runs[case], twins.get(case))[:, side]
                    line(each, answers[case][0], values, **styles[case], label=f"({case})")
                each.axhline(0.0, color=PALE, linewidth=0.6, zorder=0.5)
                each.set_ylabel(rf"$\Delta \tau_{side + 1}$ [N m]")
                tag(each, LETTERS[len(axes) * column + len(ANGLES + POSE) + side])
            cases = ", ".join(f"({case})" for case in group)
            axes[0, column].set_title(f"{title}: {cases}", pad=3.0)
            bottom = strips[column] if strips else axes[-1, column]
            bottom.set_xlabel("time from the onset [s]")
            until = max(measures.busy(*answers[case]) for case in group)
            axes[0, column].set_xlim(0.0, until or None)
            if strips:
                shown_runs = {f"({case})": runs[case] for case in group}
                onsets = {f"({case})": measures.onset(runs[case]) for case in group}
                contact_bands.draw_bands(bottom, shown_runs, onsets, room=contact_bands.count(most))
            least_range(axes[:, column])
            figure.align_ylabels(axes[:, column])
        legend_above(figure, list(axes[0]))
        if strips:
            contact_bands.legend_below(figure, contact_bands.occurring(runs))
        return figure
