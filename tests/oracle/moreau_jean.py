"""Siconos on our scenes, in a process of its own: Debian binds it to the system's interpreter.

The terms of motion are those that SymPy derives, sent as the text of a function; time stepping and
contact problem are Siconos' own (moreau_jean_siconos.py).
"""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from softpinch.accuracy.segments import Inputs
from softpinch.scene.parts import others

from .contact_parts import PartsMechanics
from .contact_terms import PLACES, TURNING, Floats, Mechanics, term_function
from .evaluate import parameters
from .lagrangian import PARAMETERS
from .trajectory import start_state

SCRIPT = Path(__file__).with_name("moreau_jean_siconos.py")
MISSING = "Siconos is not installed (Debian's python3-siconos)"


@dataclass(frozen=True, eq=False)
class Stepped:
    """The end of a run by Siconos, and what its contacts did.

    Attributes:
        q: At the end (9,).
        p: At the end (9,).
        changes: (start of the step, s; "right" or "left"; mode from then on: 0 free, 1 stick,
            2 slip), the first modes included.
        rows: q after the steps that were asked for (n, 9).
        step: s.
        spent: Processor time of the steps, and its part in the terms of motion, s.
    """

    q: Floats
    p: Floats
    changes: list[tuple[float, str, int]]
    rows: Floats
    step: float
    spent: tuple[float, float]


@cache
def interpreter() -> str | None:
    """A Python that imports Siconos; None where there is none."""
    for candidate in dict.fromkeys([sys.executable, "/usr/bin/python3"]):
        command = [candidate, "-I", "-c", "import siconos.kernel, siconos.numerics"]
        try:
            done = subprocess.run(command, capture_output=True, timeout=60)
        except OSError:
            continue
        if done.returncode == 0:
            return candidate
    return None


def _task(scene: Any, friction: tuple[float, float], steps: int) -> dict[str, Any]:
    start, begin = start_state(scene)
    step = scene.duration / steps
    inputs = Inputs(scene, begin, begin + scene.duration)
    asked = []
    for k in range(steps):
        middle = begin + (k + 0.5) * step
        edge = int(np.searchsorted(inputs.edges, middle))
        driven = inputs.between(inputs.edges[edge - 1], inputs.edges[edge])
        asked.append([float(value) for value in driven(middle)])
    values: list[float] = []
    if others(scene):
        parts = PartsMechanics(scene)
        masses, (terms, turning) = parts.masses, parts.term_function()
    else:
        numbers = parameters(scene)
        values = [float(numbers[name]) for name in PARAMETERS]
        masses, terms, turning = Mechanics(numbers).masses, term_function(), TURNING.tolist()
    return {
        "q": start[:9].tolist(),
        "p": start[9:18].tolist(),
        "integral": start[18:].tolist(),
        "masses": masses.tolist(),
        "turning": turning,
        "terms": inspect.getsource(terms),
        "name": terms.__name__,
        "values": values,
        "places": PLACES.tolist(),
        "asked": asked,
        "friction": list(friction),
        "step": step,
    }


def stepped(
    scene: Any,
    friction: tuple[float, float],
    steps: int,
    watched: Sequence[int] = (),
    theta: float = 1.0,
    iterated: bool = False,
) -> Stepped:
    """Simulates a scene in equal steps by Siconos' Moreau-Jean scheme, first order in the step.

    With theta = 1/2 and iterations it is of second order where no mode changes.

    Args:
        scene: As for `unilateral`; fingers under PID control, no impulses, endless faces. Its
            breaks belong on the grid of the steps. Other parts than the paper's are upright tips
            on upright faces.
        friction: mu (right, left).
        steps: How many.
        watched: After which of them the coordinates are wanted, in order.
        theta: Share of a step's end in its forces.
        iterated: Whether the forces of a step's end are iterated; else they are those of its start.
    """
    python = interpreter()
    if python is None:
        raise RuntimeError(MISSING)
    task = _task(scene, friction, steps)
    task |= {"watched": list(watched), "theta": theta, "iterated": iterated}
    done = subprocess.run(
        [python, "-I", str(SCRIPT)], input=json.dumps(task), capture_output=True, text=True
    )
    if done.returncode != 0:
        raise RuntimeError(f"Siconos failed: {done.stderr[-2000:]}")
    # Siconos greets on standard output.
    result = json.loads(done.stdout[done.stdout.index("{") :])
    begin = scene.start().time
    changes = [(begin + t, ("right", "left")[i], mode) for t, i, mode in result["changes"]]
    total, terms = result["spent"]
    end = np.array(result["q"]), np.array(result["p"])
    rows = np.array(result["rows"]).reshape(-1, 9)
    return Stepped(*end, changes, rows, task["step"], (total, terms))
