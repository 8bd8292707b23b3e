"""Paths that a scene does not have: the error suggests the one that was meant."""

import pickle
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from softpinch.scene.fields import SYMBOLS

SCENE = sp.Scene(duration=0.01)
PAIR = SCENE.with_({"hand.tip.left.radius": 0.021, "control.left.kp": 90.0})
# Every way by which a user gives a path.
TAKERS: dict[str, Callable[[sp.Scene, str], Any]] = {
    "vary_paths": lambda scene, path: scene.vary_paths()[path],
    "with_": lambda scene, path: scene.with_({path: 1.0}),
    "monte_carlo": lambda scene, path: sp.monte_carlo(scene, 1, vary={path: [1.0]}),
    "sensitivities": lambda scene, path: sp.simulate(scene, 1e-3, sensitivities=(path,)),
    "fit": lambda scene, path: sp.fit(
        scene, [0.005], {"y": [0.07]}, {path: (1.0, 2.0)}, dt=1e-3, noise=1.0
    ),
    "equilibrium_map": lambda scene, path: sp.equilibrium_map(scene, {path: [1.0]}, progress=False),
}
TWO = sp.Scene(
    hand=sp.Hand(tip=(sp.Fingertip(), sp.Fingertip())),
    disturbances=[sp.Step(time=0.0)],
    schedule=sp.Schedule.steps([0.0], [[0.1, 0.1]]),
)
SAID = [
    (SCENE, "hand.tip.E", 'did you mean "hand.tip.youngs_modulus"?'),
    (SCENE, "hand.tip.left.E", 'did you mean "hand.tip.left.youngs_modulus"?'),
    (SCENE, "E", 'did you mean "hand.tip.youngs_modulus"?'),
    (SCENE, "youngs_modulus", 'did you mean "hand.tip.youngs_modulus"?'),
    (SCENE, "hand.youngs_modulos", 'did you mean "hand.tip.youngs_modulus"?'),
    (SCENE, "hand.right.M", 'did you mean "hand.right.mass"?'),
    (SCENE, "mu", 'did you mean "friction"?'),
    (SCENE, "control.E", 'did you mean "hand.tip.youngs_modulus"?'),
    (SCENE, "control.left.kpp", 'did you mean "control.kp"?'),
    (SCENE, "disturbances.0.force", "Scene.disturbances is empty, so there is no '0'"),
    (PAIR, "hand.tip.left.E", 'did you mean "hand.tip.left.youngs_modulus"?'),
    (PAIR, "hand.tip.E", 'did you mean "hand.tip.left.youngs_modulus"?'),
    (TWO, "force", 'did you mean "disturbances.0.force"?'),
    (TWO, "hand.tip.radius", 'did you mean "hand.tip.left.radius"?'),
    (TWO, "schedule.angles.1", "Schedule.angles has one entry, 0, not '1'"),
    (TWO, "disturbances.0.force.2", "Step.force has 0 to 1, not '2'"),
]


@pytest.mark.parametrize(("scene", "path", "message"), SAID, ids=range(len(SAID)))
def test_an_unknown_path_says_which_was_meant(scene: sp.Scene, path: str, message: str) -> None:
    with pytest.raises(ValueError) as error:
        scene.with_({path: 1.0})
    assert str(error.value).startswith(f"with_: {path!r}: ") and message in str(error.value)


@pytest.mark.parametrize("taker", TAKERS)
def test_every_function_that_takes_paths_suggests_one(taker: str) -> None:
    with pytest.raises((ValueError, KeyError)) as error:
        TAKERS[taker](PAIR, "hand.tip.E")
    assert isinstance(error.value, KeyError) == (taker == "vary_paths")
    text = str(error.value)
    assert "hand.tip.E" in text and "\\" not in text
    assert '; did you mean "hand.tip.left.youngs_modulus"?' in text


@given(st.text(max_size=30) | st.sampled_from(sorted(SYMBOLS)).map("hand.tip.left.{}".format))
def test_no_suggestion_is_the_record_that_lacks_the_name(path: str) -> None:
    table = SCENE.vary_paths()
    if path in table:
        return
    with pytest.raises(KeyError) as error:
        table[path]
    found = re.search(r'did you mean "([^"]+)"', str(error.value))
    assert found is None or not path.startswith(f"{found[1]}.")


def test_the_table_stays_a_mapping() -> None:
    table = SCENE.vary_paths()
    assert "hand.tip.E" not in table and table.get("hand.tip.E") is None
    assert repr(pickle.loads(pickle.dumps(table))) == repr(table)
    for odd in (3, None, ("a",)):
        assert odd not in table
        with pytest.raises(KeyError):
            table[odd]  # type: ignore[index]
    with pytest.raises(KeyError, match="contact is not a number"):
        table["contact"]
    many = sp.Schedule.sampled(np.arange(40.0), np.zeros((40, 2)))
    with pytest.raises(KeyError, match="can be varied, but is not listed"):
        sp.Scene(schedule=many).vary_paths()["schedule.angles.3.0"]
