"""Today's simulators on the reference problems: error and creep over run time.

make bench-reference

The part "chart" draws the points of the last whole run again, from results/reports.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import carry_peers
import document
import softpinch as sp
from command import parser
from machine import describe, without_mujoco
from peers_contact import equations, grips
from peers_contact.grips import Grip, Held

MEASURED = ("equations", "grips")
PARTS = (*MEASURED, "chart")
PEERS = ("Siconos", "MuJoCo", "Drake")
# Columns of the points: of an error, or of creep in m, and processor time in s.
POINTS = ("part", "problem", "name", "step", "value", "lost", "seconds")
LEVELS = (1e-2, 1e-4, 1e-6, 1e-8)
REPEATS = 15
# softpinch on the problems with jaws: what a user would take.
OURS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("softpinch, rk4, dt = 0.2 ms", {"method": "rk4", "dt": 2e-4}),
    ("softpinch, rosenbrock, dt = 1 ms", {"method": "rosenbrock", "dt": 1e-3}),
    ("softpinch, radau5, tolerance 1e-6", {"method": "radau5", "tolerance": 1e-6}),
)
CHARTED = ("01-rest", "02-rest-half", "03-held")
# What the chart draws for less creep than that, mm.
FLOOR = 1e-7


@dataclass
class Rungs:
    """Errors and processor times, s, of one solver on one problem, from loose to tight."""

    solver: str
    problem: str
    errors: list[float] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    def time(self, level: float) -> float:
        """The least time with an error below the level; infinite where there is none."""
        pairs = zip(self.errors, self.times, strict=True)
        return min((t for error, t in pairs if error <= level), default=math.inf)


def on_equations(quick: bool, missing: Mapping[str, str]) -> list[Rungs]:
    """Solvers of the same equations, whose error is that of the scorer."""
    found = []
    for problem in equations.PROBLEMS[:1] if quick else equations.PROBLEMS:
        for name, options, rungs in equations.OURS:
            done = Rungs(name, problem)
            for rung in rungs[:2] if quick else rungs:
                error, spent = equations.ours(problem, options | rung, 1 if quick else REPEATS)
                done.errors.append(error)
                done.times.append(spent)
            found.append(done)
        if "Siconos" in missing:
            continue
        for name, theta, iterated in equations.SICONOS:
            done = Rungs(name, problem)
            for k in range(1 if quick else equations.SICONOS_DOUBLINGS + 1):
                steps = equations.SICONOS_STEPS[problem] * 2**k
                error, spent = equations.siconos(problem, steps, theta, iterated)
                done.errors.append(error)
                done.times.append(spent)
            found.append(done)
    return found


def absent(names: Sequence[str], missing: Mapping[str, str], cells: int) -> list[str]:
    """Rows that say which of these could not be measured."""
    return [
        f"| {name}: could not be installed where this was measured |{' - |' * cells}"
        for name in names
        if name in missing
    ]


def equations_table(found: list[Rungs], missing: Mapping[str, str]) -> str:
    lines = [
        "| problem | solver | "
        + " | ".join(f"{level:.0e}" for level in LEVELS)
        + " | least error |",
        "|---|---|" + "---:|" * (len(LEVELS) + 1),
    ]
    for each in found:
        times = (each.time(level) for level in LEVELS)
        cells = [f"{1e3 * t:.3g}" if math.isfinite(t) else "-" for t in times]
        lines.append(
            f"| {each.problem} | {each.solver} | {' | '.join(cells)} | {min(each.errors):.0e} |"
        )
    return "\n".join([*lines, *absent(PEERS[:1], missing, len(LEVELS) + 2)])


def ours(name: str, options: dict[str, Any], grip: Grip, repeats: int) -> Held:
    """softpinch on a problem with jaws."""
    from time import process_time

    posed, spent = equations.scene(name), []
    for _ in range(repeats):
        begin = process_time()
        run = sp.simulate(
            posed, times=np.unique([0.0, *grip.creep]), record=("state",), stop_on=(), **options
        )
        spent.append(process_time() - begin)
    took = float(np.median(spent))
    if run.status != "completed":
        return Held(math.nan, float(run.t[-1]), took)
    at = np.searchsorted(run.t, grip.creep)
    return Held(float(abs(np.diff(run.q[at, 1])[0])), None, took)


@dataclass
class GripRow:
    """One simulator with one setting and step on the problems with jaws."""

    name: str
    step: int
    held: dict[str, Held]


def on_grips(quick: bool, missing: Mapping[str, str]) -> list[GripRow]:
    """Everyone on the problems with jaws, the peers at smaller steps on those of the chart too."""
    motion = equations.scene("20-carried-in-jaws").motion
    assert motion is not None
    posed = grips.grips(motion)
    if quick:
        posed = {name: posed[name] for name in ("04-lost",)}
    rows = []
    for name, options in OURS:
        held = {problem: ours(problem, options, grip, 3) for problem, grip in posed.items()}
        rows.append(GripRow(name, 0, held))
    if "Siconos" not in missing:
        each = [name for name in equations.SICONOS_GRIPS if name in posed]
        held = {
            name: equations.siconos_grip(
                name, posed[name].creep, 0.1 if quick else posed[name].duration
            )
            for name in each
        }
        limit = f"{equations.SICONOS_LIMIT:g} s at most"
        rows.append(GripRow(f"Siconos, Moreau-Jean, 0.15 ms, {limit}", 0, held))
    for step in range(1 if quick else len(grips.MUJOCO_STEPS)):
        makers = grips.peers(missing, step)
        for name, make in makers[:: len(makers) - 1 or 1] if quick else makers:
            names = posed if step == 0 else ["03-held"]
            duration = 0.1 if quick else None
            held = {each: grips.hold(make(), posed[each], duration) for each in names}
            rows.append(GripRow(name, step, held))
            told = ", ".join(f"{key} {cell(value)}" for key, value in held.items())
            print(f"  {name}, step {step}: {told}", flush=True)
    return rows


def cell(held: Held) -> str:
    if held.lost is not None:
        return f"lost, {held.lost:.3g} s" if held.lost else "lost"
    creep = 1e3 * held.creep
    return "0" if creep < 1e-9 else f"{creep:.2g}"


def solved(problem: str) -> Held:
    """What the solution of a problem says."""
    answer = equations.score.solution(problem)[0]["answer"]
    lost = answer["end"] if answer["status"] == "lost" else None
    return Held(1e-3 * answer.get("creep_mm", math.nan), lost, 0.0)


def grips_table(rows: list[GripRow], problems: list[str], missing: Mapping[str, str]) -> str:
    exact = " | ".join(cell(solved(name)) for name in problems)
    lines = [
        "| simulator | " + " | ".join(problems) + " | time of 02, s | time of 03, s |",
        "|---|" + "---:|" * (len(problems) + 2),
        f"| **the solution** | {exact} | | |",
    ]
    for row in rows:
        if row.step == 0:
            cells = [cell(row.held[name]) if name in row.held else "-" for name in problems]
            for problem in ("02-rest-half", "03-held"):
                held = row.held.get(problem)
                whole = held is not None and held.lost is None
                cells.append(f"{held.spent:.2g}" if held is not None and whole else "-")
            lines.append(f"| {row.name} | {' | '.join(cells)} |")
    return "\n".join([*lines, *absent(PEERS, missing, len(problems) + 2)])


def _best(rows: list[GripRow], name: str, problem: str) -> GripRow:
    """The row of a simulator that creeps least."""
    kept = [r for r in rows if r.name.startswith(name) and r.step == 0]
    kept = [r for r in kept if r.held[problem].lost is None]
    return min(kept, key=lambda row: row.held[problem].creep)


def message(rows: list[GripRow]) -> str:
    """What the numbers say of the problems with jaws."""
    problem, lines = "03-held", []
    for name in PEERS[1:]:
        of = [row for row in rows if row.name.startswith(name) and row.step == 0]
        if not of:
            continue
        best = _best(rows, name, problem)
        wrong = sum(row.held[problem].lost is not None for row in of)
        held = sum(row.held["04-lost"].lost is None for row in of)
        quick = min(row.held[problem].spent for row in of if row.held[problem].lost is None)
        kept = best.held[problem]
        lines.append(
            f"- **{name}** in {len(of)} settings: the cube of 03-held, which friction holds, is "
            f"lost in {wrong}, and that of 04-lost is still there after 2 s in {held}. The least "
            f"creep in the 18 s of 03-held is {1e3 * kept.creep:.2g} mm, by "
            f"{best.name.removeprefix(name).strip(', ')}, in {kept.spent:.2g} s; the shortest time "
            f"of those that hold is {quick:.2g} s."
        )
    for row in rows:
        if row.name.startswith("Siconos"):
            kept = row.held[problem]
            lines.append(
                f"- **Siconos** keeps the cube of 03-held, with a creep of {cell(kept)} mm "
                f"in {kept.spent:.2g} s; it loses that of 04-lost."
            )
    mine = [row for row in rows if row.name.startswith("softpinch")]
    times = ", ".join(
        f"{row.held[problem].spent:.2g} s ({row.name.partition(', ')[2]})" for row in mine
    )
    worst = max(1e3 * row.held[problem].creep for row in mine)
    named = {row.name.partition(",")[0].split()[0] for row in rows}
    lines += [f"- **{name}** could not be installed." for name in PEERS if name not in named]
    lines.append(f"- **softpinch** takes {times}; its largest creep there is {worst:.1g} mm.")
    return "\n".join(lines)


STYLES = {"softpinch": ("tab:blue", "o"), "Siconos": ("tab:green", "s"),
          "MuJoCo": ("tab:red", "^"), "Drake": ("tab:purple", "D")}  # fmt: skip


def store(path: Path, found: list[Rungs], rows: list[GripRow]) -> None:
    """Writes the points of the chart."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(POINTS)
        for each in found:
            for error, seconds in zip(each.errors, each.times, strict=True):
                writer.writerow(["equations", each.problem, each.solver, 0, error, "", seconds])
        for row in rows:
            for problem, held in row.held.items():
                lost = "" if held.lost is None else held.lost
                point = [held.creep, lost, held.spent]
                writer.writerow(["grips", problem, row.name, row.step, *point])


def stored(path: Path) -> tuple[list[Rungs], list[GripRow]]:
    """What `store` has written."""
    rungs: dict[tuple[str, str], Rungs] = {}
    rows: dict[tuple[str, int], GripRow] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for part, problem, name, step, value, lost, seconds in list(csv.reader(file))[1:]:
            if part == "equations":
                done = rungs.setdefault((problem, name), Rungs(name, problem))
                done.errors.append(float(value))
                done.times.append(float(seconds))
            else:
                row = rows.setdefault((name, int(step)), GripRow(name, int(step), {}))
                when = float(lost) if lost else None
                row.held[problem] = Held(float(value), when, float(seconds))
    return list(rungs.values()), list(rows.values())


def chart(path: Path, found: list[Rungs], rows: list[GripRow]) -> None:
    """Work-precision: error over run time above, creep over run time below."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(11, 7.6), layout="constrained")
    dashes = ("-", "--", ":")
    for axis, problem in zip(axes[0], equations.PROBLEMS, strict=True):
        of = [each for each in found if each.problem == problem]
        for k, each in enumerate(of):
            colour, marker = STYLES[each.solver.partition(",")[0]]
            axis.loglog(
                each.times, each.errors, dashes[k % 3], color=colour, marker=marker,
                markersize=4, linewidth=1.2, label=each.solver,
            )  # fmt: skip
        axis.set_title(problem)
        axis.set_xlabel("processor time, s")
    axes[0, 0].set_ylabel("error of q and p at the end")
    # Outside, where no curve is.
    figure.legend(*axes[0, 0].get_legend_handles_labels(), fontsize=8, ncols=5,
                  loc="outside upper center")  # fmt: skip
    for axis, problem in zip(axes[1], CHARTED, strict=True):
        for name, (colour, marker) in STYLES.items():
            held = [
                row.held[problem]
                for row in rows
                if row.name.startswith(name) and problem in row.held
            ]
            kept = [each for each in held if each.lost is None]
            if kept:
                axis.loglog(
                    [each.spent for each in kept],
                    [max(1e3 * each.creep, FLOOR) for each in kept],
                    marker, color=colour, markersize=5, alpha=0.75, label=name,
                )  # fmt: skip
        axis.axhline(FLOOR, color="0.6", linewidth=0.8, linestyle=":")
        axis.set_ylim(FLOOR / 3, 1e3)
        axis.set_title(problem)
        axis.set_xlabel("processor time, s")
    axes[1, 0].set_ylabel(f"creep, mm (points at {FLOOR:.0e}: less)")
    kinds = {label: handle for axis in axes[1]
             for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}  # fmt: skip
    if kinds:
        figure.legend(list(kinds.values()), list(kinds), fontsize=8, ncols=len(kinds),
                      loc="outside lower center")  # fmt: skip
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=160)
    plt.close(figure)


def main() -> None:
    given = parser(__doc__, PARTS).parse_args()
    quick, parts = given.quick, given.part or PARTS
    missing = {
        **without_mujoco(), **carry_peers.without_drake(), **equations.without_siconos()
    }  # fmt: skip
    libraries = [name for name in ("mujoco", "drake") if name not in map(str.lower, missing)]
    machine = describe(libraries=libraries, missing=missing)
    if "Siconos" not in missing:
        machine += f"\n           siconos {equations.siconos_version()}"
    print(machine)
    found, rows, texts = [], [], {}
    if "equations" in parts:
        found = on_equations(quick, missing)
        texts["reference equations"] = equations_table(found, missing)
    if "grips" in parts:
        rows = on_grips(quick, missing)
        texts["reference grips"] = grips_table(rows, list(rows[0].held), missing)
        if not quick:
            texts["reference message"] = message(rows)
    with document.folders(quick) as (figures, data):
        points = data / "reference_problems.csv"
        if found and rows:
            texts["reference machine"] = f"```text\n{machine}\n```"
            store(points, found, rows)
        if "chart" in parts:
            if not points.is_file():
                raise SystemExit(f"{points}: there is none yet; measure all parts first")
            chart(figures / "reference_problems.png", *stored(points))
    for name, text in texts.items():
        if machine not in text:
            print(f"\n{name}\n{text}")
        if not quick:
            document.put(name, text)


if __name__ == "__main__":
    main()
