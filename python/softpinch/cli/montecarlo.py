"""`softpinch montecarlo`: computes a study from a file, and reports it."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from .. import _core, plot
from ..montecarlo import compute
from ..store.files import MANIFEST, PARTS
from ..store.study import Study
from ..study import Capsule, Ensemble, Results, sensitivity, study_file
from ..study.compute import Computation
from ..study.rows import HOLDS, missing
from ..study.sampling import SAMPLERS
from ..study.spec import SUMMARIES
from ..support import Table, checks, require, save_csv, save_npz
from ..support.files import FORMATS
from .options import Dt, Format, Formulation, Method, Out, Set, Threads, Tolerance, separated
from .shell import ENDED_EARLY, INTERRUPTED, changed_study, one_line_errors

_SUMMARY = (
    *("name", "unit", "runs", "mean", "low (95 %)", "high (95 %)"),
    *("std", "min", "5 %", "50 %", "95 %", "max"),
)
# Half width of a two-sided 95 % interval of a normal distribution, in standard errors.
_REACH = 1.959963984540054
# Figures, and files with a row for each run, have at most this many runs.
LARGEST = 100_000
# The meaning of holding, for each kind of contact.
_HOLDS = {
    "bilateral": "to hold is to complete, without a tip that pulls or needs more friction",
    "unilateral": "to hold is to complete, with both tips touching the object at the end",
}
# Event -> name of the figure with its share of the runs.
_MAPS = {"completed": "success_map", HOLDS: "success_map_holds"}
# Capsules are written for at most this many failed runs.
CAPSULES = 10


def montecarlo(
    study: Annotated[
        Path, typer.Argument(help="The study, a TOML file: scene, random numbers in it, settings.")
    ],
    runs: Annotated[int | None, typer.Option(help="Number of runs.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all draws.")] = None,
    set_: Set = None,
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
        how = {"dt": dt, "tolerance": tolerance, "method": method, "formulation": formulation}
        how |= {"runs": runs, "seed": seed, "sampler": sampler, "check_dt": check_dt}
        names = None if summaries is None else separated(summaries)
        spec = study_file.read(study, partial(changed_study, set_), **how, summaries=names)
        require("matplotlib", extra="plot", purpose="figures")
        begun = Study._opened(out).runs if (out / MANIFEST).exists() else 0
        started = time.perf_counter()
        with _executor(dask) as executor:
            result = compute(Computation(spec, threads=threads, executor=executor), out)
        seconds = time.perf_counter() - started
        if result.interrupted:
            typer.echo(f"{result.interruption}; run the same command again to continue", err=True)
        if result.runs:
            typer.echo("\n".join(lines(result, seconds, begun)))
            some = sample(result)
            files = save_tables(result, some, out) + save_figures(some, out, format)
            typer.echo(f"{out}: {', '.join((MANIFEST, PARTS, *(file.name for file in files)))}")
            if some.runs < result.runs:
                typer.echo(f"(the figures show {some.runs} runs, evenly spread over all)")
            if capsules := save_capsules(result.failures()[:CAPSULES], out):
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


def sample(study: Results) -> Ensemble:
    """The runs for the figures: all, or of a large study `LARGEST` evenly spaced ones."""
    numbers = study._computed.evenly_spaced(LARGEST)
    return Ensemble(study._spec, study._rows_of(numbers), requested=len(numbers))


def scalars(study: Results) -> list[str]:
    """Names of the summaries that have one number for each run."""
    entries = study._spec.schema.entries
    return [name for name in study._spec.summaries if not entries[name].shape]


def summary_table(study: Results) -> Table:
    """Probabilities of events and statistics of summaries, with intervals for independent draws."""
    rows: list[tuple[Any, ...]] = [(f"model: {study.model}", "", study.runs, *[""] * 9)]
    happened = dict.fromkeys(["completed", HOLDS, *study.counts()])
    for name in _core.VIOLATIONS:
        possible = not missing(name, study.scene, study._spec.shapes)
        if possible and study.probability(name).happened:
            happened[name] = None
    for name in happened:
        estimate = study.probability(name)
        numbers = (estimate.value, estimate.low, estimate.high)
        rows.append((f"probability of {name}", "1", estimate.runs, *numbers, *[""] * 6))
    entries = [study._spec.schema.entries[name] for name in study._spec.summaries]
    for name, unit in (column for entry in entries for column in entry.columns.items()):
        mean = study.mean(name)
        if not mean.runs:
            rows.append((name, unit, 0, *[""] * 9))
            continue
        reach = _REACH * mean.error
        interval = (mean.value, mean.value - reach, mean.value + reach)
        order = study.quantile(name, [0.05, 0.5, 0.95]).tolist()
        spread = (mean.spread, mean.least, *order, mean.greatest)
        rows.append((name, unit, mean.runs, *interval, *spread))
    return Table(columns=_SUMMARY, rows=tuple(rows))


def save_tables(study: Results, some: Ensemble, out: Path) -> list[Path]:
    """Writes summary.csv and, if `some` has all runs, runs.csv and ensemble.npz."""
    files = [out / "summary.csv", out / "runs.csv", out / "ensemble.npz"]
    summary_table(study).save(files[0])
    if some.runs < study.runs:
        for file in files[1:]:
            file.unlink(missing_ok=True)
        return files[:1]
    columns = some._spec.schema.split(some.to_dict())
    header = [n if c.unit in ("", "1") else f"{n} [{c.unit}]" for n, c in columns.items()]
    numbers = (column.values.tolist() for column in columns.values())
    save_csv(files[1], header, zip(*numbers, strict=True))
    # NumPy pickles arrays of objects, and does not load pickles by default.
    arrays = {**some.to_dict(), "message": some.message.astype(str)}
    save_npz(files[2], arrays, some.provenance())
    return files


def save_capsules(capsules: Sequence[Capsule], out: Path) -> list[Path]:
    """Writes capsules of runs, which `softpinch run` replays."""
    files = []
    for capsule in capsules:
        files.append(out / "failures" / f"{capsule.run}.toml")
        files[-1].parent.mkdir(exist_ok=True)
        files[-1].write_text(capsule.to_toml(), encoding="utf-8")
    return files


def save_figures(ensemble: Results, out: Path, format: str) -> list[Path]:
    """Writes a histogram of each scalar summary, and figures about failures and importance."""
    names = ["failure_times", *_MAPS.values(), *(f"histogram_{name}" for name in _core.SUMMARIES)]
    names += [f"importance_{name}" for name in (*_MAPS, *_core.SUMMARIES)]
    # Nobody shall take figures of an earlier study for this study's.
    for name in names:
        for suffix in FORMATS:
            (out / f"{name}.{suffix}").unlink(missing_ok=True)
    return [plot.save(figure, out / f"{name}.{format}") for name, figure in _figures(ensemble)]


def _figures(ensemble: Results) -> Iterator[tuple[str, Any]]:
    for name in scalars(ensemble):
        yield f"histogram_{name}", plot.histogram(ensemble, name)
    yield "failure_times", plot.failure_times(ensemble)
    if not ensemble.parameters:
        return
    for what, name in _MAPS.items():
        if not 0.0 < float(ensemble.probability(what)) < 1.0:
            continue
        found = sensitivity(ensemble, what)
        yield f"importance_{what}", plot.importance(ensemble, what, found)
        if len(found) > 1:
            x, y, *_ = found
            yield name, plot.success_map(ensemble, x, y, what)
    for name in scalars(ensemble)[:1]:
        yield f"importance_{name}", plot.importance(ensemble, name)


def lines(study: Results, seconds: float, earlier: int = 0) -> list[str]:
    """Lines about a study, whose new runs took `seconds`; `earlier` ones were there before."""
    counts = ", ".join(f"{count} {name}" for name, count in study.counts().items())
    new = study.runs - earlier
    before = f", {earlier} of them before," if earlier else ""
    # Points of the other samplers are not independent.
    as_if = "" if study.sampler == "random" else "as if drawn independently"
    behind = f", {as_if}" if as_if else ""
    result = [
        f"{study.runs} runs{before} in {seconds:.2f} s ({new / max(seconds, 1e-9):,.0f} "
        f"runs/s): {counts}",
        f"probability of completing: {study.probability('completed')}{behind}",
        f"probability of holding: {study.probability(HOLDS)}{', likewise' if as_if else ''}",
        f"(both are of {study.model}; {_HOLDS[study.scene.contact]})",
    ]
    found = scalars(study)
    if not found:
        return result
    width = max(map(len, found))
    header = f"{'':{width}}  {'mean ± standard error':<26} {'5 %':>11} {'95 %':>11}"
    result.append(f"{header}  (errors {as_if})" if as_if else header)
    for name in found:
        mean = study.mean(name)
        if not mean.runs:
            result.append(f"{name:{width}}  finite in no run")
            continue
        low, high = study.quantile(name, [0.05, 0.95])
        shown = f"{mean.value:.6g} ± {mean.error:.2g} {study._spec.schema.entries[name].unit}"
        few = "" if mean.runs == study.runs else f"  ({mean.runs} runs)"
        result.append(f"{name:{width}}  {shown:<26} {low:>11.4g} {high:>11.4g}{few}")
    for name, each in (study.discretisation or {}).items():
        if np.ndim(each.bias) == 0:
            what = f"the probability of {name}" if name in _MAPS else name
            bias = f"{each.bias:.2g} ± {each.bias_error:.1g}"
            left = f"(sampling leaves {each.sampling_error:.2g}{behind})"
            result.append(f"the step puts {what} off by {bias} {left}")
    return result
