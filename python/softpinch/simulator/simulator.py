"""`Simulator` and `VectorSimulator`: one run, and many at once, that are stepped from outside."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run import Request, Run, simulate
from ..run.options import STOP_ON, Options
from ..scene import Sampled, Schedule, Stabilization, usual
from ..scene.control import WRITTEN
from ..scene.motion import ConstantMotion, HandMotion
from ..scene.scene import Scene, State, require_fit
from ..study.sources import Key
from ..study.spec import StudySpec
from ..support import Floats, Formulation, Method, Recordable, Shown, Violation, checks, text_of

# The name of a status's code in the core: a run that goes on, and then the ways to end.
STATUSES = ("running", *_core.STATUSES)
# Numbers that are kept of each period: its start, torques, force, moment and acceleration.
_KEPT = 8
_NAMES = np.array(STATUSES)
# Largest number of runs; their states take 10 GB.
_MOST = 10_000_000


class Observation(NamedTuple):
    """Observation of a run at the end of a period.

    Attributes:
        t: Time, s.
        q: Coordinates (9,), m and rad, in the order of `State.q`.
        p: Rates of the coordinates (9,), m/s and rad/s.
        multipliers: lambda_1^H, lambda_2^H, lambda_1^N, lambda_2^N, (4,), N, under the torques of
            the period that has just ended. At a start they are those under the schedule's torques.
        status: "running", or the status with which the run has ended: "completed" at the end of
            the scene's duration, or one of those of `Run.status`.
    """

    t: float
    q: NDArray[np.float64]
    p: NDArray[np.float64]
    multipliers: NDArray[np.float64]
    status: str

    def __repr__(self) -> str:
        return text_of("Observation", self._asdict())


class Stepped(Shown):
    """The base of both simulators: a checked scene and the options of its equal steps."""

    _core: _core.Simulator

    def __init__(self, scene: Scene, period: float, *how: Any, stop_on: Any) -> None:
        """Takes dt, method, formulation and stabilization as `how` to step."""
        checks.instance("scene", scene, Scene)
        if scene.law not in ("torque", "pid", "sampled"):
            rule = "control=Torque(), whose torques it sets, or another law, whose targets it sets"
            raise ValueError(f"Scene.{WRITTEN[scene.law]}: a simulator needs {rule}")
        self._scene = scene
        self._options = Options.checked(*how, stop_on=stop_on)
        self._period = checks.positive("period", period)
        usual.warn(scene, schedule_replaced=True)

    def _state(self, run: int) -> State:
        time, q, p, (right, left, *branches), grid, *rest = self._core.state(run)
        # The stabilisation lets states drift off the constraints.
        check = self._options.formulation != "csm"
        state = State(q, p, (right, left), time, check, grid, None, *rest)
        return replace(state, relaxation=np.array(branches)) if branches else state

    def _checked(self, name: str, state: State) -> State:
        """Checks a state from which a run is to go on."""
        checks.instance(name, state, State)
        require_fit(self._scene, name, state)
        return state

    def _along_fixed_axes(
        self, acceleration: ArrayLike, tilts: Floats | None = None, runs: tuple[int, ...] = ()
    ) -> Floats:
        """Turns accelerations of a step along the axes of hands, after checks, (*runs, 2)."""
        motion = self._scene.motion
        if not isinstance(motion, ConstantMotion):
            rule = f"which must be HandMotion.constant(...) and is {checks.shown(motion)}"
            raise ValueError(f"acceleration: takes the place of the one of Scene.motion, {rule}")
        shape = (*runs, 2) if np.ndim(acceleration) == 2 else (2,)
        x, y = checks.array("acceleration", acceleration, shape).T
        tilts = np.broadcast_to(motion.tilt if tilts is None else tilts, runs)
        cos, sin = np.cos(tilts), np.sin(tilts)
        return np.stack([x * cos - y * sin, y * cos + x * sin], axis=-1)

    @property
    def period(self) -> float:
        """Time for which the torques of one step are held, s."""
        return self._period

    def __reduce__(self) -> NoReturn:
        # A copy would share the state in the core, but not the record of the steps.
        advice = "take its state() and give it to set_state() or reset() of another one"
        raise TypeError(f"{type(self).__name__} cannot be copied or pickled: {advice}")


class Simulator(Stepped):
    """One run that is stepped from outside, period by period, with torques that are held in each.

        sim = sp.Simulator(sp.Scene(control=sp.Torque()), period=1e-3, dt=1e-4)
        observation = sim.reset()
        while observation.status == "running":
            observation = sim.step(my_policy(observation))
        run = sim.run()

    Period k goes from start + k * period to start + (k + 1) * period; the last one ends with the
    scene's duration. A step ends at each of these instants, so that a method keeps its order. The
    torques take the place of the scene's schedule; its disturbances act as in `simulate`. A scene
    with a PID takes the target angles of its fingers, rad, instead of torques, and one with a
    `SampledController` its targets, those of the first block of a cascade.

    n periods have the bits of one `simulate` whose schedule steps to the same torques at the same
    instants; `run()` is that run. Violations are watched as there: in each period from its start,
    and at its end under the period's own torques. After an argument that is refused, and after
    Ctrl-C, the simulator is as before.

    The state is kept in the core, so that a simulator is not copied or pickled; for `run()` it also
    keeps 64 bytes for each period since the last `reset` or `set_state`. The core takes equal
    steps: `tolerance` is not offered, because its steps depend on all earlier states.
    """

    def __init__(
        self,
        scene: Scene,
        period: float = 1e-3,
        dt: float | None = None,
        method: Method = "rk4",
        formulation: Formulation = "csm",
        stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
        stop_on: Violation | Sequence[Violation] = STOP_ON,
    ) -> None:
        """Puts a scene at its start.

        Args:
            scene: The scene; its duration is that of the run.
            period: Time for which the torques of one `step` are held, s.
            dt, method, formulation, stabilization, stop_on: As for `simulate`.
        """
        super().__init__(scene, period, dt, method, formulation, stabilization, stop_on=stop_on)
        self._core = _core.Simulator.alone(Request(scene, self._options).simulation(), self._period)
        self._start: State | None = None
        self._force = (0.0, 0.0, 0.0)
        motion = scene.motion
        self._usual = motion.acceleration if isinstance(motion, ConstantMotion) else (0.0, 0.0)
        self._seen = self._begin()

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self._scene

    @property
    def observation(self) -> Observation:
        """The last observation, which `reset`, `step` and `set_state` also return."""
        return self._seen

    @property
    def message(self) -> str:
        """The status in words, with the numbers; empty while the run goes on."""
        if self._seen.status == "completed":
            return f"reached the end at t = {self._seen.t:.6g} s"
        return self._core.message(0)

    def reset(self, state: State | None = None) -> Observation:
        """Puts the run at its start, and takes away the force of `set_force`.

        From a given `state` it lasts for the scene's duration, counted from the state's time.
        """
        self._core.reset(0, None if state is None else self._checked("state", state))
        self._start, self._force = state, (0.0, 0.0, 0.0)
        return self._begin()

    def step(self, torque: ArrayLike, acceleration: ArrayLike | None = None) -> Observation:
        """Goes on for one period.

        Args:
            torque: Torques on the right and the left finger (2,), N m, a positive one closes its
                finger; or the target angles of the fingers of a PID, rad. Of jaws: forces, N, or
                travels, m.
            acceleration: Acceleration (a_x, a_y) of the hand along its own axes in this period,
                m/s^2, instead of that of the scene's motion, a `HandMotion.constant`; None keeps
                that one.
        """
        before = self._seen
        if before.status != "running":
            end = f"with status {before.status!r} at t = {before.t:.6g} s"
            raise ValueError(f"step: the run has ended {end}; reset() begins it again")
        right, left = _torque_pair(torque)
        own = None if acceleration is None else self._along_fixed_axes(acceleration).tolist()
        t, q, p, multipliers, code = self._core.step(right, left, own)
        self._held.extend((before.t, right, left, *self._force, *(own or self._usual)))
        self._seen = Observation(t, q, p, multipliers, STATUSES[code])
        return self._seen

    def set_force(self, force: ArrayLike = (0.0, 0.0), moment: float = 0.0) -> None:
        """Sets an external force on the object, held from the next step on until it is set again.

        It is (F_x, F_y) at the centre of gravity, N, and a counter-clockwise moment, N m, beside
        the scene's disturbances.
        """
        found = (*checks.pair("force", force), checks.finite("moment", moment))
        self._core.set_force(0, found)
        self._force = found

    def state(self) -> State:
        """Returns the present state, from which `set_state` or another run goes on, to the bit."""
        return self._state(0)

    def set_state(self, state: State) -> Observation:
        """Goes on from a state, at its time, for example to try another way from there.

        The end of the run and the force of `set_force` stay. Periods begin at the instants at
        which they would have begun anyway, if the state's time is one of them. Then the next steps
        have the same bits as at first. `run()` begins at this state.
        """
        self._core.set_state(0, self._checked("state", state))
        self._start = state
        return self._begin()

    def run(
        self, record: Recordable | Sequence[Recordable] = _core.RECORDABLE, every: int = 1
    ) -> Run:
        """Computes the run since the last `reset` or `set_state` again, with its whole recording.

        It has the bits of the steps, and its scene has their torques as its schedule, the forces of
        `set_force` as one more disturbance, and their accelerations as its motion. After
        `set_state` its last instant may differ by one unit of round-off, because not every sum of a
        start and a duration is the end of a period. The arguments are those of `simulate`.
        """
        if not self._held:
            raise ValueError("run: there has been no step since the start")
        held = np.array(self._held).reshape(-1, _KEPT)
        times, disturbances = held[:, 0], self._scene.disturbances
        initial = self._scene.initial if self._start is None else self._start
        if isinstance(initial, State):
            # A period begins a segment of its own, wherever the state comes from.
            initial = replace(initial, grid=None, linearized=None)
        # Periods begin segments; only the targets of a `SampledController` do not by themselves.
        if held[:, 3:6].any() or self._scene.law == "sampled":
            force = Sampled(times=times, force=held[:, 3:5], moment=held[:, 5])
            disturbances = (*disturbances, force)
        motion, accelerations = self._scene.motion, held[:, 6:]
        if isinstance(motion, ConstantMotion) and (accelerations != motion.acceleration).any():
            motion = HandMotion.sampled(times, None, accelerations, motion.tilt, hold=True)
        scene = replace(
            self._scene,
            motion=motion,
            schedule=Schedule.steps(times, held[:, 1:3]),
            disturbances=disturbances,
            duration=_duration(times[0], self._core.end(0)),
            initial=initial,
        )
        return simulate(scene, record=record, every=every, **self._options.numerics())

    def _begin(self) -> Observation:
        t, q, p, multipliers, code = self._core.observation(0)
        self._held = array("d")
        self._seen = Observation(t, q, p, multipliers, STATUSES[code])
        return self._seen

    def __repr__(self) -> str:
        seen = self._seen
        steps = f"{len(self._held) // _KEPT} periods of {self._period} s"
        return f"<Simulator {seen.status}: t = {seen.t:.6g} s, {steps}>"


def _torque_pair(torque: ArrayLike) -> tuple[float, float]:
    """Converts torques, the usual types of them without the cost of an array."""
    given: Any = torque.tolist() if type(torque) is np.ndarray and torque.dtype == float else torque
    if type(given) in (list, tuple) and len(given) == 2:
        right, left = given
        if type(right) is float and type(left) is float and math.isfinite(right + left):
            return right, left
    return checks.pair("torque", torque)


def _duration(start: float, end: float) -> float:
    """Returns a duration that leads from `start` to exactly `end` in floating-point numbers."""
    duration = end - start
    for near in (duration, math.nextafter(duration, math.inf), math.nextafter(duration, 0.0)):
        if start + near == end:
            return near
    return duration


def checked_actions(actions: ArrayLike, n: int, each: str) -> NDArray[np.float64]:
    """Converts actions (n, 2) to a contiguous array; errors call one of the n an `each`."""
    given = checks.numbers("actions", actions)
    if given.shape != (n, 2):
        raise ValueError(f"actions have shape {given.shape}: must be ({n}, 2)")
    wrong = np.argwhere(~np.isfinite(given))
    if len(wrong):
        k, finger = wrong[0].tolist()
        rule = f"must be finite ({each} {k})"
        raise ValueError(f"actions[{k}, {finger}] = {given[k, finger]}: {rule}")
    return np.ascontiguousarray(given, dtype=np.float64)


class Observations(NamedTuple):
    """Observations of n runs at the ends of their periods; `Observation` has the details.

    Arrays: t (n,), q and p (n, 9), multipliers (n, 4), and status (n,), as text.
    """

    t: NDArray[np.float64]
    q: NDArray[np.float64]
    p: NDArray[np.float64]
    multipliers: NDArray[np.float64]
    status: NDArray[np.str_]

    def __repr__(self) -> str:
        return text_of("Observations", self._asdict())


class VectorSimulator(Stepped):
    """Many runs that are stepped from outside at once, each as a `Simulator` steps it, to the bit.

        sims = sp.VectorSimulator(sp.Scene(control=sp.Torque()), n=256, vary={...}, seed=3)
        t, q, p, multipliers, status = sims.step(actions)

    Run k has the scene of run k of `monte_carlo(scene, runs=n, vary=..., seed=...)`, its noise
    included. A run that has ended keeps its last state, and takes no actions until `reset`.
    """

    def __init__(
        self,
        scene: Scene,
        n: int,
        period: float = 1e-3,
        dt: float | None = None,
        method: Method = "rk4",
        formulation: Formulation = "csm",
        stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
        stop_on: Violation | Sequence[Violation] = STOP_ON,
        *,
        vary: Mapping[Key, Any] | None = None,
        seed: int = 0,
        threads: int = 1,
    ) -> None:
        """Puts all runs at their starts.

        Args:
            scene: The scene that all runs share, apart from the varied values.
            n: Number of runs.
            period, dt, method, formulation, stabilization, stop_on: As for `Simulator`. The methods
                "rk4", "dop853" and "rosenbrock" compute several runs in each instruction.
            vary, seed: As for `monte_carlo`.
            threads: Largest number of threads of a step. To wake a second thread costs up to 0.1 ms
                at every step, so that it pays from about 2500 integration steps a call on, for
                example 250 runs and 10 steps a period.
        """
        super().__init__(scene, period, dt, method, formulation, stabilization, stop_on=stop_on)
        threads = checks.integer("threads", threads, 1, 4096)
        n = checks.integer("n", n, 1, _MOST)
        spec = StudySpec.checked(scene, self._options, runs=n, seed=seed, vary=vary, summaries=())
        runs = spec.block(np.arange(n, dtype=np.uint64))
        self._spec, self._values = spec, spec.values(runs)
        spec.varied.check(self._values, runs.run)
        self._core = _core.Simulator.many(spec.batch(runs), self._period, threads)
        self._codes = np.zeros(n, np.uint8)
        t, q, p, multipliers = np.empty(n), np.empty((n, 9)), np.empty((n, 9)), np.empty((n, 4))
        self._seen = Observations(t, q, p, multipliers, np.empty(n, _NAMES.dtype))

    @property
    def n(self) -> int:
        """Number of runs."""
        return len(self._codes)

    @property
    def observations(self) -> Observations:
        """The present observations, in the simulator's own arrays."""
        t, q, p, multipliers, status = self._seen
        self._core.observe((t, q, p, multipliers, self._codes))
        _NAMES.take(self._codes, out=status, mode="clip")
        return self._seen

    def scene(self, run: int) -> Scene:
        """Returns the scene of a run, with its own values."""
        run = self._run(run)
        own = {path: value[run] for path, value in self._values.items()}
        return self._spec.varied.at(own, run)

    def message(self, run: int) -> str:
        """Returns the status of a run in words; empty if it goes on or has reached its end."""
        return self._core.message(self._run(run))

    def step(
        self,
        actions: ArrayLike,
        out: Observations | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Observations:
        """Steps all runs that have not ended by one period.

        Args:
            actions: Torques on the right and the left finger of each run (n, 2), N m; or the target
                angles of the fingers of a PID, rad. Those of a run that has ended are ignored.
            out: Arrays to write to, of the shapes and types of `Observations`, contiguous and
                without overlap; None writes to the simulator's own, which the next step overwrites.
            acceleration: As for `Simulator.step`, of all hands (2,), or of each (n, 2).

        After an error, which names its run, and after Ctrl-C all runs are as before the step.
        """
        given = actions
        # The usual case skips the checks: the core refuses numbers that are not finite.
        if not (type(given) is np.ndarray and (given.dtype, given.shape) == (float, (self.n, 2))):
            given = checked_actions(actions, self.n, "run")
        own = None
        if acceleration is not None:
            tilts = self._values.get("motion.tilt")
            own = self._along_fixed_axes(acceleration, tilts, (self.n,))
        seen = self._seen if out is None else self._required(out)
        t, q, p, multipliers, status = seen
        try:
            self._core.step_all(given, own, (t, q, p, multipliers, self._codes))
        except ValueError:
            # The core has refused a number that is not finite; this error also names the run.
            checked_actions(given, self.n, "run")
            raise
        _NAMES.take(self._codes, out=status, mode="clip")
        return seen

    def reset(
        self, state: State | Sequence[State] | None = None, mask: ArrayLike | None = None
    ) -> Observations:
        """Puts runs at their starts, and takes away their forces of `set_force`.

        Args:
            state: The state from which all of them start, or one for each of the n runs; None
                starts each as its scene does.
            mask: Which runs (n,), as booleans; None is all of them. The others stay as they are.

        If a state is refused, the error names its run; the runs before it have their new states.
        """
        states = (None,) * self.n if state is None else self._all_checked(state)
        self._set_states(self._core.reset, states, mask)
        return self.observations

    def set_force(
        self, force: ArrayLike = (0.0, 0.0), moment: ArrayLike = 0.0, mask: ArrayLike | None = None
    ) -> None:
        """Sets external forces on the objects, held from the next step on until they are set again.

        Args:
            force, moment: As for `Simulator.set_force`, of all runs, or of each (n, 2) and (n,).
            mask: As for `reset`.
        """
        n = self.n
        forces = checks.array("force", force, (n, 2) if np.ndim(force) == 2 else (2,))
        moments = checks.array("moment", moment, (n,) if np.ndim(moment) else ())
        # Lists: to take each row out of an array costs more than the core's part does.
        x, y = np.broadcast_to(forces, (n, 2)).T.tolist()
        given = list(zip(x, y, np.broadcast_to(moments, (n,)).tolist(), strict=True))
        for run in self._masked(mask):
            self._core.set_force(run, given[run])

    def state(self, run: int) -> State:
        """Returns the present state of a run, from which `set_state` or another run goes on."""
        return self._state(self._run(run))

    def set_state(
        self, state: State | Sequence[State], mask: ArrayLike | None = None
    ) -> Observations:
        """Goes on from states, as `Simulator.set_state`; the arguments are those of `reset`."""
        self._set_states(self._core.set_state, self._all_checked(state), mask)
        return self.observations

    def _run(self, run: int) -> int:
        run = checks.integer("run", run)
        if not 0 <= run < self.n:
            raise IndexError(f"run = {checks.shown(run)}: must be from 0 to {self.n - 1}")
        return run

    def _masked(self, mask: ArrayLike | None) -> list[int]:
        if mask is None:
            return list(range(self.n))
        given = checks.read("mask", mask)
        if given.dtype != np.bool_ or given.shape != (self.n,):
            raise ValueError(f"mask = {checks.shown(mask)}: must be {self.n} booleans, (n,)")
        return np.flatnonzero(given).tolist()

    def _set_states(
        self, place: Callable[[int, Any], None], states: Sequence[Any], mask: ArrayLike | None
    ) -> None:
        """Gives each run its state by `place`; an error has the number of its run."""
        for run in self._masked(mask):
            with checks.reworded(f"run {run}: "):
                place(run, states[run])

    def _required(self, out: Observations) -> Observations:
        """Refuses arrays that do not fit; the core refuses those that overlap."""
        checks.instance("out", out, Observations, "Observations")
        for name, given, own in zip(out._fields, out, self._seen, strict=True):
            fits = type(given) is np.ndarray and given.shape == own.shape
            # `carray` is contiguous, aligned and writable.
            if not (fits and given.dtype == own.dtype and given.flags.carray):
                rule = f"must be a contiguous array of shape {own.shape} and type {own.dtype}"
                raise ValueError(f"out.{name}: {rule}")
        return out

    def _all_checked(self, state: State | Sequence[State]) -> Sequence[State]:
        """Converts a state for all runs, or one for each, as the core takes them (n,)."""
        if isinstance(state, State):
            return (self._checked("state", state),) * self.n
        if not isinstance(state, list | tuple) or len(state) != self.n:
            raise TypeError(f"state: must be a State, or {self.n} of them, one for each run")
        return [self._checked(f"state[{k}]", each) for k, each in enumerate(state)]

    def __repr__(self) -> str:
        goes_on = int((self.observations.status == STATUSES[0]).sum())
        return f"<VectorSimulator of {self.n} runs, {goes_on} running, {self._period} s a period>"
