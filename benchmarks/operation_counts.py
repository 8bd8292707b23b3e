"""Operations and longest chain of an evaluation and of a step, for each choice of equations.

The counts are those of the table `operations.py`, which `make operations` writes.
"""

import math
from typing import Any, NamedTuple

import numpy as np

import softpinch as sp
from command import parser
from machine import describe
from operations import COSTS, EQUATIONS, FRICTION, KINDS, SINE
from softpinch import _core

# Methods with a fixed cost per step, in the order of the table. Implicit methods iterate.
METHODS = ("rk4", "dop853")
# The largest number of sines in the table; each further sine costs as much as the last of these.
_SINES = 2


class Cost(NamedTuple):
    """The cost of a scene's equations, with the inputs that hold at its start.

    The operations are those of bilateral contact: a solve without symmetry for the multipliers,
    the choice of modes, events and the steps that are repeated to locate them are not counted.
    Angles are taken below 45 degrees; the sine and cosine of a larger angle need 22 more
    floating-point operations.

    Attributes:
        operations: Kind of operation -> its number in one evaluation, including multipliers and
            residuals. Constants are folded and common terms are counted once, but equal
            polynomials are counted separately.
        evaluation: Floating-point operations of one evaluation; a fused multiply-add counts as two.
        step: Floating-point operations of a step, including its monitors.
        chain: Cycles of a step's longest chain of dependent operations on a current x86 core.
    """

    operations: dict[str, int]
    evaluation: int
    step: int
    chain: int


def cost(
    scene: sp.Scene, formulation: str = "csm", method: str = "rk4", *, ledger: bool = False
) -> Cost:
    """Looks up the cost of a scene's equations."""
    begin = scene.start().time
    compiled = [push.compile() for push in scene.disturbances]
    polynomials = [scene.schedule.compile(), *(force for one in compiled for force in one.forces)]
    degree = max(_degree(polynomial, begin) for polynomial in polynomials)
    sines = sum(bool(first <= begin < last) for one in compiled for first, last, *_ in one.sines)
    choice = formulation, "torque" if scene.law == "sampled" else scene.law, int(ledger)
    tabled = min(sines, _SINES)
    counts, steps = COSTS[*choice, degree, tabled]
    fewer_counts, fewer_steps = COSTS[*choice, degree, max(tabled - 1, 0)]
    further = sines - tabled
    each = (now + further * (now - less) for now, less in zip(counts, fewer_counts, strict=True))
    operations = dict(zip(KINDS, each, strict=True))
    place = METHODS.index(method)
    step, chain = steps[2 * place], steps[2 * place + 1]
    step += further * (step - fewer_steps[2 * place])
    step += FRICTION * bool(np.isfinite(scene.parameters()[-2:]).any())
    if sines:
        chain = max(chain, EQUATIONS[choice][2][place] + SINE * sines)
    evaluation = sum(KINDS[name] * count for name, count in operations.items())
    return Cost(operations, evaluation, step, chain)


def _degree(polynomial: Any, begin: float) -> int:
    """The degree of a piecewise polynomial just after the start."""
    breaks, coefficients = polynomial
    piece = np.searchsorted(breaks, math.nextafter(begin, math.inf), side="left")
    used = np.flatnonzero(coefficients[piece].any(axis=0))
    return int(used[-1]) if used.size else 0


def main() -> None:
    # Counts are looked up, not measured: a quick look is the whole.
    parser(__doc__).parse_args()
    smooth = sp.Schedule.minimum_jerk([-0.1, 0.0], np.deg2rad([[6, 6], [8, 7]]), move_time=0.1)
    scenes = {
        "undisturbed": sp.Scene(),
        "moving targets": sp.Scene(schedule=smooth),
        "a sine": sp.Scene(disturbances=[sp.Sine(frequency_hz=9.0, force=(1.0, 0.0))]),
        "driven": sp.Scene(schedule=smooth, fingers="driven"),
    }
    print(describe())
    print(f"\n{'':34}evaluation   rk4 step  its chain  dop853 step  its chain")
    for formulation in _core.FORMULATIONS:
        for name, scene in scenes.items():
            for ledger in (False, True):
                told = f"{formulation}, {name}{', ledger' if ledger else ''}"
                rk4, dop853 = (cost(scene, formulation, m, ledger=ledger) for m in METHODS)
                print(
                    f"{told:34}{rk4.evaluation:10}{rk4.step:11}{rk4.chain:11}"
                    f"{dop853.step:13}{dop853.chain:11}"
                )


if __name__ == "__main__":
    main()
