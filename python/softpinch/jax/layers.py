"""`simulate` and `final_state`, which make JAX functions of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import numpy as np

from .. import _core
from ..montecarlo import monte_carlo
from ..run.options import MOST_STEPS, STOP_ON, Options, names
from ..run.run import Run
from ..run.simulate import described, not_interrupted
from ..run.simulate import simulate as run_of
from ..scene.disturbance import Noise
from ..scene.sampled_control import SampledController
from ..scene.scene import Scene
from ..scene.stabilization import Stabilization
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Floats
from .callback import Results, Slopes, array, differentiable, require_float64

# The statuses of runs, in the order of the numbers in `Trajectory.status`.
STATUSES: tuple[str, ...] = _core.STATUSES
_RECORDABLE = ("multipliers", "torque")
# Result -> number of its columns.
_COLUMNS = {"q": 9, "p": 9, "multipliers": 4, "torque": 2}


class Trajectory(NamedTuple):
    """All recorded rows of a run, as JAX arrays.

    A run that ends early has fewer rows than one that reaches its end: the others are NaN, and
    their derivatives are zero, so that a loss that leaves them out has its own gradient.

    Attributes:
        t: Recorded instants (n,), s.
        q: Coordinates (n, 9), m and rad, in the order of `State.q`.
        p: Rates of the coordinates (n, 9), m/s and rad/s.
        multipliers: Multipliers (n, 4), N; None unless recorded.
        torque: Torques on the fingers (n, 2), N m; None unless recorded.
        status: Index in `softpinch.jax.STATUSES` of the run's status; 0 is "completed".
    """

    t: jax.Array
    q: jax.Array
    p: jax.Array
    multipliers: jax.Array | None
    torque: jax.Array | None
    status: jax.Array

    @property
    def completed(self) -> jax.Array:
        """Whether the run has reached its end, as a boolean."""
        return self.status == 0


class FinalState(NamedTuple):
    """The last state of a run, as JAX arrays.

    Attributes:
        t: The instant, s: the end of the scene's duration, or that at which the run ended.
        q: Coordinates (9,), m and rad, in the order of `State.q`.
        p: Rates of the coordinates (9,), m/s and rad/s.
        status: Index in `softpinch.jax.STATUSES` of the run's status; 0 is "completed".
    """

    t: jax.Array
    q: jax.Array
    p: jax.Array
    status: jax.Array

    @property
    def completed(self) -> jax.Array:
        """Whether the run has reached its end, as a boolean."""
        return self.status == 0


Values: TypeAlias = Mapping[str, Any]


def simulate(
    scene: Scene,
    vary: str | Sequence[str],
    dt: float | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    record: str | Sequence[str] = (),
    every: int = 1,
    stop_on: str | Sequence[str] = STOP_ON,
) -> Callable[[Values], Trajectory]:
    """Makes a JAX function of the varied numbers of a scene, which simulates it.

        layer = softpinch.jax.simulate(scene, ("grasped.mass", "schedule.angles"), dt=1e-3)
        run = layer({"grasped.mass": 0.1, "schedule.angles": angles})

    `jit` calls back to Python; one call has the bits that it has without `jit`, and those of
    `sp.simulate`. `jvp`, `jacfwd`, `grad` and `jacrev` have the derivatives of
    `sp.simulate(..., sensitivities=...)`, all in forward mode: the time grows with the number of
    varied numbers that JAX derives by, and not with the number of results. There are no second
    derivatives. `vmap` makes one call for a batch, which computes one run after another;
    `final_state` uses the lanes of the core.

    Args:
        scene: The scene.
        vary: Dotted paths of the numbers that are arguments, as in `sp.monte_carlo`. The number of
            rows must not depend on them.
        dt: Longest step, s, as for `sp.simulate`; 1e-4 if it is None. The error control of
            `tolerance` is not offered: its number of rows depends on the values.
        method: The integration method, as for `sp.simulate`.
        formulation: How the constraints are enforced, as for `sp.simulate`.
        stabilization: The gains of (19) and (20), for "csm".
        record: What to return beside the state: "multipliers", "torque".
        every: Number of steps between rows; the last instant is always a row.
        stop_on: The violations that end a run, as for `sp.simulate`.

    Returns:
        A function of a dictionary, path -> value, that has all paths of `vary`. It raises
        ValueError or TypeError if a path or a shape is wrong, and RuntimeError if JAX's numbers
        have 32 bits. A value that breaks a rule of the scene is an error too; within `jit`, JAX
        makes its own exception of it, with the message. A run that fails has a status instead.

    Raises:
        ValueError: An argument breaks its rule, or a path does not exist.
        TypeError: An argument has the wrong type.
        RuntimeError: JAX's numbers have 32 bits: `jax_enable_x64` is not set.
    """
    record = names("record", record, _RECORDABLE)
    template, options = _prepared(
        scene,
        vary,
        dt=dt,
        method=method,
        formulation=formulation,
        stabilization=stabilization,
        record=("state", *record),
        every=every,
        stop_on=stop_on,
    )
    steps = described(scene, options).outline()["steps"]
    assert steps is not None  # known for equal steps
    rows = 1 + -(-steps // options.every)
    columns = {name: _COLUMNS[name] for name in ("q", "p", *record)}
    results = {
        "t": array(rows),
        **{name: array(rows, k) for name, k in columns.items()},
        "status": array(kind=np.int32),
    }

    def padded(value: Floats, fill: float) -> Floats:
        whole = np.full((rows, *value.shape[1:]), fill)
        whole[: len(value)] = value
        return whole

    def arrays(run: Run) -> Results:
        if len(run) > rows or (run.success and len(run) < rows):
            raise ValueError(
                f"vary: with these values the run has {len(run)} rows, and {rows} with those of "
                "the scene; a layer's number of rows must not depend on its values"
            )
        found = {name: padded(getattr(run, name), np.nan) for name in ("t", *columns)}
        return {**found, "status": np.array(STATUSES.index(run.status), np.int32)}

    def compute(values: dict[str, Floats]) -> Results:
        return arrays(_run(template, values, options))

    def derive(values: dict[str, Floats], by: Sequence[str]) -> tuple[Results, Slopes]:
        run = _run(template, values, options, by)
        slopes = _slopes(run, by, record)
        slopes["t"] = {path: np.zeros((len(run), *template.shapes[path])) for path in by}
        return arrays(run), {
            name: {path: padded(value, 0.0) for path, value in each.items()}
            for name, each in slopes.items()
        }

    layer = differentiable(template.shapes, results, template.changed, compute, derive)

    def trajectory(values: Values) -> Trajectory:
        found: dict[str, Any] = {"multipliers": None, "torque": None, **layer(values)}
        return Trajectory(**found)

    return trajectory


def final_state(
    scene: Scene,
    vary: str | Sequence[str],
    dt: float | None = None,
    method: str = "rk4",
    formulation: str = "csm",
    stabilization: Stabilization = Stabilization(),  # noqa: B008, it is frozen
    stop_on: str | Sequence[str] = STOP_ON,
) -> Callable[[Values], FinalState]:
    """Makes a JAX function of the varied numbers of a scene, which returns the state at its end.

    As `simulate`, but `vmap` computes a batch as `sp.monte_carlo` does: in the lanes of the core,
    on all cores, with the bits of single runs. The derivatives of a batch are those of one run
    after another. The number of steps may depend on the values here.

    Args:
        scene: The scene. If it has noise, a batch is one run after another, with equal noise.
        vary: Dotted paths of the numbers that are arguments.
        dt: Longest step, s, as for `sp.simulate`; 1e-4 if it is None.
        method: The integration method, as for `sp.simulate`.
        formulation: How the constraints are enforced, as for `sp.simulate`.
        stabilization: The gains of (19) and (20), for "csm".
        stop_on: The violations that end a run, as for `sp.simulate`.

    Returns:
        A function of a dictionary, path -> value, as `simulate` has it. A run that ends early gives
        its last state, and a status.

    Raises:
        ValueError: An argument breaks its rule, or a path does not exist.
        TypeError: An argument has the wrong type.
        RuntimeError: JAX's numbers have 32 bits: `jax_enable_x64` is not set.
    """
    template, options = _prepared(
        scene,
        vary,
        dt=dt,
        method=method,
        formulation=formulation,
        stabilization=stabilization,
        record="state",
        every=MOST_STEPS,
        stop_on=stop_on,
    )
    results = {"t": array(), "q": array(9), "p": array(9), "status": array(kind=np.int32)}
    # An ensemble gives every run noise of its own, and a layer is a function of its values only.
    alike = not any(isinstance(one, Noise) for one in scene.disturbances)
    lanes = alike and not isinstance(scene.control, SampledController)

    def arrays(run: Run) -> Results:
        last = {name: getattr(run, name)[-1] for name in ("t", "q", "p")}
        return {**last, "status": np.array(STATUSES.index(run.status), np.int32)}

    def compute(values: dict[str, Floats]) -> Results:
        return arrays(_run(template, values, options))

    def together(runs: dict[str, Floats]) -> Results:
        vary: dict[Any, Any] = {**runs}
        many = monte_carlo(scene, vary=vary, progress=False, **options.numerics())
        if many.interrupted:
            raise KeyboardInterrupt
        state = many["final_state"]
        status = np.array([STATUSES.index(one) for one in many.status], np.int32)
        return {"t": many["end_time"], "q": state[:, :9], "p": state[:, 9:], "status": status}

    def derive(values: dict[str, Floats], by: Sequence[str]) -> tuple[Results, Slopes]:
        run = _run(template, values, options, by)
        slopes = _slopes(run, by, ())
        slopes["t"] = {path: np.zeros((1, *template.shapes[path])) for path in by}
        return arrays(run), {
            name: {path: value[-1] for path, value in each.items()} for name, each in slopes.items()
        }

    layer = differentiable(
        template.shapes, results, template.changed, compute, derive, together if lanes else None
    )

    def state(values: Values) -> FinalState:
        return FinalState(**layer(values))

    return state


def _prepared(
    scene: Scene, vary: str | Sequence[str], **given: Any
) -> tuple[SceneTemplate, Options]:
    """Checks the arguments that both kinds of layers have."""
    require_float64()
    checks.instance("scene", scene, Scene)
    options = Options.checked(**given)
    paths = [vary] if isinstance(vary, str) else checks.several("vary", vary, "paths")
    if not paths:
        raise ValueError("vary = (): must have at least one path")
    return SceneTemplate(scene, paths, 0), options


def _run(
    template: SceneTemplate,
    values: dict[str, Floats],
    options: Options,
    sensitivities: Sequence[str] = (),
) -> Run:
    run = run_of(
        template.changed(values),
        **options.numerics(),
        record=options.record,  # type: ignore[arg-type]
        every=options.every,
        sensitivities=sensitivities,
    )
    return not_interrupted(run)


def _slopes(run: Run, by: Sequence[str], record: Sequence[str]) -> Slopes:
    """The derivatives of a run's rows by each path."""
    found = run.sensitivity
    slopes = {
        "q": {path: found[path][:, :9] for path in by},
        "p": {path: found[path][:, 9:] for path in by},
    }
    return slopes | {name: {path: getattr(found, name)[path] for path in by} for name in record}
