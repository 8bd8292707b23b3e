"""Scenes with rare events, and their probabilities from plain runs.

make rare-truth

computes plain runs of each scene, and writes how many had the event to rare_scenes.toml beside this
file. An event is an argument of `rare_event`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from softpinch.support import toml

FILE = Path(__file__).with_suffix(".toml")
COMMAND = "make rare-truth"
SEED = 17
# Plain runs that are kept in memory at a time.
_AT_ONCE = 250_000


@dataclass(frozen=True)
class RareScene:
    """A scene, its random numbers, the event, the step of its runs, s, and how many are plain."""

    scene: sp.Scene
    vary: Mapping[Any, Any]
    event: Any
    dt: float
    runs: int = 4_000_000

    def plain(self, seed: int) -> int:
        """How many of the plain runs have the event."""
        total = 0
        for k, first in enumerate(range(0, self.runs, _AT_ONCE)):
            study = sp.monte_carlo(
                self.scene,
                min(_AT_ONCE, self.runs - first),
                1000 * seed + k,
                self.vary,
                dt=self.dt,
                summaries=("peak_rotation", "margin"),
                progress=False,
            )
            total += int(np.count_nonzero(self._happens(study)))
        return total

    def _happens(self, study: Any) -> Any:
        if self.event == "lost":
            return ~study.holds
        name, _, threshold = self.event
        return study[name] > threshold


_PUSH = sp.Scene(duration=0.1, disturbances=[sp.Pulse(time=0.02, duration=0.01)])
_LOOSE = sp.Scene(
    contact="unilateral",
    friction=0.5,
    hand=sp.Hand(tip=sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)),  # kg
    grasped=sp.GraspedObject(height=0.049),  # m, so that the object can be lost
    disturbances=[sp.Pulse(time=0.02, duration=0.01)],
    duration=0.1,
)
_PUSHES = sp.Scene(
    duration=0.1, disturbances=[sp.Pulse(time=0.02 + 0.015 * k, duration=0.01) for k in range(4)]
)
_NOISE = sp.Scene(
    duration=0.1,
    disturbances=[sp.Noise(force_std=(3.0, 1.0), moment_std=0.01, rate_hz=500.0, duration=0.06)],
)
SCENES = {
    "bilateral": RareScene(
        _PUSH,
        {
            "grasped.mass": sp.Normal(0.1, 0.01),
            "hand.tip.youngs_modulus": sp.LogNormal(0.3e6, 0.2),
            "disturbances.0.force": sp.Normal((0.0, 0.0), (20.0, 10.0)),
        },
        ("peak_rotation", ">", 0.02),
        1e-3,
    ),
    "unilateral": RareScene(
        _LOOSE, {"disturbances.0.force": sp.Normal((0.0, 0.0), (21.0, 21.0))}, "lost", 2.5e-4
    ),
    "friction": RareScene(
        _LOOSE.with_({"disturbances.0.force": (0.0, -62.0)}),
        {"friction": sp.LogNormal(0.6, 0.1), "grasped.mass": sp.LogNormal(0.1, 0.1)},
        "lost",
        2.5e-4,
        1_000_000,
    ),
    "pushes": RareScene(
        _PUSHES,
        {f"disturbances.{k}.force": sp.Normal((0.0, 0.0), (12.0, 6.0)) for k in range(4)},
        ("peak_rotation", ">", 0.0128),
        1e-3,
    ),
    "noise": RareScene(_NOISE, {}, ("peak_rotation", ">", 0.0021), 1e-3),
    # A push to one side is likelier to turn the object than one to the other.
    "two ways": RareScene(
        _PUSH,
        {
            "grasped.mass": sp.Normal(0.1, 0.01),
            "disturbances.0.force": sp.Normal((4.0, 0.0), (20.0, 10.0)),
        },
        ("peak_rotation", ">", 0.02),
        1e-3,
    ),
    "never": RareScene(
        _PUSH,
        {"disturbances.0.force": sp.Uniform((-20.0, -10.0), (20.0, 10.0))},
        ("peak_rotation", ">", 0.03),
        1e-3,
    ),
}


def known() -> dict[str, sp.Estimate]:
    """The stored probability of each scene, with its 95 % interval."""
    data = toml.read(FILE)
    return {
        name: sp.Estimate.counted(one["happened"], one["runs"])
        for name, one in data["scenes"].items()
    }


def main(names: list[str]) -> None:
    """Computes plain runs of each scene, or of these ones, and writes the file."""
    found = toml.read(FILE)["scenes"] if names else {}
    for name in names or SCENES:
        begun = time.perf_counter()
        one = SCENES[name]
        found[name] = {"happened": one.plain(SEED), "runs": one.runs, "seed": SEED}
        spent = time.perf_counter() - begun
        print(f"{name}: {sp.Estimate.counted(found[name]['happened'], one.runs)} in {spent:.0f} s")
    FILE.write_text(toml.dumps({"command": COMMAND, "scenes": found}, "study"), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
