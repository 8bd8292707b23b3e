"""Means against exact arithmetic; quantiles of results are those of NumPy."""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch.study.estimates import Mean
from softpinch.study.tables import number
from stores import SCENE, in_memory

LARGEST, SMALLEST = float(np.finfo(np.float64).max), 5e-324

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
anything = st.lists(st.floats() | awkward, max_size=40)


def bits(values: Sequence[float]) -> list[str]:
    """Texts that distinguish 0.0 from -0.0, and in which NaN equals itself."""
    return [float(each).hex() for each in values]


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
    result = Mean.of(np.random.default_rng(1).permutation(values))
    mean, variance = exact_mean(values)
    # The sum is rounded, by at most one ulp of the mean, and so is the quotient, by half of one;
    # beside the largest doubles the smallest vanish.
    rounding = Fraction(3, 2) * Fraction(math.ulp(result.value))
    bound = rounding + Fraction(max(map(abs, values))) / 2**900
    assert abs(Fraction(result.value) - mean) <= bound
    assert close_root(result.spread, variance, 1e-15)
    assert close_root(result.error, variance / len(values), 1e-15) or math.isinf(result.spread)
    assert (result.least, result.greatest) == (min(values), max(values))
    assert (result.runs, result.left_out) == (len(values), 0)


@given(st.lists(finite | awkward, min_size=2, max_size=40))
def test_the_mean_is_the_exact_one(values: list[float]) -> None:
    check_mean(values)


def test_the_spread_of_neighbours() -> None:
    # The mean rounds to 1.0: without the correction the spread would be sqrt(2) times too large.
    assert Mean.of(np.array([1.0, 1.0 + 2**-52])).spread == pytest.approx(
        2**-52 / math.sqrt(2), rel=1e-15
    )


@given(anything, st.integers(0, 1000))
def test_the_mean_does_not_depend_on_the_order(values: list[float], seed: int) -> None:
    given_order = Mean.of(np.array(values))
    other = Mean.of(np.random.default_rng(seed).permutation(np.array(values)))
    assert bits(other) == bits(given_order)


def test_the_mean_leaves_out_what_is_not_finite() -> None:
    values = np.array([1.0, math.nan, 2.0, math.inf, 6.0, -math.inf])
    result = Mean.of(values)
    assert result == (3.0, math.sqrt(7 / 3), math.sqrt(7), 1.0, 6.0, 3, 3)
    assert float(result) == 3.0


def test_the_mean_of_one_and_of_none() -> None:
    one = Mean.of(np.array([-0.0]))
    assert bits(one) == bits([0.0, math.nan, math.nan, 0.0, 0.0, 1, 0])
    assert bits(Mean.of(np.empty(0))) == bits([math.nan] * 5 + [0, 0])
    assert bits(Mean.of(np.full(4, math.nan))) == bits([math.nan] * 5 + [0, 4])


@pytest.mark.parametrize(
    ("value", "error", "left_out", "text"),
    [
        (0.0123456, 0.000412, 0, "0.01235 ± 0.00041 (1000 runs)"),
        (-1234567.8, 0.25, 12, "-1234567.8 ± 0.25 (1000 runs), 12 left out"),
        (0.0, 0.5, 0, "0 ± 0.5 (1000 runs)"),
        (math.nan, math.nan, 3, "nan ± nan (1000 runs), 3 left out"),
        (1e308, math.inf, 0, "1e+308 ± inf (1000 runs)"),
    ],
)
def test_the_mean_as_text(value: float, error: float, left_out: int, text: str) -> None:
    assert str(Mean(value, error, 1.0, 0.0, 1.0, 1000, left_out)) == text


@pytest.mark.parametrize(
    "name", ["peak_torque", "settling_time", "final_state.theta", "disturbances.1.force.0"]
)
def test_quantiles_are_numpys_of_the_finite_values(name: str) -> None:
    ensemble = in_memory("ours")
    values = number(ensemble, name).values
    kept = values[np.isfinite(values)]
    q = [0.0, 0.05, 0.25, 1 / 3, 0.5, 0.5, 0.95, 0.999, 1.0]
    assert bits(ensemble.quantile(name, q)) == bits(np.quantile(kept, q))
    middle = ensemble.quantile(name, 0.5)
    assert type(middle) is float and middle == np.quantile(kept, 0.5)
    assert ensemble.mean(name) == Mean.of(values)


def test_quantiles_of_nothing_and_of_zeros() -> None:
    forces = np.array([[-0.0, 1.0], [-0.0, 2.0]])
    ensemble = sp.monte_carlo(
        SCENE, vary={"disturbances.1.force": forces}, dt=1e-3, progress=False
    )  # fmt: skip
    # No run begins with a lost grasp, so the time of it is nowhere finite.
    assert np.isnan(ensemble["first_folded"]).all()
    assert np.isnan(ensemble.quantile("first_folded", [0.0, 0.5])).all()
    assert bits(ensemble.quantile("disturbances.1.force.0", [0.0, 0.5, 1.0])) == bits([0.0] * 3)
    with pytest.raises(ValueError, match=r"q = 1\.5: must be from 0 to 1"):
        ensemble.quantile("disturbances.1.force.0", 1.5)


def test_a_notebook_shows_a_mean_as_a_table_with_six_digits() -> None:
    html = Mean.of(np.array([1.0, 2.0, 2.0]))._repr_html_()
    assert "<th" in html and "spread" in html
    assert ">1.66667<" in html
