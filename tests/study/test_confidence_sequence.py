"""Intervals that may be looked at: of which values they consist, and how often they are wrong."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import softpinch as sp
from softpinch.study.estimates import Estimate

BLOCK = 1024


def log_mixture(count: int, n: int, p: Any, level: float) -> Any:
    """ln of the mixed likelihood over the one of p, from SciPy's distributions."""
    limit = np.log(1 / level)
    mass = BLOCK / (2 * limit + np.log(1 + 2 * limit))
    mixed = stats.betabinom.logpmf(count, n, mass * p, mass * (1 - p))
    return mixed - stats.binom.logpmf(count, n, p)


@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
@pytest.mark.parametrize("n", [1, 7, 100, 1024, 50_000])
def test_an_interval_has_the_probabilities_that_the_mixture_does_not_contradict(
    n: int, confidence: float
) -> None:
    odds = np.concatenate([np.linspace(-14, 14, 400), np.linspace(-2, 2, 400)])
    for count in {0, 1, 2, n // 100, n // 3, n - 1, n} - {-1}:
        if count > n:
            continue
        ours = Estimate.at_every_look(count, n, confidence)
        p = stats.logistic.cdf(odds)
        plausible = log_mixture(count, n, p, 1 - confidence) <= np.log(1 / (1 - confidence))
        inside = (ours.low <= p) & (p <= ours.high)
        near = (abs(p / ours.low - 1) < 1e-6) if ours.low else np.zeros(len(p), bool)
        np.testing.assert_array_equal(inside[~near], plausible[~near], err_msg=str((count, n)))
        assert (ours.value, ours.happened, ours.runs) == (count / n, count, n)


def ever_missed(of: Any, p: float, block: int, looks: int) -> float:
    """How likely any of the intervals misses p, looked at after each block: exactly."""
    alive, missed = np.ones(1), 0.0
    step = stats.binom.pmf(np.arange(block + 1), block, p)
    for look in range(1, looks + 1):
        n = block * look
        alive = np.convolve(alive, step)
        likely = np.flatnonzero(alive > 1e-15)
        covers = np.zeros(len(alive), bool)
        ends = [of(int(k), n) for k in likely]
        covers[likely] = [one.low <= p <= one.high for one in ends]
        missed += float(alive[~covers].sum())
        alive = np.where(covers, alive, 0.0)
    return missed


@pytest.mark.parametrize("p", [0.003, 0.1, 0.5, 0.97])
def test_looking_after_each_block_does_not_make_the_sequence_wrong(p: float) -> None:
    """Wilson's interval misses more often than it says, since it is of one look."""
    ours = ever_missed(Estimate.at_every_look, p, 32, 40)
    assert 0.0 < ours <= 0.05
    assert ever_missed(Estimate.counted, p, 32, 40) > 0.1


def test_runs_that_all_end_alike_are_told_in_words() -> None:
    none = str(Estimate.counted(0, 3000))
    assert none.endswith("it happens in at most 3 of 3000 runs (rule of three, one-sided)")
    # The chance of none in 3000, if it happened in 3 of 3000 on average, is 5 %, nearly.
    never = (1 - 3.0 / 3000) ** 3000
    assert never == pytest.approx(0.05, rel=0.01)
    every = str(Estimate.at_every_look(3000, 3000))
    assert every.endswith("it fails to happen in at most 3.47 of 3000 runs (at every look)")
    # From SciPy's distributions: the mixture of a probability 3.47 / 3000 of what never happened.
    assert log_mixture(0, 3000, 3.47 / 3000, 0.05) == pytest.approx(np.log(20), abs=0.01)
    assert "at most 4.61 of 200 runs" in str(Estimate.counted(0, 200, 0.99))
    assert "rule" not in str(Estimate.counted(1, 3000)) + str(Estimate.counted(0, 0))


def test_a_study_says_which_interval_its_probabilities_have() -> None:
    scene = replace(sp.Scene(duration=2e-3), disturbances=[sp.Impulse(time=0.0)])
    pushes: Any = {"disturbances.0.impulse.0": sp.Choice([0.0, 50.0], weights=[0.7, 0.3])}
    how: Any = {"vary": pushes, "seed": 4, "dt": 1e-3, "progress": False}
    fixed = sp.monte_carlo(scene, 2 * BLOCK, **how)
    stopped = sp.monte_carlo(scene, 9 * BLOCK, stop_when={"separated": 0.04}, **how)
    assert stopped.runs == 2 * BLOCK  # Wilson's interval is narrow enough after the first block
    for event in ("separated", "holds"):
        wide, narrow = stopped.probability(event), fixed.probability(event)
        assert (wide.interval, narrow.interval) == ("confidence sequence", "Wilson")
        assert wide.low < narrow.low < wide.value == narrow.value < narrow.high < wide.high
        assert wide[:3] == Estimate.at_every_look(wide.happened, 2 * BLOCK)[:3]
        assert wide.missing == 7 * BLOCK
    assert "95 % at every look: " in str(stopped.probability("separated", 0.95))
