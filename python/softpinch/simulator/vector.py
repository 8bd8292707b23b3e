"""`VectorSimulator`: many runs that are stepped from outside at once, in the lanes of the core."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _core
from ..run.options import STOP_ON
from ..scene import usual
from ..scene.scene import Scene, State
from ..scene.stabilization import Stabilization
from ..study.sources import Key
from ..study.spec import StudySpec
from ..support import checks
from ..support.choices import Formulation, Method, Violation
from ..support.display import text_of
from .simulator import STATUSES, Stepped, checked_actions, checked_options, parts_of, state_of

_NAMES = np.array(STATUSES)
# Largest number of runs; their states take 10 GB.
_MOST = 10_000_000


class Observations(NamedTuple):
    """Observations of all runs at the ends of their periods; `Observation` has the details.

    Attributes:
        t: Times (n,), s.
        q: Coordinates (n, 9), m and rad.
        p: Rates of the coordinates (n, 9), m/s and rad/s.
        multipliers: Multipliers (n, 4), N.
        status: Statuses (n,), as text.
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
            period: Time for which the torques of one `step` are held, s.
            dt, method, formulation, stabilization, stop_on: As for `simulate`. The methods "rk4",
                "dop853" and "rosenbrock" compute several runs in each instruction.
            vary: The varied paths, and the sources of their values, as for `monte_carlo`.
            seed: Seed of the draws and of noise, as for `monte_carlo`.
            threads: Largest number of threads of a step. To wake a second thread costs up to 0.1 ms
                at every step, so that it pays from about 2500 integration steps a call on, for
                example 250 runs and 10 steps a period.
        """
        options = checked_options(scene, dt, method, formulation, stabilization, stop_on)
        self._scene = scene
        self._period = checks.positive("period", period)
        threads = checks.integer("threads", threads, 1, 4096)
        n = checks.integer("n", n, 1, _MOST)
        spec = StudySpec.checked(self._scene, options, runs=n, seed=seed, vary=vary, summaries=())
        usual.warn(self._scene, schedule_replaced=True)
        numbers = np.arange(n, dtype=np.uint64)
        self._spec, self._values = spec, spec.plan.rows(numbers)
        spec.varied.check(self._values, numbers)
        batch = spec.batch(numbers, self._values)
        self._core = _core.Simulator.many(batch, self._period, threads)
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

    def step(self, actions: ArrayLike, out: Observations | None = None) -> Observations:
        """Steps all runs that have not ended by one period.

        Args:
            actions: Torques on the right and the left finger of each run (n, 2), N m; or the target
                angles of the fingers of a PID, rad. Those of a run that has ended are ignored.
            out: Arrays to write to, of the shapes and types of `Observations`, contiguous and
                without overlap; None writes to the simulator's own, which the next step overwrites.

        After an error, which names its run, and after Ctrl-C all runs are as before the step.
        """
        given = actions
        # The usual case skips the checks: the core refuses numbers that are not finite.
        if not (type(given) is np.ndarray and (given.dtype, given.shape) == (float, (self.n, 2))):
            given = checked_actions(actions, self.n, "run")
        seen = self._seen if out is None else self._required(out)
        t, q, p, multipliers, status = seen
        try:
            self._core.step_all(given, (t, q, p, multipliers, self._codes))
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
        parts = (None,) * self.n if state is None else self._parts(state)
        self._place(self._core.reset, parts, mask)
        return self.observations

    def set_force(
        self, force: ArrayLike = (0.0, 0.0), moment: ArrayLike = 0.0, mask: ArrayLike | None = None
    ) -> None:
        """Sets external forces on the objects, held from the next step on until they are set again.

        Args:
            force: (F_x, F_y), N, of all runs (2,) or of each (n, 2), beside the disturbances.
            moment: Moments, counter-clockwise, N m, of all runs or of each (n,).
            mask: Which runs (n,), as booleans; None is all of them.
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
        parts = self._core.state(self._run(run))
        return state_of(parts, self._spec.options.formulation)

    def set_state(
        self, state: State | Sequence[State], mask: ArrayLike | None = None
    ) -> Observations:
        """Goes on from states, each at its time, as `Simulator.set_state` does.

        `state` and `mask` are those of `reset`; a state is needed here.
        """
        self._place(self._core.set_state, self._parts(state), mask)
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

    def _place(
        self, place: Callable[[int, Any], None], parts: Sequence[Any], mask: ArrayLike | None
    ) -> None:
        """Gives each run its state by `place`; an error has the number of its run."""
        for run in self._masked(mask):
            try:
                place(run, parts[run])
            except ValueError as error:
                raise ValueError(f"run {run}: {error}") from None

    def _required(self, out: Observations) -> Observations:
        """Refuses arrays that do not fit; the core refuses those that overlap."""
        checks.instance("out", out, Observations, "Observations")
        for name, given, own in zip(out._fields, out, self._seen, strict=True):
            fits = type(given) is np.ndarray and (given.shape, given.dtype) == (
                own.shape,
                own.dtype,
            )
            # `carray` is contiguous, aligned and writable.
            if not (fits and given.flags.carray):
                rule = f"must be a contiguous array of shape {own.shape} and type {own.dtype}"
                raise ValueError(f"out.{name}: {rule}")
        return out

    def _parts(self, state: State | Sequence[State]) -> Sequence[tuple[Any, ...]]:
        """Converts a state for all runs, or one for each, as the core takes them (n,)."""
        if isinstance(state, State):
            return (parts_of(self._scene, "state", state),) * self.n
        if not isinstance(state, list | tuple) or len(state) != self.n:
            raise TypeError(f"state: must be a State, or {self.n} of them, one for each run")
        return [parts_of(self._scene, f"state[{k}]", each) for k, each in enumerate(state)]

    def __repr__(self) -> str:
        goes_on = int((self.observations.status == STATUSES[0]).sum())
        return f"<VectorSimulator of {self.n} runs, {goes_on} running, {self._period} s a period>"
