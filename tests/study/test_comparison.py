"""Comparing designs by pairs of runs: the interval, its coverage, and what is refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import optimize, special, stats

import softpinch as sp
from softpinch.study.comparison import _greatest_difference

SCENE = replace(sp.Scene(duration=2e-3), disturbances=[sp.Impulse(time=0.0)])
VARY: dict[Any, Any] = {
    "disturbances.0.impulse.0": sp.Uniform(0.0, 5.0),
    "grasped.mass": sp.Normal(0.1, 0.01),
}


def study(runs: int = 400, **how: Any) -> sp.Ensemble:
    scene = SCENE.with_({"hand.tip.youngs_modulus": how.pop("modulus", 3e5)})
    given = {"vary": VARY, "seed": 1, "dt": 1e-3, "progress": False, **how}
    return sp.monte_carlo(scene, runs, **given)


def score(delta: float, only_a: int, only_b: int, n: int) -> float:
    """Tango's statistic, with the likelihood's maximum found by SciPy."""

    def negative(q: float) -> float:
        cells = [q + delta, q, 1 - 2 * q - delta]
        return -float(special.xlogy([only_a, only_b, n - only_a - only_b], cells).sum())

    low, high = max(0.0, -delta), 0.5 * (1 - delta)
    bounds = {"bounds": (low, high), "method": "bounded", "options": {"xatol": 1e-12}}
    q = optimize.minimize_scalar(negative, **bounds).x
    return float((only_a - only_b - n * delta) / np.sqrt(n * (2 * q + delta - delta**2)))


@pytest.mark.parametrize(("only_a", "only_b", "n"), [(20, 5, 100), (3, 9, 40), (1, 1, 30)])
def test_the_ends_are_where_the_score_test_rejects(only_a: int, only_b: int, n: int) -> None:
    z = stats.norm.ppf(0.975)
    high = _greatest_difference(only_a, only_b, n, 0.95)
    low = -_greatest_difference(only_b, only_a, n, 0.95)
    assert score(high, only_a, only_b, n) == pytest.approx(-z, abs=1e-4)
    assert score(low, only_a, only_b, n) == pytest.approx(z, abs=1e-4)


def test_without_any_difference_the_interval_has_its_closed_form() -> None:
    square = stats.norm.ppf(0.975) ** 2
    assert _greatest_difference(0, 0, 50, 0.95) == pytest.approx(square / (50 + square))


@pytest.mark.parametrize("probabilities", [(0.1, 0.03), (0.02, 0.02), (0.3, 0.2)])
@pytest.mark.parametrize("n", [50, 400])
def test_intervals_contain_the_difference_as_often_as_they_say(
    probabilities: tuple[float, float], n: int
) -> None:
    a, b = probabilities
    drawn = np.random.default_rng(3).multinomial(n, [a, b, 1 - a - b], 2000)
    tables, times = np.unique(drawn, axis=0, return_counts=True)
    covered = 0
    for (only_a, only_b, _), count in zip(tables.tolist(), times.tolist(), strict=True):
        low = -_greatest_difference(only_b, only_a, n, 0.95)
        covered += count * (low <= a - b <= _greatest_difference(only_a, only_b, n, 0.95))
    # 2000 draws scatter by half a per cent.
    assert 0.935 < covered / 2000 < 0.985


def test_a_comparison_counts_pairs_and_says_which_design_is_better() -> None:
    a, b = study(), study(300, modulus=1e5)
    for event in ("holds", "completed", "pulling"):
        found = sp.compare(a, b, event)
        first, second = a.happened(event)[:300], b.happened(event)
        assert (found.pairs, found.event) == (300, event)
        assert found.only_a == (first & ~second).sum()
        assert found.only_b == (second & ~first).sum()
        assert found.difference == pytest.approx(first.mean() - second.mean())
        assert found.low < found.difference < found.high
        back = sp.compare(b, a, event)
        assert (back.low, back.high) == pytest.approx((-found.high, -found.low))
        likelier = "a" if found.low > 0 else "b" if found.high < 0 else None
        assert found.likelier == likelier
        swapped = {"a": "b", "b": "a", None: None}
        assert found.better == (swapped[likelier] if event == "pulling" else likelier)
    same = sp.compare(a, a)
    assert same.better is None and same.difference == 0.0
    assert "neither design is better" in repr(same)


def test_studies_that_are_no_pairs_are_refused() -> None:
    a = study(20)
    for other, said in (
        (study(20, seed=2), "seed: must be the same, for the runs to be pairs; study_a has 1"),
        (study(20, sampler="sobol"), "sampler: must be the same"),
        (study(20, vary={"grasped.mass": sp.Normal(0.1, 0.01)}), "paths in vary: must be the same"),
        (study(20, stop_when={"holds": 0.1}), "study_b was computed with stop_when"),
        (study(40, only=[30, 31]), "must have runs in common"),
    ):
        with pytest.raises(ValueError, match=said):
            sp.compare(a, other)
    with pytest.raises(ValueError, match="event = 'hold': must be one of"):
        sp.compare(a, a, "hold")
    with pytest.raises(TypeError, match="study_b"):
        sp.compare(a, a.run)  # type: ignore[arg-type]
