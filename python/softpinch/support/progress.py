"""How far a long computation is, on the screen: with rich, where that is installed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeAlias

from . import checks

# Takes how many of the runs are done, and how many there are.
Report: TypeAlias = Callable[[int, int], object]


def _silent(done: int, total: int) -> None:
    """Says nothing."""


@contextmanager
def reporting(progress: bool | Report, what: str) -> Iterator[Report]:
    """A function to call with (done, total).

    Args:
        progress: True draws a bar with rate and time left, where stderr is a terminal and rich is
            installed; False nothing. Or the function itself.
        what: Stands before the bar.

    Raises:
        TypeError: `progress` is neither.
    """
    if callable(progress):
        yield progress
        return
    if not isinstance(progress, bool):
        raise TypeError(f"progress = {checks.shown(progress)}: must be True, False or a function")
    if not progress or sys.stderr is None or not sys.stderr.isatty():
        yield _silent
        return
    try:
        from rich import progress as bars
        from rich.console import Console
    except ImportError:
        yield _silent
        return
    columns = (
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TextColumn("{task.fields[rate]}"),
        bars.TimeRemainingColumn(),
    )
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None, rate="")

        def report(done: int, total: int) -> None:
            speed = bar.tasks[0].finished_speed or bar.tasks[0].speed
            rate = f"{speed:,.0f} runs/s" if speed else ""
            bar.update(task, completed=done, total=total, rate=rate)

        yield report
