"""The figure of the energy around rests has the curves that it is given."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from softpinch.reproduce.energy_minimum import EnergyCurves
from softpinch.reproduce.figures import energy_minima


def curves(shift: float) -> EnergyCurves:
    theta = np.linspace(-0.1, 0.1, 5)
    return EnergyCurves(
        rest=np.array([shift, 0.0]),
        rolled=np.stack([theta, theta**2]),
        family=np.stack([2.0 * theta, theta**2 - shift]),
        lowest=np.array([0.0, -shift]),
    )


def test_the_curves_are_in_degrees_and_millijoules() -> None:
    given = {f"rest {k}": curves(0.01 * k) for k in range(5)}
    figure = energy_minima(given)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    titles = [axes.get_title(loc="left") for axes in shown]
    assert titles == [f"({letter}) rest {k}" for k, letter in enumerate("abcde")]
    for axes, found in zip(shown, given.values(), strict=True):
        lines = {line.get_label(): line.get_xydata() for line in axes.get_lines()}
        for label, curve in (
            ("turned without slip", found.rolled),
            ("other states of rest", found.family),
            ("lowest state of rest", found.lowest[:, None]),
            ("rest that is reached", found.rest[:, None]),
        ):
            expected = np.column_stack([np.rad2deg(curve[0]), 1e3 * curve[1]])
            np.testing.assert_allclose(lines[label], expected, atol=1e-12)
    # The axes whose lower neighbour is missing say what they show, too.
    assert [bool(axes.get_xlabel()) for axes in shown] == [False, True, True, True, True]
    (legend,) = figure.legends
    assert len(legend.get_texts()) == 4
    assert [text.get_text() for text in figure.texts] == [r"targets $(\theta_1, \theta_2)$:"]


def test_without_a_rest_there_is_an_empty_figure() -> None:
    assert not any(axes.get_visible() for axes in energy_minima({}).axes)
