"""`softpinch work-precision` and `softpinch advise`: error against run time, and the best pair."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from .. import _core
from ..accuracy.measurements import WHERE, Measurement, WorkPrecision
from ..run.options import some_names
from ..support import checks
from ..support.extras import require
from ..support.files import FORMATS
from .options import Alpha, Beta, Format, Out, SceneFile, Set, Steps, separated
from .shell import ENDED_EARLY, gains, ladder, one_line_errors, read_scene

_LEVELS = (1e-3, 1e-6, 1e-9)


def work_precision(
    scene: SceneFile,
    set_: Set = None,
    formulations: Annotated[
        str | None,
        typer.Option(
            help="How the constraints are kept, with commas; all that the scene's contact allows "
            "if left out."
        ),
    ] = None,
    methods: Annotated[str, typer.Option(help="How time is stepped, with commas.")] = ",".join(
        _core.METHODS
    ),
    dt: Steps = None,
    alpha: Alpha = None,
    beta: Beta = None,
    longest: Annotated[
        float, typer.Option(help="Leave out settings that would take longer, s.")
    ] = 2.0,
    where: Annotated[
        str, typer.Option(help="The error: the largest along the run, or that at the end.")
    ] = "along",
    out: Out = Path("work_precision"),
    format: Format = "png",
) -> None:
    """Measure error and run time of each formulation with each method on a scene.

    Writes work_precision.csv and a figure; prints the quickest settings with errors below 1e-3,
    1e-6 and 1e-9.

    Exit code: 0 done, 1 the reference could not be computed, 2 bad input, 130 Ctrl-C.
    """
    with one_line_errors():
        checks.choice("--format", format, FORMATS)
        checks.choice("--where", where, WHERE)
        kept = None
        if formulations is not None:
            kept = some_names("formulations", separated(formulations), _core.FORMULATIONS)
        stepped = some_names("methods", separated(methods), _core.METHODS)
        stabilization = gains(*(kept or _core.FORMULATIONS), alpha=alpha, beta=beta)
        described = read_scene(scene, set_)
        steps = None if dt is None else ladder(dt)
        require("matplotlib", extra="plot", purpose="figures")
        require("scipy", extra="study", purpose="the reference")
        from .. import plot
        from ..accuracy import precision

        out.mkdir(parents=True, exist_ok=True)
        try:
            found = precision.work_precision(
                described,
                formulations=kept,
                methods=stepped,
                dt=steps,
                stabilization=stabilization,
                longest=longest,
            )
        except RuntimeError as reason:
            typer.echo(f"no reference: {reason}", err=True)
            raise typer.Exit(ENDED_EARLY) from None
        for line in lines(found, where):
            typer.echo(line)
        table = found.save(out / "work_precision.csv")
        figure = plot.save(
            plot.work_precision(found, where=where), out / f"work_precision.{format}"
        )
        typer.echo(f"{out}: {table.name}, {figure.name}")


def lines(found: WorkPrecision, where: str = "along") -> Iterator[str]:
    """Lines that summarise measurements, for the screen and for reports."""
    own = ", ".join(f"{name} {size:.0e}" for name, size in found.floor.items())
    yield f"reference: {found.reference}; its own error: {own}"
    place = "along the run" if where == "along" else "at the end"
    for level in _LEVELS:
        yield f"error {place} below {level:.0e}, the quickest first:"
        best = found.cheapest(level, where)
        yield from (f"  {_line(row, where)}" for row in best)
        if not best:
            yield "  none"
    if where == "end" and found.settled():
        yield found.settled()
    failed = [row for row in found.rows if row.status not in ("completed", "not_run")]
    for row in failed:
        yield f"failed: {row.solver}, {row.setting} = {row.value:.3g}: {row.status}"
    yield from (f"left out: {reason}" for reason in found.skipped)


def _line(row: Measurement, where: str) -> str:
    size, order = row.along, ""
    if where == "end":
        size, order = row.error, f", error along the run {row.along:.1e}"
    elif np.isfinite(row.order):
        order = f", order {row.order:.1f}"
        if row.order > row.expected_order + 1.0:
            order += f", above the method's {row.expected_order} after a step too long for it"
    work = f", {row.evaluations} evaluations" if row.evaluations >= 0 else ""
    return (
        f"{row.solver:28s} {row.setting:>9s} {row.value:8.2e}  error {size:.1e}"
        f"  {1e3 * row.time:9.4f} ms{work}{order}"
    )


def advise(
    scene: SceneFile,
    set_: Set = None,
    tolerance: Annotated[
        float, typer.Option(help="The largest error of q, p and lambda along the run.")
    ] = 1e-6,
    alpha: Alpha = None,
    beta: Beta = None,
    budget: Annotated[float, typer.Option(help="Time for the search, s.")] = 2.0,
) -> None:
    """Find the quickest formulation, method and step whose error on a scene is below a tolerance.

    Equal steps (dt) and adaptive steps (tolerance) are tried alike, within the budget.

    Exit code: 0 found, 1 none meets the tolerance, 2 bad input, 130 Ctrl-C.
    """
    with one_line_errors():
        stabilization = gains(*_core.FORMULATIONS, alpha=alpha, beta=beta)
        described = read_scene(scene, set_)
        from ..accuracy import advisor

        found = advisor.advise(described, tolerance, stabilization=stabilization, budget=budget)
        typer.echo(found.message)
        for trial in found.trials:
            pair = f"{trial.formulation} {trial.method}"
            if trial.note:
                typer.echo(f"  {pair:28s} {trial.note}")
                continue
            where = "whole scene" if trial.whole else "its beginning"
            typer.echo(
                f"  {pair:28s} {trial.setting:20s} error {trial.error:.1e}"
                f"  {1e3 * trial.time:9.4f} ms  ({where})"
            )
    if not found.met:
        raise typer.Exit(ENDED_EARLY)
