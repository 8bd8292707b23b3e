"""`rare_event` beside the probabilities of scenes that plain runs gave (`make rare-truth`)."""

import math
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from rare_scenes import SCENES, known

pytest.importorskip("scipy")

KNOWN = known()


def found(name: str, runs: int, seed: int, method: Any = "auto") -> sp.RareEvent:
    one = SCENES[name]
    return sp.rare_event(
        one.scene, one.vary, one.event, runs, seed, method, dt=one.dt, progress=False
    )


def right(name: str, one: sp.RareEvent) -> bool:
    """Whether the interval meets that of plain runs, or a warning stands beside it."""
    truth = KNOWN[name]
    low, high = one.interval
    return bool(low <= truth.high and truth.low <= high) or bool(one.warnings)


@pytest.mark.parametrize("name", SCENES)
def test_plain_runs_agree_or_a_warning_stands_beside(name: str) -> None:
    one = found(name, 5000, 1)
    assert right(name, one), f"{one}, and plain runs give {KNOWN[name]}"
    if name == "never":
        assert one.probability == 0.0 and KNOWN[name].happened == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"),
    [
        *(("bilateral", "subset"), ("bilateral", "importance")),
        *(("two ways", "subset"), ("two ways", "importance")),
        *(("noise", "subset"), ("noise", "splitting")),
    ],
)
def test_intervals_of_scenes_cover(name: str, method: Any) -> None:
    seeds = 200
    share = np.mean([right(name, found(name, 5000, seed, method)) for seed in range(seeds)])
    print(f"{name}, {method}: {100 * share:.1f} % of {seeds} seeds")
    assert share > 0.95 - 3.0 * math.sqrt(0.95 * 0.05 / seeds)
