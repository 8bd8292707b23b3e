"""The core's unilateral contact against the oracle's: events, the end, forces, the ledger."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings

import softpinch as sp
from contact_scenes import EVERYTHING, UNHURRIED, check, grasps, perturbed, sequence, settled
from oracle import Change, UnilateralReference, unilateral
from random_pinches import random_pinch
from scenes import uneven
from softpinch import paper
from softpinch.scene import outline

METHODS: list[dict[str, Any]] = [
    {"tolerance": 1e-12, "method": "dop853", "formulation": "csm"},
    {"tolerance": 1e-12, "method": "dop853", "formulation": "projected"},
    {"dt": 2e-5, "method": "dop853", "formulation": "projected"},
]
# A run that magnifies a change of its start by more than this is chaotic.
GROWTH = 100.0
SIDES = ("right", "left")
CODES = {"free": 0, "stick": 1, "slip+": 2, "slip-": 2, "graze": 3}


def simulated(scene: sp.Scene, **options: Any) -> sp.Run:
    return sp.simulate(scene, record=EVERYTHING, **options)


def calm(scene: sp.Scene, run: sp.Run) -> bool:
    """Whether a change of the start by 1e-9 changes no mode, and the end by little."""
    other = simulated(perturbed(scene, 1e-9), **METHODS[1])
    if other.status != run.status or sequence(other) != sequence(run):
        return False
    change = np.abs(run.q[-1] - other.q[-1]).max(), np.abs(run.p[-1] - other.p[-1]).max()
    return bool(change[0] < GROWTH * 1e-9 and change[1] < GROWTH * 1e-7)


def merged(changes: list[Change]) -> list[tuple[float, int, int]]:
    """Time and modes of a finger's changes; several at one instant are one."""
    found: list[tuple[float, int, int]] = []
    for change in changes:
        time, before, after = change.time, CODES[change.before], CODES[change.after]
        if found and time - found[-1][0] <= 1e-12:
            time, before, _ = found.pop()
        if before != after or before == CODES["slip+"]:
            found.append((time, before, after))
    return found


def compare(run: sp.Run, ours: UnilateralReference, share: float = 1.0) -> None:
    """Compares changes of mode, the end and the ledger; `share` makes all tolerances smaller."""
    assert run.status == ours.status
    assert run.t[-1] == pytest.approx(ours.end.t, abs=1e-8 * share)
    assert run.holds == ours.holds
    for finger in SIDES:
        found = settled(run, finger)
        theirs = merged([c for c in ours.changes if c.finger == finger])
        assert [e[1:] for e in found] == [e[1:] for e in theirs]
        times = [e[0] for e in found]
        np.testing.assert_allclose(times, [e[0] for e in theirs], rtol=0, atol=1e-8 * share)
    # Speeds are a few m/s and rad/s, forces some 100 N.
    for name, rtol, atol in (("q", 0.0, 1e-8), ("p", 1e-8, 1e-7), ("multipliers", 1e-7, 1e-5)):
        end, expected = getattr(run, name)[-1], getattr(ours.end, name)
        np.testing.assert_allclose(end, expected, rtol=rtol * share, atol=atol * share)
    codes = [CODES[mode] for mode in ours.end.modes]
    assert run.contact[-1].tolist() == codes
    ledger = run.energy
    small = 1e-8 * share * ledger.exchanged
    book = ours.ledger
    assert ledger.friction_loss[-1] == pytest.approx(book["friction"], abs=small)
    assert ledger.impact_loss[-1] == pytest.approx(book["impact"] + book["stop"], abs=small)
    assert ledger.relaxation_work[-1] == pytest.approx(
        book["relaxation"] + book["graze"], abs=small
    )
    assert ledger.viscous_loss[-1] == pytest.approx(-book["viscous"], abs=small)
    assert ledger.controller_work[-1] == pytest.approx(book["torque"], abs=small)
    assert ledger.external_work[-1] == pytest.approx(book["external"] + book["impulse"], abs=small)


def agree(scene: sp.Scene) -> None:
    """Compares all METHODS with the oracle."""
    ours = unilateral(scene)
    for options in METHODS:
        run = simulated(scene, **options)
        # Where a mode whose event was located goes on after all, its end is found at a 1024th of
        # the next step, which an adaptive method may make long.
        compare(run, ours)
        check(run)


@settings(max_examples=4, **UNHURRIED)
@given(grasps(duration=0.012))
def test_the_core_and_the_oracle_agree_on_events_and_the_end(scene: sp.Scene) -> None:
    run = simulated(scene, **METHODS[1])
    assume(len(run.contact_changes) >= 2 and calm(scene, run))
    agree(scene)


@pytest.mark.slow
@settings(max_examples=60, **UNHURRIED)
@given(grasps(duration=0.04))
def test_the_core_and_the_oracle_agree_on_many_scenes(scene: sp.Scene) -> None:
    assume(calm(scene, simulated(scene, **METHODS[1])))
    agree(scene)


def broken(status: str) -> sp.Scene:
    """A push that presses a tip flat, or an object that turns between fingers at 84 degrees."""
    if status == "crushed":
        push = sp.Step(time=0.002, force=(300.0, 5.0))
        tip = sp.Fingertip(normal_mass=0.02, tangential_mass=0.02, youngs_modulus=1e5)
        hand = sp.Hand(right=sp.Finger(length=0.079), tip=tip)
        return of_the_paper(0.5, hand=hand, disturbances=(push,), duration=0.03)
    law = sp.PowerLaw(2e4, 1.5, foot=1e-5)
    tip = sp.Fingertip(normal_mass=0.02, tangential_mass=0.02, law=law)
    tilt, finger = np.deg2rad(84.0), sp.Finger()
    reach = outline.inward(finger, tilt) + tip.radius + 0.5 * sp.GraspedObject().width
    wide = replace(finger, root_offset=reach - 1e-3)
    scene = sp.Scene(
        contact="unilateral",
        friction=0.8,
        hand=sp.Hand(right=wide, left=wide, tip=tip),
        control=sp.Pid(kp=0.0, kd=0.0, ki=0.0),
        schedule=sp.Schedule.steps([0.0], [[tilt, tilt]]),
        duration=0.015,
    )
    turning: dict[str, Any] = {"finger_rates": (5.0, 2.0), "velocity": (0.0, 0.0, -120.0)}
    place: dict[str, Any] = {"x": 0.0, "y": outline.upward(wide, tilt), "fingers": (tilt, tilt)}
    return replace(scene, initial=sp.State.consistent(scene, **place, **turning))


@pytest.mark.parametrize("status", ["crushed", "folded"])
def test_a_tip_is_crushed_or_folded_at_its_own_instant(status: str) -> None:
    """Not at the end of a step, and in lanes as alone."""
    scene = broken(status)
    agree(scene)
    end, step = unilateral(scene).end.t, 3e-4 if status == "crushed" else 1e-4
    for method in ("rk4", "radau5" if status == "crushed" else "rosenbrock"):
        run = simulated(scene, dt=step, method=method)
        assert run.status == status and f"at t = {run.t[-1]:.6g} s" in run.message
    study = sp.monte_carlo(scene, 9, vary={"friction": np.linspace(0.5, 0.9, 9)}, dt=step)
    for k in (0, 8):
        alone = simulated(study.scene_of(k), dt=step)
        assert study.end_time[k] == alone.t[-1] == alone.violations[status]
        assert alone.violation_intervals[status].tolist() == [[alone.t[-1], alone.t[-1]]]
    # Where it is not to end the run, the run goes on.
    assert simulated(scene, dt=step, stop_on=()).t[-1] > end


# The paper's parameters, faces 49 mm high, and the frictions between which its operations differ.
FRICTIONS = (0.3, 0.5, 0.8, 1.0)
OPERATIONS = paper.manipulation().schedule.angles


def of_the_paper(friction: float, **changes: Any) -> sp.Scene:
    grasped = sp.GraspedObject(height=0.049)
    return sp.Scene(grasped=grasped, contact="unilateral", friction=friction, **changes)


def disturbed(case: str, friction: float, duration: float) -> sp.Scene:
    scene = paper.disturbance(case)
    changes = {"schedule": scene.schedule, "disturbances": scene.disturbances}
    return of_the_paper(friction, duration=duration, **changes)


def follows(scene: sp.Scene) -> sp.Run:
    """Compares one exact run with the oracle and returns it."""
    ours = unilateral(scene)
    run = simulated(scene, **METHODS[1])
    compare(run, ours)
    return run


def kicked(
    scene: sp.Scene, *disturbances: sp.Disturbance, friction: Any, **changes: Any
) -> sp.Scene:
    """A scene that is disturbed while its fingers hold the object at 6 degrees."""
    held = sp.Schedule.steps([0.0], np.deg2rad([[6, 6]]))
    return replace(
        scene,
        grasped=replace(scene.grasped, height=0.049),
        contact="unilateral",
        friction=friction,
        disturbances=disturbances,
        **{"schedule": held, "duration": 0.05, **changes},
    )


def beside(gap: float, coordinates: dict[int, float], rates: dict[int, float]) -> dict[str, Any]:
    """Heavy upright fingers whose tips miss the object by a gap, and a state by its entries."""
    q, p = np.zeros(9), np.zeros(9)
    q[1] = sp.Finger().length
    q[list(coordinates)], p[list(rates)] = [*coordinates.values()], [*rates.values()]
    finger = sp.Finger(mass=1e-9, inertia=50.0, root_offset=0.049 + gap)
    return {"hand": sp.Hand(right=finger, left=finger), "initial": sp.State(q, p)}


# The jump of its targets lets the left tip go, which stuck; it grazes, and slips then.
LET_GO = sp.Scene(
    hand=sp.Hand(
        right=sp.Finger(
            length=0.0756, root_offset=0.0424, half_thickness=0.00437, mass=0.111, inertia=6.64e-4
        ),
        left=sp.Finger(length=0.07, root_offset=0.0452, inertia=6.67e-4),
        tip=(
            sp.Fingertip(
                radius=0.0205, youngs_modulus=2.386e5, tangential_viscosity=99.5,
                normal_mass=0.0656, tangential_mass=0.0521,
            ),
            sp.Fingertip(
                radius=0.0205, youngs_modulus=2e5, normal_viscosity=87.0,
                tangential_viscosity=101.5, normal_mass=0.1, tangential_mass=0.1486,
            ),
        ),
    ),
    grasped=sp.GraspedObject(width=0.045, mass=0.08, inertia=4.79e-5, com_offset=9.65e-4),
    control=(sp.Pid(), sp.Pid(kp=103.0, kd=1.3)),
    schedule=sp.Schedule.steps([0.0, 0.015], [[0.0965, 0.1217], [-0.026, 0.017]]),
    disturbances=[
        sp.Pulse(time=0.006, duration=0.0075, moment=2.2),
        sp.Step(time=0.0, force=(18.0, 7.0)),
    ],
    duration=0.02,
    contact="unilateral",
    friction=(0.174, 1.124),
)  # fmt: skip
PUSH = sp.Step(time=0.02, force=(130.0, 130.0), moment=5.0)
TURN = sp.Pulse(time=0.02, duration=0.01, moment=27.6)
KICK = sp.Impulse(time=0.02, impulse=(0.4, 0.3), angular_impulse=5e-4)
SCENES = {
    "all modes": kicked(
        sp.Scene(hand=sp.Hand(right=sp.Finger(inertia=6e-4), left=sp.Finger(mass=0.12))),
        sp.Pulse(time=0.01, duration=0.006, force=(120.0, 60.0), moment=2.0),
        friction=(0.4, 0.6),
        duration=0.022,
    ),
    "impulse": kicked(sp.Scene(), KICK, friction=0.4),
    "impulse on unequal fingers": kicked(uneven(), KICK, friction=(0.4, 0.3)),
    "turn of unequal fingers": kicked(uneven(), TURN, friction=(0.8, 0.6)),
    "driven fingers": kicked(
        sp.Scene(fingers="driven"),
        sp.Pulse(time=0.03, duration=0.01, force=(80.0, 30.0), moment=2.0),
        friction=0.3,
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.0137], np.deg2rad([[5, 6], [8, 4]]), move_time=0.0411
        ),
    ),
    "impact on a driven finger": kicked(
        sp.Scene(fingers="driven", gravity=0.0),
        friction=0.0,
        schedule=sp.Schedule.minimum_jerk(
            [0.0, 0.001], np.deg2rad([[0, 0], [4, 0]]), move_time=0.04
        ),
        duration=0.06,
        **beside(0.003, {1: 0.0792, 2: 0.05}, {1: 0.02, 2: 0.4}),
    ),
    "a free tip relaxes beside a face that turns": kicked(
        sp.Scene(gravity=0.0, control=sp.Pid(kp=0.0, kd=0.0, ki=0.0)),
        friction=0.5,
        **beside(0.03, {3: 0.3, 4: -0.1, 5: 0.006, 7: 0.002}, {2: 0.5}),
    ),
    "a free surface that comes to zero stops": kicked(
        sp.Scene(), friction=0.5, duration=0.01, **beside(0.01, {6: 1e-4, 8: 1e-5}, {6: -2.0})
    ),
    "a tip that stuck grazes": LET_GO,
    "the switch into the second operation": of_the_paper(
        0.5, schedule=sp.Schedule.steps([0.0, 0.2], OPERATIONS[:2]), duration=0.22
    ),
    "case (i)": kicked(sp.Scene(), replace(PUSH, time=0.2), friction=0.5, duration=0.3),
}
MODES = {
    "all modes": "free stick slip graze",
    "a tip that stuck grazes": "slip graze",
    "the switch into the second operation": "free stick slip",
}
STATUSES = {"case (i)": "lost", "turn of unequal fingers": "lost"}


@pytest.mark.parametrize("name", SCENES)
def test_the_core_and_the_oracle_agree_on_a_scene(name: str) -> None:
    run = follows(SCENES[name])
    assert run.status == STATUSES.get(name, "completed")
    after = {change.after.name.lower() for change in run.contact_changes}
    assert after >= set(MODES.get(name, "").split())
    if name == "all modes":
        agree(SCENES[name])


def test_two_contacts_that_open_each_other_in_turn_settle_as_in_the_oracle() -> None:
    """Each collision of the left tip opens the right one, with an eighth of the speed.

    The oracle goes through the collisions one by one, the core sums the last of them.
    """
    scene = kicked(sp.Scene(), PUSH, friction=5.0)
    ours, run = unilateral(scene), simulated(scene, **METHODS[1])
    assert run.holds and ours.holds
    times = [change.time for change in ours.changes if change[1:] == ("right", "stick", "free")]
    apart = np.diff(times)
    np.testing.assert_allclose(apart[1:4] / apart[:3], 0.135, atol=0.05)
    np.testing.assert_allclose(run.q[-1], ours.end.q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(run.p[-1], ours.end.p, rtol=0, atol=1e-6)
    check(run)


# Random scenes of unlike hands with a series of flights, each shorter by the same factor.
SERIES = (2613, 2720, 3473, 3761, 4022, 6074, 7021, 9291, 10042, 10347)
SERIES += (10614, 10706, 10875, 11342, 11713, 11842, 12765, 13193, 13201, 13985)
QUICK = (2720, 3473, 10706)


@pytest.mark.parametrize(
    "seed", [*QUICK, *(pytest.param(k, marks=pytest.mark.slow) for k in SERIES if k not in QUICK)]
)
def test_the_rest_of_a_series_of_flights_is_summed(seed: int) -> None:
    """The oracle goes through the flights one by one, down to 1e-6 m/s."""
    scene = random_pinch(np.random.default_rng(seed), "unilateral", 0.03)
    ours, run = unilateral(scene), simulated(scene, **METHODS[1])
    assert run.status == ours.status != "chattering"
    np.testing.assert_allclose(run.q[-1], ours.end.q, rtol=0, atol=1e-7)
    np.testing.assert_allclose(run.p[-1], ours.end.p, rtol=0, atol=1e-4)
    # The impulses of a sum have any sign, so that its loss may be negative.
    assert np.abs(run.energy.closure).max() <= 1e-6 * run.energy.exchanged
    masses = scene.grasped.mass * np.linspace(1.0, 1.01, 5)
    study = sp.monte_carlo(scene, 5, vary={"grasped.mass": masses}, dt=1e-4, progress=False)
    for k in (0, 3):
        alone = simulated(study.scene_of(k), dt=1e-4)
        last = np.hstack([alone.q[-1], alone.p[-1]])
        np.testing.assert_array_equal(study["final_state"][k], last)


@pytest.mark.slow
@pytest.mark.parametrize("friction", FRICTIONS)
def test_the_core_and_the_oracle_agree_on_the_eight_operations(friction: float) -> None:
    steps = sp.Schedule.steps(np.arange(8.0), OPERATIONS)
    run = follows(of_the_paper(friction, schedule=steps, duration=8.0))
    assert run.holds and len(run.contact_changes) > 10


@pytest.mark.slow
@pytest.mark.parametrize("friction", FRICTIONS)
@pytest.mark.parametrize("case", paper.CASES)
def test_the_core_and_the_oracle_agree_on_the_disturbances(case: str, friction: float) -> None:
    follows(disturbed(case, friction, 2.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("milliseconds", "slips", "holds"),
    [(30, 0.298, 0.302), (20, 0.302, 0.305), (10, 0.84, 0.86), (7, 5.8, 6.0)],
)
def test_the_core_and_the_oracle_agree_on_the_friction_that_smooth_moves_need(
    milliseconds: int, slips: float, holds: float
) -> None:
    """The hardest switch is that into operation 7."""
    move = 1e-3 * milliseconds
    moves = sp.Schedule.minimum_jerk(np.arange(8.0), OPERATIONS, move_time=move)
    for friction, changes in ((slips, True), (holds, False)):
        run = follows(of_the_paper(friction, schedule=moves, duration=6.0 + 3 * move))
        assert bool(run.contact_changes) == changes


# Of pushes of 10 ms: direction (N, N, N m), friction, and a size near the largest that is held.
PUSHES = [
    ((1.0, 0.0, 0.0), 0.5, 232.0),
    ((0.0, 1.0, 0.0), 0.8, 125.0),
    ((0.0, -1.0, 0.0), 0.3, 63.0),
    ((0.0, 0.0, 1.0), 0.5, 16.5),
    ((1.0, 1.0, 5.0 / 130.0), 0.8, 358.0),
]


@pytest.mark.slow
@pytest.mark.parametrize(("direction", "friction", "near"), PUSHES)
def test_the_core_and_the_oracle_agree_on_the_largest_push_that_is_held(
    direction: tuple[float, float, float], friction: float, near: float
) -> None:
    def pushed(size: float) -> sp.Scene:
        x, y, turn = (size * part for part in direction)
        pulse = sp.Pulse(time=1.0, duration=0.01, force=(x, y), moment=turn)
        return of_the_paper(friction, disturbances=[pulse], duration=1.51)

    low, high = 0.9 * near, 1.1 * near
    for _ in range(6):
        middle = 0.5 * (low + high)
        if sp.simulate(pushed(middle), every=10**6).holds:
            low = middle
        else:
            high = middle
    for size, holds in ((0.99 * low, True), (1.01 * high, False)):
        scene = pushed(size)
        assert unilateral(scene).holds == holds
