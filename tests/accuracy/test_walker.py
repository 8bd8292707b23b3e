"""The walker beside an oscillator with a solution in closed form, by every method of SciPy."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import softpinch as sp
from alarms import alarm
from softpinch.accuracy.driven import Inputs
from softpinch.accuracy.walker import METHODS, System, Walker

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


def system(rates: Callable[..., Any] | None = None) -> System:
    """x'' = F_x - omega^2 x; an impulse adds to x'."""
    return System(
        rates or (lambda y, u: (y[1], u[2] - OMEGA**2 * y[0])),
        lambda y, impulse: y + np.array([0.0, impulse[0]]),
        lambda y, u: np.array([[0.0, 1.0], [-(OMEGA**2), 0.0]]),
    )


def walker(method: str, end: float = 1.0, **changes: Any) -> Walker:
    how: dict[str, Any] = {
        "system": system(),
        "inputs": Inputs(SCENE, 0.0, end),
        "start": START,
        "method": method,
        "rtol": ALLOWED[method][0],
        "sizes": np.array([0.3, 9.0]),
        "most": 5_000_000,
    }
    return Walker(**{**how, **changes})


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
def test_every_row_is_where_the_closed_form_has_it(method: str) -> None:
    wanted = np.union1d(np.linspace(0.0, 1.0, 33), [*RAMP, SINE, STEP, 0.3001, IMPULSE]).tolist()
    path = list(walker(method).walk(wanted))
    times = [t for t, _, _ in path]
    assert times == sorted(times) and set(wanted) <= set(times) and len(times) > len(wanted)
    # The first row of an instant is that before its impulse, here the only one.
    assert len(set(times)) == len(times)
    found, expected = np.array([y for _, y, _ in path]), np.array([exact(t) for t in times])
    size = np.abs(expected).max(axis=0)
    assert (np.abs(found - expected) / size).max() < ALLOWED[method][1]
    # Inputs are those after a break, but at the end those before.
    forces = {t: driven(t)[2] for t, _, driven in path}
    swing = 25.0 * np.sin(DRIVEN_OMEGA * (np.array([STEP, 1.0]) - SINE))
    assert forces[STEP] == pytest.approx(40.0 - 60.0 * 0.15 / 0.25 + swing[0], rel=1e-12)
    assert forces[1.0] == pytest.approx(40.0 - 60.0 + swing[1], rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_wanted_instants_cost_no_more_than_a_step_each(method: str) -> None:
    few, many = walker(method), walker(method)
    list(few.walk([]))
    instants = np.linspace(0.0, 1.0, 41).tolist()
    list(many.walk(instants))
    # Multistep methods take no step more. A step of DOP853 takes twelve evaluations and one more to
    # begin, and one in four is tried in vain.
    allowed = 0 if method in ("BDF", "LSODA") else 41 * 16
    assert many.evaluations <= few.evaluations + allowed


@pytest.mark.parametrize("error", [KeyboardInterrupt, TimeoutError])
@pytest.mark.parametrize("method", METHODS)
def test_ctrl_c_stops_it_soon(method: str, error: type[BaseException]) -> None:
    long = walker(method, end=1e5, most=10**7, rtol=2.3e-14)
    begin = time.monotonic()
    with alarm(error("signal"), 0.2), pytest.raises(error, match="signal"):
        list(long.walk([]))
    assert time.monotonic() - begin < 5.0
    assert long.evaluations > 0


@pytest.mark.parametrize("method", METHODS)
def test_a_motion_without_a_future_ends_with_the_time(method: str) -> None:
    runs_away = system(lambda y, u: (y[0] ** 2, 0.0))
    how: dict[str, Any] = {"system": runs_away, "rtol": 1e-6, "start": np.array([2.0, 0.0])}
    one = walker(method, inputs=Inputs(sp.Scene(), 0.0, 1.0), **how)
    # From 2 on it is infinite at 0.5.
    with pytest.raises(RuntimeError, match=r"reference: .* at t = 0\.(4999|5000)"):
        list(one.walk([]))
    assert one.evaluations < 100_000


@pytest.mark.parametrize("method", METHODS)
def test_rates_that_fail_from_the_start_are_an_error_and_not_a_hang(method: str) -> None:
    def rates(y: object, u: object) -> object:
        raise ValueError("math domain error")

    with pytest.raises(RuntimeError, match=r"reference: .* at t = 0\.0"):
        list(walker(method, system=system(rates)).walk([]))


@pytest.mark.parametrize("method", METHODS)
def test_work_is_limited(method: str) -> None:
    one = walker(method, most=50)
    with pytest.raises(RuntimeError, match=r"takes more than 50 evaluations at t = 0\.0.*, by "):
        list(one.walk([]))
    assert one.evaluations <= 50 + 2
