"""Descriptions: values, defaults, equality, copies, parameters, and what disturbances become."""

import copy
import math
import pickle
import re
from dataclasses import FrozenInstanceError, fields, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import _core, strategies
from softpinch.scene.disturbance import DISTURBANCES

RECORDS = [sp.Finger(), sp.Fingertip(), sp.GraspedObject(), sp.Pid(), sp.Stabilization()]


def load(scene: sp.Scene, t: float) -> np.ndarray:
    """Force and moment on the object at `t`, as the core has them."""
    start = scene.start()
    return sp.evaluate(scene, t, start.q, start.p).forces.external[:3]


def test_the_default_scene_starts_in_point_contact_and_holds_six_degrees() -> None:
    start = sp.Scene().start()
    np.testing.assert_allclose(start.q, [0, 0.0762, *[0] * 7], atol=1e-17)
    assert not start.p.any()
    np.testing.assert_array_equal(sp.Scene().schedule.target(0.0), np.deg2rad([6.0, 6.0]))


@given(strategies.scenes(spread=2.0))
def test_every_parameter_stands_under_its_name(scene: sp.Scene) -> None:
    values = dict(zip(_core.PARAMETERS, scene.parameters(), strict=True))
    hand, tips, control = scene.hand, scene.hand.tips, scene.control
    if not isinstance(control, tuple):
        control = (control, control)
    for k, (side, finger) in enumerate({"right": hand.right, "left": hand.left}.items()):
        for f in fields(finger):
            rubbing = {"joint_friction": 0.0, "creep_rate": 0.01}
            own = getattr(finger, f.name)
            expected = rubbing[f.name] if own is None else own
            assert values[f"hand.{side}.{f.name}"] == expected
        for f in fields(tips[k])[:-2]:
            own = getattr(tips[k], f.name)
            expected = scene.grasped.mass if own is None else own
            assert values[f"hand.tip.{side}.{f.name}"] == expected
        for f in fields(control[k]):
            assert values[f"control.{side}.{f.name}"] == getattr(control[k], f.name)
    assert values["grasped.com_offset"] == scene.grasped.com_offset
    height = scene.grasped.height
    assert values["grasped.height"] == (math.inf if height is None else height)
    assert values["gravity"] == scene.gravity
    own = math.inf if scene.friction is None else scene.friction
    pair = own if isinstance(own, tuple) else (own, own)
    assert (values["friction.right"], values["friction.left"]) == pair


@given(strategies.scenes(), strategies.scenes())
def test_scenes_compare_hash_copy_and_pickle_by_value(one: sp.Scene, other: sp.Scene) -> None:
    for again in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one), replace(one)):
        assert again == one
        assert hash(again) == hash(one)
        assert not again.schedule.angles.flags.writeable
    assert (one == other) == (one.to_dict() == other.to_dict())
    assert one != replace(one, duration=2 * one.duration)
    angles = one.schedule.angles + 0.5
    assert one != replace(one, schedule=replace(one.schedule, angles=angles))


def test_records_are_equal_only_to_their_kind() -> None:
    assert sp.Step(time=0.0) != sp.Impulse(time=0.0)
    assert sp.Pid() != (100.0, 1.0, 1000.0)
    assert sp.Hand(tip=sp.Fingertip()) != sp.Hand(tip=(sp.Fingertip(), sp.Fingertip()))


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_fields_rules_and_numbers(record: Any) -> None:
    numbers = [
        f.name for f in fields(record) if f.name not in ("law", "relaxation", "right", "left")
    ]
    assert numbers == list(_core.RULES[type(record).__name__])
    name = fields(record)[0].name
    for value in (np.float32(0.5), np.int64(2), np.array(0.25), Fraction(1, 4), 3):
        stored = getattr(replace(record, **{name: value}), name)
        assert type(stored) is float
        assert stored == float(value)
    with pytest.raises(FrozenInstanceError):
        setattr(record, name, 1.0)


def test_a_repr_says_what_differs_from_the_defaults_and_makes_the_same_again() -> None:
    assert repr(sp.Scene()) == "Scene()"
    scene = sp.Scene(
        hand=sp.Hand(tip=(sp.Fingertip(radius=0.02), sp.Fingertip(radius=0.021))),
        schedule=sp.Schedule.ramps([0, 1], [[0.0, 0.0], [0.1, 0.2]]),
        disturbances=[sp.Step(time=1, force=(2, 3))],
        initial=sp.State(np.full(9, 0.1)),
    )
    assert "radius=0.021" in repr(scene)
    assert "inertia" not in repr(scene)
    assert eval(repr(scene), vars(sp)) == scene


def test_a_lone_tip_stands_for_both_and_a_pair_is_right_then_left() -> None:
    tips = (sp.Fingertip(radius=0.01), sp.Fingertip(radius=0.03, normal_mass=0.5))
    values = dict(zip(_core.PARAMETERS, sp.Scene(hand=sp.Hand(tip=tips)).parameters(), strict=True))
    assert values["hand.tip.right.radius"] == 0.01
    assert values["hand.tip.left.radius"] == 0.03
    assert values["hand.tip.right.normal_mass"] == sp.GraspedObject().mass
    assert values["hand.tip.left.normal_mass"] == 0.5


# Held noise draws by its place among them: alone it is another one.
FORCES = [kind for kind in DISTURBANCES if kind != "noise"]


@given(st.lists(strategies.disturbances(kinds=FORCES), max_size=3), st.floats(0.0, 2.0))
def test_disturbances_add_up(disturbances: list[sp.Disturbance], t: float) -> None:
    together = load(sp.Scene(disturbances=disturbances), t)
    apart = sum((load(sp.Scene(disturbances=[d]), t) for d in disturbances), np.zeros(3))
    np.testing.assert_allclose(together, apart, rtol=0, atol=1e-12)


def test_a_pulse_that_outlasts_the_clock_never_ends() -> None:
    pulse = sp.Pulse(time=1e308, duration=1e308, force=(1, 0))
    assert load(sp.Scene(disturbances=[pulse]), 1.5e308)[0] == 1.0


@given(strategies.scenes(), st.data())
def test_a_consistent_state_is_on_the_constraints(scene: sp.Scene, data: st.DataObject) -> None:
    state = data.draw(strategies.consistent_states(scene))
    terms = sp.evaluate(scene, 0.0, state.q, state.p)
    assert np.abs(terms.residuals[:2]).max() <= 1e-14
    assert np.abs(terms.constraint_matrix @ state.p).max() <= 1e-12


def test_a_consistent_state_has_the_pose_that_was_asked_for() -> None:
    state = sp.State.consistent(
        sp.Scene(),
        x=0.01,
        y=0.07,
        rotation=0.1,
        fingers=(0.2, 0.3),
        shear=(1e-3, 2e-3),
        velocity=(0.1, 0.2, 0.3),
        finger_rates=(0.4, 0.5),
        integral=(0.6, 0.7),
        time=0.8,
    )
    assert state.q[:5].tolist() == [0.01, 0.07, 0.1, 0.2, 0.3]
    assert state.q[7:].tolist() == [1e-3, 2e-3]
    assert state.p[:5].tolist() == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert (state.integral, state.time, state.check) == ((0.6, 0.7), 0.8, True)


def test_a_consistent_state_lies_by_default_where_the_scene_starts() -> None:
    offset = sp.GraspedObject(com_offset=0.003)
    assert sp.State.consistent(sp.Scene(grasped=offset)).q[:2].tolist() == [0.003, 0.0762]
    narrow = sp.GraspedObject(width=0.04)
    # Straight fingers leave a gap here, which is no reason to refuse closed ones.
    assert sp.State.consistent(sp.Scene(grasped=narrow), fingers=(0.1, 0.1)).q[5] > 0
    touching = sp.Scene(grasped=narrow, initial="touching")
    np.testing.assert_array_equal(sp.State.consistent(touching).q[:2], touching.start().q[:2])
    given_state = sp.State(np.array([0.01, 0.02, *[0] * 7]))
    assert sp.State.consistent(sp.Scene(initial=given_state)).q[:2].tolist() == [0.01, 0.02]


@pytest.mark.parametrize(
    ("name", "ours"),
    [
        ("Finger", sp.Finger()),
        ("Fingertip", sp.Fingertip()),
        ("GraspedObject", sp.GraspedObject()),
        ("PidGains", sp.Pid()),
        ("Surroundings", sp.Scene()),
    ],
)
def test_the_crate_has_the_same_defaults(name: str, ours: object) -> None:
    """They stand in both languages, for who uses one of them alone."""
    source = Path(__file__).parents[2] / "rust" / "softpinch" / "src" / "model" / "parameters.rs"
    text = source.read_text(encoding="utf-8")
    block = re.search(rf"record! {{[^{{}}]*\b{name} {{(.*?)\n    }}", text, re.DOTALL)
    assert block is not None
    numbers = re.findall(r"(\w+): \w+ = ([-+.\de]+)", block[1])
    assert numbers
    for field, number in numbers:
        assert getattr(ours, field) == float(number), field
