"""A scene without losses: what each method does to its energy over a long time."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp

KP = 100.0


def spring_held() -> sp.Scene:
    """Tips without viscosity, fingers on springs (K_P alone), settled, with a small kick."""
    hand = sp.Hand(tip=sp.Fingertip(normal_viscosity=0.0, tangential_viscosity=0.0))
    damped = sp.Scene(control=sp.Pid(kp=KP, kd=2.0, ki=0.0), duration=2.0)
    settled = sp.simulate(damped, tolerance=1e-10, method="radau5", formulation="nullspace")
    q, p = settled.q[-1], settled.p[-1]
    # The kick is a motion along the constraints: an impulse's, which keeps them.
    kick = sp.Impulse(time=0.0, impulse=(4e-3, -2e-3), angular_impulse=2e-5)
    return sp.Scene(
        hand=hand,
        control=sp.Pid(kp=KP, kd=0.0, ki=0.0),
        initial=sp.State(q, p),
        disturbances=[kick],
        duration=1.0,
    )


def energy(scene: sp.Scene, run: sp.Run) -> np.ndarray:
    """The ledger's energies and that of the fingers' springs, from the kick on, J."""
    target = np.asarray(scene.schedule.angles)[0]
    springs = KP / 2 * ((run.q[:, 3:5] - target) ** 2).sum(axis=1)
    return (run.energy.total + springs)[1:]


def excess(method: str, steps: int, dt: float) -> tuple[np.ndarray, float]:
    """The energy's error along the run, as a share of the motion's own energy, and that, J."""
    scene = replace(spring_held(), duration=steps * dt)
    run = sp.simulate(
        scene,
        dt=dt,
        method=method,
        formulation="nullspace",
        record=("state", "energy"),
        every=max(1, steps // 20_000),
    )
    assert run.success, run.message
    values = energy(scene, run)
    moving = float(run.energy.kinetic.max())
    return (values - values[0]) / moving, moving


def bound(error: np.ndarray, windows: int = 10) -> np.ndarray:
    """The largest size of the error in each of equal windows."""
    return np.array([np.abs(part).max() for part in np.array_split(error, windows)])


def check_no_drift(steps: int) -> None:
    dt = 2e-4
    midpoint, moving = excess("implicit_midpoint", steps, dt)
    assert moving > 1e-5
    windows = bound(midpoint)
    # Bounded, and no larger at the end than at the start; the mean of a window does not move.
    assert windows.max() < 1e-5
    assert windows[-1] < 1.1 * windows[0]
    means = np.array([part.mean() for part in np.array_split(midpoint, 10)])
    slope = np.polyfit(np.arange(10), means, 1)[0] * 9
    assert abs(slope) < 0.05 * windows.max()
    # RK4 loses energy steadily.
    rk4, _ = excess("rk4", steps, dt)
    lost = [part.mean() for part in np.array_split(rk4, 10)]
    assert np.all(np.diff(lost) < 0)


def test_the_midpoint_rule_keeps_energy_and_rk4_loses_it() -> None:
    check_no_drift(50_000)


@pytest.mark.slow
def test_over_a_million_steps() -> None:
    check_no_drift(1_000_000)


@pytest.mark.parametrize("method", ["radau5", "rosenbrock", "dop853"])
def test_what_the_others_lose_falls_with_their_order(method: str) -> None:
    order = {"radau5": 5, "rosenbrock": 4, "dop853": 8}[method]
    dt = {"radau5": 4e-4, "rosenbrock": 2e-4, "dop853": 3.2e-3}[method]
    coarse, fine = (abs(excess(method, round(0.4 / step), step)[0][-1]) for step in (dt, dt / 2))
    assert coarse > 1e-12
    assert coarse / fine > 2 ** (order - 0.5)
