"""Draws of ensembles: which run gets which numbers, by every sampler, and what is refused."""

import hashlib
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

from softpinch.study.distributions import (
    Choice,
    LogNormal,
    LogUniform,
    Normal,
    TruncatedNormal,
    Uniform,
)
from softpinch.study.sampling import SAMPLERS, Plan, count_runs
from softpinch.study.sources import BLOCK

SHAPES: dict[str, tuple[int, ...]] = {
    "mass": (),
    "width": (),
    "length": (),
    "force": (2,),
    "angles": (3, 2),
    "dust": (1,),
}


def plan(
    vary: Mapping[Any, Any], runs: int | None = 3000, seed: int = 0, sampler: str = "random"
) -> Plan:
    return Plan(vary, runs, seed, sampler, shapes=SHAPES)


def gamma(rng: np.random.Generator) -> float:
    return float(rng.gamma(2.0))


def couple(rng: np.random.Generator) -> tuple[float, Any]:
    mass = rng.normal()
    return mass, [mass + rng.normal(), -mass]


COVARIANCE = np.array([[1.0, 0.6, 0.0], [0.6, 2.0, -0.5], [0.0, -0.5, 1.5]])
# One of every kind, on every sort of field.
MANY: dict[Any, Any] = {
    "mass": Normal(0.1, 0.01),
    "width": stats.weibull_min(2.0),
    "length": gamma,
    "force": Uniform((-80, -8), (80, 8)),
    "angles": LogUniform(1.0, 10.0),
    "dust": Choice([1.0, 2.0, 5.0]),
}
JOINT: dict[Any, Any] = {
    ("mass", "force"): couple,
    ("width", "length", "dust"): stats.multivariate_normal([0, 1, 2], COVARIANCE),
    "angles": stats.norm(np.arange(6.0).reshape(3, 2), 0.1),
}
PLACED = {path: value for path, value in MANY.items() if path != "length"}
P_VALUE = 1e-4


def assert_same(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> None:
    assert set(one) == set(other)
    for path in one:
        np.testing.assert_array_equal(one[path], other[path], err_msg=path)


# Which run gets which numbers


@pytest.mark.parametrize("vary", [MANY, JOINT])
def test_draws_have_the_shapes_of_the_fields(vary: dict[Any, Any]) -> None:
    ours = plan(vary, 1500)
    assert ours.blocks == 2 and ours.extendable and ours.dimensions == 0
    for path, values in ours.draw(1).items():
        assert values.shape == (BLOCK, *SHAPES[path]) and values.dtype == np.float64
    for path, values in ours.draw_all().items():
        assert values.shape == (1500, *SHAPES[path])
    assert set(ours.paths) == set(ours.draw_all())


@pytest.mark.parametrize("vary", [MANY, JOINT])
@pytest.mark.parametrize("runs", [1, 1023, 1024, 1025, 2048])
def test_more_runs_change_no_run_that_was_there(vary: dict[Any, Any], runs: int) -> None:
    most = plan(vary, 2600, seed=5).draw_all()
    fewer = plan(vary, runs, seed=5).draw_all()
    assert_same(fewer, {path: values[:runs] for path, values in most.items()})


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_block_alone_is_the_slice_of_all(sampler: str) -> None:
    vary = {**PLACED, "length": np.arange(2600.0)}
    everything = plan(vary, 2600, 3, sampler).draw_all()
    ours = plan(vary, 2600, 3, sampler)
    for block in (2, 0, 1, 1, 2):
        rows = slice(block * BLOCK, min((block + 1) * BLOCK, 2600))
        drawn = {p: v[: rows.stop - rows.start] for p, v in ours.draw(block).items()}
        assert_same(drawn, {p: v[rows] for p, v in everything.items()})


@given(st.permutations(list(MANY)), st.integers(0, 6))
def test_other_paths_and_their_order_change_nothing(order: list[str], count: int) -> None:
    expected = plan(MANY, 10).draw(1)
    drawn = plan({path: MANY[path] for path in order[:count]}, 10).draw(1)
    assert_same(drawn, {path: expected[path] for path in order[:count]})


@pytest.mark.parametrize("sampler", ["sobol", "latin_hypercube"])
def test_the_order_of_paths_does_not_matter_to_points(sampler: str) -> None:
    turned = dict(reversed(PLACED.items()))
    one, other = plan(PLACED, 50, 1, sampler), plan(turned, 50, 1, sampler)
    assert_same(one.draw_all(), other.draw_all())


@given(st.integers(0, 2**200), st.integers(0, 2**200))
def test_every_seed_draws_and_another_draws_otherwise(one: int, other: int) -> None:
    drawn = [plan({"mass": Normal(0, 1)}, 5, seed).draw(0)["mass"] for seed in (one, one, other)]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert (one == other) == bool((drawn[0] == drawn[2]).any())


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_seeds_differ_and_repeat_with_every_sampler(sampler: str) -> None:
    first, again, other = (
        plan({"mass": Uniform(0, 1)}, 100, seed, sampler).draw_all()["mass"] for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()


def test_a_tuple_of_one_path_draws_what_the_path_draws() -> None:
    assert_same(plan({("mass",): Normal(0, 1)}).draw(0), plan({"mass": Normal(0, 1)}).draw(0))
    assert_same(
        plan({("length",): lambda rng: (gamma(rng),)}).draw(0), plan({"length": gamma}).draw(0)
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
        drawn = plan({paths: one}, 1, 10**30).draw(2)
        columns = [drawn[path].reshape(BLOCK, -1) for path in paths]
        np.testing.assert_array_equal(np.hstack(columns), expected)


def test_an_empty_vary_draws_nothing() -> None:
    for sampler in SAMPLERS:
        ours = plan({}, 5, sampler=sampler)
        assert ours.draw(0) == {} and ours.draw_all() == {} and ours.paths == ()


# The numbers follow what was asked


def test_paths_components_and_blocks_are_independent() -> None:
    n = 32 * BLOCK
    vary = {"mass": Normal(0, 1), "width": Normal(0, 1), "force": Normal(0, 1)}
    drawn = plan(vary, n).draw_all()
    columns = np.column_stack([drawn["mass"], drawn["width"], drawn["force"]])
    assert np.abs(np.corrcoef(columns.T) - np.eye(4)).max() < 5 / np.sqrt(n)
    assert len(np.unique(columns)) == columns.size
    blocks = drawn["mass"].reshape(32, BLOCK)
    assert np.abs(np.corrcoef(blocks) - np.eye(32)).max() < 6 / np.sqrt(BLOCK)
    # Neither does a run depend on the one before it.
    assert abs(np.corrcoef(drawn["mass"][1:], drawn["mass"][:-1])[0, 1]) < 5 / np.sqrt(n)
    for column in columns.T:
        assert stats.kstest(column, stats.norm.cdf).pvalue > P_VALUE


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_draws_follow_their_distributions(sampler: str) -> None:
    drawn = plan(PLACED, 20_000, 11, sampler).draw_all()
    for path, cdf in {
        "mass": stats.norm(0.1, 0.01).cdf,
        "width": stats.weibull_min(2.0).cdf,
        "angles": stats.loguniform(1.0, 10.0).cdf,
    }.items():
        columns = drawn[path].reshape(20_000, -1).T
        for column in columns:
            assert stats.kstest(column, cdf).pvalue > P_VALUE
    for k, size in enumerate((80.0, 8.0)):
        cdf = stats.uniform(-size, 2 * size).cdf
        assert stats.kstest(drawn["force"][:, k], cdf).pvalue > P_VALUE
    counts = [(drawn["dust"] == value).sum() for value in (1.0, 2.0, 5.0)]
    assert sum(counts) == 20_000 and stats.chisquare(counts).pvalue > P_VALUE


def test_a_multivariate_distribution_keeps_its_covariance() -> None:
    n = 20_000
    drawn = plan(JOINT, n).draw_all()
    columns = np.column_stack([drawn["width"], drawn["length"], drawn["dust"][:, 0]])
    np.testing.assert_allclose(columns.mean(axis=0), [0, 1, 2], atol=5 * np.sqrt(2 / n))
    np.testing.assert_allclose(np.cov(columns.T), COVARIANCE, atol=5 * 3 / np.sqrt(n))
    one = plan({"force": stats.multivariate_normal([0, 5], 0.01)}).draw(0)["force"]
    np.testing.assert_allclose(one.mean(axis=0), [0, 5], atol=0.05)
    single = plan({"dust": stats.multivariate_normal([3.0])}).draw(0)["dust"]
    assert abs(single.mean() - 3.0) < 5 / 32


def test_a_function_may_tie_paths_together() -> None:
    drawn = plan(JOINT).draw_all()
    np.testing.assert_array_equal(drawn["force"][:, 1], -drawn["mass"])
    n = len(drawn["mass"])
    assert abs(np.corrcoef(drawn["force"][:, 0], drawn["mass"])[0, 1] - 0.5**0.5) < 5 / np.sqrt(n)
    as_mapping = plan({("mass", "width"): lambda r: {"width": 2.0, "mass": r.random()}}).draw(0)
    assert (as_mapping["width"] == 2.0).all() and (as_mapping["mass"] < 1.0).all()
    as_array = plan({("mass", "width"): lambda r: r.normal(size=2) * [1, 100]}).draw(0)
    assert as_array["width"].std() > 50 > as_array["mass"].std()


def test_vectors_and_arrays_over_several_paths_go_in_their_order() -> None:
    rows = np.arange(15.0).reshape(5, 3)
    drawn = plan({("force", "mass"): rows}, None).draw_all()
    np.testing.assert_array_equal(drawn["force"], rows[:, :2])
    np.testing.assert_array_equal(drawn["mass"], rows[:, 2])
    for sampler in SAMPLERS:
        vector = Uniform((0, 10, 20), (1, 11, 21))
        drawn = plan({("mass", "force"): vector}, 20, 0, sampler).draw_all()
        assert (drawn["mass"] < 1).all() and (np.floor(drawn["force"]) == [10, 20]).all()
        tied = Choice([[1, 10, 100], [2, 20, 200]])
        drawn = plan({("mass", "force"): tied}, 20, 0, sampler).draw_all()
        np.testing.assert_array_equal(drawn["force"], np.outer(drawn["mass"], [10, 100]))


def test_a_function_is_called_once_for_each_run_of_the_block() -> None:
    calls = []

    def count(rng: np.random.Generator) -> Any:
        calls.append(rng)
        return np.int64(len(calls)) if len(calls) % 2 else Fraction(len(calls))

    drawn = plan({"mass": count}, 10).draw(0)["mass"]
    np.testing.assert_array_equal(drawn, np.arange(1, BLOCK + 1))
    assert len({id(rng) for rng in calls}) == 1


@pytest.mark.parametrize("runs", [1, 10, 1023, 1024, 1025, 3000])
def test_of_all_runs_a_function_is_called_once_for_each(runs: int) -> None:
    calls = 0

    def count(rng: np.random.Generator) -> float:
        nonlocal calls
        calls += 1
        return rng.random()

    ours = plan({"mass": count}, runs)
    drawn = ours.draw_all()["mass"]
    assert calls == runs
    # Fewer calls, the same numbers.
    last = ours.draw(ours.blocks - 1)["mass"]
    np.testing.assert_array_equal(drawn[(ours.blocks - 1) * BLOCK :], last[: (runs - 1) % 1024 + 1])


@pytest.mark.parametrize("theirs", [stats.poisson(3.0), stats.randint(-2, 3), stats.bernoulli(0.2)])
@pytest.mark.parametrize("sampler", SAMPLERS)
def test_discrete_distributions_stay_on_their_values(theirs: Any, sampler: str) -> None:
    drawn = plan({"force": theirs}, 3000, 2, sampler).draw_all()["force"]
    low, high = theirs.support()
    assert (drawn == np.round(drawn)).all() and low <= drawn.min() and drawn.max() <= high
    for column in drawn.T:
        assert abs(column.mean() - theirs.mean()) < 5 * theirs.std() / np.sqrt(3000)


def test_arrays_are_copied_and_may_hold_what_is_not_finite() -> None:
    mass = np.array([1.0, np.inf, np.nan])
    ours = plan({"mass": mass, "force": [[1, 2], [3, 4], [5, 6]]}, None)
    mass[0] = 7.0
    assert ours.runs == 3 and not ours.extendable
    drawn = ours.draw_all()
    np.testing.assert_array_equal(drawn["mass"], [1.0, np.inf, np.nan])
    np.testing.assert_array_equal(drawn["force"], [[1, 2], [3, 4], [5, 6]])


def test_what_comes_after_the_end_of_an_array_or_hypercube_is_nan() -> None:
    for vary, sampler in (({"mass": np.ones(1030)}, "random"), (PLACED, "latin_hypercube")):
        ours = plan(vary, 1030, 0, sampler)
        for path, values in ours.draw(1).items():
            assert values.shape == (BLOCK, *SHAPES[path])
            assert np.isfinite(values[:6]).all() and np.isnan(values[6:]).all()
        with pytest.raises(ValueError, match=r"^block = 2: must be at most 1$"):
            ours.draw(2)


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_extendable_plans_have_blocks_after_the_last(sampler: str) -> None:
    ours = plan(PLACED, 10, 4, sampler)
    assert ours.extendable and ours.blocks == 1
    longer = plan(PLACED, 3 * BLOCK, 4, sampler).draw_all()
    assert_same(ours.draw(2), {path: values[2 * BLOCK :] for path, values in longer.items()})


# The points of the samplers

UNIT = {"width": Uniform(0, 1), "force": Uniform((0, 0), (1, 1)), "mass": Uniform(0, 1)}


def unit_points(runs: int, seed: int, sampler: str) -> np.ndarray:
    drawn = plan(UNIT, runs, seed, sampler).draw_all()
    # Dimensions go to the paths in the order of their names.
    return np.column_stack([drawn["force"], drawn["mass"], drawn["width"]])


def test_sobol_runs_are_scipys_points_one_by_one() -> None:
    theirs = qmc.Sobol(4, rng=np.random.default_rng(9)).random(4096)
    # The middles of the cells whose corners are SciPy's points.
    np.testing.assert_array_equal(unit_points(4096, 9, "sobol"), theirs + 2.0**-31)
    assert plan(UNIT, 5, sampler="sobol").dimensions == 4


def test_sobol_integrates_a_smooth_function_much_better_than_random() -> None:
    def error(seed: int, sampler: str) -> float:
        points = unit_points(4096, seed, sampler)
        # The integral of each factor is 1.
        return float(np.prod(1 + (np.exp(points) - np.e + 1) / 2, axis=1).mean() - 1)

    errors = {s: np.std([error(seed, s) for seed in range(10)]) for s in SAMPLERS}
    assert errors["sobol"] < errors["random"] / 30
    assert errors["latin_hypercube"] < errors["random"] / 2


@pytest.mark.parametrize("runs", [1, 7, 1000, 2500])
def test_a_latin_hypercube_has_one_point_in_each_stratum(runs: int) -> None:
    ours = plan(UNIT, runs, 1, "latin_hypercube")
    assert not ours.extendable and ours.dimensions == 4
    strata = np.floor(unit_points(runs, 1, "latin_hypercube") * runs)
    np.testing.assert_array_equal(np.sort(strata, axis=0), np.tile(np.arange(runs)[:, None], 4))


def test_points_take_no_dimension_for_arrays() -> None:
    for sampler in ("sobol", "latin_hypercube"):
        vary = {**UNIT, "length": np.arange(100.0)}
        drawn = plan(vary, None, 1, sampler).draw_all()
        assert plan(vary, None, 1, sampler).dimensions == 4
        np.testing.assert_array_equal(drawn["length"], np.arange(100.0))
        expected = plan(UNIT, 100, 1, sampler).draw_all()
        assert_same({path: drawn[path] for path in UNIT}, expected)
        only = plan({"length": np.arange(3.0)}, None, 1, sampler)
        np.testing.assert_array_equal(only.draw_all()["length"], [0, 1, 2])


def test_normals_from_many_points_are_finite() -> None:
    vary = {"mass": Normal(0, 1), "width": LogNormal(1, 1), "length": stats.norm()}
    vary["dust"] = TruncatedNormal(0, 1, 1, np.inf)
    for sampler in ("sobol", "latin_hypercube"):
        for values in plan(vary, 8 * BLOCK, 0, sampler).draw_all().values():
            assert np.isfinite(values).all() and abs(values).max() < 500


# Counting runs


def test_runs_are_given_or_counted() -> None:
    assert count_runs({}, 7) == 7
    assert count_runs({"mass": Normal(0, 1)}, np.int64(7)) == 7
    assert count_runs({"mass": [1, 2, 3], "force": np.ones((3, 2)), "width": gamma}) == 3
    assert count_runs({"mass": [1, 2, 3]}, 3) == 3


@pytest.mark.parametrize(
    ("vary", "runs", "error", "message"),
    [
        ({}, None, ValueError, r"^runs is missing: must be given where vary has no array$"),
        ({"mass": Normal(0, 1)}, None, ValueError, r"^runs is missing"),
        ({}, 0, ValueError, r"^runs = 0: must be at least 1$"),
        ({}, 2.5, TypeError, r"^runs = 2.5: must be an integer$"),
        ({}, True, TypeError, r"^runs = True: must be an integer$"),
        ({"mass": []}, None, ValueError, r'^vary\["mass"\] has no entries'),
        (
            {"mass": [1, 2]},
            3,
            ValueError,
            r'^vary\["mass"\] has 2 entries: must have one for each run, and runs is 3$',
        ),
        (
            {"mass": [1, 2], "width": [1, 2, 3]},
            None,
            ValueError,
            r'^vary\["width"\] has 3 entries: must have one for each run, and vary\["mass"\] has 2',
        ),
        ({"mass": 3.0}, 3, TypeError, r'^vary\["mass"\] = 3.0: must be an array with one entry'),
        ({"mass": "normal"}, 3, TypeError, r"must be an array .* a distribution or a function$"),
        ({"mass": {"kind": "normal"}}, 3, TypeError, r"must be an array .* a distribution or"),
        ({"mass": ["a", "b"]}, None, TypeError, r'^vary\["mass"\] = .*: must hold numbers$'),
        ({"mass": [1, [2]]}, None, ValueError, r'^vary\["mass"\] is ragged: '),
        ([1], 3, TypeError, r"^vary = \[1\]: must be a mapping from paths$"),
        ({3: [1]}, 1, TypeError, r"^vary: the key 3 must be a path or a tuple of paths$"),
        ({(): [1]}, 1, TypeError, r"^vary: the key \(\) must be"),
        ({("mass", 1): [1]}, 1, TypeError, r"^vary: the key \('mass', 1\) must be"),
        ({"mass": [1], ("width", "mass"): [1]}, 1, ValueError, r"the path 'mass' stands twice$"),
    ],
)
def test_runs_that_cannot_be_counted_are_refused(
    vary: Any, runs: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        count_runs(vary, runs)
    with pytest.raises(error, match=message):
        plan(vary, runs)


# What is refused


@pytest.mark.parametrize(
    ("vary", "options", "error", "message"),
    [
        ({}, {"seed": -1}, ValueError, r"^seed = -1: must be at least 0$"),
        ({}, {"seed": 1.0}, TypeError, r"^seed = 1.0: must be an integer$"),
        ({}, {"sampler": "sobel"}, ValueError, r'^sampler = .sobel.: .*did you mean "sobol"'),
        ({"speed": gamma}, {}, ValueError, r"the shape of 'speed' is not known$"),
        (
            {"force": np.ones((3, 3))},
            {"runs": 3},
            ValueError,
            r'^vary\["force"\] has shape \(3, 3\): must have shape \(3, 2\), one entry for each',
        ),
        ({"mass": np.ones((3, 1))}, {"runs": 3}, ValueError, r"must have shape \(3,\), one entry"),
        (
            {("mass", "width"): np.ones((3, 3))},
            {"runs": 3},
            ValueError,
            r"must have shape \(3, 2\), one entry for each run, the numbers of all the paths",
        ),
        (
            {"mass": Normal((0, 1), 1)},
            {},
            ValueError,
            r'^vary\["mass"\]: draws of Normal have shape \(2,\), must have shape \(\)$',
        ),
        (
            {("mass", "width"): Normal(0, 1)},
            {},
            ValueError,
            r'^vary\["mass", "width"\]: draws of Normal have shape \(\), must have shape \(2,\), '
            "the numbers of all the paths in a row$",
        ),
        ({("mass", "width"): stats.norm()}, {}, ValueError, r"draws of norm have shape \(\)"),
        ({"mass": stats.norm([0, 1])}, {}, ValueError, r"draws of norm have shape \(2,\)"),
        ({"mass": gamma}, {"sampler": "sobol"}, ValueError, r'function .* by sampler "sobol"'),
        (
            {"mass": gamma},
            {"sampler": "latin_hypercube"},
            ValueError,
            r'^vary\["mass"\]: a function of a generator cannot be placed .*latin_hypercube',
        ),
        (
            {"force": stats.multivariate_normal([0, 0])},
            {"sampler": "sobol"},
            ValueError,
            r'^vary\["force"\] = multivariate_normal: has no ppf, which sampler "sobol"',
        ),
        ({}, {"sampler": "sobol", "runs": 2**30 + 1}, ValueError, r"must be at most 2\*\*30 with"),
    ],
)
def test_bad_plans_are_refused(
    vary: Any, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        plan(vary, **options)


def after(count: int, value: Any) -> Callable[[np.random.Generator], Any]:
    """A function that gives a `value` of its own after `count` runs."""
    runs = iter(range(10**9))
    return lambda _: value if next(runs) >= count else 1.0


@pytest.mark.parametrize(
    ("vary", "error", "message"),
    [
        (
            {"mass": after(5, (1.0, 2.0))},
            ValueError,
            r'^vary\["mass"\], run 5: the function gave shape \(2,\), must give shape \(\)$',
        ),
        ({"mass": after(3, "x")}, TypeError, r'^vary\["mass"\], run 3 = .x.: must hold numbers$'),
        ({"mass": after(3, None)}, TypeError, r"run 3 = None: must hold numbers$"),
        ({"force": lambda _: [1.0, None]}, TypeError, r"run 0 = \[1.0, None\]: must hold numbers$"),
        ({"force": lambda _: [Fraction(1), "1"]}, TypeError, r"run 0 = .*: must hold numbers$"),
        ({"mass": after(3, True)}, TypeError, r"run 3 = True: must hold numbers$"),
        ({"force": lambda _: 1.0}, ValueError, r"run 0: .* gave shape \(\), must give shape \(2,"),
        (
            {("mass", "width"): lambda _: (1.0,)},
            ValueError,
            r'run 0: the function gave \(1.0,\); must give a value for each of "mass", "width"$',
        ),
        ({("mass", "width"): lambda _: 1.0}, ValueError, r"run 0: the function gave 1.0; must"),
        ({("mass", "width"): lambda _: "ab"}, ValueError, r"run 0: the function gave 'ab'; must"),
        (
            {("mass", "force"): lambda _: (1.0, 2.0)},
            ValueError,
            r"run 0, 'force': the function gave shape \(\), must give shape \(2,\)$",
        ),
        (
            {("mass", "width"): lambda _: {"mass": 1.0, "wdth": 1.0}},
            ValueError,
            r'values for "mass", "wdth"; must give one for each of "mass", "width"$',
        ),
        (
            {"force": stats.multivariate_normal([0, 0, 0])},
            ValueError,
            r'^vary\["force"\]: draws of multivariate_normal have shape \(3,\), must have '
            r"shape \(2,\)$",
        ),
    ],
)
def test_bad_draws_are_refused_by_path_and_run(
    vary: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        plan(vary).draw(0)


def test_the_run_of_a_function_counts_from_the_first_block() -> None:
    with pytest.raises(ValueError, match="run 1029: the function gave shape"):
        plan({"mass": after(5, (1.0, 2.0))}).draw(1)


def test_errors_of_functions_and_scipy_say_where() -> None:
    def fail(rng: np.random.Generator) -> float:
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine") as caught:
        plan({"mass": fail}).draw(0)
    assert caught.value.__notes__ == ['softpinch: while drawing vary["mass"], run 0']
    with pytest.raises(ValueError) as broken:
        plan({"mass": stats.norm(0, -1)}).draw(0)
    assert broken.value.__notes__ == ['softpinch: while drawing vary["mass"] from norm']


# Provenance


def test_a_plan_describes_where_its_numbers_come_from() -> None:
    vary = {
        "mass": Normal(0.1, 0.01),
        "width": stats.gamma(2.0, scale=np.array(3.0)),
        "length": gamma,
        ("force", "dust"): stats.multivariate_normal([0, 1, 2], COVARIANCE),
        "angles": np.ones((5, 3, 2)),
    }
    assert plan(vary, None, seed=12).describe() == {
        "sampler": "random",
        "seed": 12,
        "runs": 5,
        "block": 1024,
        "vary": {
            "mass": {"kind": "normal", "mean": 0.1, "std": 0.01},
            "width": {"kind": "scipy", "name": "gamma", "args": [2.0], "kwds": {"scale": 3.0}},
            "length": {"kind": "function", "function": f"{__name__}.gamma"},
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
