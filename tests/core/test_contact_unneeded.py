"""Unilateral contact is the paper's model, to the bit, if no tip pulls, slips or opens."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings

import softpinch as sp
from contact_scenes import grasps
from softpinch import paper

EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque")
HOW: list[dict[str, Any]] = [
    *(
        {"method": method, "dt": 1e-4}
        for method in ("rk4", "dop853", "implicit_midpoint", "radau5", "rosenbrock")
    ),
    *({"method": method, "tolerance": 1e-8} for method in ("dop853", "radau5", "rosenbrock")),
]


def same(scene: sp.Scene, options: dict[str, Any], formulation: str) -> None:
    """A unilateral run without events and the bilateral run have the same bits."""
    ours, theirs = (
        sp.simulate(
            replace(scene, contact=contact),
            formulation=formulation,
            record=EVERYTHING,
            stop_on=(),
            **options,
        )
        for contact in ("unilateral", "bilateral")
    )
    assert not ours.contact_changes and not ours.violations and ours.holds
    assert ours.status == theirs.status == "completed"
    for name, values in theirs.arrays().items():
        np.testing.assert_array_equal(ours.arrays()[name], values, err_msg=name)


@pytest.mark.parametrize("formulation", ["csm", "projected"])
@pytest.mark.parametrize("options", HOW, ids=str)
def test_smooth_moves_are_the_papers(options: dict[str, Any], formulation: str) -> None:
    moves = sp.Schedule.minimum_jerk(
        0.1 * np.arange(4), paper.manipulation().schedule.angles[:4], move_time=0.03
    )
    scene = sp.Scene(
        grasped=sp.GraspedObject(height=0.049), schedule=moves, duration=0.35, friction=1.0
    )
    same(scene, options, formulation)


@pytest.mark.parametrize("formulation", ["csm", "projected"])
def test_smooth_moves_of_driven_fingers_are_the_papers(formulation: str) -> None:
    move = sp.Schedule.minimum_jerk([0.0, 0.0137], np.deg2rad([[5, 6], [8, 4]]), move_time=0.0411)
    scene = sp.Scene(fingers="driven", schedule=move, duration=0.08, friction=1.0)
    same(scene, {"method": "dop853", "dt": 2e-4}, formulation)


@settings(max_examples=30)
@given(grasps(duration=0.02, steps=False))
def test_random_grasps_that_are_pushed_gently_are_the_papers(scene: sp.Scene) -> None:
    (push,) = scene.disturbances
    gently = replace(push, force=tuple(0.02 * np.array(push.force)), moment=0.01 * push.moment)
    scene = replace(scene, disturbances=[gently], friction=tuple(2 * np.array(scene.friction)))
    assume(not sp.simulate(replace(scene, contact="unilateral")).contact_changes)
    for formulation in ("csm", "projected"):
        same(scene, {"method": "rk4", "dt": 1e-4}, formulation)
