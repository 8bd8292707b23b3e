"""The height of the faces: a contact beyond their ends is noted, and the motion stays as it is."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import strategies
from transforms import Units, mirrored, without_noise

ALL = ("state", "multipliers", "residuals", "energy", "torque")


def high(scene: sp.Scene, height: float | None) -> sp.Scene:
    return replace(scene, grasped=replace(scene.grasped, height=height))


@given(strategies.scenes(duration=0.05, force=60.0), st.floats(1e-5, 1e-2))
def test_a_height_changes_no_bit_of_the_motion(scene: sp.Scene, height: float) -> None:
    low = sp.simulate(high(scene, height), dt=5e-4, record=ALL)
    endless = sp.simulate(high(scene, None), dt=5e-4, record=ALL)
    assert low.status == endless.status
    for name, values in endless.arrays().items():
        np.testing.assert_array_equal(low.arrays()[name], values, err_msg=name)
    assert "off_face" not in endless.violations
    noted = {name: time for name, time in low.violations.items() if name != "off_face"}
    assert noted == endless.violations


@given(
    strategies.scenes(duration=0.05, force=60.0),
    st.floats(1e-5, 5e-3),
    st.sampled_from([(3, -5, 2), (-4, 1, 0)]),
)
def test_other_units_and_a_mirror_find_the_same_instants(
    scene: sp.Scene, height: float, exponents: tuple[int, int, int]
) -> None:
    scene = high(without_noise(scene), height)
    run = sp.simulate(scene, dt=5e-4)
    units = Units(*exponents)
    gains = sp.Stabilization(alpha=1e3 / units.time, beta=1e3 / units.time)
    scaled = sp.simulate(units.scene(scene), dt=5e-4 * units.time, stabilization=gains)
    nothing = np.empty((0, 2))
    here = run.violation_intervals.get("off_face", nothing)
    there = scaled.violation_intervals.get("off_face", nothing)
    np.testing.assert_array_equal(there, here * units.time)
    image = sp.simulate(mirrored(scene), dt=5e-4)
    np.testing.assert_array_equal(image.violation_intervals.get("off_face", nothing), here)


def test_a_push_along_the_faces_takes_a_contact_off_the_shorter_face_first() -> None:
    push = sp.Step(time=0.1, force=(0.0, 30.0))
    scene = sp.Scene(disturbances=[push], duration=0.3)
    found = [sp.simulate(high(scene, height)) for height in (2.0e-3, 2.4e-3, 1.0)]
    first = [run.violations.get("off_face", np.inf) for run in found]
    assert 0.0 < first[0] < first[1] < first[2] == np.inf
