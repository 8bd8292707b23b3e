"""Probability that a grasp holds with real friction: README's study, for mu from 0.3 to 2.

make bench-odds

Simulates the study with unilateral contact for each coefficient of friction, and with the paper's
bilateral contact for its bounds. Writes the tables of docs/unilateral.md, docs/figures/odds.png,
and all numbers as JSON into results/reports.
"""

import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

import softpinch as sp
from command import parser
from document import folders, put
from machine import describe
from softpinch import plot
from softpinch.plot.style import BLACK, BLUE, GREEN, PAGE, RED, panels, tag

SEED = 7
DT = 2e-4
RUNS = 5000
PUSH = 1.0  # s, the start of the push
FRICTION = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)
# The step is halved for these.
HALVED = (0.5, 1.0)
SCENE = replace(sp.paper.disturbance("ii", duration=1.5), grasped=sp.GraspedObject(height=0.049))
VARY: dict[str, Any] = {
    "grasped.mass": sp.Normal(0.1, 0.01),
    "hand.tip.youngs_modulus": sp.LogUniform(2e5, 5e5),
    "disturbances.0.force": sp.Uniform((-300, -300), (300, 300)),
}
# Name -> mass of the tips' surfaces, kg; None is the object's, (14).
TIPS = {"as heavy as the object (14)": None, "10 g": 0.01}


@dataclass
class Odds:
    """The outcomes of one study with one kind of tip.

    Attributes:
        completes: Bilateral contact: the run reaches its end.
        never_pulls: Bilateral contact: and no tip pulls from the push on.
        sticks: mu -> bilateral contact: and no tip needs more friction either.
        holds: mu -> unilateral contact: the grasp holds.
        undisturbed: mu -> unilateral contact: the grasp holds, and no tip ever slips or opens.
        contradictions: Runs that hold in unilateral contact and do not complete in bilateral
            contact, summed over mu.
        changed: mu -> the runs whose outcome changes when the step is halved.
    """

    completes: sp.Estimate
    never_pulls: sp.Estimate
    sticks: dict[float, sp.Estimate] = field(default_factory=dict)
    holds: dict[float, sp.Estimate] = field(default_factory=dict)
    undisturbed: dict[float, sp.Estimate] = field(default_factory=dict)
    contradictions: int = 0
    changed: dict[float, int] = field(default_factory=dict)


def scene(mass: float | None, **changes: Any) -> sp.Scene:
    tip = sp.Fingertip(normal_mass=mass, tangential_mass=mass)
    return replace(SCENE, hand=replace(SCENE.hand, tip=tip), **changes)


def study(
    given: sp.Scene, runs: int, summaries: Sequence[str], dt: float = DT, **more: Any
) -> sp.Ensemble:
    return sp.monte_carlo(
        given,
        runs=runs,
        seed=SEED,
        dt=dt,
        vary=VARY | more,
        summaries=tuple(summaries),
        summaries_after=PUSH,
        progress=False,
    )


def measure(mass: float | None, frictions: Sequence[float], runs: int) -> Odds:
    bilateral = study(scene(mass), runs, ("peak_friction_ratio",))
    completed = bilateral.happened("completed")
    # The ratio is infinite in runs in which a tip pulls.
    needed = np.where(completed, bilateral["peak_friction_ratio"], np.inf)
    found = Odds(
        completes=bilateral.probability("completed"),
        never_pulls=bilateral.probability(np.isfinite(needed)),
    )
    for mu in frictions:
        given = scene(mass, contact="unilateral", friction=mu)
        each = study(given, runs, ("final_state",))
        quiet = each.holds & ~(each.happened("slipping") | each.happened("opened"))
        found.sticks[mu] = bilateral.probability(needed <= mu)
        found.holds[mu] = each.probability("holds")
        found.undisturbed[mu] = each.probability(quiet)
        found.contradictions += int(np.count_nonzero(each.holds & ~completed))
        if mu in HALVED:
            again = study(given, runs, ("final_state",), dt=DT / 2)
            found.changed[mu] = int(np.count_nonzero(again.holds != each.holds))
    return found


def effects(runs: int) -> tuple[dict[str, sp.Effect], dict[str, tuple[float, int]]]:
    """Shares of the variance of "holds", friction varied too; and how often pushes are held."""
    given = scene(TIPS["10 g"], contact="unilateral", friction=1.0)
    varied = study(given, runs, ("final_state",), friction=sp.Uniform(0.3, 2.0))
    size = np.hypot(*varied["disturbances.0.force"].T)
    edges = (0, 50, 100, 150, 200, 300, 425)
    sizes = {}
    for low, high in itertools.pairwise(edges):
        some = varied.holds[(low <= size) & (size < high)]
        sizes[f"{low} to {high}"] = (float(some.mean()) if len(some) else 0.0, len(some))
    return sp.sensitivity(varied, "holds"), sizes


def percent(found: sp.Estimate) -> str:
    return f"{100 * found.value:.1f} ({100 * found.low:.1f} to {100 * found.high:.1f})"


def table(results: Mapping[str, Odds]) -> str:
    lines = [
        "| μ | bilateral: no tip pulls or slips | unilateral: no tip slips or opens | "
        + " | ".join(f"unilateral: holds, tips {name}" for name in results)
        + " |",
        "|---|---|---|" + "---|" * len(results),
    ]
    first = next(iter(results.values()))
    for mu in first.holds:
        cells = [percent(first.sticks[mu]), percent(first.undisturbed[mu])]
        cells += [percent(found.holds[mu]) for found in results.values()]
        lines.append(f"| {mu:g} | " + " | ".join(cells) + " |")
    lines += ["", "The bounds of the bilateral model that friction does not enter:", ""]
    lines += [
        f"- tips {name}: {percent(found.completes)} complete, {percent(found.never_pulls)} "
        "complete without a tip that pulls after the push begins;"
        for name, found in results.items()
    ]
    contradictions = sum(found.contradictions for found in results.values())
    changed = [n for found in results.values() for n in found.changed.values()]
    simulated = first.completes.runs * len(first.holds) * len(results)
    repeated = first.completes.runs * len(changed)
    lines += [
        f"- {contradictions} of {simulated} runs hold in unilateral contact although a tip leaves "
        "the object in bilateral contact;",
        f"- half the step changes the outcome of {sum(changed)} of {repeated} runs.",
    ]
    return "\n".join(lines)


def shares(found: Mapping[str, sp.Effect], sizes: Mapping[str, tuple[float, int]]) -> str:
    lines = ["| varied | share of the variance | chance alone |", "|---|---:|---:|"]
    for path, effect in found.items():
        lines.append(f"| `{path}` | {max(effect.share, 0.0):.3f} | {effect.noise:.3f} |")
    lines += ["", "| size of the push, N | " + " | ".join(sizes) + " |"]
    lines += ["|---|" + "---|" * len(sizes)]
    held = " | ".join(f"{100 * share:.0f}" for share, _ in sizes.values())
    lines += [f"| holds, % | {held} |"]
    return "\n".join(lines)


def chart(results: Mapping[str, Odds]) -> Any:
    """P(holds) over mu with 95 % intervals, between the bounds of bilateral contact."""
    with plot.styled():
        figure, axes = panels(1, len(results), PAGE, 3.0, sharey=True)
        for panel, letter, (name, found) in zip(axes[0], "ab", results.items(), strict=True):
            mus = np.array(list(found.holds))
            for what, label, style in (
                (found.completes, "bilateral: completes", {"color": BLACK, "ls": (0, (1.2, 1.2))}),
                (
                    found.never_pulls,
                    "bilateral: completes, no tip pulls",
                    {"color": GREEN, "ls": (0, (5, 1.2, 1.2, 1.2))},
                ),
            ):
                _line(panel, mus, [what] * len(mus), label, style)
            _line(
                panel,
                mus,
                [found.holds[mu] for mu in mus],
                "unilateral: holds",
                {"color": BLUE, "ls": "-", "marker": "o"},
            )
            _line(
                panel,
                mus,
                [found.sticks[mu] for mu in mus],
                "bilateral: completes, no tip pulls or slips",
                {"color": RED, "ls": (0, (4, 1.5)), "marker": "s", "mfc": "white"},
            )
            panel.set(xlabel="coefficient of friction μ", xlim=(0.2, 2.1), ylim=(0.0, 1.0))
            panel.set_xticks([0.3, 0.5, 1.0, 1.5, 2.0])
            tag(panel, letter, f"tips {name}")
        axes[0, 0].set_ylabel("share of the runs (bands: 95 %)")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _line(
    axes: Any, x: Any, found: Sequence[sp.Estimate], label: str, style: Mapping[str, Any]
) -> None:
    axes.plot(x, [each.value for each in found], label=label, **style)
    low, high = [each.low for each in found], [each.high for each in found]
    axes.fill_between(x, low, high, color=style["color"], alpha=0.2, linewidth=0.0)


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    runs, frictions = (64, HALVED) if quick else (RUNS, FRICTION)
    results = {name: measure(mass, frictions, runs) for name, mass in TIPS.items()}
    found, sizes = effects(runs)
    texts = {
        "odds machine": f"```\n{describe('all cores')}\n```",
        "odds": table(results),
        "odds parameters": shares(found, sizes),
    }
    facts = {
        "machine": describe("all cores"),
        "runs": runs,
        "seed": SEED,
        "dt": DT,
        "tips": {name: asdict(odds) for name, odds in results.items()},
        "effects": {path: effect._asdict() for path, effect in found.items()},
        "sizes": sizes,
    }
    with folders(quick) as (figures, data):
        (data / "odds.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
        plot.save(chart(results), figures / "odds.png")
    for name, text in texts.items():
        print(f"{text}\n")
        if not quick:
            put(name, text)


if __name__ == "__main__":
    main()
