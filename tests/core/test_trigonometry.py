"""The core's own sine and cosine against mpmath, to a unit in the last place, for every angle."""

import math

import mpmath
import numpy as np
import pytest

import softpinch as sp
from softpinch import _core

SCENE = sp.Scene()
START = SCENE.start()
PARAMETERS, INPUTS = SCENE.parameters(), SCENE.inputs()
SEED = 20070410
# Beyond this the reduction by multiples of pi/2 in three parts gives way to that of libm.
REDUCIBLE = 2.0**28


def sine_and_cosine(x: float) -> tuple[float, float]:
    """Those of the core, out of Phi's row of C_1^N, which begins (-sin theta, cos theta, ...)."""
    q = np.array(START.q)
    q[2] = x
    at_rest = np.zeros(2)
    terms = _core.evaluate(PARAMETERS, INPUTS, 0.0, q, START.p, at_rest, "csm", 1000.0, 1000.0)
    row = terms["constraint_matrix"][2]
    return -row[0], row[1]


def ulps(found: float, exact: mpmath.mpf) -> float:
    """The error in units in the last place of the double nearest to the exact number."""
    if exact == 0:
        return 0.0 if found == 0.0 else math.inf
    return float(abs(mpmath.mpf(found) - exact) / math.ulp(float(exact)))


def worst(angles: np.ndarray) -> float:
    """The largest error over angles (n,), of either function."""
    # A number near 1e300 has a thousand bits before its point.
    with mpmath.workprec(1300):
        found = 0.0
        for x in angles.tolist():
            sine, cosine = sine_and_cosine(x)
            exact = mpmath.mpf(x)
            found = max(found, ulps(sine, mpmath.sin(exact)), ulps(cosine, mpmath.cos(exact)))
        return found


def near(k: np.ndarray) -> np.ndarray:
    """Doubles nearest to k pi/2 and some of their neighbours, where one of the two is tiny."""
    with mpmath.workprec(200):
        middle = np.array([float(mpmath.mpf(int(n)) * mpmath.pi / 2) for n in k])
    steps = np.arange(-2, 3)[:, None]
    return (middle + steps * np.spacing(middle)).ravel()


def rng() -> np.random.Generator:
    return np.random.default_rng(SEED)


def signs(n: int) -> np.ndarray:
    return np.where(np.arange(n) % 2, 1.0, -1.0)


ANGLES = {
    "tiny": np.r_[0.0, -0.0, 5e-324, 2.3e-308, np.geomspace(1e-300, 1e-3, 300) * signs(300)],
    "a turn": np.linspace(-7.0, 7.0, 1200),
    "eighths of a turn": near(np.arange(-8, 9)) / 2.0,
    "near small multiples": near(np.arange(-60, 61)),
    "near large multiples": near(np.unique(np.geomspace(61, 2**27, 150).astype(np.int64))),
    "near the largest multiples": near(2**27 - np.arange(60)),
    "large": rng().uniform(-(2**27), 2**27, 800) * (np.pi / 2),
    "about where it is handed over": np.r_[
        REDUCIBLE - rng().uniform(0, 10, 100),
        REDUCIBLE + rng().uniform(0, 10, 100),
        np.nextafter(REDUCIBLE, 0.0),
        REDUCIBLE,
    ],
    "wild": np.geomspace(2.0**28, 1e300, 500) * signs(500),
    # The double that comes nearest to a multiple of pi/2 (Muller, "Elementary Functions").
    "the hardest": np.array([6381956970095103.0 * 2.0**797]),
}


@pytest.mark.parametrize("name", ANGLES)
def test_sine_and_cosine_are_within_a_unit_in_the_last_place(name: str) -> None:
    assert worst(ANGLES[name]) <= 1.0


def test_errors_are_in_units_in_the_last_place() -> None:
    third = mpmath.mpf(1) / 3
    assert ulps(1 / 3, third) <= 0.5
    assert 0.5 < ulps(math.nextafter(1 / 3, 1.0), third) <= 1.5
    assert ulps(-1 / 3, third) > 1e15
