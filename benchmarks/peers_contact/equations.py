"""Solvers of the problems' own equations: softpinch and Siconos.

Siconos has no event location: its Moreau-Jean scheme solves one nonsmooth problem a step. It is
called as the tests call it (tests/oracle/moreau_jean.py), with forces that are Python; its time
includes theirs.
"""

from __future__ import annotations

import math
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp

from .grips import Held

ROOT = Path(__file__).parents[2]
sys.path += [str(ROOT / "reference"), str(ROOT / "tests")]

import score  # noqa: E402

Floats = NDArray[np.float64]

# Problems with the paper's hand that both can compute.
PROBLEMS = ("10-slip", "12-open", "14-impact")
# Settings of Siconos' Moreau-Jean scheme: theta, and whether it iterates over the forces of a
# step's end, as its TimeStepping does by default. They converge where it is short.
SICONOS: tuple[tuple[str, float, bool], ...] = (
    ("Siconos, Moreau-Jean, theta 1", 1.0, False),
    ("Siconos, Moreau-Jean, theta 1/2, iterated", 0.5, True),
)
# Steps of a run: the first, and how often they are doubled. They meet the breaks of the inputs.
SICONOS_STEPS, SICONOS_DOUBLINGS = {"10-slip": 400, "12-open": 500, "14-impact": 300}, 6
OURS: tuple[tuple[str, dict[str, Any], tuple[dict[str, float], ...]], ...] = (
    (
        "softpinch, rk4, csm",
        {"method": "rk4", "formulation": "csm"},
        tuple({"dt": dt} for dt in (2e-4, 1e-4, 5e-5, 2.5e-5, 1.25e-5, 6.25e-6)),
    ),
    (
        "softpinch, dop853, projected",
        {"method": "dop853", "formulation": "projected"},
        tuple({"tolerance": 10.0**-k} for k in range(2, 13)),
    ),
    (
        "softpinch, radau5, csm",
        {"method": "radau5", "formulation": "csm"},
        tuple({"tolerance": 10.0**-k} for k in range(2, 12)),
    ),
)


def without_siconos() -> dict[str, str]:
    """For `missing` of `machine.describe`: Siconos and why it does not take part, or nothing."""
    try:
        from oracle import moreau_jean
    except ImportError:
        return {"Siconos": "not installed"}
    return {} if moreau_jean.interpreter() else {"Siconos": "not installed"}


def siconos_version() -> str:
    """Of Debian's package, which `without_siconos` has found."""
    asked = ["dpkg-query", "--showformat", "${Version}", "--show", "python3-siconos"]
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return "of another source than Debian's package"


def scene(name: str) -> sp.Scene:
    """The scene of a problem, as its file has it."""
    from softpinch.support import toml

    return sp.Scene.from_toml(toml.dumps(score.solution(name)[0]["scene"], "scene"))


def error(name: str, q: Floats, p: Floats) -> float:
    """The error of q and p at the end, as `score` measures it."""
    exact = score.solution(name)[1].rows
    mine = exact[-1:].copy()
    mine[0, 1:10], mine[0, 10:19] = q, p
    found = score.differences(exact[-1:], mine, exact)
    return max(found["q"], found["p"])


def ours(name: str, options: dict[str, Any], repeats: int) -> tuple[float, float]:
    """Error at the end, and processor time, s."""
    posed, spent = scene(name), []
    settings: dict[str, Any] = {"every": 10**9, "record": ("state",), "stop_on": (), **options}
    for _ in range(repeats):
        begin = time.process_time()
        run = sp.simulate(posed, **settings)
        spent.append(time.process_time() - begin)
    off = error(name, run.q[-1], run.p[-1]) if run.status == "completed" else np.inf
    return off, float(np.median(spent))


def siconos(name: str, steps: int, theta: float, iterated: bool) -> tuple[float, float]:
    """Error at the end, infinite where it diverged, and processor time, s."""
    from oracle import moreau_jean

    posed = scene(name)
    mu = posed.friction
    pair: Any = mu if isinstance(mu, tuple) else (mu, mu)
    try:
        end = moreau_jean.stepped(posed, pair, steps, theta=theta, iterated=iterated)
    except RuntimeError as failure:
        if "OverflowError" not in str(failure) and "ValueError" not in str(failure):
            raise
        return math.inf, math.nan
    return error(name, end.q, end.p), end.spent[0]


# Problems with jaws on a fixed base, and steps in a second, of which 0.1 s is a whole number.
# The forces are those at a step's start, so the tips' viscosity bounds it to 2 m/c = 0.2 ms.
SICONOS_GRIPS = ("01-rest", "02-rest-half", "03-held", "04-lost")
SICONOS_RATE = 6670
# A step takes some 0.2 ms with Python's border, and 100 s more than half a million of them: two
# minutes for each of the first two problems on an idle machine. They end here, s.
SICONOS_LIMIT = 20.0


def siconos_grip(name: str, creep: tuple[float, float], duration: float) -> Held:
    """What became of a grip by Siconos, whose faces do not end, within `SICONOS_LIMIT`."""
    from oracle import moreau_jean

    posed, duration = scene(name), min(duration, SICONOS_LIMIT)
    steps = round(duration * SICONOS_RATE)
    posed = posed.with_({"duration": duration})
    half = float(score.solution(name)[0]["scene"]["grasped"]["height"]) / 2
    times = np.unique([*np.arange(0.05, duration, 0.05), *creep, duration])
    at = np.unique(np.rint(times[times > 0] / duration * steps).astype(int))
    found = moreau_jean.stepped(posed, (posed.friction,) * 2, steps, at.tolist())  # type: ignore[arg-type]
    start = posed.start().q[1]
    heights = np.concatenate([[start], found.rows[:, 1]])
    seconds = np.concatenate([[0.0], at * duration / steps])
    gone = np.abs(heights - start) > half
    if gone.any():
        return Held(math.nan, float(seconds[gone.argmax()]), found.spent[0])
    before, after = np.searchsorted(seconds, np.minimum(creep, duration) - duration / steps)
    return Held(float(abs(heights[after] - heights[before])), None, found.spent[0])
