"""A name that nobody knows: the error says which field was meant, with its dotted path."""

import inspect
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pytest

import softpinch as sp
from softpinch.support.record import Record

CONSTRUCTORS: list[tuple[Callable[[], Any], str]] = [
    (lambda: sp.Scene(object=1), 'Scene.object: unknown name; must be one of "hand", "grasped", '),
    (lambda: sp.Scene(object=1), 'did you mean "grasped"?'),
    (lambda: sp.Scene(youngs_modulos=1), 'did you mean "hand.tip.youngs_modulus"?'),
    (lambda: sp.Scene(tip=sp.Fingertip()), 'did you mean "hand.tip"?'),
    (lambda: sp.Scene(pid=sp.Pid()), 'did you mean "control"?'),
    (lambda: sp.Hand(left_finger=1), 'did you mean "left"?'),
    (lambda: sp.Fingertip(youngs_modulos=3e5), 'Fingertip.youngs_modulos: unknown name'),
    (lambda: sp.Fingertip(youngs_modulos=3e5), 'did you mean "youngs_modulus"?'),
    (lambda: sp.Pid(Kp=1), 'did you mean "kp"?'),
    (lambda: sp.Noise(force_sdt=1), 'did you mean "force_std"?'),
    (lambda: sp.State(qq=1), 'State.qq: unknown name; must be one of "q", "p"'),
    (lambda: replace(sp.Scene(), objct=1), 'did you mean "grasped"?'),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), CONSTRUCTORS, ids=range(len(CONSTRUCTORS)))
def test_a_constructor_says_it(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(TypeError) as error:
        make()
    assert message in str(error.value), str(error.value)


def test_nothing_is_suggested_where_nothing_is_close() -> None:
    with pytest.raises(TypeError, match=r'Scene\.zzz: unknown name; must be .*"motion"$'):
        sp.Scene(zzz=1)  # type: ignore[call-arg]


def every_record(cls: type[Record] = Record) -> list[type[Record]]:
    return [cls, *(each for below in cls.__subclasses__() for each in every_record(below))]


@pytest.mark.parametrize("cls", every_record()[1:], ids=lambda cls: cls.__name__)
def test_constructors_keep_their_signatures(cls: type[Record]) -> None:
    named = [f.name for f in fields(cls)]
    assert list(inspect.signature(cls).parameters) == named
    with pytest.raises(TypeError, match=rf"^{cls.__name__}\.no_such_thing: unknown name"):
        cls(no_such_thing=1)
    from softpinch.support import suggest

    if named:
        assert suggest.hint(named[-1], cls) == f'; did you mean "{named[-1]}"?'


def test_a_result_that_is_given_as_a_scene_is_told_to_pass_its_scene() -> None:
    grip = sp.grip(sp.Scene(), force=5.0)
    for call in (sp.simulate, sp.equilibrium, sp.explain):
        with pytest.raises(TypeError, match=r"^scene = <Grip.*must be a Scene; pass its \.scene$"):
            call(grip)
    with pytest.raises(TypeError, match=r"must be a Hand; pass its \.hand$"):
        sp.Scene(hand=sp.Scene())  # type: ignore[arg-type]
