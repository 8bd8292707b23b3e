"""`Scene.with_` and `Scene.vary_paths`: the dotted paths of studies, for one scene."""

import pickle
from ast import literal_eval
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch.run.options import Options
from softpinch.scene.paths import PathTable, shapes_of
from softpinch.study.spec import StudySpec

LOADED = sp.Scene(
    disturbances=[sp.Step(time=0.1), sp.Pulse(time=0.2, duration=0.1)], friction=(0.5, 0.4)
)
CONTROLLER = sp.SampledController.pid(1e-3)
# One scene of each kind of control, start and sharing, beside those of the strategy.
SCENES = {
    "loaded": LOADED,
    "driven": replace(LOADED, fingers="driven", schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]])),
    "torques": replace(LOADED, control=sp.Torque()),
    "sampled": replace(LOADED, control=CONTROLLER),
    "own state": replace(LOADED, initial=LOADED.start()),
    "two tips": replace(
        LOADED,
        hand=sp.Hand(tip=(sp.Fingertip(), sp.Fingertip(radius=0.018, normal_mass=0.01))),
        control=(sp.Pid(), sp.Pid(kp=90.0)),
        friction=0.5,
    ),
    "noisy": sp.Scene(disturbances=[sp.Noise(force_std=1.0, moment_std=0.0, rate_hz=10.0)]),
}
by_name = pytest.mark.parametrize("name", SCENES)


def studied(scene: sp.Scene, path: str, value: Any) -> StudySpec:
    """The check of `monte_carlo`, of a study with this value in both of its runs."""
    return StudySpec.checked(
        scene, Options.checked(dt=1e-3), runs=None, vary={path: np.stack([value, value])}
    )


@by_name
def test_the_listed_paths_are_those_of_studies(name: str) -> None:
    scene = SCENES[name]
    for path, (value, unit) in scene.vary_paths().items():
        assert scene.with_({path: value}) == scene, path
        assert unit, path
        if value is not None and np.isfinite(value).all():
            assert studied(scene, path, value).draws.runs == 2


def every_path(node: Any, path: str = "") -> set[str]:
    """Paths of all fields, sides and entries, made from the plain data of a scene."""
    inside = node.items() if isinstance(node, dict) else enumerate(node)
    found = set()
    for name, part in inside:
        whole = f"{path}.{name}" if path else str(name)
        found |= {whole}
        if isinstance(part, dict | list):
            found |= every_path(part, whole)
    return found


@by_name
def test_no_path_that_a_study_accepts_is_left_out(name: str) -> None:
    scene = SCENES[name]
    accepted = set()
    for path in every_path(scene.to_dict()):
        with suppress(ValueError):
            accepted |= set(shapes_of(scene, [path]))
    left_out = accepted - set(scene.vary_paths())
    # A study gives both contacts one number by this path, whatever they had.
    assert left_out == ({"friction"} if isinstance(scene.friction, tuple) else set())
    assert len(accepted) > 20


def test_the_table_has_values_and_units() -> None:
    table = LOADED.vary_paths()
    assert isinstance(table, PathTable)
    assert table["hand.tip.youngs_modulus"] == (0.3e6, "Pa")
    assert table["disturbances.1.duration"] == (0.1, "s")
    assert table["friction.left"] == (0.4, "1")
    assert table["grasped.height"] == (None, "m")
    assert table["schedule.angles"][1] == "rad"
    assert SCENES["torques"].vary_paths()["schedule.angles"][1] == "N m"
    assert SCENES["own state"].vary_paths()["initial.q.2"] == (0.0, "rad")
    assert list(pickle.loads(pickle.dumps(table))) == list(table)


def test_several_values_are_set_at_once() -> None:
    found = LOADED.with_(
        {
            "hand.tip.youngs_modulus": 6e5,
            "disturbances.0.force": (50, 20),
            "contact": "unilateral",
            "grasped": sp.GraspedObject(width=0.04),
            "schedule.angles.0.1": 0.2,
        }
    )
    one, other = LOADED.disturbances
    expected = replace(
        LOADED,
        hand=sp.Hand(tip=sp.Fingertip(youngs_modulus=6e5)),
        disturbances=[replace(one, force=(50.0, 20.0)), other],  # type: ignore[call-arg]
        contact="unilateral",
        grasped=sp.GraspedObject(width=0.04),
        schedule=sp.Schedule.steps([0.0], [[np.deg2rad(6.0), 0.2]]),
    )
    assert found == expected
    assert LOADED.with_({}) == LOADED


def test_the_tips_follow_the_mass_of_the_object_as_in_a_study() -> None:
    scene = sp.Scene(duration=0.01)
    heavier = scene.with_({"grasped.mass": 0.2})
    vary = {"grasped.mass": [0.2]}
    study = sp.monte_carlo(scene, vary=vary, dt=1e-3, progress=False)
    end = sp.simulate(heavier, 1e-3).state(-1)
    np.testing.assert_array_equal(study["final_state"][0], [*end.q, *end.p])
    assert not np.array_equal(end.q, sp.simulate(scene, 1e-3).state(-1).q)


def test_a_side_gets_a_record_or_a_number_of_its_own() -> None:
    tip = sp.Fingertip(radius=0.018)
    assert LOADED.with_({"hand.tip.left": tip}).hand.tip == (sp.Fingertip(), tip)
    assert LOADED.with_({"hand.tip.left.radius": 0.018}).hand.tip == (sp.Fingertip(), tip)
    assert LOADED.with_({"control.right": sp.Pid(kp=9.0)}).control == (sp.Pid(kp=9.0), sp.Pid())
    assert LOADED.with_({"friction.left": None}).friction == (0.5, np.inf)
    assert LOADED.with_({"friction": None}).friction is None
    assert sp.Scene().with_({"friction.left": 0.3}).friction == (np.inf, 0.3)
    # A side of the object, or a finger, is none of the numbers beside it.
    face, link = sp.Face(tilt=0.1), sp.Finger(length=0.08)
    changed = {"grasped.left": face, "grasped.width": 0.06, "hand.right": link, "hand.tip": tip}
    found = sp.Scene().with_(changed)
    assert (found.grasped.left, found.grasped.width) == (face, 0.06)
    assert (found.hand.right, found.hand.tip) == (link, tip)


REFUSED: list[tuple[Any, type[Exception], str]] = [
    ({"grasped.mas": 1.0}, ValueError, 'did you mean "grasped.mass"?'),
    ({"hand.tip.lef.radius": 1.0}, ValueError, "with_: 'hand.tip.lef.radius': Hand.tip has no"),
    ({"disturbances.7.force": (1, 2)}, ValueError, "has 0 to 1, not '7'"),
    ({"grasped": sp.GraspedObject(), "grasped.mass": 0.1}, ValueError, "set the same number"),
    ({"hand.right.length": 0.08, "hand.right": sp.Finger()}, ValueError, "set the same number"),
    ({"grasped.mass": -1.0}, ValueError, "GraspedObject.mass = -1"),
    ({"grasped.mass": "0.1"}, TypeError, "GraspedObject.mass = '0.1': must be a number"),
    ({"hand.tip": 1.0}, TypeError, "Hand.tip = 1.0: must be a Fingertip"),
    ({"contact": "glued"}, ValueError, "Scene.contact = 'glued': must be one of"),
    ({"schedule.angles.0": 5.0}, ValueError, "'schedule.angles.0' = 5.0: must have the shape (2,)"),
    ({"schedule.angles.0.0": (1, 2)}, ValueError, "must be one number"),
    ({"grasped": {"mass": 1.0}}, TypeError, "not a mapping"),
    ({"initial.q.0": 0.1}, ValueError, "Scene.initial = None has no parts"),
    ({3: 1.0}, TypeError, "with_: 3: must be a path"),
    ([("grasped.mass", 1.0)], TypeError, "must map paths to values"),
]


@pytest.mark.parametrize(("values", "error", "message"), REFUSED, ids=range(len(REFUSED)))
def test_a_wrong_path_or_value_is_refused(
    values: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error) as raised:
        LOADED.with_(values)
    assert message in str(raised.value)
    assert not str(raised.value).startswith("vary")


@pytest.mark.parametrize("name", ["driven", "torques"])
@pytest.mark.parametrize("call", [lambda s, v: s.with_(v), lambda s, v: studied(s, *v.popitem())])
def test_gains_are_refused_where_no_pid_is(name: str, call: Callable[..., Any]) -> None:
    with pytest.raises(ValueError, match="there is no PID"):
        call(SCENES[name], {"control.kp": 3.0})


@pytest.mark.parametrize("before", [{}, {"values": {"gravity": 9.8}}])
def test_a_field_given_by_name_is_told_how_it_is_written(before: Any) -> None:
    with pytest.raises(TypeError) as error:
        sp.Scene().with_(**before, friction=0.3, gravity=9.0)
    text = str(error.value)
    assert text.startswith("with_: friction is given by name: ")
    # What it proposes does it.
    written = text.partition("as in with_(")[2]
    assert written.endswith(")")
    changed = sp.Scene().with_(literal_eval(written[:-1]))
    assert (changed.friction, changed.gravity) == (0.3, 9.0)
    with pytest.raises(TypeError, match="with_: None: must map paths to values"):
        sp.Scene().with_()
