"""The numbers of a scene with a tiny imaginary part in one of them, read from its plain fields.

Whatever is computed from them with complex numbers has the derivative by that number as its
imaginary part over `STEP`, exact to round-off. Start and inputs are written out again from their
definitions, so that nothing is shared with the package's own derivatives.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import softpinch as sp
from oracle.lagrangian import PARAMETERS, SIDES

Complex = NDArray[np.complex128]
STEP = 1e-60


class Numbers:
    """A scene's numbers.

    Attributes:
        parameters: Of `oracle.lagrangian.PARAMETERS`, SI.
        start: q, p and the integrals (20,).
        edges: Start, every instant between at which an input jumps or bends, and end, s. The
            imaginary part is that of the instant.
        impulses: (instant, (J_x, J_y, J_theta)), N s and N m s.
    """

    def __init__(self, scene: sp.Scene, path: str = "", index: tuple[int, ...] = ()) -> None:
        self._scene, self._path, self._index = scene, path, index
        self.parameters = self._parameters()
        schedule = scene.schedule
        self._times = self._of("schedule.times", schedule.times)
        self._angles = self._of("schedule.angles", schedule.angles)
        self._move = self._of("schedule.move_time", schedule.move_time or 0.0)
        self._loads = [
            {
                name: self._of(f"disturbances.{place}.{name}", getattr(load, name))
                for name in vars(load)
                if getattr(load, name) is not None
            }
            for place, load in enumerate(scene.disturbances)
        ]
        self.impulses = [
            (load["time"], np.array([*load["impulse"], load["angular_impulse"]]))
            for load in self._loads
            if "impulse" in load
        ]
        begin = scene.initial.time if isinstance(scene.initial, sp.State) else 0.0
        end = begin + scene.duration
        breaks = [*self._times, *(self._times[1:] + self._move if schedule.move_time else [])]
        for load in self._loads:
            breaks += [load["time"]]
            breaks += [load["time"] + load["duration"]] if "duration" in load else []
        inside = sorted((t for t in breaks if begin < t.real < end), key=lambda t: t.real)
        self.edges = [complex(begin), *inside, complex(end)]
        self.start = self._start()

    def _of(self, name: str, value: Any) -> Any:
        """The value of that name, moved if it is the one."""
        found = np.array(value, dtype=np.complex128)
        if name == self._path:
            found[self._index] += 1j * STEP
        return found if found.ndim else complex(found)

    def _parameters(self) -> dict[str, complex]:
        scene, found = self._scene, {}
        for k, (side, _) in enumerate(SIDES):
            pair = {"hand.tip": scene.hand.tip, "control": scene.control}
            records: dict[str, Any] = {f"hand.{side}": getattr(scene.hand, side)}
            records |= {
                f"{name}.{side}": both[k] if isinstance(both, tuple) else both
                for name, both in pair.items()
            }
            for owner, record in records.items():
                for name in [n for n in PARAMETERS if n.startswith(owner + ".")]:
                    value = getattr(record, name.rpartition(".")[2])
                    if value is None:  # a tip's mass is the object's
                        value = self._of("grasped.mass", scene.grasped.mass)
                    shared = name.replace(f".{side}", "", 1)
                    found[name] = self._of(shared if shared == self._path else name, value)
        for name in ("width", "mass", "inertia", "com_offset"):
            found[f"grasped.{name}"] = self._of(f"grasped.{name}", getattr(scene.grasped, name))
        found["gravity"] = self._of("gravity", scene.gravity)
        return found

    def _start(self) -> Complex:
        initial = self._scene.initial
        if isinstance(initial, sp.State):
            parts = {name: getattr(initial, name) for name in ("q", "p", "integral")}
            return np.concatenate([self._of(f"initial.{n}", value) for n, value in parts.items()])
        angles, heights, c = [], [], self.parameters
        for side, _ in SIDES:
            length, thickness = (c[f"hand.{side}.{n}"] for n in ("length", "half_thickness"))
            angle = 0j
            if initial == "touching":
                # The tip's centre stands a radius before the face of the upright object.
                inward = c[f"hand.{side}.root_offset"] - c[f"hand.tip.{side}.radius"]
                reach = np.sqrt(length**2 + thickness**2)
                turned = np.arcsin((inward - c["grasped.width"] / 2) / reach)
                angle = turned - np.arctan(thickness / length)
            angles.append(angle)
            heights.append(length * np.cos(angle) - thickness * np.sin(angle))
        if initial != "touching":
            heights = [c[f"hand.{side}.length"] for side, _ in SIDES]
        start = np.zeros(20, dtype=np.complex128)
        start[:5] = c["grasped.com_offset"], sum(heights) / 2, 0.0, *angles
        start[5:7] = self.compressions(start)
        return start

    def compressions(self, q: Any) -> list[complex]:
        """d_n of both tips from the other coordinates: how far each is inside its face."""
        c, found = self.parameters, []
        for k, (side, s) in enumerate(SIDES):
            length, thickness = (c[f"hand.{side}.{n}"] for n in ("length", "half_thickness"))
            root = -s * c[f"hand.{side}.root_offset"]
            x = root + s * (length * np.sin(q[3 + k]) + thickness * np.cos(q[3 + k]))
            y = length * np.cos(q[3 + k]) - thickness * np.sin(q[3 + k])
            out = -s * ((x - q[0]) * np.cos(q[2]) + (y - q[1]) * np.sin(q[2]))
            face = c["grasped.width"] / 2 + s * c["grasped.com_offset"]
            found.append(c[f"hand.tip.{side}.radius"] - (out - face))
        return found

    def inputs(self, t: float, inside: float) -> Complex:
        """theta_1^d, theta_2^d, F_x, F_y and the moment at t, in the segment of `inside`."""
        load = np.zeros(3, dtype=np.complex128)
        for own in self._loads:
            if "impulse" in own or own["time"].real > inside:
                continue
            if "duration" in own and (own["time"] + own["duration"]).real < inside:
                continue
            wave: Any = 1.0
            if "frequency_hz" in own:
                wave = np.sin(math.tau * own["frequency_hz"] * (t - own["time"]) + own["phase"])
            load += wave * np.array([*own["force"], own["moment"]])
        return np.concatenate([self._target(t, inside), load])

    def _target(self, t: float, inside: float) -> Complex:
        times, angles, kind = self._times, self._angles, self._scene.schedule.kind
        k = int(np.searchsorted(times.real, inside, side="right")) - 1
        if k < 0:
            return np.asarray(angles[0])
        if kind == "ramps" and k + 1 < len(times):
            share = (t - times[k]) / (times[k + 1] - times[k])
            return np.asarray(angles[k] + share * (angles[k + 1] - angles[k]))
        if kind == "minimum_jerk" and k > 0 and inside < (times[k] + self._move).real:
            share = (t - times[k]) / self._move
            way = share**3 * (10 - 15 * share + 6 * share**2)
            return np.asarray(angles[k - 1] + way * (angles[k] - angles[k - 1]))
        return np.asarray(angles[k])
