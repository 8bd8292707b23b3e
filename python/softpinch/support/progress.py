"""Progress of long computations, drawn with rich if it is installed."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TypeAlias

from . import checks

# A function of (runs done, runs in total).
Report: TypeAlias = Callable[[int, int], object]


@contextmanager
def reporting(
    progress: bool | Report, what: str | Callable[[], str], each: str = "runs"
) -> Iterator[Report]:
    """Yields a function of (done, total): the user's, or a bar on a terminal with rich, or none.

    The bar is called `what`; a function is asked again at each report.
    """
    if callable(progress):
        yield progress
        return
    checks.instance("progress", progress, bool, "True, False or a function")
    terminal = sys.stderr is not None and sys.stderr.isatty()
    if not (progress and terminal and find_spec("rich")):
        yield lambda done, total: None
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (
        bars.TextColumn("{task.description}"),
        bars.BarColumn(),
        bars.MofNCompleteColumn(),
        bars.TextColumn("{task.fields[rate]}"),
        bars.TimeRemainingColumn(),
    )
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None, rate="")

        def report(done: int, total: int) -> None:
            speed = bar.tasks[0].finished_speed or bar.tasks[0].speed
            rate = f"{speed:,.0f} {each}/s" if speed else ""
            title = what() if callable(what) else what
            bar.update(task, description=title, completed=done, total=total, rate=rate)

        yield report
