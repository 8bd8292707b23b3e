"""The energy ledger: what goes in, comes out or stays, each work by a quadrature of its own."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from numpy.typing import NDArray
from scipy.integrate import cumulative_simpson

import softpinch as sp
from softpinch import paper, strategies

LEDGER = ("state", "multipliers", "energy")
WORKS = ("controller_work", "external_work", "viscous_loss")


def closure(scene: sp.Scene, dt: float) -> float:
    """The largest gap of the ledger along a run, as a share of the largest entry."""
    return closure_of(sp.simulate(scene, dt=dt, record=("energy",)))


def closure_of(run: sp.Run) -> float:
    energy = run.energy
    entries = [getattr(energy, name) for name in (*WORKS, "kinetic", "elastic")]
    # Where a run ends at its first step nothing but the height is there, and its round-off.
    height = 1e-5 * np.abs(energy.gravity).max()
    return float(np.abs(energy.closure).max() / max(np.abs(entries).max(), height))


def kicked(**changes: object) -> sp.Scene:
    """A firm grasp, pushed by every kind of disturbance, switches and edges off any grid."""
    return replace(
        sp.Scene(
            schedule=sp.Schedule.steps([0.0, 0.0371], np.deg2rad([[6, 6], [8, 4]])),
            disturbances=[
                sp.Step(time=0.0113, force=(5.0, 2.0), moment=0.02),
                sp.Pulse(time=0.02007, duration=0.00511, force=(-9.0, 4.0)),
                sp.Impulse(time=0.0303, impulse=(0.01, -0.01), angular_impulse=1e-4),
                sp.Sine(frequency_hz=70.0, force=(2.0, -1.0), moment=0.01, time=0.0011),
            ],
            duration=0.06,
        ),
        **changes,
    )


def test_the_ledger_closes_at_the_order_of_the_method() -> None:
    scene = kicked()
    gaps = np.array([closure(scene, dt) for dt in (4e-4, 2e-4, 1e-4, 5e-5)])
    orders = np.log2(gaps[:-1] / gaps[1:])
    assert np.all(np.abs(orders - 4) <= 0.6), (gaps, orders)
    assert gaps[-1] < 1e-7


@given(strategies.scenes(duration=0.04))
def test_the_ledger_closes_on_any_scene(scene: sp.Scene) -> None:
    # Short steps, so that halving dt halves the steps between close breakpoints too.
    runs = [sp.simulate(scene, dt=dt, record=("energy",)) for dt in (4e-5, 2e-5)]
    # A tip that leaves the object for a moment may be seen by one of them alone.
    assume(runs[0].status == runs[1].status)
    coarse, fine = map(closure_of, runs)
    # Order four means a sixteenth; a quarter leaves room for scenes that the coarse step hardly
    # resolves.
    assert fine <= max(0.25 * coarse, 1e-10), (coarse, fine)


def test_each_work_is_the_integral_of_its_own_power() -> None:
    """Powers recomputed in NumPy from the recorded states, integrated by Simpson's rule."""
    push = sp.Step(time=0.0, force=(5.0, 2.0), moment=0.02)
    scene = kicked(
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[6, 4]])), disturbances=[push], duration=0.05
    )
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


def settled(scene: sp.Scene) -> NDArray[np.float64]:
    """Where the grasp comes to rest, with more damping than it has."""
    tip = sp.Fingertip(normal_viscosity=300.0, tangential_viscosity=300.0)
    damped = replace(scene, hand=sp.Hand(tip=tip), control=sp.Pid(kp=100.0, kd=2.0, ki=0.0))
    return np.asarray(sp.simulate(replace(damped, duration=6.0), dt=2e-4, every=10**9).q[-1])


@pytest.mark.parametrize("tilt_coupling", [1.0, 0.0, -1.0])
def test_without_losses_the_energy_is_constant_to_the_order_of_the_method(
    tilt_coupling: float,
) -> None:
    kp, target = 100.0, np.deg2rad([6.0, 6.0])
    tip = sp.Fingertip(normal_viscosity=0.0, tangential_viscosity=0.0, tilt_coupling=tilt_coupling)
    scene = sp.Scene(
        hand=sp.Hand(tip=tip),
        control=sp.Pid(kp=kp, kd=0.0, ki=0.0),
        schedule=sp.Schedule.steps([0.0], [target]),
        duration=0.05,
    )
    q = settled(scene)
    initial = sp.State.consistent(
        scene,
        x=q[0],
        y=q[1],
        rotation=q[2],
        fingers=q[3:5],
        shear=q[7:9],
        velocity=(0.005, -0.004, 0.1),
    )
    scene = replace(scene, initial=initial)
    spreads = []
    for dt in (2e-4, 1e-4, 5e-5):
        run = sp.simulate(scene, dt=dt, record=("state", "energy"))
        assert run.success, run.message
        spring = 0.5 * kp * ((run.q[:, 3:5] - target) ** 2).sum(axis=1)
        total = run.energy.kinetic + run.energy.elastic + run.energy.gravity + spring
        exchanged = np.ptp(run.energy.kinetic)
        spreads.append(np.ptp(total) / exchanged)
    orders = np.log2(np.array(spreads[:-1]) / spreads[1:])
    assert np.all(orders > 3.4), (spreads, orders)
    assert spreads[-1] < 1e-5


def test_an_impulse_does_the_work_that_the_ledger_says() -> None:
    scene = sp.Scene(
        disturbances=[sp.Impulse(time=0.02, impulse=(0.05, -0.02), angular_impulse=1e-3)],
        duration=0.04,
    )
    energy = sp.simulate(scene, dt=5e-5, record=("energy",)).energy
    assert np.abs(energy.external_work[-1]) > 1e-3
    assert np.abs(energy.closure).max() <= 1e-6 * np.abs(energy.kinetic).max()


def test_the_papers_manipulation_closes() -> None:
    assert closure(paper.manipulation(), 1e-4) < 1e-4
