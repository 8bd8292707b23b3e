"""Derivatives of runs with other parts by the numbers of each kind, beside differences of runs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_sensitivity_contact import Compared, require_all

import derivative_paths as paths_of
import softpinch as sp
from derivative_differences import of
from derivative_scenes import entries
from differences import changed, closest, states
from other_hands import SCENES
from softpinch import _core
from unilateral_parts import KINDS, grasp

# Shares of a number's size.
LADDER = (1e-2, 1e-3, 1e-4)
BLOW = sp.Impulse(time=0.0057, impulse=(0.02, -0.01), angular_impulse=3e-4)
RELAXING = tuple(
    sp.Fingertip(normal_mass=0.05, tangential_mass=0.07, relaxation=branches, law=law)
    for branches, law in (
        ((sp.Maxwell(0.5, 0.004), sp.Maxwell(0.2, 0.02)), None),
        (sp.Maxwell(0.4, 0.01), sp.PowerLaw(164033.0, 1.67, 1e-4)),
    )
)
RUBBING = sp.Hand(
    right=sp.Finger(joint_friction=0.05, creep_rate=0.05), left=sp.Jaw(joint_friction=1.5)
)
MIXED = SCENES["a link and a jaw"]
# The scene, and numbers of its kinds.
BY: dict[str, tuple[sp.Scene, tuple[str, ...]]] = {
    "jaws": (
        SCENES["jaws and a bottle"],
        ("hand.right.root_offset", "hand.left.direction", "hand.right.height", "hand.left.angle",
         "hand.left.mass", "grasped.mass", "control.right.kp", "schedule.angles"),
    ),
    "arcs": (
        MIXED,
        ("grasped.left.radius", "grasped.left.center.0", "grasped.left.center.1",
         "grasped.right.tilt", "grasped.width", "grasped.com_offset", "hand.tip.radius",
         "hand.tip.youngs_modulus"),
    ),
    "wedge": (SCENES["jaws and a wedge"], ("grasped.left.tilt", "grasped.width", "gravity")),
    "parallelograms": (
        SCENES["parallelograms"],
        ("hand.right.angle", "hand.left.length", "hand.right.inertia", "hand.left.mass"),
    ),
    "power law": (
        SCENES["power law"],
        ("hand.tip.law.coefficient", "hand.tip.law.exponent", "hand.tip.law.foot",
         "hand.tip.law.shear_factor", "hand.tip.tilt_coupling", "hand.tip.normal_viscosity"),
    ),
    "measured law": (SCENES["measured law"], ("hand.tip.law.shear_factor", "hand.left.length")),
    "branches": (
        replace(SCENES["power law"], hand=sp.Hand(tip=RELAXING)),
        ("hand.tip.right.relaxation.0.share", "hand.tip.right.relaxation.1.time",
         "hand.tip.left.relaxation.0.time", "hand.tip.left.law.coefficient", "grasped.mass"),
    ),
    "rubbing joints": (
        replace(MIXED, hand=RUBBING),
        ("hand.right.joint_friction", "hand.right.creep_rate", "hand.left.joint_friction"),
    ),
}  # fmt: skip


def error(scene: sp.Scene, path: str, index: tuple[int, ...], **how: Any) -> float:
    """The smallest error of the derivatives by one number, over steps of differences."""
    run = sp.simulate(scene, sensitivities=path, **how)
    assert run.success, run.message
    size = paths_of.size(scene, path, index)
    least = 1e-4 / size * (np.abs(states(run)) + np.repeat([1.0, 30.0], 9))
    ours = of(run, "state", path, index)
    assert ours.any(), path

    def moved(by: float) -> Any:
        return states(sp.simulate(changed(scene, path, index, by), **how))

    return closest(ours, moved, [share * size for share in LADDER], least)


# The methods in turns.
@pytest.mark.parametrize("number", range(len(BY)))
@pytest.mark.parametrize("fingers", ["own", "held"])
def test_differences_agree_by_numbers_of_each_kind(number: int, fingers: str) -> None:
    (scene, paths), name = [*BY.values()][number], [*BY][number]
    scene = replace(scene, duration=0.012, disturbances=(BLOW,))
    method = [*_core.METHODS][(number + (fingers == "held")) % len(_core.METHODS)]
    formulation = [*_core.FORMULATIONS][number % 3]
    if fingers == "held":
        # The start is that of a schedule, and the hand moves.
        targets = np.array(scene.schedule.angles[0])
        paths = (*paths[:2], *(("schedule.angles",) if "schedule.angles" in paths else ()))
        schedule = sp.Schedule.minimum_jerk([0.0, 0.001], [targets, 1.1 * targets], 0.01)
        motion = sp.HandMotion.constant(acceleration=(3.0, -2.0), tilt=0.2)
        scene = replace(
            scene,
            fingers="driven",
            initial=None,
            schedule=schedule,
            motion=motion,
            control=sp.Pid(),
        )
        if name == "rubbing joints":
            paths = ("hand.left.root_offset",)
    how: dict[str, Any] = {"dt": 4e-4, "method": method, "formulation": formulation}
    for path in paths:
        for index in entries(scene, path):
            assert error(scene, path, index, stop_on=(), **how) <= 1e-7, (path, index)


KIND_PATHS = {
    "jaw": ("hand.right.direction", "hand.left.mass"),
    "parallelogram": ("hand.right.angle", "hand.left.length"),
    "tilted face": ("grasped.right.tilt", "grasped.left.tilt"),
    "arc": ("grasped.right.radius", "grasped.left.radius"),
    "power law": ("hand.tip.right.law.exponent", "hand.tip.left.law.coefficient"),
    "measured law": ("hand.tip.right.law.shear_factor", "hand.tip.left.normal_viscosity"),
    "mixed": ("friction.right", "grasped.mass"),
}


def of_kinds(seeds: range) -> Any:
    for seed in seeds:
        for kind in KINDS:
            path = KIND_PATHS[kind][seed % 2]
            scene = grasp(kind, seed)
            yield Compared(scene, path, (), method=("rk4", "dop853")[seed % 2], dt=5e-5)


def test_differences_agree_through_the_events_of_every_kind() -> None:
    require_all(of_kinds(range(4)), 4 * len(KINDS))
