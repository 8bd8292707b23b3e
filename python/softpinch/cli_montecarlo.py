"""`softpinch montecarlo`: a study from a file to tables and figures."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from . import _core, _record
from ._extras import require
from ._shell import INTERRUPTED, one_line_errors
from ._setup import SUMMARIES
from .reproduce import FORMATS
from .sampling import SAMPLERS
from .study_file import StudyFile


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

    Options take the place of what the file says. Leaves runs.csv, summary.csv, ensemble.npz,
    study.toml (what was run, in full) and the figures.

    Exit code: 0 done, 2 bad input, 130 Ctrl-C, which keeps all runs done so far.
    """
    with one_line_errors():
        _record.choice("--format", format, FORMATS)
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
        out.mkdir(parents=True, exist_ok=True)
        # It cannot be written after the runs if not before.
        text = asked.to_toml()
        started = time.perf_counter()
        ensemble = asked.run(threads=threads)
        seconds = time.perf_counter() - started
        if ensemble.interrupted:
            text = f"# {ensemble.interruption}\n{text}"
            typer.echo(ensemble.interruption, err=True)
        if ensemble.runs:
            from . import _study_report as report

            for line in report.lines(ensemble, seconds):
                typer.echo(line)
            (out / "study.toml").write_text(text, encoding="utf-8")
            files = [out / "study.toml", *report.save_tables(ensemble, out)]
            files += report.save_figures(ensemble, out, format)
            typer.echo(f"{out}: {', '.join(file.name for file in files)}")
    if ensemble.interrupted:
        raise typer.Exit(INTERRUPTED)
