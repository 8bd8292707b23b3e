"""A JAX function of a computation outside of JAX that also has derivatives: a custom JVP."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from ..support import checks
from ..support.arrays import Floats

# Name of a result -> its array. Integers have no derivative.
Results: TypeAlias = dict[str, np.ndarray[Any, Any]]
# Result -> path -> derivative, of the shape of the result and then that of the value.
Slopes: TypeAlias = dict[str, dict[str, Floats]]
Shapes: TypeAlias = Mapping[str, tuple[int, ...]]


def require_float64() -> None:
    """Refuses JAX's default of 32 bits, which would round values and results."""
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise RuntimeError(
            "softpinch.jax needs numbers of 64 bits, and JAX is set to 32: call "
            'jax.config.update("jax_enable_x64", True) at the start of the program'
        )


def array(*shape: int, kind: type = np.float64) -> jax.ShapeDtypeStruct:
    """The shape and type of an array, as JAX describes them."""
    return jax.ShapeDtypeStruct(shape, kind)  # type: ignore[no-untyped-call]


def differentiable(
    shapes: Shapes,
    results: Mapping[str, jax.ShapeDtypeStruct],
    check: Callable[[dict[str, Floats]], object],
    derive: Callable[[dict[str, Floats], Sequence[str]], tuple[Results, Slopes]],
    many: Callable[[dict[str, Floats]], Results] | None = None,
) -> Callable[[Mapping[str, Any]], dict[str, jax.Array]]:
    """Makes a function of values by path to results by name, for JAX.

    A batch (`vmap`) is one call back to Python. The tangents are a contraction of the derivatives,
    which depend on the values only: hence JAX can transpose it, and `grad` works. `check` refuses
    wrong values outside of callbacks, in which JAX buries the message of an error. `derive`
    computes results of one run, and derivatives by some paths; `many` results of all runs at once.
    """
    smooth = [name for name, each in results.items() if each.dtype == np.float64]

    def primal(*values: Any) -> Results:
        batch, runs = runs_of(values)
        if many is not None and len(next(iter(runs.values()))) > 1:
            return _reshaped(many(runs), batch)
        return sloped((), *values)[0]

    def sloped(by: Sequence[str], *values: Any) -> tuple[Results, Slopes]:
        batch, runs = runs_of(values)
        count, each = len(next(iter(runs.values()))), []
        for k in range(count):
            try:
                each.append(derive({path: value[k] for path, value in runs.items()}, by))
            except ValueError as error:
                if count == 1:
                    raise
                raise ValueError(f"run {k}: {error}") from None
        found = {name: np.stack([one[name] for one, _ in each]) for name in results}
        slopes = {
            name: {path: np.stack([slope[name][path] for _, slope in each]) for path in by}
            for name in smooth
        }
        return _reshaped(found, batch), {
            name: _reshaped(slope, batch) for name, slope in slopes.items()
        }

    def runs_of(values: Sequence[Any]) -> tuple[tuple[int, ...], dict[str, Floats]]:
        """Returns the shape of the batch, and the values of its runs in one axis."""
        arrays = [np.asarray(value, dtype=np.float64) for value in values]
        first = next(iter(shapes.values()))
        batch = arrays[0].shape[: arrays[0].ndim - len(first)]
        return batch, {
            path: value.reshape((-1, *shape))
            for (path, shape), value in zip(shapes.items(), arrays, strict=True)
        }

    @jax.custom_jvp
    def function(*values: jax.Array) -> dict[str, jax.Array]:
        out: dict[str, jax.Array] = jax.pure_callback(
            primal, dict(results), *values, vmap_method="broadcast_all"
        )
        return out

    @partial(function.defjvp, symbolic_zeros=True)
    def tangent(values: Any, dots: Any) -> tuple[Any, Any]:
        paths = list(shapes)
        # A value that is constant for JAX needs no derivative, and costs nothing.
        moved = {
            path: dot
            for path, dot in zip(paths, dots, strict=True)
            if not isinstance(dot, SymbolicZero)
        }
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
        tangents: dict[str, Any] = {}
        for name, each in results.items():
            if name not in smooth:
                tangents[name] = np.zeros(each.shape, jax.dtypes.float0)
                continue
            total = jnp.zeros(each.shape)
            for path, dot in moved.items():
                total += jnp.tensordot(slopes[name][path], dot, axes=len(shapes[path]))
            # Rows that a run does not reach are constant. A zero slope alone would not do: the
            # derivative of a loss is NaN there, and JAX multiplies both.
            tangents[name] = jnp.where(jnp.isnan(out[name]), 0.0, total)
        return out, tangents

    def layer(values: Mapping[str, Any]) -> dict[str, jax.Array]:
        require_float64()
        arrays = _checked(values, shapes)
        if not any(isinstance(array, jax.core.Tracer) for array in arrays):
            check(dict(zip(shapes, map(np.asarray, arrays), strict=True)))
        return function(*arrays)

    return layer


def _reshaped(runs: dict[str, Any], batch: tuple[int, ...]) -> dict[str, Any]:
    """Gives the runs' axis the shape of the batch."""
    return {name: value.reshape(batch + value.shape[1:]) for name, value in runs.items()}


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
