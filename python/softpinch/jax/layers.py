"""`simulate` and `final_state`, which make JAX functions of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from .. import _core
from ..montecarlo import monte_carlo
from ..run.options import MOST_STEPS, STOP_ON, Options, names
from ..run.request import Request
from ..run.simulate import simulate as run_of
from ..scene import Noise, SampledController, Scene, Stabilization
from ..scene.fields import QUANTITIES
from ..scene.template import SceneTemplate
from ..support import checks
from ..support.arrays import Floats

# The statuses of runs, in the order of the numbers in `Trajectory.status`.
STATUSES: tuple[str, ...] = _core.STATUSES
_RECORDABLE = ("multipliers", "torque")
# Name of a result -> its array. Integers have no derivative.
Results: TypeAlias = dict[str, np.ndarray[Any, Any]]
# Result -> path -> derivative, of the shape of the result and then that of the value.
Slopes: TypeAlias = dict[str, dict[str, Floats]]
Shapes: TypeAlias = Mapping[str, tuple[int, ...]]
Values: TypeAlias = Mapping[str, Any]


class Trajectory(NamedTuple):
    """All recorded rows of a run, as JAX arrays.

    The rows that a run does not reach are NaN, and their derivatives are zero, so that a loss that
    leaves them out has its own gradient.

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
        """True if the run has reached its end."""
        return self.status == 0


class FinalState(NamedTuple):
    """The last row of a `Trajectory`: t (), s, q (9,), p (9,) and status.

    If the run ended early, t is the instant at which it did.
    """

    t: jax.Array
    q: jax.Array
    p: jax.Array
    status: jax.Array

    @property
    def completed(self) -> jax.Array:
        """True if the run has reached its end."""
        return self.status == 0


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

    A call has the bits of `sp.simulate`, also in `jit`, which calls back to Python. `jvp`,
    `jacfwd`, `grad` and `jacrev` have the derivatives of `sp.simulate(..., sensitivities=...)`, all
    in forward mode: the time grows with the number of varied numbers that JAX derives by. There are
    no second derivatives. They hold at fixed instants, although the rows around a switch that a
    value moves (such as "disturbances.0.time") move with it: use the last row there, or
    `final_state`. After an event that ends them they are NaN, and so is a gradient with such rows
    in its sum. `vmap` makes one call for a batch, which computes one run after another.

    Args:
        vary: Dotted paths of the numbers that are arguments, as in `sp.monte_carlo`. The number of
            rows must not depend on them.
        dt: Longest step, s, as for `sp.simulate`; 1e-4 if it is None. The error control of
            `tolerance` is not offered: its number of rows depends on the values.
        method, formulation, stabilization, every, stop_on: As for `sp.simulate`.
        record: Groups to return beside the state: "multipliers", "torque".

    Returns:
        A function of a dictionary, path -> value, that has all paths of `vary`. It raises
        ValueError or TypeError if a path, a shape or a value is wrong (within `jit`, JAX makes its
        own exception of it, with the message), and RuntimeError if JAX's numbers have 32 bits. A
        run that fails has a status instead.
    """
    record = names("record", record, _RECORDABLE)
    how = (dt, method, formulation, stabilization, ("state", *record), every, stop_on)
    template, options = _prepared(scene, vary, *how)
    steps = Request(scene, options).simulation().outline()["steps"]
    assert steps is not None  # known for equal steps
    layer = _layer(template, options, record, rows=1 + -(-steps // options.every))
    unrecorded: dict[str, Any] = dict.fromkeys(_RECORDABLE)
    return lambda values: Trajectory(**(unrecorded | layer(values)))


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
        vary, dt, method, formulation, stabilization, stop_on: As for `simulate`.
    """
    how = (dt, method, formulation, stabilization, "state", MOST_STEPS, stop_on)
    template, options = _prepared(scene, vary, *how)
    # An ensemble gives every run noise of its own, and a layer is a function of its values only.
    alike = not any(isinstance(one, Noise) for one in scene.disturbances)
    lanes = alike and not isinstance(scene.control, SampledController)

    def together(runs: dict[str, Floats]) -> Results:
        vary: dict[Any, Any] = {**runs}
        many = monte_carlo(scene, vary=vary, progress=False, **options.numerics())
        if many.interrupted:
            raise KeyboardInterrupt
        state = many["final_state"]
        status = np.array([STATUSES.index(one) for one in many.status], np.int32)
        return {"t": many["end_time"], "q": state[:, :9], "p": state[:, 9:], "status": status}

    layer = _layer(template, options, many=together if lanes else None)
    return lambda values: FinalState(**layer(values))


def _prepared(scene: Scene, vary: str | Sequence[str], *how: Any) -> tuple[SceneTemplate, Options]:
    require_float64()
    checks.instance("scene", scene, Scene)
    options = Options.checked(*how)
    paths = [vary] if isinstance(vary, str) else checks.several("vary", vary, "paths")
    if not paths:
        raise ValueError("vary = (): must have at least one path")
    return SceneTemplate(scene, paths, 0), options


def _layer(
    template: SceneTemplate,
    options: Options,
    record: Sequence[str] = (),
    rows: int | None = None,
    many: Callable[[dict[str, Floats]], Results] | None = None,
) -> Callable[[Values], dict[str, jax.Array]]:
    """Makes the JAX function of a run's rows, or of its last row alone if `rows` is None.

    A batch (`vmap`) is one call back to Python; `many` computes the results of all its runs. The
    tangents are a contraction of the derivatives, which depend on the values only: hence JAX can
    transpose it, and `grad` works.
    """
    shapes = template.shapes
    columns = {name: len(QUANTITIES[name].columns) for name in ("q", "p", *record)}
    first = () if rows is None else (rows,)
    results = {"t": array(*first), **{name: array(*first, k) for name, k in columns.items()}}
    results["status"] = array(kind=np.int32)
    smooth = ("t", *columns)

    def shaped(value: Floats, fill: float) -> Any:
        if rows is None:
            return value[-1]
        filled = np.full((rows, *value.shape[1:]), fill)
        filled[: len(value)] = value
        return filled

    def derive(values: dict[str, Floats], by: Sequence[str]) -> tuple[Results, Slopes]:
        how = options.numerics() | {"record": options.record, "every": options.every}
        run = run_of(template.changed(values), **how, sensitivities=by)
        if run.status == "interrupted":
            raise KeyboardInterrupt
        if rows is not None and (len(run) > rows or (run.success and len(run) < rows)):
            counts = f"the run has {len(run)} rows, and {rows} with those of the scene"
            rule = "a layer's number of rows must not depend on its values"
            raise ValueError(f"vary: with these values {counts}; {rule}")
        found = {name: shaped(getattr(run, name), np.nan) for name in smooth}
        found["status"] = np.array(STATUSES.index(run.status), np.int32)
        slopes: Slopes = {name: {} for name in smooth}
        for path in by:
            both = run.sensitivity[path]
            slopes["t"][path] = np.zeros((len(run), *shapes[path]))
            slopes["q"][path], slopes["p"][path] = both[:, :9], both[:, 9:]
            for name in record:
                slopes[name][path] = getattr(run.sensitivity, name)[path]
        return found, jax.tree.map(lambda value: shaped(value, 0.0), slopes)

    def primal(*values: Any) -> Results:
        batch, runs = runs_of(values)
        if many is not None and len(next(iter(runs.values()))) > 1:
            return {k: value.reshape(batch + value.shape[1:]) for k, value in many(runs).items()}
        return sloped((), *values)[0]

    def sloped(by: Sequence[str], *values: Any) -> tuple[Results, Slopes]:
        batch, runs = runs_of(values)
        count, each = len(next(iter(runs.values()))), []
        for k in range(count):
            with checks.reworded(f"run {k}: " if count > 1 else ""):
                each.append(derive({path: value[k] for path, value in runs.items()}, by))
        # Results and derivatives are nested dictionaries of arrays.
        stacked: tuple[Results, Slopes] = jax.tree.map(
            lambda *rows: np.stack(rows).reshape(batch + np.shape(rows[0])), *each
        )
        return stacked

    def runs_of(values: Sequence[Any]) -> tuple[tuple[int, ...], dict[str, Floats]]:
        """Returns the shape of the batch, and the values of its runs in one axis."""
        arrays = [np.asarray(value, dtype=np.float64) for value in values]
        first = next(iter(shapes.values()))
        batch = arrays[0].shape[: arrays[0].ndim - len(first)]
        pairs = zip(shapes.items(), arrays, strict=True)
        return batch, {path: value.reshape((-1, *shape)) for (path, shape), value in pairs}

    @jax.custom_jvp
    def function(*values: jax.Array) -> dict[str, jax.Array]:
        out: dict[str, jax.Array] = jax.pure_callback(
            primal, dict(results), *values, vmap_method="broadcast_all"
        )
        return out

    @partial(function.defjvp, symbolic_zeros=True)
    def tangent(values: Any, dots: Any) -> tuple[Any, Any]:
        # A value that is constant for JAX needs no derivative, and costs nothing.
        pairs = zip(shapes, dots, strict=True)
        moved = {path: dot for path, dot in pairs if not isinstance(dot, SymbolicZero)}
        struct = {
            name: {path: array(*results[name].shape, *shapes[path]) for path in moved}
            for name in smooth
        }
        out, slopes = jax.pure_callback(
            partial(sloped, tuple(moved)),
            (dict(results), struct),
            *values,
            vmap_method="broadcast_all",
        )
        tangents: dict[str, Any] = {"status": np.zeros(results["status"].shape, jax.dtypes.float0)}
        for name in smooth:
            total = jnp.zeros(results[name].shape)
            for path, dot in moved.items():
                total += jnp.tensordot(slopes[name][path], dot, axes=len(shapes[path]))
            # Rows that a run does not reach are constant. A zero slope alone would not do: the
            # derivative of a loss is NaN there, and JAX multiplies both.
            tangents[name] = jnp.where(jnp.isnan(out[name]), 0.0, total)
        return out, tangents

    def layer(values: Mapping[str, Any]) -> dict[str, jax.Array]:
        require_float64()
        arrays = _checked(values, shapes)
        # JAX buries the message of an error in a callback.
        if not any(isinstance(array, jax.core.Tracer) for array in arrays):
            template.changed(dict(zip(shapes, map(np.asarray, arrays), strict=True)))
        return function(*arrays)

    return layer


def require_float64() -> None:
    """Refuses JAX's default of 32 bits, which would round values and results."""
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        advice = 'call jax.config.update("jax_enable_x64", True) at the start of the program'
        rule = "needs numbers of 64 bits, and JAX is set to 32"
        raise RuntimeError(f"softpinch.jax {rule}: {advice}")


def array(*shape: int, kind: type = np.float64) -> jax.ShapeDtypeStruct:
    """The shape and type of an array, as JAX describes them."""
    return jax.ShapeDtypeStruct(shape, kind)  # type: ignore[no-untyped-call]


def _checked(values: Mapping[str, Any], shapes: Shapes) -> list[jax.Array]:
    """Checks names and shapes, which JAX knows while it traces, and makes arrays of 64 bits."""
    checks.refuse_unknown("values", values, shapes, "")
    arrays = []
    for path, shape in shapes.items():
        if path not in values:
            raise ValueError(f"values: {path!r} is missing")
        try:
            array = jnp.asarray(values[path], dtype=np.float64)
        except (TypeError, ValueError):
            text = f"values[{path!r}] = {checks.shown(values[path])}: must be numbers"
            raise TypeError(text) from None
        if array.shape != shape:
            raise ValueError(f"values[{path!r}]: has shape {array.shape}, must have {shape}")
        arrays.append(array)
    return arrays
