"""The energy ledger: what goes in, comes out or stays, each work by a quadrature of its own."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

import softpinch as sp
from softpinch import _core, strategies

LEDGER = ("state", "multipliers", "energy")
WORKS = ("controller_work", "external_work", "viscous_loss")


def closure_of(run: sp.Run) -> float:
    energy = run.energy
    entries = [getattr(energy, name) for name in (*WORKS, "kinetic", "elastic")]
    # Where a run ends at its first step nothing but the height is there, and its round-off.
    height = 1e-5 * np.abs(energy.gravity).max()
    return float(np.abs(energy.closure).max() / max(np.abs(entries).max(), height))


def with_halved_steps(scene: sp.Scene, formulation: str, dt: float = 4e-5) -> list[sp.Run]:
    """Two runs, the second with steps half as long; dt may have to be shorter than asked for."""
    # Short steps, so that halving dt halves the steps between close breakpoints too.
    how: dict[str, Any] = {"formulation": formulation, "record": ("energy",)}
    runs = [sp.simulate(scene, dt=each, **how) for each in (dt, 0.5 * dt)]
    # A run that is over before its breakpoints are further apart than dt has the same steps twice.
    same = len(runs[0].t) > 1 and np.array_equal(runs[0].t, runs[1].t)
    return with_halved_steps(scene, formulation, 0.5 * dt) if same else runs


@given(strategies.scenes(duration=0.04), st.sampled_from(_core.FORMULATIONS))
def test_the_ledger_closes_on_any_scene(scene: sp.Scene, formulation: str) -> None:
    runs = with_halved_steps(scene, formulation)
    # A tip that leaves the object for a moment may be seen by one of them alone.
    assume(runs[0].status == runs[1].status)
    coarse, fine = map(closure_of, runs)
    # Order four means a sixteenth; a quarter leaves room for scenes that the coarse step hardly
    # resolves.
    assert fine <= max(0.25 * coarse, 1e-10), (coarse, fine)


def test_each_work_is_the_integral_of_its_own_power() -> None:
    """Powers recomputed in NumPy from the recorded states, integrated by Simpson's rule."""
    push = sp.Step(time=0.0, force=(5.0, 2.0), moment=0.02)
    held = sp.Schedule.steps([0.0], np.deg2rad([[6, 4]]))
    scene = sp.Scene(schedule=held, disturbances=[push], duration=0.05)
    run = sp.simulate(scene, dt=5e-5, record=LEDGER)
    pid, tip = scene.control, scene.hand.tip
    assert isinstance(pid, sp.Pid)
    assert isinstance(tip, sp.Fingertip)
    q, p = run.q, run.p
    error = q[:, 3:5] - np.deg2rad([6, 4])
    memory = cumulative_simpson(error, x=run.t, axis=0, initial=0.0)
    torque = -pid.kp * error - pid.kd * p[:, 3:5] - pid.ki * memory
    powers = {
        "controller_work": (torque * p[:, 3:5]).sum(axis=1),
        "external_work": p[:, :3] @ [5.0, 2.0, 0.02],
        "viscous_loss": tip.normal_viscosity * (p[:, 5:7] ** 2).sum(axis=1)
        + tip.tangential_viscosity * (p[:, 7:9] ** 2).sum(axis=1),
    }
    for name, power in powers.items():
        expected = cumulative_simpson(power, x=run.t, initial=0.0)
        ours = getattr(run.energy, name)
        assert np.abs(ours - expected).max() <= 1e-6 * np.abs(expected).max(), name


# A scene without losses: what each method does to its energy over a long time.


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


@pytest.mark.parametrize("steps", [50_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_the_midpoint_rule_keeps_energy_and_rk4_loses_it(steps: int) -> None:
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
