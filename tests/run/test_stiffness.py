"""A run that its step has ruined says so: which step is stable, and which method needs none."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import softpinch as sp
from softpinch import strategies, stress
from softpinch.run import stiffness

OVERDAMPED = stress.CASES["overdamped"].scene


def said(call: Any) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", sp.StabilityWarning)
        call()
    return [str(one.message) for one in caught if one.category is sp.StabilityWarning]


@pytest.mark.parametrize("method", ["rk4", "dop853"])
@pytest.mark.parametrize("formulation", sp._core.FORMULATIONS)
def test_a_scene_that_long_steps_ruin(method: str, formulation: str) -> None:
    how: dict[str, Any] = {"method": method, "formulation": formulation}
    with pytest.warns(sp.StabilityWarning, match="dt = 0.0001 s is beyond") as caught:
        run = sp.simulate(OVERDAMPED, dt=1e-4, **how)
    assert run.status != "completed"
    (one,) = caught
    # It names the user's own line.
    assert one.filename == __file__
    text = str(one.message)
    assert 'take method="radau5"' in text and f'"{run.status}"' in text
    longest = float(text.split("is beyond ")[1].split(" s")[0])
    # The eigenvalues along the whole motion, computed elsewhere, allow the same.
    limit = sp.max_stable_dt(OVERDAMPED, **how, measure=False).predicted
    assert longest == pytest.approx(limit, rel=0.1)
    # It takes what it is told, and with a third more it fails again.
    short = replace(OVERDAMPED, duration=2e-4)
    advised = float(text.split("or dt <= ")[1].split(" s")[0])
    assert not said(lambda: sp.simulate(short, dt=advised, **how).success or pytest.fail())
    assert said(lambda: sp.simulate(short, dt=1.35 * longest, **how))


@pytest.mark.parametrize("name", ["thrown_out", "crushed"])
@pytest.mark.parametrize("dt", [1e-3, 1e-4])
def test_motions_that_end_by_themselves_give_no_warning(name: str, dt: float) -> None:
    case = stress.CASES[name]
    assert not said(lambda: sp.simulate(case.scene, dt=dt).status == case.end or pytest.fail())


def test_other_runs_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither those that complete, nor those of methods that are stable for every step."""
    monkeypatch.setattr("softpinch.run.stiffness.eigenvalues", lambda *_: pytest.fail())
    sp.simulate(sp.Scene(duration=0.01))
    blow = sp.Impulse(time=0.001, impulse=(6.0, 0.0))
    gone = sp.Scene(disturbances=[blow], duration=0.02)
    for how in ({"method": "radau5"}, {"method": "dop853", "tolerance": 1e-6}):
        assert not sp.simulate(gone, **how).success


def test_unilateral_contact_whose_free_tips_are_overdamped() -> None:
    tip = sp.Fingertip(normal_viscosity=1e4, tangential_viscosity=1e4)
    grasped = sp.GraspedObject(mass=1e-3)
    scene = sp.Scene(
        hand=sp.Hand(tip=tip), grasped=grasped, contact="unilateral", friction=0.8, duration=0.02
    )
    (text,) = said(lambda: sp.simulate(scene, dt=1e-4))
    # A free surface of m = 1 g decays at c / m = 1e7 1/s, and RK4 damps up to 2.785.
    assert "is beyond 2.79e-07 s" in text or "is beyond 4" in text


def slippery(viscosity: float) -> sp.Scene:
    """A grasp that slips down between tips of 10 g."""
    tip = sp.Fingertip(tangential_viscosity=viscosity, tangential_mass=0.01)
    return sp.Scene(hand=sp.Hand(tip=tip), contact="unilateral", friction=0.01, duration=0.03)


def test_a_slipping_tip_limits_the_step() -> None:
    """Its shear decays at c / m = 1e5 1/s, which RK4 damps up to 2.785 / 1e5 s."""
    scene = slippery(1e3)
    how: dict[str, Any] = {"formulation": "projected"}
    exact = sp.simulate(scene, method="radau5", tolerance=1e-6, **how)
    below, above = (sp.simulate(scene, dt=dt, **how) for dt in (2.6e-5, 2.9e-5))
    shear = exact.q[-1, 7:]
    np.testing.assert_allclose(below.q[-1, 7:], shear, rtol=1e-3)
    assert (np.abs(above.q[-1, 7:] / shear - 1.0) > 0.1).all()
    (text,) = said(lambda: sp.simulate(slippery(1e2), dt=5.57e-3, **how).success and pytest.fail())
    assert "is beyond 0.000279 s" in text


def test_a_discrete_controller_may_start_it() -> None:
    scene = replace(OVERDAMPED, control=sp.SampledController.pid(1e-3), duration=0.01)
    (text,) = said(lambda: sp.simulate(scene, dt=1e-4))
    assert 'take method="radau5"' in text


def noisy(rate: float) -> sp.Scene:
    """Steps end at each sample; the blow at the end opens the grasp whatever the step."""
    noise = sp.Noise(rate_hz=rate, force_std=(0.1, 0.1), moment_std=0.0, seed=1)
    blow = sp.Impulse(time=0.45, impulse=(20.0, 0.0))
    return sp.Scene(duration=0.5, disturbances=[noise, blow])


@pytest.mark.parametrize("every", [1, 50])
def test_the_steps_that_were_taken_are_compared(every: int) -> None:
    """Samples of a noise end the steps after 1 ms, which is stable, whatever `dt`."""
    scene = noisy(1000.0)
    assert np.diff(sp.simulate(scene, dt=1e-3).t).max() < 1.1e-3
    assert not said(lambda: sp.simulate(scene, dt=3e-3, every=every).success and pytest.fail())


def test_an_end_that_no_stiff_method_has_reached_is_not_called_unconfirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (text,) = said(lambda: sp.simulate(OVERDAMPED, dt=1e-4, method="dop853"))
    assert "which a stiff method does not confirm" in text
    monkeypatch.setattr(stiffness, "_MOST", 2)
    (text,) = said(lambda: sp.simulate(OVERDAMPED, dt=1e-4))
    assert "confirm" not in text
    assert "a stiff method looked up to t = " in text


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(strategies.scenes(duration=0.05))
def test_no_scene_with_a_short_step_is_warned_of(scene: sp.Scene) -> None:
    assert not said(lambda: sp.simulate(scene, dt=2e-5, method="dop853", formulation="nullspace"))


def test_of_few_failures_all_are_looked_at() -> None:
    """One of forty is unstable, and some others are lost by themselves."""
    masses = np.full(40, 0.1)
    masses[17] = 1e-4
    scene = replace(stress.CASES["hammer"].scene, duration=0.02)
    ensemble: list[sp.Ensemble] = []
    (text,) = said(
        lambda: ensemble.append(
            sp.monte_carlo(scene, 40, vary={"grasped.mass": masses}, dt=1e-4, progress=False)
        )
    )
    assert text.startswith("1 of 40 runs are unstable, such as run 17: ")
    assert ensemble[0].counts()["completed"] == 39
