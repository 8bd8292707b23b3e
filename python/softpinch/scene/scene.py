"""A scene: hand, grasped object, control, what is asked of the fingers and what disturbs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..support import checks
from ..support.arrays import read_only
from ..support.record import SIDES, Parser, Record
from . import usual
from .compilation import inputs
from .disturbance import Disturbance
from .hand import GraspedObject, Hand, Pid, name_sides, one_or_pair, take_one_or_pair
from .schedule import Schedule


@dataclass(frozen=True, eq=False, repr=False)
class State(Record):
    """Where a run starts, or is.

    Attributes:
        q: (9,), x, y, theta, theta_1, theta_2, d_n1, d_n2, d_t1, d_t2 in m and rad.
        p: (9,), their rates in m/s and rad/s.
        integral: The integrals of the angles' errors in (39), right and left, rad s.
        time: On the clock of schedule and disturbances, s.
        check: Whether a state off the constraints is refused. False starts there, for
            formulation="csm" only.
        grid: (start of the segment in s, steps taken since), so that a run that goes on takes the
            same steps to the same bits; None starts afresh.
        linearized: (21,), where an implicit method took the Jacobian that it still uses: time since
            the segment's start, q, p, integral; None takes a new one.
    """

    q: NDArray[np.float64]
    p: NDArray[np.float64] = field(default_factory=lambda: np.zeros(9))
    integral: tuple[float, float] = (0.0, 0.0)
    time: float = 0.0
    check: bool = True
    grid: tuple[float, int] | None = None
    linearized: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Checks shapes and that numbers are finite; the core checks the constraints."""
        self._set("q", checks.array("State.q", self.q, (9,)))
        self._set("p", checks.array("State.p", self.p, (9,)))
        self._set("integral", checks.pair("State.integral", self.integral))
        self._set("time", checks.finite("State.time", self.time))
        self._set("check", checks.boolean("State.check", self.check))
        if self.grid is not None:
            if not isinstance(self.grid, tuple | list) or len(self.grid) != 2:
                raise TypeError(
                    f"State.grid = {checks.shown(self.grid)}: must be (segment start, steps taken)"
                )
            anchor = checks.finite("State.grid[0]", self.grid[0])
            self._set("grid", (anchor, checks.integer("State.grid[1]", self.grid[1], 0, 2**63 - 1)))
        if self.linearized is not None:
            self._set("linearized", checks.array("State.linearized", self.linearized, (21,)))

    @classmethod
    def consistent(
        cls,
        scene: Scene,
        *,
        x: float | None = None,
        y: float | None = None,
        rotation: float = 0.0,
        fingers: ArrayLike = (0.0, 0.0),
        shear: ArrayLike = (0.0, 0.0),
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        finger_rates: ArrayLike = (0.0, 0.0),
        integral: ArrayLike = (0.0, 0.0),
        time: float = 0.0,
    ) -> Self:
        """The state on the constraints that has this pose, shear and velocity.

        The compressions follow from C^H = 0 (9), the rates of compression and shear from
        Phi p = 0 (25). Whether the tips reach the object is not asked: look at `q[5:7]`.

        Args:
            scene: Whose geometry.
            x: Of the centre of gravity, m; None is where the scene's own start has it.
            y: The same, upwards, m.
            rotation: theta, rad.
            fingers: (2,), theta_1 and theta_2, rad.
            shear: (2,), d_t1 and d_t2, m.
            velocity: (3,), rates of x, y and theta, m/s and rad/s.
            finger_rates: (2,), rates of theta_1 and theta_2, rad/s.
            integral: (2,), rad s.
            time: s.

        Raises:
            ValueError: A shape is wrong or a number not finite.
            TypeError: Something is no number.
        """
        checks.instance("scene", scene, Scene)
        start = scene._start_position() if x is None or y is None else (0.0, 0.0)
        pose = [
            start[0] if x is None else checks.finite("x", x),
            start[1] if y is None else checks.finite("y", y),
            checks.finite("rotation", rotation),
            *checks.pair("fingers", fingers),
        ]
        rates = [
            *checks.array("velocity", velocity, (3,)),
            *checks.pair("finger_rates", finger_rates),
        ]
        q, p = _core.consistent(
            scene.parameters(),
            np.array(pose),
            checks.array("shear", shear, (2,)),
            np.array(rates),
        )
        return cls(q, p, integral=checks.pair("integral", integral), time=time)

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        if isinstance(data, Mapping) and isinstance(data.get("grid"), list):
            data = {**data, "grid": tuple(data["grid"])}
        return super()._parse(data, path)


def _parse_initial(data: Any, path: str) -> Any:
    return data if isinstance(data, str) else State._parse(data, path)


def _parse_disturbances(data: Any, path: str) -> Any:
    if not isinstance(data, list | tuple):
        raise TypeError(f"Scene.disturbances = {checks.shown(data)}: must be an array of tables")
    return tuple(Disturbance._parse(item, checks.below(path, k)) for k, item in enumerate(data))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Scene(Record):
    """What is simulated: the physics, and nothing of the numerics.

    Attributes:
        hand: The fingers and their tips.
        grasped: The object.
        control: The gains of both fingers, or a pair (right, left).
        schedule: The angles that the fingers are asked for.
        fingers: "pid" turns them by the torques of (39); "driven" has them where the schedule has
            them, at every instant, as position control with torque to spare would. Then their
            angles leave the equations: `control` and the fingers' inertia move nothing, and the
            torque that it takes is a result (`Run.torque`). The schedule must have no step and no
            kink, as `Schedule.minimum_jerk` has none.
        disturbances: What pushes the object; forces add up.
        gravity: g, downwards, m/s^2.
        duration: From the start on, s.
        initial: None starts with straight fingers at rest, in point contact or pressed, or with
            driven ones where the schedule has them, the object still; "touching" with the fingers
            closed until both tips touch; a `State` where it says.
        friction: mu, above which |lambda^N| / lambda^H is noted as slipping; None notes nothing.

    Raises:
        ValueError: A value breaks its rule; the message has the field, the value and the rule.
        TypeError: A value is of the wrong kind.
    """

    hand: Hand = field(default_factory=Hand)
    grasped: GraspedObject = field(default_factory=GraspedObject)
    control: Pid | tuple[Pid, Pid] = field(default_factory=Pid)
    schedule: Schedule = field(
        default_factory=lambda: Schedule.steps([0.0], np.deg2rad([[6.0, 6.0]]))
    )
    disturbances: Sequence[Disturbance] = ()
    gravity: float = 9.81
    duration: float = 1.0
    initial: State | str | None = None
    friction: float | None = None
    fingers: str = "pid"

    _parsers: ClassVar[Mapping[str, Parser]] = {
        "hand": Hand._parse,
        "grasped": GraspedObject._parse,
        "control": one_or_pair(Pid),
        "schedule": Schedule._parse,
        "disturbances": _parse_disturbances,
        "initial": _parse_initial,
    }

    def __post_init__(self) -> None:
        """Checks kinds and numbers."""
        super().__post_init__()
        checks.instance("Scene.hand", self.hand, Hand)
        checks.instance("Scene.grasped", self.grasped, GraspedObject)
        checks.instance("Scene.schedule", self.schedule, Schedule)
        self._set("control", take_one_or_pair("Scene.control", self.control, Pid))
        if not isinstance(self.disturbances, tuple | list):
            raise TypeError(
                f"Scene.disturbances = {checks.shown(self.disturbances)}: must be a sequence"
            )
        self._set("disturbances", tuple(self.disturbances))
        for k, disturbance in enumerate(self.disturbances):
            checks.instance(f"Scene.disturbances[{k}]", disturbance, Disturbance)
        checks.choice("Scene.fingers", self.fingers, _core.FINGERS)
        if isinstance(self.initial, str):
            checks.choice("Scene.initial", self.initial, ("touching",))
            if self.fingers == "driven":
                raise ValueError(
                    'Scene.initial = "touching": with fingers="driven" the schedule says where '
                    "they start; leave it None, or give a State"
                )
        elif self.initial is not None:
            checks.instance("Scene.initial", self.initial, State)

    def parameters(self) -> NDArray[np.float64]:
        """The physics as numbers (36,), in the order of `_core.PARAMETERS`, SI units."""
        return self._parameters

    # A scene never changes: what is compiled once serves every run of it.
    @cached_property
    def _parameters(self) -> NDArray[np.float64]:
        return read_only(np.array([self._parameter(path) for path in _core.PARAMETERS]))

    @cached_property
    def _inputs(self) -> _core.Inputs:
        return inputs(self.schedule, self.disturbances, self.fingers)

    @cached_property
    def _suspicions(self) -> tuple[str, ...]:
        return usual.suspicions(self)

    @cached_property
    def _start(self) -> State:
        if isinstance(self.initial, State):
            return self.initial
        if self.fingers == "driven":
            return State(*_core.start_driven(self.parameters(), self.inputs(), 0.0))
        return State(_core.start(self.parameters(), self.initial or "contact"))

    def _parameter(self, path: str) -> float:
        node: Any = self
        for name in path.split("."):
            if isinstance(node, tuple):
                node = node[SIDES.index(name)]
            elif name not in SIDES or isinstance(node, Hand):
                node = getattr(node, name)
            # Else one record stands for both sides.
        if node is None:
            # A tip without masses has the object's (14), and no friction given is no limit.
            node = np.inf if path == "friction" else self.grasped.mass
        return float(node)

    def inputs(self) -> _core.Inputs:
        """Schedule and disturbances as the core takes them."""
        return self._inputs

    def start(self) -> State:
        """The state that a run begins with.

        Raises:
            ValueError: The fingertips do not reach the object; the message has the gap in mm.
        """
        return self._start

    def _start_position(self) -> tuple[float, float]:
        """Where the start has the object, also where straight fingers leave a gap."""
        if self.initial is None and self.fingers == "pid":
            return self.grasped.com_offset, 0.5 * (self.hand.right.length + self.hand.left.length)
        x, y = self.start().q[:2].tolist()
        return x, y

    def to_dict(self) -> dict[str, Any]:
        """As a dictionary of plain data; a pair of controls as `right` and `left`."""
        return name_sides(self.control, super().to_dict(), "control")

    def to_toml(self) -> str:
        """As a TOML scene file, every number exact. Needs the extra `cli`.

        Raises:
            ImportError: tomli_w is not installed.
        """
        from ..support import toml  # most programs read and write no file

        return toml.dumps(self.to_dict(), "scene")

    @classmethod
    def from_toml(cls, source: str | Path) -> Self:
        """From a TOML scene file.

        What is left out takes its default. `hand.tip` and `control` are one table, or two named
        `right` and `left`. A schedule may have `angles_deg` in the place of `angles`.

        Args:
            source: The text, or the file's `Path`.

        Raises:
            ValueError: It is no TOML, or as `from_dict`.
            TypeError: As `from_dict`.
            OSError: The file cannot be read.
        """
        from ..support import toml

        return cls.from_dict(toml.read(source))
