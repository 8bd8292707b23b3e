"""The coordinates in which a fit searches: their bounds, their logarithm, and their slope."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import softpinch as sp
from measured_motions import SCENE, TRUTH, C, E
from softpinch.fitting.problem import Parameter, parameters, slopes, values

FORCE = "disturbances.0.force.0"


def one(path: str, bounds: Any, scene: sp.Scene = SCENE, **start: float) -> Parameter:
    given = {path: start["start"]} if start else None
    (found,) = parameters([scene], {path: bounds}, given)
    return found


@st.composite
def drawn(draw: st.DrawFn) -> Parameter:
    low = draw(st.floats(1e-3, 1e3))
    ratio = draw(st.floats(1.5, 1e6))
    share = draw(st.floats(0.0, 1.0))
    return one(E, (low, low * ratio), start=low + share * (low * ratio - low))


@given(drawn(), st.floats(0.0, 1.0))
def test_coordinates_and_values_belong_to_each_other(found: Parameter, share: float) -> None:
    low, high = found.bounds
    assert found.value(0.0) == found.start
    # A step of one is the whole range.
    assert high - low == pytest.approx(1.0, rel=1e-9)
    u = low + share * (high - low)
    assert found.coordinate(found.value(u)) == pytest.approx(u, abs=1e-9)
    # The logarithm makes equal steps of u equal factors.
    middle = math.sqrt(found.low * found.high) if found.log else 0.5 * (found.low + found.high)
    assert found.value(0.5 * (low + high)) == pytest.approx(middle, rel=1e-9)


@given(drawn(), st.floats(0.01, 0.99))
def test_slopes_are_the_derivatives_of_the_values(found: Parameter, share: float) -> None:
    low, high = found.bounds
    u, h = low + share * (high - low), 1e-5 * (high - low)
    numeric = (found.value(u + h) - found.value(u - h)) / (2.0 * h)
    assert found.slope(u) == pytest.approx(numeric, rel=1e-6)


@pytest.mark.parametrize(
    ("path", "bounds", "log", "low", "span", "room"),
    [
        (E, (1e5, 1.01e6), True, 1e5, math.log(10.1), 1.0),
        (E, (1e5, 9.9e5), False, 1e5, 8.9e5, 1.0),
        (E, (0.0, 1e6), False, 0.0, 1e6, 1.0),
        (FORCE, (-5.0, 5.0), False, -5.0, 10.0, 1.0),
        (FORCE, (1.0, math.inf), True, 1.0, math.log(10.0), 3.0),
        # The scene refuses moduli below zero, but no forces.
        (E, None, True, 0.0, math.log(10.0), 3.0),
        (FORCE, None, False, -math.inf, 3.0, 1e3),
    ],
)
def test_bounds_decide_on_the_logarithm_and_the_span(
    path: str, bounds: Any, log: bool, low: float, span: float, room: float
) -> None:
    found = one(path, bounds)
    assert (found.log, found.low) == (log, low)
    assert found.span == pytest.approx(span, rel=1e-12)
    assert found.room == pytest.approx(room, rel=1e-12)


def test_the_start_is_the_scenes_value_or_the_bound_next_to_it() -> None:
    assert one(E, (1e4, 1e7)).start == sp.Fingertip().youngs_modulus
    assert one(E, (1e6, 2e6)).start == 1e6 and one(E, (1e4, 2e4)).start == 2e4
    assert one(E, (1e4, 1e7), start=5e4).start == 5e4
    # A tip without a mass of its own has that of the object.
    heavy = SCENE.with_({"grasped.mass": 0.25})
    assert one("hand.tip.normal_mass", None, heavy).start == 0.25


def test_values_stay_within_the_bounds_however_far_a_step_goes() -> None:
    for path, bounds in ((E, (1e4, 1e7)), (FORCE, (-5.0, 5.0)), (E, None)):
        found = one(path, bounds)
        assert found.value(-1e9) == found.low and found.value(1e9) == found.high
    assert one(E, None).bounds == (-math.inf, math.inf)


def test_all_parameters_together() -> None:
    found = parameters([SCENE, SCENE], {E: (1e4, 1e7), C: (1.0, 1e3)}, TRUTH)
    assert values(found, np.zeros(2)) == pytest.approx(TRUTH)
    assert [each.unit for each in found] == ["Pa", "N s/m"]
    u = np.array([0.1, -0.2])
    each = [one.slope(at) for one, at in zip(found, u, strict=True)]
    np.testing.assert_array_equal(slopes(found, u), each)
