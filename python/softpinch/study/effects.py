"""Global sensitivity: the share of a result's variance that each input explains.

    >>> rng = np.random.default_rng(1)
    >>> x = {"a": rng.random(4000), "b": rng.random(4000), "c": rng.random(4000)}
    >>> found = effects(x, 3 * x["a"] + x["b"])
    >>> {name: round(effect.share, 1) for name, effect in found.items()}
    {'a': 0.9, 'b': 0.1, 'c': 0.0}

The share is the first-order Sobol index Var(E[y | x]) / Var(y). It is estimated from existing runs,
without a special design. The shares of independent inputs add up to at most 1. The remainder is due
to interactions of inputs, and to scatter that no input explains, such as held noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support import Bools, Floats, ShownTable, checks
from .results import Results
from .tables import number

# Number of shuffled results for the noise level; the seed is fixed, so that it repeats.
_SHUFFLES = 99
_SEED = 20070410
# Fewest runs that say anything of a variance.
_FEWEST = 3


class Effect(NamedTuple):
    """The effect of one input on a result.

    Attributes:
        share: Var(E[y | x]) / Var(y), the share of the result's variance that this input explains
            alone. E[y | x] is modelled by a straight line in each of 8 bins (1000 runs) to 32 bins
            (64 000 runs or more), so curvature within a bin does not count. The share that these
            lines would explain by chance is subtracted, so the estimate may be slightly below 0.
        noise: The noise level: 95 % of the shares are below it if the result does not depend on the
            input. A share below it is not significant.
        rank_correlation: Spearman's rank correlation, from -1 to 1; its sign is the direction of
            the effect. If it is near 0 but the share is large, the dependence is not monotonic.
        runs: The number of runs used, in which the result is finite.
    """

    share: float
    noise: float
    rank_correlation: float
    runs: int

    def __repr__(self) -> str:
        share, noise, correlation = (f"{number:.6g}" for number in self[:3])
        shown = f"share={share}, noise={noise}, rank_correlation={correlation}"
        return f"Effect({shown}, runs={self.runs})"


class Effects(dict[str, Effect]):
    """Name of an input -> `Effect`. It prints as a table, and is one in a notebook."""

    def _table(self) -> ShownTable:
        names = (name.replace("_", " ") for name in Effect._fields)
        columns, rows = ("varied", *names), [(name, *effect) for name, effect in self.items()]
        unknown = next((one.runs for one in self.values() if math.isnan(one.share)), None)
        if unknown is None:
            return ShownTable(columns, rows)
        why = "the same in all" if unknown >= _FEWEST else "finite in only"
        return ShownTable(columns, rows, f"The result is {why} {unknown} runs: no share is known.")

    def __repr__(self) -> str:
        table = self._table()
        return "\n".join(filter(None, (table.caption, table.text())))

    def _repr_html_(self) -> str:
        return self._table().html()


def sensitivity(ensemble: Results, name: str | Bools = "completed") -> dict[str, Effect]:
    """The effect of each varied number on a result.

    Args:
        ensemble: The ensemble or study.
        name: The result: a summary ("peak_rotation", "final_state.theta"), or an event, which
            counts as 1 or 0: a status ("completed"), a violation ("pulling"), "holds", or booleans
            (runs,).

    Returns:
        A dictionary that shows as a table: path of each varied number ("disturbances.0.force.0") ->
        `Effect`, the largest share first. The shares are NaN if the result is equal in all runs, or
        finite in fewer than three; the table says so.

    Raises:
        ValueError: The summary was not computed, the name is unknown, or nothing was varied.
    """
    checks.instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    varied = ensemble._spec.schema.split(ensemble.parameters)
    inputs = {path: column.values for path, column in varied.items()}
    if not inputs:
        raise ValueError("sensitivity: nothing was varied")
    found = effects(inputs, number(ensemble, name).values)
    order = sorted(found, key=lambda path: -np.nan_to_num(found[path].share, nan=-math.inf))
    return Effects((path, found[path]) for path in order)


def effects(inputs: Mapping[str, ArrayLike], result: ArrayLike) -> dict[str, Effect]:
    """The effect of each input, name -> values (n,), on a result (n,), where that is finite."""
    y = checks.numbers("result", result)
    if y.ndim != 1:
        raise ValueError(f"result has shape {y.shape}: must have shape (n,)")
    kept = np.isfinite(y)
    y = y[kept]
    n = len(y)
    given = {name: checks.array(name, values, ("n",)) for name, values in inputs.items()}
    for name, x in given.items():
        checks.same_length(name, x, "result", len(kept))
    if n < _FEWEST or np.ptp(y) == 0.0:
        return {name: Effect(math.nan, math.nan, math.nan, n) for name in given}
    binned = {name: _BinnedLines.of(x[kept]) for name, x in given.items()}
    ranks = {name: _ranks(x[kept]) for name, x in given.items()}
    # Shares do not depend on the scale of y. Normalise it, because its squares might overflow.
    y = (y - y.mean()) / np.abs(y - y.mean()).max()
    rng = np.random.default_rng(_SEED)
    # Shuffle one copy at a time, because all copies would take a hundred times the result's memory.
    by_chance = np.empty((_SHUFFLES, len(binned)))
    for row in by_chance:
        shuffled = rng.permutation(y)
        row[:] = [each.share(shuffled) for each in binned.values()]
    noise = dict(zip(binned, np.quantile(by_chance, 0.95, axis=0).tolist(), strict=True))
    own_ranks = _ranks(y)
    return {
        name: Effect(each.share(y), noise[name], _correlation(ranks[name], own_ranks), n)
        for name, each in binned.items()
    }


class _BinnedLines(NamedTuple):
    """A model of a result over an input: a straight line in each of several bins of the input."""

    group: NDArray[np.intp]  # the bin of each row (n,)
    counts: NDArray[np.intp]  # the number of rows in each bin (bins,)
    along: Floats  # the input, scaled to 0 to 1, minus its mean in the bin (n,)
    spread: Floats  # the sum of squares of `along` in each bin (bins,); inf of a single value

    @classmethod
    def of(cls, x: Floats) -> Self:
        """Makes bins with about equal numbers of rows; equal values share a bin."""
        n = len(x)
        most = int(np.clip(round(0.8 * n ** (1 / 3)), 1, 32))
        values, which = np.unique(x, return_inverse=True)
        if len(values) > 2 * most:
            place = np.floor((_ranks(x) - 0.5) * (most / n)).astype(np.intp)
            which = np.unique(place, return_inverse=True)[1]
        group = which.astype(np.intp)
        counts = np.bincount(group)
        # Halve both ends, because their difference might overflow.
        low, high = 0.5 * values[0], 0.5 * values[-1]
        u = (0.5 * x - low) / (high - low) if high > low else np.zeros(n)
        along = u - (np.bincount(group, weights=u) / counts)[group]
        spread = np.bincount(group, weights=along**2)
        return cls(group, counts, along, np.where(spread > 1e-24, spread, np.inf))

    def share(self, y: Floats) -> float:
        """The share of y's variance that the lines explain beyond chance: the adjusted R^2."""
        n = len(y)
        numbers = len(self.counts) + int(np.count_nonzero(np.isfinite(self.spread)))
        if numbers < 2 or n <= numbers:
            return 0.0
        total = float(((y - y.mean()) ** 2).sum())
        means = np.bincount(self.group, weights=y) / self.counts
        slopes = np.bincount(self.group, weights=self.along * y) / self.spread
        left = y - means[self.group] - slopes[self.group] * self.along
        return 1.0 - (float(left @ left) / (n - numbers)) / (total / (n - 1))


def _ranks(x: Floats) -> Floats:
    """Ranks from 1; equal values all get their mean rank."""
    _, which, counts = np.unique(x, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    return np.asarray((ends - 0.5 * (counts - 1))[which], dtype=np.float64)


def _correlation(a: Floats, b: Floats) -> float:
    """Pearson's correlation; 0 if `a` or `b` is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / scale if scale > 0.0 else 0.0
