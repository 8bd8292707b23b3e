"""Dry friction of the joints: beside SymPy's equations, in the ledger, in lanes, and left out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_parts_oracle import BLOW, MOVE, require_equal

import softpinch as sp
from ensembles import require_alone
from oracle.parts import parts_reference
from other_hands import SCENES, STIFF
from softpinch import _core

RUBBING = sp.Finger(joint_friction=0.05, creep_rate=0.05)
SCENE = sp.Scene(
    hand=sp.Hand(right=RUBBING, left=sp.Finger(joint_friction=0.02)),
    schedule=sp.Schedule.steps([0.0, 0.02], [[0.1, 0.1], [0.13, 0.12]]),
    disturbances=[BLOW],
    duration=0.05,
)
OTHER = SCENES["a link and a jaw"]
JAWS = replace(
    OTHER,
    hand=sp.Hand(
        right=sp.Jaw(joint_friction=1.5, creep_rate=2e-3),
        left=sp.Parallelogram(joint_friction=0.04, creep_rate=0.03),
    ),
    control=(STIFF, sp.Pid()),
    schedule=sp.Schedule.steps([0.0], [[6e-3, 0.08]]),
    disturbances=[BLOW],
    duration=0.05,
)


@pytest.mark.parametrize("scene", [SCENE, replace(SCENE, motion=MOVE), JAWS], ids=str)
def test_it_is_that_of_the_equations_from_geometry(scene: sp.Scene) -> None:
    exact = parts_reference(scene, np.linspace(0.0, scene.duration, 11))
    for formulation in _core.FORMULATIONS:
        require_equal(scene, exact, formulation, 1e-9)
    smooth = replace(
        scene,
        hand=replace(
            scene.hand,
            right=replace(scene.hand.right, joint_friction=0.0),
            left=replace(scene.hand.left, joint_friction=0.0),
        ),
    )
    assert np.abs(sp.simulate(smooth).q[-1] - exact.q[-1]).max() > 1e-5


def test_the_ledger_has_its_loss() -> None:
    """The loss of the tips apart, it is the integral of f w^2 / sqrt(w^2 + v^2)."""
    for contact in _core.CONTACT_MODELS:
        scene = replace(SCENE, contact=contact, friction=0.9)
        run = sp.simulate(scene, 2e-5, "radau5", record=("state", "energy"))
        run.check()
        tip, w = scene.hand.tips[0], run.p[:, 3:5]
        most, creep = np.array([0.05, 0.02]), np.array([0.05, 0.01])
        rubbed = (most * w**2 / np.hypot(w, creep)).sum(axis=1)
        drags = [tip.normal_viscosity] * 2 + [tip.tangential_viscosity] * 2
        power = rubbed + (drags * run.p[:, 5:] ** 2).sum(axis=1)
        lost = np.trapezoid(power, run.t)
        assert run.energy.viscous_loss[-1] == pytest.approx(lost, rel=3e-4)
        assert np.trapezoid(rubbed, run.t) > 0.01 * lost


def test_driven_fingers_need_the_torque_that_overcomes_it() -> None:
    path = sp.Schedule.minimum_jerk([0.0], [[0.1, 0.1]], move_time=0.05)
    driven = replace(SCENE, schedule=path, fingers="driven", disturbances=())
    with_it = sp.simulate(driven, record=("state", "torque"))
    free = sp.Hand()
    without = sp.simulate(replace(driven, hand=free), record=("state", "torque"))
    np.testing.assert_allclose(with_it.q, without.q, rtol=0.0, atol=1e-12)
    w = with_it.p[:, 3:5]
    expected = np.array([0.05, 0.02]) * w / np.hypot(w, [0.05, 0.01])
    np.testing.assert_allclose(with_it.torque - without.torque, expected, rtol=0.0, atol=1e-9)


def test_at_rest_it_damps_as_a_gain_of_the_rate_does() -> None:
    """Its slope at w = 0 is f / v, so that a joint creeps under any torque."""
    rubbing = replace(SCENE, hand=sp.Hand(right=RUBBING, left=RUBBING), disturbances=())
    damped = replace(rubbing, hand=sp.Hand(), control=sp.Pid(kd=2.0))
    found, expected = sp.linearize(rubbing), sp.linearize(damped)
    np.testing.assert_allclose(found.A, expected.A, rtol=1e-9, atol=1e-7)
    assert sp.equilibrium(rubbing).growth == pytest.approx(sp.equilibrium(damped).growth)


@pytest.mark.parametrize("contact", _core.CONTACT_MODELS)
@pytest.mark.parametrize("method", ["rk4", "radau5"])
def test_runs_in_lanes_have_the_bits_that_they_have_alone(contact: Any, method: Any) -> None:
    vary = {
        "hand.right.joint_friction": sp.Uniform(0.0, 0.1),
        "hand.left.creep_rate": sp.Uniform(0.02, 0.2),
    }
    left = replace(RUBBING, joint_friction=0.02)
    hand = replace(SCENE.hand, left=left)
    scene = replace(SCENE, hand=hand, contact=contact, friction=0.5)
    found = sp.monte_carlo(scene, 11, vary=vary, seed=2, dt=1e-4, method=method, progress=False)
    assert (found.status == "completed").all()
    assert np.ptp(found["final_state"][:, 3]) > 1e-5
    for run in range(11):
        require_alone(found, run)


def test_it_is_a_number_of_the_finger() -> None:
    assert sp.Scene.from_toml(SCENE.to_toml()) == SCENE
    assert SCENE.vary_paths()["hand.right.joint_friction"] == (0.05, "N m")
    assert JAWS.vary_paths()["hand.right.creep_rate"] == (2e-3, "m/s")
    assert "hand.right.joint_friction" not in sp.Scene().vary_paths()
    smooth = sp.Scene(hand=sp.Hand(left=sp.Finger(creep_rate=0.1)))
    with pytest.raises(ValueError, match=r"hand\.left\.creep_rate.*the joint has no friction"):
        sp.monte_carlo(smooth, vary={"hand.left.creep_rate": [0.1, 0.2]}, progress=False)
    assert "joint_friction" in str(sp.explain(SCENE, measure=False))
    terms = sp.evaluate(SCENE, 0.0, SCENE.start().q, np.ones(9))
    np.testing.assert_allclose(terms.forces.viscous[3:5], -np.array([0.05, 0.02]), rtol=2e-3)
    assert sp.simulate(SCENE, 2e-4).stats["steps"] > 0
    for bad in ({"joint_friction": -1.0}, {"creep_rate": 0.0}):
        with pytest.raises(ValueError, match=rf"Finger\.{next(iter(bad))} = .*must be finite"):
            sp.Finger(**bad)
