"""The sources of varied values: arrays, distributions and functions, with a common interface.

A file may name a distribution of SciPy: {kind = "scipy", name = "gamma", args = [2.0]}. Files come
from other people, so an entry must not be able to run other code: the name must be that of a
distribution, and the arguments must be numbers for its parameters. Both are checked before any
function of SciPy is called.
"""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np

from ..support import Floats, checks, extras
from .distributions import Distribution, inside

# The dotted path of a scene's field, or a tuple of paths that are drawn together.
Key: TypeAlias = str | tuple[str, ...]

BLOCK = 1024

# The multivariate distributions that a file may name. Each of them keeps its parameters when it is
# frozen and draws real arrays, so a manifest can hold it.
MULTIVARIATE = (
    *("dirichlet", "invwishart", "matrix_normal", "multinomial", "multivariate_hypergeom"),
    *("multivariate_normal", "multivariate_t", "ortho_group", "special_ortho_group"),
    *("uniform_direction", "vonmises_fisher", "wishart"),
)
# The most numbers to which the parameters of a file's distribution may broadcast, and the most
# entries of a covariance.
_MOST_NUMBERS = 2**20
# Drawing takes memory in proportion to these first parameters, so a file may not make them huge.
_COUNTS = ("irwinhall", "nhypergeom")
_MOST_COUNT = 10_000

Shapes: TypeAlias = Mapping[str, tuple[int, ...]]


class Source:
    """The source of the values of one key of `vary`: random draws, or quantiles of points."""

    def __init__(self, key: Key, value: Any, shapes: Shapes) -> None:
        """Takes the key, the user's array, distribution or function, and path -> shape."""
        self.value = value
        self.paths = (key,) if isinstance(key, str) else key
        # In error messages.
        self.name = f"vary[{checks.quoted(self.paths)}]"
        self.shapes = tuple(shapes[path] for path in self.paths)
        # Whether a function returns one value for each path instead of a single value.
        self.several = not isinstance(key, str)
        self.sizes = [math.prod(shape) for shape in self.shapes]
        # The shape of one draw for all paths.
        alone = len(self.paths) == 1
        self.shape = self.shapes[0] if alone else (sum(self.sizes),)
        # Ends error messages about shapes.
        self.joined = "" if alone else ", the numbers of all the paths in a row"

    def split(self, values: Floats) -> dict[str, Floats]:
        """Splits draws (m, *shape) into path -> (m, *shape of its field)."""
        if len(self.paths) == 1:
            return {self.paths[0]: values}
        parts = np.split(values, np.cumsum(self.sizes)[:-1], axis=1)
        return {
            path: np.ascontiguousarray(part).reshape(len(part), *shape)
            for path, shape, part in zip(self.paths, self.shapes, parts, strict=True)
        }

    def wrong_draws(self, kind: str, shape: tuple[int, ...]) -> ValueError:
        """The error for draws of a distribution `kind` that do not have the right shape."""
        rule = f"must have shape {self.shape}{self.joined}"
        return ValueError(f"{self.name}: draws of {kind} have shape {shape}, {rule}")

    def check_kind(self, kind: str, shape: tuple[int, ...]) -> None:
        """Refuses a distribution `kind` unless its draws have the right shape or are numbers."""
        if shape != self.shape and (shape != () or len(self.paths) > 1):
            raise self.wrong_draws(kind, shape)

    def dimensions(self, sampler: str) -> int:
        """The number of dimensions of a draw's points; refuses a sampler that does not fit."""
        return 0

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        """Draws a block (1024, *shape); an array has fewer rows at its end, a function `calls`."""
        raise NotImplementedError

    def from_points(self, points: Floats, block: int) -> Floats:
        """Maps the sampler's points of a block (m, dimensions) to values (m, *shape)."""
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """Describes the source as plain data with a `kind`, for manifests and provenance."""
        return dict(self.value)


class Description(dict[str, Any]):
    """The result of `Source.describe`; in `vary` it stands for a source that draws nothing."""


class ArraySource(Source):
    """An array with one entry for each run."""

    def __init__(self, key: Key, value: Any, shapes: Shapes) -> None:
        super().__init__(key, value, shapes)
        if not hasattr(value, "__len__") or isinstance(value, str | Mapping):
            rule = "must be an array with one entry for each run, a distribution or a function"
            raise TypeError(f"{self.name} = {checks.shown(value)}: {rule}")
        # Copy the array, because the caller might change it before all blocks are drawn.
        self.value = checks.numbers(self.name, value).copy()
        shape = self.value.shape
        if shape[1:] != self.shape:
            rows = f"{shape[:1] + self.shape}, one entry for each run{self.joined}"
            raise ValueError(f"{self.name} has shape {shape}: must have shape {rows}")

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        """The block's rows."""
        return np.asarray(self.value[block * BLOCK : (block + 1) * BLOCK])

    def from_points(self, points: Floats, block: int) -> Floats:
        """The block's rows."""
        return np.asarray(self.value[block * BLOCK : (block + 1) * BLOCK])

    def describe(self) -> dict[str, Any]:
        """The shape; a store adds a file."""
        return {"kind": "array", "shape": list(self.value.shape)}


class _OwnDistribution(Source):
    value: Distribution

    def __init__(self, key: Key, value: Distribution, shapes: Shapes) -> None:
        super().__init__(key, value, shapes)
        self.check_kind(type(value).__name__, value.shape)
        # The number of draws of the distribution that make one draw of the field.
        self.copies = 1 if value.shape == self.shape else math.prod(self.shape)

    def dimensions(self, sampler: str) -> int:
        return self.copies * self.value.dimensions

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        drawn = self.value.sample(rng, BLOCK * self.copies)
        return drawn.reshape(BLOCK, *self.shape)

    def from_points(self, points: Floats, block: int) -> Floats:
        placed = self.value.ppf(points.reshape(len(points) * self.copies, self.value.dimensions))
        return placed.reshape(len(points), *self.shape)

    def describe(self) -> dict[str, Any]:
        return self.value.to_dict()


class _SciPyDistribution(Source):
    """A frozen SciPy distribution: it has a method `rvs`, and `ppf` if it is univariate."""

    def __init__(self, key: Key, value: Any, shapes: Shapes) -> None:
        super().__init__(key, value, shapes)
        frozen = getattr(value, "dist", value)
        own_name = type(value).__name__.removesuffix("_frozen")
        self.kind = getattr(frozen, "name", None) or own_name
        self.scalar = hasattr(value, "ppf")
        if self.scalar:
            parameters = (*getattr(value, "args", ()), *getattr(value, "kwds", {}).values())
            self.check_kind(self.kind, np.broadcast_shapes(*map(np.shape, parameters)))
        else:
            # `dim` is the length of the last axis of a multivariate draw. Check it before drawing,
            # because draws with a very long axis would exhaust the memory.
            length = self.shape[-1] if self.shape else 1
            if getattr(value, "dim", length) != length:
                self.check_kind(self.kind, (int(value.dim),))

    def dimensions(self, sampler: str) -> int:
        if not self.scalar:
            why = f'has no ppf, which sampler "{sampler}" needs'
            advice = 'use independent components or sampler "random"'
            raise ValueError(f"{self.name} = {self.kind}: {why}; {advice}")
        return math.prod(self.shape)

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        shape = (BLOCK, *self.shape)
        size = shape if self.scalar else BLOCK
        return self._checked(lambda: self.value.rvs(size=size, random_state=rng), shape)

    def from_points(self, points: Floats, block: int) -> Floats:
        shape = (len(points), *self.shape)
        # Clip to inside (0, 1): at 0 the quantile may be infinite, and that of a discrete
        # distribution is below its smallest value.
        return self._checked(lambda: self.value.ppf(inside(points.reshape(shape))), shape)

    def _checked(self, draw: Callable[[], Any], shape: tuple[int, ...]) -> Floats:
        try:
            drawn = draw()
        except Exception as error:
            error.add_note(f"softpinch: while drawing {self.name} from {self.kind}")
            raise
        values = checks.numbers(f"{self.name}: draws of {self.kind}", drawn)
        # SciPy leaves out the axis of a single component.
        alone = values.shape[:1] == shape[:1] and values.size == shape[0] == math.prod(shape)
        if values.shape != shape and not alone:
            raise self.wrong_draws(self.kind, values.shape[1:])
        return values.reshape(shape)

    def describe(self) -> dict[str, Any]:
        result: dict[str, Any] = {"kind": "scipy", "name": self.kind}
        # A multivariate distribution keeps its class in `_dist`.
        kept = getattr(self.value, "_dist", None)
        frozen = getattr(self.value, "dist", kept or self.value)
        # Without an imported SciPy the distribution cannot be SciPy's.
        if type(_named(sys.modules.get("scipy.stats"), self.kind)) is not type(frozen):
            # A class of the user, or numbers in a histogram or a table.
            frozen = getattr(self.value, "dist", self.value)
            kind = f"{type(frozen).__module__}.{type(frozen).__qualname__}"
            numbers = ("xk", "pk", "_histogram")
            own = {name: _plain(getattr(frozen, name)) for name in numbers if hasattr(frozen, name)}
            result = {"kind": "function", "function": kind, **own}
        if hasattr(self.value, "args"):
            result["args"] = _plain(list(self.value.args))
            result["kwds"] = _plain(dict(self.value.kwds))
        elif kept is not None:
            # A multivariate distribution has attributes with the names of its parameters.
            names = inspect.signature(type(kept).__call__).parameters
            given = {name: getattr(self.value, name, None) for name in names if name != "seed"}
            result["kwds"] = _plain({k: v for k, v in given.items() if v is not None})
        return result


class _FunctionSource(Source):
    """A function of a generator, called once for each run."""

    def dimensions(self, sampler: str) -> int:
        rule = f'needs sampler "random", not "{sampler}"; or use a distribution'
        raise ValueError(f"{self.name}: a function that draws from a generator {rule}")

    def draw(self, rng: np.random.Generator, block: int, calls: int) -> Floats:
        values = np.empty((calls, *self.shape))
        for k in range(calls):
            run = f"run {block * BLOCK + k}"
            try:
                value = self.value(rng)
            except Exception as error:
                error.add_note(f"softpinch: while drawing {self.name}, {run}")
                raise
            given = self._by_path(value, run) if self.several else {f"{self.name}, {run}": value}
            parts = []
            for (name, part), shape in zip(given.items(), self.shapes, strict=True):
                numbers = checks.numbers(name, part)
                if numbers.shape != shape:
                    rule = f"must give shape {shape}"
                    raise ValueError(f"{name}: the function gave shape {numbers.shape}, {rule}")
                parts.append(numbers.ravel())
            values[k] = np.concatenate(parts).reshape(self.shape)
        return values

    def _by_path(self, value: Any, run: str) -> dict[str, Any]:
        """The values that a function returned for several paths, by their places in messages."""
        where = f"{self.name}, {run}"
        if isinstance(value, Mapping):
            if set(value) != set(self.paths):
                given = f"gave values for {checks.quoted(map(str, value))}"
                rule = f"must give one for each of {checks.quoted(self.paths)}"
                raise ValueError(f"{where}: the function {given}; {rule}")
            value = [value[path] for path in self.paths]
        array = isinstance(value, np.ndarray) and value.ndim > 0
        if not (array or isinstance(value, tuple | list)) or len(value) != len(self.paths):
            rule = f"must give a value for each of {checks.quoted(self.paths)}"
            raise ValueError(f"{where}: the function gave {checks.shown(value)}; {rule}")
        return {f"{where}, {path!r}": part for path, part in zip(self.paths, value, strict=True)}

    def describe(self) -> dict[str, Any]:
        name = getattr(self.value, "__qualname__", None)
        shown = f"{self.value.__module__}.{name}" if name else repr(self.value)
        return {"kind": "function", "function": shown}


def source_of(key: Key, value: Any, shapes: Shapes) -> Source:
    """Makes the source for a value of `vary`."""
    if isinstance(value, Description):
        return Source(key, value, shapes)
    if isinstance(value, Distribution):
        return _OwnDistribution(key, value, shapes)
    if hasattr(value, "rvs"):
        return _SciPyDistribution(key, value, shapes)
    if callable(value):
        return _FunctionSource(key, value, shapes)
    return ArraySource(key, value, shapes)


def _plain(value: Any) -> Any:
    """Converts arrays, tuples and NumPy numbers to plain data, and other objects to their repr."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, bool | int | float | str) else repr(value)


def _named(stats: ModuleType | None, name: object) -> Any:
    """The distribution of this name in `scipy.stats`; None if files may not use the name."""
    if stats is None or not isinstance(name, str) or name.startswith("_"):
        return None
    # Use the module's dictionary, because getattr might run the module's `__getattr__`.
    found = vars(stats).get(name)
    univariate = isinstance(found, stats.rv_continuous | stats.rv_discrete)
    return found if univariate or name in MULTIVARIATE else None


def frozen_distribution(where: str, data: Mapping[str, Any]) -> Any:
    """Makes the frozen distribution of SciPy that the table `where` of a file describes."""
    checks.refuse_unknown(where, data, ("kind", "name", "args", "kwds"), "")
    stats = extras.require("scipy.stats", extra="study", purpose=f"{where} (SciPy)")
    name = data.get("name")
    distribution = _named(stats, name)
    if distribution is None:
        allowed = [each for each in vars(stats) if _named(stats, each) is not None]
        hint = checks.hint(name, allowed) if isinstance(name, str) else ""
        rule = 'must be a distribution of scipy.stats, such as "gamma" or "multivariate_normal"'
        raise ValueError(f"{where}: name = {checks.shown(name)}: {rule}{hint}")
    args, kwds = data.get("args", []), data.get("kwds", {})
    checks.instance(f"{where}: args", args, list, "an array of numbers")
    checks.instance(f"{where}: kwds", kwds, Mapping, "a table of numbers")
    _check_parameters(f"{where}: {name}", str(name), args, kwds)
    try:
        made = distribution(*args, **kwds)
        # If parameters are outside of its domain, a univariate distribution's support is NaN.
        valid = name in MULTIVARIATE or not np.isnan(made.support()).any()
    except Exception as error:
        raise ValueError(f"{where}: SciPy cannot make {name}: {error}") from None
    if not valid:
        given = ", ".join([*map(checks.shown, args), *(f"{k} = {v}" for k, v in kwds.items())])
        raise ValueError(f"{where}: {name}({given}): is outside of the distribution's domain")
    return made


def _check_parameters(where: str, name: str, args: list[Any], kwds: Mapping[str, Any]) -> None:
    """Refuses parameters other than numbers, and those that would need much memory."""
    # SciPy itself checks their names, shapes and domains.
    given = {f"args[{k}]": value for k, value in enumerate(args)} | {**kwds}
    if isinstance(given.get("allow_singular"), bool):
        del given["allow_singular"]
    shapes = []
    for each, value in given.items():
        array = checks.numbers(f"{where}.{each}", value)
        if array.size == 0 or np.isnan(array).any():
            shown = checks.shown(value)
            raise ValueError(f"{where}.{each} = {shown}: must be numbers, and none of them NaN")
        if name in _COUNTS and array.max() > _MOST_COUNT:
            raise ValueError(f"{where}.{each} = {array.max()}: must be at most {_MOST_COUNT}")
        shapes.append(array.shape)
    if name in MULTIVARIATE:
        # A mean alone makes a covariance with its length as side.
        numbers = max((length for shape in shapes for length in shape), default=0) ** 2
    else:
        try:
            numbers = math.prod(np.broadcast_shapes(*shapes))
        except ValueError:
            raise ValueError(f"{where}: the shapes of its parameters must broadcast") from None
    if numbers > _MOST_NUMBERS:
        raise ValueError(f"{where} has {numbers} numbers: must be at most {_MOST_NUMBERS}")
