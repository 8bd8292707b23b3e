"""`softpinch stability`, `work-precision` and `advise`: steps, errors and run times of a scene."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from .. import _core, plot
from ..accuracy.advisor import advise as find_advice
from ..accuracy.measurements import WHERE, Measurement, WorkPrecision
from ..accuracy.precision import work_precision as measure_precision
from ..accuracy.stability import max_stable_dt
from ..accuracy.stability_axes import AXES
from ..accuracy.stability_maps import PAIRS, MapPlan, Pair, check_pairs
from ..scene.contact import formulations_of, require_formulations
from ..support import Floats, checks, reporting, require
from ..support.files import FORMATS
from .options import Alpha, Beta, Format, Out, SceneFile, Set, Threads, separated
from .shell import ENDED_EARLY, gains, one_line_errors, read_scene

_LEVELS = (1e-3, 1e-6, 1e-9)
Steps = Annotated[
    tuple[float, float, int] | None,
    typer.Option(metavar="LOW HIGH COUNT", help="The steps, by equal factors, s."),
]


def _ladder(dt: tuple[float, float, int] | None) -> Floats | None:
    """The steps of an option --dt LOW HIGH COUNT, spaced by equal factors (COUNT,), s."""
    if dt is None:
        return None
    low, high = checks.positive("--dt LOW", dt[0]), checks.positive("--dt HIGH", dt[1])
    count = checks.integer("--dt COUNT", dt[2], 2, 1000)
    if not low < high:
        raise ValueError(f"--dt HIGH = {high}: must be greater than LOW = {low}")
    return np.geomspace(low, high, count)


def stability(
    scene: SceneFile,
    set_: Set = None,
    axis: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help=f"Make a map along it: {', '.join(AXES)}, or a path such as grasped.mass. May be "
            "given several times.",
        ),
    ] = None,
    values: Annotated[
        str | None, typer.Option(help="Values of the only axis, with commas.")
    ] = None,
    dt: Steps = None,
    pairs: Annotated[
        str | None,
        typer.Option(
            help="Formulations and methods, as csm+rk4,nullspace+radau5; all that the "
            "scene's contact allows if left out."
        ),
    ] = None,
    alpha: Alpha = None,
    beta: Beta = None,
    max_steps: Annotated[
        int, typer.Option(help="Leave out the runs of a map that would take more.")
    ] = 200_000,
    threads: Threads = None,
    out: Out = Path("stability"),
    format: Format = "png",
) -> None:
    """Find the longest stable step of each formulation and method on a scene.

    Prints the step that theory predicts and the step that trial runs measure. For each --axis it
    also maps how runs end over a parameter and over step sizes, and writes stability_NAME.csv,
    stability_NAME.npz and a figure.

    Exit code: 0 done, 2 bad input, 130 Ctrl-C (maps completed before are kept).
    """
    with one_line_errors():
        checks.choice("--format", format, FORMATS)
        given = _pairs(pairs)
        stabilization = gains(*{pair[0] for pair in given or PAIRS}, alpha=alpha, beta=beta)
        described = read_scene(scene, set_)
        require_formulations("--pairs", [pair[0] for pair in given or ()], described)
        wanted = given or tuple(pair for pair in PAIRS if pair[0] in formulations_of(described))
        axes = list(dict.fromkeys(axis or ()))
        at, steps = _values(values, axes), _ladder(dt)
        if steps is not None and not axes:
            raise ValueError("--dt needs --axis: it sets the steps of a stability map")
        # Check all maps before the first run.
        settings = (at, steps, wanted, stabilization, max_steps, threads)
        plans = [MapPlan(described, name, *settings) for name in axes]
        if plans:
            require("matplotlib", extra="plot", purpose="figures")
            out.mkdir(parents=True, exist_ok=True)
        names = [f"{formulation} + {method}" for formulation, method in wanted]
        wide = max(map(len, names))
        typer.echo(f"{'longest step [s]':{wide}}  predicted   measured")
        longest = []
        with reporting(True, "longest steps") as report:
            for k, (formulation, method) in enumerate(wanted):
                report(k, len(wanted))
                pair = (method, formulation)
                longest.append(max_stable_dt(described, *pair, stabilization=stabilization))
        for name, step in zip(names, longest, strict=True):
            measured = "-" if step.measured is None else f"{step.measured:.4g}"
            typer.echo(f"{name:{wide}}  {step.predicted:9.4g}  {measured:>9}  {step.message}")
        for plan in plans:
            found = plan.run()
            typer.echo("\n".join(["", *found.summary()]))
            stem = out / f"stability_{found.axis.replace('.', '_')}"
            files = [found.save(stem.with_suffix(suffix)) for suffix in (".csv", ".npz")]
            files.append(plot.save(plot.stability_map(found), stem.with_suffix(f".{format}")))
            typer.echo(f"{out}: {', '.join(file.name for file in files)}")


def _pairs(text: str | None) -> tuple[Pair, ...] | None:
    if text is None:
        return None
    found: list[tuple[str, str]] = []
    for name in text.replace(" ", "").split(","):
        formulation, plus, method = name.partition("+")
        if not plus:
            raise ValueError(f"--pairs: {name!r} must be FORMULATION+METHOD, such as csm+rk4")
        found.append((formulation, method))
    return check_pairs(found)


def _values(text: str | None, axes: Sequence[str]) -> list[float] | None:
    if text is None:
        return None
    if len(axes) != 1:
        raise ValueError(f"--values needs exactly one --axis, not {len(axes)}")
    found = []
    for word in text.split(","):
        try:
            found.append(float(word))
        except ValueError:
            raise ValueError(f"--values: {word.strip()!r} must be a number") from None
    return found


def work_precision(
    scene: SceneFile,
    set_: Set = None,
    formulations: Annotated[
        str | None,
        typer.Option(
            help="Formulations, with commas; all that the scene's contact allows if left out."
        ),
    ] = None,
    methods: Annotated[str, typer.Option(help="Integration methods, with commas.")] = ",".join(
        _core.METHODS
    ),
    dt: Steps = None,
    alpha: Alpha = None,
    beta: Beta = None,
    longest: Annotated[
        float, typer.Option(help="Leave out settings that would take longer, s.")
    ] = 2.0,
    where: Annotated[
        str, typer.Option(help="The error: along (the largest along the run) or end.")
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
        kept = None if formulations is None else separated(formulations)
        stabilization = gains(*(kept or _core.FORMULATIONS), alpha=alpha, beta=beta)
        described = read_scene(scene, set_)
        steps = _ladder(dt)
        require("matplotlib", extra="plot", purpose="figures")
        require("scipy", extra="study", purpose="the reference")
        out.mkdir(parents=True, exist_ok=True)
        try:
            how: Any = {"formulations": kept, "methods": separated(methods), "longest": longest}
            found = measure_precision(described, dt=steps, stabilization=stabilization, **how)
        except RuntimeError as reason:
            typer.echo(f"no reference: {reason}", err=True)
            raise typer.Exit(ENDED_EARLY) from None
        typer.echo("\n".join(lines(found, where)))
        table = found.save(out / "work_precision.csv")
        drawn = plot.work_precision(found, where=where)
        figure = plot.save(drawn, out / f"work_precision.{format}")
        typer.echo(f"{out}: {table.name}, {figure.name}")


def lines(found: WorkPrecision, where: str = "along") -> Iterator[str]:
    """Lines that summarise measurements, for the screen and for reports."""
    own = ", ".join(f"{name} {size:.0e}" for name, size in found.floor.items())
    yield f"reference: {found.reference}; its own error: {own}"
    place = "along the run" if where == "along" else "at the end"
    for level in _LEVELS:
        yield f"error {place} below {level:.0e}, the quickest first:"
        best = found.cheapest(level, where)
        yield from (f"  {_line(row, where)}" for row in best) if best else ["  none"]
    if where == "end" and found.settled():
        yield found.settled()
    for row in found.rows:
        if row.status not in ("completed", "not_run"):
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
    setting = f"{row.solver:28s} {row.setting:>9s} {row.value:8.2e}"
    time = f"{1e3 * row.time:9.4f} ms"
    return f"{setting}  error {size:.1e}  {time}{work}{order}"


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
        found = find_advice(described, tolerance, stabilization=stabilization, budget=budget)
        typer.echo(found.message)
        for trial in found.trials:
            pair = f"{trial.formulation} {trial.method}"
            where = "whole scene" if trial.whole else "its beginning"
            measured = f"error {trial.error:.1e}  {1e3 * trial.time:9.4f} ms  ({where})"
            typer.echo(f"  {pair:28s} {trial.note or f'{trial.setting:20s} {measured}'}")
    if not found.met:
        raise typer.Exit(ENDED_EARLY)
