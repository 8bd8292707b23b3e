"""How a number scatters from run to run: what `vary` of `monte_carlo` takes for a path.

    >>> Uniform((-80.0, -80.0), (80.0, 80.0)).sample(np.random.default_rng(1), 3).shape
    (3, 2)

Parameters are numbers or arrays, which broadcast; an array's components are independent of each
other. Every kind draws from a generator (`sample`) and maps uniform numbers (`ppf`), which Sobol
points and Latin hypercubes need. A new kind is a class with `shape` and `ppf` and a line in
`DISTRIBUTIONS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ..support import checks
from ..support.arrays import Floats
from ..support.kinds import chosen, kind_of
from ..support.record import Record
from .quantiles import MOST, normal, truncated

# No draw of a normal lies further out: the probability is 1e-19 a draw, and ndtri(LEAST) = -8.3.
_TAIL = 9.0
# Up to here log_ndtr has digits enough for the quantiles of a truncated tail.
_FARTHEST = 1000.0
# Of one call of `sample`: so many numbers are 8 TB.
_MOST_DRAWS = 2**40
# The most numbers that the parameters of a distribution may broadcast to: 32 MB.
_MOST_NUMBERS = 2**22


@dataclass(frozen=True, eq=False, repr=False)
class Distribution(Record):
    """Base of the distributions."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one draw; () is a number."""
        raise NotImplementedError

    @property
    def dimensions(self) -> int:
        """How many uniform numbers one draw takes."""
        return math.prod(self.shape)

    def ppf(self, u: ArrayLike) -> Floats:
        """Draws from uniform numbers: the inverse of the cumulative distribution.

        Args:
            u: (n, dimensions), within [0, 1).

        Returns:
            (n, *shape), finite for u = 0 too: where the distribution has no lower end, u counts
            as no less than 2^-54, and nowhere as more than 1 - 2^-53.

        Raises:
            TypeError: `u` holds something else than numbers.
            ValueError: `u` has another shape, or a number outside [0, 1].
            ImportError: The distribution needs SciPy, and it is not installed.
        """
        given = checks.array("u", u, (len(np.atleast_1d(checks.read("u", u))), self.dimensions))
        wrong = np.argwhere((given < 0.0) | (given > 1.0))
        if wrong.size:
            where = tuple(map(int, wrong[0]))
            raise ValueError(f"u{list(where)} = {given[where]}: must be within [0, 1)")
        return self._quantiles(np.minimum(given, MOST))

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Random draws (n, *shape); row k is the same for any larger n.

        Raises:
            TypeError: `rng` is no generator, or `n` no integer.
            ValueError: `n` is below 0, or beyond what a computer can hold.
            ImportError: The distribution needs SciPy, and it is not installed.
        """
        n = _checked_count(rng, n)
        return self._quantiles(rng.random((n, self.dimensions)))

    def _quantiles(self, u: Floats) -> Floats:
        """(n, *shape) from u (n, dimensions), checked and below 1."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """As a dictionary, with the `kind` that `from_dict` needs.

        Raises:
            TypeError: The class has no line in `DISTRIBUTIONS`.
        """
        return {
            "kind": kind_of(self, DISTRIBUTIONS, "distributions.DISTRIBUTIONS"),
            **super().to_dict(),
        }

    @classmethod
    def _parse(cls, data: Any, path: str) -> Self:
        """The class by `kind`; a class of its own needs none."""
        found, rest = chosen(Distribution, cls, DISTRIBUTIONS, data, path)
        result: Self = super(Distribution, found)._parse(rest, path)
        return result


@dataclass(frozen=True, eq=False, repr=False)
class _Componentwise(Distribution):
    """Parameters that broadcast to the shape of a draw, each component by itself."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one draw: what the parameters broadcast to."""
        return np.broadcast_shapes(*map(np.shape, self._values().values()))

    def _quantiles(self, u: Floats) -> Floats:
        return self._component_quantiles(u.reshape(len(u), *self.shape))

    def _component_quantiles(self, u: Floats) -> Floats:
        """Quantiles of u (n, *shape), component by component."""
        raise NotImplementedError

    def _checked(self, name: str, check: Callable[[str, object], float] = checks.finite) -> Floats:
        """Checks a field and keeps it, as a float or a read-only array; returns it as an array."""
        value = checks.number_or_array(f"{type(self).__name__}.{name}", getattr(self, name), check)
        self._set(name, value)
        return np.asarray(value)

    def _broadcast(self) -> None:
        """Refuses parameters that do not broadcast."""
        shapes = {name: np.shape(value) for name, value in self._values().items()}
        shown = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        try:
            shape = np.broadcast_shapes(*shapes.values())
        except ValueError:
            raise ValueError(
                f"{type(self).__name__}: shapes must broadcast, but are {shown}"
            ) from None
        if math.prod(shape) > _MOST_NUMBERS:
            raise ValueError(
                f"{type(self).__name__}: shapes must broadcast to at most {_MOST_NUMBERS} numbers, "
                f"but are {shown}"
            )

    def _refuse(self, name: str, wrong: object, rule: str, other: str = "") -> None:
        """An error where any of `wrong` is true, with the rule and the `other` field's value."""
        where = np.argwhere(np.broadcast_to(np.asarray(wrong), self.shape))
        if not len(where):
            return
        index = tuple(map(int, where[0]))

        def said(field: str) -> tuple[str, float]:
            value = np.asarray(getattr(self, field))
            shown = f"{field}{list(index)}" if value.ndim else field
            return shown, float(np.broadcast_to(value, self.shape)[index])

        shown, value = said(name)
        message = f"{type(self).__name__}.{shown} = {value}: must {rule}"
        if other:
            shown, value = said(other)
            message += f" {shown}, {value}"
        raise ValueError(message)


@dataclass(frozen=True, eq=False, repr=False)
class Normal(_Componentwise):
    """The normal distribution. `ppf` needs SciPy, `sample` does not.

    Attributes:
        mean: Of any shape.
        std: Standard deviation, >= 0; 0 leaves the mean.
    """

    mean: ArrayLike
    std: ArrayLike

    def __post_init__(self) -> None:
        """Checks both, and that the tails do not overflow."""
        mean, std = self._checked("mean"), self._checked("std")
        self._broadcast()
        self._refuse("std", std < 0.0, "be >= 0")
        with np.errstate(over="ignore"):
            end = np.abs(mean) + _TAIL * std
        self._refuse("std", ~np.isfinite(end), "keep mean + 9 std finite beside", "mean")

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Random draws (n, *shape); row k is the same for any larger n."""
        n = _checked_count(rng, n)
        return rng.normal(np.asarray(self.mean), np.asarray(self.std), (n, *self.shape))

    def _component_quantiles(self, u: Floats) -> Floats:
        quantiles: Floats = np.asarray(self.mean) + np.asarray(self.std) * normal(
            u, type(self).__name__
        )
        return quantiles


@dataclass(frozen=True, eq=False, repr=False)
class Uniform(_Componentwise):
    """Every number from `low` to `high` alike.

    Attributes:
        low: Of any shape.
        high: Above `low`.
    """

    low: ArrayLike
    high: ArrayLike

    def __post_init__(self) -> None:
        """Checks both."""
        low, high = self._checked("low"), self._checked("high")
        self._broadcast()
        self._refuse("high", high <= low, "be >", "low")
        with np.errstate(over="ignore"):
            width = high - low
        self._refuse("high", ~np.isfinite(width), "be at a finite distance from", "low")

    def _component_quantiles(self, u: Floats) -> Floats:
        low, high = np.asarray(self.low), np.asarray(self.high)
        quantiles: Floats = np.clip(low + (high - low) * u, low, high)
        return quantiles


@dataclass(frozen=True, eq=False, repr=False)
class LogUniform(_Componentwise):
    """Every ratio alike: the logarithm is uniform. For what is known to an order of magnitude.

    Attributes:
        low: > 0, of any shape.
        high: Above `low`.
    """

    low: ArrayLike
    high: ArrayLike

    def __post_init__(self) -> None:
        """Checks both."""
        low, high = self._checked("low"), self._checked("high")
        self._broadcast()
        self._refuse("low", low <= 0.0, "be > 0")
        self._refuse("high", high <= low, "be >", "low")

    def _component_quantiles(self, u: Floats) -> Floats:
        low, high = np.asarray(self.low), np.asarray(self.high)
        bottom, top = np.log(low), np.log(high)
        with np.errstate(over="ignore"):
            quantiles: Floats = np.clip(np.exp(bottom + (top - bottom) * u), low, high)
        return quantiles


@dataclass(frozen=True, eq=False, repr=False)
class LogNormal(_Componentwise):
    """The logarithm is normal: median * exp(sigma * z). `ppf` needs SciPy, `sample` does not.

    Attributes:
        median: > 0, of any shape; half of the draws lie below it.
        sigma: Standard deviation of the natural logarithm, >= 0: for small ones the coefficient of
            variation.
    """

    median: ArrayLike
    sigma: ArrayLike

    def __post_init__(self) -> None:
        """Checks both, and that the upper tail does not overflow."""
        median, sigma = self._checked("median"), self._checked("sigma")
        self._broadcast()
        self._refuse("median", median <= 0.0, "be > 0")
        self._refuse("sigma", sigma < 0.0, "be >= 0")
        limit = math.log(np.finfo(np.float64).max)
        with np.errstate(over="ignore"):
            end = np.log(median) + _TAIL * sigma
        self._refuse("sigma", end > limit, "keep median * exp(9 sigma) finite beside", "median")

    def sample(self, rng: np.random.Generator, n: int) -> Floats:
        """Random draws (n, *shape); row k is the same for any larger n."""
        n = _checked_count(rng, n)
        return self._from_normal(rng.standard_normal((n, *self.shape)))

    def _component_quantiles(self, u: Floats) -> Floats:
        return self._from_normal(normal(u, type(self).__name__))

    def _from_normal(self, z: Floats) -> Floats:
        # Through the logarithm: exp(sigma z) alone may overflow where the product does not.
        draws: Floats = np.exp(np.log(self.median) + np.asarray(self.sigma) * z)
        return draws


@dataclass(frozen=True, eq=False, repr=False)
class TruncatedNormal(_Componentwise):
    """The normal distribution between two bounds, given that it lies there. Needs SciPy.

    Draws are quantiles of uniform numbers, also in `sample`. They come from logarithms of the
    tails: the share of the probability below each is right to 1e-8 with bounds 50 std out, to 1e-6
    with bounds 1000 std out.

    Attributes:
        mean: Of the normal before it is cut, of any shape.
        std: Standard deviation before it is cut, > 0.
        low: Lower bound; -inf is none.
        high: Upper bound, above `low`; inf is none. One of the bounds or what lies between them
            must be within 1000 std of the mean.
    """

    mean: ArrayLike
    std: ArrayLike
    low: ArrayLike
    high: ArrayLike

    def __post_init__(self) -> None:
        """Checks all four."""
        mean, std = self._checked("mean"), self._checked("std")
        low, high = (
            self._checked("low", checks.not_nan),
            self._checked("high", checks.not_nan),
        )
        self._broadcast()
        self._refuse("std", std <= 0.0, "be > 0")
        self._refuse("high", high <= low, "be >", "low")
        with np.errstate(over="ignore"):
            end = np.abs(mean) + _TAIL * std
            bottom, top = (low - mean) / std, (high - mean) / std
        self._refuse("std", ~np.isfinite(end), "keep mean + 9 std finite beside", "mean")
        self._refuse("low", bottom > _FARTHEST, "be at most 1000 std above", "mean")
        self._refuse("high", top < -_FARTHEST, "be at most 1000 std below", "mean")

    def _component_quantiles(self, u: Floats) -> Floats:
        own = (np.broadcast_to(value, self.shape) for value in self._values().values())
        return truncated(u, *own, owner=type(self).__name__)


@dataclass(frozen=True, eq=False, repr=False)
class Choice(Distribution):
    """One of some values, numbers or arrays: measured parts, or an earlier study's samples.

    Attributes:
        values: (k, ...): k of them, each of the shape of a draw.
        weights: (k,), >= 0, of any sum above 0; None is all alike.
    """

    values: ArrayLike
    weights: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Checks both."""
        given = checks.read("Choice.values", self.values)
        checks.require_few_axes("Choice.values", given)
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
        with np.errstate(over="ignore"):
            total = weights.sum()
        if not (np.isfinite(total) and total > 0.0):
            raise ValueError(f"Choice.weights: their sum is {total}, must be finite and > 0")

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one value."""
        return np.shape(self.values)[1:]

    @property
    def dimensions(self) -> int:
        """One: which value."""
        return 1

    def _quantiles(self, u: Floats) -> Floats:
        values = np.asarray(self.values)
        if self.weights is None:
            # Below 1 times k may round to k.
            index = np.minimum((u[:, 0] * len(values)).astype(np.intp), len(values) - 1)
        else:
            ends = np.cumsum(self.weights)
            index = np.searchsorted(ends / ends[-1], u[:, 0], side="right")
        drawn: Floats = values[index]
        return drawn


def _checked_count(rng: object, n: object) -> int:
    """How many draws are asked for, of a generator."""
    checks.instance("rng", rng, np.random.Generator)
    return checks.integer("n", n, 0, _MOST_DRAWS)


# By the `kind` that stands in a study file.
DISTRIBUTIONS: dict[str, type[Distribution]] = {
    "normal": Normal,
    "uniform": Uniform,
    "log_uniform": LogUniform,
    "log_normal": LogNormal,
    "truncated_normal": TruncatedNormal,
    "choice": Choice,
}
