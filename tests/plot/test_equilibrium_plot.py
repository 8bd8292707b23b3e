"""Figures of equilibria and of wrench limits: what is drawn is what was computed, with units."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import softpinch as sp
from films import legend_of
from resting import held, leaning
from softpinch import plot

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.collections import LineCollection, QuadMesh  # noqa: E402


@cache
def heavier() -> sp.EquilibriumMap:
    """Stable, then unstable grasps over the mass."""
    axes = {"grasped.mass": np.linspace(0.1, 40.0, 12)}
    return sp.equilibrium_map(held(friction=(0.5, 0.7)), axes, progress=False)


@cache
def cusp() -> sp.EquilibriumMap:
    axes = {
        "grasped.com_offset": np.linspace(-2e-3, 2e-3, 9),
        "grasped.mass": np.linspace(1.0, 6.0, 11),
    }
    return sp.equilibrium_map(leaning(1.0, 0.0), axes, progress=False)


def test_the_curves_over_one_axis_are_the_map_s_numbers() -> None:
    map = heavier()
    figure = plot.equilibria(map)
    figure.draw_without_rendering()
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "rotation [deg]", "height $y$ [mm]", "stiffness [N/mm]",
        r"$K_{\theta\theta}$ [N m/rad]", "friction needed [1]", "growth [1/s]",
    ]  # fmt: skip
    assert figure.axes[-1].get_xlabel() == "mass (grasped) [kg]"
    solid, dashed = figure.axes[1].get_lines()
    count = np.count_nonzero(map.stable)
    assert 2 < count < 10 and map.stable[:count].all()
    cells, height = np.arange(len(map.values[0])), 1e3 * map.position[:, 1]
    np.testing.assert_allclose(solid.get_ydata(), np.where(cells < count, height, np.nan))
    # The dashed part joins the solid one.
    np.testing.assert_allclose(dashed.get_ydata(), np.where(cells >= count - 1, height, np.nan))
    assert solid.get_linestyle() == "-" and dashed.get_linestyle() == "--"
    assert {"stable", "unstable", "friction of the scene", "right", "left"} <= {*legend_of(figure)}
    levels = [set(np.asarray(line.get_ydata()).tolist()) for line in figure.axes[4].get_lines()]
    assert {0.5} in levels and {0.7} in levels
    # An upright grasp: round-off is not magnified.
    low, high = figure.axes[0].get_ylim()
    assert high - low > 0.01


def test_curves_break_between_branches_and_show_why_there_is_no_equilibrium() -> None:
    axes = {"grasped.com_offset": np.linspace(-2e-3, 2e-3, 12)}
    map = sp.equilibrium_map(leaning(4.0, -2e-3), axes, progress=False)
    assert set(map.branch.tolist()) == {0, 1}
    figure = plot.equilibria(map)
    turns = [np.asarray(line.get_ydata()) for line in figure.axes[0].get_lines()]
    assert sum(map.branch[1:] != map.branch[:-1]) == 1
    assert max(np.nanmax(np.abs(np.diff(part))) for part in turns) < 5.0
    assert figure.axes[-1].get_xlabel() == "offset of mass (grasped) [mm]"
    angles = {"schedule.angles.0.0": np.linspace(-0.2, 0.2, 9)}
    some = sp.equilibrium_map(held(1.0, fingers="driven"), angles, progress=False)
    none = some.status != "at_rest"
    assert none.any() and not none.all()
    figure = plot.equilibria(some)
    assert len(figure.axes[0].patches) == np.count_nonzero(none)
    for status in np.unique(some.status[none]):
        assert f"no equilibrium: {status.replace('_', ' ')}" in legend_of(figure)


def test_a_lone_cell_shows() -> None:
    map = sp.equilibrium_map(held(), {"grip": [0.0]}, progress=False)
    (line,) = plot.equilibria(map).axes[1].get_lines()
    assert line.get_marker() == "o"


def test_the_panels_over_two_axes_are_the_map_s_numbers() -> None:
    map = cusp()
    figure = plot.equilibria(map)
    figure.draw_without_rendering()
    panels = figure.axes[:4]
    drawn, scales = [], []
    for axes in panels:
        (mesh,) = [each for each in axes.collections if isinstance(each, QuadMesh)]
        drawn.append(np.ma.asarray(mesh.get_array()))
        scales.append(mesh.get_clim())
    at_rest = map.status == "at_rest"
    assert (~at_rest).any()
    np.testing.assert_array_equal(np.ma.getmaskarray(drawn[0]), ~at_rest.T)
    np.testing.assert_allclose(drawn[0].T[at_rest], np.rad2deg(map.rotation[at_rest]))
    np.testing.assert_allclose(drawn[1].T[at_rest], 1e3 * map.position[at_rest][:, 1])
    scale = np.diag([1.0, 1.0, 1.0 / (0.5 * map.scene.grasped.width)])
    stiffness = scale @ map.stiffness[at_rest] @ scale
    least = np.linalg.eigvalsh(0.5 * (stiffness + stiffness.transpose(0, 2, 1)))[:, 0]
    np.testing.assert_allclose(drawn[2].T[at_rest], 1e-3 * least)
    np.testing.assert_allclose(drawn[3].T[at_rest], map.friction_needed[at_rest].max(axis=1))
    # Zero is in the middle of the colours of the rotation, the other panels use all colours.
    most = np.abs(drawn[0]).max()
    assert scales == [(-most, most), *((each.min(), each.max()) for each in drawn[1:])]
    names = [axes.get_ylabel() for axes in figure.axes[4:]]
    assert names == [
        "rotation [deg]", "height $y$ [mm]", "smallest stiffness [N/mm]", "friction needed [1]"
    ]  # fmt: skip
    # A side of a cell for each seam, neighbour of another branch, and change of stability.
    sides: dict[str, int] = {"branch": len(map.seams), "stability": 0}
    seams = {tuple(pair.ravel().tolist()) for pair in map.seams}
    for i, j in np.ndindex(map.shape):
        for k, m in ((i + 1, j), (i, j + 1)):
            if k == map.shape[0] or m == map.shape[1] or not (at_rest[i, j] and at_rest[k, m]):
                continue
            if map.branch[i, j] != map.branch[k, m]:
                sides["branch"] += 1
            elif (i, j, k, m) not in seams and map.stable[i, j] != map.stable[k, m]:
                sides["stability"] += 1
    lines = [each for each in panels[0].collections if isinstance(each, LineCollection)]
    counts = [len(each.get_segments()) for each in lines]
    assert counts == [sides["stability"]] * 2 * (sides["stability"] > 1) + [sides["branch"]]
    assert {"fold between neighbours", "unstable"} <= {*legend_of(figure)}


def test_the_margin_of_friction_replaces_the_need_for_it() -> None:
    axes = {"grasped.mass": [0.1, 1.0], "grip": [0.0, 0.01]}
    map = sp.equilibrium_map(held(friction=0.5), axes, progress=False)
    figure = plot.equilibria(map)
    assert figure.axes[-1].get_ylabel() == "margin of friction [1]"
    mesh = figure.axes[3].collections[0]
    np.testing.assert_allclose(mesh.get_array(), map.friction_margin.T)  # type: ignore[arg-type]
    most = np.abs(map.friction_margin).max()
    assert mesh.get_clim() == (-most, most)
    # The friction suffices for the lighter objects only: one side of a cell for each grip.
    axes = {"grasped.mass": [0.1, 4.0, 12.0], "grip": [0.0, 0.01]}
    map = sp.equilibrium_map(held(friction=0.5), axes, progress=False)
    figure = plot.equilibria(map)
    lines = [each for each in figure.axes[0].collections if isinstance(each, LineCollection)]
    assert [len(each.get_segments()) for each in lines] == [2, 2]
    assert legend_of(figure) == ["limit of friction"]
    nothing = sp.equilibrium_map(
        held(-5.0), {"grasped.mass": [0.1, 1.0], "grip": [0.0, 0.01]}, progress=False
    )
    assert "no equilibrium: apart" in legend_of(plot.equilibria(nothing))


@cache
def limits() -> sp.WrenchLimits:
    return sp.wrench_limits(held(friction=0.6))


def test_the_limits_by_direction() -> None:
    figure = plot.wrench_limits(limits())
    figure.draw_without_rendering()
    (axes,) = figure.axes
    line, marks = axes.get_lines()
    np.testing.assert_allclose(np.sort(marks.get_ydata()), np.sort(limits().magnitude[:72]))
    np.testing.assert_allclose(
        np.asarray(marks.get_xdata())[:3], np.deg2rad([0.0, 5.0, 10.0]), atol=1e-12
    )
    # The outline is closed.
    assert len(np.asarray(line.get_xdata())) == 73
    assert legend_of(figure) == ["slipping"]
    assert f"+{limits().wrench[72, 2]:.3g} N m (slipping)" in axes.get_title()
    assert "force [N]" in [text.get_text() for text in axes.texts]
    # No number of the radial axis is on the marks: each is farther away than half its width.
    places = [text.get_position() for text in axes.texts if text.get_text() != "force [N]"]
    numbers = np.array([radius * np.exp(1j * angle) for angle, radius in places])
    points = np.asarray(marks.get_ydata()) * np.exp(1j * np.asarray(marks.get_xdata()))
    assert len(numbers) > 0
    assert np.abs(numbers[:, None] - points).min() > 0.15 * axes.get_ylim()[1]


def test_forces_of_an_ensemble_beside_the_limits() -> None:
    force = np.array([[1.0, 2.0], [-30.0, 0.0], [0.0, -200.0]])
    scene = held(friction=0.6, disturbances=[sp.Step(time=0.01)], duration=0.03)
    ensemble = sp.monte_carlo(scene, vary={"disturbances.0.force": force}, dt=5e-4, progress=False)
    held_ones = np.array([True, True, False])
    figure = plot.wrench_limits(limits(), ensemble, what=held_ones)
    second = figure.axes[1]
    held_dots, lost = second.get_lines()[-2:]
    np.testing.assert_allclose(held_dots.get_ydata(), np.hypot(*force[:2].T))
    np.testing.assert_allclose(lost.get_xdata(), [-np.pi / 2])
    assert {"held (2)", "not held (1)", "limit of slow forces"} <= {*legend_of(figure)}
    assert "bilateral contact, friction 0.6" in second.get_title()
    assert figure.axes[0].get_ylim() == second.get_ylim()
    by_name = plot.wrench_limits(limits(), ensemble)
    count = np.count_nonzero(ensemble.happened("holds"))
    assert f"held ({count})" in legend_of(by_name)


def test_directions_apart_are_not_joined_and_infinite_ones_are_counted() -> None:
    some = sp.wrench_limits(held(friction=0.6), [[1, 0, 0], [0.995, 0.1, 0], [-1, 0, 0]])
    line = plot.wrench_limits(some).axes[0].get_lines()[0]
    assert np.isnan(np.asarray(line.get_xdata())).any()
    free = replace(some, magnitude=np.array([1.0, 2.0, np.inf]))
    assert "1 directions without limit" in plot.wrench_limits(free).axes[0].get_title()


def test_missing_directions_and_forces_are_refused() -> None:
    with pytest.raises(ValueError, match="limits: must have a direction without moment"):
        plot.wrench_limits(sp.wrench_limits(held(), [[0.0, 0.0, 1.0]]))
    other = sp.monte_carlo(
        held(duration=0.002), vary={"grasped.mass": [0.1]}, dt=1e-3, progress=False
    )
    with pytest.raises(ValueError, match=r"force = .disturbances.0.force.0"):
        plot.wrench_limits(limits(), other)
