"""Names, paths and arrays that are far too long: refused in a short message, without a panic."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from softpinch import _core


def repeated(value: Any, *shape: int) -> np.ndarray:
    """An array of any size that takes no memory."""
    return np.broadcast_to(value, shape)


MUCH = 10**12
HUGE: dict[str, Callable[[], object]] = {
    "rows": lambda: _core.residuals(
        sp.Scene().parameters(), repeated(0.0, MUCH, 9), repeated(0.0, MUCH, 9)
    ),
    "eigenvalues": lambda: _core.stable_step("rk4", repeated(-1j, MUCH)),
    "coefficients": lambda: inputs(
        schedule=(repeated(0.0, 1, MUCH), repeated(0.0, 1, MUCH + 1, 2, 1))
    ),
    "sines": lambda: inputs(sines=[repeated(0.0, MUCH, 7)]),
    "numbers": lambda: inputs(
        noises=[(repeated(1.0, 1, 6), 0, repeated(np.uint64(0), MUCH), 0)],
    ),
}


def inputs(**changes: Any) -> _core.Inputs:
    still = (np.zeros((1, 0)), np.zeros((1, 1, 2, 1)))
    parts: dict[str, Any] = dict.fromkeys(("forces", "sines", "impulses", "noises"), ())
    return _core.Inputs(**{"schedule": still, **parts, "fingers": "pid", **changes})


@pytest.mark.parametrize("make", HUGE.values(), ids=HUGE)
def test_arrays_for_which_there_is_no_room_are_refused(make: Callable[[], object]) -> None:
    # What memory does not hold is no panic and no abort either.
    with pytest.raises(ValueError, match=r" would need \d\.\d+e\d+, the limit is 2\.1e9"):
        make()


LONG = "hand." * 20_000
WITHIN = {
    **{"a field": f"hand.{LONG}", "no field": f"hand.tip.{'x' * 99_999}"},
    **{"an index": f"schedule.times.{'9' * 99_999}", "a number": f"gravity.{LONG}"},
    **{"a side": f"control.right.{'k' * 99_999}", "nothing": LONG},
}


@pytest.mark.parametrize("path", WITHIN.values(), ids=WITHIN)
def test_a_path_of_any_length_makes_a_short_message(path: str) -> None:
    scene = sp.Scene(duration=0.01)
    uneven = replace(scene, control=(sp.Pid(), sp.Pid()))
    asked: list[Callable[[], object]] = [
        lambda: sp.monte_carlo(scene, 3, vary={path: [1.0] * 3}, progress=False),
        lambda: sp.monte_carlo(uneven, 3, vary={path.replace("right.", ""): [1.0] * 3}),
        lambda: sp.stability_map(scene, path, [1.0], progress=False),
        lambda: sp.stability_map(scene, f"x{path}", [1.0], progress=False),
    ]
    for ask in asked:
        with pytest.raises(ValueError, match=r"vary: '|axis = '") as error:
            ask()
        assert len(str(error.value)) < 600


def test_a_name_of_any_length_makes_a_short_message() -> None:
    ensemble = sp.monte_carlo(
        sp.Scene(duration=0.01), 3, vary={"gravity": [9.7, 9.8, 9.9]}, dt=1e-3, progress=False
    )
    name = "x" * 100_000
    asked: list[Callable[[], object]] = [
        lambda: ensemble.mean(name),
        lambda: ensemble.quantile(name, 0.5),
        lambda: sp.sensitivity(ensemble, name),
        lambda: ensemble[name],
    ]
    for ask in asked:
        with pytest.raises((KeyError, ValueError), match="xxx") as error:
            ask()
        assert len(str(error.value)) < 600


class Unprintable:
    def __repr__(self) -> str:
        raise RuntimeError("no")


@pytest.mark.parametrize("key", [10**5000, Unprintable(), None, 1.5, ("a", "b")], ids=type)
def test_a_key_that_is_no_text_is_refused_with_its_owner(key: object) -> None:
    with pytest.raises(TypeError, match=r"^Scene: .*: names must be text$"):
        sp.Scene.from_dict({key: 1})  # type: ignore[dict-item]
    with pytest.raises(TypeError, match=r"^Hand \(in hand\): .*: names must be text$"):
        sp.Scene.from_dict({"hand": {key: 1}})
