"""The points of samplers: Sobol's are SciPy's, a hypercube has one in each stratum."""

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from draws import assert_same, draw_all, draws
from softpinch.study.distributions import LogNormal, Normal, TruncatedNormal, Uniform
from softpinch.study.sources import BLOCK

UNIT = {"width": Uniform(0, 1), "force": Uniform((0, 0), (1, 1)), "mass": Uniform(0, 1)}


def unit_points(runs: int, seed: int, sampler: str) -> np.ndarray:
    drawn = draw_all(draws(UNIT, runs, seed, sampler))
    # Dimensions go to the paths in the order of their names.
    return np.column_stack([drawn["force"], drawn["mass"], drawn["width"]])


def test_sobol_runs_are_scipys_points_one_by_one() -> None:
    theirs = qmc.Sobol(4, rng=np.random.default_rng(9)).random(4096)
    # The middles of the cells whose corners are SciPy's points.
    np.testing.assert_array_equal(unit_points(4096, 9, "sobol"), theirs + 2.0**-31)
    assert draws(UNIT, 5, sampler="sobol").dimensions == 4


@pytest.mark.parametrize("runs", [1, 7, 1000, 2500])
def test_a_latin_hypercube_has_one_point_in_each_stratum(runs: int) -> None:
    ours = draws(UNIT, runs, 1, "latin_hypercube")
    assert ours.dimensions == 4
    strata = np.floor(unit_points(runs, 1, "latin_hypercube") * runs)
    np.testing.assert_array_equal(np.sort(strata, axis=0), np.tile(np.arange(runs)[:, None], 4))


def test_points_take_no_dimension_for_arrays() -> None:
    for sampler in ("sobol", "latin_hypercube"):
        vary = {**UNIT, "length": np.arange(100.0)}
        drawn = draw_all(draws(vary, None, 1, sampler))
        assert draws(vary, None, 1, sampler).dimensions == 4
        np.testing.assert_array_equal(drawn["length"], np.arange(100.0))
        expected = draw_all(draws(UNIT, 100, 1, sampler))
        assert_same({path: drawn[path] for path in UNIT}, expected)
        only = draws({"length": np.arange(3.0)}, None, 1, sampler)
        np.testing.assert_array_equal(draw_all(only)["length"], [0, 1, 2])


def test_normals_from_many_points_are_finite() -> None:
    vary = {"mass": Normal(0, 1), "width": LogNormal(1, 1), "length": stats.norm()}
    vary["dust"] = TruncatedNormal(0, 1, 1, np.inf)
    for sampler in ("sobol", "latin_hypercube"):
        for values in draw_all(draws(vary, 8 * BLOCK, 0, sampler)).values():
            assert np.isfinite(values).all() and abs(values).max() < 500
