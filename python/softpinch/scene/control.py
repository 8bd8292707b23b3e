"""What turns the fingers of a scene: a PID (39), torques of the schedule, or a sampled controller.

A new law needs its class, and its `kind` in `LAWS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self, TypeAlias

from ..support import checks
from ..support.kinds import without_kind
from ..support.record import Record
from .hand import one_or_pair, take_one_or_pair
from .sampled_control import SampledController


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Pid(Record):
    """The gains of the PID controller (39) of a finger's angle.

    Attributes:
        kp: K_P, proportional gain, N m/rad.
        kd: K_D, derivative gain, N m s/rad.
        ki: K_I, integral gain, N m/(rad s).
    """

    kp: float = 100.0
    kd: float = 1.0
    ki: float = 1000.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Torque(Record):
    """The schedule's values are the torques on the fingers, N m, instead of target angles.

    A positive torque closes its finger. Between the instants of the schedule the torques are what
    the schedule says: constant for `Schedule.steps`, linear for `Schedule.ramps`. No angle is fed
    back. Give a schedule too: the default one, 0.105 rad for a PID, would be 0.105 N m.
    """

    def to_dict(self) -> dict[str, Any]:
        """Converts to a dictionary with the key `kind`, by which a file tells it from a PID."""
        return {"kind": "torque"}

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        return super()._parse(without_kind("Scene.control", data, "torque", path), path)


Control: TypeAlias = Pid | tuple[Pid, Pid] | Torque | SampledController

# The entry `kind` of a scene file -> class. A PID has none.
LAWS: dict[str, type[Torque | SampledController]] = {"torque": Torque, "sampled": SampledController}
# `Scene.law` -> what moves the fingers then, as it is written.
WRITTEN = {
    "pid": "control=Pid(...)",
    "torque": "control=Torque()",
    "sampled": "control=SampledController(...)",
    "driven": 'fingers="driven"',
}


def parse_control(data: Any, path: str) -> Any:
    """Parses `control` of a scene: the gains of a PID, those of both sides, or a table with `kind`.

    Raises:
        ValueError: The kind is unknown, or a gain breaks its rule.
        TypeError: A value has the wrong type.
    """
    if isinstance(data, Mapping) and "kind" in data:
        kind = checks.choice(f"Scene.control.kind{checks.at(path)}", data["kind"], LAWS)
        return LAWS[kind]._parse(data, path)
    return one_or_pair(Pid)(data, path)


def take_control(value: object) -> object:
    """Checks the field `control` of a scene; a pair of PIDs is returned as a tuple (right, left).

    Raises:
        TypeError: The value is no control.
    """
    if isinstance(value, Torque | SampledController):
        return value
    try:
        return take_one_or_pair("Scene.control", value, Pid)
    except TypeError as error:
        raise TypeError(f"{error}, Torque() or SampledController(...)") from None


def require_known_torque(law: str, name: str) -> None:
    """Refuses a `SampledController`, whose torques depend on the run so far.

    Args:
        law: The scene's `law`.
        name: The function that refuses it.

    Raises:
        ValueError: The law is "sampled".
    """
    if law == "sampled":
        raise ValueError(
            f"Scene.{WRITTEN[law]}: {name} needs the torques at a state, which depend on the run; "
            "replace(scene, control=Torque(), schedule=...) gives the scene between two samples"
        )
