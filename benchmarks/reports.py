"""`make reports`: the measurements behind docs/error-against-run-time.md and docs/stability.md.

Makes their figures again (docs/figures), their data (results/reports), and puts the tables between
the markers `<!-- report: NAME -->` and `<!-- end -->` of the documents.
"""

import math
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from command import parser
from document import folders, map_table, put
from machine import describe, median_time
from softpinch import _core, plot, stress
from softpinch.accuracy.measurements import WHERE, Measurement, WorkPrecision
from softpinch.accuracy.runs import accurate_run
from softpinch.accuracy.stability_axes import AXES
from softpinch.run import scaled_error

LEVELS = (1e-3, 1e-6, 1e-9)

_TIP = sp.Fingertip(normal_viscosity=20, tangential_viscosity=20, youngs_modulus=0.2e6)
_FINGER = sp.Finger(inertia=2e-4)
GRASP = sp.Scene(
    hand=sp.Hand(right=_FINGER, left=_FINGER, tip=_TIP),
    control=sp.Pid(kp=50, kd=0.5, ki=500),
    duration=0.2,
)
SCENES = {
    "grasp": GRASP,
    "manipulation": sp.paper.manipulation(),
    "overdamped": stress.CASES["overdamped"].scene,
}
# What the maps vary.
HELD = sp.Scene(
    schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 4.8]])),
    duration=0.1,
)


@dataclass(frozen=True)
class Job:
    """The extent of the measurements, and the folders of figures and data.

    Attributes:
        quick: Whether it is only shown to work: short scenes and few settings.
        figures: A folder.
        data: A folder.
    """

    quick: bool
    figures: Path
    data: Path

    def few(self, **settings: Any) -> dict[str, Any]:
        """The settings, for a quick look; else none."""
        return settings if self.quick else {}


def precision(job: Job) -> Iterator[tuple[str, str]]:
    """Every pair, and the peers, on three scenes."""
    import peer_adapters

    scenes = {"grasp": replace(GRASP, duration=0.01)} if job.quick else SCENES
    for name, scene in scenes.items():
        others = peer_adapters.peers(scene)
        few = job.few(dt=[1e-3, 5e-4], tolerances=[1e-3], formulations="nullspace")
        if job.quick:
            others = [replace(peer, values=peer.values[4:5]) for peer in others[:2]]
        found = sp.work_precision(scene, peers=others, longest=0.5, progress=False, **few)
        found.save(job.data / f"work_precision_{name}.csv")
        for where in WHERE[:1] if job.quick else WHERE:
            figure = plot.work_precision(found, where=where)
            plot.save(figure, job.figures / f"work_precision_{name}_{where}.png")
        yield f"reference {name}", _reference(found)
        yield f"cheapest {name}", _cheapest(found, "end")
        yield f"cheapest along {name}", _cheapest(found, "along")
        yield f"orders {name}", _orders(found)
        if any(not row.method for row in found.rows) and not job.quick:
            figure = plot.work_precision(found, peers=True)
            plot.save(figure, job.figures / f"work_precision_{name}_peers.png")
        yield f"left out {name}", "\n".join(f"- {reason}" for reason in _brief(found)) or "Nothing."


def _brief(found: WorkPrecision) -> list[str]:
    """Settings that were left out, a line for each solver."""
    reasons: dict[str, list[str]] = {}
    for line in found.skipped:
        who, _, why = line.partition(": ")
        solver, _, setting = who.partition(", ")
        reasons.setdefault(f"{solver}: {why}", []).append(setting)
    return [
        f"{what}" + (f" ({len(settings)} settings)" if len(settings) > 1 else "")
        for what, settings in reasons.items()
    ]


def _reference(found: WorkPrecision) -> str:
    own = ", ".join(f"{name} {size:.0e}" for name, size in found.floor.items())
    return f"{found.reference}; they differ by {own.replace('multipliers', 'λ')}."


def _cheapest(found: WorkPrecision, where: str) -> str:
    """A row for each solver: the quickest setting below each level."""
    best: dict[tuple[str, str], dict[float, Measurement]] = {}
    for level in LEVELS:
        for row in found.cheapest(level, where):
            best.setdefault((row.solver, row.setting), {})[level] = row

    def quickness(item: tuple[tuple[str, str], dict[float, Measurement]]) -> float:
        return min((row.time for level, row in item[1].items() if level <= 1e-6), default=math.inf)

    quickest = {
        level: min((rows[level].time for rows in best.values() if level in rows), default=math.nan)
        for level in LEVELS
    }
    lines = [
        "| solver | steps | " + " | ".join(f"error {level:.0e}, ms" for level in LEVELS) + " |",
        "|---|---|" + "---|" * len(LEVELS),
    ]
    for (solver, setting), rows in sorted(best.items(), key=quickness):
        kind = {"dt": "equal", "tolerance": "free"}.get(setting, setting)
        cells = []
        for level in LEVELS:
            if level not in rows:
                cells.append("-")
                continue
            took = 1e3 * rows[level].time
            bold = "**" if rows[level].time == quickest[level] else ""
            cells.append(f"{bold}{took:.3g}{bold} ({rows[level].value:.1e})")
        lines.append(f"| {solver} | {kind} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _orders(found: WorkPrecision) -> str:
    """Orders of each pair in the last two halvings whose error is above the floor."""
    floor = 100.0 * max(found.floor.values())
    lines = [
        "| method (order) | " + " | ".join(_core.FORMULATIONS) + " |",
        "|---|" + "---|" * len(_core.FORMULATIONS),
    ]
    for method in _core.METHODS:
        cells = []
        for formulation in _core.FORMULATIONS:
            seen = [
                row.order
                for row in found.rows
                if (row.method, row.formulation, row.setting) == (method, formulation, "dt")
                and math.isfinite(row.order)
                and floor < row.along < 1e-2
            ]
            cells.append(", ".join(f"{order:.1f}" for order in seen[-2:]) or "-")
        lines.append(f"| {method} ({_core.ORDERS[method]}) | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def gains(job: Job) -> Iterator[tuple[str, str]]:
    """Drift and error over alpha dt, at two steps."""
    scene = replace(HELD, duration=0.01) if job.quick else HELD
    few = job.few(products=np.geomspace(1e-4, 10.0, 5))
    sweeps = [sp.stabilization_sweep(scene, dt=dt, **few) for dt in (1e-4, 3e-4)]
    plot.save(plot.stabilization_sweep(sweeps), job.figures / "gains.png")
    lines = [
        "| α dt = β dt | dt, s | largest C^H, m | largest C^N, m/s | error of q and p | of λ |",
        "|---|---|---|---|---|---|",
    ]
    for sweep in sweeps:
        for k in range(0, len(sweep.product), 4):
            if sweep.status[k] != "completed":
                cells = [sweep.status[k].replace("_", " "), "", "", ""]
            else:
                sizes = (sweep.holonomic, sweep.nonholonomic, sweep.error, sweep.multipliers)
                cells = [f"{size[k]:.1e}" for size in sizes]
            lines.append(f"| {sweep.product[k]:.1e} | {sweep.dt:.0e} | " + " | ".join(cells) + " |")
        own = sweep.without
        lines.append(
            f"| nullspace | {sweep.dt:.0e} | {own['holonomic']:.1e} | {own['nonholonomic']:.1e} | "
            f"{own['q and p']:.1e} | {own['multipliers']:.1e} |"
        )
    yield "gains", "\n".join(lines)


def maps(job: Job) -> Iterator[tuple[str, str]]:
    """A map along each axis, and the longest steps of the scene itself."""
    scene = replace(HELD, duration=0.01) if job.quick else HELD
    lines = ["| formulation, method | predicted, s | measured, s | |", "|---|---|---|---|"]
    for formulation in _core.FORMULATIONS:
        for method in _core.METHODS:
            step = sp.max_stable_dt(scene, method, formulation, measure=not job.quick)
            measured = "-" if step.measured is None else f"{step.measured:.3g}"
            predicted = "any" if math.isinf(step.predicted) else f"{step.predicted:.3g}"
            why = step.message.partition("they part because ")[2] or (
                "" if math.isinf(step.predicted) else f"the mode of {step.mode}"
            )
            lines.append(f"| {formulation} {method} | {predicted} | {measured} | {why} |")
    yield "longest steps", "\n".join(lines)
    few = job.few(values=[1e5, 1e6], dt=[1e-4, 1e-3], pairs=[("nullspace", "rk4")])
    for axis in ["youngs_modulus"] if job.quick else AXES:
        begin = time.perf_counter()
        found = sp.stability_map(scene, axis, progress=False, **few)
        found.save(job.data / f"stability_{axis}.csv")
        plot.save(plot.stability_map(found), job.figures / f"stability_{axis}.png")
        print(f"    {axis}: {time.perf_counter() - begin:.0f} s", flush=True)
        yield f"map {axis}", map_table(found.summary())


def hard(job: Job) -> Iterator[tuple[str, str]]:
    """Every stress scene by every pair: error at the end and time, or the status."""
    cases = _cases(job)
    for setting in ("dt", "tolerance"):
        methods = _core.METHODS if setting == "dt" else _core.ADAPTIVE_METHODS
        lines = [
            "| scene | formulation | " + " | ".join(methods) + " |",
            "|---|---|" + "---|" * len(methods),
        ]
        for name, case in cases.items():
            value = case.dt if setting == "dt" else 1e-6
            label = f"{name}" + (f", dt = {case.dt:g} s" if setting == "dt" else "")
            exact = accurate_run(
                case.scene, tolerance=1e-12, record=("state",), stabilization=case.stabilization
            )
            for formulation in _core.FORMULATIONS:
                cells = [
                    _outcome(case, formulation, method, {setting: value}, exact)
                    for method in methods
                ]
                lines.append(f"| {label} | {formulation} | " + " | ".join(cells) + " |")
                label = ""
        yield f"stress {setting}", "\n".join(lines)
    lines = ["| scene | why it is hard |", "|---|---|"]
    lines += [f"| {name} | {case.why} |" for name, case in stress.CASES.items()]
    yield "stress scenes", "\n".join(lines)


def _cases(job: Job) -> dict[str, stress.StressCase]:
    """The stress scenes that do not take too long."""
    short = {name: case for name, case in stress.CASES.items() if not case.long}
    return {"overdamped": short["overdamped"]} if job.quick else short


def _outcome(
    case: stress.StressCase, formulation: str, method: str, how: dict[str, float], exact: sp.Run
) -> str:
    def run() -> sp.Run:
        return sp.simulate(
            case.scene,
            method=method,
            formulation=formulation,
            stabilization=case.stabilization,
            every=10**9,
            **how,  # type: ignore[arg-type]
        )

    found = run()
    took = f"{1e3 * median_time(run, 5, timer=time.thread_time):.2g} ms"
    if found.status != exact.status:
        return f"*{found.status.replace('_', ' ')}*"
    if not found.success:
        return f"{found.status}, {took}"
    error = max(
        float(
            scaled_error.by_row(
                getattr(found, name)[-1],
                getattr(exact, name)[-1],
                scaled_error.scales(name, getattr(exact, name)),
            )
        )
        for name in ("q", "p")
    )
    return f"{error:.0e}, {took}" if error < 1e-2 else f"*{error:.0e}*"


def advice(job: Job) -> Iterator[tuple[str, str]]:
    """Advice of `advise` for the paper's scenes and for the hard ones."""
    lines = [
        "| scene | take | error of q, p, λ | a run, ms | the best equal steps | ms | found in, s |",
        "|---|---|---|---|---|---|---|",
    ]
    if job.quick:
        scenes = {"grasp": (replace(GRASP, duration=0.02), sp.Stabilization())}
    else:
        papers = {f"disturbance {c}": sp.paper.disturbance(c) for c in sp.paper.CASES}
        papers = {"the paper's manipulation": sp.paper.manipulation(), **papers}
        scenes = {name: (scene, sp.Stabilization()) for name, scene in papers.items()}
        scenes |= {name: (case.scene, case.stabilization) for name, case in _cases(job).items()}
    for name, (scene, gains) in scenes.items():
        begin = time.perf_counter()
        found = sp.advise(scene, 1e-6, stabilization=gains, progress=False)
        took = time.perf_counter() - begin
        sizes = ", ".join(f"{size:.0e}" for size in found.error.values())
        equal = found.equal
        assert equal is not None
        setting = f"{equal.formulation} {equal.method} {equal.setting}" if equal.found else "-"
        least = f"{1e3 * equal.time:.2g}" if equal.found else f"over {1e3 * equal.time:.2g}"
        step = f"dt={found.dt:.2e}" if found.dt else f"tolerance={found.step_tolerance:.0e}"
        lines.append(
            f"| {name} | {found.formulation} {found.method} {step} | {sizes} | "
            f"{1e3 * found.time:.2g} | {setting} | {least} | {took:.1f} |"
        )
    yield "advice", "\n".join(lines)


PARTS: dict[str, Callable[[Job], Iterator[tuple[str, str]]]] = {
    "precision": precision,
    "gains": gains,
    "maps": maps,
    "stress": hard,
    "advice": advice,
}


def main() -> None:
    given = parser(__doc__, list(PARTS)).parse_args()
    import peer_adapters

    warnings.simplefilter("ignore", sp.StabilityWarning)
    print(describe(missing=peer_adapters.MISSING), flush=True)
    if not given.quick:
        put("machine", "```\n" + describe().rstrip() + "\n```")
    with folders(given.quick) as (figures, data):
        job = Job(given.quick, figures, data)
        for part in given.part or PARTS:
            begin = time.perf_counter()
            print(part, flush=True)
            for name, text in PARTS[part](job):
                (data / f"{name.replace(' ', '_')}.md").write_text(text + "\n", encoding="utf-8")
                if given.quick:
                    print(text)
                else:
                    put(name, text)
                print(f"  {name}: {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
