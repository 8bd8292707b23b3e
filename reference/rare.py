"""The problems 24-rare and 25-rarer: a push that rarely loses the object, and how rarely.

Two numbers are random, and the more force, the less the grasp holds: the probability is an integral
over friction of the probability that the force exceeds what is just held, which bisection finds.
Runs check it, plain ones or, where those would lose nothing, runs with more force that count by
their likelihood; and the independent simulation on both sides of that force.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from math import erfc, sqrt
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from definitions import jaws
from score import RARE, RARER, VERSION, wilson
from softpinch.support import toml

FRICTIONS = (0.4, 0.6)
RUNS, SEED = 200_000, 42
DURATION = 0.3  # s
# Of the normal distribution, for 99 %.
Z = 2.5758293035489004


@dataclass(frozen=True)
class Rare:
    """One problem.

    Attributes:
        name: Of its folder.
        title: One line.
        mean: Of the force, N.
        deviation: Of the force, N.
        drawn: Mean of the force in the runs that check it, N.
        nodes: Of Gauss and Legendre's rule, for the error and for the result.
    """

    name: str
    title: str
    mean: float
    deviation: float
    drawn: float
    nodes: tuple[int, int]

    @property
    def plain(self) -> bool:
        """Whether runs are drawn from the distribution itself."""
        return self.drawn == self.mean


RARES = (
    Rare(RARE, "A push that rarely loses the cube", 4.65, 0.5, 4.65, (10, 14)),
    Rare(RARER, "A push that loses the cube once in a million times", 4.0, 0.43, 5.9, (14, 20)),
)


def scene(friction: float = 0.5, force: float = 4.65) -> sp.Scene:
    """The cube of 01-rest, held twice as lightly, and pushed down for 30 ms."""
    push = sp.Pulse(time=0.01, duration=0.03, force=(0.0, -force))
    return jaws(0.2, disturbances=[push], duration=DURATION).with_({"friction": friction})


def lost(friction: float, force: float) -> bool:
    changes: dict[str, Any] = {"friction": friction, "disturbances.0.force": (0.0, -force)}
    run = sp.simulate(
        scene().with_(changes), dt=1e-4, method="dop853", formulation="projected", record=("state",)
    )
    return run.status == "lost"


@cache
def just_held(friction: float) -> float:
    """The largest force that is held, N."""
    low, high = 4.0, 10.0
    while high - low > 1e-10:
        middle = (low + high) / 2
        low, high = (low, middle) if lost(friction, middle) else (middle, high)
    return (low + high) / 2


def exact(rare: Rare, nodes: int) -> tuple[float, list[tuple[float, float]]]:
    """The probability, and friction and force at each node."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    low, high = FRICTIONS
    frictions = low + (high - low) * (places + 1) / 2
    forces = [just_held(friction) for friction in frictions.tolist()]
    above = [erfc((force - rare.mean) / rare.deviation / sqrt(2)) / 2 for force in forces]
    return float(weights @ above) / 2, list(zip(frictions.tolist(), forces, strict=True))


def study(rare: Rare, of: sp.Scene) -> sp.Ensemble:
    """The runs of a scene that check the probability."""
    return sp.monte_carlo(
        of,
        runs=RUNS,
        seed=SEED,
        dt=2e-4,
        vary={
            "friction": sp.Uniform(*FRICTIONS),
            "disturbances.0.force.1": sp.Normal(-rare.drawn, rare.deviation),
        },
        formulation="projected",
        progress=False,
    )


def run(rare: Rare) -> tuple[np.ndarray, np.ndarray]:
    """Which of the runs lose the object, and the likelihood of each by that of its draw."""
    found = study(rare, scene())
    force = -found["disturbances.0.force.1"]
    far, drawn = ((force - mean) / rare.deviation for mean in (rare.mean, rare.drawn))
    return found.status == "lost", np.exp((drawn**2 - far**2) / 2)


def above(rare: Rare, pairs: list[tuple[float, float]]) -> np.ndarray:
    """In which of the same runs the force is above what is held, without simulating them."""
    frictions, forces = np.array(pairs).T
    held = np.polynomial.Polynomial.fit(frictions, forces, len(pairs) - 1, domain=FRICTIONS)
    # The draws depend on the seed alone.
    short = study(rare, scene().with_({"duration": 4e-4}))
    return np.asarray(-short["disturbances.0.force.1"] > held(short["friction"]))


def interval(rare: Rare, lost: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """The 99 % interval of the probability, of plain or of weighted runs."""
    if rare.plain:
        return wilson(int(lost.sum()), RUNS)
    counted = lost * weights
    half = Z * float(counted.std()) / sqrt(RUNS)
    return float(counted.mean()) - half, float(counted.mean()) + half


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


def write(folder: Path, rare: Rare) -> None:
    """Computes the probability in three ways and writes the problem."""
    (coarse, _), (value, pairs) = (exact(rare, nodes) for nodes in rare.nodes)
    independent(pairs[::6])
    lost, weights = run(rare)
    failures, expected = int(lost.sum()), above(rare, pairs)
    if (lost != expected).any():
        raise RuntimeError(f"{failures} runs lose the object, {expected.sum()} others should")
    low, high = interval(rare, lost, weights)
    if not low <= value <= high:
        raise RuntimeError(f"{failures} of {RUNS} runs: {value} is not in {low} to {high}")
    print(f"{rare.name} {value:.9g} {abs(value - coarse):.1e}; {low:.3g} to {high:.3g}", flush=True)
    checked = {
        "runs": RUNS,
        "seed": SEED,
        "failures": failures,
        "draws_above_what_is_held": int(expected.sum()),
        "interval_99_percent": [low, high],
        "command": f"PYTHONPATH=tests python reference/generate.py {rare.name}",
    }
    how = "plain" if rare.plain else "weighted"
    if not rare.plain:
        checked["drawn_with_mean"] = -rare.drawn
    data = {
        "name": rare.name,
        "title": rare.title,
        "version": VERSION,
        "statement": "A push of 30 ms pulls down the cube of 01-rest, whose weight is 20 % of what "
        "friction carries at a coefficient of 0.5. The coefficient and the force are random. How "
        "likely is it that the cube is lost within the duration?",
        "equations": "docs/equations.md",
        "random": {
            "friction": {"distribution": "uniform", "from": FRICTIONS[0], "to": FRICTIONS[1]},
            "disturbances.0.force.1": {
                "distribution": "normal",
                "mean": -rare.mean,
                "standard_deviation": rare.deviation,
            },
        },
        "answer": {
            "probability": value,
            "probability_error": float(f"{max(abs(value - coarse), 1e-9 * value):.1e}"),
            "just_held": [{"friction": mu, "force": force} for mu, force in pairs],
            how: checked,
        },
        "scene": scene(force=rare.mean).to_dict(),
    }
    folder.mkdir(parents=True, exist_ok=True)
    text = "# A reference problem; ../../README.md has the rules. SI units, angles in radians.\n"
    (folder / "problem.toml").write_text(text + toml.dumps(data, "problem"), encoding="utf-8")


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parent.parent / "tests"))
    for each in RARES:
        write(Path(__file__).parent / "problems" / each.name, each)
