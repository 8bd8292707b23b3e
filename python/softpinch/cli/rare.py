"""`softpinch rare`: the probability of a rare event, from a study file."""

import os
from pathlib import Path
from typing import Annotated

import typer

from .. import plot
from ..rare import rare_event
from ..run.options import Options, in_place
from ..study import study_file
from ..study.spec import RUN_OPTIONS
from ..support import checks, require, toml
from ..support.files import FORMATS
from .montecarlo import CAPSULES, save_capsules
from .options import Dt, Format, Out, Set, Threads
from .shell import INTERRUPTED, changed_study, one_line_errors

_SETTINGS = ("event", "runs", "method")


def rare(
    study: Annotated[
        Path, typer.Argument(help="The study, a TOML file: scene, random numbers, event.")
    ],
    runs: Annotated[int | None, typer.Option(help="The largest number of runs.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all random numbers.")] = None,
    method: Annotated[
        str | None, typer.Option(metavar="auto|subset|splitting|importance", help="The method.")
    ] = None,
    set_: Set = None,
    out: Out = Path("rare"),
    store: Annotated[
        Path | None, typer.Option(help="A folder for the runs; a repeated command continues there.")
    ] = None,
    dt: Dt = None,
    threads: Threads = None,
    format: Format = "png",
) -> None:
    """Estimate how rarely something happens: by default, that the object is lost.

    The table [rare] of the study file has the event, such as event = ["peak_rotation", ">", 0.3],
    and may have runs and method. Numbers of runs in [study] are those of plain runs. Writes a
    figure, and 10 runs with the event as capsules for `softpinch run`.

    Exit code: 0 done, 2 bad input, 130 Ctrl-C (finished levels are kept).
    """
    with one_line_errors():
        checks.choice("--format", format, FORMATS)
        require("matplotlib", extra="plot", purpose="figures")
        data = toml.read(checks.path("study", study))
        scene, vary, settings = study_file.parse(data, study)
        scene = changed_study(set_, scene, vary)
        with study_file.naming(study):
            own = data.get("rare", {})
            checks.refuse_unknown("[rare]", own, _SETTINGS, "")
            if isinstance(own.get("event"), list):
                own["event"] = tuple(own["event"])
            how = {name: settings[name] for name in RUN_OPTIONS if name in settings}
            options = Options.from_dict(how | in_place(dt=dt))
            numerics = options.numerics() | {"summaries_after": options.summaries_after}
        there = next(each for each in (out, *out.absolute().parents) if each.exists())
        if not (there.is_dir() and os.access(there, os.W_OK)):
            raise ValueError(f"--out {out}: {there} is no folder that can be written")
        integrator = numerics.pop("method")
        seed = settings.get("seed", 0) if seed is None else seed
        own |= in_place(runs=runs, method=method, store=store) | {"seed": seed, "threads": threads}
        found = rare_event(scene, vary, integrator=integrator, **own, **numerics)
        typer.echo(
            f"probability {found}, cov {found.cov:.3g}, as {found.plain_runs:.3g} plain runs"
        )
        for k, level in enumerate(found.levels, 1):
            typer.echo(f"level {k}: {level.probability:.4g} at a distance of {level.threshold:.4g}")
        for text in found.warnings:
            typer.echo(f"warning: {text}", err=True)
        for name, share in list(found.importance.items())[:5]:
            typer.echo(f"{name}: {100.0 * share:.0f} % of the way to the event")
        for path, value in found.design_point.items() if found.events.runs else ():
            typer.echo(f"design point: {path} = {value}")
        out.mkdir(parents=True, exist_ok=True)
        plot.save(plot.rare_event(found), out / f"rare.{format}")
        save_capsules(found.failures()[-CAPSULES:], out)
    if found.interrupted:
        raise typer.Exit(INTERRUPTED)
