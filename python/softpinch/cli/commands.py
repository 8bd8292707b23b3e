"""The application `softpinch` with its commands `run`, `reproduce` and `fit`."""

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console

from .. import _core
from .. import plot as figures
from ..fitting import fit_file
from ..fitting.problem import LOSSES
from ..fitting.search import fit as fit_numbers
from ..reproduce import reproduce as reproduce_paper
from ..run import ContactMode, Run, measures, simulate
from ..run.options import Options, in_place
from ..scene.fields import COORDINATE_UNITS, DISPLAY_UNITS, of_coordinates
from ..scene.parts import jaws
from ..study.capsule import Capsule
from ..support import checks, require
from ..support.files import FORMATS
from .accuracy import advise, stability, work_precision
from .montecarlo import montecarlo
from .options import Alpha, Beta, Dt, Format, Formulation, Method, Out, Set, Tolerance, separated
from .rare import rare
from .shell import ENDED_EARLY, INTERRUPTED, gains, one_line_errors, read_run, with_changes

app = typer.Typer(
    name="softpinch",
    help="A planar two-finger pinch with soft fingertips: fast, and honest about its error.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    # Help texts have brackets, which rich would take for markup.
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

_TABLES, _PICTURES = (".npz", ".csv"), tuple(f".{name}" for name in FORMATS)


def _say_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"softpinch {_core.__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    pass


@app.command()
def reproduce(
    out: Out = Path("results"),
    format: Format = "png",
    dt: Annotated[float, typer.Option(help="The longest step, s.")] = 1e-4,
) -> None:
    """Repeat the paper's simulations, draw its Figures 4 to 7, and check its claims.

    Writes figure4 to figure7, figure_forces (contact forces and energy, not in the paper),
    figure_tilt_coupling (effect of the shear's sign), figure_contact_operations and
    figure_contact_disturbances (the same scenes if tips only push, and slip where friction of 0.3
    to 1 allows it), and the tables operations.csv, disturbances.csv, tilt_coupling.csv,
    contact.csv and verdict.csv.

    The paper: Inoue and Hirai, "Dynamic Stable Manipulation via Soft-fingered Hand", ICRA 2007.
    """
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn())
    console = Console(stderr=True)
    with one_line_errors():
        with Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        ) as bar:
            task = bar.add_task("", total=1.0)

            def progress(what: str, share: float) -> None:
                bar.update(task, description=what, completed=share)

            result = reproduce_paper(out, format=format, dt=dt, progress=progress)
        result.show()


@app.command()
def run(
    scene: Annotated[
        Path,
        typer.Argument(help="The scene, or a capsule: a TOML file, SI units, angles in radians."),
    ],
    set_: Set = None,
    dt: Dt = None,
    tolerance: Tolerance = None,
    max_steps: Annotated[
        int | None,
        typer.Option(
            help="With --tolerance: the most steps that are attempted; "
            f"{_core.MAX_STEPS} where it is not given."
        ),
    ] = None,
    method: Method = None,
    formulation: Formulation = None,
    alpha: Alpha = None,
    beta: Beta = None,
    record: Annotated[
        str,
        typer.Option(
            help=f"Quantities to record, out of {', '.join(_core.RECORDABLE)}, with commas."
        ),
    ] = ",".join(_core.RECORDABLE),
    every: Annotated[
        int | None,
        typer.Option(
            help="Number of steps between recorded rows: 10, or 1 with --tolerance if left out. "
            "The last step is always a row."
        ),
    ] = None,
    estimate_error: Annotated[
        bool,
        typer.Option(
            "--estimate-error",
            help="Compute the run again with half and a quarter of its steps, and print its error.",
        ),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.npz|FILE.csv", help="Save the recorded rows.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE.png|pdf|svg", help="Draw the recorded rows.")
    ] = None,
) -> None:
    """Simulate a scene once, and print how it ended and how large its errors are.

    Entries missing from the file have defaults: an empty file is a grasp at 6 degrees for 1 s, in
    the paper's bilateral contact, whose tips pull and never slip. With contact = "unilateral" and
    friction in the file, tips slip, open and close again.

    A capsule is one run of a study with all its settings; Capsule.to_toml and softpinch montecarlo
    write capsules. Without options its replay gives exactly the study's result. Options replace the
    capsule's settings; --dt also replaces its tolerance, and --set changes its scene. The last line
    says whether the run ended as in the study.

    Exit code: 0 completed, 1 ended early (for example the grasp was lost), 2 bad input, 130 Ctrl-C.
    """
    with one_line_errors():
        _writable("--out", out, _TABLES)
        _writable("--plot", plot, _PICTURES)
        if plot is not None:
            require("matplotlib", extra="plot", purpose="--plot")
        read = read_run(scene)
        capsule, described = (read, read.scene) if isinstance(read, Capsule) else (None, read)
        described = with_changes(described, set_)
        options = Options.checked() if capsule is None else capsule.options
        how = options.numerics() | in_place(
            dt=dt, tolerance=tolerance, max_steps=max_steps, method=method, formulation=formulation
        )
        others = how["stabilization"]
        how["stabilization"] = gains(how["formulation"], others=others, alpha=alpha, beta=beta)
        console = Console(stderr=True)
        with console.status(f"simulating {scene.name}") if console.is_terminal else nullcontext():
            result = simulate(
                described,
                **how,
                estimate_error=estimate_error,
                record=separated(record),  # type: ignore[arg-type]
                every=(10 if how["tolerance"] is None else 1) if every is None else every,
            )
        if out is not None:
            result.save(out)
        if plot is not None:
            figures.save(figures.run(result), plot)
        typer.echo("\n".join(summary(result)))
        if capsule is not None and result.status != "interrupted":
            typer.echo("\n".join(beside_study(capsule, result, how)))
    if result.status == "interrupted" or (estimate_error and result.error_estimate.interrupted):
        raise typer.Exit(INTERRUPTED)
    if not result.success:
        raise typer.Exit(ENDED_EARLY)


app.command()(montecarlo)
app.command()(rare)


@app.command()
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
        how = {"dt": dt, "tolerance": tolerance, "method": method, "formulation": formulation}
        how |= {"loss": loss, "multistart": multistart}
        scene, observables, settings = fit_file.read(study, **how)
        times, measured = fit_file.read_data(data, observables)
        require("matplotlib", extra="plot", purpose="figures")
        require("tomli_w", extra="cli", purpose="writing TOML")
        found = fit_numbers(scene, times, measured, **settings)
        typer.echo("\n".join([*found.lines(), *found.messages]))
        if profile:
            for path in found.values:
                low, high = found.profile(path).interval
                typer.echo(f"{path}, 95 % by its profile: {low:.6g} to {high:.6g}")
        out.mkdir(parents=True, exist_ok=True)
        files = [found.save(out / "fit.json"), found.save(out / "fit.csv")]
        files.append(figures.save(figures.fit(found), out / f"fit.{format}"))
        files.append(out / "scene.toml")
        files[-1].write_text(found.scene.to_toml(), encoding="utf-8")
        typer.echo(f"{out}: {', '.join(file.name for file in files)}")
    if not found.converged:
        raise typer.Exit(ENDED_EARLY)


app.command()(stability)
app.command()(work_precision)
app.command()(advise)


def _writable(option: str, path: Path | None, suffixes: tuple[str, ...]) -> None:
    """Checks suffix and folder of an output file before simulating, to fail early."""
    if path is None:
        return
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{option} = {str(path)!r}: must end in {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise ValueError(f"{option} = {str(path)!r}: there is no directory {str(path.parent)!r}")


def beside_study(capsule: Capsule, run: Run, how: Mapping[str, Any]) -> list[str]:
    """Lines that say whether a capsule's run ended as in its study; `how` has today's settings."""
    name, ended = f"run {capsule.run}", f"{capsule.status} at t = {capsule.time!r} s"
    if run.scene != capsule.scene:
        return [f"another scene than in the study, where {name} {ended}"]
    if how != capsule.options.numerics():
        return [f"other settings than in the study, where {name} {ended}"]
    lines = []
    if capsule.results_version != _core.RESULTS_VERSION:
        bits = f"the study's bits are those of results version {capsule.results_version}"
        lines.append(f"{bits}, these of {_core.RESULTS_VERSION}: they may differ")
    if capsule.agrees(run):
        return [*lines, f"as in the study: {name} {ended}"]
    now = f"{run.status} at t = {float(run.t[-1])!r} s"
    return [*lines, f"differs from the study: {name} {ended} there, {now} here"]


def contact_lines(run: Run) -> list[str]:
    """Lines that describe the contacts of a run with unilateral contact."""
    friction = run.scene.friction
    pair = friction if isinstance(friction, tuple) else None
    mu = f"{pair[0]:g} right and {pair[1]:g} left" if pair else f"{friction:g}"
    times = []
    for side, name in enumerate(("right", "left")):
        spans = measures.contact_spans(run, side)
        free, slip = (
            1e3 * sum(end - begin for begin, end, mode in spans if mode is wanted)
            for wanted in (ContactMode.FREE, ContactMode.SLIP)
        )
        times.append(f"the {name} tip is free for {free:.4g} ms and slips for {slip:.4g} ms")
    return [
        f"unilateral contact, friction {mu}: the grasp {'holds' if run.holds else 'does not hold'}",
        f"{len(run.contact_changes)} changes of contact: {', '.join(times)}",
    ]


def summary(run: Run) -> list[str]:
    """Lines that describe a finished run: how it ended, its final state, and its errors."""
    last = run.state(-1)
    units = [DISPLAY_UNITS[unit] for unit in of_coordinates(COORDINATE_UNITS, jaws(run.scene))]
    shown = last.q * [per_si for _, per_si in units]
    x, y, theta, right, left, d_n1, d_n2, _, _ = (f"{number:z.3f}" for number in shown)
    length, _, angle, first, second = (name for name, _ in units[:5])
    right = right if first == second else f"{right} {first}"
    lines = [
        f"{run.status}: {run.message}",
        f"at t = {last.time:.6g} s: x = {x} {length}, y = {y} {length}, theta = {theta} {angle}",
        f"fingers: {right} and {left} {second} (right, left); d_n = {d_n1} and {d_n2} {length}",
    ]
    noted = ", ".join(f"{name} first at {time:.6g} s" for name, time in run.violations.items())
    lines.append(f"violations: {noted or 'none'}")
    if run.scene.motion is not None:
        fastest = np.hypot(*run.hand.acceleration.T).max()
        lines.append(f"the hand moves: acceleration up to {fastest:.4g} m/s^2")
    if run.scene.contact == "unilateral":
        lines += contact_lines(run)
    if "multipliers" in run.record:
        least = run.multipliers[:, :2].min(axis=0)
        lines.append(f"least lambda^H: {least[0]:.3g} and {least[1]:.3g} N")
    if "residuals" in run.record:
        sizes = measures.held_residuals(run).max(axis=0)
        holonomic, nonholonomic = sizes.reshape(2, 2).max(axis=1)
        lines.append(f"residuals: |C^H| <= {holonomic:.1e} m, |C^N| <= {nonholonomic:.1e} m/s")
    if "energy" in run.record:
        closure = np.abs(run.energy.closure).max()
        exchanged = run.energy.exchanged
        lines.append(f"energy ledger: closes within {closure:.1e} J of {exchanged:.3g} J exchanged")
        if run.scene.contact == "unilateral":
            taken = run.energy.friction_loss[-1], run.energy.impact_loss[-1]
            lines.append(f"friction takes {taken[0]:.3g} J, impacts take {taken[1]:.3g} J")
    # `Run` raises AttributeError for an estimate that was not requested.
    if (error := getattr(run, "error_estimate", None)) is not None:
        lines.append(error.message)
    if run.every > 1 and set(run.record) & {"multipliers", "residuals", "energy"}:
        lines.append(f"(extremes are of one step in {run.every}; --every 1 sees all)")
    return lines
