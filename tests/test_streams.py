"""Reductions over chunks against exact arithmetic and NumPy, however the numbers are cut."""

import math
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from softpinch import _streams
from softpinch._record import Floats
from softpinch._streams import ExactSum, Mean, quantiles

LARGEST, SMALLEST = float(np.finfo(np.float64).max), 5e-324
Q = [0.0, 0.05, 0.25, 1 / 3, 0.5, 0.5, 0.95, 0.999, 1.0]

finite = st.floats(allow_nan=False, allow_infinity=False)
# Few different numbers, so that they repeat; zeros of both signs; and what overflows, or vanishes.
awkward = st.sampled_from(
    [
        0.0,
        -0.0,
        1.0,
        -1.0,
        1.0 + 2**-52,
        1e16,
        -1e16,
        LARGEST,
        -LARGEST,
        SMALLEST,
        -SMALLEST,
        1e-310,
    ]
)
moderate = st.floats(-1e6, 1e6)
many = st.lists(finite | awkward, max_size=40) | st.lists(moderate, max_size=40)
anything = st.lists(st.floats() | awkward, max_size=40)
shares = st.lists(st.floats(0.0, 1.0) | st.sampled_from([0.0, 0.5, 1.0]), max_size=8)


def cut(values: Floats, seed: int) -> list[Floats]:
    """The values in another order, in chunks of chance lengths, some empty."""
    rng = np.random.default_rng(seed)
    places = np.sort(rng.integers(0, len(values) + 1, size=5))
    return np.split(rng.permutation(values), places)


def bits(values: Sequence[float]) -> list[str]:
    """What tells 0.0 from -0.0, and takes NaN for equal to itself."""
    return [float(each).hex() for each in values]


def exact_sum(values: Sequence[float]) -> float:
    """Rounded once, to infinity where it must be."""
    exact = sum(map(Fraction, values), Fraction(0))
    try:
        return float(exact)
    except OverflowError:
        return math.inf if exact > 0 else -math.inf


def total(chunks: Sequence[Floats]) -> float:
    result = ExactSum()
    for chunk in chunks:
        result.add(chunk)
    return result.value


SAMPLES: dict[str, Callable[[np.random.Generator, int], NDArray[Any]]] = {
    "normal": lambda rng, n: rng.normal(size=n),
    "every exponent": lambda rng, n: (
        np.ldexp(rng.uniform(0.5, 1.0, n), rng.integers(-1073, 1025, n)) * rng.choice([-1, 1], n)
    ),
    "narrow": lambda rng, n: 1.0 + 1e-13 * rng.normal(size=n),
    "repeated": lambda rng, n: rng.integers(-3, 4, n) * 0.1,
    "all equal": lambda rng, n: np.full(n, 0.1),
    "denormal": lambda rng, n: rng.integers(-50, 50, n) * SMALLEST,
    "huge": lambda rng, n: rng.uniform(-0.4, 0.4, n) * LARGEST,
}


def sample(name: str, n: int = 3000) -> Floats:
    return SAMPLES[name](np.random.default_rng(7), n)


@given(many, st.integers(0, 1000))
def test_the_sum_is_the_exact_one_rounded_once(values: list[float], seed: int) -> None:
    assert bits([total(cut(np.array(values), seed))]) == bits([exact_sum(values)])


@pytest.mark.parametrize("name", SAMPLES)
def test_the_sum_of_many(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    values = sample(name)
    expected = exact_sum(values.tolist())
    # Of the others, fsum may give up where partial sums overflow.
    if name not in ("huge", "every exponent"):
        assert expected == math.fsum(values.tolist())
    assert total([values]) == expected
    monkeypatch.setattr(_streams, "_BLOCK", 64)
    assert total(cut(values, 3)) == expected


def test_the_sum_of_more_than_a_block() -> None:
    # All bits of the significand are set, and all exponents alike: the most that a block adds up.
    values = np.full(3 * 2**16 + 5, 2.0 - 2.0**-52)
    assert total([values]) == float(len(values) * Fraction(2.0 - 2.0**-52))


def test_the_sum_cancels_exactly() -> None:
    values = np.concatenate([sample("every exponent"), [SMALLEST]])
    everything = np.concatenate([values, -values[:-1]])
    for seed in range(5):
        assert total(cut(everything, seed)) == SMALLEST


def test_a_sum_overflows_only_at_the_end() -> None:
    result = ExactSum()
    for sign in (1.0, -1.0):
        assert result.value == 0.0
        result.add(np.array([sign * LARGEST, sign * LARGEST]))
        assert result.value == sign * math.inf
        result.add(np.array([-sign * LARGEST]))
        assert result.value == sign * LARGEST
        result.add(np.array([-sign * LARGEST]))


def test_a_sum_takes_chunks_of_any_shape() -> None:
    values = sample("normal", 600)
    assert total([values.reshape(20, 30).T[::2], values.reshape(20, 30).T[1::2]]) == total([values])
    assert total([np.array(2.5), np.empty((0, 3))]) == 2.5


def exact_mean(values: Sequence[float]) -> tuple[Fraction, Fraction]:
    """Mean and sample variance of two or more values."""
    exact = [Fraction(each) for each in values]
    mean = sum(exact, Fraction(0)) / len(exact)
    return mean, sum(((each - mean) ** 2 for each in exact), Fraction(0)) / (len(exact) - 1)


def close_root(root: float, square: Fraction, bound: float) -> bool:
    """Whether `root` is the root of `square` to a relative bound, or to a denormal's rounding."""
    if math.isinf(root):
        return square > Fraction(LARGEST) ** 2 * (1 - Fraction(bound))
    low = max(Fraction(0), Fraction(root) * (1 - Fraction(bound)) - Fraction(SMALLEST))
    return low**2 <= square <= (Fraction(root) * (1 + Fraction(bound)) + Fraction(SMALLEST)) ** 2


def check_mean(values: Sequence[float]) -> None:
    result = Mean.of(lambda: cut(np.array(values), 1))
    mean, variance = exact_mean(values)
    assert result.value == float(mean)
    assert close_root(result.spread, variance, 1e-15)
    assert close_root(result.error, variance / len(values), 1e-15) or math.isinf(result.spread)
    assert (result.least, result.greatest) == (min(values), max(values))
    assert (result.runs, result.left_out) == (len(values), 0)


@given(st.lists(finite | awkward, min_size=2, max_size=40))
def test_the_mean_is_the_exact_one(values: list[float]) -> None:
    check_mean(values)


@pytest.mark.parametrize("name", SAMPLES)
def test_the_mean_of_many(name: str) -> None:
    check_mean(sample(name, 1000).tolist())


def test_the_spread_of_neighbours() -> None:
    # The mean rounds to 1.0: without the correction the spread would be sqrt(2) times too large.
    assert Mean.of(lambda: [np.array([1.0, 1.0 + 2**-52])]).spread == pytest.approx(
        2**-52 / math.sqrt(2), rel=1e-15
    )


@given(anything, st.integers(0, 1000))
def test_the_mean_does_not_depend_on_chunks_and_order(values: list[float], seed: int) -> None:
    given_order = Mean.of(lambda: [np.array(values)])
    other = Mean.of(lambda: cut(np.array(values), seed))
    assert bits(other) == bits(given_order)


def test_the_mean_leaves_out_what_is_not_finite() -> None:
    values = np.array([1.0, math.nan, 2.0, math.inf, 6.0, -math.inf])
    result = Mean.of(lambda: [values[:2], values[2:]])
    assert result == (3.0, math.sqrt(7 / 3), math.sqrt(7), 1.0, 6.0, 3, 3)
    assert float(result) == 3.0


def test_the_mean_of_one_and_of_none() -> None:
    one = Mean.of(lambda: [np.array([-0.0])])
    assert bits(one) == bits([0.0, math.nan, math.nan, 0.0, 0.0, 1, 0])
    assert bits(Mean.of(lambda: [])) == bits([math.nan] * 5 + [0, 0])
    assert bits(Mean.of(lambda: [np.empty(0)])) == bits([math.nan] * 5 + [0, 0])
    assert bits(Mean.of(lambda: [np.full(4, math.nan)])) == bits([math.nan] * 5 + [0, 4])


@pytest.mark.parametrize(
    ("value", "error", "left_out", "text"),
    [
        (0.0123456, 0.000412, 0, "0.01235 ± 0.00041 (1000 runs)"),
        (-1234567.8, 0.25, 12, "-1234567.8 ± 0.25 (1000 runs), 12 left out"),
        (0.0012, 0.5, 0, "0.001 ± 0.5 (1000 runs)"),
        (0.0, 0.5, 0, "0 ± 0.5 (1000 runs)"),
        (1 / 3, 0.0, 0, "0.33333 ± 0 (1000 runs)"),
        (1 / 3, math.nan, 0, "0.33333 ± nan (1000 runs)"),
        (math.nan, math.nan, 3, "nan ± nan (1000 runs), 3 left out"),
        (1e308, math.inf, 0, "1e+308 ± inf (1000 runs)"),
        (1e300, 1e-300, 0, "1.0000000000000001e+300 ± 1e-300 (1000 runs)"),
    ],
)
def test_the_mean_as_text(value: float, error: float, left_out: int, text: str) -> None:
    assert str(Mean(value, error, 1.0, 0.0, 1.0, 1000, left_out)) == text


def expected_quantiles(values: Floats, q: Sequence[float]) -> list[float]:
    """NumPy's, where a zero has no sign, of the finite values."""
    kept = values[np.isfinite(values)] + 0.0
    if len(kept) == 0:
        return [math.nan] * len(q)
    with np.errstate(over="ignore", invalid="ignore"):
        result: list[float] = np.quantile(kept, np.array(q, dtype=np.float64)).tolist()
    return result


# From sorting all that is left after one pass to never sorting.
@pytest.fixture(params=[2**20, 100, 4, 0], ids=lambda limit: f"gathered{limit}")
def gathered(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    limit: int = request.param
    monkeypatch.setattr(_streams, "_GATHERED", limit)
    return limit


@pytest.mark.usefixtures("gathered")
@pytest.mark.parametrize("name", SAMPLES)
def test_quantiles_of_many_are_numpys(name: str) -> None:
    values = sample(name)
    chunks = cut(values, 5)
    for q in ([0.5], Q, Q[::-1], np.linspace(0.0, 1.0, 57).tolist()):
        assert bits(quantiles(lambda: chunks, q)) == bits(expected_quantiles(values, q))


@pytest.mark.parametrize("limit", [2**20, 2, 0])
@given(values=anything, q=shares, seed=st.integers(0, 1000))
def test_quantiles_are_numpys(limit: int, values: list[float], q: list[float], seed: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_streams, "_GATHERED", limit)
        found = quantiles(lambda: cut(np.array(values), seed), q)
    assert bits(found) == bits(expected_quantiles(np.array(values), q))


def counted(chunks: list[Floats]) -> tuple[Callable[[], list[Floats]], list[None]]:
    """The chunks for every pass, and a list that grows by one with each."""
    passes: list[None] = []

    def again() -> list[Floats]:
        passes.append(None)
        return chunks

    return again, passes


def test_the_passes_that_quantiles_take(gathered: int) -> None:
    # Four order statistics, far enough apart: no fewer candidates can be left.
    chunks, passes = counted([sample("normal")])
    quantiles(chunks, [0.3, 0.7])
    assert len(passes) == {2**20: 2, 100: 2, 4: 3, 0: 4}[gathered]


def quantiles_of(values: Sequence[float], q: Sequence[float]) -> list[float]:
    return quantiles(lambda: [np.array(values)], q)


def test_medians_of_two_are_numpys() -> None:
    # Halfway, interpolating from either end is right, and rounds differently.
    for pair in np.random.default_rng(11).normal(size=(200, 2)):
        assert quantiles_of(pair, [0.5]) == [np.quantile(pair, 0.5)]


def test_a_zero_has_no_sign_in_quantiles() -> None:
    for zeros in ([-0.0, -0.0], [0.0, -0.0], [-0.0, 0.0], [-0.0]):
        assert bits(quantiles_of(zeros, [0.0, 0.5, 1.0])) == bits([0.0, 0.0, 0.0])


def test_infinities_and_nan_are_left_out() -> None:
    values = np.array([math.inf, 3.0, math.nan, 1.0, -math.inf, -math.nan])
    assert quantiles(lambda: [values, values], [0.0, 0.5, 1.0]) == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("q", [-1e-9, 1.0 + 1e-9, math.nan, math.inf])
def test_quantiles_refuse_what_is_no_share(q: float) -> None:
    with pytest.raises(ValueError, match=r"q = .*: must lie between 0 and 1"):
        quantiles_of([1.0, 2.0], [0.5, q])


@pytest.mark.parametrize("limit", [2**20, 0])
def test_an_iterator_that_is_used_up_is_noticed(
    limit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_streams, "_GATHERED", limit)

    def once() -> Callable[[], Iterator[Floats]]:
        chunks = iter([sample("normal")])
        return lambda: chunks

    for reduce in (Mean.of, lambda chunks: quantiles(chunks, [0.5])):
        with pytest.raises(ValueError, match=r"same values in every pass: 3000 .*, now 0"):
            reduce(once())
