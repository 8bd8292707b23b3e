"""Invariants and symmetries of random runs with unilateral contact."""

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import softpinch as sp
from contact_scenes import (
    EVERYTHING,
    UNHURRIED,
    check,
    grasps,
    perturbed,
    sequence,
    settled,
    within,
)
from transforms import MIRROR_MULTIPLIERS, mirrored, mirrored_coordinates

FIXED = [(method, {"dt": 5e-5}) for method in ("rk4", "dop853", "radau5", "rosenbrock")]
ADAPTIVE = [(method, {"tolerance": 1e-10}) for method in ("dop853", "radau5", "rosenbrock")]
# Seldom two contacts open each other in turn by ever smaller impacts, which is chattering.
ENDS = ("completed", "lost", "crushed", "folded")


def simulated(scene: sp.Scene, **options: Any) -> sp.Run:
    return sp.simulate(scene, record=EVERYTHING, **options)


@settings(max_examples=30)
@given(grasps(duration=0.04), st.sampled_from(FIXED + ADAPTIVE), st.booleans())
def test_contact_forces_gaps_and_the_ledger_are_legal_along_any_run(
    scene: sp.Scene, how: tuple[str, dict[str, float]], projected: bool
) -> None:
    method, steps = how
    run = simulated(scene, method=method, formulation="projected" if projected else "csm", **steps)
    assert run.status in ENDS
    check(run, closure=1e-5 if "tolerance" in steps else 1e-2)


@settings(max_examples=30)
@given(grasps(duration=0.04), st.tuples(*[within(-0.3, 0.3)] * 2), within(-1e-3, 1e-3))
def test_contact_forces_gaps_and_the_ledger_are_legal_across_an_impulse(
    scene: sp.Scene, impulse: tuple[float, float], turn: float
) -> None:
    kick = sp.Impulse(time=0.011, impulse=impulse, angular_impulse=turn)
    scene = replace(scene, disturbances=[*scene.disturbances, kick])
    run = simulated(scene, method="dop853", tolerance=1e-11)
    assert run.status in ENDS
    check(run)


def measured(run: sp.Run) -> dict[str, Any]:
    """The numbers of a run that a mirror image shares; forces as shares of the largest one."""
    times = [change[0] for finger in ("right", "left") for change in settled(run, finger)]
    forces = run.multipliers / np.abs(run.multipliers).max()
    return {"times": np.array(times), "q": run.q, "p": run.p, "forces": forces}


def measured_of_image(run: sp.Run) -> dict[str, Any]:
    """The same numbers from the run of the mirror image."""
    times = [change[0] for finger in ("left", "right") for change in settled(run, finger)]
    forces = run.multipliers[:, MIRROR_MULTIPLIERS] / np.abs(run.multipliers).max()
    q, p = mirrored_coordinates(run.q), mirrored_coordinates(run.p)
    return {"times": np.array(times), "q": q, "p": p, "forces": forces}


# A grazing tip that opens meets the face again and again within microseconds, by gaps of 1e-15 m:
# round-off then moves later events by up to 1e-6 s, with any method and step.
FINGER = sp.Finger(length=0.07, root_offset=0.0425, half_thickness=0.004, mass=0.08, inertia=5e-4)
TIP = sp.Fingertip(radius=0.018, tangential_viscosity=70.0, normal_mass=0.01, tangential_mass=0.005)
TIPS = (
    replace(TIP, youngs_modulus=2e5, normal_viscosity=130.0),
    replace(TIP, youngs_modulus=4e5, normal_viscosity=70.0),
)
BOUNCING = sp.Scene(
    hand=sp.Hand(right=FINGER, left=FINGER, tip=TIPS),
    grasped=sp.GraspedObject(width=0.045, mass=0.08, inertia=3e-5, com_offset=-0.005),
    control=(sp.Pid(), sp.Pid(kp=80.0, kd=0.7)),
    schedule=sp.Schedule.steps([0.0, 0.015], np.deg2rad([[6.5, 2.0], [3.5, -4.0]])),
    disturbances=(sp.Pulse(time=0.006, duration=0.0075, force=(-30.0, 0.0), moment=-2.0),),
    duration=0.03,
    friction=(0.1, 0.65),
    contact="unilateral",
)


@settings(max_examples=20, **UNHURRIED)
@given(grasps())
@example(BOUNCING)
def test_the_mirror_image_runs_the_mirror_image(scene: sp.Scene) -> None:
    scene = replace(scene, initial=scene.start())
    options: dict[str, Any] = {"dt": 1e-4, "method": "dop853"}
    run = simulated(scene, **options)
    others = [simulated(perturbed(scene, size), **options) for size in (1e-9, 3e-10, 1e-10)]
    for other in others:
        assume(other.status == run.status and sequence(other) == sequence(run))
        assume(np.array_equal(other.contact, run.contact))
    assert isinstance(scene.friction, tuple)
    image = simulated(replace(mirrored(scene), friction=scene.friction[::-1]), **options)
    assert image.status == run.status and image.holds == run.holds
    assert sequence(image)[::-1] == sequence(run)
    np.testing.assert_array_equal(image.contact[:, ::-1], run.contact)
    ours, theirs = measured(run), measured_of_image(image)
    neighbours = [measured(other) for other in others]
    for name, least in {"times": 1e-10, "q": 1e-10, "p": 1e-7, "forces": 1e-7}.items():
        # Where a start that is moved by 1e-9 changes more than that, round-off may, too.
        moved = max(np.abs(near[name] - ours[name]).max(initial=0.0) for near in neighbours)
        np.testing.assert_allclose(theirs[name], ours[name], rtol=0, atol=least + 10 * moved)
