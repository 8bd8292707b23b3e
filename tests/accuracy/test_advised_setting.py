"""What `Advice` says of its setting, and the options that it does not leave to the caller."""

import html
from dataclasses import replace
from functools import cache
from typing import Any

import pytest

import softpinch as sp

SCENE = sp.Scene(duration=0.005)


@cache
def advised(equal: bool) -> sp.Advice:
    # Which steps of a method with both are quicker is a matter of timing; rk4 has equal steps only.
    found = sp.advise(SCENE, 1e-3, formulations="csm", methods="rk4", progress=False)
    assert found.dt is not None, found.message
    if equal:
        return found
    return replace(found, dt=None, step_tolerance=1e-3, method="radau5")


@pytest.mark.parametrize("equal", [True, False])
@pytest.mark.parametrize("option", ["dt", "tolerance", "method", "formulation", "stabilization"])
def test_an_option_that_the_advice_chooses_is_refused(equal: bool, option: str) -> None:
    with pytest.raises(TypeError) as error:
        advised(equal).simulate(**{"every": 2, option: 1e-4})
    assert str(error.value).startswith(f"{option} = 0.0001: must be left out, because the advice ")
    assert f"simulate(advice.scene, {option}=...)" in str(error.value)


@pytest.mark.parametrize("equal", [True, False])
def test_other_options_are_those_of_simulate(equal: bool) -> None:
    run = advised(equal).simulate(record=("state", "torque"), every=2)
    assert run.status == "completed" and run.torque.shape == (len(run.t), 2)
    with pytest.raises(TypeError, match="evry"):
        advised(equal).simulate(evry=2)


@pytest.mark.parametrize("equal", [True, False])
def test_it_shows_which_steps_it_advises_before_all_else(equal: bool) -> None:
    found = advised(equal)
    shown = f"adaptive: dt = None, step_tolerance = {found.step_tolerance}"
    if equal:
        shown = f"equal: dt = {found.dt:.5g}, step_tolerance = None"
    first, second, third, *_ = repr(found).splitlines()
    assert first == "<Advice" and second.split(None, 1) == ["steps", shown]
    assert third.split() == ["formulation", "csm"]
    page = html.unescape(found._repr_html_())
    assert shown in page and found.message[:60] in page


def test_its_docstring_says_when_dt_is_none() -> None:
    text: Any = " ".join((sp.Advice.__doc__ or "").split())
    assert "dt: The longest of equal steps, s. None if adaptive steps are advised" in text
