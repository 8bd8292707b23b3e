"""Numbers that are likely in another unit: a warning, and none for anything that is real."""

import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given

import softpinch as sp
from softpinch import paper, strategies, stress
from softpinch.accuracy.stability_axes import AXES
from softpinch.scene import paths, usual

raw: Any = sp


def tip(**changes: Any) -> sp.Scene:
    return sp.Scene(hand=sp.Hand(tip=sp.Fingertip(**changes)), duration=1e-3)


SLIPS = [
    (
        tip(youngs_modulus=0.3),
        r"^hand\.tip\.youngs_modulus = 0\.3 Pa: usual is from 1000 to 1e\+13 Pa",
    ),
    (
        tip(radius=20.0),
        r"^hand\.tip\.radius = 20 m: usual is from 1e-05 to 1 m; is it in another unit",
    ),
    (
        sp.Scene(schedule=sp.Schedule.steps([0.0], [[6.0, -7.0]])),
        r"^schedule\.angles\.0\.1 = -7 rad: usual is from -1\.57\d* to 1\.57\d* rad; .*deg2rad",
    ),
    (sp.Scene(friction=50.0), r"^friction = 50: usual is from 0 to 30; "),
    (sp.Scene(friction=(0.5, 50.0)), r"^friction\.left = 50: usual is from 0 to 30; "),
    (sp.Scene(control=(sp.Pid(), sp.Pid(kp=1e7))), r"^control\.left\.kp = 1e\+07 N m/rad: "),
    (
        sp.Scene(hand=sp.Hand(tip=(sp.Fingertip(), sp.Fingertip(radius=20.0)))),
        r"^hand\.tip\.left\.radius = 20 m: ",
    ),
    (
        sp.Scene(disturbances=[sp.Step(time=0.0), sp.Sine(frequency_hz=1.0, phase=90.0)]),
        r"^disturbances\.1\.phase = 90 rad: ",
    ),
]


CURVE = np.array([1.0, 2.0, 4.0, 8.0])
POLE = (
    r"law\.exponent = 1\.2: below 2 a run can end .* has a pole there; give .*such as foot=1e-4 m"
)
UNITS = r"law: is as stiff as springs with a modulus of .* usual is from 1000 .*in m and N\?"
# F = pi E d^2 with E = 0.3 MPa.
LAWS: list[tuple[Any, str]] = [
    (sp.PowerLaw(1.6e5, 1.2), POLE),
    (sp.PowerLaw(1.6e5, 1.2, 0.0), POLE),
    (sp.MeasuredLaw(CURVE, 0.94 * CURVE**2), UNITS),  # mm
    (sp.MeasuredLaw(1e-3 * CURVE, 0.94e-3 * CURVE**2), UNITS),  # kN
    (sp.PowerLaw(0.94, 2.0), UNITS),  # N/mm^2
]


@pytest.mark.parametrize(("law", "message"), LAWS)
def test_a_law_with_a_pole_or_in_other_units_is_a_warning(law: Any, message: str) -> None:
    scene = tip(law=law)
    with pytest.warns(sp.SuspiciousValueWarning, match=rf"^hand\.tip\.{message}") as caught:
        usual.warn(scene)
    assert len(caught) == 1
    left = replace(scene.hand, tip=(sp.Fingertip(), sp.Fingertip(law=law)))
    with pytest.warns(sp.SuspiciousValueWarning, match=rf"^hand\.tip\.left\.{message}") as caught:
        usual.warn(replace(scene, hand=left))
    assert len(caught) == 1


@pytest.mark.parametrize(
    "law",
    [
        sp.PowerLaw(1.6e5, 1.2, 1e-5),
        sp.PowerLaw(9.4e5, 2.0),
        sp.MeasuredLaw(1e-3 * CURVE, 0.94 * CURVE**2),
    ],
)
def test_sound_laws_are_not_suspicious(law: Any) -> None:
    assert not usual.suspicions(tip(law=law))


@pytest.mark.parametrize(("scene", "message"), SLIPS, ids=[message for _, message in SLIPS])
def test_a_slip_is_a_warning_with_field_value_and_range(scene: sp.Scene, message: str) -> None:
    with pytest.warns(sp.SuspiciousValueWarning, match=message):
        usual.warn(scene)
    (only,) = usual.suspicions(scene)
    # What is named is a path that `vary` takes, or one that leads to a number.
    path = only.partition(" = ")[0]
    assert float(paths.resolve(scene, path)) == pytest.approx(float(only.split()[2].rstrip(":")))


def test_runs_and_studies_warn_once_at_the_users_line() -> None:
    scene = tip(youngs_modulus=0.3)
    with pytest.warns(sp.SuspiciousValueWarning, match="youngs_modulus") as caught:
        sp.simulate(scene, 1e-3)
    assert [each.filename for each in caught] == [__file__]
    with pytest.warns(sp.SuspiciousValueWarning, match="youngs_modulus") as caught:
        sp.monte_carlo(scene, 50, vary={"grasped.mass": np.full(50, 0.1)}, dt=1e-3, progress=False)
    assert [each.filename for each in caught] == [__file__]


def test_nothing_that_is_real_is_suspicious() -> None:
    scenes = [paper.manipulation(), *map(paper.disturbance, paper.CASES), sp.Scene()]
    scenes += [case.scene for case in stress.CASES.values()]
    scenes += [
        axis.apply(sp.Scene(), sp.Stabilization(), value)[0]
        for axis in AXES.values()
        for value in axis.values or ()
    ]
    for scene in scenes:
        assert not usual.suspicions(scene)


def solid(half: np.ndarray, inside: Any = None) -> np.ndarray:
    """Points of a uniform body within the half lengths (x, y, z), on a fine grid (n, 3)."""
    axes = [(np.arange(60) + 0.5) / 30.0 - 1.0] * 3
    points = np.stack(np.meshgrid(*axes), -1).reshape(-1, 3) * half
    return points if inside is None else points[inside(points)]


def inertia(points: np.ndarray, mass: float) -> float:
    """About the axis normal to the plane, z, as the mean over the points."""
    return mass * float(np.mean(points[:, 0] ** 2 + points[:, 1] ** 2))


@pytest.mark.parametrize(("width", "height", "mass"), [(0.05, 0.12, 0.3), (0.08, 0.01, 0.02)])
def test_a_box_and_a_cylinder_have_the_inertia_of_their_points(
    width: float, height: float, mass: float
) -> None:
    half = 0.5 * np.array([width, height, height])
    box = sp.GraspedObject.box(width, height, mass)
    assert box.inertia == pytest.approx(inertia(solid(half), mass), rel=1e-3)
    round_ = solid(half, lambda r: np.hypot(r[:, 1], r[:, 2]) <= 0.5 * height)
    cylinder = sp.GraspedObject.cylinder(width, 0.5 * height, mass)
    assert cylinder.inertia == pytest.approx(inertia(round_, mass), rel=1e-3)
    for one in (box, cylinder):
        assert (one.width, one.height, one.mass) == (width, height, mass)
        assert one.com_offset == 0.0
        assert not usual.suspicions(sp.Scene(grasped=one))


OTHER = r"^grasped\.inertia = .* kg m\^2: usual for .* another mass or width\?.*GraspedObject\.box"


@pytest.mark.parametrize(
    "changes",
    [{"mass": 0.25}, {"mass": 0.02, "height": 0.049}, {"width": 0.001}],
    ids=str,
)
def test_an_inertia_given_for_another_mass_or_width_is_a_warning(changes: dict[str, Any]) -> None:
    scene = sp.Scene(duration=1e-3)
    changed = scene.with_({f"grasped.{name}": value for name, value in changes.items()})
    with pytest.warns(sp.SuspiciousValueWarning, match=OTHER):
        usual.warn(changed)
    grasped = changed.grasped
    box = sp.GraspedObject.box(grasped.width, grasped.height or grasped.width, grasped.mass)
    assert not usual.suspicions(changed.with_({"grasped.inertia": box.inertia}))


def test_the_inertia_of_what_is_held_by_its_round_side_is_that_of_a_disc() -> None:
    scene = sp.Scene(
        grasped=replace(sp.GraspedObject.disc(0.06, 0.1), mass=2.0), initial="touching"
    )
    (text,) = usual.suspicions(scene)
    assert text.endswith("another mass or width? GraspedObject.disc(diameter, mass) computes it")


def test_a_micro_gripper_is_usual() -> None:
    """Fingers of 5 mm and 1 mg, and tips of micrograms, on a grain of a third of a milligram."""
    finger = sp.Finger(length=5e-3, root_offset=8e-4, half_thickness=2e-4, mass=1e-6, inertia=8e-12)
    tip = sp.Fingertip(radius=3e-4, normal_mass=3e-8, tangential_mass=3e-8)
    grain = sp.GraspedObject(width=6e-4, mass=3e-7, inertia=2e-14)
    hand = sp.Hand(right=finger, left=finger, tip=tip)
    assert not usual.suspicions(sp.Scene(hand=hand, grasped=grain))


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (0, 76.2, r"^initial\.q\.0 = 76\.2 m: usual is from -10 to 10 m; "),
        (2, 30.0, r"^initial\.q\.2 = 30 rad: usual is from -3\.14\d* to 3\.14\d* rad; .*deg2rad"),
        (5, 5.0, r"^initial\.q\.5 = 5 m: "),
    ],
)
def test_a_state_in_other_units_is_a_warning(place: int, value: float, message: str) -> None:
    q = sp.Scene().start().q.copy()
    q[place] = value
    with pytest.warns(sp.SuspiciousValueWarning, match=message):
        usual.warn(sp.Scene(initial=sp.State(q, check=False)))


@given(strategies.scenes())
def test_nothing_that_strategies_draw_is_suspicious(scene: sp.Scene) -> None:
    found = usual.suspicions(scene)
    # Their first targets may open the fingers.
    assert not [text for text in found if "opens the fingers" not in text]


def closed_to(degrees: float, **changes: Any) -> sp.Scene:
    """Fingers whose roots are 60 mm off: the tips touch where L sin + d_f cos = 60 - 20 - 24.5."""
    finger = sp.Finger(root_offset=0.06)
    schedule = sp.Schedule.in_degrees("steps", [0.0, 0.1], [[degrees, degrees], [0, 0]])
    scene = sp.Scene(
        hand=sp.Hand(right=finger, left=finger), schedule=schedule, initial="touching", friction=1.0
    )
    return replace(scene, **changes)


TOUCHING = math.degrees(math.asin(15.5 / math.hypot(76.2, 4.5)) - math.atan2(4.5, 76.2))


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
def test_a_schedule_that_opens_the_fingers_at_the_start_is_a_warning(contact: str) -> None:
    scene = closed_to(6.0, contact=contact, duration=1e-3)
    asked = f"touching is at {TOUCHING:.4g} degrees, the schedule asks for 6 at the start"
    with pytest.warns(sp.SuspiciousValueWarning, match=f"{asked}: it opens the fingers"):
        run = sp.simulate(scene)
    assert {"separated", "opened"} & set(run.violations)
    assert not usual.suspicions(closed_to(TOUCHING + 1e-3, contact=contact))
    assert usual.suspicions(closed_to(TOUCHING - 1e-3, contact=contact))


def test_fingers_that_are_open_already_or_have_no_target_angles_open_without_a_warning() -> None:
    assert not usual.suspicions(closed_to(6.0, contact="unilateral", initial=None))
    assert not usual.suspicions(closed_to(6.0, control=sp.Torque()))
    # No start at all: an error says so where the scene is simulated.
    assert not usual.suspicions(closed_to(6.0, initial=None))


def test_torques_of_the_default_schedule_are_a_warning() -> None:
    scene = sp.Scene(control=sp.Torque(), duration=1e-3)
    says = r"^schedule: this is the default schedule, .* 0\.105 rad .* Give schedule= in N m"
    study: dict[str, Any] = {"vary": {"gravity": [9.0]}, "dt": 1e-3, "progress": False}
    for simulated in (lambda: sp.simulate(scene, 1e-3), lambda: sp.monte_carlo(scene, **study)):
        with pytest.warns(sp.SuspiciousValueWarning, match=says) as caught:
            simulated()
        assert len(caught) == 1
    # A schedule that differs in any number was given, also one with the same numbers of another
    # kind.
    angles = np.deg2rad([[6.0, 6.0]])
    given = [sp.Schedule.steps([0.0], 2.0 * angles), sp.Schedule.ramps([0.0], angles)]
    for schedule in given:
        assert not usual.suspicions(replace(scene, schedule=schedule))


def test_torques_that_replace_the_default_schedule_are_no_warning() -> None:
    scene = sp.Scene(control=sp.Torque(), duration=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sp.Simulator(scene)
        sp.VectorSimulator(scene, n=2)
        sp.monte_carlo(scene, vary={"schedule.angles": [[[1.2, 1.2]]]}, dt=1e-3, progress=False)
    # Other warnings about the schedule stay.
    degrees = sp.Scene(schedule=sp.Schedule.steps([0.0], [[6.0, 6.0]]))
    with pytest.warns(sp.SuspiciousValueWarning, match=r"^schedule\.angles"):
        usual.warn(degrees, schedule_replaced=True)


def test_targets_that_turn_no_finger_open_none() -> None:
    idle = sp.Scene(control=sp.Pid(kp=0.0, kd=0.0, ki=0.0), duration=1e-3).with_(
        {"schedule": sp.Schedule.steps([0.0], [[-0.1, -0.1]])}
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", sp.SuspiciousValueWarning)
        sp.simulate(idle, dt=1e-3)
    with pytest.warns(
        sp.SuspiciousValueWarning, match="touching is at 0 degrees, .* asks for -5.73"
    ):
        sp.simulate(idle.with_({"control": sp.Pid()}), dt=1e-3)


def moved(begin: float, **kind: Any) -> sp.Scene:
    """A run from `begin` to `begin` + 0.5 s whose hand moves from 1 to 1.5 s."""
    times, start = [1.0, 1.5], replace(sp.Scene().start(), time=begin)
    motion = sp.HandMotion.minimum_jerk(times, [[0.0, 0.0], [0.1, 0.0]])
    if kind:
        motion = sp.HandMotion.sampled(times, **kind)
    return sp.Scene(initial=start, duration=0.5, motion=motion)


@pytest.mark.parametrize("begin", [0.0, 0.5, 1.6, 2.0])
def test_a_motion_beside_the_run_is_a_warning(begin: float) -> None:
    message = rf"^motion\.times: .* 1 to 1\.5 s.* from {begin:g} to {begin + 0.5:g} s"
    with pytest.warns(sp.SuspiciousValueWarning, match=message) as caught:
        sp.simulate(moved(begin), dt=1e-3)
    assert len(caught) == 1


def test_a_motion_that_overlaps_the_run_or_is_held_after_it_is_no_warning() -> None:
    assert not any(usual.suspicions(moved(begin)) for begin in (0.6, 1.0, 1.4, 1.5))
    held: dict[str, Any] = {"accelerations": [[1.0, 0.0], [2.0, 0.0]], "hold": True}
    assert not usual.suspicions(moved(2.0, **held)) and usual.suspicions(moved(0.0, **held))
    assert not usual.suspicions(replace(moved(2.0), motion=sp.HandMotion.sine(0.01, 5.0, "x")))
