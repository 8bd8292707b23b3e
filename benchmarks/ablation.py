"""What each part of a scene costs: from a full one to the smallest, one thing after the other.

make bench-ablation

Writes the tables of docs/what-a-scene-pays.md, docs/figures/ablation.png, and all numbers as JSON
into results/reports. Give it an idle core: it keeps to the last one that it may use.
"""

import itertools
import json
import math
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

import softpinch as sp
from command import parser
from document import ROOT, folders, put
from machine import clock, describe
from operation_counts import Cost, cost
from softpinch import _core, plot
from softpinch.plot.style import BLUE, PAGE, RED, new

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DT = 1e-4
DURATION = 1.0
FORMULATIONS = ("csm", "nullspace")
# Runs of an ensemble: every lane is taken many times, and making the runs is a small part.
RUNS = 128
LAST_ONLY = 10**9
CONTROL = "nothing (the same once more)"


# Levels whose distance from the machine is looked at.
SHOWN = {
    "full, nothing recorded": "states, energies of every step",
    "undisturbed": "moving targets",
    "smallest": "finger angles and PID (driven)",
}


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked of the core.

    Attributes:
        scene: What to simulate.
        record: What a lone run keeps.
        every: Every how many steps.
        summaries: What an ensemble keeps.
    """

    scene: sp.Scene
    record: Sequence[str] = ("state",)
    every: int = LAST_ONLY
    summaries: Sequence[str] = ("final_state",)

    def alone(self, formulation: str) -> sp.Run:
        return sp.simulate(
            self.scene, dt=DT, formulation=formulation, record=self.record, every=self.every
        )

    def lanes(self, formulation: str, runs: int) -> sp.Ensemble:
        masses = self.scene.grasped.mass * np.linspace(0.9, 1.1, runs)
        return sp.monte_carlo(
            self.scene,
            runs=runs,
            vary={"grasped.mass": masses},
            dt=DT,
            formulation=formulation,
            summaries=self.summaries,
            threads=1,
            progress=False,
        )

    def counted(self, formulation: str) -> Cost:
        return cost(self.scene, formulation, ledger="energy" in self.record)


def _scene(task: Task, **changes: Any) -> Task:
    return replace(task, scene=replace(task.scene, **changes))


def _tips(task: Task, **changes: Any) -> Task:
    hand = task.scene.hand
    tips = hand.tip if isinstance(hand.tip, tuple) else (hand.tip, hand.tip)
    right, left = (replace(tip, **changes) for tip in tips)
    return _scene(task, hand=replace(hand, tip=(right, left)))


def _without(task: Task, kind: type[sp.Disturbance]) -> Task:
    rest = tuple(one for one in task.scene.disturbances if not isinstance(one, kind))
    return _scene(task, disturbances=rest)


def full() -> Task:
    """Everything at once: unequal fingers that move all the time, and all that can push."""
    move = DURATION / 10
    # The first angles hold until the second time: so that one is the start.
    times = move * np.arange(-1, 10)
    back_and_forth = np.where(np.arange(11)[:, None] % 2, [[10.0, 9.0]], [[6.0, 6.0]])
    scene = sp.Scene(
        hand=sp.Hand(
            right=sp.Finger(length=0.077, mass=0.11, inertia=6e-4),
            tip=(
                sp.Fingertip(radius=0.0205, youngs_modulus=0.32e6),
                sp.Fingertip(normal_viscosity=90.0),
            ),
        ),
        grasped=sp.GraspedObject(com_offset=0.001),
        schedule=sp.Schedule.minimum_jerk(times, np.deg2rad(back_and_forth), move),
        disturbances=(
            sp.Step(time=0.35, force=(0.5, -0.3), moment=0.01),
            sp.Sine(frequency_hz=12.0, force=(0.3, 0.2), moment=0.005),
            sp.Noise(force_std=0.1, moment_std=0.002, rate_hz=100.0),
        ),
        duration=DURATION,
        initial="touching",
    )
    return Task(
        scene,
        record=("state", "multipliers", "residuals", "energy", "torque"),
        every=1,
        summaries=("final_state", *_core.SUMMARIES),
    )


# What is left out, in this order; each from what the one before has left.
LEVELS: tuple[tuple[str, Callable[[Task], Task]], ...] = (
    (
        "λ, C, torques of every step; summaries",
        lambda task: replace(
            task, record=("state", "energy"), summaries=("final_state", "energy_closure")
        ),
    ),
    ("states, energies of every step", lambda task: replace(task, every=LAST_ONLY)),
    (
        "energy ledger",
        lambda task: replace(task, record=("state",), summaries=("final_state",)),
    ),
    ("noise, 100 samples/s", lambda task: _without(task, sp.Noise)),
    ("sine force", lambda task: _without(task, sp.Sine)),
    ("step force", lambda task: _without(task, sp.Step)),
    (
        "moving targets",
        lambda task: _scene(task, schedule=sp.Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]]))),
    ),
    ("integral gain K_I", lambda task: _scene(task, control=replace(sp.Pid(), ki=0.0))),
    ("viscosity", lambda task: _tips(task, normal_viscosity=0.0, tangential_viscosity=0.0)),
    ("gravity", lambda task: _scene(task, gravity=0.0)),
    ("tilt coupling κ", lambda task: _tips(task, tilt_coupling=0.0)),
    (
        "unequal fingers, offset w",
        lambda task: _scene(
            task,
            hand=sp.Hand(tip=task.scene.hand.tip[1]),  # type: ignore[index]
            grasped=sp.GraspedObject(),
        ),
    ),
    (
        "finger angles and PID (driven)",
        lambda task: _scene(task, fingers="driven", initial=None),
    ),
    (CONTROL, lambda task: task),
)


@dataclass(frozen=True)
class Saving:
    """A level beside the one before it.

    Attributes:
        nanoseconds: A step takes, the median.
        saved: Share of the time of the level before that it saves: quartiles and median; none at
            the first level.
        measurable: Whether the quartiles exclude zero, and the median is beyond those of the same
            call timed against itself.
    """

    nanoseconds: float
    saved: tuple[float, float, float] | None = None
    measurable: bool = False


@dataclass
class Found:
    """What was measured of a formulation, level by level.

    Attributes:
        names: What each leaves out.
        operations: Floating-point operations of a step.
        chains: Cycles of a step's longest chain.
        alone: Of a lone run.
        lanes: Of a run among others.
    """

    names: list[str]
    operations: list[int] = field(default_factory=list)
    chains: list[int] = field(default_factory=list)
    alone: list[Saving] = field(default_factory=list)
    lanes: list[Saving] = field(default_factory=list)


def tasks() -> dict[str, Task]:
    """The full scene, and what each level leaves."""
    found = {"": full()}
    for name, leave_out in LEVELS:
        found[name] = leave_out(list(found.values())[-1])
    return found


def measure(levels: Mapping[str, Task], formulation: str, runs: int, rounds: int) -> Found:
    """Every level alone and in lanes, in turns."""
    found = Found(list(levels))
    for task in levels.values():
        told = task.counted(formulation)
        found.operations.append(told.step)
        found.chains.append(told.chain)
    steps, works = [], []
    for task in levels.values():
        run = task.alone(formulation)
        if not run.success:
            raise RuntimeError(f"{formulation}: {run.status}, {run.message}")
        steps.append(run.stats["steps"])
        works.append(partial(task.alone, formulation))
    found.alone = _savings(clock(works, rounds, math.inf), steps)
    steps, works = [], []
    for task in levels.values():
        ensemble = task.lanes(formulation, runs)
        if len(ensemble.failures()):
            raise RuntimeError(f"{formulation}: {ensemble.failures()[0].message}")
        steps.append(int(ensemble.steps.sum()))
        works.append(partial(task.lanes, formulation, runs))
    found.lanes = _savings(clock(works, rounds, math.inf), steps)
    return found


def _savings(spent: Sequence[np.ndarray], steps: Sequence[int]) -> list[Saving]:
    """Of each level, from times (rounds,) that were taken in turns; the last is the control."""
    each = [1e9 * times / count for times, count in zip(spent, steps, strict=True)]
    shares = [
        np.quantile(1.0 - after / before, (0.25, 0.5, 0.75)).tolist()
        for before, after in itertools.pairwise(each)
    ]
    noise = max(abs(share) for share in shares[-1])
    medians = [float(np.median(times)) for times in each]
    return [
        Saving(medians[0]),
        *(
            Saving(median, (low, middle, high), low * high > 0.0 and abs(middle) > noise)
            for median, (low, middle, high) in zip(medians[1:], shares, strict=True)
        ),
    ]


@dataclass(frozen=True)
class Peak:
    """What one core reaches with the numbers of a level.

    Attributes:
        gflops: Of multiply-adds side by side.
        chained: ns of a multiply-add that waits for the one before.
    """

    gflops: float
    chained: float


def peaks() -> dict[str, Peak]:
    """By level of instructions; none without cargo."""
    if shutil.which("cargo") is None:
        return {}
    example = ["--release", "--quiet", "--package", "softpinch", "--example", "peak"]
    subprocess.run(["cargo", "build", *example], cwd=ROOT, check=True)
    _keep_to_one_core()
    done = subprocess.run(
        ["cargo", "run", *example], cwd=ROOT, check=True, capture_output=True, text=True
    )
    rows = re.findall(
        r"^(scalar|avx2|avx512) +\d+ +([\d.]+) +[\d.]+ +([\d.]+)", done.stdout, re.MULTILINE
    )
    return {level: Peak(float(gflops), float(chained)) for level, gflops, chained in rows}


def _keep_to_one_core() -> None:
    """Moving between cores costs what a term does."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def table(found: Found, formulation: str) -> str:
    lines = [
        f"| `{formulation}`, left out | operations a step | alone, ns a step | saves, % | "
        "in lanes, ns a step of a run | saves, % |",
        "|---|---:|---:|---|---:|---|",
    ]
    for k, name in enumerate(found.names):
        cells = [name or "nothing: the full scene", str(found.operations[k])]
        for saving in (found.alone[k], found.lanes[k]):
            cells += [f"{saving.nanoseconds:.1f}", _percent(saving)]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _percent(saving: Saving) -> str:
    """Median and quartiles; bold where that is measurable."""
    if saving.saved is None:
        return ""
    low, middle, high = (f"{100.0 * part:z.1f}".replace("-", "−") for part in saving.saved)
    bold = "**" if saving.measurable else ""
    return f"{bold}{middle}{bold} ({low} to {high})"


def distance(results: Mapping[str, Found], peak: Mapping[str, Peak]) -> str:
    """Share of the machine's peak that some levels reach, and of a lone step its longest chain."""
    lines = [
        "| scene | how | operations a step | Gflop/s | share of the peak | "
        "longest chain, share of the step |",
        "|---|---|---:|---:|---:|---:|",
    ]
    missing = "not measured"
    for formulation, found in results.items():
        for name, level in SHOWN.items():
            k = found.names.index(level)
            ways = (("alone", "scalar", found.alone), ("lanes", _core.simd_level(), found.lanes))
            for how, simd, savings in ways:
                most, waiting = peak.get(simd), peak.get("scalar")
                count, taken = found.operations[k], savings[k].nanoseconds
                share = missing if most is None else f"{100 * count / taken / most.gflops:.0f} %"
                chain = ""
                if how == "alone":
                    # A multiply-add that waits for another takes four cycles.
                    cycle = None if waiting is None else 0.25 * waiting.chained
                    chain = (
                        missing
                        if cycle is None
                        else f"{100 * found.chains[k] * cycle / taken:.0f} %"
                    )
                cells = [f"`{formulation}`, {name}", how, str(count), f"{count / taken:.1f}"]
                lines.append("| " + " | ".join([*cells, share, chain]) + " |")
    if peak:
        tops = ", ".join(f"{level} {top.gflops:.1f}" for level, top in peak.items())
        lines += ["", f"The peak of one core, Gflop/s: {tops}."]
    return "\n".join(lines)


def chart(results: Mapping[str, Found]) -> Any:
    """ns a step by level, alone and in lanes; what a level saves where that is measurable."""
    with plot.styled():
        names = next(iter(results.values())).names
        shown = [k for k, name in enumerate(names) if name != CONTROL]
        figure = new(PAGE, 0.34 * len(shown) + 0.9)
        axes = figure.subplots(1, 2, sharey=True)
        for each, kind, title in (
            (axes[0], "alone", "(a) a run alone"),
            (axes[1], "lanes", f"(b) in lanes ({_core.simd_level()})"),
        ):
            _bars(each, {f: getattr(found, kind) for f, found in results.items()}, shown)
            each.set_title(title, loc="left", pad=3.0)
        axes[0].set_xlabel("time of a step, ns")
        axes[1].set_xlabel("time of a step of one run, ns")
        axes[0].set_yticks(
            range(len(shown)),
            [f"− {names[k].replace('K_I', '$K_I$')}" if names[k] else "full scene" for k in shown],
        )
        axes[0].invert_yaxis()
        figure.supxlabel(
            "Each row leaves out one thing more than the row above. "
            "Numbers: against the row above, where that is measurable.",
            fontsize=7.5,
        )
        figure.legend(
            *axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=len(results)
        )
    return figure


def _bars(axes: "Axes", results: Mapping[str, Sequence[Saving]], shown: Sequence[int]) -> None:
    looks: tuple[dict[str, Any], ...] = (
        {"facecolor": BLUE, "edgecolor": BLUE},
        # Hatched, so that the two stay apart in grey.
        {"facecolor": "white", "edgecolor": RED, "hatch": "/////"},
    )
    rows = np.arange(len(shown))
    height = 0.38
    longest = max(saving.nanoseconds for savings in results.values() for saving in savings)
    for k, ((formulation, savings), look) in enumerate(zip(results.items(), looks, strict=True)):
        place = rows + (k - 0.5) * height
        widths = [savings[level].nanoseconds for level in shown]
        axes.barh(place, widths, height=0.9 * height, linewidth=0.6, label=formulation, **look)
        for y, level in zip(place, shown, strict=True):
            saving = savings[level]
            if saving.saved is not None and saving.measurable:
                text = f"{-100.0 * saving.saved[1]:+.1f} %".replace("-", "−")
                axes.text(saving.nanoseconds + 0.012 * longest, y, text, va="center", fontsize=6.5)
    axes.set_xlim(0.0, 1.16 * longest)
    axes.set_ylim(-0.6, len(shown) - 0.4)
    axes.tick_params(axis="y", length=0.0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    # A quick look leaves out the machine's peak, which would have to be built first.
    peak = {} if quick else peaks()
    _keep_to_one_core()
    levels = tasks()
    runs, rounds = (8, 1) if quick else (RUNS, 31)
    results = {name: measure(levels, name, runs, rounds) for name in FORMULATIONS}
    texts = {
        "ablation machine": "```\n" + describe() + "\n```",
        "ablation": "\n\n".join(table(found, name) for name, found in results.items()),
        "ablation peak": distance(results, peak),
    }
    facts = {
        "machine": describe(),
        "dt": DT,
        "runs": runs,
        "rounds": rounds,
        "peak": {level: asdict(top) for level, top in peak.items()},
        "formulations": {name: asdict(found) for name, found in results.items()},
    }
    with folders(quick) as (figures, data):
        (data / "ablation.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
        plot.save(chart(results), figures / "ablation.png")
    for name, text in texts.items():
        print(f"{text}\n")
        if not quick:
            put(name, text)


if __name__ == "__main__":
    main()
