"""`softpinch montecarlo`: a study from a file to tables and figures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from .. import _core
from ..montecarlo import monte_carlo
from ..store.files import MANIFEST, PARTS
from ..store.study import Study
from ..study.sampling import SAMPLERS
from ..study.setup import SUMMARIES
from ..study.study_file import StudyFile
from ..support import checks
from ..support.extras import require
from ..support.formats import FORMATS
from .shell import ENDED_EARLY, INTERRUPTED, one_line_errors


def montecarlo(
    study: Annotated[
        Path, typer.Argument(help="The study, a TOML file: scene, what scatters in it, settings.")
    ],
    runs: Annotated[int | None, typer.Option(help="How many runs.")] = None,
    seed: Annotated[int | None, typer.Option(help="Of everything that is drawn.")] = None,
    out: Annotated[
        Path, typer.Option(help="The directory for tables and figures, made if needed.")
    ] = Path("study"),
    dt: Annotated[float | None, typer.Option(help="The longest step, s.")] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help=f"Instead of --dt ({', '.join(_core.ADAPTIVE_METHODS)})."),
    ] = None,
    method: Annotated[
        str | None, typer.Option(metavar="|".join(_core.METHODS), help="How time is stepped.")
    ] = None,
    formulation: Annotated[
        str | None,
        typer.Option(metavar="|".join(_core.FORMULATIONS), help="How the constraints are kept."),
    ] = None,
    threads: Annotated[int | None, typer.Option(help="As many as there are, if left out.")] = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Of a Dask scheduler, whose workers compute the runs."
        ),
    ] = None,
    sampler: Annotated[
        str | None, typer.Option(metavar="|".join(SAMPLERS), help="How numbers are drawn.")
    ] = None,
    summaries: Annotated[
        str | None,
        typer.Option(help=f"What to compute: names out of {', '.join(SUMMARIES)}, with commas."),
    ] = None,
    check_dt: Annotated[
        bool | None,
        typer.Option(
            "--check-dt/--no-check-dt", help="Compute some runs again with half the step."
        ),
    ] = None,
    format: Annotated[
        str, typer.Option(metavar="|".join(FORMATS), help="What the figures are saved as.")
    ] = "png",
) -> None:
    """Run a scene many times with scattered numbers: how likely does it hold, and what matters?

    Options take the place of what the file says. The runs are kept in the directory as Parquet,
    and a study that is there already is gone on with: after Ctrl-C or worse, or with more --runs.
    What was run, in full, is in its manifest.toml, which is a study file itself. Leaves
    summary.csv and the figures too, up to 10 failures as capsules for `softpinch run`, and runs.csv
    and ensemble.npz of up to 100000 runs.

    Exit code: 0 done, 1 workers lost runs, 2 bad input, 130 Ctrl-C, which keeps all runs done so
    far.
    """
    with one_line_errors():
        checks.choice("--format", format, FORMATS)
        names = None
        if summaries is not None:
            names = tuple(name for name in summaries.replace(" ", "").split(",") if name)
        asked = StudyFile.read(study).changed(
            runs=runs,
            seed=seed,
            dt=dt,
            tolerance=tolerance,
            method=method,
            formulation=formulation,
            sampler=sampler,
            summaries=names,
            check_dt=check_dt,
        )
        require("matplotlib", extra="plot", purpose="figures")
        begun = Study.open(out).runs if (out / MANIFEST).exists() else 0
        started = time.perf_counter()
        with _executor(dask) as executor:
            result = monte_carlo(**asked.arguments(), threads=threads, executor=executor, store=out)
        seconds = time.perf_counter() - started
        if result.interrupted:
            typer.echo(f"{result.interruption}; the same command goes on with them", err=True)
        if result.runs:
            from . import study_report as report

            for line in report.lines(result, seconds, begun):
                typer.echo(line)
            some = report.sample(result)
            files = [
                *report.save_tables(result, some, out),
                *report.save_figures(some, out, format),
            ]
            typer.echo(f"{out}: {', '.join((MANIFEST, PARTS, *(file.name for file in files)))}")
            if some.runs < result.runs:
                typer.echo(f"(figures are of {some.runs} runs, evenly among all)")
            capsules = report.save_capsules(result, out)
            if capsules:
                typer.echo(f"the first failures again: softpinch run {capsules[0]}, ...")
    if result.interrupted:
        raise typer.Exit(INTERRUPTED)
    if result.lost:
        raise typer.Exit(ENDED_EARLY)


@contextmanager
def _executor(dask: str | None) -> Iterator[Any]:
    """That of a Dask cluster, if one is named."""
    if dask is None:
        yield None
        return
    distributed = require("dask.distributed", extra="dask", purpose="--dask")
    with distributed.Client(dask) as client:
        if not client.nthreads():
            typer.echo(f"{dask} has no workers yet: waiting for them", err=True)
        yield client.get_executor()
