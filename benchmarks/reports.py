"""`make reports`: the measurements behind docs/error-against-run-time.md and docs/stability.md.

Makes their figures again (docs/figures), their data (OUT), and puts the tables between the markers
`<!-- report: NAME -->` and `<!-- end -->` of the documents. Parts can be named: `python
benchmarks/reports.py precision gains maps stress advice`.
"""

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import softpinch as sp
from machine import describe
from softpinch import _core, _error, plot, stress
from softpinch.measurements import WHERE, Measurement, WorkPrecision
from softpinch.stability import trusted_run
from softpinch.stability_axes import AXES

ROOT = Path(__file__).parent.parent
FIGURES = ROOT / "docs" / "figures"
OUT = ROOT / "results" / "reports"
DOCUMENTS = (
    "error-against-run-time.md",
    "scale-out.md",
    "stability.md",
    "what-a-scene-pays.md",
)
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


def precision() -> Iterator[tuple[str, str]]:
    """Every pair, and the peers, on three scenes."""
    for name, scene in SCENES.items():
        others = peers(scene)
        found = sp.work_precision(scene, peers=others, longest=0.5, progress=False)
        found.save(OUT / f"work_precision_{name}.csv")
        for where in WHERE:
            figure = plot.work_precision(found, where=where)
            plot.save(figure, FIGURES / f"work_precision_{name}_{where}.png")
        yield f"reference {name}", _reference(found)
        yield f"cheapest {name}", _cheapest(found, "end")
        yield f"cheapest along {name}", _cheapest(found, "along")
        yield f"orders {name}", _orders(found)
        if any(not row.method for row in found.rows):
            plot.save(
                plot.work_precision(found, peers=True), FIGURES / f"work_precision_{name}_peers.png"
            )
        yield f"left out {name}", "\n".join(f"- {reason}" for reason in _brief(found)) or "Nothing."


def peers(scene: sp.Scene) -> list[sp.Peer]:
    """Those that are installed and take this scene."""
    try:
        import peer_adapters
    except ImportError as reason:
        print(f"  no peers: {reason}")
        return []
    return peer_adapters.peers(scene)


def _brief(found: WorkPrecision) -> list[str]:
    """What was left out, a line for each solver."""
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
    """Of each pair the orders of the last two halvings whose error is above the floor."""
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
                and floor < row.error < 1e-2
            ]
            cells.append(", ".join(f"{order:.1f}" for order in seen[-2:]) or "-")
        lines.append(f"| {method} ({_core.ORDERS[method]}) | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def gains() -> Iterator[tuple[str, str]]:
    """Drift and error over alpha dt, at two steps."""
    sweeps = [sp.stabilization_sweep(HELD, dt=dt) for dt in (1e-4, 3e-4)]
    plot.save(plot.stabilization_sweep(sweeps), FIGURES / "gains.png")
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


def maps() -> Iterator[tuple[str, str]]:
    """A map along each axis, and the longest steps of the scene itself."""
    lines = ["| formulation, method | predicted, s | measured, s | |", "|---|---|---|---|"]
    for formulation in _core.FORMULATIONS:
        for method in _core.METHODS:
            step = sp.max_stable_dt(HELD, method, formulation)
            measured = "-" if step.measured is None else f"{step.measured:.3g}"
            predicted = "any" if math.isinf(step.predicted) else f"{step.predicted:.3g}"
            why = step.message.partition("they part because ")[2] or (
                "" if math.isinf(step.predicted) else f"the mode of {step.mode}"
            )
            lines.append(f"| {formulation} {method} | {predicted} | {measured} | {why} |")
    yield "longest steps", "\n".join(lines)
    for axis in AXES:
        begin = time.perf_counter()
        found = sp.stability_map(HELD, axis, progress=False)
        found.save(OUT / f"stability_{axis}.csv")
        plot.save(plot.stability_map(found), FIGURES / f"stability_{axis}.png")
        print(f"    {axis}: {time.perf_counter() - begin:.0f} s", flush=True)
        yield f"map {axis}", "\n".join(f"- {line}" for line in found.summary())


def hard() -> Iterator[tuple[str, str]]:
    """Every stress scene by every pair: error at the end and time, or the status."""
    for setting in ("dt", "tolerance"):
        methods = _core.METHODS if setting == "dt" else _core.ADAPTIVE_METHODS
        lines = [
            "| scene | formulation | " + " | ".join(methods) + " |",
            "|---|---|" + "---|" * len(methods),
        ]
        for name, case in stress.CASES.items():
            if case.long:
                continue
            value = case.dt if setting == "dt" else 1e-6
            label = f"{name}" + (f", dt = {case.dt:g} s" if setting == "dt" else "")
            exact = trusted_run(
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

    found, times = run(), []
    for _ in range(5):
        begin = time.thread_time()
        run()
        times.append(time.thread_time() - begin)
    took = f"{1e3 * float(np.median(times)):.2g} ms"
    if found.status != exact.status:
        return f"*{found.status.replace('_', ' ')}*"
    if not found.success:
        return f"{found.status}, {took}"
    error = max(
        float(
            _error.by_row(
                getattr(found, name)[-1],
                getattr(exact, name)[-1],
                _error.scales(name, getattr(exact, name)),
            )
        )
        for name in ("q", "p")
    )
    return f"{error:.0e}, {took}" if error < 1e-2 else f"*{error:.0e}*"


def advice() -> Iterator[tuple[str, str]]:
    """What `advise` says of the paper's scenes and of the hard ones."""
    lines = [
        "| scene | take | dt, s | expected error of q, p, λ | a run, ms | found in, s |",
        "|---|---|---|---|---|---|",
    ]
    scenes = {
        "the paper's manipulation": (sp.paper.manipulation(), sp.Stabilization()),
        **{
            f"disturbance {c}": (sp.paper.disturbance(c), sp.Stabilization())
            for c in sp.paper.CASES
        },
        **{n: (c.scene, c.stabilization) for n, c in stress.CASES.items() if not c.long},
    }
    for name, (scene, gains) in scenes.items():
        begin = time.perf_counter()
        found = sp.advise(scene, 1e-6, stabilization=gains)
        took = time.perf_counter() - begin
        sizes = ", ".join(f"{size:.0e}" for size in found.error.values())
        lines.append(
            f"| {name} | {found.formulation} {found.method} | {found.dt:.2e} | {sizes} | "
            f"{1e3 * found.time:.2g} | {took:.1f} |"
        )
    yield "advice", "\n".join(lines)


PARTS: dict[str, Callable[[], Iterator[tuple[str, str]]]] = {
    "precision": precision,
    "gains": gains,
    "maps": maps,
    "stress": hard,
    "advice": advice,
}


def put(name: str, text: str) -> None:
    """Between its markers, in whichever document has them."""
    begin, end = f"<!-- report: {name} -->", "<!-- end -->"
    for document in DOCUMENTS:
        path = ROOT / "docs" / document
        body = path.read_text(encoding="utf-8")
        if begin in body:
            head, _, rest = body.partition(begin)
            _, _, tail = rest.partition(end)
            path.write_text(f"{head}{begin}\n{text}\n{end}{tail}", encoding="utf-8")


def main() -> None:
    warnings.simplefilter("ignore", sp.StabilityWarning)
    OUT.mkdir(parents=True, exist_ok=True)
    put("machine", "```\n" + describe().rstrip() + "\n```")
    for part in sys.argv[1:] or PARTS:
        begin = time.perf_counter()
        print(part, flush=True)
        for name, text in PARTS[part]():
            put(name, text)
            (OUT / f"{name.replace(' ', '_')}.md").write_text(text + "\n", encoding="utf-8")
            print(f"  {name}: {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
