"""The sources of varied values: arrays, distributions and functions, with a common interface."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from ..support import checks
from ..support.arrays import Floats
from . import scipy_names
from .distributions import Distribution
from .quantiles import inside

# The dotted path of a scene's field, or a tuple of paths that are drawn together.
Key: TypeAlias = str | tuple[str, ...]

BLOCK = 1024


class Field:
    """The fields of one key of `vary`: its paths, and the shape of one draw for all of them."""

    def __init__(
        self, key: Key, paths: tuple[str, ...], shapes: Mapping[str, tuple[int, ...]]
    ) -> None:
        """Takes a key of `vary`, its paths, and path -> shape of its field.

        Raises:
            ValueError: The shape of a path is missing.
        """
        for path in paths:
            if path not in shapes:
                raise ValueError(f"{name_of(paths)}: the shape of {path!r} is not known")
        self.name = name_of(paths)
        self.paths = paths
        self.shapes = tuple(shapes[path] for path in paths)
        # Whether a function returns one value for each path instead of a single value.
        self.several = not isinstance(key, str)
        self.sizes = [math.prod(shape) for shape in self.shapes]
        self.shape = self.shapes[0] if len(paths) == 1 else (sum(self.sizes),)

    def split(self, values: Floats) -> dict[str, Floats]:
        """Splits draws (m, *shape) into path -> (m, *shape of its field)."""
        if len(self.paths) == 1:
            return {self.paths[0]: values}
        parts = np.split(values, np.cumsum(self.sizes)[:-1], axis=1)
        return {
            path: np.ascontiguousarray(part).reshape(len(part), *shape)
            for path, shape, part in zip(self.paths, self.shapes, parts, strict=True)
        }

    @property
    def wanted(self) -> str:
        """The required shape, for error messages."""
        if len(self.paths) == 1:
            return f"must have shape {self.shape}"
        return f"must have shape {self.shape}, the numbers of all the paths in a row"

    def check_kind(self, kind: str, shape: tuple[int, ...]) -> None:
        """Refuses a distribution `kind` unless its draws have the field's shape or are numbers."""
        if shape == self.shape or (shape == () and len(self.paths) == 1):
            return
        raise ValueError(f"{self.name}: draws of {kind} have shape {shape}, {self.wanted}")


class Source:
    """The source of a field's values, which gives random draws or maps a sampler's points."""

    def __init__(self, field: Field, value: Any) -> None:
        """Takes the field, and the user's distribution, function or array."""
        self.field = field
        self.value = value

    def dimensions(self, sampler: str) -> int:
        """The number of dimensions of the sampler's points that one draw needs.

        Raises:
            ValueError: The source does not support samplers other than "random".
        """
        raise NotImplementedError

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        """Draws the values of a block (1024, *shape).

        An array returns fewer rows at its end. A function returns `calls` rows.
        """
        raise NotImplementedError

    def from_points(self, points: Floats, block: int) -> Floats:
        """Maps the sampler's points of a block (m, dimensions) to values (m, *shape)."""
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """Describes the source as plain data with a `kind`, for manifests and provenance."""
        raise NotImplementedError


class ArraySource(Source):
    """An array with one entry for each run."""

    def __init__(self, field: Field, value: Any) -> None:
        """Copies the array.

        Raises:
            ValueError: Its rows do not have the field's shape.
            TypeError: It is not numeric.
        """
        # Copy the array, because the caller might change it before all blocks are drawn.
        super().__init__(field, checks.numbers(field.name, value).copy())
        shape = self.value.shape
        if shape[1:] != field.shape:
            rows = f"{shape[:1] + field.shape}, one entry for each run"
            along = "" if len(field.paths) == 1 else ", the numbers of all the paths in a row"
            raise ValueError(f"{field.name} has shape {shape}: must have shape {rows}{along}")

    def dimensions(self, sampler: str) -> int:
        """Zero, because nothing is drawn."""
        return 0

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        """The block's rows."""
        rows: Floats = self.value[block * BLOCK : (block + 1) * BLOCK]
        return rows

    def from_points(self, points: Floats, block: int) -> Floats:
        """The block's rows."""
        rows: Floats = self.value[block * BLOCK : (block + 1) * BLOCK]
        return rows

    def describe(self) -> dict[str, Any]:
        """The shape; a store adds a file."""
        return {"kind": "array", "shape": list(self.value.shape)}


class _OwnDistribution(Source):
    """A distribution of this package."""

    value: Distribution

    def __init__(self, field: Field, value: Distribution) -> None:
        super().__init__(field, value)
        field.check_kind(type(value).__name__, value.shape)
        # The number of draws of the distribution that make one draw of the field.
        self.copies = 1 if value.shape == field.shape else math.prod(field.shape)

    def dimensions(self, sampler: str) -> int:
        return self.copies * self.value.dimensions

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        drawn = self.value.sample(rng, BLOCK * self.copies)
        return drawn.reshape(BLOCK, *self.field.shape)

    def from_points(self, points: Floats, block: int) -> Floats:
        placed = self.value.ppf(points.reshape(len(points) * self.copies, self.value.dimensions))
        return placed.reshape(len(points), *self.field.shape)

    def describe(self) -> dict[str, Any]:
        return self.value.to_dict()


class _SciPyDistribution(Source):
    """A frozen SciPy distribution: it has a method `rvs`, and `ppf` if it is univariate."""

    def __init__(self, field: Field, value: Any) -> None:
        super().__init__(field, value)
        self.scalar = hasattr(value, "ppf")
        if self.scalar:
            parameters = (*getattr(value, "args", ()), *getattr(value, "kwds", {}).values())
            for parameter in parameters:
                checks.require_few_axes(f"{field.name}: a parameter of {self._kind()}", parameter)
            field.check_kind(self._kind(), np.broadcast_shapes(*map(np.shape, parameters)))
        else:
            # `dim` is the length of the last axis of a multivariate draw. Check it before drawing,
            # because draws with a very long axis would exhaust the memory.
            length = field.shape[-1] if field.shape else 1
            if getattr(value, "dim", length) != length:
                field.check_kind(self._kind(), (int(value.dim),))

    def _kind(self) -> str:
        frozen = getattr(self.value, "dist", self.value)
        return getattr(frozen, "name", None) or type(self.value).__name__.removesuffix("_frozen")

    def dimensions(self, sampler: str) -> int:
        if not self.scalar:
            raise ValueError(
                f'{self.field.name} = {self._kind()}: has no ppf, which sampler "{sampler}" needs; '
                'use independent components or sampler "random"'
            )
        return math.prod(self.field.shape)

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        shape = (BLOCK, *self.field.shape)
        size = shape if self.scalar else BLOCK
        return self._checked(lambda: self.value.rvs(size=size, random_state=rng), shape)

    def from_points(self, points: Floats, block: int) -> Floats:
        shape = (len(points), *self.field.shape)
        # Clip to inside (0, 1): at 0 the quantile may be infinite, and that of a discrete
        # distribution is below its smallest value.
        return self._checked(lambda: self.value.ppf(inside(points.reshape(shape))), shape)

    def _checked(self, draw: Callable[[], Any], shape: tuple[int, ...]) -> Floats:
        try:
            drawn = draw()
        except (ArithmeticError, MemoryError) as error:
            raise ValueError(f"{self.field.name}: {self._kind()} cannot draw: {error}") from error
        except Exception as error:
            error.add_note(f"softpinch: while drawing {self.field.name} from {self._kind()}")
            raise
        values = checks.numbers(f"{self.field.name}: draws of {self._kind()}", drawn)
        # SciPy leaves out the axis of a single component.
        fits = values.shape == shape or (
            values.shape[:1] == shape[:1] and values.size == shape[0] == math.prod(shape)
        )
        if not fits:
            raise ValueError(
                f"{self.field.name}: draws of {self._kind()} have shape {values.shape[1:]}, "
                f"{self.field.wanted}"
            )
        return values.reshape(shape)

    def _own(self) -> dict[str, Any]:
        """Describes a distribution class of the user, with the numbers that define it, if known."""
        frozen = getattr(self.value, "dist", self.value)
        kind = f"{type(frozen).__module__}.{type(frozen).__qualname__}"
        numbers = {
            name: _plain(getattr(frozen, name))
            for name in ("xk", "pk", "_histogram")
            if hasattr(frozen, name)
        }
        return {"kind": "function", "function": kind, **numbers}

    def describe(self) -> dict[str, Any]:
        result: dict[str, Any] = {"kind": "scipy", "name": self._kind()}
        if not scipy_names.described(self.value, self._kind()):
            result = self._own()
        if hasattr(self.value, "args"):
            result["args"] = _plain(list(self.value.args))
            result["kwds"] = _plain(dict(self.value.kwds))
        elif hasattr(self.value, "_dist"):
            # A multivariate distribution has attributes with the names of its parameters.
            names = inspect.signature(type(self.value._dist).__call__).parameters
            kept = {name: getattr(self.value, name, None) for name in names if name != "seed"}
            result["kwds"] = _plain({k: v for k, v in kept.items() if v is not None})
        return result


class _FunctionSource(Source):
    """A function of a generator, called once for each run."""

    def dimensions(self, sampler: str) -> int:
        raise ValueError(
            f"{self.field.name}: a function that draws from a generator needs sampler "
            f'"random", not "{sampler}"; or use a distribution'
        )

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        values = np.empty((calls, *self.field.shape))
        for k in range(calls):
            run = f"run {block * BLOCK + k}"
            try:
                value = self.value(rng)
            except Exception as error:
                error.add_note(f"softpinch: while drawing {self.field.name}, {run}")
                raise
            if self.field.several:
                values[k] = self._joined(value, run)
            else:
                values[k] = _fitting(f"{self.field.name}, {run}", value, self.field.shape)
        return values

    def _joined(self, value: Any, run: str) -> Floats:
        """Joins the values that a function returned for each path into one flat vector."""
        field = self.field
        where = f"{field.name}, {run}"
        if isinstance(value, Mapping):
            if set(value) != set(field.paths):
                raise ValueError(
                    f"{where}: the function gave values for {checks.quoted(map(str, value))}; "
                    f"must give one for each of {checks.quoted(field.paths)}"
                )
            value = [value[path] for path in field.paths]
        several = isinstance(value, tuple | list) or (
            isinstance(value, np.ndarray) and value.ndim > 0
        )
        if not several or len(value) != len(field.paths):
            raise ValueError(
                f"{where}: the function gave {checks.shown(value)}; must give a value for each of "
                f"{checks.quoted(field.paths)}"
            )
        parts = [
            _fitting(f"{where}, {path!r}", part, shape).ravel()
            for path, part, shape in zip(field.paths, value, field.shapes, strict=True)
        ]
        return np.concatenate(parts).reshape(field.shape)

    def describe(self) -> dict[str, Any]:
        name = getattr(self.value, "__qualname__", None)
        shown = f"{self.value.__module__}.{name}" if name else repr(self.value)
        return {"kind": "function", "function": shown}


def source_of(field: Field, value: Any, runs: int) -> Source:
    """Makes the source for a value of `vary`.

    Raises:
        ValueError: The value's shape does not fit the field.
        TypeError: The value is of the wrong kind.
    """
    if isinstance(value, Distribution):
        return _OwnDistribution(field, value)
    if hasattr(value, "rvs"):
        return _SciPyDistribution(field, value)
    if callable(value):
        return _FunctionSource(field, value)
    return ArraySource(field, value)


def name_of(paths: tuple[str, ...]) -> str:
    """The name of an entry of `vary` in error messages."""
    return f"vary[{checks.quoted(paths)}]"


def _fitting(name: str, value: Any, shape: tuple[int, ...]) -> Floats:
    """Checks the value that a function returned for a run, and converts it to numbers."""
    values = checks.numbers(name, value)
    if values.shape != shape:
        raise ValueError(f"{name}: the function gave shape {values.shape}, must give shape {shape}")
    return values


def _plain(value: Any) -> Any:
    """Converts arrays, tuples and NumPy numbers to plain data, and other objects to their repr."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, bool | int | float | str) else repr(value)
