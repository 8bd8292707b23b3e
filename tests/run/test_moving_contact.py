"""Unilateral contact in a hand that moves, beside the oracle's in inertial coordinates."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import softpinch as sp
from contact_scenes import EVERYTHING, UNHURRIED, check, grasps, settled
from core.test_contact_agreement import CODES, METHODS, SIDES, calm, merged, simulated
from core.test_moving_oracle import UNLIKE, require_close
from oracle import UnilateralReference, unilateral
from oracle.moving import Moving
from softpinch import ContactMode
from transforms import MIRROR_MULTIPLIERS, mirrored, mirrored_coordinates
from unilateral_parts import grasp

TIMES = np.array([0.0127, 0.0223, 0.0341, 0.0489])
GRASP = replace(
    UNLIKE,
    contact="unilateral",
    friction=(0.4, 0.6),
    grasped=replace(UNLIKE.grasped, height=0.049),
    disturbances=(),
)
ASIDE = replace(GRASP, schedule=sp.Schedule.in_degrees("steps", [0.0], [[6, 6]]))
# Forces and impulses are along fixed axes, so that a tilt turns them in the hand.
PUSHED = replace(
    GRASP,
    disturbances=[
        sp.Step(time=0.01, force=(1.0, -2.0), moment=0.01),
        sp.Impulse(time=0.0151, impulse=(0.03, 0.02), angular_impulse=2e-4),
    ],
)
LIMITED, TRAPEZOID = sp.HandMotion.jerk_limited, sp.HandMotion.trapezoid
FAR, MOVE = [[0.0, 0.0], [0.09, 0.01]], [0.0093, 0.0433]
SCENES = {
    "translation": replace(
        ASIDE, motion=TRAPEZOID([0.0093, 0.0393], [[0.0, 0.0], [0.12, 0.02]], 700.0), duration=0.053
    ),
    "shaken": replace(ASIDE, motion=sp.HandMotion.sine(0.03, 25.0, 0.3), duration=0.048),
    "turning": replace(
        PUSHED,
        motion=TRAPEZOID(MOVE, [[0.0, 0.0], [0.03, 0.02]], 400.0, [0.2, 1.2]),
        duration=0.055,
    ),
    "both": replace(PUSHED, motion=LIMITED(MOVE, FAR, 600.0, 3e5, [0.2, 0.9]), duration=0.048),
    "whirled": replace(PUSHED, motion=sp.HandMotion.sine(0.3, 20.0, "tilt", phase=0.3, tilt=0.1)),
}
STATUSES = {"whirled": "lost"}


def in_inertial_coordinates(scene: sp.Scene) -> UnilateralReference:
    return unilateral(scene, TIMES[scene.duration > TIMES])


@cache
def expected(name: str) -> UnilateralReference:
    return in_inertial_coordinates(SCENES[name])


def follows(
    scene: sp.Scene,
    ours: UnilateralReference,
    options: dict[str, Any],
    tolerance: float,
    late: float,
) -> sp.Run:
    """Compares a run with the oracle: its modes, their instants, its rows and its ledger.

    Args:
        scene: With a motion and unilateral contact.
        ours: Its motion by the oracle.
        options: Of the run.
        tolerance: Of states and forces, as a share of the largest.
        late: What an instant may be off, s.
    """
    run = simulated(scene, **options, times=ours.t)
    assert (run.status, run.holds) == (ours.status, ours.holds)
    for finger in SIDES:
        found = settled(run, finger)
        theirs = merged([change for change in ours.changes if change.finger == finger])
        assert [change[1:] for change in found] == [change[1:] for change in theirs]
        instants = [change[0] for change in theirs]
        np.testing.assert_allclose([change[0] for change in found], instants, rtol=0, atol=late)
    # The last row is that at the end of the run.
    assert run.t[-1] == pytest.approx(ours.end.t, abs=late)
    assert run.contact[-1].tolist() == [CODES[mode] for mode in ours.end.modes]
    rows = Moving(*(np.vstack([getattr(ours, n), getattr(ours.end, n)]) for n in ("q", "p")),
                  run.multipliers)  # fmt: skip
    require_close(Moving(run.q, run.p, run.multipliers), rows, tolerance)
    forces = ours.end.multipliers
    np.testing.assert_allclose(
        run.multipliers[-1], forces, rtol=0, atol=tolerance * np.abs(run.multipliers).max()
    )
    book, ledger = ours.ledger, run.energy
    for amount, wanted in (
        (ledger.friction_loss, book["friction"]),
        (ledger.impact_loss, book["impact"] + book["stop"]),
        (ledger.relaxation_work, book["relaxation"] + book["graze"]),
        (ledger.viscous_loss, -book["viscous"]),
        (ledger.controller_work, book["torque"]),
        (ledger.external_work, book["external"] + book["impulse"]),
    ):
        assert amount[-1] == pytest.approx(wanted, abs=tolerance * ledger.exchanged)
    assert np.abs(ledger.closure).max() < tolerance * ledger.exchanged
    assert ledger.motion_work.any()
    return run


@pytest.mark.parametrize(
    "name",
    # Another one moves and turns.
    [
        pytest.param(name, marks=pytest.mark.slow) if name == "translation" else name
        for name in SCENES
    ],
)
def test_tips_slip_open_and_collide_as_in_inertial_coordinates(name: str) -> None:
    scene = SCENES[name]
    run = follows(scene, expected(name), METHODS[1], 1e-10, 1e-12)
    assert run.status == STATUSES.get(name, "completed")
    check(run)
    modes = {(change.before, change.after) for change in run.contact_changes}
    assert any(after == ContactMode.SLIP for _, after in modes)
    assert any(before == ContactMode.FREE != after for before, after in modes)
    assert any(after == ContactMode.FREE for _, after in modes)
    assert run.energy.impact_loss[-1] > 1e-6
    assert np.ptp(run.hand.tilt) > (0.5 if name in ("turning", "both", "whirled") else -1.0)


@pytest.mark.parametrize("options", [METHODS[0], METHODS[2]], ids=["csm", "equal steps"])
def test_other_steps_and_formulations_move_as_in_inertial_coordinates(
    options: dict[str, Any],
) -> None:
    follows(SCENES["turning"], expected("turning"), options, 1e-10, 1e-12)


# Kinds and seeds of `grasp`, and the tilts that the motion begins and ends with.
OTHER_PARTS = [
    ("parallelogram", 44, -0.4),
    ("mixed", 28, 0.5),
    ("jaw", 20, 0.0),
    pytest.param("jaw", 14, 0.5, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("kind", "seed", "tilt"), OTHER_PARTS)
def test_other_parts_slip_and_open_as_in_inertial_coordinates(
    kind: str, seed: int, tilt: float
) -> None:
    move = sp.HandMotion.minimum_jerk([0.001, 0.015], [[0.0, 0.0], [0.01, 0.005]], [0.1, tilt])
    scene = grasp(kind, seed).with_({"motion": move})
    run = follows(scene, unilateral(scene, [0.004, 0.009, 0.0131]), METHODS[1], 1e-10, 1e-11)
    modes = {change.after for change in run.contact_changes}
    assert {ContactMode.SLIP, ContactMode.FREE} <= modes


@st.composite
def carried(draw: st.DrawFn) -> sp.Scene:
    """A grasp whose hand is moved, turned or shaken so that tips may slip and open."""
    scene = draw(grasps(duration=0.03))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    kind = draw(st.sampled_from(["minimum_jerk", "trapezoid", "sine", "turn"]))
    points, tilts = rng.uniform(-0.03, 0.03, (2, 2)), rng.uniform(-0.5, 0.5, 2)
    times = [0.0053, 0.0053 + rng.uniform(0.015, 0.022)]
    if kind == "minimum_jerk":
        motion = sp.HandMotion.minimum_jerk(times, points, tilts)
    elif kind == "trapezoid":
        motion = TRAPEZOID(times, points, 2000.0, tilts)
    else:
        motion = sp.HandMotion.sine(
            *((0.01, 30.0, float(tilts[0])) if kind == "sine" else (0.2, 20.0, "tilt")),
            phase=float(tilts[1]),
            tilt=float(tilts[0]),
        )
    return replace(scene, motion=motion)


@pytest.mark.slow
@settings(max_examples=40, **UNHURRIED)
@given(carried())
def test_many_grasps_move_as_in_inertial_coordinates(scene: sp.Scene) -> None:
    run = simulated(scene, **METHODS[1])
    # Tips that throw each other off in ever shorter flights: see the status's limits.
    assume(run.status != "chattering" and run.t[-1] > TIMES[0] and calm(scene, run))
    follows(scene, in_inertial_coordinates(scene), METHODS[1], 1e-8, 1e-8)


@pytest.mark.parametrize("name", ["translation", "turning", "both"])
def test_the_mirror_image_slips_like_the_image_in_a_mirror(name: str) -> None:
    scene, data = SCENES[name], SCENES[name].motion.to_dict()
    data["points"] = np.multiply(data["points"], [-1, 1])
    data["tilts"] = np.negative(data["tilts"])
    image = replace(mirrored(replace(scene, motion=None)), motion=sp.HandMotion.from_dict(data))
    ours, theirs = (sp.simulate(s, dt=1e-4, record=EVERYTHING) for s in (scene, image))
    assert len(ours.contact_changes) > 5
    for finger, other in (SIDES, SIDES[::-1]):
        pairs = zip(settled(ours, finger), settled(theirs, other), strict=True)
        for (t, *modes), (t_image, *modes_image) in pairs:
            assert t_image == pytest.approx(t, abs=1e-12) and modes_image == modes
    image_rows = Moving(*map(mirrored_coordinates, (ours.q, ours.p)),
                        ours.multipliers[:, MIRROR_MULTIPLIERS])  # fmt: skip
    require_close(Moving(theirs.q, theirs.p, theirs.multipliers), image_rows, 1e-9)
