"""The draws of a study: how each run gets its varied values.

    >>> draws = Draws({"grasped.mass": Normal(0.1, 0.01)}, 2000, shapes={"grasped.mass": ()})
    >>> draws.draw(1)["grasped.mass"].shape
    (1024,)

Runs are drawn in blocks of 1024. With the sampler "random", the numbers of a run depend only on the
seed, the path and the run's number, because each block of each path has its own generator. So any
block can be drawn alone, and more runs, another path or another order of the paths do not change
existing numbers. Distributions always draw a whole block; functions are called only for requested
runs. The bits depend on the versions of NumPy and SciPy.

With "sobol", run i takes the i-th scrambled Sobol point. Any block can be drawn alone, and more
runs can follow, but another path changes all numbers. With "latin_hypercube", one sample has
exactly the requested number of runs. Both samplers assign dimensions to the paths in the sorted
order of their names.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..support import Floats, SuspiciousValueWarning, checks, require, warn
from .distributions import MOST
from .sources import BLOCK, ArraySource, Description, Key, Shapes, Source, source_of

SAMPLERS = ("random", "sobol", "latin_hypercube")
# SciPy's default. With more than 32 bits `fast_forward` fails (SciPy 1.17).
_SOBOL_BITS = 30
# The largest number of runs in a study: intervals of run numbers are signed 64-bit integers.
MOST_RUNS = 2**62


class Draws:
    """The draws of the varied values of all runs.

    Only one thread may draw at a time, because SciPy's distributions and its Sobol engine are
    stateful.

    If a field has several numbers and its distribution has one, the components are independent. A
    tuple of paths takes one flat vector for each run, with the numbers of all fields in the order
    of the paths. `dimensions` are those of the Sobol points or the Latin hypercube.
    """

    def __init__(
        self,
        vary: Mapping[Key, Any],
        runs: int | None = None,
        seed: int = 0,
        sampler: str = "random",
        *,
        shapes: Callable[[list[str]], Shapes],
    ) -> None:
        """Checks the arguments of `monte_carlo`; `shapes` gives path -> shape for some paths."""
        keys = _paths_of(vary)
        self.seed = checks.integer("seed", seed, 0)
        self.sampler = checks.choice("sampler", sampler, SAMPLERS)
        self.shapes = shapes([path for paths in keys.values() for path in paths])
        self.sources: dict[Key, Source] = {k: source_of(k, vary[k], self.shapes) for k in keys}
        self.runs = _count_runs(self.sources.values(), runs, vary)
        self.dimensions = 0
        self._columns: dict[Key, slice] = {}
        if self.sampler != "random":
            for key in sorted(keys, key=keys.__getitem__):
                wanted = self.sources[key].dimensions(self.sampler)
                self._columns[key] = slice(self.dimensions, self.dimensions + wanted)
                self.dimensions += wanted
        if self.sampler == "sobol" and self.runs > 2**_SOBOL_BITS:
            rule = f"must be at most 2**{_SOBOL_BITS} with Sobol points"
            raise ValueError(f"runs = {self.runs}: {rule}")
        # Caches: the Sobol engine in its state after the last drawn block, and the whole hypercube.
        self._engine: Any = None
        self._hypercube: Floats | None = None

    def draw(self, block: int, calls: int = BLOCK) -> dict[str, Floats]:
        """Draws the 1024 runs from run 1024 * `block` on: path -> (1024, *shape of the field).

        Functions are called for the first `calls` of them only. Other rows, and those beyond the
        end of an array or a Latin hypercube, are NaN.
        """
        points = self._points(block) if self.dimensions else np.empty((BLOCK, 0))
        result = {}
        for key, source in self.sources.items():
            if self.sampler == "random":
                values = source.draw(self._generator(source.paths, block), block, calls)
            else:
                values = source.from_points(points[:, self._columns[key]], block)
            if len(values) < BLOCK:
                rest = np.full((BLOCK - len(values), *values.shape[1:]), np.nan)
                values = np.concatenate([values, rest])
            result.update(source.split(values))
        return result

    def rows(self, numbers: NDArray[np.uint64]) -> dict[str, Floats]:
        """Draws the runs `numbers` (k,), increasing: path -> (k, *shape of the field)."""
        result = {path: np.empty((len(numbers), *shape)) for path, shape in self.shapes.items()}
        blocks, begins = np.unique(numbers // BLOCK, return_index=True)
        ends = [*begins[1:].tolist(), len(numbers)]
        for block, begin, end in zip(blocks.tolist(), begins.tolist(), ends, strict=True):
            start = block * BLOCK
            drawn = self.draw(block, min(BLOCK, self.runs - start))
            rows = numbers[begin:end].astype(np.int64) - start
            for path, values in drawn.items():
                result[path][begin:end] = values[rows]
        return result

    def describe(self) -> dict[str, Any]:
        """Describes the draws as plain data; ", " joins paths that are drawn together."""
        return {
            "sampler": self.sampler,
            "seed": self.seed,
            "runs": self.runs,
            "block": BLOCK,
            "vary": {", ".join(s.paths): s.describe() for s in self.sources.values()},
        }

    def described(self) -> Self:
        """The same with descriptions in place of sources: small, and able to draw nothing."""
        vary: dict[Key, Any] = {s.paths: Description(s.describe()) for s in self.sources.values()}
        return type(self)(vary, self.runs, self.seed, self.sampler, shapes=lambda _: self.shapes)

    def _generator(self, paths: tuple[str, ...], block: int) -> np.random.Generator:
        """Makes the generator of a block: Philox, with a key from seed, block and path names."""
        # The names enter as the four little-endian words of their hash.
        digest = hashlib.blake2b("\0".join(paths).encode(), digest_size=16).digest()
        words = np.frombuffer(digest, dtype="<u4").tolist()
        sequence = np.random.SeedSequence(self.seed, spawn_key=(block, *words))
        return np.random.Generator(np.random.Philox(sequence))

    def _points(self, block: int) -> Floats:
        """The sampler's points of a block (1024, dimensions); fewer at the end of a hypercube."""
        qmc = require("scipy.stats.qmc", extra="study", purpose=f'sampler "{self.sampler}" (SciPy)')
        start = block * BLOCK
        points: Floats
        if self.sampler == "latin_hypercube":
            if self._hypercube is None:
                rng = np.random.default_rng(self.seed)
                try:
                    points = qmc.LatinHypercube(self.dimensions, rng=rng).random(self.runs)
                except (MemoryError, ValueError) as error:
                    why = "too many for a Latin hypercube, which is held in memory as a whole"
                    raise ValueError(f"runs = {self.runs}: {why}: {error}") from None
                # SciPy subtracts a uniform number from the upper end of each stratum, so a point of
                # the last stratum can be 1, which is not below 1 as `ppf` needs.
                self._hypercube = np.minimum(points, MOST)
            return self._hypercube[start : start + BLOCK]
        if self._engine is None or self._engine.num_generated > start:
            rng = np.random.default_rng(self.seed)
            self._engine = qmc.Sobol(self.dimensions, bits=_SOBOL_BITS, rng=rng)
        if start > self._engine.num_generated:
            self._engine.fast_forward(start - self._engine.num_generated)
        # SciPy's points are the lower corners of cells. The first corner is 0, whose normal
        # quantile would be an outlier, so the points are moved to the centres of the cells.
        points = self._engine.random(BLOCK) + 0.5 ** (_SOBOL_BITS + 1)
        return points


def _paths_of(vary: Mapping[Key, Any]) -> dict[Key, tuple[str, ...]]:
    """Returns the paths of each key; refuses keys that are not paths, and repeated paths."""
    kind = "a mapping from paths to arrays, distributions or functions"
    checks.instance("vary", vary, Mapping, kind)
    result: dict[Key, tuple[str, ...]] = {}
    seen: set[str] = set()
    for key in vary:
        paths = (key,) if isinstance(key, str) else key
        if not (isinstance(paths, tuple) and paths and all(isinstance(p, str) for p in paths)):
            raise TypeError(f"vary: the key {checks.shown(key)} must be a path or a tuple of paths")
        for path in paths:
            if path in seen:
                raise ValueError(f"vary: the path {path!r} is given twice")
            seen.add(path)
        result[key] = paths
    return result


def _count_runs(sources: Iterable[Source], runs: int | None, vary: Mapping[Key, Any]) -> int:
    """The number of runs, given or that of the arrays; warns of a tuple that may be bounds."""
    wanted = None if runs is None else checks.integer("runs", runs, 1, MOST_RUNS)
    said = "runs is"
    for source, given in zip(sources, vary.values(), strict=True):
        if not isinstance(source, ArraySource):
            continue
        length, hint = len(source.value), _range_hint(source.value)
        if wanted is None:
            wanted, said = length, f"{source.name} has"
            if wanted == 0:
                raise ValueError(f"{source.name} has no entries: must have one for each run")
            if hint and isinstance(given, tuple):
                text = f"{source.name} = {checks.shown(given)} makes two runs"
                warn(f"{text}{hint}; a list means runs", SuspiciousValueWarning)
        elif length != wanted:
            rule = f"must have one for each run, and {said} {wanted}{hint}"
            raise ValueError(f"{source.name} has {length} entries: {rule}")
    if wanted is None:
        raise ValueError("runs is missing: must be given where vary has no array")
    return wanted


def _range_hint(values: Floats) -> str:
    """Returns the distribution that a pair (low, high) may mean; `fit` takes pairs as bounds."""
    if values.shape != (2,) or not -np.inf < values[0] < values[1] < np.inf:
        return ""
    low, high = values.tolist()
    return f"; a pair is no distribution: sp.Uniform({low}, {high}) draws between two numbers"
