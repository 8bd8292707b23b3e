"""Draws of ensembles: which run gets which numbers, by every sampler, and what is refused."""

import hashlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from draws import (
    COVARIANCE,
    JOINT,
    MANY,
    P_VALUE,
    PLACED,
    SHAPES,
    assert_same,
    draw_all,
    draws,
    gamma,
)
from softpinch.study.distributions import Choice, Normal, Uniform
from softpinch.study.sampling import SAMPLERS
from softpinch.study.sources import BLOCK

# Which run gets which numbers


@pytest.mark.parametrize("vary", [MANY, JOINT])
@pytest.mark.parametrize("runs", [1, 1023, 1024, 1025, 2048])
def test_more_runs_change_no_run_that_was_there(vary: dict[Any, Any], runs: int) -> None:
    most = draw_all(draws(vary, 2600, seed=5))
    fewer = draw_all(draws(vary, runs, seed=5))
    assert_same(fewer, {path: values[:runs] for path, values in most.items()})


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_block_alone_is_the_slice_of_all(sampler: str) -> None:
    vary = {**PLACED, "length": np.arange(2600.0)}
    everything = draw_all(draws(vary, 2600, 3, sampler))
    ours = draws(vary, 2600, 3, sampler)
    for block in (2, 0, 1, 1, 2):
        rows = slice(block * BLOCK, min((block + 1) * BLOCK, 2600))
        drawn = {p: v[: rows.stop - rows.start] for p, v in ours.draw(block).items()}
        assert_same(drawn, {p: v[rows] for p, v in everything.items()})


@given(st.permutations(list(MANY)), st.integers(0, 6))
def test_other_paths_and_their_order_change_nothing(order: list[str], count: int) -> None:
    expected = draws(MANY, 10).draw(1)
    drawn = draws({path: MANY[path] for path in order[:count]}, 10).draw(1)
    assert_same(drawn, {path: expected[path] for path in order[:count]})


@pytest.mark.parametrize("sampler", ["sobol", "latin_hypercube"])
def test_the_order_of_paths_does_not_matter_to_points(sampler: str) -> None:
    turned = dict(reversed(PLACED.items()))
    one, other = draws(PLACED, 50, 1, sampler), draws(turned, 50, 1, sampler)
    assert_same(draw_all(one), draw_all(other))


@given(st.integers(0, 2**200), st.integers(0, 2**200))
def test_every_seed_draws_and_another_draws_otherwise(one: int, other: int) -> None:
    drawn = [draws({"mass": Normal(0, 1)}, 5, seed).draw(0)["mass"] for seed in (one, one, other)]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert (one == other) == bool((drawn[0] == drawn[2]).any())


def test_a_tuple_of_one_path_draws_what_the_path_draws() -> None:
    assert_same(draws({("mass",): Normal(0, 1)}).draw(0), draws({"mass": Normal(0, 1)}).draw(0))
    assert_same(
        draws({("length",): lambda rng: (gamma(rng),)}).draw(0), draws({"length": gamma}).draw(0)
    )


def test_the_generator_is_the_documented_one() -> None:
    """Philox by seed, block and the 128-bit BLAKE2b hash of the paths, low words first."""
    for paths in (("mass",), ("mass", "force")):
        digest = hashlib.blake2b("\0".join(paths).encode(), digest_size=16).digest()
        words = [int.from_bytes(digest[k : k + 4], "little") for k in (0, 4, 8, 12)]
        sequence = np.random.SeedSequence(10**30, spawn_key=(2, *words))
        size = 1 if len(paths) == 1 else 3
        expected = np.random.Generator(np.random.Philox(sequence)).random((BLOCK, size))
        one = Uniform(0, 1) if size == 1 else Uniform((0, 0, 0), 1)
        drawn = draws({paths: one}, 1, 10**30).draw(2)
        columns = [drawn[path].reshape(BLOCK, -1) for path in paths]
        np.testing.assert_array_equal(np.hstack(columns), expected)


# The numbers follow what was asked


def test_paths_components_and_blocks_are_independent() -> None:
    n = 32 * BLOCK
    vary = {"mass": Normal(0, 1), "width": Normal(0, 1), "force": Normal(0, 1)}
    drawn = draw_all(draws(vary, n))
    columns = np.column_stack([drawn["mass"], drawn["width"], drawn["force"]])
    assert np.abs(np.corrcoef(columns.T) - np.eye(4)).max() < 5 / np.sqrt(n)
    assert len(np.unique(columns)) == columns.size
    blocks = drawn["mass"].reshape(32, BLOCK)
    assert np.abs(np.corrcoef(blocks) - np.eye(32)).max() < 6 / np.sqrt(BLOCK)
    # Neither does a run depend on the one before it.
    assert abs(np.corrcoef(drawn["mass"][1:], drawn["mass"][:-1])[0, 1]) < 5 / np.sqrt(n)
    for column in columns.T:
        assert stats.kstest(column, stats.norm.cdf).pvalue > P_VALUE


def test_a_multivariate_distribution_keeps_its_covariance() -> None:
    n = 20_000
    drawn = draw_all(draws(JOINT, n))
    columns = np.column_stack([drawn["width"], drawn["length"], drawn["dust"][:, 0]])
    np.testing.assert_allclose(columns.mean(axis=0), [0, 1, 2], atol=5 * np.sqrt(2 / n))
    np.testing.assert_allclose(np.cov(columns.T), COVARIANCE, atol=5 * 3 / np.sqrt(n))
    one = draws({"force": stats.multivariate_normal([0, 5], 0.01)}).draw(0)["force"]
    np.testing.assert_allclose(one.mean(axis=0), [0, 5], atol=0.05)
    single = draws({"dust": stats.multivariate_normal([3.0])}).draw(0)["dust"]
    assert abs(single.mean() - 3.0) < 5 / 32


def test_a_function_may_tie_paths_together() -> None:
    drawn = draw_all(draws(JOINT))
    np.testing.assert_array_equal(drawn["force"][:, 1], -drawn["mass"])
    n = len(drawn["mass"])
    assert abs(np.corrcoef(drawn["force"][:, 0], drawn["mass"])[0, 1] - 0.5**0.5) < 5 / np.sqrt(n)
    as_mapping = draws({("mass", "width"): lambda r: {"width": 2.0, "mass": r.random()}}).draw(0)
    assert (as_mapping["width"] == 2.0).all() and (as_mapping["mass"] < 1.0).all()
    as_array = draws({("mass", "width"): lambda r: r.normal(size=2) * [1, 100]}).draw(0)
    assert as_array["width"].std() > 50 > as_array["mass"].std()


def test_vectors_and_arrays_over_several_paths_go_in_their_order() -> None:
    rows = np.arange(15.0).reshape(5, 3)
    drawn = draw_all(draws({("force", "mass"): rows}, None))
    np.testing.assert_array_equal(drawn["force"], rows[:, :2])
    np.testing.assert_array_equal(drawn["mass"], rows[:, 2])
    for sampler in SAMPLERS:
        vector = Uniform((0, 10, 20), (1, 11, 21))
        drawn = draw_all(draws({("mass", "force"): vector}, 20, 0, sampler))
        assert (drawn["mass"] < 1).all() and (np.floor(drawn["force"]) == [10, 20]).all()
        tied = Choice([[1, 10, 100], [2, 20, 200]])
        drawn = draw_all(draws({("mass", "force"): tied}, 20, 0, sampler))
        np.testing.assert_array_equal(drawn["force"], np.outer(drawn["mass"], [10, 100]))


@pytest.mark.parametrize("runs", [1, 10, 1023, 1024, 1025, 3000])
def test_of_all_runs_a_function_is_called_once_for_each(runs: int) -> None:
    calls = 0

    def count(rng: np.random.Generator) -> float:
        nonlocal calls
        calls += 1
        return rng.random()

    ours = draws({"mass": count}, runs)
    drawn = draw_all(ours)["mass"]
    assert calls == runs
    # Fewer calls, the same numbers.
    last = (runs - 1) // BLOCK
    whole = ours.draw(last)["mass"]
    np.testing.assert_array_equal(drawn[last * BLOCK :], whole[: (runs - 1) % BLOCK + 1])


@pytest.mark.parametrize("theirs", [stats.poisson(3.0), stats.randint(-2, 3), stats.bernoulli(0.2)])
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_discrete_distributions_stay_on_their_values(theirs: Any, sampler: str) -> None:
    drawn = draw_all(draws({"force": theirs}, 3000, 2, sampler))["force"]
    low, high = theirs.support()
    assert (drawn == np.round(drawn)).all() and low <= drawn.min() and drawn.max() <= high
    for column in drawn.T:
        assert abs(column.mean() - theirs.mean()) < 5 * theirs.std() / np.sqrt(3000)


def test_arrays_are_copied_and_may_hold_what_is_not_finite() -> None:
    mass = np.array([1.0, np.inf, np.nan])
    ours = draws({"mass": mass, "force": [[1, 2], [3, 4], [5, 6]]}, None)
    mass[0] = 7.0
    assert ours.runs == 3
    drawn = draw_all(ours)
    np.testing.assert_array_equal(drawn["mass"], [1.0, np.inf, np.nan])
    np.testing.assert_array_equal(drawn["force"], [[1, 2], [3, 4], [5, 6]])


def test_rows_after_the_end_of_an_array_or_hypercube_are_nan() -> None:
    for vary, sampler in (({"mass": np.ones(1030)}, "random"), (PLACED, "latin_hypercube")):
        ours = draws(vary, 1030, 0, sampler)
        for path, values in ours.draw(1).items():
            assert values.shape == (BLOCK, *SHAPES[path])
            assert np.isfinite(values[:6]).all() and np.isnan(values[6:]).all()


# Provenance


def test_draws_describe_where_their_numbers_come_from() -> None:
    vary = {
        "mass": Normal(0.1, 0.01),
        "width": stats.gamma(2.0, scale=np.array(3.0)),
        "length": gamma,
        ("force", "dust"): stats.multivariate_normal([0, 1, 2], COVARIANCE),
        "angles": np.ones((5, 3, 2)),
    }
    assert draws(vary, None, seed=12).describe() == {
        "sampler": "random",
        "seed": 12,
        "runs": 5,
        "block": 1024,
        "vary": {
            "mass": {"kind": "normal", "mean": 0.1, "std": 0.01},
            "width": {"kind": "scipy", "name": "gamma", "args": [2.0], "kwds": {"scale": 3.0}},
            "length": {"kind": "function", "function": f"{gamma.__module__}.gamma"},
            "force, dust": {
                "kind": "scipy",
                "name": "multivariate_normal",
                "kwds": {
                    "mean": [0.0, 1.0, 2.0],
                    "cov": COVARIANCE.tolist(),
                    "allow_singular": False,
                },
            },
            "angles": {"kind": "array", "shape": [5, 3, 2]},
        },
    }
