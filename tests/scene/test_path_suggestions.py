"""Paths that a scene does not have: wherever one is given, the error suggests the one meant."""

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
by_taker = pytest.mark.parametrize("taker", TAKERS)

MEANT = [
    (SCENE, "hand.tip.E", "hand.tip.youngs_modulus"),
    (SCENE, "hand.tip.left.E", "hand.tip.left.youngs_modulus"),
    (SCENE, "E", "hand.tip.youngs_modulus"),
    (SCENE, "hand.tip.young_modulus", "hand.tip.youngs_modulus"),
    (SCENE, "hand.right.M", "hand.right.mass"),
    (SCENE, "mu", "friction"),
    (SCENE, "control.E", "hand.tip.youngs_modulus"),
    (PAIR, "hand.tip.left.E", "hand.tip.left.youngs_modulus"),
    (PAIR, "hand.tip.E", "hand.tip.left.youngs_modulus"),
    (PAIR, "E", "hand.tip.left.youngs_modulus"),
]


@by_taker
@pytest.mark.parametrize(("scene", "path", "meant"), MEANT, ids=range(len(MEANT)))
def test_the_path_that_was_meant_is_suggested(
    taker: str, scene: sp.Scene, path: str, meant: str
) -> None:
    with pytest.raises((ValueError, KeyError)) as error:
        TAKERS[taker](scene, path)
    assert isinstance(error.value, KeyError) == (taker == "vary_paths")
    assert path in str(error.value) and "\\" not in str(error.value)
    assert f'; did you mean "{meant}"?' in str(error.value), str(error.value)


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
