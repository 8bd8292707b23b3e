"""`Scene`, the complete physics of a run, `State`, and their conversion to the core's inputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Never, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..support import ContactModel, Fingers, Floats, ShownTable, checks, read_only
from ..support.record import SIDES, Parser, Record, array_of
from . import parts, usual
from .contact import coefficients, pair_of, parse_friction
from .control import WRITTEN, Control, Law, Pid, SampledController, Torque, parse_control
from .disturbance import Compiled, Disturbance, Noise
from .hand import GraspedObject, Hand, name_sides, take_one_or_pair
from .motion import HandMotion
from .outline import drawings
from .parts import PAPERS, Mechanism
from .paths import PathTable, changed, paths_of
from .schedule import Schedule, default_schedule


@dataclass(frozen=True, eq=False, repr=False)
class State(Record):
    """The state of the system at one instant, from which a run can start.

    Attributes:
        q: Coordinates (9,): x, y, theta, theta_1, theta_2, d_n1, d_n2, d_t1, d_t2, m and rad; of a
            `Jaw` theta_i is its travel, m.
        p: Rates of the coordinates (9,), m/s and rad/s.
        integral: The integrals of the angle errors in (39), (right, left), rad s.
        time: Time on the clock of schedule and disturbances, s.
        check: Whether a run refuses to start if the state violates the constraints. False allows
            it, for formulation="csm" only.
        grid: (start time of the current segment, s; steps taken since then). With it a continued
            run repeats the step times of the original run and gives identical bits. None starts a
            new grid.
        linearized: The point (21,) at which an implicit method evaluated the Jacobian that it still
            uses: time since the segment's start, q, p, integral, and the states of `Maxwell`
            branches. None evaluates a new Jacobian.
        contact: The contacts (4,) of a run with contact="unilateral", from which another run goes
            on; a scene with bilateral contact refuses them. They are, for the right and the left
            tip, a code (0 free, 1 stick, 2 or -2 slip with the face moving up or down over the
            tip, 3 graze, 4 or -4 graze while the face moves up or down), then the tilts that are
            frozen while the tips are free, rad. None lets the contacts follow from `q` and `p`.
        controller: The state of a `SampledController` in a run: the instant at which it started, s;
            the numbers of samples taken and in force; the torques in force (2,), N m; xi (n,); the
            torques under way; measurements that are kept, and how many were used. In a cascade it
            is so of each block, the last one first. None starts the controller at `time`.
        relaxation: The states of `Maxwell` branches (k,), for each branch the remembered forces of
            the right and the left tip, N, and their remembered shears, m. None is branches that
            have relaxed.
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
    relaxation: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        # The core checks the constraints.
        for name, size in {"q": 9, "p": 9, "contact": 4}.items():
            value = getattr(self, name)
            if value is not None or size == 9:
                self._set(name, checks.array(f"State.{name}", value, (size,)))
        branches = 0
        if self.relaxation is not None:
            self._set("relaxation", checks.array("State.relaxation", self.relaxation, ("k",)))
            branches = len(self.relaxation)
        if self.linearized is not None:
            point = checks.array("State.linearized", self.linearized, (21 + branches,))
            self._set("linearized", point)
        self._set("integral", checks.pair("State.integral", self.integral))
        self._set("time", checks.finite("State.time", self.time))
        self._set("check", checks.boolean("State.check", self.check))
        if self.grid is not None:
            if not isinstance(self.grid, tuple | list) or len(self.grid) != 2:
                rule = "must be (segment start, steps taken)"
                raise TypeError(f"State.grid = {checks.shown(self.grid)}: {rule}")
            anchor = checks.finite("State.grid[0]", self.grid[0])
            self._set("grid", (anchor, checks.integer("State.grid[1]", self.grid[1], 0, 2**63 - 1)))
        if self.controller is not None:
            # Its torques under way may be infinite: a run then ends later.
            row = checks.numbers("State.controller", self.controller)
            if row.ndim != 1 or np.isnan(row).any():
                given = checks.shown(self.controller)
                raise ValueError(f"State.controller = {given}: must be numbers, (k,)")
            self._set("controller", read_only(row.copy()))

    @property
    def _memories(self) -> Floats:
        """The integrals, and the states of branches if these are given."""
        return np.array([*self.integral, *(() if self.relaxation is None else self.relaxation)])

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
        """Makes the state with a given pose, shear and velocity that satisfies the constraints.

        The compressions follow from C^H = 0 (9), the rates of compression and shear from
        Phi p = 0 (25). A tip that does not reach the object gives a negative compression in
        `q[5:7]`, not an error.

        Args:
            scene: The `Scene` whose geometry is used.
            x, y: Position of the centre of gravity, m; None takes that of the scene's start.
            rotation: theta, rad.
            fingers: theta_1 and theta_2 (2,), rad, or travels of jaws, m.
            shear: d_t1 and d_t2 (2,), m.
            velocity: Rates of x, y and theta (3,), m/s and rad/s.
            finger_rates: Rates of theta_1 and theta_2 (2,), rad/s, or m/s.
            integral, time: As for the class.
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
            scene.parameters(), np.array(pose), checks.array("shear", shear, (2,)), np.array(rates)
        )
        return cls(q, p, integral=checks.pair("integral", integral), time=time)


def require_fit(scene: Scene, name: str, state: State) -> None:
    """Refuses a state with contacts, a controller or branches that the scene does not have."""
    needed = 4 * parts.branches(scene)
    if state.relaxation is not None and len(state.relaxation) != needed:
        rule = f"must be {needed} numbers, four for each Maxwell branch, or None"
        raise ValueError(f"{name}.relaxation = {checks.shown(state.relaxation)}: {rule}")
    if state.contact is not None and scene.contact == "bilateral":
        rule = 'must be None with contact = "bilateral", in which contacts have no modes'
        raise ValueError(f"{name}.contact = {checks.shown(state.contact)}: {rule}")
    if state.controller is not None and scene.law != "sampled":
        rule = "must be None, because control is no SampledController"
        raise ValueError(f"{name}.controller: {rule}")


# The fields that differ between runs, if no field does.
_ALIKE: Mapping[str, Floats] = MappingProxyType({})


def inputs(
    schedule: Schedule,
    disturbances: Sequence[Disturbance],
    law: str,
    control: object = None,
    *,
    moves: Mapping[str, Floats] = _ALIKE,
    loads: Sequence[Mapping[str, Floats]] = (),
    gains: Mapping[str, Mapping[str, Floats]] = MappingProxyType({}),
    motion: HandMotion | None = None,
    carries: Mapping[str, Floats] = _ALIKE,
    numbers: NDArray[np.uint64] | None = None,
    seed: int = 0,
) -> _core.Inputs:
    """Converts schedule, disturbances, controller and motion to the core's inputs.

    They are those of one run or of many. `moves`, `loads` and `carries` have the fields of the
    schedule, of each disturbance and of the hand's motion that differ between runs: name ->
    (runs, ...). `gains` has those of each block of a `SampledController`, by its path. The run
    `numbers` (runs,) key the noise together with the study's `seed`; None keeps each noise's own
    `seed` and `run`.
    """

    def one(array: Any) -> Any:
        return np.ascontiguousarray(array[None])

    many = np.ascontiguousarray
    breaks, rows = schedule.compile_runs(moves) if moves else map(one, schedule.compile())
    compiled = [
        load.compile_runs(values).map(many) if values else load.compile().map(one)
        for load, values in zip(disturbances, loads or repeat(_ALIKE), strict=False)
    ]
    noises: list[Any] = []
    for place, (load, arrays) in enumerate(zip(disturbances, compiled, strict=True)):
        for row, own_seed, own_run in arrays.noises:
            row = np.pad(row, ((0, 0), (0, 8 - row.shape[-1])))
            # Only a `Noise` takes the study's seed and run number, as in `SceneTemplate.at`.
            if numbers is None or not isinstance(load, Noise):
                noises.append((row, own_seed, np.array([own_run], np.uint64), place))
            else:
                noises.append((row, seed, numbers, place))
    parts = (
        (many(breaks), many(rows)),
        [force for arrays in compiled for force in arrays.forces],
        [sine for arrays in compiled for sine in arrays.sines],
        [impulse for arrays in compiled for impulse in arrays.impulses],
        noises,
    )
    carried = None
    if motion is not None:
        moved = motion.compile_runs(carries) if carries else motion.compile().map(one)
        carried = moved.core()
    if not isinstance(control, SampledController):
        return _core.Inputs(*parts, law, None, carried)
    blocks = [own.compile_runs(gains.get(path, _ALIKE)) for path, own in control.blocks()][::-1]
    if numbers is None:
        numbers, seed = np.array([control.run], np.uint64), control.seed
    return _core.Inputs(*parts, "torque", (blocks, seed, numbers), carried)


_STARTS = 'must be a State, "touching" or None'


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Scene(Record):
    """A complete description of the physics to simulate. Numerical settings are not part of it.

    Attributes:
        hand: The fingers and their tips.
        grasped: The grasped object.
        control: The PID gains of both fingers, or a pair (right, left); or `Torque()`, with which
            the schedule's values are the torques on the fingers; or a `SampledController`.
        schedule: The target angles of the fingers, rad, or travels of jaws, m; with `Torque()` the
            torques on them, N m, or forces, N.
        fingers: "pid" moves the fingers with the torques of `control`. "driven" prescribes their
            angles: they equal the schedule at every instant, as under ideal position control. Then
            `control` and the fingers' inertia do not affect the motion, and the driving torque is
            a result (`Run.torque`). The schedule must have no jumps and no kinks; use
            `Schedule.minimum_jerk`.
        disturbances: Forces, moments and impulses on the object; they add up.
        gravity: g, downwards, m/s^2.
        duration: Length of the run, s.
        initial: None starts at rest with fingers at zero, in point contact or pressed; with
            "driven" fingers it starts at the schedule's angles, with the object still. "touching"
            closes the fingers until both tips touch the object. A `State` starts from that state.
        friction: Coefficient of friction mu of both contacts, or a pair (right, left). With
            contact="bilateral", |lambda^N| > mu lambda^H is recorded as the violation "slipping",
            and None or infinity records no slipping; "unilateral" needs finite friction.
        contact: "bilateral" is the paper's model: the tips never slip, and they pull where they
            have to. With "unilateral" contact the tips push and never pull, stick as far as
            friction allows, slip, open and close again; and straight fingers that do not reach
            the object are a start too, with free tips.
        motion: The motion of the hand's frame, in which all coordinates are measured; None keeps it
            at rest and upright. Forces and impulses of disturbances act along fixed axes.
    """

    hand: Hand = field(default_factory=Hand)
    grasped: GraspedObject = field(default_factory=GraspedObject)
    control: Control = field(default_factory=Pid)
    schedule: Schedule = field(default_factory=default_schedule)
    disturbances: Sequence[Disturbance] = ()
    gravity: float = 9.81
    duration: float = 1.0
    initial: State | str | None = None
    friction: float | tuple[float, float] | None = None
    fingers: Fingers = "pid"
    contact: ContactModel = "bilateral"
    motion: HandMotion | None = None

    _parsers: ClassVar[Mapping[str, Parser]] = {
        "hand": Hand._parse,
        "grasped": GraspedObject._parse,
        "control": parse_control,
        "schedule": Schedule._parse,
        "disturbances": array_of(Disturbance, "Scene.disturbances"),
        "friction": parse_friction,
        "initial": lambda data, at: data if isinstance(data, str) else State._parse(data, at),
        "motion": HandMotion._parse,
    }

    def __post_init__(self) -> None:
        pair = pair_of(self.friction)
        if pair is not None:
            self._set("friction", None)
        super().__post_init__()
        if pair is not None:
            self._set("friction", pair)
        checks.choice("Scene.contact", self.contact, _core.CONTACT_MODELS)
        if self.contact == "unilateral" and not np.isfinite(coefficients(self.friction)).all():
            rule = 'must be finite where contact = "unilateral", such as 0.5'
            raise ValueError(f"Scene.friction = {checks.shown(self.friction)}: {rule}")
        checks.instance("Scene.hand", self.hand, Hand)
        checks.instance("Scene.grasped", self.grasped, GraspedObject)
        made = "a Schedule, such as Schedule.steps(times, angles)"
        checks.instance("Scene.schedule", self.schedule, Schedule, made)
        if self.schedule.given_in_degrees and any(parts.jaws(self)):
            raise ValueError(
                "Scene.schedule: is in degrees, but the coordinate of a Jaw is its travel, m; use "
                "Schedule.steps, .ramps, .minimum_jerk or .sampled"
            )
        if not isinstance(self.control, Law):
            with checks.reworded(after=", Torque() or SampledController(...)"):
                self._set("control", take_one_or_pair("Scene.control", self.control, Pid))
        if not isinstance(self.disturbances, tuple | list):
            rule = "must be a sequence of disturbances, such as [Step(time=0.1, force=(1.0, 0.0))]"
            raise TypeError(f"Scene.disturbances = {checks.shown(self.disturbances)}: {rule}")
        self._set("disturbances", tuple(self.disturbances))
        for k, disturbance in enumerate(self.disturbances):
            checks.instance(f"Scene.disturbances[{k}]", disturbance, Disturbance)
            shaking = getattr(disturbance, "acceleration_std", 0.0)
            if self.motion is None and np.any(shaking):
                place = f"disturbances[{k}].acceleration_std = {checks.shown(shaking)}"
                raise ValueError(f"{place}: needs a Scene.motion, such as HandMotion.constant()")
        if self.motion is not None:
            made = "a HandMotion, such as HandMotion.minimum_jerk(times, points)"
            checks.instance("Scene.motion", self.motion, HandMotion, made)
        checks.choice("Scene.fingers", self.fingers, ("pid", "driven"))
        if self.fingers == "driven" and self.law != "driven":
            rule = "the schedule prescribes the angles, and the torques are a result"
            raise ValueError(f'Scene.{WRITTEN[self.law]}: with fingers="driven" {rule}')
        if isinstance(self.initial, str):
            if self.initial != "touching":
                raise ValueError(f"Scene.initial = {checks.shown(self.initial)}: {_STARTS}")
            if self.fingers == "driven":
                rule = "the schedule sets the fingers' start; use None or a State"
                raise ValueError(f'Scene.initial = "touching": with fingers="driven" {rule}')
        elif self.initial is not None:
            checks.instance("Scene.initial", self.initial, State, _STARTS.removeprefix("must be "))
            require_fit(self, "Scene.initial", self.initial)

    def with_(self, values: Mapping[str, Any] | None = None, **named: Never) -> Self:
        """Returns a copy of the scene with other values at dotted paths.

            >>> import softpinch as sp
            >>> scene = sp.Scene(disturbances=[sp.Step(time=0.1)])
            >>> pushed = scene.with_({"disturbances.0.force": (5, 2), "grasped.mass": 0.12})
            >>> pushed.disturbances[0]
            Step(time=0.1, force=(5.0, 2.0))

        The paths are those of `vary` in `monte_carlo`, which `vary_paths` lists, and also lead to
        names of choices ("contact"), whole records ("grasped", "hand.tip.left") and optional values
        ("friction": None). All values are set together. Tips without masses of their own take the
        new mass of the object; its inertia is a value of its own, see `GraspedObject.box`.

        Args:
            values: Path -> new value: a number, a pair, an array, a name, a record or None.
            named: For the error only: `with_(friction=0.3)` is written `with_({"friction": 0.3})`,
                because most paths have dots.

        Raises:
            ValueError: A path does not exist (the message suggests the closest), two paths set the
                same number, or a value breaks the rule of its field.
        """
        return changed(self, values, named)  # type: ignore[return-value]

    def vary_paths(self) -> PathTable:
        """Lists the paths that `vary` of `monte_carlo` accepts, with their values and units.

            >>> import softpinch as sp
            >>> sp.Scene().vary_paths()["hand.tip.youngs_modulus"]
            (300000.0, 'Pa')

        It is a mapping, which prints as a table. A value of None is an optional number that is not
        set. The unit is a tuple where the entries of an array differ. Of what both fingers share
        there is one path for both and one for each side, of a pair only the latter. Of an array
        with more than 32 numbers only the path of the whole is listed, though its entries may be
        varied too.
        """
        return paths_of(self)

    def _picture(self) -> str:
        try:
            start = self.start()
        except ValueError:
            return ""  # a run says why it cannot start
        text = f"start, t = {start.time:.6g} s"
        return drawings(self, [np.asarray(start.q)], [text])

    def _tables(self) -> Iterator[ShownTable]:
        """Everything that can be varied, with units."""
        rows = [(path, *entry) for path, entry in self.vary_paths().items()]
        yield ShownTable(("path", "value", "unit"), rows, f"{len(rows)} numbers", folded=True)

    def parameters(self) -> NDArray[np.float64]:
        """Returns the parameters (n,), SI units, in the order of `_core.PARAMETERS`."""
        return self._parameters

    # A scene is immutable, so every run of it can share these cached results.
    @cached_property
    def _parameters(self) -> NDArray[np.float64]:
        found = _core.DEFAULTS.copy()
        found[:PAPERS] = [self._parameter(path) for path in _core.PARAMETERS[:PAPERS]]
        for path, number in parts.numbers(self).items():
            found[_core.PARAMETERS.index(path)] = number
        for side, tip in zip(SIDES, self.hand.tips, strict=True):
            if isinstance(tip.law, parts.MeasuredLaw):
                place = _core.PARAMETERS.index(f"hand.tip.{side}.law.weights")
                found[place : place + len(tip.law.weights)] = tip.law.weights
        return read_only(found)

    @cached_property
    def _loads(self) -> tuple[Compiled, ...]:
        return tuple(disturbance.compile() for disturbance in self.disturbances)

    @cached_property
    def _inputs(self) -> _core.Inputs:
        return inputs(self.schedule, self.disturbances, self.law, self.control, motion=self.motion)

    @cached_property
    def _suspicions(self) -> tuple[str, ...]:
        return usual.suspicions(self)

    @cached_property
    def _start(self) -> State:
        parts.refuse_crossed(self)
        if isinstance(self.initial, State):
            return self.initial
        if self.fingers == "driven":
            return State(*_core.start_driven(self.parameters(), self.inputs(), 0.0, self.contact))
        return State(_core.start(self.parameters(), self._start_kind))

    @property
    def _start_kind(self) -> str:
        """The core's name of a start without a `State`: only unilateral contact allows a gap."""
        return str(self.initial or ("apart" if self.contact == "unilateral" else "contact"))

    @property
    def law(self) -> str:
        """The law that moves the fingers: "pid", "torque", "sampled" or "driven"."""
        if isinstance(self.control, SampledController):
            return "sampled"
        return "torque" if isinstance(self.control, Torque) else self.fingers

    @property
    def schedules_angles(self) -> bool:
        """True if the schedule has angles: not torques, nor a controller's own quantity.

        In a cascade these are the first block's, which may pass its targets on to the next ones.
        """
        if isinstance(self.control, SampledController):
            blocks = [block for _, block in self.control.blocks()]
            own = (block for block in blocks[::-1] if not block.passes_targets)
            return "angle_error" in next(own, blocks[0]).measures
        return self.law != "torque"

    def _parameter(self, path: str) -> float:
        if path.startswith("control.") and self.law in ("torque", "sampled"):
            return 0.0  # the core has no use for gains then
        node: Any = self
        for name in path.split("."):
            if isinstance(node, tuple):
                node = node[SIDES.index(name)]
            elif isinstance(node, Mechanism):
                return float(_core.DEFAULTS[_core.PARAMETERS.index(path)])  # of a link
            elif name not in SIDES or isinstance(node, Hand):
                node = getattr(node, name)
            # Otherwise `name` is a side and both sides share one record.
        if node is None:
            # Tip masses default to the object's mass (14); friction and height to unlimited.
            unlimited = name == "height" or path.startswith("friction")
            node = np.inf if unlimited else self.grasped.mass
        return float(node)

    def inputs(self) -> _core.Inputs:
        """Returns the core's inputs of one run: schedule, disturbances and controller."""
        return self._inputs

    def loads(self) -> tuple[Compiled, ...]:
        """Returns the disturbances as arrays of the core."""
        return self._loads

    def start(self) -> State:
        """Returns the state in which a run starts.

        Raises:
            ValueError: The fingertips do not reach the object; the message has the gap in mm.
        """
        return self._start

    def _start_position(self) -> tuple[float, float]:
        """Returns the object's x and y at the start, even if straight fingers do not reach it."""
        if self.initial is None and self.fingers == "pid":
            apart = _core.start(self.parameters(), "apart")
            return float(apart[0]), float(apart[1])
        x, y = self.start().q[:2].tolist()
        return x, y

    def to_dict(self) -> dict[str, Any]:
        """Converts to plain data; pairs in `control` and `friction` get `right` and `left`."""
        data = name_sides(self.control, super().to_dict(), "control")
        return name_sides(self.friction, data, "friction")

    def to_toml(self) -> str:
        """Returns the text of a TOML scene file with exact numbers. Needs the extra `cli`."""
        from ..support import toml  # most programs do not need it

        return toml.dumps(self.to_dict(), "scene")

    @classmethod
    def from_toml(cls, source: str | Path) -> Self:
        """Reads a scene from TOML text, or from the file at a `Path`.

        Omitted entries take their defaults. `hand.tip` and `control` are either one table or two
        tables named `right` and `left`; `friction` is one number, a list of two (right, left), or a
        table with `right` and `left`. A schedule may have `angles_deg` instead of `angles`.
        """
        from ..support import toml

        return cls.from_dict(toml.read(source))
