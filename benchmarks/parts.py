"""What jaws, other sides, other laws and branches cost a step, beside the paper's hand.

make bench-parts
"""

import time
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np

import softpinch as sp
from command import parser
from machine import describe

SPRINGS = sp.Fingertip()
CURVE = np.linspace(1e-3, 0.012, 12)
STIFF = sp.Pid(kp=2e4, kd=200.0, ki=2e5)
DISC = sp.GraspedObject.disc(diameter=0.049, mass=0.1)
# The kind, and its part of a scene. All press with about as much.
KINDS: dict[str, dict[str, Any]] = {
    "the paper's hand": {},
    "power law": {"hand": sp.Hand(tip=replace(SPRINGS, law=sp.PowerLaw(164033.0, 1.67, 1e-4)))},
    "measured law": {
        "hand": sp.Hand(tip=replace(SPRINGS, law=sp.MeasuredLaw(CURVE, np.pi * 3e5 * CURVE**2)))
    },
    "branch": {"hand": sp.Hand(tip=replace(SPRINGS, relaxation=sp.Maxwell(0.4, 0.05)))},
    "tilted faces": {"grasped": sp.GraspedObject(right=sp.Face(tilt=0.02), left=sp.Face())},
    "arcs": {"grasped": DISC},
    "parallelograms": {"hand": sp.Hand(right=sp.Parallelogram(), left=sp.Parallelogram())},
    "jaws": {
        "hand": sp.Hand(right=sp.Jaw(), left=sp.Jaw()),
        "control": STIFF,
        "schedule": sp.Schedule.steps([0.0], [[4e-3, 4e-3]]),
    },
    "joints that rub": {"hand": sp.Hand(right=sp.Finger(joint_friction=0.02))},
    "jaws with measured tips on a disc": {
        "hand": sp.Hand(
            right=sp.Jaw(),
            left=sp.Jaw(),
            tip=replace(SPRINGS, law=sp.MeasuredLaw(CURVE, np.pi * 3e5 * CURVE**2)),
        ),
        "control": STIFF,
        "schedule": sp.Schedule.steps([0.0], [[4e-3, 4e-3]]),
        "grasped": DISC,
    },
}
HOW: dict[str, dict[str, Any]] = {
    "rk4": {"dt": 1e-4},
    "rk4, unilateral": {"dt": 1e-4, "contact": "unilateral"},
    "dop853": {"tolerance": 1e-6, "method": "dop853"},
    "rosenbrock": {"dt": 1e-3, "method": "rosenbrock"},
}


def scene_of(kind: str, contact: str, duration: float) -> sp.Scene:
    parts = {"initial": "touching", "friction": 0.8, **KINDS[kind]}
    return sp.Scene(**parts, contact=contact, duration=duration)  # type: ignore[arg-type]


def spent(kind: str, runs: int, duration: float, contact: str = "bilateral", **how: Any) -> float:
    """Processor time of a step of a run, s; `runs` in lanes of one thread, or a run alone."""
    scene = scene_of(kind, contact, duration)
    if runs == 1:
        begin = time.process_time()
        steps = sp.simulate(scene, every=10**9, **how).stats["steps"]
        return (time.process_time() - begin) / steps
    masses = np.linspace(0.08, 0.12, runs)
    begin = time.process_time()
    many = sp.monte_carlo(
        scene,
        vary={"grasped.mass": masses},
        threads=1,
        progress=False,
        summaries="final_state",
        **how,
    )
    assert (many.status == "completed").all(), many.counts()
    return (time.process_time() - begin) / float(many.steps.sum())


def table(runs: int, duration: float, turns: int) -> str:
    """Times of each kind as rows, and their ratios to the paper's hand."""
    names, rows = list(KINDS), []
    times: dict[tuple[str, str], list[float]] = {}
    for _ in range(turns):
        for how, given in HOW.items():
            for kind in names:
                times.setdefault((kind, how), []).append(spent(kind, runs, duration, **given))
    for kind in names:
        cells = []
        for how in HOW:
            own, first = (median(times[name, how]) for name in (kind, names[0]))
            cells.append(f"{1e9 * own:.0f} ({own / first:.2f})")
        rows.append(f"| {kind} | {' | '.join(cells)} |")
    where = "alone" if runs == 1 else "in lanes"
    head = f"| {where} | {' | '.join(HOW)} |\n|---|{'---:|' * len(HOW)}"
    return "\n".join([head, *rows])


def main() -> None:
    options = parser(__doc__).parse_args()
    turns, runs, duration = (1, 16, 0.004) if options.quick else (5, 256, 0.05)
    print(describe())
    print("processor time of a step of a run, ns (and as a share of the first row's)")
    for count in (runs, 1):
        print(table(count, duration, turns), "\n")


if __name__ == "__main__":
    main()
