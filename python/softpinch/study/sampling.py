"""The plan of a study's draws: how each run gets its varied values.

    >>> plan = Plan({"grasped.mass": Normal(0.1, 0.01)}, 2000, shapes={"grasped.mass": ()})
    >>> plan.draw(1)["grasped.mass"].shape
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
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..support import checks
from ..support.arrays import Floats
from ..support.errors import SuspiciousValueWarning, warn
from ..support.extras import load, require
from .distributions import Distribution
from .quantiles import MOST
from .sources import BLOCK, ArraySource, Field, Key, name_of, source_of

SAMPLERS = ("random", "sobol", "latin_hypercube")
# SciPy's default. With more than 32 bits `fast_forward` fails (SciPy 1.17).
_SOBOL_BITS = 30
# The largest number of runs in a study: intervals of run numbers are signed 64-bit integers.
MOST_RUNS = 2**62


class Plan:
    """The draws of the varied values of all runs.

    Only one thread may draw at a time, because SciPy's distributions and its Sobol engine are
    stateful.

    If a field has several numbers and its distribution has one, the components are independent. A
    tuple of paths takes one flat vector for each run, which has the numbers of all fields in the
    order of the paths. It comes from an array, a vector-valued distribution, or a function that
    returns a value for each path.

    Attributes:
        runs: The number of runs.
        seed: The seed of all draws.
        sampler: One of `SAMPLERS`.
        blocks: The number of blocks of 1024 runs; the last block may be partly filled.
        dimensions: Dimensions of the Sobol points or the Latin hypercube; 0 for "random".
        extendable: Whether runs beyond `runs` can be drawn; not with arrays or a Latin hypercube.
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
        """Checks the arguments as far as possible without drawing.

        Args:
            vary: A path, or a tuple of paths -> an array with one entry for each run, a
                `Distribution`, a frozen SciPy distribution, or a function of a
                `numpy.random.Generator`, which is called once for each run, in order. It may be
                empty.
            runs: The number of runs; None takes the length of the arrays.
            seed: Any integer >= 0.
            sampler: "random", "sobol" or "latin_hypercube"; the last two need SciPy, and do not
                support functions.
            shapes: Path -> shape of its field; () is a number.

        Raises:
            TypeError: An argument is of the wrong kind.
            ValueError: A length or a shape does not fit, a path occurs twice, or the sampler does
                not support an entry of `vary`.
        """
        self.runs = count_runs(vary, runs)
        self.seed = checks.integer("seed", seed, 0)
        self.sampler = checks.choice("sampler", sampler, SAMPLERS)
        self.blocks = -(-self.runs // BLOCK)
        keys = _keys(vary)
        self._sources = {
            key: source_of(Field(key, paths, shapes), vary[key], self.runs)
            for key, paths in keys.items()
        }
        self.dimensions = 0
        self._columns: dict[Key, slice] = {}
        if self.sampler != "random":
            for key in sorted(keys, key=keys.__getitem__):
                wanted = self._sources[key].dimensions(self.sampler)
                self._columns[key] = slice(self.dimensions, self.dimensions + wanted)
                self.dimensions += wanted
        if self.sampler == "sobol" and self.blocks * BLOCK > 2**_SOBOL_BITS:
            raise ValueError(
                f"runs = {self.runs}: must be at most 2**{_SOBOL_BITS} with Sobol points"
            )
        fixed = any(isinstance(source, ArraySource) for source in self._sources.values())
        self.extendable = not fixed and self.sampler != "latin_hypercube"
        # Caches: the Sobol engine in its state after the last drawn block, and the whole hypercube.
        self._engine: Any = None
        self._hypercube: Floats | None = None

    @property
    def paths(self) -> tuple[str, ...]:
        """All varied paths, in the given order."""
        return tuple(path for source in self._sources.values() for path in source.field.paths)

    def draw(self, block: int) -> dict[str, Floats]:
        """Draws the 1024 runs of a block, which start at run 1024 * `block`.

        The result always has 1024 rows, also if the last block has fewer runs. Rows beyond the end
        of an array or a Latin hypercube are NaN.

        Args:
            block: The index of the block; if the plan is extendable, it may exceed the last block.

        Returns:
            Path -> (1024, *shape of the field).

        Raises:
            TypeError: A function or a SciPy distribution returned something that is not numeric.
            ValueError: It returned the wrong shape; the message names path and run.
            ImportError: A source or the sampler needs SciPy, which is not installed.
        """
        most = None if self.extendable else self.blocks - 1
        return self._draw(checks.integer("block", block, 0, most), BLOCK)

    def _draw(self, block: int, calls: int) -> dict[str, Floats]:
        """Draws a block, and calls functions only for its first `calls` runs; NaN for the rest."""
        points = self._points(block) if self.dimensions else np.empty((BLOCK, 0))
        result = {}
        for key, source in self._sources.items():
            if self.sampler == "random":
                values = source.draw(self._generator(source.field.paths, block), block, calls)
            else:
                values = source.from_points(points[:, self._columns[key]], block)
            result.update(source.field.split(_padded(values)))
        return result

    def rows(self, numbers: NDArray[np.uint64]) -> dict[str, Floats]:
        """Draws some runs: path -> (k, *shape of the field).

        Args:
            numbers: The numbers of the runs (k,), increasing, below `runs`.
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
        """Draws all runs: path -> (runs, *shape of the field)."""
        return self.rows(np.arange(self.runs, dtype=np.uint64))

    def describe(self) -> dict[str, Any]:
        """Describes the draws as plain data.

        In the table "vary", paths that are drawn together have one key, in which ", " joins them.
        """
        return {
            "sampler": self.sampler,
            "seed": self.seed,
            "runs": self.runs,
            "block": BLOCK,
            "vary": {", ".join(s.field.paths): s.describe() for s in self._sources.values()},
        }

    def _generator(self, paths: tuple[str, ...], block: int) -> np.random.Generator:
        """Makes the generator of a block: Philox, with a key from seed, block and path names."""
        # The names enter as the four little-endian words of their hash.
        digest = hashlib.blake2b("\0".join(paths).encode(), digest_size=16).digest()
        words = np.frombuffer(digest, dtype="<u4").tolist()
        random = load("numpy.random")
        sequence = random.SeedSequence(self.seed, spawn_key=(block, *words))
        found: np.random.Generator = random.Generator(random.Philox(sequence))
        return found

    def _points(self, block: int) -> Floats:
        """Returns the sampler's points of a block (m, dimensions).

        m is 1024, but smaller in the last block of a Latin hypercube.
        """
        qmc = require("scipy.stats.qmc", extra="study", purpose=f'sampler "{self.sampler}" (SciPy)')
        start = block * BLOCK
        points: Floats
        if self.sampler == "latin_hypercube":
            if self._hypercube is None:
                rng = np.random.default_rng(self.seed)
                try:
                    points = qmc.LatinHypercube(self.dimensions, rng=rng).random(self.runs)
                except (MemoryError, ValueError) as error:
                    raise ValueError(
                        f"runs = {self.runs}: too many for a Latin hypercube, which is held in "
                        f"memory as a whole: {error}"
                    ) from None
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


def count_runs(vary: Mapping[Key, Any], runs: int | None = None) -> int:
    """Returns the number of runs: `runs`, or the common length of the arrays if it is None.

    Raises:
        TypeError: `runs` is not an integer, or `vary` is not a mapping from paths to arrays,
            distributions and functions.
        ValueError: `runs` is below 1; the length of an array differs from it or from another array;
            `runs` is None and there is no array; or a path occurs twice.

    Warns:
        SuspiciousValueWarning: `runs` is None, and a tuple of two increasing numbers, which may be
            meant as bounds, makes two runs. A list or an array says the same without a warning.
    """
    wanted, said = None, "runs"
    if runs is not None:
        wanted = checks.integer("runs", runs, 1, MOST_RUNS)
    for key, paths in _keys(vary).items():
        if not _is_array(vary[key]):
            continue
        name = name_of(paths)
        if not hasattr(vary[key], "__len__") or isinstance(vary[key], str | Mapping):
            raise TypeError(
                f"{name} = {checks.shown(vary[key])}: must be an array with one entry for each "
                "run, a distribution or a function"
            )
        values = checks.numbers(name, vary[key])
        if wanted is None:
            wanted, said = len(values), name
            if wanted == 0:
                raise ValueError(f"{name} has no entries: must have one for each run, at least 1")
            hint = _range_hint(vary[key]) if isinstance(vary[key], tuple) else ""
            if hint:
                text = f"{name} = {checks.shown(vary[key])} makes two runs{hint}; a list means runs"
                warn(text, SuspiciousValueWarning)
        elif len(values) != wanted:
            raise ValueError(
                f"{name} has {len(values)} entries: must have one for each run, "
                f"and {said} {'is' if said == 'runs' else 'has'} {wanted}{_range_hint(vary[key])}"
            )
    if wanted is None:
        raise ValueError("runs is missing: must be given where vary has no array")
    return wanted


def _range_hint(value: Any) -> str:
    """Returns the distribution that a pair (low, high) may mean; `fit` takes pairs as bounds."""
    if np.shape(value) != (2,):
        return ""
    low, high = value
    if not -np.inf < low < high < np.inf:
        return ""
    return f"; a pair is no distribution: sp.Uniform({low}, {high}) draws between two numbers"


def _is_array(value: Any) -> bool:
    return not (isinstance(value, Distribution) or hasattr(value, "rvs") or callable(value))


def _keys(vary: Mapping[Key, Any]) -> dict[Key, tuple[str, ...]]:
    """Returns the paths of each key; refuses keys that are not paths, and repeated paths."""
    if not isinstance(vary, Mapping):
        raise TypeError(f"vary = {checks.shown(vary)}: must be a mapping from paths")
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


def _padded(values: Floats) -> Floats:
    """Pads the rows of a block with NaN to 1024 rows."""
    if len(values) == BLOCK:
        return values
    return np.concatenate([values, np.full((BLOCK - len(values), *values.shape[1:]), np.nan)])
