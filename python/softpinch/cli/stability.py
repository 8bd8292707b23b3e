"""`softpinch stability`: the longest stable steps of a scene, and stability maps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from ..accuracy.stability import max_stable_dt
from ..accuracy.stability_axes import AXES
from ..accuracy.stability_maps import PAIRS, MapPlan, Pair, StabilityMap, check_pairs
from ..scene.contact import formulations_of, require_formulations
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..support import checks
from ..support.arrays import Floats
from ..support.extras import require
from ..support.files import FORMATS
from ..support.progress import reporting
from .options import Alpha, Beta, Format, Out, SceneFile, Set, Steps, Threads
from .shell import gains, ladder, one_line_errors, read_scene


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
        str | None,
        typer.Option(help="Where to look on the one axis that is given, with commas."),
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
        at, steps = _values(values, axes), _steps(dt, axes)
        # Check all maps before the first run.
        plans = [
            MapPlan(described, name, at, steps, wanted, stabilization, max_steps, threads)
            for name in axes
        ]
        if plans:
            require("matplotlib", extra="plot", purpose="figures")
            out.mkdir(parents=True, exist_ok=True)
        for line in _table(described, wanted, stabilization):
            typer.echo(line)
        for plan in plans:
            found = plan.run()
            typer.echo("")
            for line in found.summary():
                typer.echo(line)
            typer.echo(f"{out}: {', '.join(_save(found, out, format))}")


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


def _steps(dt: tuple[float, float, int] | None, axes: Sequence[str]) -> Floats | None:
    if dt is None:
        return None
    if not axes:
        raise ValueError("--dt needs --axis: it sets the steps of a stability map")
    return ladder(dt)


def _table(scene: Scene, pairs: Sequence[Pair], stabilization: Stabilization) -> Iterator[str]:
    """Yields the lines of the table of longest steps, one for each pair."""
    wide = max(len(f"{formulation} + {method}") for formulation, method in pairs)
    yield f"{'longest step [s]':{wide}}  predicted   measured"
    found = []
    with reporting(True, "longest steps") as report:
        for k, (formulation, method) in enumerate(pairs):
            report(k, len(pairs))
            step = max_stable_dt(scene, method, formulation, stabilization=stabilization)
            found.append((f"{formulation} + {method}", step))
    for name, step in found:
        measured = "-" if step.measured is None else f"{step.measured:.4g}"
        yield f"{name:{wide}}  {step.predicted:9.4g}  {measured:>9}  {step.message}"


def _save(found: StabilityMap, out: Path, format: str) -> list[str]:
    """Writes tables and figure, and returns their file names."""
    from .. import plot

    stem = out / f"stability_{found.axis.replace('.', '_')}"
    files = [found.save(stem.with_suffix(suffix)) for suffix in (".csv", ".npz")]
    files.append(plot.save(plot.stability_map(found), stem.with_suffix(f".{format}")))
    return [file.name for file in files]
