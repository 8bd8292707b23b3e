"""Distributions of numbers that vary from run to run, for `vary` of `monte_carlo`.

    >>> Uniform((-80.0, -80.0), (80.0, 80.0)).sample(np.random.default_rng(1), 3).shape
    (3, 2)

Parameters are numbers or arrays, which broadcast; the components of an array are independent. Every
class draws from a generator (`sample`), and maps uniform numbers to quantiles (`ppf`) for Sobol
points and Latin hypercubes. A new class needs `shape`, `_quantiles` and a line in `DISTRIBUTIONS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..support import Floats, Kinded, checks, require

# Limits of uniform numbers, so that quantiles are finite.
LEAST = 2.0**-54
MOST = 1.0 - 2.0**-53
# log_ndtr is accurate enough for quantiles of a truncated tail up to this many std.
_FARTHEST = 1000.0
# The most draws of one call of `sample`; these take 8 TB.
_MOST_DRAWS = 2**40
# The most numbers that the parameters of a distribution may broadcast to: 32 MB.
_MOST_NUMBERS = 2**22


@dataclass(frozen=True, eq=False, repr=False)
class Distribution(Kinded):
    """Base of the distributions. The parameters broadcast to a draw, of independent components."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of one draw; () is a number."""
        return np.broadcast_shapes(*map(np.shape, self._values().values()))

    @property
    def dimensions(self) -> int:
        """The number of uniform numbers that one draw needs."""
        return math.prod(self.shape)

    def ppf(self, u: ArrayLike) -> Floats:
        """Maps uniform numbers (n, dimensions), within [0, 1), to quantiles (n, *shape).

        u is limited to 1 - 2^-53 from above, and to 2^-54 from below if the distribution has no
        lower end, so that draws are finite.
        """
        given = checks.array("u", u, (len(np.atleast_1d(checks.read("u", u))), self.dimensions))
        wrong = np.argwhere((given < 0.0) | (given > 1.0))
        if wrong.size:
            where = tuple(map(int, wrong[0]))
            raise ValueError(f"u{list(where)} = {given[where]}: must be within [0, 1)")
        return self._quantiles(np.minimum(given, MOST))

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Random draws (n, *shape); the first rows do not depend on `n`."""
        checks.instance("rng", rng, np.random.Generator)
        return self._drawn(rng, checks.integer("n", n, 0, _MOST_DRAWS))

    def _drawn(self, rng: np.random.Generator, n: int) -> Floats:
        return self._quantiles(rng.random((n, self.dimensions)))

    def _quantiles(self, u: Floats) -> Floats:
        """Quantiles (n, *shape) of uniform numbers u (n, dimensions), which are checked."""
        return self._component_quantiles(u.reshape(len(u), *self.shape))

    def _component_quantiles(self, u: Floats) -> Floats:
        """Quantiles of uniform numbers u (n, *shape), for each component."""
        raise NotImplementedError

    def _checked(self, **rules: Callable[[str, object], float]) -> list[Floats]:
        """Checks the fields (finite without a rule), stores them, and returns them as arrays."""
        owner = type(self).__name__
        for name, value in self._values().items():
            check = rules.get(name, checks.finite)
            self._set(name, checks.number_or_array(f"{owner}.{name}", value, check))
        arrays = {name: np.asarray(value) for name, value in self._values().items()}
        shown = ", ".join(f"{name} {each.shape}" for name, each in arrays.items())
        try:
            numbers = math.prod(self.shape)
        except ValueError:
            raise ValueError(f"{owner}: shapes must broadcast, but are {shown}") from None
        if numbers > _MOST_NUMBERS:
            rule = f"must broadcast to at most {_MOST_NUMBERS} numbers"
            raise ValueError(f"{owner}: shapes {rule}, but are {shown}")
        return list(arrays.values())

    def _refuse(self, name: str, wrong: Any, rule: str) -> None:
        """Raises an error with the field, its value and the rule if any of `wrong` is true."""
        if np.any(wrong):
            shown = checks.shown(getattr(self, name))
            raise ValueError(f"{type(self).__name__}.{name} = {shown}: must {rule}")


@dataclass(frozen=True, eq=False, repr=False)
class Normal(Distribution):
    """The normal distribution. `ppf` needs SciPy, `sample` does not.

    Attributes:
        mean: Mean, of any shape.
        std: Standard deviation, >= 0; with 0 all draws equal the mean.
    """

    mean: ArrayLike
    std: ArrayLike

    def __post_init__(self) -> None:
        _, std = self._checked()
        self._refuse("std", std < 0.0, "be >= 0")

    def _drawn(self, rng: np.random.Generator, n: int) -> Floats:
        return rng.normal(np.asarray(self.mean), np.asarray(self.std), (n, *self.shape))

    def _component_quantiles(self, u: Floats) -> Floats:
        z = _normal_quantiles(u, "Normal")
        return np.asarray(np.asarray(self.mean) + np.asarray(self.std) * z)


@dataclass(frozen=True, eq=False, repr=False)
class Uniform(Distribution):
    """The uniform distribution from `low` to `high`.

    Attributes:
        low: Lower bound, of any shape; `high` is the upper bound, above it.
    """

    low: ArrayLike
    high: ArrayLike

    def __post_init__(self) -> None:
        low, high = self._checked()
        self._refuse("high", high <= low, f"be > low, {checks.shown(self.low)}")
        with np.errstate(over="ignore"):
            self._refuse("high", ~np.isfinite(high - low), "be at a finite distance from low")

    def _component_quantiles(self, u: Floats) -> Floats:
        low, high = np.asarray(self.low), np.asarray(self.high)
        return np.asarray(np.clip(low + (high - low) * u, low, high))


@dataclass(frozen=True, eq=False, repr=False)
class LogUniform(Distribution):
    """The logarithm is uniform, for numbers of which only the order of magnitude is known.

    Attributes:
        low: Lower bound, > 0, of any shape; `high` is the upper bound, above it.
    """

    low: ArrayLike
    high: ArrayLike

    def __post_init__(self) -> None:
        low, high = self._checked()
        self._refuse("low", low <= 0.0, "be > 0")
        self._refuse("high", high <= low, f"be > low, {checks.shown(self.low)}")

    def _component_quantiles(self, u: Floats) -> Floats:
        low, high = np.asarray(self.low), np.asarray(self.high)
        bottom, top = np.log(low), np.log(high)
        with np.errstate(over="ignore"):
            return np.asarray(np.clip(np.exp(bottom + (top - bottom) * u), low, high))


@dataclass(frozen=True, eq=False, repr=False)
class LogNormal(Distribution):
    """The logarithm is normal: median * exp(sigma * z). `ppf` needs SciPy, `sample` does not.

    Attributes:
        median: Median, > 0, of any shape.
        sigma: Standard deviation of ln(x), >= 0; if small, about the coefficient of variation.
    """

    median: ArrayLike
    sigma: ArrayLike

    def __post_init__(self) -> None:
        median, sigma = self._checked()
        self._refuse("median", median <= 0.0, "be > 0")
        self._refuse("sigma", sigma < 0.0, "be >= 0")

    def _drawn(self, rng: np.random.Generator, n: int) -> Floats:
        return self._from_normal(rng.standard_normal((n, *self.shape)))

    def _component_quantiles(self, u: Floats) -> Floats:
        return self._from_normal(_normal_quantiles(u, "LogNormal"))

    def _from_normal(self, z: Floats) -> Floats:
        # Add the logarithm, because exp(sigma z) may overflow although the product does not.
        return np.asarray(np.exp(np.log(self.median) + np.asarray(self.sigma) * z))


@dataclass(frozen=True, eq=False, repr=False)
class TruncatedNormal(Distribution):
    """The normal distribution truncated to an interval. Needs SciPy.

    Draws are quantiles of uniform numbers, also in `sample`, computed from logarithms of the tails.
    The cumulative probability of a draw is accurate to 1e-8 if the interval is 50 std from the
    mean, and to 1e-6 if it is 1000 std from the mean.

    Attributes:
        mean: Mean of the normal distribution before truncation, of any shape.
        std: Standard deviation before truncation, > 0.
        low: Lower bound; -inf for none.
        high: Upper bound, above `low`; inf for none. Some part of the interval must be within 1000
            std of the mean.
    """

    mean: ArrayLike
    std: ArrayLike
    low: ArrayLike
    high: ArrayLike

    def __post_init__(self) -> None:
        mean, std, low, high = self._checked(low=checks.not_nan, high=checks.not_nan)
        self._refuse("std", std <= 0.0, "be > 0")
        self._refuse("high", high <= low, f"be > low, {checks.shown(self.low)}")
        with np.errstate(over="ignore"):
            end = np.abs(mean) + 9.0 * std
            bottom, top = (low - mean) / std, (high - mean) / std
        self._refuse("std", ~np.isfinite(end), "keep mean + 9 std finite")
        self._refuse("low", bottom > _FARTHEST, "be at most 1000 std above mean")
        self._refuse("high", top < -_FARTHEST, "be at most 1000 std below mean")

    def _component_quantiles(self, u: Floats) -> Floats:
        # `scipy.stats.truncnorm.ppf` uses this formula too, but takes three times as long, and a
        # second to import. About half of its draws differ from these by rounding.
        special = _special("TruncatedNormal")
        mean, std, low, high = np.broadcast_arrays(*self._values().values())
        with np.errstate(over="ignore"):
            bottom, top = (low - mean) / std, (high - mean) / std
        # Mirror an interval above the mean, because only the lower tail has enough digits.
        mirrored = bottom > 0.0
        near, far = np.where(mirrored, -bottom, top), np.where(mirrored, -top, bottom)
        inner = inside(u)
        from_near, from_far = np.log1p(-inner), np.log(inner)
        weight_near = np.where(mirrored, from_near, from_far)
        weight_far = np.where(mirrored, from_far, from_near)
        parts = special.log_ndtr(near) + weight_near, special.log_ndtr(far) + weight_far
        log_p = np.logaddexp(*parts)
        # Rounding may raise the sum of both terms above 1.
        z = special.ndtri_exp(np.minimum(log_p, -LEAST))
        return np.asarray(np.clip(mean + std * np.where(mirrored, -z, z), low, high))


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Distribution):
    """A random choice from given values, such as measured parts or samples of an earlier study.

    Attributes:
        values: The values (k, ...), k numbers or arrays.
        weights: The weight of each value (k,), >= 0, with any sum above 0; None for equal weights.
    """

    values: ArrayLike
    weights: ArrayLike | None = None

    def __post_init__(self) -> None:
        given = checks.read("Choice.values", self.values)
        if given.ndim == 0 or given.size == 0:
            raise ValueError(f"Choice.values has shape {given.shape}: must have shape (k, ...)")
        values = checks.array("Choice.values", self.values, given.shape)
        self._set("values", values)
        if self.weights is None:
            return
        weights = checks.array("Choice.weights", self.weights, ("k",))
        self._set("weights", weights)
        checks.same_length("Choice.weights", weights, "Choice.values", len(values))
        for k in np.flatnonzero(weights < 0.0)[:1]:
            raise ValueError(f"Choice.weights[{k}] = {weights[k]}: must be >= 0")
        total = weights.sum()
        if not (np.isfinite(total) and total > 0.0):
            raise ValueError(f"Choice.weights: their sum is {total}, must be finite and > 0")

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of one value."""
        return np.shape(self.values)[1:]

    @property
    def dimensions(self) -> int:
        """One uniform number selects the value."""
        return 1

    def _quantiles(self, u: Floats) -> Floats:
        values = np.asarray(self.values)
        if self.weights is None:
            # u is below 1, but u k may round to k.
            index = np.minimum((u[:, 0] * len(values)).astype(np.intp), len(values) - 1)
        else:
            ends = np.cumsum(self.weights)
            index = np.searchsorted(ends / ends[-1], u[:, 0], side="right")
        return np.asarray(values[index])


def inside(u: Floats) -> Floats:
    """Clips uniform numbers to [2^-54, 1 - 2^-53], so that their quantiles are finite."""
    return np.asarray(np.clip(u, LEAST, MOST))


def _normal_quantiles(u: Floats, owner: str) -> Floats:
    """Standard normal quantiles, always finite."""
    return np.asarray(_special(owner).ndtri(inside(u)))


def _special(owner: str) -> ModuleType:
    return require("scipy.special", extra="study", purpose=f"quantiles of {owner} (SciPy)")


# `kind` in a study file -> class.
DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "normal": Normal,
    "uniform": Uniform,
    "log_uniform": LogUniform,
    "log_normal": LogNormal,
    "truncated_normal": TruncatedNormal,
    "choice": Choice,
}
Distribution._kinds = DISTRIBUTIONS
