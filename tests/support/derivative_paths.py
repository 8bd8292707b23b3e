"""The paths by which runs of any scene have derivatives."""

from dataclasses import fields
from typing import Any

import numpy as np

import softpinch as sp
from derivative_scenes import SIDED
from softpinch.scene.paths import resolve

# What moves breakpoints, as a field of a schedule or a disturbance.
TIMES = ("time", "times", "duration", "move_time")
# What has no derivative, or none here.
_NONE = ("rate_hz", "kind", "hold", "seed", "run", *TIMES)


def sided(scene: sp.Scene) -> list[str]:
    """All numbers of hand, object and controllers, those of both fingers by their sides.

    A tip's mass that is the object's is left out: it would be a number of its own.
    """
    return [path for path in SIDED if path != "gravity" and _given(scene, path)] + ["gravity"]


def _given(scene: sp.Scene, path: str) -> bool:
    if not path.endswith(("normal_mass", "tangential_mass")):
        return True
    tip = scene.hand.tips[0 if ".right." in path else 1]
    return getattr(tip, path.rpartition(".")[2]) is not None


def shared(scene: sp.Scene) -> list[str]:
    """The paths that both tips or both controllers share."""
    whole = {"hand.tip": scene.hand.tip, "control": scene.control}
    names = {path.replace(".right", "") for path in sided(scene) if ".right." in path}
    return sorted(
        path
        for path in names
        if any(
            path.startswith(f"{owner}.") and not isinstance(record, tuple)
            for owner, record in whole.items()
        )
    )


def inputs(scene: sp.Scene, times: bool = False) -> list[str]:
    """The numbers of schedule and disturbances: those that move breakpoints, or the others."""
    found = []
    records: dict[str, Any] = {"schedule": scene.schedule}
    records |= {f"disturbances.{k}": load for k, load in enumerate(scene.disturbances)}
    for owner, record in records.items():
        noise = isinstance(record, sp.Noise)
        for name in (field.name for field in fields(record)):
            asked = name in TIMES and not noise if times else name not in _NONE
            if asked and getattr(record, name) is not None:
                found.append(f"{owner}.{name}")
    return found


def value(scene: sp.Scene, path: str) -> Any:
    return np.asarray(resolve(scene, path))


def size(scene: sp.Scene, path: str, index: tuple[int, ...] = ()) -> float:
    """The size of a number: its own, or what would be usual if it is about zero."""
    least = {"tilt_coupling": 1.0, "force": 0.1}.get(path.split(".")[-1], 1e-3)
    return max(least, abs(float(value(scene, path)[index])))
