"""Distributions against SciPy's and mpmath's: draws, quantiles, tails; and what they refuse."""

import copy
import pickle
from dataclasses import FrozenInstanceError, replace
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from conftest import Hide
from softpinch.study import distributions
from softpinch.study.distributions import (
    DISTRIBUTIONS,
    Choice,
    Distribution,
    LogNormal,
    LogUniform,
    Normal,
    TruncatedNormal,
    Uniform,
)

# Ours and SciPy's by its own parameters.
CONTINUOUS: list[tuple[Distribution, Any]] = [
    (Normal(0.1, 0.02), stats.norm(0.1, 0.02)),
    (Uniform(-80.0, 30.0), stats.uniform(-80.0, 110.0)),
    (LogUniform(1e-3, 10.0), stats.loguniform(1e-3, 10.0)),
    (LogNormal(2.5, 0.4), stats.lognorm(0.4, scale=2.5)),
    (TruncatedNormal(1.0, 0.5, 0.3, 1.2), stats.truncnorm(-1.4, 0.4, 1.0, 0.5)),
    (TruncatedNormal(0.0, 2.0, 5.0, np.inf), stats.truncnorm(2.5, np.inf, 0.0, 2.0)),
    (TruncatedNormal(0.0, 2.0, -np.inf, 1.0), stats.truncnorm(-np.inf, 0.5, 0.0, 2.0)),
]
VALUES, WEIGHTS = [3.0, -1.0, 7.0, 0.5], [1.0, 2.0, 0.0, 5.0]
EVERY: list[Distribution] = [
    *(ours for ours, _ in CONTINUOUS),
    Choice(VALUES),
    Choice([[1, 2], [3, 4], [5, 6]], [0.2, 0.3, 0.5]),
    Normal((0.0, 1.0), 0.5),
    Uniform([[0.0], [1.0]], [2.0, 3.0, 4.0]),
]
# Generous, and the seeds are fixed: what is below is a fault, not bad luck.
P_VALUE = 1e-4
continuous = pytest.mark.parametrize(("ours", "theirs"), CONTINUOUS, ids=lambda x: repr(x)[:25])
every = pytest.mark.parametrize("ours", EVERY, ids=repr)


@continuous
def test_random_draws_follow_the_distribution(ours: Distribution, theirs: Any) -> None:
    n = 200_000
    drawn = ours.sample(np.random.default_rng(7), n)
    assert drawn.shape == (n,)
    assert stats.kstest(drawn, theirs.cdf).pvalue > P_VALUE
    mean, variance, kurtosis = map(float, theirs.stats("mvk"))
    assert abs(drawn.mean() - mean) < 5 * np.sqrt(variance / n)
    assert abs(drawn.var() / variance - 1) < 5 * np.sqrt((kurtosis + 2) / n)


@continuous
@given(u=st.floats(0.0, 1.0, exclude_max=True))
def test_quantiles_invert_scipys_cdf(ours: Distribution, theirs: Any, u: float) -> None:
    x = ours.ppf([[u]])
    assert x.shape == (1,) and np.isfinite(x).all()
    np.testing.assert_allclose(theirs.cdf(x), [u], rtol=1e-9, atol=2e-14)
    np.testing.assert_allclose(theirs.sf(x), [1 - u], rtol=1e-9, atol=2e-14)


@continuous
def test_quantiles_of_few_points_are_scipys(ours: Distribution, theirs: Any) -> None:
    u = np.linspace(0.001, 0.999, 57)
    np.testing.assert_allclose(ours.ppf(u[:, None]), theirs.ppf(u), rtol=1e-10)


@pytest.mark.parametrize(
    ("low", "high"),
    [(30, 31), (-31, -30), (990, np.inf), (-np.inf, -500), (-1, 8), (5, 5.001), (-8, 7), (9, 40)],
)
def test_truncated_tails_keep_their_digits(low: float, high: float) -> None:
    """The share of the probability below each quantile, by mpmath with 60 digits."""
    u = np.array([2.0**-40, 1e-6, 0.01, 0.3, 0.5, 0.8, 0.999, 1 - 2.0**-30])
    x = TruncatedNormal(0.0, 1.0, low, high).ppf(u[:, None])
    assert (low <= x).all() and (x <= high).all()
    with mpmath.workdps(60):

        def between(a: float, b: float) -> mpmath.mpf:
            # From the side on which the tail is small.
            if a > 0:
                a, b = -b, -a
            return mpmath.ncdf(b) - mpmath.ncdf(a)

        shares = [float(between(low, float(z)) / between(low, high)) for z in x]
    atol = 1e-8 if min(abs(low), abs(high)) < 50 else 1e-6
    np.testing.assert_allclose(shares, u, rtol=0, atol=atol)


@every
def test_the_ends_of_the_unit_interval_are_finite_and_in_order(ours: Distribution) -> None:
    u = np.repeat([[0.0], [2.0**-60], [0.5], [1 - 2.0**-53], [1.0]], ours.dimensions, axis=1)
    x = ours.ppf(u)
    assert x.shape == (5, *ours.shape) and np.isfinite(x).all()
    if not isinstance(ours, Choice):
        assert (np.diff(x, axis=0) >= 0).all() and (x[0] < x[2]).all() and (x[2] < x[3]).all()
    np.testing.assert_array_equal(x[3], x[4])


def test_the_normal_at_zero_is_the_quantile_at_two_to_the_minus_54() -> None:
    np.testing.assert_allclose(Normal(0, 1).ppf([[0.0]]), stats.norm.ppf(2.0**-54), rtol=1e-13)


@every
def test_draws_have_the_shape_and_more_of_them_begin_alike(ours: Distribution) -> None:
    many = ours.sample(np.random.default_rng(3), 500)
    assert many.shape == (500, *ours.shape) and many.dtype == np.float64
    np.testing.assert_array_equal(ours.sample(np.random.default_rng(3), 100), many[:100])
    assert ours.dimensions == (1 if isinstance(ours, Choice) else many[0].size)


def test_components_have_their_own_parameters_and_are_independent() -> None:
    n = 20_000
    ours = Normal([[0.0], [10.0]], [1.0, 2.0, 3.0])
    drawn = ours.sample(np.random.default_rng(1), n)
    assert ours.shape == (2, 3) and ours.dimensions == 6
    for i, mean in enumerate([0.0, 10.0]):
        for j, std in enumerate([1.0, 2.0, 3.0]):
            assert stats.kstest(drawn[:, i, j], stats.norm(mean, std).cdf).pvalue > P_VALUE
    correlation = np.corrcoef(drawn.reshape(n, 6).T) - np.eye(6)
    assert np.abs(correlation).max() < 5 / np.sqrt(n)
    u = np.random.default_rng(2).random((4, 6))
    placed = ours.ppf(u)
    for k in range(6):
        i, j = divmod(k, 3)
        theirs = stats.norm(10.0 * i, j + 1.0).ppf(u[:, k])
        np.testing.assert_allclose(placed[:, i, j], theirs, rtol=1e-12)


@pytest.mark.parametrize("weights", [None, WEIGHTS])
def test_choices_come_as_often_as_their_weights_say(weights: list[float] | None) -> None:
    n = 20_000
    drawn = Choice(VALUES, weights).sample(np.random.default_rng(4), n)
    counts = np.array([(drawn == value).sum() for value in VALUES])
    assert counts.sum() == n
    share = np.ones(4) / 4 if weights is None else np.array(weights) / sum(weights)
    possible = share > 0
    assert not counts[~possible].any()
    assert stats.chisquare(counts[possible], n * share[possible]).pvalue > P_VALUE


def test_quantiles_of_a_choice_go_through_its_values_in_order() -> None:
    u = (np.arange(1000)[:, None] + 0.5) / 1000
    np.testing.assert_array_equal(Choice(VALUES).ppf(u), np.repeat(VALUES, 250))
    weighted = np.repeat(VALUES, [125, 250, 0, 625])
    np.testing.assert_array_equal(Choice(VALUES, WEIGHTS).ppf(u), weighted)
    # Values without weight are not drawn at the ends either.
    weighted = Choice([1.0, 2.0, 3.0], [0.0, 1.0, 0.0]).ppf([[0.0], [1.0]])
    np.testing.assert_array_equal(weighted, 2.0)
    rows = Choice([[1, 2], [3, 4]]).ppf([[0.1], [0.9]])
    np.testing.assert_array_equal(rows, [[1, 2], [3, 4]])


def test_no_scatter_leaves_the_middle() -> None:
    rng = np.random.default_rng(1)
    assert (Normal((3.0, 0.0), (0.0, 1.0)).sample(rng, 50)[:, 0] == 3.0).all()
    np.testing.assert_allclose(LogNormal(3.0, 0.0).sample(rng, 50), 3.0, rtol=1e-15)


@every
def test_copies_and_plain_dictionaries_are_equal(ours: Distribution) -> None:
    kinds = {kind for kind, cls in DISTRIBUTIONS.items() if type(ours) is cls}
    assert ours.to_dict()["kind"] in kinds
    for again in (
        Distribution.from_dict(ours.to_dict()),
        type(ours).from_dict(ours.to_dict()),
        pickle.loads(pickle.dumps(ours)),
        copy.deepcopy(ours),
        replace(ours),
    ):
        assert again == ours and hash(again) == hash(ours) and repr(again) == repr(ours)


def test_they_are_frozen_and_keep_copies() -> None:
    mean = np.zeros(2)
    ours = Normal(mean, 1.0)
    mean[0] = 5.0
    assert ours == Normal((0.0, 0.0), 1.0)
    with pytest.raises(FrozenInstanceError):
        ours.mean = 1.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        ours.mean[0] = 1.0  # type: ignore[index]


REFUSED: list[tuple[type[Distribution], tuple[Any, ...], type[Exception], str]] = [
    (Uniform, (2, 1), ValueError, r"^Uniform.high = 1.0: must be > low, 2.0$"),
    (Uniform, ((0, 2), (1, 1)), ValueError, r"^Uniform.high = array.*: must be > low, array"),
    (Uniform, (-1e308, 1e308), ValueError, r"^Uniform.high = 1e\+308: must be at a finite dist"),
    (Uniform, (0, np.inf), ValueError, r"^Uniform.high = inf: must be finite$"),
    (Normal, (0, -1), ValueError, r"^Normal.std = -1.0: must be >= 0$"),
    (Normal, (np.nan, 1), ValueError, r"^Normal.mean = nan: must be finite$"),
    (Normal, ((1, 2), (1, 2, 3)), ValueError, r"^Normal: shapes must broadcast, but are mean \(2"),
    (LogUniform, (0, 1), ValueError, r"^LogUniform.low = 0.0: must be > 0$"),
    (LogNormal, (0, 1), ValueError, r"^LogNormal.median = 0.0: must be > 0$"),
    (TruncatedNormal, (0, 0, 0, 1), ValueError, r"^TruncatedNormal.std = 0.0: must be > 0$"),
    (TruncatedNormal, (0, 1, 1001, 1e9), ValueError, r"low = 1001.0: must be at most 1000 std ab"),
    (Choice, ([],), ValueError, r"^Choice.values has shape \(0,\): must have shape \(k, ...\)$"),
    (Choice, ([1, 2], [1]), ValueError, r"^Choice.weights has 1 rows: must have one for each of"),
    (Choice, ([1, 2], [1, -1]), ValueError, r"^Choice.weights\[1\] = -1.0: must be >= 0$"),
    (Choice, ([1, 2], [0, 0]), ValueError, r"^Choice.weights: their sum is 0.0, must be"),
]


@pytest.mark.parametrize(("cls", "parameters", "error", "message"), REFUSED)
def test_bad_parameters_are_refused_by_name(
    cls: type[Distribution], parameters: tuple[Any, ...], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        cls(*parameters)


@pytest.mark.parametrize(
    ("u", "message"),
    [
        ([0.5], r"^u has shape \(1,\): must have shape \(1, 1\)$"),
        ([[0.5, 0.5]], r"^u has shape \(1, 2\): must have shape \(1, 1\)$"),
        ([[0.1], [-0.1]], r"^u\[1, 0\] = -0.1: must be within \[0, 1\)$"),
        ([[np.nan]], r"^u\[0, 0\] = nan: must be finite$"),
    ],
)
def test_bad_uniform_numbers_are_refused(u: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Normal(0, 1).ppf(u)


def test_only_quantiles_of_the_normals_need_scipy(without: Hide) -> None:
    without("scipy")
    rng = np.random.default_rng(1)
    for ours in (Normal(0, 1), LogNormal(1, 1), Uniform(0, 1), LogUniform(1, 2), Choice([1])):
        ours.sample(rng, 3)
    for ours in (Uniform(0, 1), LogUniform(1, 2), Choice([1])):
        ours.ppf([[0.5]])
    for ours in (Normal(0, 1), LogNormal(1, 1), TruncatedNormal(0, 1, 0, 1)):
        with pytest.raises(ImportError, match=f"extra study is needed for .*{type(ours).__name__}"):
            ours.ppf([[0.5]])
    with pytest.raises(ImportError, match="extra study"):
        TruncatedNormal(0, 1, 0, 1).sample(rng, 3)


def test_a_class_without_a_line_in_the_table_says_so() -> None:
    class Own(distributions.Normal):
        pass

    with pytest.raises(TypeError, match="Own has no kind"):
        Own(0, 1).to_dict()
