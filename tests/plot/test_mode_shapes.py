"""Figures of modes and compliance show the linear model's own numbers."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import softpinch as sp
from softpinch import plot
from softpinch.plot import mode_shapes
from softpinch.plot.style import LETTERS

SCENE = sp.Scene(schedule=sp.Schedule.steps([0.0], np.radians([[9.0, 3.0]])))


@pytest.fixture(scope="module")
def rest() -> sp.Equilibrium:
    return sp.equilibrium(SCENE)


def titles(figure: Figure) -> list[str]:
    """The titles without their letters, which come one after the other."""
    found = [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]
    assert [title[:4] for title in found] == [f"({letter}) " for letter in LETTERS[: len(found)]]
    return [title[4:] for title in found]


def test_the_slowest_modes_follow_the_neutral_directions(rest: sp.Equilibrium) -> None:
    slow = rest.eigenvalues[2:][np.argsort(np.abs(rest.eigenvalues[2:]))]
    shown = titles(plot.modes(rest, most=4))
    assert shown[:2] == ["neutral: both grips", "neutral: grips opposite"]
    assert shown[2:] == [f"time constant {-1e3 / rate.real:.3g} ms" for rate in slow[:2]]


def test_titles_name_growing_modes() -> None:
    torques = sp.Schedule.steps([0.0], [[1.2, 1.2]])
    found = sp.equilibrium(sp.Scene(control=sp.Torque(), schedule=torques))
    assert found.growth > 0.0
    growing = f"grows, time constant {1e3 / found.growth:.3g} ms"
    assert [title for title in titles(plot.modes(found)) if "grows" in title] == [growing]


def test_no_shape_moves_farther_than_the_largest_displacement(rest: sp.Equilibrium) -> None:
    """The tips stay on the object: none is torn off, and none is crushed."""
    assert rest.state is not None
    radius = sp.Fingertip().radius
    for shape in mode_shapes._shapes(rest):
        q = mode_shapes._moved(SCENE, rest.state.q, shape.direction)
        assert np.hypot(*(q - rest.state.q)[:2]) < 0.3 * radius
        assert (q[5:7] > 0.0).all() and (q[5:7] < radius).all()


def test_each_pair_of_conjugate_modes_is_drawn_once(rest: sp.Equilibrium) -> None:
    figure = plot.modes(rest, most=100)
    pairs = int((rest.eigenvalues.imag > 0.0).sum())
    assert pairs > 0
    assert len(titles(figure)) == len(rest.eigenvalues) - pairs
    assert sum("Hz" in title for title in titles(figure)) <= pairs


def test_integrals_that_nothing_reads_are_no_modes() -> None:
    found = sp.equilibrium(replace(SCENE, control=sp.Pid(ki=0.0)))
    shown = titles(plot.modes(found, most=100))[2:]
    rates = found.eigenvalues[found.eigenvalues != 0.0]
    assert len(rates) == 10  # pose, fingers and their rates
    # Those of a millisecond and more; all shrink, and none oscillates.
    slow = 1e3 / np.sort(np.abs(rates[np.abs(rates) < 1000.0]))
    assert [text for text in shown if "ms" in text] == [f"time constant {t:.3g} ms" for t in slow]
    assert len(shown) == len(rates)


def test_an_oscillation_says_its_frequency_and_its_damping() -> None:
    tip = sp.Fingertip(normal_viscosity=1.0, tangential_viscosity=1.0)
    scene = replace(SCENE, hand=sp.Hand(tip=tip), fingers="driven")
    found = sp.equilibrium(scene)
    rate = found.eigenvalues[2:][np.argmin(np.abs(found.eigenvalues[2:]))]
    hertz, damping = abs(rate) / (2.0 * np.pi), -rate.real / abs(rate)
    assert titles(plot.modes(found))[2] == f"{hertz:.3g} Hz, damping {damping:.2f}"


@pytest.mark.parametrize("fingers", ["pid", "driven"])
def test_shapes_solve_the_eigenvalue_problem(fingers: str) -> None:
    """The derivative of q along a mode is its eigenvalue times the mode."""
    found = sp.equilibrium(replace(SCENE, fingers=fingers))
    assert found.state is not None
    model = sp.linearize(found.scene, found, inputs="force", outputs=("pose", "shears"))
    for shape in mode_shapes._shapes(found)[2:]:
        if shape.rate.imag == 0.0:
            state = np.linalg.eig(model.A)
            nearest = np.argmin(np.abs(state.eigenvalues - shape.rate))
            own = (model.C @ state.eigenvectors[:, nearest]).real
            theirs = shape.direction[[0, 1, 2, 7, 8]]
            factor = own @ theirs / (own @ own)
            assert np.abs(theirs - factor * own).max() < 1e-7 * np.abs(theirs).max()


def test_compliance_is_that_of_the_stiffness_at_low_and_of_the_mass_at_high_frequency() -> None:
    found = sp.equilibrium(replace(SCENE, fingers="driven"))
    figure = plot.compliance(found, [1e-3, 1e5])
    lines = {line.get_label(): line for axes in figure.axes[:2] for line in axes.lines}
    static = np.diag(np.linalg.inv(found.stiffness))
    assert figure.axes[0].get_ylabel() == "compliance [mm/N]"
    assert figure.axes[-1].get_xlabel() == "frequency [Hz]"
    names = ["$x$ over $F_x$", "$y$ over $F_y$", r"$\theta$ over the moment"]
    for k, name in enumerate(names):
        scale = np.degrees(1.0) if k == 2 else 1e3
        low, high = np.asarray(lines[name].get_ydata())
        assert low == pytest.approx(scale * static[k], rel=1e-6)
        assert high < 1e-6 * low


def test_unilateral_contact_has_the_figures_of_sticking_tips(rest: sp.Equilibrium) -> None:
    found = sp.equilibrium(replace(SCENE, contact="unilateral", friction=0.9))
    assert titles(plot.modes(found)) == titles(plot.modes(rest))
    ours, theirs = (
        [line.get_ydata() for axes in plot.compliance(of, [1.0, 30.0]).axes for line in axes.lines]
        for of in (found, rest)
    )
    assert len(ours) == 6
    np.testing.assert_array_equal(ours, theirs)


def test_missing_equilibria_and_wrong_frequencies_are_refused(rest: sp.Equilibrium) -> None:
    apart = sp.equilibrium(replace(SCENE, schedule=sp.Schedule.steps([0.0], [[-0.5, -0.5]])))
    with pytest.raises(ValueError, match="no modes, because no equilibrium"):
        plot.modes(apart)
    with pytest.raises(ValueError, match="no compliance"):
        plot.compliance(apart)
    with pytest.raises(ValueError, match=r"frequency_hz\[1\] = 0.0: must be > 0"):
        plot.compliance(rest, [1.0, 0.0])
