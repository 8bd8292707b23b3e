"""Calls that are refused; those of `monte_carlo` before anything is computed."""

from collections.abc import Callable

import numpy as np
import pytest

import softpinch as sp

SCENE = sp.Scene(
    schedule=sp.Schedule.steps([0.0, 0.5], [[0.1, 0.1], [0.12, 0.1]]),
    disturbances=[
        sp.Step(time=0.0, force=(1.0, 0.0)),
        sp.Pulse(time=0.001, duration=0.001, force=(1.0, 0.0)),
        sp.Noise(force_std=1.0, moment_std=0.0, rate_hz=100.0),
        sp.Sine(frequency_hz=50.0, time=1.0, duration=1.0),
        sp.Sampled(times=[0.0, 0.1, 0.2], force=np.ones((3, 2)), hold="linear"),
    ],
    duration=2e-3,
)


def told(done: int, runs: int) -> None:
    raise AssertionError(f"computing has begun: {done} of {runs}")


def refused(
    error: type[Exception], message: str, *, scene: sp.Scene = SCENE, **how: object
) -> None:
    """The call fails with this message, and has computed nothing."""
    with pytest.raises(error, match=message):
        sp.monte_carlo(scene, **{"dt": 1e-3, "progress": told, **how})


def check_refusal(call: Callable[[], object], error: type[Exception], message: str) -> None:
    """The call fails with one line that has this text."""
    with pytest.raises(error) as caught:
        call()
    assert message in str(caught.value) and "\n" not in str(caught.value)
