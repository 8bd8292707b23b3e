"""Scenes with unilateral contact or with two coefficients of friction: text, paths, refusals."""

import pickle
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch import _core
from softpinch.scene import fields, paths, usual
from softpinch.scene.template import SceneTemplate

# The package as those see it who check no types.
raw: Any = sp
INF = float("inf")
UNEVEN = sp.Scene(friction=(0.5, 0.8), contact="unilateral")
# Straight fingers leave gaps of 2 mm.
NARROW = sp.GraspedObject(width=0.045)


@pytest.mark.parametrize(
    "text",
    [
        "friction = [0.5, 0.8]",
        "[friction]\nright = 0.5\nleft = 0.8",
        "friction = {left=0.8,right=0.5}",
    ],
)
def test_two_coefficients_are_a_list_or_a_table_and_are_written_as_a_table(text: str) -> None:
    scene = sp.Scene.from_toml(f'contact = "unilateral"\n{text}')
    assert scene == UNEVEN and hash(scene) == hash(UNEVEN)
    assert scene.friction == (0.5, 0.8)
    assert tomllib.loads(scene.to_toml())["friction"] == {"right": 0.5, "left": 0.8}
    for again in (
        sp.Scene.from_toml(scene.to_toml()),
        sp.Scene.from_dict(scene.to_dict()),
        pickle.loads(pickle.dumps(scene)),
        sp.Scene(friction=np.array([0.5, 0.8]), contact="unilateral"),  # type: ignore[arg-type]
    ):
        assert again == UNEVEN
    assert repr(scene) == "Scene(friction=(0.5, 0.8), contact='unilateral')"
    assert scene != replace(scene, friction=(0.8, 0.5)) != replace(scene, contact="bilateral")
    values = dict(zip(_core.PARAMETERS, scene.parameters().tolist(), strict=True))
    assert (values["friction.right"], values["friction.left"]) == (0.5, 0.8)


REFUSED = [
    ({"contact": "unilateral"}, r'Scene\.friction = None: must be finite where contact = "unilat'),
    ({"contact": "unilateral", "friction": INF}, r"Scene\.friction = inf: must be finite where"),
    ({"contact": "unilateral", "friction": (0.5, INF)}, r"friction = \(0\.5, inf\): must be finit"),
    ({"contact": "unilateral", "friction": -0.1}, r"Scene\.friction = -0\.1: must be >= 0"),
    ({"friction": (0.5, -0.1)}, r"Scene\.friction = -0\.1: must be >= 0"),
    ({"contact": "unilatral", "friction": 1.0}, r"contact = 'unilatral': .*mean \"unilateral\"\?"),
]
BAD_TYPES = [
    ({"friction": (0.5, None)}, r"friction = \(0\.5, None\): must be a number, or two, \(ri"),
    ({"friction": (0.5, 0.5, 0.5)}, r"Scene\.friction = \(.*: must be a number, or two, \(right"),
    ({"contact": None}, r"Scene\.contact = None: must be one of \"bilateral\", \"unilateral\""),
]


@pytest.mark.parametrize(("fields", "message"), REFUSED, ids=range(len(REFUSED)))
def test_wrong_contacts_and_frictions_are_refused(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        raw.Scene(**fields)


@pytest.mark.parametrize(("fields", "message"), BAD_TYPES, ids=range(len(BAD_TYPES)))
def test_contacts_and_frictions_of_wrong_types_are_refused(
    fields: dict[str, Any], message: str
) -> None:
    with pytest.raises(TypeError, match=message):
        raw.Scene(**fields)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("[friction]\nright = 0.5", ValueError, r"friction\.left \(in friction\): is missing"),
        (
            "[friction]\nright = 0.5\nleft = 1\nmiddle = 2",
            ValueError,
            r"friction\.middle \(in friction\): unkn",
        ),
        ("friction = [0.5]", TypeError, r"Scene\.friction = \[0\.5\]: must be a number, or two"),
    ],
)
def test_slips_of_friction_in_a_file_are_named(
    text: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        sp.Scene.from_toml(text)


def test_bilateral_contact_refuses_a_state_with_modes() -> None:
    """They would change nothing, and nobody would notice."""
    state = replace(sp.Scene().start(), contact=np.array([1.0, 1.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match=r"initial\.contact = .*must be None with contact = \"bil"):
        sp.Scene(initial=state)
    assert sp.Scene(initial=state, contact="unilateral", friction=0.5).start() == state


@pytest.mark.parametrize("formulation", ["csm", "projected"])
def test_a_state_whose_closed_tip_has_a_gap_is_refused(formulation: Any) -> None:
    scene = sp.Scene(contact="unilateral", friction=0.5, duration=0.002)
    q = scene.start().q.copy()
    q[5] += 0.002
    for contact in ([1, 1, 0, 0], [2, 1, 0, 0]):
        apart = sp.State(q, contact=np.array(contact, float))
        with pytest.raises(ValueError, match=r"C_1\^H = 2\.000e-3 m"):
            sp.simulate(replace(scene, initial=apart), dt=1e-4, formulation=formulation)
    free = sp.State(q, contact=np.array([0.0, 1.0, 0.0, 0.0]))
    assert sp.simulate(replace(scene, initial=free), dt=1e-4, formulation=formulation).success
    unchecked = replace(scene, initial=replace(apart, check=False))
    if formulation == "csm":
        assert sp.simulate(unchecked, dt=1e-4).success


def test_a_start_with_a_gap_is_for_unilateral_contact() -> None:
    scene = sp.Scene(grasped=NARROW, contact="unilateral", friction=0.5, duration=0.01)
    start = scene.start()
    assert not start.q[3:].any() and not start.p.any()
    run = sp.simulate(scene, dt=1e-3, record=("state", "contact", "multipliers"))
    assert not run.contact[0].any() and not run.multipliers[0].any()
    with pytest.raises(ValueError, match="does not reach the object: gap 2 mm"):
        replace(scene, contact="bilateral").start()
    # Closing the fingers first leaves no gap.
    touching = replace(scene, initial="touching").start()
    assert touching == replace(scene, initial="touching", contact="bilateral").start()
    assert (touching.q[3:5] > 0.0).all()


# Friction of the scene, varied values -> friction of the run.
PATHS = [
    (0.5, {"friction": 0.7}, 0.7),
    ((0.5, 0.8), {"friction": 0.7}, 0.7),
    (None, {"friction": 0.7}, 0.7),
    (0.5, {"friction.left": 0.7}, (0.5, 0.7)),
    ((0.5, 0.8), {"friction.right": 0.7}, (0.7, 0.8)),
    (None, {"friction.right": 0.7}, (0.7, INF)),
    (0.5, {"friction.left": 0.1, "friction.right": 0.2}, (0.2, 0.1)),
]


@pytest.mark.parametrize(("friction", "values", "expected"), PATHS, ids=str)
def test_paths_set_the_friction_of_both_contacts_or_of_one(
    friction: Any, values: dict[str, float], expected: Any
) -> None:
    template = SceneTemplate(sp.Scene(friction=friction), values, 0)
    assert set(template.shapes.values()) == {()}
    assert template.changed(values).friction == expected
    slots = {"friction": [36, 37], "friction.right": [36], "friction.left": [37]}
    assert template.slots == {path: slots[path] for path in values}
    for path in values:
        assert fields.units(path, ()) == "1"
        assert set(paths.at_path(template.changed(values), path)) == {values[path]}


def test_two_paths_to_one_number_are_found_among_others() -> None:
    one, other = "hand.tip.left.radius", "hand.tip.radius"
    among = ["control.kp", one, "hand.tip.left.youngs_modulus", "hand.tip.right.radius"]
    assert list(SceneTemplate(sp.Scene(), among, 0).shapes) == among
    with pytest.raises(ValueError, match=f"'{one}' and '{other}' set the same number"):
        SceneTemplate(sp.Scene(), [*among[:3], other, "gravity"], 0)
    with pytest.raises(
        ValueError, match=r"'schedule' and 'schedule\.angles\.0' set the same number"
    ):
        paths.refuse_overlaps(["schedule", "grasped.mass", "schedule.angles.0", "schedule.times"])


def test_the_friction_of_both_and_of_one_are_the_same_number() -> None:
    with pytest.raises(ValueError, match=r"'friction' and 'friction\.left' set the same number"):
        SceneTemplate(UNEVEN, ["friction", "friction.left"], 0)
    for scene, path, message in (
        (UNEVEN, "friction.0", r'friction is a pair; it has "right", "left", not \'0\''),
        (sp.Scene(friction=0.5), "friction.0", r"Scene\.friction = 0\.5 has no parts"),
        (UNEVEN, "friction.right.left", r"Scene\.friction\.right = 0\.5 has no parts"),
        (sp.Scene(), "contact", r"Scene\.contact is not a number"),
        (
            replace(UNEVEN, initial=UNEVEN.start()),
            "initial.contact",
            r"the modes of contacts, State\.contact, are shared by all runs; without them they fol",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            paths.resolve(scene, path)


LIGHT = sp.Fingertip(normal_mass=0.01, tangential_mass=0.01)
HEAVY = [
    (sp.Scene(contact="unilateral", friction=2.0), "friction = 2: above 1.4 "),
    (
        replace(UNEVEN, friction=(2.0, 1.5), hand=sp.Hand(tip=(LIGHT, sp.Fingertip()))),
        "friction.left = 1.5: above 1.4 ",
    ),
]


@pytest.mark.parametrize(("scene", "message"), HEAVY, ids=[message for _, message in HEAVY])
def test_high_friction_of_heavy_tips_is_a_warning_in_unilateral_contact(
    scene: sp.Scene, message: str
) -> None:
    (text,) = usual.suspicions(scene)
    assert text.startswith(message)
    assert text.endswith("about normal_mass = tangential_mass = 0.01 kg")
    assert not usual.suspicions(replace(scene, contact="bilateral"))
    assert not usual.suspicions(replace(scene, friction=1.4))
    assert not usual.suspicions(replace(scene, hand=sp.Hand(tip=LIGHT)))
    with pytest.warns(sp.SuspiciousValueWarning, match=message):
        sp.simulate(replace(scene, duration=1e-3), dt=1e-3)
