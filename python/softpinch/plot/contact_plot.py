"""Figures of unilateral contact: gaps and slip of one run, and runs with several frictions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..run import measures as measures
from ..run.run import Run
from ..support.checks import instance, shown
from . import contact_bands
from .panels import (
    EVERYTHING,
    FINGERS,
    LETTERS,
    POSE,
    Floats,
    Rows,
    finer,
    gap,
    name,
    pressing,
    slip,
    time_axis,
)
from .style import (
    COLUMN,
    LINES,
    PAGE,
    PALE,
    least_range,
    legend_above,
    line,
    styled,
    tag,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Changes of mode that follow each other within this time, s, belong together.
_TOGETHER = 0.02
# The shortest window around such changes, s, and the room before and after them, as its share.
_WINDOW, _ROOM = 1e-3, (0.15, 0.35)


def contact(run: Run) -> Figure:
    """Gaps and slip of both tips, their pressing forces if recorded, and the modes as bands.

    The left column has the whole run, the right column the time around the instant with the most
    changes of mode. A run without a change has only the left column. C^H of (9) is the gap of a
    free tip, C^N of (12) the velocity of slip: that of the object's face over a tip that touches.

    Args:
        run: A run with unilateral contact and "residuals" recorded, best at every step.

    Raises:
        ValueError: The run has bilateral contact.
        TypeError: `run` is not a Run.
        NotRecordedError: The residuals were not recorded.
        ImportError: matplotlib is not installed.
    """
    instance("run", run, Run)
    if run.scene.contact != "unilateral":
        raise ValueError(
            f"run.scene.contact = {run.scene.contact!r}: must be 'unilateral'; tips in bilateral "
            "contact neither slip nor open"
        )
    draws = [gap, slip, *([pressing] if "multipliers" in run.record else [])]
    window = _busiest(run)
    views: list[tuple[Floats, Rows]] = [(run.t, EVERYTHING)]
    if window is not None:
        # Select a little more than is shown, so that lines reach the edges.
        start, begin, end = window
        since = run.t - start
        more = 0.2 * (end - begin)
        around = (since >= begin - more) & (since <= end + more)
        views.append((1e3 * since[around], around))
    with styled():
        figure, axes, strips = contact_bands.panels_over_bands(
            {"": run},
            len(draws),
            len(views),
            PAGE if window else COLUMN,
            1.35 * len(draws) + 0.5,
            sharex="col",
            sharey="row",
        )
        for column, (t, rows) in enumerate(views):
            for row, draw in enumerate(draws):
                draw(axes[row, column], run, t, rows)
        for row, each in enumerate(axes[:, 0]):
            tag(each, LETTERS[row])
            for side, handle in enumerate(each.get_lines()[:2]):
                handle.set_label(FINGERS[side])
        legend_above(figure, axes[:1, 0].tolist())
        contact_bands.draw_bands(strips[0], {"": run})
        time_axis(run, [*axes[:, 0], strips[0]])
        if window is not None:
            contact_bands.draw_bands(strips[1], {"": run}, since=start, per=1e3)
            for each in axes[:, 1]:
                each.set_ylabel("")
            strips[1].set_xlim(1e3 * begin, 1e3 * end)
            strips[1].set_xlabel(f"time from {start:.6g} s [ms]")
        least_range(axes[:, 0])
        contact_bands.legend_below(figure, contact_bands.occurring({"": run}))
        figure.align_ylabels(axes[:, 0])
        return figure


def _busiest(run: Run) -> tuple[float, float, float] | None:
    """The first of the most changes of mode that belong together, s, and a window around them.

    The begin and the end of the window are relative to it, s. None if no mode changes, or if the
    run ended at its start.
    """
    times = np.array([change.time for change in run.contact_changes])
    if not times.size or run.t[-1] <= run.t[0]:
        return None
    groups = np.split(times, np.flatnonzero(np.diff(times) > _TOGETHER) + 1)
    most = max(groups, key=len)
    last = float(most[-1] - most[0])
    length = max(last, _WINDOW)
    begin, end = -_ROOM[0] * length, last + _ROOM[1] * length
    start, inside = float(most[0]), (run.t[[0, -1]] - most[0]).tolist()
    return start, max(begin, inside[0]), min(end, inside[1])


def contact_models(columns: Mapping[str, Mapping[str, Run]]) -> Figure:
    """The object's motion in scenes with bilateral contact and with several frictions.

    Each column is a scene. Time and change of pose count from the onset of its first disturbance,
    or from the start of the run without one; a column with a disturbance ends when the pose stays.
    A cross marks the end of a run that ended early. Below are two bands for each run with
    unilateral contact: the modes of its right tip above those of its left tip.

    Args:
        columns: Name of each scene -> name of each contact -> run with "state" recorded. The names
            of the contacts are those of the lines, and of the bands.

    Raises:
        ValueError: There is no scene, or a scene without a run.
        TypeError: An argument is of the wrong kind.
        NotRecordedError: A state was not recorded.
        ImportError: matplotlib is not installed.
    """
    instance("columns", columns, Mapping, "a dictionary of dictionaries of runs")
    for title, runs in columns.items():
        instance(f"columns[{shown(title)}]", runs, Mapping, "a dictionary of runs")
        for label, run in runs.items():
            instance(f"columns[{shown(title)}][{shown(label)}]", run, Run)
        if not runs:
            raise ValueError(f"columns[{shown(title)}] is empty: must have a run")
    if not columns:
        raise ValueError("columns is empty: must have a scene")
    labels = list(dict.fromkeys(label for runs in columns.values() for label in runs))
    styles = {label: LINES[k % len(LINES)] for k, label in enumerate(labels)}
    leftmost, most = next(iter(columns.values())), max(columns.values(), key=contact_bands.count)
    with styled():
        figure, axes, strips = contact_bands.panels_over_bands(
            most, len(POSE), len(columns), PAGE, 4.2, sharex="col"
        )
        for k, (title, runs) in enumerate(columns.items()):
            onsets = {label: measures.onset(run) for label, run in runs.items()}
            changes = {label: measures.response(run) for label, run in runs.items()}
            for row, (index, symbol, unit) in enumerate(POSE):
                each = axes[row, k]
                unit = finer(unit, max(abs(c[:, index]).max() for _, c in changes.values()))
                for label, run in runs.items():
                    t, change = changes[label]
                    values = change[:, index] * unit.per_si
                    line(each, t, values, **styles[label], label=label)
                    if not run.success:
                        color = styles[label]["color"]
                        each.plot(t[-1], values[-1], marker="x", markersize=5.0, color=color)
                each.axhline(0.0, color=PALE, linewidth=0.6, zorder=0.5)
                each.set_ylabel(name(symbol, unit, change=True))
                tag(each, LETTERS[len(POSE) * k + row])
            axes[0, k].set_title(title, pad=3.0)
            bottom = strips[k] if strips else axes[-1, k]
            if strips:
                contact_bands.draw_bands(bottom, runs, onsets, room=contact_bands.count(most))
                # Names that are equal to those of the first column are not repeated.
                if k > 0 and list(contact_bands.unilateral(runs)) == list(
                    contact_bands.unilateral(leftmost)
                ):
                    bottom.tick_params(labelleft=False)
            disturbed = any(run.scene.disturbances for run in runs.values())
            last = max(measures.busy(*c) if disturbed else c[0][-1] for c in changes.values())
            bottom.set_xlim(0.0, float(last) or None)
            bottom.set_xlabel("time from the onset [s]" if disturbed else "time [s]")
            figure.align_ylabels(axes[:, k])
        least_range(axes.flat)
        legend_above(figure, list(axes[0]))
        if strips:
            contact_bands.legend_below(
                figure,
                sorted(
                    {mode for runs in columns.values() for mode in contact_bands.occurring(runs)}
                ),
            )
        return figure
