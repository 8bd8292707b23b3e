"""Scenes with rare events, and their probabilities from plain runs.

make rare-truth

computes plain runs of each scene, and writes how many had the event to rare_scenes.toml beside this
file, after each part of 250 000 runs. It continues from the runs that the file has; to begin a
scene anew, delete its table. An event is an argument of `rare_event`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import softpinch as sp
from softpinch.support import toml

FILE = Path(__file__).with_suffix(".toml")
COMMAND = "make rare-truth"
SEED = 17
# Plain runs that are kept in memory at a time; each such part has its own seed.
_PART = 250_000


@dataclass(frozen=True)
class RareScene:
    """A scene, its random numbers, the event, the step of its runs, s, and how many are plain."""

    scene: sp.Scene
    vary: Mapping[Any, Any]
    event: Any
    dt: float
    runs: int = 10_000_000

    def plain(self, part: int, seed: int) -> int:
        """How many of the plain runs of a part have the event."""
        study = sp.monte_carlo(
            self.scene,
            _PART,
            1000 * seed + part,
            self.vary,
            dt=self.dt,
            summaries=("peak_rotation", "margin"),
            progress=False,
        )
        return int(np.count_nonzero(self._happens(study)))

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

# The same with a probability of about 1e-6.
RARER = {
    "bilateral": replace(SCENES["bilateral"], event=("peak_rotation", ">", 0.0322)),
    "two ways": replace(SCENES["two ways"], event=("peak_rotation", ">", 0.0325)),
    "friction": replace(
        SCENES["friction"],
        vary={"friction": sp.LogNormal(0.7, 0.1), "grasped.mass": sp.LogNormal(0.1, 0.1)},
    ),
    "unilateral": replace(
        SCENES["unilateral"],
        vary={"disturbances.0.force": sp.Normal((0.0, 0.0), (14.1, 14.1))},
    ),
    "pushes": replace(SCENES["pushes"], event=("peak_rotation", ">", 0.0187)),
    "noise": replace(SCENES["noise"], event=("peak_rotation", ">", 0.00296)),
}


def known() -> dict[str, sp.Estimate]:
    """The stored probability of each scene, with its 95 % interval."""
    data = toml.read(FILE)
    return {
        name: sp.Estimate.counted(one["happened"], one["runs"])
        for name, one in data["scenes"].items()
    }


def main(names: list[str]) -> None:
    """Computes the plain runs that the file lacks of each scene, or of these, and writes them."""
    found = toml.read(FILE)["scenes"] if FILE.exists() else {}
    for name in names or SCENES:
        begun, scene = time.perf_counter(), SCENES[name]
        one = found.setdefault(name, {"happened": 0, "runs": 0, "seed": SEED})
        first = one["runs"]
        while one["runs"] < scene.runs:
            one["happened"] += scene.plain(one["runs"] // _PART, one["seed"])
            one["runs"] += _PART
            text = toml.dumps({"command": COMMAND, "scenes": found}, "study")
            FILE.write_text(text, encoding="utf-8")
        spent, new = time.perf_counter() - begun, one["runs"] - first
        estimate = sp.Estimate.counted(one["happened"], one["runs"])
        print(f"{name}: {estimate}; {new} more runs in {spent:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
