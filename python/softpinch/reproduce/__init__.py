"""The paper's simulation, end to end: every run, Figures 4 to 7 and two more, tables, verdicts.

    >>> from pathlib import Path
    >>> from softpinch.reproduce import reproduce
    >>> result = reproduce(Path("results"))  # doctest: +SKIP
    >>> result.show()  # doctest: +SKIP

Needs the extra `plot` for the figures, and `cli` for `show`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import paper
from ..run import measures as m
from ..run.run import Run
from ..run.simulate import simulate
from ..scene.disturbance import Impulse, Pulse, Step
from ..scene.hand import Fingertip, Hand
from ..scene.scene import Scene
from ..scene.schedule import Schedule
from ..support import checks
from ..support.extras import require
from . import report, verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("png", "pdf", "svg")
# What is being done, and how much of it all is done (0 to 1).
Progress = Callable[[str, float], None]

_EVERYTHING = ("state", "multipliers", "residuals", "energy")
# The moments with which (40) is tried, N m: its own, none, and the opposite.
_MOMENTS = (5.0, 0.0, -5.0)


def _quietly(what: str, share: float) -> None:
    """Progress that nobody watches."""


@dataclass(frozen=True, kw_only=True)
class Runs:
    """All runs behind the figures and the verdicts, recorded at every step.

    Attributes:
        operations: The eight operations of VI-A.
        coarse: The same with twice the step.
        direct: The last operation's angles straight from the start.
        cases: Case of Fig. 7 -> its run.
        held: Case -> the same without the disturbance.
        moments: Moment in N m -> case (i) with it.
        ideal: Case (ii) with its numbers read as N s and N m s.
        other_operations: The eight operations with kappa = -1.
        other_cases: Case -> its run with kappa = -1.
    """

    operations: Run
    coarse: Run
    direct: Run
    cases: Mapping[str, Run]
    held: Mapping[str, Run]
    moments: Mapping[float, Run]
    ideal: Run
    other_operations: Run
    other_cases: Mapping[str, Run]


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """What `reproduce` found and left.

    Attributes:
        runs: Every run.
        tables: Name of each CSV file, without suffix -> its table.
        findings: The paper's claims and what it does not say.
        files: What was written.
    """

    runs: Runs
    tables: Mapping[str, report.Table]
    findings: tuple[verdict.Finding, ...]
    files: tuple[Path, ...]

    def show(self) -> None:
        """Prints tables and verdicts. Needs the extra `cli`."""
        report.show(self)


def reproduce(
    out: str | Path, format: str = "png", dt: float = 1e-4, progress: Progress = _quietly
) -> Reproduction:
    """Runs the paper's simulation and writes figures and tables.

    Args:
        out: The directory, made if it is not there.
        format: Of the figures: "png", "pdf" or "svg".
        dt: Longest step, s.
        progress: Told what is being done, and which share is done.

    Raises:
        ValueError: `format` or `dt` breaks its rule.
        TypeError: An argument is of the wrong kind.
        OSError: A file cannot be written.
        ImportError: matplotlib is not installed.
        KeyboardInterrupt: Ctrl-C during a run: a part of it is no reproduction.
    """
    out = checks.path("out", out, "the path of a folder")
    checks.choice("format", format, FORMATS)
    dt = checks.positive("dt", dt)
    checks.function("progress", progress)
    require("matplotlib", extra="plot", purpose="figures")
    out.mkdir(parents=True, exist_ok=True)
    runs = simulate_all(dt, progress)
    findings = find(runs)
    tables = {
        "operations": report.operations_table(runs.operations),
        "disturbances": report.disturbances_table(runs.cases, runs.held),
        "tilt_coupling": report.coupling_table(runs),
        "verdict": report.verdict_table(findings),
    }
    files = [table.save(out / f"{name}.csv") for name, table in tables.items()]
    files += _draw(runs, out, format, progress)
    progress("done", 1.0)
    return Reproduction(runs=runs, tables=tables, findings=findings, files=tuple(files))


def simulate_all(dt: float, progress: Progress = _quietly) -> Runs:
    """Runs every scene at every step recorded.

    Raises:
        ValueError: `dt` breaks its rule.
        TypeError: An argument is of the wrong kind.
        KeyboardInterrupt: Ctrl-C during a run.
    """
    dt = checks.positive("dt", dt)
    checks.function("progress", progress)
    # How far the runs take the progress; the figures are the rest.
    share, done, count = 0.4, 0, 6 + 3 * len(paper.CASES) + len(_MOMENTS)

    def run(
        scene: Scene, what: str, record: Sequence[str] = _EVERYTHING, times: float = 1.0
    ) -> Run:
        nonlocal done
        progress(f"simulating {what}", share * done / count)
        result = simulate(scene, dt=times * dt, record=record)
        if result.status == "interrupted":
            raise KeyboardInterrupt
        done += 1
        return result

    other = Hand(tip=Fingertip(tilt_coupling=-1.0))
    last = Schedule.steps([0.0], np.deg2rad(paper.OPERATIONS[-1:]))
    step = paper.disturbance("i")
    return Runs(
        operations=run(paper.manipulation(), "the eight operations"),
        coarse=run(paper.manipulation(), "them with twice the step", times=2.0),
        direct=run(Scene(schedule=last, duration=paper.OPERATION_TIME), "the last one alone"),
        cases={case: run(paper.disturbance(case), f"({case})") for case in paper.CASES},
        held={
            case: run(paper.disturbance(case, disturbances=()), f"({case}) undisturbed", ["state"])
            for case in paper.CASES
        },
        moments={
            moment: run(_with_moment(step, moment), f"(i) with {moment:g} N m", ["state"])
            for moment in _MOMENTS
        },
        ideal=run(_as_impulse(paper.disturbance("ii")), "(ii) as an ideal impulse", ["state"]),
        other_operations=run(paper.manipulation(hand=other), "the operations with kappa = -1"),
        other_cases={
            case: run(paper.disturbance(case, hand=other), f"({case}) with kappa = -1")
            for case in paper.CASES
        },
    )


def _with_moment(scene: Scene, moment: float) -> Scene:
    """The scene with another moment in its step."""
    (step,) = scene.disturbances
    assert isinstance(step, Step)
    return replace(scene, disturbances=(replace(step, moment=moment),))


def _as_impulse(scene: Scene) -> Scene:
    """The scene with its pulse's height read as an impulse."""
    (pulse,) = scene.disturbances
    assert isinstance(pulse, Pulse)
    ideal = Impulse(time=pulse.time, impulse=pulse.force, angular_impulse=pulse.moment)
    return replace(scene, disturbances=(ideal,))


def find(runs: Runs) -> tuple[verdict.Finding, ...]:
    """Every claim of the paper, and what it does not say, held against the runs.

    Raises:
        TypeError: They are none that `simulate_all` made.
    """
    checks.instance("runs", runs, Runs)
    return (
        verdict.converges(runs.operations),
        verdict.fingers_arrive(runs.operations),
        verdict.holonomic_order(runs.operations),
        verdict.nonholonomic_order(runs.operations),
        verdict.rises_at_switches(runs.operations),
        *(verdict.survives(case, run) for case, run in runs.cases.items()),
        verdict.light_swings_more(
            (runs.cases["iii"], runs.held["iii"]), (runs.cases["ii"], runs.held["ii"])
        ),
        verdict.depends_on_the_way(runs.operations, runs.direct),
        verdict.pulls_at_switches(runs.operations),
        verdict.only_as_printed(runs.moments),
        verdict.reading_of_delta(runs.ideal),
        verdict.sign_of_the_shear(runs.operations, runs.other_operations, runs.other_cases["i"]),
        verdict.residuals_follow_the_step(runs.operations, runs.coarse),
        verdict.can_be_believed(runs.operations),
        verdict.parameters_are_ours(),
    )


def _draw(runs: Runs, out: Path, suffix: str, progress: Progress) -> list[Path]:
    """Makes and saves every figure."""
    from .. import plot

    pieces = m.operations(runs.operations)
    times = [pieces[0][0], *(end for _, end in pieces)]
    titles = ["start"]
    for k, (right, left) in enumerate(paper.OPERATIONS):
        # A minus sign, not a hyphen: these titles are printed.
        titles.append(f"operation {k + 1}: ({right:g}°, {left:g}°)".replace("-", "\N{MINUS SIGN}"))
    makers: dict[str, Callable[[], Figure]] = {
        "figure4": lambda: plot.snapshots(runs.operations, times, titles),
        "figure5": lambda: plot.motion(runs.operations),
        "figure6": lambda: plot.residuals(runs.operations),
        "figure7": lambda: plot.disturbances(runs.cases, runs.held),
        "figure_forces": lambda: plot.forces(runs.operations),
        "figure_tilt_coupling": lambda: plot.tilt_coupling(
            runs.operations,
            runs.other_operations,
            runs.cases["i"],
            runs.other_cases["i"],
            "disturbance (i)",
        ),
    }
    files = []
    for k, (name, make) in enumerate(makers.items()):
        progress(f"drawing {name}", 0.4 + 0.6 * k / len(makers))
        files.append(plot.save(make(), out / f"{name}.{suffix}"))
    return files
