"""Closed forms of jaws and parallelograms, faces and arcs, laws of the tip."""

from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import softpinch as sp
from other_hands import (
    BOTTLE,
    EVERYTHING,
    STIFF,
    jaws,
    linked,
)
from softpinch.scene.outline import contacts, object_outline

CURVE = np.linspace(1e-3, 0.012, 12)
MEASURED = sp.MeasuredLaw(CURVE, np.pi * 3e5 * CURVE**2)


@pytest.mark.parametrize("finger", [sp.Finger(), sp.Jaw(), sp.Parallelogram()])
def test_an_arc_of_a_thousand_kilometres_is_a_face(finger: Any) -> None:
    control = STIFF if isinstance(finger, sp.Jaw) else sp.Pid()
    scene = linked(hand=sp.Hand(right=finger, left=finger), control=control)
    target = scene.start().q[3:5] + np.array([4e-3, 5e-3]) / (1 if control is STIFF else 0.0762)
    scene = replace(scene, schedule=sp.Schedule.steps([0.0], [target]))
    half = 0.5 * scene.grasped.width
    sides = [sp.Arc(1e6, (sign * (half - 1e6), 0.0)) for sign in (1.0, -1.0)]
    curved = replace(scene, grasped=replace(scene.grasped, right=sides[0], left=sides[1]))
    runs = [sp.simulate(each, formulation="projected") for each in (scene, curved)]
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-9
    plain = replace(scene, grasped=replace(scene.grasped, right=sp.Face(), left=sp.Face()))
    assert np.abs(sp.simulate(plain, formulation="projected").q - runs[0].q).max() < 1e-12


def test_jaws_hold_a_box_by_half_its_weight_each() -> None:
    rest = sp.equilibrium(jaws())
    assert rest.stable
    np.testing.assert_allclose(rest.multipliers[2:], 0.5 * 0.1 * 9.81, rtol=1e-9)
    # The drives hold the tips' normal forces, which the springs of (5) have.
    np.testing.assert_allclose(rest.torque, rest.multipliers[:2], rtol=1e-9)
    assert rest.state is not None
    # Of upright tips (5) has E pi (d_n^2 + d_t^2) there.
    expected = np.pi * 3e5 * (rest.state.q[5:7] ** 2 + rest.state.q[7:] ** 2)
    np.testing.assert_allclose(rest.multipliers[:2], expected, rtol=1e-9)


def test_a_parallelogram_with_links_of_a_kilometre_is_a_jaw() -> None:
    length = 1e3
    jaw = sp.Jaw(height=length)
    long = sp.Parallelogram(length=length, mass=0.0, inertia=jaw.mass * length**2)
    travel = jaws(hand=sp.Hand(right=jaw, left=jaw))
    gains = sp.Pid(kp=2e4 * length**2, kd=200.0 * length**2, ki=2e5 * length**2)
    swing = jaws(
        hand=sp.Hand(right=long, left=long),
        control=gains,
        schedule=sp.Schedule.steps([0.0], [[4e-3 / length, 4e-3 / length]]),
    )
    runs = [sp.simulate(each, formulation="projected") for each in (travel, swing)]
    scale = np.array([1.0, 1.0, 1.0, length, length, 1.0, 1.0, 1.0, 1.0])
    # The arc falls by z^2 / (2 L) below the line.
    assert np.abs(runs[0].q - scale * runs[1].q).max() < 1e-7


@pytest.mark.parametrize("angle", [0.0, 0.3, -0.2])
def test_a_wedge_balances_at_its_width_and_has_the_inertia_of_its_points(angle: float) -> None:
    width, height, mass = 0.05, 0.04, 0.2
    wedge = sp.GraspedObject.wedge(width, height, mass, angle)
    strips = height * ((np.arange(4000) + 0.5) / 4000 - 0.5)

    def half(offset: float) -> Any:
        """Half the width of each strip if the middle is so far above the centre of gravity."""
        return 0.5 * width + np.tan(angle) * (strips + offset)

    offset = brentq(lambda o: (half(o) * (strips + o)).sum(), -height, height, xtol=1e-14)
    own, y = half(offset), strips + offset
    inertia = mass * (own * (own**2 / 3 + y**2)).sum() / own.sum()
    assert wedge.inertia == pytest.approx(inertia, rel=1e-6)
    assert np.ptp(object_outline(linked(grasped=wedge), np.zeros(9))[:, 1]) == pytest.approx(height)


def test_a_law_that_samples_the_springs_moves_as_they_do() -> None:
    springs = linked()
    d = np.linspace(1e-3, 0.012, 12)
    force = np.pi * 3e5 * d**2
    law = sp.MeasuredLaw(d, force)
    assert law.misfit < 1e-9
    exact = sp.simulate(springs, formulation="projected").q
    for other in (law, sp.PowerLaw(np.pi * 3e5, 2.0), sp.ParallelSprings(3e5)):
        scene = replace(springs, hand=sp.Hand(tip=sp.Fingertip(law=other)))
        assert np.abs(sp.simulate(scene, formulation="projected").q - exact).max() < 1e-9
    assert sp.Fingertip(law=sp.ParallelSprings(2e5)) == sp.Fingertip(youngs_modulus=2e5)


@pytest.mark.parametrize(
    "law", [sp.PowerLaw(164033.0, 1.67, 1e-4), MEASURED], ids=["power", "measured"]
)
def test_a_sheared_tip_that_just_touches_is_as_stiff_as_one_that_presses(law: Any) -> None:
    """Its compression rounds to zero at the first angle; F''' of a power law jumps there."""
    scene = sp.Scene(hand=sp.Hand(tip=sp.Fingertip(law=law)), initial="touching", duration=0.01)
    found = []
    for angle in (1e-17, -1e-12, 1e-12):
        q = np.array([0.0, 0.0762, 0.0, angle, angle, 0.0, 0.0, 2e-3, 1e-3])
        found.append(sp.linearize(scene, sp.State(q=q, p=np.zeros(9))).A)
    off = min(np.abs(found[0] - beside).max() for beside in found[1:])
    assert off < 1e-6 * np.abs(found[0]).max()


def test_arcs_soften_the_tips_unless_they_are_told_not_to() -> None:
    forces = {}
    for counterface in ("flat", "cylinder", "sphere"):
        side = sp.Arc(0.025, counterface=counterface)
        scene = jaws(grasped=replace(BOTTLE, right=side, left=side))
        state = sp.State.consistent(scene, fingers=(3e-3, 3e-3))
        terms = sp.evaluate(replace(scene, initial=state), 0.0, state.q, state.p)
        forces[counterface] = terms.forces.elastic[5]
    share = 1.0 + 0.02 / 0.025
    assert forces["cylinder"] / forces["flat"] == pytest.approx(share**-0.5)
    assert forces["sphere"] / forces["flat"] == pytest.approx(1.0 / share)
    assert "arcs soften the tips to 0.745 and 0.745" in str(sp.explain(jaws(grasped=BOTTLE)))


def test_swings_of_a_free_jaw_grow_by_its_mass() -> None:
    """With u = -K_D v held for T, v grows by 1 - K_D T / m: beyond -1 for K_D T > 2 m."""
    for kd, grows in ((190.0, False), (250.0, True)):
        scene = jaws(control=sp.SampledController.pid(1e-3, kp=0.0, kd=kd, ki=0.0))
        assert any("swings ever wider" in text for text in scene._suspicions) == grows


@pytest.mark.parametrize("angle", [0.2, -0.2])
def test_jaws_squeeze_a_wedge_out_below_its_angle_of_friction(angle: float) -> None:
    """Above it the faces carry the weight: M g = 2 (lambda_N cos beta + lambda_H sin beta)."""
    tip = sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)
    wedge = sp.GraspedObject.wedge(width=0.049, height=0.05, mass=0.05, angle=angle)
    held = sp.Scene(
        hand=sp.Hand(right=sp.Jaw(), left=sp.Jaw(), tip=tip),
        grasped=wedge,
        control=STIFF,
        schedule=sp.Schedule.steps([0.0], [[0.003, 0.003]]),
        contact="unilateral",
        friction=3.0 * np.tan(abs(angle)),
        duration=0.3,
    )
    run = sp.simulate(held, dt=1e-4, record=EVERYTHING)
    assert run.status == "completed"
    assert not run.contact_changes
    normal, tangential = run.multipliers[-1, 0], run.multipliers[-1, 2]
    weight = 2.0 * (tangential * np.cos(angle) + normal * np.sin(angle))
    assert weight == pytest.approx(wedge.mass * held.gravity, rel=1e-6)
    slippery = sp.simulate(replace(held, friction=0.3 * np.tan(abs(angle))), dt=1e-4)
    moved = slippery.q[-1, 1] - slippery.q[0, 1]
    assert len(slippery.contact_changes) > 0
    assert slippery.status == ("completed" if angle > 0.0 else "lost")
    assert moved * angle > 0.0
    assert abs(moved) > 5e-3


def test_a_disc_rolls_between_jaws_of_which_one_moves_along_it() -> None:
    """Without shear its middle moves half as far, and it turns by the way over the diameter."""
    radius, way = 0.03, 1e-5
    rail = sp.Jaw(root_offset=radius + 0.0205, direction=np.pi / 2, half_thickness=0.004)
    disc = sp.GraspedObject.disc(diameter=2 * radius, mass=0.1)
    scene = sp.Scene(
        hand=sp.Hand(right=rail, left=rail),
        grasped=disc,
        fingers="driven",
        schedule=sp.Schedule.minimum_jerk([0.0, 0.1], [[0.0, 0.0], [way, 0.0]], move_time=0.2),
        gravity=0.0,
        duration=0.5,
    )
    run = sp.simulate(scene, dt=1e-4, formulation="nullspace")
    (_, y, turn), (right, left) = run.q[-1, :3] - run.q[0, :3], run.q[-1, 7:] - run.q[0, 7:]
    assert abs(y - radius * turn + left) < 1e-3 * way
    assert abs(y - way + radius * turn + right) < 1e-3 * way
    assert abs(turn) > 0.3 * way / (2.0 * radius)


RAIL = sp.Jaw(root_offset=0.0505, direction=np.pi / 2, half_thickness=0.004)
ROLLING = {
    "a disc between jaws": (
        sp.Hand(right=RAIL, left=RAIL),
        sp.GraspedObject.disc(diameter=0.06, mass=0.1),
        [[0.0, 0.0], [0.018, -0.018]],
    ),
    "an arc and a face": (
        sp.Hand(),
        sp.GraspedObject(right=sp.Arc(0.04, (-0.0155, 0.004)), left=sp.Face(tilt=0.05)),
        [[0.05, 0.08], [0.25, -0.1]],
    ),
}


@pytest.mark.parametrize("name", ROLLING)
def test_the_way_on_the_side_is_that_on_the_tip_and_the_shear(name: str) -> None:
    """No slip by arc lengths, from positions alone: dl = (a - d_n) d theta_p + d d_t."""
    hand, grasped, targets = ROLLING[name]
    moves = sp.Schedule.minimum_jerk([0.0, 0.1], targets, move_time=0.3)
    scene = sp.Scene(hand=hand, grasped=grasped, fingers="driven", schedule=moves, duration=0.5)
    times = np.linspace(0.0, 0.5, 4001)
    run = sp.simulate(scene, 1e-3, "dop853", "nullspace", times=times)
    found, (cos, sin) = contacts(scene, run.q), (np.cos(run.q[:, 2]), np.sin(run.q[:, 2]))
    assert np.ptp(found.tilts, axis=0).min() > 0.25
    for side, sign in enumerate((-1.0, 1.0)):
        x, y = (found.centres[:, side] - run.q[:, :2]).T
        x, y = x * cos + y * sin, y * cos - x * sin
        shape = (grasped.right, grasped.left)[side]
        if isinstance(shape, sp.Arc):
            far, up = sign * (shape.center[0] - x), y - shape.center[1]
            way = shape.radius * np.arctan2(up, far)
        else:
            assert isinstance(shape, sp.Face)
            way = y * np.cos(shape.tilt) - sign * x * np.sin(shape.tilt)
        arm = scene.hand.tips[side].radius - run.q[:, 5 + side]
        turn = np.diff(found.tilts[:, side])
        rolled = np.append(0.0, np.cumsum(0.5 * (arm[1:] + arm[:-1]) * turn))
        assert np.ptp(way) > 2e-3
        # The trapezoids' error falls to a quarter with twice the rows.
        assert np.ptp(way - rolled - run.q[:, 7 + side]) < 3e-10


ARC, FACE = sp.Arc(0.03, (-0.05, 0.0)), sp.Face(tilt=-0.6, height=0.08)
APART: list[tuple[tuple[Any, Any], str]] = [
    ((ARC, sp.Arc(0.03, (0.05, 0.0))), "-40 mm apart"),
    ((sp.Arc(0.03, (-0.03, 0.0)), sp.Arc(0.03, (0.03, 0.0))), "0 mm apart"),
    ((ARC, None), ""),
    ((FACE, sp.Face(tilt=-0.6, height=0.09)), ""),
    ((FACE, sp.Face(tilt=-0.9, height=0.09)), r"49 mm apart at their middles, -5\.387 mm at"),
]


@pytest.mark.parametrize(("sides", "says"), APART)
def test_sides_that_cross_are_refused(sides: tuple[Any, Any], says: str) -> None:
    scene = jaws(grasped=sp.GraspedObject(right=sides[0], left=sides[1]), duration=1e-3)
    for used in (sp.Scene.start, sp.simulate, lambda s: sp.monte_carlo(s, 2, progress=False)):
        with pytest.raises(ValueError, match=f"its sides are {says}") if says else nullcontext():
            used(scene)


def test_endless_faces_may_cross_somewhere() -> None:
    jaws(grasped=sp.GraspedObject(right=sp.Face(tilt=0.6), left=sp.Face(tilt=0.6))).start()


def test_links_that_are_almost_level_are_found_and_jaws_under_forces_have_no_rest() -> None:
    """A level link moves its tip across the object: the gap there is round-off for long steps."""
    link = sp.Parallelogram(length=0.03, root_offset=0.075)
    for radius in (0.0165, 0.0161, 0.01605, 0.0160):
        hand = sp.Hand(right=link, left=link, tip=sp.Fingertip(radius=radius))
        scene = sp.Scene(hand=hand, initial="touching")
        start = scene.start()
        residuals = sp.evaluate(scene, 0.0, start.q, start.p).residuals
        assert np.abs(residuals[:2]).max() < 1e-15
    forced = sp.Scene(hand=sp.Hand(right=sp.Jaw(), left=sp.Jaw()), control=sp.Torque())
    for limits in (sp.equilibrium, sp.wrench_limits):
        with pytest.raises(ValueError, match=r"scene\.control: Torque gives two jaws"):
            limits(forced)
