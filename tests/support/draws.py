"""Draws: one of every kind of source, on every sort of field."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy import stats

from softpinch.study.distributions import Choice, LogUniform, Normal, Uniform
from softpinch.study.sampling import Draws

SHAPES: dict[str, tuple[int, ...]] = {
    "mass": (),
    "width": (),
    "length": (),
    "force": (2,),
    "angles": (3, 2),
    "dust": (1,),
}


def draws(
    vary: Mapping[Any, Any], runs: int | None = 3000, seed: int = 0, sampler: str = "random"
) -> Draws:
    return Draws(vary, runs, seed, sampler, shapes=lambda paths: {p: SHAPES[p] for p in paths})


def draw_all(made: Draws) -> dict[str, Any]:
    return made.rows(np.arange(made.runs, dtype=np.uint64))


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
