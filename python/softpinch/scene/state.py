"""`State`, the system's state at one instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..support import checks
from ..support.arrays import read_only
from ..support.record import Record


@runtime_checkable
class Described(Protocol):
    """The part of `Scene` that a state needs. `Scene` itself imports this module."""

    @property
    def contact(self) -> str:
        """The contact model."""

    @property
    def law(self) -> str:
        """What moves the fingers."""

    def parameters(self) -> NDArray[np.float64]:
        """Returns the physical parameters (38,)."""

    def _start_position(self) -> tuple[float, float]: ...


@dataclass(frozen=True, eq=False, repr=False)
class State(Record):
    """The state of the system at one instant, from which a run can start.

    Attributes:
        q: Coordinates (9,): x, y, theta, theta_1, theta_2, d_n1, d_n2, d_t1, d_t2, m and rad.
        p: Rates of the coordinates (9,), m/s and rad/s.
        integral: The integrals of the angle errors in (39), (right, left), rad s.
        time: Time on the clock of schedule and disturbances, s.
        check: Whether a run refuses to start if the state violates the constraints. False allows
            it, for formulation="csm" only.
        grid: (start time of the current segment, s; steps taken since then). With it a continued
            run repeats the step times of the original run and gives identical bits. None starts a
            new grid.
        linearized: The point (21,) at which an implicit method evaluated the Jacobian that it still
            uses: time since the segment's start, q, p, integral. None evaluates a new Jacobian.
        contact: The contacts (4,) of a run with contact="unilateral", from which another run goes
            on; a scene with bilateral contact refuses them. They are, for the right and the left
            tip, a code (0 free, 1 stick, 2 or -2 slip with the face moving up or down over the
            tip, 3 graze, 4 or -4 graze while the face moves up or down), then the tilts that are
            frozen while the tips are free, rad. None lets the contacts follow from `q` and `p`.
        controller: The state of a `SampledController` in a run, from which another run goes on: the
            instant of its first sample, s; the numbers of samples taken and in force; the torques
            in force (2,), N m; xi (n,); and the torques under way. None starts the controller at
            `time`.
    """

    q: NDArray[np.float64]
    p: NDArray[np.float64] = field(default_factory=lambda: np.zeros(9))
    integral: tuple[float, float] = (0.0, 0.0)
    time: float = 0.0
    check: bool = True
    grid: tuple[float, int] | None = None
    linearized: NDArray[np.float64] | None = None
    contact: NDArray[np.float64] | None = None
    controller: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Checks shapes and that numbers are finite. The core checks the constraints."""
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
        if self.contact is not None:
            self._set("contact", checks.array("State.contact", self.contact, (4,)))
        if self.controller is not None:
            self._set("controller", self._controller_row())

    def _controller_row(self) -> NDArray[np.float64]:
        """Checks `controller`, whose torques under way may be infinite: a run then ends later."""
        row = checks.numbers("State.controller", self.controller)
        if row.ndim != 1 or np.isnan(row).any():
            raise ValueError(
                f"State.controller = {checks.shown(self.controller)}: must be numbers, (k,)"
            )
        return read_only(row.copy())

    @classmethod
    def consistent(
        cls,
        scene: Described,
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
        """Makes the state with a given pose, shear and velocity that satisfies the constraints.

        The compressions follow from C^H = 0 (9), the rates of compression and shear from
        Phi p = 0 (25). A tip that does not reach the object gives a negative compression in
        `q[5:7]`, not an error.

        Args:
            scene: The `Scene` whose geometry is used.
            x: Horizontal position of the centre of gravity, m; None takes the scene's start.
            y: Vertical position of the centre of gravity, m, upwards; None takes the scene's start.
            rotation: theta, rad.
            fingers: theta_1 and theta_2 (2,), rad.
            shear: d_t1 and d_t2 (2,), m.
            velocity: Rates of x, y and theta (3,), m/s and rad/s.
            finger_rates: Rates of theta_1 and theta_2 (2,), rad/s.
            integral: Integrals of the angle errors (2,), rad s.
            time: Time on the clock of schedule and disturbances, s.

        Raises:
            ValueError: A shape is wrong or a number is not finite; or x or y is None and the
                scene's own start does not exist.
            TypeError: A value is not a number, or `scene` is not a `Scene`.
        """
        checks.instance("scene", scene, Described, "a Scene")
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


def require_fit(scene: Described, name: str, state: State) -> None:
    """Refuses a state that has what a scene has not; errors call the state `name`.

    Raises:
        ValueError: It has contacts in a bilateral scene, or a controller's state in one without.
    """
    if state.contact is not None and scene.contact == "bilateral":
        raise ValueError(
            f"{name}.contact = {checks.shown(state.contact)}: must be None "
            'with contact = "bilateral", in which contacts have no modes'
        )
    if state.controller is not None and scene.law != "sampled":
        raise ValueError(
            f"{name}.controller: must be None, because control is no SampledController"
        )
