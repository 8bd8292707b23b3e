"""`softpinch montecarlo`: computes a study from a file, and writes tables and figures."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from ..montecarlo import compute
from ..store.files import MANIFEST, PARTS
from ..store.study import Study
from ..study import study_file
from ..study.compute import Computation
from ..study.sampling import SAMPLERS
from ..study.spec import SUMMARIES
from ..support import checks
from ..support.extras import require
from ..support.files import FORMATS
from .options import Dt, Format, Formulation, Method, Out, Threads, Tolerance, separated
from .shell import ENDED_EARLY, INTERRUPTED, one_line_errors


def montecarlo(
    study: Annotated[
        Path, typer.Argument(help="The study, a TOML file: scene, random numbers in it, settings.")
    ],
    runs: Annotated[int | None, typer.Option(help="Number of runs.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all draws.")] = None,
    out: Out = Path("study"),
    dt: Dt = None,
    tolerance: Tolerance = None,
    method: Method = None,
    formulation: Formulation = None,
    threads: Threads = None,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Address of a Dask scheduler whose workers compute the runs."
        ),
    ] = None,
    sampler: Annotated[
        str | None, typer.Option(metavar="|".join(SAMPLERS), help="The sampler.")
    ] = None,
    summaries: Annotated[
        str | None,
        typer.Option(help=f"Summaries to compute, out of {', '.join(SUMMARIES)}, with commas."),
    ] = None,
    check_dt: Annotated[
        bool | None,
        typer.Option(
            "--check-dt/--no-check-dt", help="Compute some runs again with half the step."
        ),
    ] = None,
    format: Format = "png",
) -> None:
    """Simulate a scene many times with random parameters: how likely does the grasp hold?

    Options replace the settings of the file. The output directory keeps the runs as Parquet files.
    If it already has this study, only missing runs are computed: repeat the command after Ctrl-C
    or a crash, or with more --runs. manifest.toml has all settings and is itself a study file.

    Also writes summary.csv and figures, up to 10 failed runs as capsules for `softpinch run`, and,
    for at most 100000 runs, runs.csv and ensemble.npz.

    Exit code: 0 done, 1 workers lost runs, 2 bad input, 130 Ctrl-C (completed runs are kept).
    """
    with one_line_errors():
        checks.choice("--format", format, FORMATS)
        spec = study_file.read(
            study,
            runs=runs,
            seed=seed,
            dt=dt,
            tolerance=tolerance,
            method=method,
            formulation=formulation,
            sampler=sampler,
            summaries=None if summaries is None else separated(summaries),
            check_dt=check_dt,
        )
        require("matplotlib", extra="plot", purpose="figures")
        begun = Study._opened(out).runs if (out / MANIFEST).exists() else 0
        started = time.perf_counter()
        with _executor(dask) as executor:
            result = compute(Computation(spec, threads=threads, executor=executor), out)
        seconds = time.perf_counter() - started
        if result.interrupted:
            typer.echo(f"{result.interruption}; run the same command again to continue", err=True)
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
                typer.echo(f"(the figures show {some.runs} runs, evenly spread over all)")
            capsules = report.save_capsules(result, out)
            if capsules:
                typer.echo(f"to repeat the first failures: softpinch run {capsules[0]}, ...")
    if result.interrupted:
        raise typer.Exit(INTERRUPTED)
    if result.lost:
        raise typer.Exit(ENDED_EARLY)


@contextmanager
def _executor(dask: str | None) -> Iterator[Any]:
    """Connects to the Dask scheduler at this address, and yields its executor; None without one."""
    if dask is None:
        yield None
        return
    distributed = require("dask.distributed", extra="dask", purpose="--dask")
    with distributed.Client(dask) as client:
        if not client.nthreads():
            typer.echo(f"{dask} has no workers yet: waiting for them", err=True)
        yield client.get_executor()
