"""Scene files: every scene makes the round trip exactly, and slips are named with their place."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch import paper, strategies


@st.composite
def any_scenes(draw: st.DrawFn) -> sp.Scene:
    """Of both kinds of contact, and also scenes that start at a state."""
    contact = draw(st.sampled_from(["bilateral", "unilateral"]))
    scene = draw(strategies.scenes(spread=2.0, contact=contact))
    if draw(st.booleans()):
        state = draw(strategies.consistent_states(scene))
        if contact == "unilateral":
            codes, tilts = st.sampled_from([0.0, 1.0, 2.0, -2.0, 3.0, 4.0, -4.0]), st.floats(-1, 1)
            state = replace(state, contact=draw(st.tuples(codes, codes, tilts, tilts)))
        grid = draw(st.none() | st.tuples(st.floats(-1, 1), st.integers(0, 10**9)))
        scene = replace(scene, initial=replace(state, grid=grid, check=draw(st.booleans())))
    return scene


@given(any_scenes())
def test_a_scene_makes_the_round_trip_through_toml_and_dictionaries(scene: sp.Scene) -> None:
    text = scene.to_toml()
    assert sp.Scene.from_toml(text) == scene
    assert sp.Scene.from_dict(scene.to_dict()) == scene
    assert sp.Scene.from_toml(text).to_toml() == text


@given(any_scenes())
def test_each_part_makes_the_round_trip_alone(scene: sp.Scene) -> None:
    parts = [scene.hand, scene.grasped, scene.schedule, *scene.disturbances]
    parts += [scene.initial] if isinstance(scene.initial, sp.State) else []
    for part in parts:
        assert type(part).from_dict(part.to_dict()) == part
    for disturbance in scene.disturbances:
        assert sp.Disturbance.from_dict(disturbance.to_dict()) == disturbance


def test_an_empty_file_is_the_default_scene() -> None:
    assert sp.Scene.from_toml("") == sp.Scene()


def test_a_file_is_read_by_its_path(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(paper.manipulation().to_toml(), encoding="utf-8")
    assert sp.Scene.from_toml(path) == paper.manipulation()
    with pytest.raises(ValueError, match=r"pathlib\.Path"):
        sp.Scene.from_toml(str(path))
    path.write_text("duration = ", encoding="utf-8")
    with pytest.raises(ValueError, match=r"scene\.toml"):
        sp.Scene.from_toml(path)


def test_integers_are_numbers_too_and_none_is_left_out() -> None:
    scene = sp.Scene.from_toml("duration = 2\ngravity = 0\n[grasped]\nmass = 1\n")
    assert scene == sp.Scene(duration=2.0, gravity=0.0, grasped=sp.GraspedObject(mass=1.0))
    data = tomllib.loads(scene.to_toml())
    assert "friction" not in data
    assert "normal_mass" not in data["hand"]["tip"]


def test_angles_may_be_in_degrees() -> None:
    scene = sp.Scene.from_toml(
        '[schedule]\nkind = "ramps"\ntimes = [0, 1]\nangles_deg = [[6, 6], [20, -10]]\n'
    )
    assert scene.schedule == sp.Schedule.ramps([0, 1], np.deg2rad([[6, 6], [20, -10]]))


def test_tips_and_gains_may_be_right_and_left() -> None:
    scene = sp.Scene.from_toml("[hand.tip.right]\nradius = 0.021\n[control.left]\nkp = 7\n")
    assert scene.hand.tip == (sp.Fingertip(radius=0.021), sp.Fingertip())
    assert scene.control == (sp.Pid(), sp.Pid(kp=7))
    assert sp.Scene.from_toml(scene.to_toml()) == scene


STEP = '[[disturbances]]\nkind = "step"\ntime = 0\n'
BAD = [
    ("durration = 1", r'Scene\.durration: unknown name; .*did you mean "duration"'),
    ("duration = 0", r"Scene\.duration = 0\.0: must be finite and > 0$"),
    ("[object]\nmass = 1", r'Scene\.object: unknown name; .*did you mean "grasped"'),
    ("[hand.right]\nlenght = 1", r'Finger\.lenght \(in hand\.right\).*mean "hand\.right\.length"'),
    ("[control.right]\nKp = 1", r'Pid\.Kp \(in control\.right\).*mean "control\.right\.kp"'),
    ("[hand.tip.left]\nradius = -1", r"Fingertip\.radius = -1\.0: .* \(in hand\.tip\.left\)"),
    ("[hand.tip]\nright = {}\nradius = 1", r"Fingertip\.right \(in hand\.tip\): unknown name"),
    (STEP + STEP.replace("step", "stepp"), r'kind \(in disturbances\.1\) = \'stepp\'.*"step"'),
    (STEP.replace('kind = "step"\n', ""), r"kind \(in disturbances\.0\): is missing"),
    (STEP.replace("time = 0\n", ""), r"Step\.time \(in disturbances\.0\): is missing"),
    (STEP + "force = [1]", r"Step\.force has shape \(1,\): must have shape \(2,\), .* \(in dist"),
    ("[initial]\np = [0]", r"State\.q \(in initial\): is missing"),
    ("[initial]\nq = [nan,0,0,0,0,0,0,0,0]", r"State\.q\[0\] = nan: must be finite \(in initial"),
    (
        '[schedule]\nkind = "steps"\ntimes = [0]\nangles = [[0, 0]]\nangles_deg = [[0, 0]]',
        r"Schedule\.angles_deg \(in schedule\): must not be given together with angles",
    ),
    (
        '[schedule]\nkind = "steps"\ntimes = [0]\nangles_deg = [[0]]',
        r"Schedule\.angles_deg has shape \(1, 1\): must have shape \(k, 2\) \(in schedule\)",
    ),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=range(len(BAD)))
def test_slips_in_a_file_are_named_with_their_place(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        sp.Scene.from_toml(text)


def test_what_must_be_a_table_or_tables_is_a_type_error() -> None:
    with pytest.raises(TypeError, match=r"Hand \(in hand\) = 3: must be a table"):
        sp.Scene.from_toml("hand = 3")
    with pytest.raises(TypeError, match=r"Scene\.disturbances = 1: must be an array of tables"):
        sp.Scene.from_toml("disturbances = 1")
