"""Integration between breaks beside an oscillator in closed form, by every method of SciPy."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import softpinch as sp
from softpinch.accuracy.segments import METHODS, Inputs, Motion, System, integrate

Floats = NDArray[np.float64]
OMEGA, DRIVEN_OMEGA = 30.0, 2 * np.pi * 7.0
START = np.array([0.1, -2.0])
STEP, RAMP, SINE, IMPULSE = 0.3, (0.15, 0.4), 0.2, 0.5
SCENE = sp.Scene(
    disturbances=[
        sp.Step(time=STEP, force=(40.0, 0.0)),
        sp.Sampled(times=RAMP, force=[[0.0, 0.0], [-60.0, 0.0]], hold="linear"),
        sp.Sine(time=SINE, frequency_hz=7.0, force=(25.0, 0.0)),
        sp.Impulse(time=IMPULSE, impulse=(3.0, 0.0)),
        sp.Impulse(time=IMPULSE, impulse=(1.0, 0.0)),
    ]
)
# rtol, and the error allowed, of each state's size.
ALLOWED = {
    # Its dense output would be off by 1.2e-12.
    "DOP853": (1e-12, 8e-13),
    "Radau": (1e-10, 1e-7),
    "LSODA": (1e-12, 1e-9),
    "BDF": (1e-8, 1e-3),
    "RK45": (1e-11, 1e-8),
    "RK23": (1e-7, 1e-3),
}


def system() -> System:
    """x'' = F_x - omega^2 x; an impulse adds to x'."""
    return System(
        lambda y, u: (y[1], u[2] - OMEGA**2 * y[0]),
        lambda y, impulse: y + np.array([0.0, impulse[0]]),
        lambda y, u: np.array([[0.0, 1.0], [-(OMEGA**2), 0.0]]),
    )


def computed(method: str, wanted: Any = (), **changes: Any) -> Motion:
    how: dict[str, Any] = {
        "system": system(),
        "inputs": Inputs(SCENE, 0.0, 1.0),
        "start": START,
        "rtol": ALLOWED[method][0],
        "sizes": np.array([0.3, 9.0]),
        "most": 5_000_000,
    }
    return integrate(wanted=wanted, method=method, **{**how, **changes})


def exact(t: float) -> Floats:
    """x and x', the impulses not yet counted at their own instant."""

    def after(start: float) -> float:
        return max(t - start, 0.0)

    def ramp(start: float) -> Floats:
        tau = after(start)
        return np.array([tau - np.sin(OMEGA * tau) / OMEGA, 1 - np.cos(OMEGA * tau)]) / OMEGA**2

    def step(start: float) -> Floats:
        tau = OMEGA * after(start)
        return np.array([1 - np.cos(tau), OMEGA * np.sin(tau)]) / OMEGA**2

    def struck(start: float) -> Floats:
        tau = after(start)
        return np.array([np.sin(OMEGA * tau) / OMEGA, np.cos(OMEGA * tau) * (tau > 0)])

    def swing(start: float) -> Floats:
        slow, fast = OMEGA * after(start), DRIVEN_OMEGA * after(start)
        both = [np.sin(fast) - DRIVEN_OMEGA / OMEGA * np.sin(slow), np.cos(fast) - np.cos(slow)]
        return np.array([1.0, DRIVEN_OMEGA]) * both / (OMEGA**2 - DRIVEN_OMEGA**2)

    cosine, sine = np.cos(OMEGA * t), np.sin(OMEGA * t)
    free = np.array([[cosine, sine / OMEGA], [-OMEGA * sine, cosine]]) @ START
    slope = -60.0 / (RAMP[1] - RAMP[0])
    forced = 40.0 * step(STEP) + slope * (ramp(RAMP[0]) - ramp(RAMP[1])) + 25.0 * swing(SINE)
    return np.asarray(free + forced + 4.0 * struck(IMPULSE))


@pytest.mark.parametrize("method", METHODS)
def test_every_row_is_on_the_closed_form(method: str) -> None:
    wanted = np.union1d(np.linspace(0.0, 1.0, 33), [*RAMP, SINE, STEP, 0.3001, IMPULSE])
    found = computed(method, wanted)
    assert (np.diff(found.t) > 0.0).all()
    assert np.isin(wanted, found.t).all() and len(found.t) > len(wanted)
    expected = np.array([exact(t) for t in found.t])
    size = np.abs(expected).max(axis=0)
    assert (np.abs(found.y - expected) / size).max() < ALLOWED[method][1]
    # Inputs are those after a break, but at the end those before it.
    at_step, at_end = (found.u[found.t == t][0, 2] for t in (STEP, 1.0))
    swing = 25.0 * np.sin(DRIVEN_OMEGA * (np.array([STEP, 1.0]) - SINE))
    assert at_step == pytest.approx(40.0 - 60.0 * 0.15 / 0.25 + swing[0], rel=1e-12)
    assert at_end == pytest.approx(40.0 - 60.0 + swing[1], rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_wanted_instants_leave_the_other_rows_as_they_are(method: str) -> None:
    few, many = computed(method), computed(method, np.linspace(0.0, 1.0, 41))
    np.testing.assert_array_equal(many.y[np.isin(many.t, few.t)], few.y)
