"""`reproduce`: its tables for CSV files, its figures, and its verdicts on the screen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import paper, plot
from ..plot.style import BLACK, DEG, LETTERS, LINES, PAGE, PALE, least_range, panels, styled, tag
from ..run import ContactMode, Run
from ..run import measures as m
from ..support import Floats, Table, checks, require
from ..support.files import FORMATS
from . import energy_minimum
from . import verdict as v
from .experiment import Progress, Runs, quietly, simulate_all
from .verdict import POSE, Finding, find

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Columns of panels in the figure of the energy.
_COLUMNS = 4
_POSE = ("x [mm]", "y [mm]", "theta [deg]")
_NOWHERE = np.full(3, np.nan)
_YES = {True: "yes", False: "no"}


def operations_table(run: Run) -> Table:
    """Final pose, settling time, constraint residuals and contact forces of each operation."""
    settled = m.settled(run)
    settling = m.settling_times(run, 1e-3 * v.BAND, np.deg2rad(v.BAND))
    peak, late = m.peak_residuals(run), m.peak_residuals(run, 1.0 - m.LAST)
    least = m.least_pressing(run)
    rows = []
    for k, (begin, end) in enumerate(m.operations(run)):
        target = run.scene.schedule.target(0.5 * (begin + end)) * POSE[2]
        pull = 1e3 * m.longest_pull(run, begin, end)
        row = [*target.round(9), *settled[k, :3] * POSE, *1e3 * settled[k, 5:7], settling[k]]
        rows.append((k + 1, *map(float, (*row, *peak[k], *late[k], least[k], pull))))
    columns = (
        *("operation", "theta_1^d [deg]", "theta_2^d [deg]", *_POSE),
        *("d_n1 [mm]", "d_n2 [mm]", "settled after [s]"),
        *("peak |C^H| [m]", "peak |C^N| [m/s]", "settled |C^H| [m]", "settled |C^N| [m/s]"),
        *("least lambda^H [N]", "pulls for [ms]"),
    )
    return Table(columns=columns, rows=tuple(rows))


def disturbances_table(runs: Mapping[str, Run], held: Mapping[str, Run]) -> Table:
    """Response to each disturbance, as the difference from the undisturbed runs `held`."""
    rows = []
    for case, run in runs.items():
        _, change = m.response(run, held[case])
        after = m.since_onset(run)
        row = [*np.abs(change[:, :3]).max(axis=0) * POSE, *change[-1, :3] * POSE]
        row += [*1e3 * run.q[-1, 5:7], run.multipliers[after, :2].min()]
        row += [1e3 * m.longest_pull(run, m.onset(run), np.inf)]
        row += np.abs(run.residuals).max(axis=0).reshape(2, 2).max(axis=1).tolist()
        row += [np.abs(run.energy.closure).max()]
        right, left = (run.scene.schedule.target(run.t[-1]) * POSE[2]).round(9).tolist()
        rows.append((case, right, left, run.status, *map(float, row)))
    columns = (
        *("case", "theta_1^d [deg]", "theta_2^d [deg]", "status"),
        *(f"{kind} of {name}" for kind in ("peak", "change") for name in _POSE),
        *("d_n1 [mm]", "d_n2 [mm]", "least lambda^H [N]", "pulls for [ms]"),
        *("peak |C^H| [m]", "peak |C^N| [m/s]", "closure [J]"),
    )
    return Table(columns=columns, rows=tuple(rows))


def coupling_table(runs: Runs) -> Table:
    """Final poses with kappa = +1, as the paper prints (4), and with kappa = -1."""
    both = (runs.operations, runs.other_operations)
    ends = zip(*(m.settled(run)[:, :3] * POSE for run in both), strict=True)
    rows: list[tuple[Any, ...]] = [
        (f"operation {k + 1}", *plus.tolist(), *minus.tolist(), *(run.status for run in both))
        for k, (plus, minus) in enumerate(ends)
    ]
    for case, plus in runs.cases.items():
        minus = runs.other_cases[case]
        poses = [(run.q[-1, :3] * POSE).tolist() for run in (plus, minus)]
        rows.append((f"case ({case})", *poses[0], *poses[1], plus.status, minus.status))
    signs = ("kappa = +1", "kappa = -1")
    columns = ("what", *(f"{name}, {sign}" for sign in signs for name in _POSE))
    return Table(columns=(*columns, *(f"status, {sign}" for sign in signs)), rows=tuple(rows))


def contact_table(runs: Runs) -> Table:
    """Final poses with bilateral contact beside those of a real hand, and what its tips do."""
    names = ["bilateral", *(f"mu = {mu:g}" for mu in runs.real)]
    ends = [m.settled(run)[:, :3] * POSE for run in (runs.operations, *runs.real.values())]
    kept = [v.survived(run) for run in runs.real.values()]
    rows: list[tuple[Any, ...]] = []
    for k, piece in enumerate(m.operations(runs.operations)):
        poses = _joined([end[k] for end in ends])
        does = _joined([_longest(run, *piece) for run in runs.real.values()])
        rows.append((f"operation {k + 1}", *poses, *(_YES[each[k]] for each in kept), *does))
    for case, cases in runs.real_cases.items():
        each = (runs.cases[case], *cases.values())
        poses = _joined([run.q[-1, :3] * POSE if run.success else _NOWHERE for run in each])
        does = _joined([_longest(run, m.onset(run), np.inf) for run in cases.values()])
        held = (_YES[v.case_survived(run)] for run in cases.values())
        rows.append((f"case ({case})", *poses, *held, *does))
    of_tips = ("survived", "opens for [ms]", "slips for [ms]")
    columns = ["what", *(f"{axis}, {name}" for axis in _POSE for name in names)]
    columns += [f"{does}, {name}" for does in of_tips for name in names[1:]]
    return Table(columns=tuple(columns), rows=tuple(rows))


def _longest(run: Run, begin: float, end: float) -> Floats:
    """The longest opening and the longest slip of a tip in [begin, end] (2,), ms."""
    found = [v.spells(run, mode, begin, end) for mode in (ContactMode.FREE, ContactMode.SLIP)]
    return np.array([1e3 * max(times, default=0.0) for times in found])


def _joined(found: Sequence[Floats]) -> list[float]:
    """The first number of each, the second of each, and so on."""
    return np.transpose(found).ravel().tolist()


def draw(runs: Runs, out: Path, suffix: str, progress: Progress) -> list[Path]:
    """Draws and saves every figure."""
    pieces = m.operations(runs.operations)
    times = [pieces[0][0], *(end for _, end in pieces)]
    pairs = (f"({right:g}°, {left:g}°)" for right, left in paper.OPERATIONS)
    # Titles are printed, so they have a minus sign instead of a hyphen.
    angles = [pair.replace("-", "\N{MINUS SIGN}") for pair in pairs]
    titles = ["start", *(f"operation {k}: {pair}" for k, pair in enumerate(angles, 1))]
    signs = (runs.operations, runs.other_operations, runs.cases["i"], runs.other_cases["i"])
    operated = {"the eight operations": _models(runs.operations, runs.real)}
    real = runs.real_cases.items()
    disturbed = {f"disturbance ({k})": _models(runs.cases[k], each) for k, each in real}
    makers: dict[str, Callable[[], Figure]] = {
        "figure4": lambda: plot.snapshots(runs.operations, times, titles),
        "figure5": lambda: plot.motion(runs.operations),
        "figure6": lambda: plot.residuals(runs.operations),
        "figure7": lambda: plot.disturbances(runs.cases, runs.held),
        "figure_forces": lambda: plot.forces(runs.operations),
        "figure_tilt_coupling": lambda: plot.tilt_coupling(*signs, "disturbance (i)"),
        "figure_energy_minimum": lambda: energy_minima(energy_minimum.curves(runs.rests, angles)),
        "figure_contact_operations": lambda: plot.contact_models(operated),
        "figure_contact_disturbances": lambda: plot.contact_models(disturbed),
    }
    files = []
    for k, (name, make) in enumerate(makers.items()):
        progress(f"drawing {name}", 0.4 + 0.6 * k / len(makers))
        files.append(plot.save(make(), out / f"{name}.{suffix}"))
    return files


def energy_minima(curves: Mapping[str, Floats]) -> Figure:
    """Elastic energy and gravity while the object turns about its rests without slip."""
    with styled():
        rows = max(1, -(-len(curves) // _COLUMNS))
        figure, axes = panels(rows, _COLUMNS, PAGE, 0.5 + 1.75 * rows, sharey=True)
        for each in axes.ravel()[len(curves) :]:
            each.set_visible(False)
        for k, (each, (title, curve)) in enumerate(zip(axes.flat, curves.items(), strict=False)):
            angle, energy = DEG.per_si * curve[0], 1e3 * curve[1]
            each.axhline(0.0, color=PALE, linewidth=0.6, zorder=0.5)
            each.plot(angle, energy, **LINES[0])
            # The curve's middle is the rest.
            each.plot(angle[len(angle) // 2], 0.0, "o", color=BLACK)
            tag(each, LETTERS[k], title)
            if k >= len(curves) - _COLUMNS:
                each.set_xlabel(r"$\theta$ [deg]")
            if k % _COLUMNS == 0:
                each.set_ylabel(r"$P + P_g$ [mJ]")
        least_range(axes.flat[: len(curves)])
        what = r"energy while the object turns about its rest at the targets $(\theta_1, \theta_2)$"
        figure.suptitle(what, fontsize="medium")
        return figure


def _models(bilateral: Run, real: Mapping[float, Run]) -> dict[str, Run]:
    return {"bilateral": bilateral} | {f"$\\mu = {mu:g}$": run for mu, run in real.items()}


_COLORS = {v.HOLDS: "green", v.FAILS: "bold red"}


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """The result of `reproduce`."""

    runs: Runs  # all runs
    tables: Mapping[str, Table]  # name of each CSV file, without suffix -> its table
    findings: tuple[Finding, ...]  # verdicts on the paper's claims, and findings beyond the paper
    files: tuple[Path, ...]  # the written files

    def show(self) -> None:
        """Prints how the runs ended, and the verdicts; needs the extra `cli`."""
        require("rich", extra="cli", purpose="printing verdicts")
        from rich.console import Console
        from rich.padding import Padding
        from rich.text import Text

        console = Console(highlight=False, markup=False)
        console.print(Text(paper.PARAMETER_NOTE, style="italic"))
        cases = {f"({case})": run for case, run in self.runs.cases.items()}
        for what, run in {"the operations": self.runs.operations, **cases}.items():
            noted = [f"{name} first at {time:.6g} s" for name, time in run.violations.items()]
            ended = f"{what}: {run.status}; noted: {', '.join(noted) or 'nothing'}"
            console.print(ended, soft_wrap=True)
        for heading, beyond in (("What the paper claims", False), ("What it does not say", True)):
            console.print(Text(f"\n{heading}", style="bold"))
            for finding in self.findings:
                if (finding.verdict == v.BEYOND) != beyond:
                    continue
                text = Text()
                if not beyond:
                    text.append(f"{finding.verdict}: ", style=_COLORS[finding.verdict])
                text.append(finding.claim)
                text.append(f" ({finding.source})" if finding.source else "")
                console.print(text)
                console.print(Padding(Text(finding.evidence), (0, 0, 0, 4), expand=False))
        folders = sorted({str(file.parent) for file in self.files})
        console.print(f"\n{len(self.files)} files in {', '.join(folders)}", soft_wrap=True)


def reproduce(
    out: str | Path, format: str = "png", dt: float = 1e-4, progress: Progress = quietly
) -> Reproduction:
    """Repeats the paper's simulations, and writes figures and tables.

    Args:
        out: The folder for the files, made if it is missing.
        format: File format of the figures: "png", "pdf" or "svg".
        dt: Longest step, s.
        progress: Called with a description of the current work and the completed share (0 to 1).
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
        "operations": operations_table(runs.operations),
        "disturbances": disturbances_table(runs.cases, runs.held),
        "tilt_coupling": coupling_table(runs),
        "energy_minimum": energy_minimum.table(runs.rests),
        "contact": contact_table(runs),
        "verdict": Table(
            columns=tuple(field.name for field in fields(Finding)),
            rows=tuple(map(astuple, findings)),
        ),
    }
    files = [table.save(out / f"{name}.csv") for name, table in tables.items()]
    files += draw(runs, out, format, progress)
    progress("done", 1.0)
    return Reproduction(runs=runs, tables=tables, findings=findings, files=tuple(files))
