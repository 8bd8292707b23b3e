"""Which parameter matters: how much of a result's scatter each input explains.

    >>> rng = np.random.default_rng(1)
    >>> x = {"a": rng.random(4000), "b": rng.random(4000), "c": rng.random(4000)}
    >>> found = effects(x, 3 * x["a"] + x["b"])
    >>> {name: round(effect.share, 1) for name, effect in found.items()}
    {'a': 0.9, 'b': 0.1, 'c': 0.0}

The share is the first-order Sobol index Var(E[y | x]) / Var(y), from the runs that are there: no
extra design is needed. Inputs that were drawn independently have shares whose sum is at most 1;
what is missing is what several inputs do only together, and what no input explains (held noise).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..support import checks
from ..support.arrays import Floats
from ..support.extras import load
from .results import Results
from .run_table import number

# So many shuffled copies of the result set the noise level, always the same ones.
_SHUFFLES = 99
_SEED = 20070410


class Effect(NamedTuple):
    """What one input does to a result.

    Attributes:
        share: Var(E[y | x]) / Var(y), the share of the result's variance that this input explains
            alone. E[y | x] is a straight line in each of 8 bins (1000 runs) to 32 (from 64 000 on),
            and what so many numbers explain by chance is taken off: so a share may come out
            slightly below 0. What bends within a bin is left out.
        noise: What 95 % of the results without any relation to the input stay below: a share below
            it says nothing.
        rank_correlation: Spearman's, from -1 to 1: the sign says which way. Near 0 with a large
            share is a dependence that goes up and down.
        runs: How many it is from: those in which the result is finite.
    """

    share: float
    noise: float
    rank_correlation: float
    runs: int


def sensitivity(
    ensemble: Results, name: str | NDArray[np.bool_] = "completed"
) -> dict[str, Effect]:
    """What each varied number does to a result.

    Args:
        ensemble: Which.
        name: A summary ("peak_rotation", "final_state.theta"), a status ("completed": whether a
            run did), a violation ("pulling"), "holds", or booleans (runs,).

    Returns:
        Path of each single number ("disturbances.0.force.0") -> `Effect`, the largest share first.
        NaN where the result is the same in all runs.

    Raises:
        ValueError: The summary was not computed, the name is unknown, or nothing was varied.
        TypeError: It is no ensemble.
    """
    checks.instance("ensemble", ensemble, Results, "an Ensemble or a Study")
    varied = ensemble._setup.schema.split(ensemble.parameters)
    inputs = {path: column.values for path, column in varied.items()}
    if not inputs:
        raise ValueError("sensitivity: nothing was varied")
    found = effects(inputs, number(ensemble, name).values)
    order = sorted(found, key=lambda path: -np.nan_to_num(found[path].share, nan=-math.inf))
    return {path: found[path] for path in order}


def effects(inputs: Mapping[str, ArrayLike], result: ArrayLike) -> dict[str, Effect]:
    """The effect of each input on a result.

    Args:
        inputs: Name -> (n,), finite.
        result: (n,); rows that are not finite are left out.

    Raises:
        ValueError: Lengths differ, or an input is not finite.
    """
    y = checks.numbers("result", result)
    if y.ndim != 1:
        raise ValueError(f"result has shape {y.shape}: must have shape (n,)")
    kept = np.isfinite(y)
    y = y[kept]
    n = len(y)
    given = {name: checks.array(name, values, ("n",)) for name, values in inputs.items()}
    for name, x in given.items():
        checks.same_length(name, x, "result", len(kept))
    if n < 3 or np.ptp(y) == 0.0:
        return {name: Effect(math.nan, math.nan, math.nan, n) for name in given}
    binned = {name: _BinnedLines.of(x[kept]) for name, x in given.items()}
    ranks = {name: _ranks(x[kept]) for name, x in given.items()}
    # The scale drops out of every share, and squares of it might overflow.
    y = (y - y.mean()) / np.abs(y - y.mean()).max()
    rng = load("numpy.random").default_rng(_SEED)
    # One at a time: all together would be a hundred times the result.
    by_chance = np.empty((_SHUFFLES, len(binned)))
    for row in by_chance:
        shuffled = rng.permutation(y)
        row[:] = [each.share(shuffled) for each in binned.values()]
    noise = dict(zip(binned, np.quantile(by_chance, 0.95, axis=0).tolist(), strict=True))
    own_ranks = _ranks(y)
    return {
        name: Effect(
            share=each.share(y),
            noise=noise[name],
            rank_correlation=_correlation(ranks[name], own_ranks),
            runs=n,
        )
        for name, each in binned.items()
    }


class _BinnedLines(NamedTuple):
    """Bins of an input, in each of which the result's mean is a straight line.

    Attributes:
        group: (n,), which bin each row is in.
        counts: (bins,), of rows.
        along: (n,), the input less its mean in the bin.
        spread: (bins,), sum of squares of `along`; inf where the bin holds one value only.
    """

    group: NDArray[np.intp]
    counts: NDArray[np.intp]
    along: Floats
    spread: Floats

    @classmethod
    def of(cls, x: Floats) -> Self:
        """Equally many rows in each bin, equal values together."""
        n = len(x)
        most = int(np.clip(round(0.8 * n ** (1 / 3)), 1, 32))
        values, which = np.unique(x, return_inverse=True)
        if len(values) > 2 * most:
            place = np.floor((_ranks(x) - 0.5) * (most / n)).astype(np.intp)
            which = np.unique(place, return_inverse=True)[1]
        group = which.astype(np.intp)
        counts = np.bincount(group)
        # Half and half again: the whole width might overflow.
        low, high = 0.5 * values[0], 0.5 * values[-1]
        u = (0.5 * x - low) / (high - low) if high > low else np.zeros(n)
        along = u - (np.bincount(group, weights=u) / counts)[group]
        spread = np.bincount(group, weights=along**2)
        return cls(group, counts, along, np.where(spread > 1e-24, spread, np.inf))

    def share(self, y: Floats) -> float:
        """The share of the variance of `y` that the lines explain, without bias.

        Lines explain something of a result that does not depend on the input: as many parts of the
        scatter as they have numbers. So variances are compared, sums of squares over their degrees
        of freedom (Kelley's epsilon^2, the adjusted R^2 of a regression).
        """
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
    """Ranks from 1 on, equal values sharing the mean of theirs."""
    _, which, counts = np.unique(x, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    return np.asarray((ends - 0.5 * (counts - 1))[which], dtype=np.float64)


def _correlation(a: Floats, b: Floats) -> float:
    """Pearson's; 0 where one of them is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / scale if scale > 0.0 else 0.0
