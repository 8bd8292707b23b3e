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
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..support import checks
from ..support.arrays import Floats
from ..support.extras import load, require
from .distributions import Distribution
from .quantiles import MOST
from .sources import BLOCK, ArraySource, Field, Key, name_of, source_of

SAMPLERS = ("random", "sobol", "latin_hypercube")
# SciPy's default. Its engine cannot go forward with more than 32 (SciPy 1.17).
_SOBOL_BITS = 30
# Of one study: intervals of them are 64 bits with a sign.
MOST_RUNS = 2**62


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
        return self._draw(checks.integer("block", block, 0, most), BLOCK)

    def _draw(self, block: int, calls: int) -> dict[str, Floats]:
        """The same, but functions give the first so many runs only; NaN for the others."""
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
        random = load("numpy.random")
        sequence = random.SeedSequence(self.seed, spawn_key=(block, *words))
        found: np.random.Generator = random.Generator(random.Philox(sequence))
        return found

    def _points(self, block: int) -> Floats:
        """Uniform numbers (m, dimensions) of a block, m = 1024 or what a hypercube has left."""
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
        elif len(values) != wanted:
            raise ValueError(
                f"{name} has {len(values)} entries: must have one for each run, "
                f"and {said} {'is' if said == 'runs' else 'has'} {wanted}"
            )
    if wanted is None:
        raise ValueError("runs is missing: must be given where vary has no array")
    return wanted


def _is_array(value: Any) -> bool:
    return not (isinstance(value, Distribution) or hasattr(value, "rvs") or callable(value))


def _keys(vary: Mapping[Key, Any]) -> dict[Key, tuple[str, ...]]:
    """The paths of each key; refuses what is no path and paths that stand twice."""
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
    """A whole block, NaN where there are no more rows."""
    if len(values) == BLOCK:
        return values
    return np.concatenate([values, np.full((BLOCK - len(values), *values.shape[1:]), np.nan)])
