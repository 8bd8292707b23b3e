"""How the runs of an ensemble get their numbers.

    >>> plan = Plan({"grasped.mass": Normal(0.1, 0.01)}, 2000, shapes={"grasped.mass": ()})
    >>> plan.draw(1)["grasped.mass"].shape
    (1024,)

Runs are drawn in blocks of 1024. With sampler "random" the numbers of a run depend on the seed, the
path and the run alone: each block of each path has a generator of its own, and a whole block is
drawn, of functions the runs up to the last. So more runs, another path or another order of paths
change no number that was there before, and any block can be drawn alone. Bits are those of NumPy's
and SciPy's versions.

"sobol" takes scrambled Sobol points, run i the i-th: any block can be drawn alone and more runs can
follow, but another path changes every number. "latin_hypercube" takes one sample of exactly so many
runs. Both give each path some dimensions, in the sorted order of the paths' names.
"""

from __future__ import annotations

import hashlib
import inspect
import math
import reprlib
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import _record
from ._extras import require
from ._record import Floats
from .distributions import MOST, Distribution, inside

# A dotted path of a scene's field, or several whose draws belong together.
Key: TypeAlias = str | tuple[str, ...]

BLOCK = 1024
SAMPLERS = ("random", "sobol", "latin_hypercube")
# SciPy's default. Its engine cannot go forward with more than 32 (SciPy 1.17).
_SOBOL_BITS = 30


class Plan:
    """What is drawn for each run of an ensemble.

    One thread draws at a time: SciPy's distributions and Sobol engine have a state while they draw.

    A field of several numbers takes from a distribution of one number independent components.
    Several paths together, a tuple, take one flat vector a run: the fields' numbers in the order of
    the paths, from an array, a vector-valued distribution, or a function that returns a value for
    each path.

    Attributes:
        runs: How many.
        seed: Of all draws.
        sampler: One of `SAMPLERS`.
        blocks: How many blocks of 1024 the runs fill, the last one perhaps in part.
        dimensions: Of the Sobol points or the Latin hypercube; 0 where draws are random.
        extendable: Whether there are draws beyond `runs`: not with arrays or a Latin hypercube.
    """

    def __init__(
        self,
        vary: Mapping[Key, Any],
        runs: int | None = None,
        seed: int = 0,
        sampler: str = "random",
        *,
        shapes: Mapping[str, tuple[int, ...]],
    ) -> None:
        """Checks everything that can be known before a draw.

        Args:
            vary: From a path, or a tuple of paths, to an array with one entry a run, a
                `Distribution`, a frozen SciPy distribution, or a function of a
                `numpy.random.Generator` that is called once a run, in their order. It may be
                empty.
            runs: None takes the length of the arrays.
            seed: Any integer >= 0.
            sampler: "random", "sobol" or "latin_hypercube"; the last two need SciPy, and no
                functions.
            shapes: Of the field at each path; () is a number.

        Raises:
            TypeError: Something is of another kind.
            ValueError: A length or a shape does not fit, a path stands twice, or the sampler
                cannot draw what is asked.
        """
        self.runs = count_runs(vary, runs)
        self.seed = _record.integer("seed", seed, 0)
        self.sampler = _record.choice("sampler", sampler, SAMPLERS)
        self.blocks = -(-self.runs // BLOCK)
        keys = _keys(vary)
        self._sources = {
            key: _source(_Field(key, paths, shapes), vary[key], self.runs)
            for key, paths in keys.items()
        }
        self.dimensions = 0
        self._columns: dict[Key, slice] = {}
        if self.sampler != "random":
            for key in sorted(keys, key=keys.__getitem__):
                wanted = self._sources[key].count(self.sampler)
                self._columns[key] = slice(self.dimensions, self.dimensions + wanted)
                self.dimensions += wanted
        if self.sampler == "sobol" and self.blocks * BLOCK > 2**_SOBOL_BITS:
            raise ValueError(
                f"runs = {self.runs}: must be at most 2**{_SOBOL_BITS} with Sobol points"
            )
        fixed = any(isinstance(source, _Rows) for source in self._sources.values())
        self.extendable = not fixed and self.sampler != "latin_hypercube"
        # The Sobol engine, where the block before has left it; the whole Latin hypercube.
        self._engine: Any = None
        self._hypercube: Floats | None = None

    @property
    def paths(self) -> tuple[str, ...]:
        """All of them, in the order given."""
        return tuple(path for source in self._sources.values() for path in source.field.paths)

    def draw(self, block: int) -> dict[str, Floats]:
        """The numbers of the runs from 1024 * block on.

        Always a whole block: runs after the last have numbers too, which the caller cuts off; NaN
        where there are none, after the end of an array or a Latin hypercube.

        Args:
            block: From 0; beyond the last where the plan is extendable.

        Returns:
            For each path (1024, *shape of the field).

        Raises:
            TypeError: A function or a SciPy distribution gave something else than numbers.
            ValueError: It gave another shape; the message names path and run.
            ImportError: Something needs SciPy, and it is not installed.
        """
        most = None if self.extendable else self.blocks - 1
        return self._draw(_record.integer("block", block, 0, most), BLOCK)

    def _draw(self, block: int, called: int) -> dict[str, Floats]:
        """The same, but functions give the first so many runs only; NaN for the others."""
        points = self._points(block) if self.dimensions else np.empty((BLOCK, 0))
        result = {}
        for key, source in self._sources.items():
            if self.sampler == "random":
                values = source.draw(self._generator(source.field.paths, block), block, called)
            else:
                values = source.place(points[:, self._columns[key]], block)
            result.update(source.field.split(_padded(values)))
        return result

    def rows(self, numbers: NDArray[np.uint64]) -> dict[str, Floats]:
        """The numbers of some runs: for each path (k, *shape of the field).

        Args:
            numbers: Of the runs (k,), increasing, below `runs`.
        """
        result = {
            path: np.empty((len(numbers), *shape))
            for source in self._sources.values()
            for path, shape in zip(source.field.paths, source.field.shapes, strict=True)
        }
        blocks, begins = np.unique(numbers // BLOCK, return_index=True)
        ends = [*begins[1:].tolist(), len(numbers)]
        for block, begin, end in zip(blocks.tolist(), begins.tolist(), ends, strict=True):
            start = block * BLOCK
            drawn = self._draw(block, min(BLOCK, self.runs - start))
            rows = numbers[begin:end].astype(np.int64) - start
            for path, values in drawn.items():
                result[path][begin:end] = values[rows]
        return result

    def draw_all(self) -> dict[str, Floats]:
        """The numbers of all runs: for each path (runs, *shape of the field)."""
        return self.rows(np.arange(self.runs, dtype=np.uint64))

    def describe(self) -> dict[str, Any]:
        """Where the numbers come from, as a dictionary of numbers, text, lists and dictionaries.

        In `vary` paths that are drawn together stand as one name, joined by ", ".
        """
        return {
            "sampler": self.sampler,
            "seed": self.seed,
            "runs": self.runs,
            "block": BLOCK,
            "vary": {", ".join(s.field.paths): s.describe() for s in self._sources.values()},
        }

    def _generator(self, paths: tuple[str, ...], block: int) -> np.random.Generator:
        """Philox by seed, block, and the four words of a hash of the paths, low bytes first."""
        digest = hashlib.blake2b("\0".join(paths).encode(), digest_size=16).digest()
        words = np.frombuffer(digest, dtype="<u4").tolist()
        sequence = np.random.SeedSequence(self.seed, spawn_key=(block, *words))
        return np.random.Generator(np.random.Philox(sequence))

    def _points(self, block: int) -> Floats:
        """Uniform numbers (m, dimensions) of a block, m = 1024 or what a hypercube has left."""
        qmc = require("scipy.stats.qmc", extra="study", purpose=f'sampler "{self.sampler}" (SciPy)')
        start = block * BLOCK
        points: Floats
        if self.sampler == "latin_hypercube":
            if self._hypercube is None:
                rng = np.random.default_rng(self.seed)
                points = qmc.LatinHypercube(self.dimensions, rng=rng).random(self.runs)
                # The top of the last stratum is 1 where SciPy's uniform number is 0.
                self._hypercube = np.minimum(points, MOST)
            return self._hypercube[start : start + BLOCK]
        if self._engine is None or self._engine.num_generated > start:
            rng = np.random.default_rng(self.seed)
            self._engine = qmc.Sobol(self.dimensions, bits=_SOBOL_BITS, rng=rng)
        if start > self._engine.num_generated:
            self._engine.fast_forward(start - self._engine.num_generated)
        # SciPy's points are the lower corners of cells, 0 among them: the middles have no such
        # outlier under the quantile of a normal.
        points = self._engine.random(BLOCK) + 0.5 ** (_SOBOL_BITS + 1)
        return points


def count_runs(vary: Mapping[Key, Any], runs: int | None = None) -> int:
    """The number of runs: `runs`, or the common length of the arrays where it is None.

    Raises:
        TypeError: `runs` is no integer, or `vary` no mapping from paths to arrays, distributions
            and functions.
        ValueError: `runs` is below 1; arrays disagree with it or with each other; neither is given;
            or a path stands twice.
    """
    wanted, said = None, "runs"
    if runs is not None:
        wanted = _record.integer("runs", runs, 1)
    for key, paths in _keys(vary).items():
        if not _is_array(vary[key]):
            continue
        name = _name(paths)
        if not hasattr(vary[key], "__len__") or isinstance(vary[key], str | Mapping):
            raise TypeError(
                f"{name} = {reprlib.repr(vary[key])}: must be an array with one entry for each "
                "run, a distribution or a function"
            )
        values = _array(name, vary[key])
        if wanted is None:
            wanted, said = len(values), name
            if wanted == 0:
                raise ValueError(f"{name} has no entries: must have one for each run, at least 1")
        elif len(values) != wanted:
            raise ValueError(
                f"{name} has {len(values)} entries: must have one for each run, "
                f"and {said} {'is' if said == 'runs' else 'has'} {wanted}"
            )
    if wanted is None:
        raise ValueError("runs is missing: must be given where vary has no array")
    return wanted


class _Field:
    """One path, or several that are drawn together: the shape of what is drawn for them."""

    def __init__(
        self, key: Key, paths: tuple[str, ...], shapes: Mapping[str, tuple[int, ...]]
    ) -> None:
        for path in paths:
            if path not in shapes:
                raise ValueError(f"{_name(paths)}: the shape of {path!r} is not known")
        self.name = _name(paths)
        self.paths = paths
        self.shapes = tuple(shapes[path] for path in paths)
        # Whether a function returns a value for each path, and not one value.
        self.several = not isinstance(key, str)
        self.sizes = [math.prod(shape) for shape in self.shapes]
        self.shape = self.shapes[0] if len(paths) == 1 else (sum(self.sizes),)

    def split(self, values: Floats) -> dict[str, Floats]:
        """From (m, *shape) to what each path has of it."""
        if len(self.paths) == 1:
            return {self.paths[0]: values}
        parts = np.split(values, np.cumsum(self.sizes)[:-1], axis=1)
        return {
            path: np.ascontiguousarray(part).reshape(len(part), *shape)
            for path, shape, part in zip(self.paths, self.shapes, parts, strict=True)
        }

    @property
    def wanted(self) -> str:
        """The shape, for messages."""
        if len(self.paths) == 1:
            return f"must have shape {self.shape}"
        return f"must have shape {self.shape}, the numbers of all the paths in a row"

    def check_kind(self, kind: str, shape: tuple[int, ...]) -> None:
        """Refuses a distribution whose draws have neither the field's shape nor are numbers."""
        if shape == self.shape or (shape == () and len(self.paths) == 1):
            return
        raise ValueError(f"{self.name}: draws of {kind} have shape {shape}, {self.wanted}")


class _Source:
    """What a field's numbers come from: random draws, or placed by points of the sampler."""

    def __init__(self, field: _Field, value: Any) -> None:
        self.field = field
        self.value = value

    def count(self, sampler: str) -> int:
        """How many dimensions of the sampler's points it takes, or an error."""
        raise NotImplementedError

    def draw(self, rng: np.random.Generator, block: int, called: int) -> Floats:
        """(1024, *shape), or fewer rows: where there are no more, or `called` of a function."""
        raise NotImplementedError

    def place(self, points: Floats, block: int) -> Floats:
        """The same from points (m, count) of the sampler."""
        raise NotImplementedError

    def describe(self) -> dict[str, Any]:
        """A dictionary for the records, with a `kind`."""
        raise NotImplementedError


class _Rows(_Source):
    """An array with one entry a run."""

    def __init__(self, field: _Field, value: Any) -> None:
        # A copy: later changes of the caller's must not reach blocks yet to be drawn.
        super().__init__(field, _array(field.name, value).copy())
        shape = self.value.shape
        if shape[1:] != field.shape:
            rows = f"{shape[:1] + field.shape}, one entry for each run"
            along = "" if len(field.paths) == 1 else ", the numbers of all the paths in a row"
            raise ValueError(f"{field.name} has shape {shape}: must have shape {rows}{along}")

    def count(self, sampler: str) -> int:
        return 0

    def draw(self, rng: np.random.Generator, block: int, called: int) -> Floats:
        rows: Floats = self.value[block * BLOCK : (block + 1) * BLOCK]
        return rows

    def place(self, points: Floats, block: int) -> Floats:
        rows: Floats = self.value[block * BLOCK : (block + 1) * BLOCK]
        return rows

    def describe(self) -> dict[str, Any]:
        return {"kind": "array", "shape": list(self.value.shape)}


class _Ours(_Source):
    """A distribution of softpinch's."""

    value: Distribution

    def __init__(self, field: _Field, value: Distribution) -> None:
        super().__init__(field, value)
        field.check_kind(type(value).__name__, value.shape)
        # How many draws of it make one of the field's.
        self.copies = 1 if value.shape == field.shape else math.prod(field.shape)

    def count(self, sampler: str) -> int:
        return self.copies * self.value.dimensions

    def draw(self, rng: np.random.Generator, block: int, called: int) -> Floats:
        drawn = self.value.sample(rng, BLOCK * self.copies)
        return drawn.reshape(BLOCK, *self.field.shape)

    def place(self, points: Floats, block: int) -> Floats:
        placed = self.value.ppf(points.reshape(len(points) * self.copies, self.value.dimensions))
        return placed.reshape(len(points), *self.field.shape)

    def describe(self) -> dict[str, Any]:
        return self.value.to_dict()


class _SciPy(_Source):
    """A frozen distribution of SciPy's: what has an `rvs`, and a `ppf` too if it is of numbers."""

    def __init__(self, field: _Field, value: Any) -> None:
        super().__init__(field, value)
        self.scalar = hasattr(value, "ppf")
        if self.scalar:
            parameters = (*getattr(value, "args", ()), *getattr(value, "kwds", {}).values())
            field.check_kind(self._kind(), np.broadcast_shapes(*map(np.shape, parameters)))

    def _kind(self) -> str:
        frozen = getattr(self.value, "dist", self.value)
        return getattr(frozen, "name", None) or type(self.value).__name__.removesuffix("_frozen")

    def count(self, sampler: str) -> int:
        if not self.scalar:
            raise ValueError(
                f'{self.field.name} = {self._kind()}: has no ppf, which sampler "{sampler}" needs; '
                'use independent components or sampler "random"'
            )
        return math.prod(self.field.shape)

    def draw(self, rng: np.random.Generator, block: int, called: int) -> Floats:
        shape = (BLOCK, *self.field.shape)
        size = shape if self.scalar else BLOCK
        return self._checked(lambda: self.value.rvs(size=size, random_state=rng), shape)

    def place(self, points: Floats, block: int) -> Floats:
        shape = (len(points), *self.field.shape)
        # Inside (0, 1): at 0 the quantile may be infinite, and of a discrete one below its least.
        return self._checked(lambda: self.value.ppf(inside(points.reshape(shape))), shape)

    def _checked(self, draw: Callable[[], Any], shape: tuple[int, ...]) -> Floats:
        try:
            drawn = draw()
        except Exception as error:
            error.add_note(f"softpinch: while drawing {self.field.name} from {self._kind()}")
            raise
        values = _array(f"{self.field.name}: what {self._kind()} drew", drawn)
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

    def describe(self) -> dict[str, Any]:
        result: dict[str, Any] = {"kind": "scipy", "name": self._kind()}
        if hasattr(self.value, "args"):
            result["args"] = _plain(list(self.value.args))
            result["kwds"] = _plain(dict(self.value.kwds))
        elif hasattr(self.value, "_dist"):
            # A multivariate one keeps its parameters under the names of its constructor's.
            names = inspect.signature(type(self.value._dist).__call__).parameters
            kept = {name: getattr(self.value, name, None) for name in names if name != "seed"}
            result["kwds"] = _plain({k: v for k, v in kept.items() if v is not None})
        return result


class _Function(_Source):
    """A function of a generator, called once a run."""

    def count(self, sampler: str) -> int:
        raise ValueError(
            f"{self.field.name}: a function of a generator cannot be placed by sampler "
            f'"{sampler}", which has no generator; use a distribution or sampler "random"'
        )

    def draw(self, rng: np.random.Generator, block: int, called: int) -> Floats:
        values = np.empty((called, *self.field.shape))
        for k in range(called):
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
        """A value for each path as one flat vector."""
        field = self.field
        where = f"{field.name}, {run}"
        if isinstance(value, Mapping):
            if set(value) != set(field.paths):
                raise ValueError(
                    f"{where}: the function gave values for {_record.quoted(map(str, value))}; "
                    f"must give one for each of {_record.quoted(field.paths)}"
                )
            value = [value[path] for path in field.paths]
        several = isinstance(value, tuple | list) or (
            isinstance(value, np.ndarray) and value.ndim > 0
        )
        if not several or len(value) != len(field.paths):
            raise ValueError(
                f"{where}: the function gave {reprlib.repr(value)}; must give a value for each of "
                f"{_record.quoted(field.paths)}"
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


def _source(field: _Field, value: Any, runs: int) -> _Source:
    if isinstance(value, Distribution):
        return _Ours(field, value)
    if hasattr(value, "rvs"):
        return _SciPy(field, value)
    if callable(value):
        return _Function(field, value)
    return _Rows(field, value)


def _is_array(value: Any) -> bool:
    return not (isinstance(value, Distribution) or hasattr(value, "rvs") or callable(value))


def _keys(vary: Mapping[Key, Any]) -> dict[Key, tuple[str, ...]]:
    """The paths of each key; refuses what is no path and paths that stand twice."""
    if not isinstance(vary, Mapping):
        raise TypeError(f"vary = {reprlib.repr(vary)}: must be a mapping from paths")
    result: dict[Key, tuple[str, ...]] = {}
    seen: set[str] = set()
    for key in vary:
        paths = (key,) if isinstance(key, str) else key
        if not (isinstance(paths, tuple) and paths and all(isinstance(p, str) for p in paths)):
            raise TypeError(f"vary: the key {key!r} must be a path or a tuple of paths")
        for path in paths:
            if path in seen:
                raise ValueError(f"vary: the path {path!r} stands twice")
            seen.add(path)
        result[key] = paths
    return result


def _name(paths: tuple[str, ...]) -> str:
    """What errors call an entry of vary."""
    return f"vary[{_record.quoted(paths)}]"


def _array(name: str, value: Any) -> Floats:
    """Numbers as float64, infinite and NaN ones too."""
    try:
        given: NDArray[Any] = np.asarray(value)
        kind = given.dtype.kind
        # Among objects NumPy would make NaN of None, and numbers of text.
        if (kind not in "iufO" and given.size) or (
            kind == "O" and any(x is None or isinstance(x, str | bytes | bool) for x in given.flat)
        ):
            raise TypeError
        with np.errstate(over="ignore"):
            return given.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} = {reprlib.repr(value)}: must hold numbers") from None


def _fitting(name: str, value: Any, shape: tuple[int, ...]) -> Floats:
    """What a function gave for a run, as numbers of the field's shape."""
    values = _array(name, value)
    if values.shape != shape:
        raise ValueError(f"{name}: the function gave shape {values.shape}, must give shape {shape}")
    return values


def _padded(values: Floats) -> Floats:
    """A whole block, NaN where there are no more rows."""
    if len(values) == BLOCK:
        return values
    return np.concatenate([values, np.full((BLOCK - len(values), *values.shape[1:]), np.nan)])


def _plain(value: Any) -> Any:
    """Arrays, tuples and NumPy's numbers as lists and numbers; whatever else as its repr."""
    if isinstance(value, Mapping):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if isinstance(value, bool | int | float | str) else repr(value)
