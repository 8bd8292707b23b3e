"""Sampled loops in which free fingers swing ever wider: Routh's rule, a simulation, the warning."""

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import softpinch as sp
from softpinch.scene import usual
from softpinch.scene.loop_matrix import growth

INERTIA = sp.Finger().inertia
LOOSE = {"kp": 1.0, "kd": 0.05}  # beside the default ki of 1000


def controlled(duration: float = 1.0, **gains: float) -> sp.Scene:
    return sp.Scene(control=sp.SampledController.pid(1e-3, **gains), duration=duration)


def factor(scene: sp.Scene) -> float:
    assert isinstance(scene.control, sp.SampledController)
    return growth(scene, scene.control)


@given(st.floats(0.1, 100.0), st.floats(0.01, 1.0), st.floats(-2.0, 2.0))
def test_of_a_short_period_it_is_the_rule_of_routh(kp: float, kd: float, decades: float) -> None:
    """I s^3 + K_D s^2 + K_P s + K_I has its roots on the left for K_P K_D > I K_I."""
    assume(abs(decades) > 0.05)
    ki = kp * kd / INERTIA * 10.0**decades
    fastest = max(kd / INERTIA, math.sqrt(kp / INERTIA), (ki / INERTIA) ** (1 / 3))
    law = sp.SampledController.pid(1e-3 / fastest, kp, kd, ki)
    assert (growth(sp.Scene(), law) > 1.0) == (decades > 0.0)


# Fingers that are apart from the object, without weight.
APART = sp.Scene(
    hand=sp.Hand(right=sp.Finger(root_offset=0.2), left=sp.Finger(root_offset=0.2)),
    schedule=sp.Schedule.steps([0.0], np.deg2rad([[1.0, 2.0]])),
    contact="unilateral",
    friction=0.5,
    gravity=0.0,
)


@pytest.mark.parametrize(
    ("gains", "duration"),
    [
        (LOOSE, 0.15),
        ({**LOOSE, "delay": 2.4e-3}, 0.1),
        ({"delay": 1e-3}, 0.1),
        ({"delay": 1.7e-3}, 0.1),
        ({"kp": 4.0, "kd": 0.05, "ki": 20.0, "delay": 1.4e-3}, 0.3),
    ],
)
def test_a_simulation_swings_by_this_factor(gains: Any, duration: float) -> None:
    scene = replace(APART, control=controlled(**gains).control, duration=duration)
    run = sp.simulate(scene, dt=1e-4)
    assert run.status == "completed"
    expected = factor(scene)
    # A linear loop of m states: each sample of the angle is a combination of the m before it.
    swing = run.q[np.isclose(run.t / 1e-3, np.round(run.t / 1e-3), rtol=0.0, atol=1e-6), 3]
    swing -= math.radians(1.0)
    m = 4 + math.floor(scene.control.delay / 1e-3)
    rows = np.array([swing[k : k + m] for k in range(len(swing) - m)])
    found = np.linalg.lstsq(rows, swing[m:], rcond=None)[0]
    largest = np.abs(np.roots([1.0, *-found[::-1]])).max()
    assert math.log(largest) == pytest.approx(math.log(expected), rel=0.01)


def test_a_loop_that_grows_is_a_warning() -> None:
    for gains in (LOOSE, {"delay": 1e-3}, {"kp": 4.0, "kd": 0.05, "ki": 1000.0}):
        with pytest.warns(
            sp.SuspiciousValueWarning, match=r"^control: .* swings ever wider, by a factor of 2\.7"
        ):
            usual.warn(controlled(**gains))
    (text,) = usual.suspicions(controlled(**LOOSE))
    time = float(text.partition("2.7 in each ")[2].split()[0])
    assert time == pytest.approx(1e-3 / math.log(factor(controlled(**LOOSE))), rel=1e-2)


def test_other_loops_are_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        usual.warn(controlled())
        usual.warn(controlled(kp=4.0, kd=0.05, ki=20.0, delay=1.4e-3))
        usual.warn(controlled(kp=20.0, kd=0.2, ki=100.0, delay=2e-3))
        usual.warn(controlled(**LOOSE, duration=0.01))  # it has no time to grow
        torques = sp.Schedule.steps([0.0], [[1.2, 1.2]])
        usual.warn(sp.Scene(control=sp.Torque(), schedule=torques))
