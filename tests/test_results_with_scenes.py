"""A result that has a scene is given as a scene: the error says to pass its scene."""

from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

import callables
import softpinch as sp

pytest.importorskip("matplotlib")

# Every public callable whose first argument is a scene, and its name of that argument.
TAKERS = [
    (name, wanted)
    for name in callables.public()
    for wanted in callables.parameters(name)[:1]
    if wanted in ("scene", "grasp")
]


@cache
def holders() -> dict[str, Any]:
    found = callables.objects()
    own = {name: found[name] for name in ("Run", "Ensemble", "Fit", "Advice", "Capsule")}
    grip = sp.grip(callables.SCENE, force=5.0)
    return {**own, "Grip": grip, "Equilibrium": grip.equilibrium}


@pytest.mark.parametrize(("name", "wanted"), TAKERS)
def test_the_scene_of_the_result_is_asked_for(name: str, wanted: str) -> None:
    right = callables.arguments().get(name, {})
    for kind, holder in holders().items():
        if (name, kind) == ("wrench_limits", "Equilibrium"):
            continue  # which it takes
        with pytest.raises(TypeError) as error:
            callables.called(name)(**{**right, wanted: holder})
        assert str(error.value).startswith(f"{wanted} = <{kind}") or kind in ("Fit", "Capsule")
        assert str(error.value).endswith(f"; pass {kind.lower()}.scene"), str(error.value)


def test_other_parts_are_asked_for_in_the_same_way() -> None:
    scene = sp.Scene()
    takers: list[tuple[Callable[[], Any], str]] = [
        (lambda: sp.Scene(hand=scene), r"Scene\.hand = .*: must be a Hand; pass scene\.hand$"),  # type: ignore[arg-type]
        (lambda: sp.Scene(schedule=scene), r"must be a Schedule, .*; pass scene\.schedule$"),  # type: ignore[arg-type]
    ]
    for take, message in takers:
        with pytest.raises(TypeError, match=message):
            take()
