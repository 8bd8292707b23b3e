"""Writes the data of the reference problems, their agreement and the tables of README.md.

PYTHONPATH=tests python reference/generate.py [NAME ...]

Readers of the data need neither this file nor softpinch. Each solution is computed four times: the
solution itself, another formulation of the same equations, another method, and tests/oracle, an
independent simulation with equations derived by SymPy, whose events SciPy locates.
"""

from __future__ import annotations

import csv
import sys
import time
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from definitions import BY_NAME, PROBLEMS, Problem
from rare import RARES
from rare import write as write_rare
from score import COLUMNS, QUANTITIES, VERSION, differences, event_error, lasting
from softpinch.accuracy.segments import Inputs
from softpinch.support import toml

ROOT = Path(__file__).parent
FOLDER = ROOT / "problems"
sys.path.append(str(ROOT.parent / "tests"))

# No row is nearer to an event, or to a jump of what is given, than this, s.
APART = 2e-6
CHECKS = ("formulation", "method", "independent")

Floats: TypeAlias = NDArray[np.float64]
Event: TypeAlias = tuple[float, str, str, str]


@dataclass(frozen=True)
class Solution:
    """A solution at given instants: `score.COLUMNS`, the events, and how the run ended."""

    rows: Floats
    modes: list[tuple[str, str]]
    events: list[Event]
    status: str
    end: float
    ledger: dict[str, float]


def solved(scene: sp.Scene, times: Sequence[float] | None, **options: Any) -> Solution:
    """By softpinch; at no instants but the end where none are given."""
    unilateral = scene.contact == "unilateral"
    record = ["state", "multipliers", "energy", *(["contact"] if unilateral else [])]
    given: dict[str, Any] = {"every": 10**9} if times is None else {"times": times}
    run = sp.simulate(scene, record=tuple(record), stop_on=(), **given, **options)
    ledger = run.energy
    energy = ledger.kinetic + ledger.gravity + ledger.elastic.reshape(len(run.t), -1).sum(axis=1)
    rows = np.column_stack([run.t, run.q, run.p, run.multipliers, energy])
    modes, events = [("stick", "stick")] * len(rows), []
    if unilateral:
        names = {mode: mode.name.lower() for mode in sp.ContactMode}
        modes = [(names[sp.ContactMode(r)], names[sp.ContactMode(e)]) for r, e in run.contact]
        events = sorted(
            (float(c.time), c.finger, names[c.before], names[c.after]) for c in run.contact_changes
        )
    losses = ("controller_work", "external_work", "viscous_loss", "friction_loss", "impact_loss")
    totals = {name: float(np.asarray(getattr(ledger, name))[-1]) for name in losses}
    # A run that ends early has a last row of its own.
    wanted = np.ones(len(rows), bool) if times is None else np.isin(run.t, times)
    modes = [pair for pair, kept in zip(modes, wanted, strict=True) if kept]
    return Solution(rows[wanted], modes, events, run.status, float(run.t[-1]), totals)


def independent(scene: sp.Scene, times: Sequence[float], method: str) -> Solution:
    """By tests/oracle, with one of SciPy's methods; energies are NaN."""
    from oracle import unilateral
    from oracle.parts import reference_of

    rows = np.full((len(times), len(COLUMNS)), np.nan)
    rows[:, 0] = times
    if scene.contact == "bilateral":
        exact = reference_of(scene, times, method=method)
        rows[:, 1:-1] = np.hstack([exact.q, exact.p, exact.multipliers])
        return Solution(rows, [], [], "completed", times[-1], {})
    walked = unilateral(scene, times, method)
    rows = rows[: len(walked.t)]
    rows[:, 1:-1] = np.hstack([walked.q, walked.p, walked.multipliers])
    events = sorted((c.time, c.finger, c.before[:4], c.after[:4]) for c in walked.changes)
    full = {"stic": "stick", "graz": "graze"}
    events = [(t, f, full.get(a, a), full.get(b, b)) for t, f, a, b in events if t > times[0]]
    return Solution(rows, [], events, walked.status, walked.end.t, {})


def instants(problem: Problem, scene: sp.Scene, first: Solution) -> list[float]:
    """Evenly spaced ones, without those at events and jumps."""
    begin = scene.start().time
    edges = Inputs(scene, begin, begin + scene.duration).edges[1:-1]
    avoided = np.array([*edges, *(event[0] for event in first.events), np.inf])
    end = first.end if first.status == "completed" else first.end - 1e-4
    spaced = np.union1d(np.linspace(begin, end, problem.rows), problem.creep or ())
    return [t for t in spaced.tolist() if np.abs(avoided - t).min() > APART or t == begin]


def compared(one: Solution, other: Solution) -> dict[str, float]:
    """The differences of two solutions by quantity, and that of their events, s."""
    n = min(len(one.rows), len(other.rows))
    found = differences(one.rows[:n], other.rows[:n], one.rows)
    found["events"] = event_error(lasting(one.events), lasting(other.events))
    if other.status != one.status:
        found["events"] = np.inf
    return {name: float(f"{value:.2g}") for name, value in found.items()}


def write(problem: Problem) -> None:
    """Computes a problem's solution four times and writes its three files."""
    begin = time.perf_counter()
    scene = problem.scene()
    start = scene.start()
    scene = scene.with_({"initial": sp.State(start.q, start.p, integral=start.integral)})
    own, other = ("projected", "csm") if scene.contact == "unilateral" else ("nullspace", "csm")
    main, second = (
        {"method": method, "dt": dt}
        for method, dt in zip(problem.methods, problem.steps, strict=True)
    )
    first = solved(scene, None, formulation=own, **main)
    times = instants(problem, scene, first)
    answer = solved(scene, times, formulation=own, **main)
    agreement = {
        "formulation": compared(answer, solved(scene, times, formulation=other, **main)),
        "method": compared(answer, solved(scene, times, formulation=own, **second)),
        "independent": compared(answer, independent(scene, times, problem.oracle)),
    }
    facts: dict[str, Any] = {
        "status": first.status,
        "end": first.end,
        "rows": len(answer.rows),
        "computed_by": f"{own}, {main['method']}, dt = {main['dt']:g} s",
        "checked_by": [f"{other}, {main['method']}", f"{own}, {second['method']}"],
    }
    if scene.contact == "unilateral":
        facts["holds"] = first.status == "completed" and "free" not in answer.modes[-1]
    if problem.creep is not None:
        a, b = (int(np.searchsorted(answer.rows[:, 0], t)) for t in problem.creep)
        way = answer.rows[min(b, len(answer.rows) - 1), 1:3] - answer.rows[a, 1:3]
        facts |= {"creep_between": list(problem.creep), "creep_mm": 1e3 * float(np.hypot(*way))}
        # Below a picometre it is rounding.
        facts["creep_mm"] = facts["creep_mm"] if facts["creep_mm"] > 1e-9 else 0.0
    data = {
        "name": problem.name,
        "title": problem.title,
        "version": VERSION,
        "statement": problem.statement,
        "equations": "docs/equations.md",
        "answer": {**facts, "at_the_end": first.ledger},
        "agreement": agreement,
        "scene": scene.to_dict(),
    }
    law = scene.hand.tips[0].law
    if isinstance(law, sp.MeasuredLaw):
        data["law"] = {"range": float(law.compression[-1]), "weights": law.weights.tolist()}
    folder = FOLDER / problem.name
    folder.mkdir(parents=True, exist_ok=True)
    text = "# A reference problem; ../../README.md has the rules. SI units, angles in radians.\n"
    (folder / "problem.toml").write_text(text + toml.dumps(data, "problem"), encoding="utf-8")
    table(
        folder / "solution.csv",
        [*COLUMNS, "mode_right", "mode_left"],
        ([*map(digits, row), *modes] for row, modes in zip(answer.rows, answer.modes, strict=True)),
    )
    events = [[digits(t), *rest] for t, *rest in answer.events]
    if first.status == "lost":
        events.append([digits(first.end), "object", "held", "lost"])
    table(folder / "events.csv", ["time", "finger", "before", "after"], events)
    worst = max(value for found in agreement.values() for value in found.values())
    print(f"{problem.name:24s} {worst:8.1e} {time.perf_counter() - begin:7.1f} s", flush=True)
    for name, found in agreement.items():
        print(f"    {name:14s} {found}", flush=True)


def digits(value: float) -> str:
    return f"{value:.17g}"


def table(path: Path, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_agreement() -> None:
    """agreement.csv, and the table of README.md."""
    lines, rows = [], []
    for folder in sorted(path for path in FOLDER.iterdir() if path.name in BY_NAME):
        data = tomllib.loads((folder / "problem.toml").read_text("utf-8"))
        agreement, cells = data["agreement"], []
        for check in CHECKS:
            found = agreement[check]
            for name in (*QUANTITIES, "events"):
                value = f"{found[name]:.2g}" if name in found else ""
                rows.append([data["name"], check, name, value])
            cells.append(f"{max(found.get(n, 0.0) for n in QUANTITIES):.1e}")
        events = max(found["events"] for found in agreement.values())
        ends = "holds" if data["answer"].get("holds") else data["answer"]["status"]
        moments = (folder / "events.csv").read_text("utf-8").count("\n") - 1
        cells += [str(moments), f"{events:.0e}" if moments else "-", ends]
        lines.append(f"| {data['name']} | {data['title']} | {' | '.join(cells)} |")
    table(ROOT / "agreement.csv", ["problem", "check", "quantity", "difference"], rows)
    head = (
        "| problem | | (a) formulations | (b) methods | (c) independent | events | their times, s "
        "| end |\n|---|---|---:|---:|---:|---:|---:|---|"
    )
    document("agreement", "\n".join([head, *lines]))


def document(name: str, text: str) -> None:
    """Puts text between its markers in README.md."""
    path = ROOT / "README.md"
    begin, end = f"<!-- {name} -->", "<!-- end -->"
    head, _, rest = path.read_text("utf-8").partition(begin)
    _, _, tail = rest.partition(end)
    path.write_text(f"{head}{begin}\n{text}\n{end}{tail}", encoding="utf-8")


def main() -> None:
    names = sys.argv[1:] or [*BY_NAME, *(rare.name for rare in RARES)]
    for problem in PROBLEMS:
        if problem.name in names:
            write(problem)
    for rare in RARES:
        if rare.name in names:
            write_rare(FOLDER / rare.name, rare)
    write_agreement()


if __name__ == "__main__":
    main()
