"""Cost of unilateral contact beside the paper's bilateral contact, alone and in ensembles.

make bench-contact
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

import softpinch as sp
from command import parser
from contact_peers import libraries, missing, peers
from machine import clock, describe
from softpinch import paper
from softpinch.run.options import Options
from softpinch.run.request import Request

FRICTION, PUSH = 1.0, 200.0  # N
DT = 1e-4  # s
FORMULATIONS = ("csm", "projected")
LAST_ONLY = 10**9
PARTS = ("lone", "lanes", "peers")


@dataclass(frozen=True)
class Case:
    """The same scene with both contacts.

    Attributes:
        name: For the report.
        bilateral: The paper's contact.
        most: The ratio aimed at, for a lone run and in lanes.
    """

    name: str
    bilateral: sp.Scene
    most: tuple[float, float]

    @property
    def unilateral(self) -> sp.Scene:
        return replace(self.bilateral, contact="unilateral", friction=FRICTION)


def cases(duration: float | None) -> list[Case]:
    """Disturbance (ii) as it is, which nothing slips in, and with a force of 200 N."""
    calm = paper.disturbance("ii")
    if duration is not None:
        early = replace(calm.disturbances[0], time=duration / 2)
        calm = replace(calm, disturbances=[early], duration=duration)
    hard = replace(calm, disturbances=[replace(calm.disturbances[0], force=(PUSH, 0.0))])
    return [
        Case("disturbance (ii)", calm, (1.15, 1.5)),
        Case(f"disturbance (ii), {PUSH:g} N", hard, (1.5, 2.0)),
    ]


def _ratio(works: Sequence[Callable[[], object]], rounds: int) -> tuple[float, float, str]:
    """Median processor times of both, s, and the median ratio of second to first with quartiles."""
    first, second = clock(works, rounds, math.inf, time.process_time)
    low, middle, high = np.quantile(second / first, [0.25, 0.5, 0.75])
    text = f"{middle:6.3f}  ({low:.3f} to {high:.3f})"
    return float(np.median(first)), float(np.median(second)), text


def lone(duration: float | None, rounds: int) -> None:
    """The core's part of a lone run; the arguments are checked before."""
    print(
        f"\nlone runs, RK4, dt = {1e3 * DT:g} ms, the end recorded; "
        f"processor time, median of {rounds}"
    )
    print(
        f"  {'':26s} {'':10s} {'events':>7s} {'bilateral':>10s} {'unilateral':>11s}   "
        "ratio  (quartiles)       at most"
    )
    for case in cases(duration):
        for formulation in FORMULATIONS:
            settings = {"dt": DT, "formulation": formulation, "stop_on": ()}
            options = Options.checked(every=LAST_ONLY, record=("state",), **settings)
            scenes = (case.bilateral, case.unilateral)
            first, second, ratio = _ratio(
                [Request(scene, options).simulation().run for scene in scenes], rounds
            )
            events = len(sp.simulate(case.unilateral, **settings).contact_changes)
            print(
                f"  {case.name:26s} {formulation:10s} {events:7d} {1e3 * first:7.2f} ms "
                f"{1e3 * second:8.2f} ms  {ratio}  {case.most[0]:.2f}",
                flush=True,
            )


def _ensemble(scene: sp.Scene, formulation: str, runs: int) -> sp.Ensemble:
    # Stiffnesses differ, so that events do not fall in the same steps of all lanes.
    moduli = 0.30e6 * np.linspace(0.9, 1.1, runs)
    return sp.monte_carlo(
        scene,
        vary={"hand.tip.youngs_modulus": moduli},
        dt=DT,
        formulation=formulation,
        stop_on=(),
        threads=1,
        progress=False,
    )


def lanes(duration: float | None, rounds: int, runs: int) -> None:
    """The same in ensembles, on one thread."""
    print(f"\nensembles of {runs} runs, one thread; processor time, median of {rounds}")
    print(
        f"  {'':26s} {'':10s} {'bilateral':>10s} {'unilateral':>11s}   "
        "ratio  (quartiles)       at most"
    )
    for case in cases(duration):
        for formulation in FORMULATIONS:
            works = [
                partial(_ensemble, scene, formulation, runs)
                for scene in (case.bilateral, case.unilateral)
            ]
            first, second, ratio = _ratio(works, rounds)
            print(
                f"  {case.name:26s} {formulation:10s} "
                f"{1e6 * first / runs:7.0f} us {1e6 * second / runs:8.0f} us  "
                f"{ratio}  {case.most[1]:.2f}",
                flush=True,
            )


def main() -> None:
    given = parser(__doc__, PARTS).parse_args()
    quick, parts = given.quick, given.part or PARTS
    duration = 0.02 if quick else None
    print(describe(libraries=libraries(), missing=missing()))
    print(f"scene      the paper's disturbance (ii) at 6 degrees, friction {FRICTION:g}")
    if "lone" in parts:
        lone(duration, 3 if quick else 31)
    if "lanes" in parts:
        lanes(duration, *((3, 16) if quick else (11, 256)))
    if "peers" in parts:
        peers(quick)


if __name__ == "__main__":
    main()
