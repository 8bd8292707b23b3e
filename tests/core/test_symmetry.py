"""Symmetries of the mechanics that the numbers must keep: the mirror image, and other units."""

from dataclasses import replace
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

import softpinch as sp
from contact_scenes import grasps, sequence
from softpinch import _core, strategies
from transforms import MIRROR_MULTIPLIERS, Units, mirrored, mirrored_coordinates, require_scaled

EVERYTHING = ("state", "multipliers", "residuals", "energy", "torque", "contact")
exponents = st.integers(-8, 8)
formulations = st.sampled_from(_core.FORMULATIONS)


@st.composite
def scenes(draw: st.DrawFn) -> sp.Scene:
    """Half of them have driven fingers; of some a contact soon leaves the face."""
    fingers = draw(st.sampled_from(["pid", "driven"]))
    scene = draw(strategies.scenes(duration=0.05, fingers=fingers, force=10.0))
    height = draw(st.one_of(st.none(), st.floats(1e-5, 5e-3)))
    return replace(scene, grasped=replace(scene.grasped, height=height))


def off_face(run: sp.Run) -> np.ndarray:
    """The intervals in which a contact is beyond the end of a face (n, 2), s."""
    return run.violation_intervals.get("off_face", np.empty((0, 2)))


@given(scenes(), st.sampled_from(_core.METHODS), formulations)
def test_mirror_images_mirror_to_round_off(scene: sp.Scene, method: str, formulation: str) -> None:
    options = {"dt": 5e-4, "method": method, "formulation": formulation, "record": EVERYTHING}
    run = sp.simulate(scene, **options)
    image = sp.simulate(mirrored(scene), **options)
    assert image.status == run.status
    assert image.t.shape == run.t.shape
    np.testing.assert_array_equal(off_face(image), off_face(run))
    q, p = mirrored_coordinates(image.q), mirrored_coordinates(image.p)
    # x and theta may both be round-off throughout, so lengths share one scale and angles another.
    lengths, angles = [0, 1, 5, 6, 7, 8], [2, 3, 4]
    for ours, theirs in ((run.q, q), (run.p, p)):
        for group in (lengths, angles):
            scale = np.abs(ours[:, group]).max()
            assert np.abs(ours[:, group] - theirs[:, group]).max() <= 1e-9 * scale
    force = np.abs(run.multipliers).max()
    difference = run.multipliers - image.multipliers[:, MIRROR_MULTIPLIERS]
    assert np.abs(difference).max() <= 1e-9 * force


@settings(max_examples=45)
@given(st.one_of(scenes(), grasps()), formulations, exponents, exponents, exponents)
def test_powers_of_two_of_length_mass_and_time_scale_a_run_to_the_bit(
    scene: sp.Scene, formulation: str, length: int, mass: int, time: int
) -> None:
    if scene.contact == "unilateral" and formulation == "nullspace":
        formulation = "csm"
    units = Units(length, mass, time)
    gains = sp.Stabilization()
    scaled = sp.Stabilization(alpha=gains.alpha / units.time, beta=gains.beta / units.time)
    dt = 1e-4 if scene.contact == "unilateral" else 5e-4
    how: dict[str, Any] = {"formulation": formulation, "record": EVERYTHING, "every": 7}
    run = sp.simulate(scene, dt=dt, **how)
    other = sp.simulate(units.scene(scene), dt=dt * units.time, stabilization=scaled, **how)
    require_scaled(run, other, units)
    np.testing.assert_array_equal(other.torque, run.torque * units.of(2, 1, -2))
    np.testing.assert_array_equal(off_face(other), off_face(run) * units.time)
    np.testing.assert_array_equal(other.contact, run.contact)
    assert sequence(other) == sequence(run)
    for ours, theirs in zip(run.contact_changes, other.contact_changes, strict=True):
        assert theirs.time == ours.time * units.time
