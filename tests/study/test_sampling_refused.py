"""Draws that are refused, before any run or by path and run; and runs that cannot be counted."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

import softpinch as sp
from draws import draws, gamma
from softpinch.study.distributions import Normal
from softpinch.support.errors import SuspiciousValueWarning


def counted(vary: Any, runs: int | None = None) -> int:
    return draws(vary, runs).runs


def test_runs_are_given_or_counted() -> None:
    assert counted({}, 7) == 7
    assert counted({"mass": Normal(0, 1)}, np.int64(7)) == 7
    assert counted({"mass": [1, 2, 3], "force": np.ones((3, 2)), "width": gamma}) == 3
    assert counted({"mass": [1, 2, 3]}, 3) == 3


def test_a_tuple_that_looks_like_bounds_is_suspicious() -> None:
    meant = r'^vary\["mass"\] = \(0\.3, 0\.6\) makes two runs; a pair is no .*Uniform\(0\.3, 0\.6\)'
    with pytest.warns(SuspiciousValueWarning, match=meant) as caught:
        assert counted({"mass": (0.3, 0.6)}) == 2
    assert len(caught) == 1
    scene, vary = sp.Scene(duration=0.002), {"grasped.mass": (0.3, 0.6)}
    with pytest.warns(SuspiciousValueWarning, match="makes two runs") as caught:
        assert sp.monte_carlo(scene, vary=vary, dt=1e-3, progress=False).runs == 2
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for said in ([0.3, 0.6], np.array([0.3, 0.6]), (0.6, 0.3), (0.3, 0.4, 0.5)):
            assert counted({"mass": said}) == len(said)
        assert counted({"mass": (0.3, 0.6)}, 2) == 2
        assert counted({"force": ((1.0, 2.0), (3.0, 4.0))}) == 2


@pytest.mark.parametrize(
    ("vary", "runs", "error", "message"),
    [
        ({}, None, ValueError, r"^runs is missing: must be given where vary has no array$"),
        ({"mass": []}, None, ValueError, r'^vary\["mass"\] has no entries'),
        (
            {"mass": [1, 2]},
            3,
            ValueError,
            r'^vary\["mass"\] has 2 entries: must have one for each run, and runs is 3; a',
        ),
        # Bounds of a fit.
        (
            {"mass": (0.3, 0.6)},
            100,
            ValueError,
            r"runs is 100; a pair is no distribution: sp\.Uniform\(0\.3, 0\.6\) draws between",
        ),
        ({"force": ((0.3, 0.6), (1, 2))}, 100, ValueError, r"and runs is 100$"),
        (
            {"mass": [1, 2], "width": [1, 2, 3]},
            None,
            ValueError,
            r'^vary\["width"\] has 3 entries: must have one for each run, and vary\["mass"\] has 2',
        ),
        ({"mass": 3.0}, 3, TypeError, r'^vary\["mass"\] = 3.0: must be an array with one entry'),
        ({"mass": "normal"}, 3, TypeError, r"must be an array .* a distribution or a function$"),
        ([1], 3, TypeError, r"^vary = \[1\]: must be a mapping from paths"),
        ({3: [1]}, 1, TypeError, r"^vary: the key 3 must be a path or a tuple of paths$"),
        ({"mass": [1], ("width", "mass"): [1]}, 1, ValueError, r"the path 'mass' is given twice$"),
    ],
)
def test_runs_that_cannot_be_counted_are_refused(
    vary: Any, runs: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        draws(vary, runs)


@pytest.mark.parametrize(
    ("vary", "options", "error", "message"),
    [
        (
            {"force": np.ones((3, 3))},
            {"runs": 3},
            ValueError,
            r'^vary\["force"\] has shape \(3, 3\): must have shape \(3, 2\), one entry for each',
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
        (
            {"mass": gamma},
            {"sampler": "latin_hypercube"},
            ValueError,
            r'^vary\["mass"\]: a function that draws .* not "latin_hypercube',
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
def test_bad_draws_are_refused(
    vary: Any, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        draws(vary, **options)


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
        (
            {("mass", "width"): lambda _: (1.0,)},
            ValueError,
            r'run 0: the function gave \(1.0,\); must give a value for each of "mass", "width"$',
        ),
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
    ],
)
def test_bad_draws_are_refused_by_path_and_run(
    vary: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        draws(vary).draw(0)


def test_the_run_of_a_function_counts_from_the_first_block() -> None:
    with pytest.raises(ValueError, match="run 1029: the function gave shape"):
        draws({"mass": after(5, (1.0, 2.0))}).draw(1)


def test_errors_of_functions_and_scipy_say_where() -> None:
    def fail(rng: np.random.Generator) -> float:
        raise ZeroDivisionError("mine")

    with pytest.raises(ZeroDivisionError, match="mine") as caught:
        draws({"mass": fail}).draw(0)
    assert caught.value.__notes__ == ['softpinch: while drawing vary["mass"], run 0']
    with pytest.raises(ValueError) as broken:
        draws({"mass": stats.norm(0, -1)}).draw(0)
    assert broken.value.__notes__ == ['softpinch: while drawing vary["mass"] from norm']
