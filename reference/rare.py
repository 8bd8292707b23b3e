"""The problem 24-rare: a push that rarely loses the object, and how rarely.

Two numbers are random, and the more force, the less the grasp holds: the probability is an integral
over friction of the probability that the force exceeds what is just held, which bisection finds.
Plain runs, and the independent simulation on both sides of that force, check it.
"""

from __future__ import annotations

import sys
from math import erfc, sqrt
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from definitions import jaws
from score import RARE, VERSION, wilson
from softpinch.support import toml

FRICTIONS = (0.4, 0.6)
MEAN, DEVIATION = 4.65, 0.5  # of the force, N
NODES = (10, 14)  # of Gauss and Legendre's rule, for the error and for the result
RUNS, SEED = 200_000, 42
DURATION = 0.3  # s


def scene(friction: float = 0.5, force: float = MEAN) -> sp.Scene:
    """The cube of 01-rest, held twice as lightly, and pushed down for 30 ms."""
    push = sp.Pulse(time=0.01, duration=0.03, force=(0.0, -force))
    return jaws(0.2, disturbances=[push], duration=DURATION).with_({"friction": friction})


def lost(friction: float, force: float) -> bool:
    changes: dict[str, Any] = {"friction": friction, "disturbances.0.force": (0.0, -force)}
    run = sp.simulate(
        scene().with_(changes), dt=1e-4, method="dop853", formulation="projected", record=("state",)
    )
    return run.status == "lost"


def just_held(friction: float) -> float:
    """The largest force that is held, N."""
    low, high = 4.0, 10.0
    while high - low > 1e-10:
        middle = (low + high) / 2
        low, high = (low, middle) if lost(friction, middle) else (middle, high)
    return (low + high) / 2


def exact(nodes: int) -> tuple[float, list[tuple[float, float]]]:
    """The probability, and friction and force at each node."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    low, high = FRICTIONS
    frictions = low + (high - low) * (places + 1) / 2
    forces = [just_held(friction) for friction in frictions.tolist()]
    above = [erfc((force - MEAN) / DEVIATION / sqrt(2)) / 2 for force in forces]
    return float(weights @ above) / 2, list(zip(frictions.tolist(), forces, strict=True))


def study(of: sp.Scene) -> sp.Ensemble:
    """The plain runs of a scene."""
    return sp.monte_carlo(
        of,
        runs=RUNS,
        seed=SEED,
        dt=2e-4,
        vary={
            "friction": sp.Uniform(*FRICTIONS),
            "disturbances.0.force.1": sp.Normal(-MEAN, DEVIATION),
        },
        formulation="projected",
        progress=False,
    )


def plain() -> int:
    """How many of the plain runs lose the object."""
    return round(RUNS * study(scene()).probability("lost").value)


def drawn(pairs: list[tuple[float, float]]) -> int:
    """In how many of the same runs the force is above what is held, without simulating them."""
    frictions, forces = np.array(pairs).T
    held = np.polynomial.Polynomial.fit(frictions, forces, len(pairs) - 1, domain=FRICTIONS)
    # The draws depend on the seed alone.
    short = study(scene().with_({"duration": 4e-4}))
    return int((-short["disturbances.0.force.1"] > held(short["friction"])).sum())


def independent(pairs: list[tuple[float, float]], off: float = 1e-5) -> None:
    """Raises unless the independent simulation finds the same forces, to `off`, N.

    Raises:
        RuntimeError: It does not.
    """
    from oracle import unilateral

    for friction, force in pairs:
        changes = [{"friction": friction, "disturbances.0.force": (0.0, -f)}
                   for f in (force - off, force + off)]  # fmt: skip
        found = [unilateral(scene().with_(change)).status for change in changes]
        if found != ["completed", "lost"]:
            raise RuntimeError(f"{friction=}, {force=}: {found}")


def write(folder: Path) -> None:
    """Computes the probability in three ways and writes the problem."""
    (coarse, _), (value, pairs) = map(exact, NODES)
    independent(pairs[::6])
    failures, above = plain(), drawn(pairs)
    if failures != above:
        raise RuntimeError(f"{failures} runs lose the object, {above} should")
    low, high = wilson(failures, RUNS)
    if not low <= value <= high:
        raise RuntimeError(f"{failures} of {RUNS} runs: {value} is not in {low} to {high}")
    print(f"{RARE} {value:.9g} {abs(value - coarse):.1e}; {failures} of {RUNS} runs", flush=True)
    data = {
        "name": RARE,
        "title": "A push that rarely loses the cube",
        "version": VERSION,
        "statement": "A push of 30 ms pulls down the cube of 01-rest, whose weight is 20 % of what "
        "friction carries at a coefficient of 0.5. The coefficient and the force are random. How "
        "likely is it that the cube is lost within the duration?",
        "equations": "docs/equations.md",
        "random": {
            "friction": {"distribution": "uniform", "from": FRICTIONS[0], "to": FRICTIONS[1]},
            "disturbances.0.force.1": {
                "distribution": "normal",
                "mean": -MEAN,
                "standard_deviation": DEVIATION,
            },
        },
        "answer": {
            "probability": value,
            "probability_error": float(f"{max(abs(value - coarse), 1e-9 * value):.1e}"),
            "just_held": [{"friction": mu, "force": force} for mu, force in pairs],
            "plain": {
                "runs": RUNS,
                "seed": SEED,
                "failures": failures,
                "draws_above_what_is_held": above,
                "interval_99_percent": [low, high],
                "command": "PYTHONPATH=tests python reference/generate.py 24-rare",
            },
        },
        "scene": scene().to_dict(),
    }
    folder.mkdir(parents=True, exist_ok=True)
    text = "# A reference problem; ../../README.md has the rules. SI units, angles in radians.\n"
    (folder / "problem.toml").write_text(text + toml.dumps(data, "problem"), encoding="utf-8")


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parent.parent / "tests"))
    write(Path(__file__).parent / "problems" / RARE)
