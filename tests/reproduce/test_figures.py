"""The figure of the energy around rests has the curves that it is given."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from softpinch.reproduce.report import energy_minima


def test_the_curves_are_in_degrees_and_millijoules() -> None:
    theta = np.linspace(-0.1, 0.1, 5)
    given = {f"rest {k}": np.stack([theta + 0.01 * k, k * theta**2]) for k in range(5)}
    shown = [axes for axes in energy_minima(given).axes if axes.get_visible()]
    titles = [axes.get_title(loc="left") for axes in shown]
    assert titles == [f"({letter}) rest {k}" for k, letter in enumerate("abcde")]
    for axes, curve in zip(shown, given.values(), strict=True):
        _, line, point = (each.get_xydata() for each in axes.get_lines())
        expected = np.column_stack([np.rad2deg(curve[0]), 1e3 * curve[1]])
        np.testing.assert_allclose(line, expected, atol=1e-12)
        np.testing.assert_allclose(point, expected[2:3], atol=1e-12)
    # The axes whose lower neighbour is missing say what they show, too.
    assert [bool(axes.get_xlabel()) for axes in shown] == [False, True, True, True, True]


def test_without_a_rest_there_is_an_empty_figure() -> None:
    assert not any(axes.get_visible() for axes in energy_minima({}).axes)
