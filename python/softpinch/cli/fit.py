"""`softpinch fit`: fits numbers of a scene to a measured motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..fitting import fit_file
from ..fitting.problem import LOSSES
from ..fitting.search import fit as fit_numbers
from ..support import checks
from ..support.extras import require
from ..support.files import FORMATS
from .options import Dt, Format, Formulation, Method, Out, Tolerance
from .shell import ENDED_EARLY, one_line_errors


def fit(
    study: Annotated[
        Path, typer.Argument(help="A TOML file: scene, bounds of the numbers, settings.")
    ],
    data: Annotated[
        Path, typer.Argument(help="The measurements, a CSV file: t [s] and columns of observables.")
    ],
    out: Out = Path("fit"),
    dt: Dt = None,
    tolerance: Tolerance = None,
    method: Method = None,
    formulation: Formulation = None,
    loss: Annotated[
        str | None,
        typer.Option(metavar="|".join(LOSSES), help="soft_l1 limits the influence of outliers."),
    ] = None,
    multistart: Annotated[int | None, typer.Option(help="Number of further starts.")] = None,
    profile: Annotated[
        bool, typer.Option("--profile", help="Also print intervals of the profile likelihood.")
    ] = False,
    format: Format = "png",
) -> None:
    """Find numbers of a scene, such as Young's modulus, from a measured motion.

    Options replace the settings of the file. Prints each number with its standard error and 95 %
    interval, and says which combinations the data do not determine. Writes fit.json, fit.csv, the
    figure and scene.toml, the scene with the numbers put in, for softpinch run.

    Exit code: 0 done, 1 the search did not converge, 2 bad input, 130 Ctrl-C.
    """
    with one_line_errors():
        checks.choice("--format", format, FORMATS)
        scene, observables, settings = fit_file.read(
            study,
            dt=dt,
            tolerance=tolerance,
            method=method,
            formulation=formulation,
            loss=loss,
            multistart=multistart,
        )
        times, measured = fit_file.read_data(data, observables)
        require("matplotlib", extra="plot", purpose="figures")
        require("tomli_w", extra="cli", purpose="writing TOML")
        found = fit_numbers(scene, times, measured, **settings)
        for line in (*found.lines(), *found.messages):
            typer.echo(line)
        if profile:
            for path in found.values:
                low, high = found.profile(path).interval
                typer.echo(f"{path}, 95 % by its profile: {low:.6g} to {high:.6g}")
        from .. import plot

        out.mkdir(parents=True, exist_ok=True)
        files = [found.save(out / "fit.json"), found.save(out / "fit.csv")]
        files.append(plot.save(plot.fit(found), out / f"fit.{format}"))
        files.append(out / "scene.toml")
        files[-1].write_text(found.scene.to_toml(), encoding="utf-8")
        typer.echo(f"{out}: {', '.join(file.name for file in files)}")
    if not found.converged:
        raise typer.Exit(ENDED_EARLY)
