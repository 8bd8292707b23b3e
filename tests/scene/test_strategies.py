"""The strategies for users: they give what they say and shrink to the paper's values."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
import pytest
from hypothesis import Phase, find, given, settings
from hypothesis import strategies as st

import softpinch as sp
from softpinch import strategies as sps
from softpinch.scene.disturbance import DISTURBANCES
from softpinch.scene.motion import MOTIONS
from softpinch.scene.schedule import KINDS

T = TypeVar("T")
STILL = sp.HandMotion.minimum_jerk([0.0], [[0.0, 0.0]])
SIMPLEST = [
    (sps.fingers(), sp.Finger()),
    (sps.fingertips(), sp.Fingertip()),
    (sps.hands(), sp.Hand()),
    (sps.hands(symmetric=True), sp.Hand()),
    (sps.grasped_objects(), sp.GraspedObject()),
    (sps.pids(), sp.Pid()),
    (sps.stabilizations(), sp.Stabilization()),
    (sps.schedules(), sp.Scene().schedule),
    (sps.disturbances(), sp.Step(time=0.0)),
    (sps.motions(), STILL),
    (sps.scenes(duration=1.0), sp.Scene()),
    (sps.scenes(duration=1.0, acceleration=5.0), sp.Scene(motion=STILL)),
    (sps.scenes(duration=1.0, symmetric=True), sp.Scene()),
]


def shrunk(strategy: st.SearchStrategy[T], wanted: Callable[[T], bool] = lambda _: True) -> T:
    """The simplest example with this property, without a hundred more to explain it."""
    phases = [Phase.generate, Phase.shrink]
    return find(strategy, wanted, settings=settings(max_examples=2000, phases=phases))


@pytest.mark.parametrize(("strategy", "simplest"), SIMPLEST, ids=[repr(s) for _, s in SIMPLEST])
def test_examples_shrink_to_the_papers_values(
    strategy: st.SearchStrategy[object], simplest: object
) -> None:
    assert shrunk(strategy) == simplest


def test_a_failing_example_keeps_only_what_makes_it_fail() -> None:
    heavy = shrunk(sps.grasped_objects(), lambda grasped: grasped.mass > 0.15)
    assert heavy == sp.GraspedObject(mass=heavy.mass)
    uneven = shrunk(sps.hands(), lambda hand: hand.left != hand.right)
    assert uneven == replace(sp.Hand(), left=uneven.left)


def falsified(strategy: st.SearchStrategy[T], holds: Callable[[T], bool]) -> tuple[str, T]:
    """The text that Hypothesis prints of the example with which a test fails, and the example."""
    drawn = []

    @settings(max_examples=500, phases=[Phase.generate, Phase.shrink])
    @given(example=strategy)
    def fails(example: T) -> None:
        drawn.append(example)
        assert holds(example)

    with pytest.raises(AssertionError) as found:
        fails()
    return "\n".join(found.value.__notes__), drawn[-1]


PRINTED = [
    (sps.fingers(), lambda finger: finger.length < 0.1),
    (sps.hands(), lambda hand: hand.left.mass == hand.right.mass),
    (sps.schedules(), lambda schedule: len(schedule.times) < 2 or schedule.angles[1, 0] < 0.11),
    (sps.disturbances(kinds=["sampled"]), lambda sampled: not sampled.moment.any()),
    (sps.motions(), lambda motion: not isinstance(motion, MOTIONS["jerk_limited"])),
    (sps.motions(kinds=["sampled"]), lambda motion: motion.accelerations is None),
    (sps.scenes(contact="unilateral"), lambda scene: not isinstance(scene.friction, tuple)),
    (sps.consistent_states(sp.Scene()), lambda state: state.q[2] < 0.01),
]


@pytest.mark.parametrize(("strategy", "holds"), PRINTED)
def test_the_text_of_an_example_can_be_pasted(
    strategy: st.SearchStrategy[object], holds: Callable[[object], bool]
) -> None:
    text, example = falsified(strategy, holds)
    assert eval("dict" + text.partition("fails")[2], vars(sp).copy()) == {"example": example}


def exists(strategy: st.SearchStrategy[T], wanted: Callable[[T], bool]) -> T:
    """Some example with this property, not shrunk."""
    return find(strategy, wanted, settings=settings(max_examples=500, phases=[Phase.generate]))


def decades(value: float, paper: float) -> float:
    return abs(math.log10(value / paper))


@given(sps.fingers(1.5), sps.fingertips(1.5), sps.pids(1.5), sps.stabilizations(1.5))
def test_parameters_stay_within_the_spread(
    finger: sp.Finger, tip: sp.Fingertip, pid: sp.Pid, gains: sp.Stabilization
) -> None:
    assert decades(finger.length, sp.Finger().length) <= 1.5 + 1e-12
    assert decades(tip.youngs_modulus, sp.Fingertip().youngs_modulus) <= 1.5 + 1e-12
    assert tip.tilt_coupling in (1.0, 0.0, -1.0)
    assert decades(pid.ki, sp.Pid().ki) <= 1.5 + 1e-12
    assert decades(gains.beta, sp.Stabilization().beta) <= 1.5 + 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_schedule_comes_with_several_knots(kind: str) -> None:
    schedule = exists(sps.schedules(), lambda s: s.kind == kind and len(s.times) > 2)
    assert shrunk(sps.schedules(kinds=(kind,))).kind == schedule.kind


@pytest.mark.parametrize("kind", DISTURBANCES)
def test_every_kind_of_disturbance_comes_with_a_force(kind: str) -> None:
    def pushes(disturbance: sp.Disturbance) -> bool:
        names = ("force", "impulse", "force_std")
        push = next(getattr(disturbance, name) for name in names if hasattr(disturbance, name))
        return type(disturbance) is DISTURBANCES[kind] and bool(np.any(push))

    exists(sps.disturbances(), pushes)


@pytest.mark.parametrize("kind", MOTIONS)
def test_every_kind_of_motion_comes_with_accelerations_and_a_tilt(kind: str) -> None:
    def moves(motion: sp.HandMotion) -> bool:
        hand = motion.at(np.linspace(0.0, 1.0, 50))
        moved = hand.acceleration.any() or hand.tilt_acceleration.any()
        return type(motion) is MOTIONS[kind] and bool(moved and hand.tilt.any())

    exists(sps.motions(), moves)
    assert type(shrunk(sps.motions(kinds=(kind,)))) is MOTIONS[kind]


@settings(max_examples=200)
@given(sps.motions(0.3, 7.0), st.lists(st.floats(0.0, 0.4), min_size=1, max_size=20))
def test_accelerations_stay_within_their_limit(motion: sp.HandMotion, times: list[float]) -> None:
    hand = motion.at([*times, *motion.breakpoints(0.0, 0.4)])
    # A curve through several positions may be accelerated more between them.
    most = 7.0 * (4.0 if getattr(motion, "positions", None) is not None else 1.0 + 1e-9)
    assert np.abs(hand.acceleration).max() <= most
    if not isinstance(motion, MOTIONS["sampled"]):
        assert 0.1 * np.abs(hand.tilt_acceleration).max() <= most


@pytest.mark.parametrize("contact", ["bilateral", "unilateral"])
@given(st.data())
def test_scenes_with_motions_run_and_keep_their_invariants(
    contact: Any, data: st.DataObject
) -> None:
    scene = data.draw(sps.scenes(duration=0.1, contact=contact, acceleration=10.0))
    assert scene.motion is not None
    run = sp.simulate(scene, record=("state", "residuals", "energy", "multipliers"))
    run.check(residual=1e-3, closure=1e-2)


@given(sps.scenes(symmetric=True, duration=0.05, most_disturbances=0))
def test_symmetric_scenes_stay_symmetric(scene: sp.Scene) -> None:
    # Much longer steps are unstable in some scenes, where round-off grows.
    run = sp.simulate(scene, dt=1e-4)
    size = scene.hand.right.length
    assert np.abs(run.q[:, 0]).max() <= 1e-9 * size
    assert np.abs(run.q[:, 2]).max() <= 1e-9
    np.testing.assert_allclose(run.q[:, 3], run.q[:, 4], rtol=0, atol=1e-9)


@given(sps.scenes(duration=0.01), st.data())
def test_consistent_states_can_be_started_from(scene: sp.Scene, data: st.DataObject) -> None:
    state = data.draw(sps.consistent_states(scene))
    radii = scene.parameters()[[10, 17]]
    assert (state.q[5:7] >= -1e-9 * radii).all()
    assert (state.q[5:7] <= 0.5 * radii * (1 + 1e-9)).all()
    assert len(sp.simulate(replace(scene, initial=state), dt=1e-3)) > 0


def test_unilateral_scenes_may_start_with_a_gap_and_have_two_coefficients() -> None:
    def apart(scene: sp.Scene) -> bool:
        try:
            replace(scene, contact="bilateral").start()
        except ValueError as error:
            return "does not reach the object" in str(error) and isinstance(scene.friction, tuple)
        return False

    scene = exists(sps.scenes(contact="unilateral"), apart)
    run = sp.simulate(replace(scene, duration=1e-3), dt=1e-3, record=("contact",))
    assert 0 in run.contact[0]
