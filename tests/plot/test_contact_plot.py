"""Figures of unilateral contact: bands and colours are the run's modes, lines its residuals."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings

import softpinch as sp
from softpinch import paper, plot, strategies
from softpinch.plot import timeline
from softpinch.run import measures
from softpinch.scene import outline
from support.wild_contacts import wild_contact

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.colors import to_hex, to_rgb  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

ALL = ("state", "multipliers", "residuals", "energy")
FREE, STICK, SLIP, GRAZE = (sp.ContactMode(k) for k in range(4))
REAL: dict[str, Any] = {
    "contact": "unilateral",
    "friction": 0.5,
    "grasped": sp.GraspedObject(height=0.049),
}


@pytest.fixture(scope="module")
def run() -> sp.Run:
    """Two of the paper's operations; the left tip opens at the switch, slips, and sticks again."""
    return sp.simulate(paper.manipulation(duration=1.2, **REAL), record=(*ALL, "contact"))


@pytest.fixture(scope="module")
def overview(run: sp.Run) -> Figure:
    return plot.run(run)


@pytest.fixture(scope="module")
def cases() -> dict[str, sp.Run]:
    slippery = REAL | {"friction": 0.3}
    return {
        case: sp.simulate(paper.disturbance(case, **slippery), record=ALL) for case in ("i", "iii")
    }


def bands(axes: Axes) -> dict[str, list[tuple[float, float, float]]]:
    """Colour of a mode -> begin, end and middle height of each of its bars, from left to right."""
    found: dict[str, list[tuple[float, float, float]]] = {}
    for collection in axes.collections:
        for path in collection.get_paths():
            (begin, low), (end, high) = path.vertices.min(axis=0), path.vertices.max(axis=0)
            color = to_hex(collection.get_facecolor()[0])
            found.setdefault(color, []).append((begin, end, 0.5 * (low + high)))
    return {color: sorted(bars) for color, bars in found.items()}


def strips(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.collections]


def legend_below(figure: Figure) -> list[str]:
    """The entries of the legend of modes, of which each figure has one at most."""
    names = set(timeline.LABELS.values())
    entries = [[text.get_text() for text in legend.get_texts()] for legend in figure.legends]
    (found,) = [texts for texts in entries if names & set(texts)]
    return found


def colour(mode: sp.ContactMode) -> str:
    return to_hex(timeline.COLORS[mode])


def test_bands_are_the_changes_of_the_run(run: sp.Run, overview: Figure) -> None:
    times = [change.time for change in run.contact_changes]
    assert [(c.finger, c.after) for c in run.contact_changes] == [
        ("left", FREE), ("left", SLIP), ("left", STICK)
    ]  # fmt: skip
    forces = plot.forces(run)
    for figure in (plot.motion(run), plot.residuals(run), overview, forces):
        axes = strips(figure)[0]
        right, left = axes.get_yticks()
        assert right > left
        assert [text.get_text() for text in axes.get_yticklabels()] == ["right", "left"]
        found = bands(axes)
        assert set(found) == {colour(FREE), colour(SLIP), colour(STICK)}
        np.testing.assert_allclose(found[colour(FREE)], [(1.0, times[1], left)], rtol=1e-12)
        np.testing.assert_allclose(found[colour(SLIP)], [(times[1], times[2], left)], rtol=1e-12)
        sticks = [(0.0, 1.0, left), (0.0, 1.2, right), (times[2], 1.2, left)]
        np.testing.assert_allclose(found[colour(STICK)], sticks, rtol=1e-12)
        assert legend_below(figure) == ["tip sticks", "slips", "free"]
        assert axes.get_xlabel() == "time [s]" and axes.get_xlim() == (0.0, 1.2)
    # The zoom of the forces has them too.
    zoomed = bands(strips(forces)[1])[colour(FREE)]
    np.testing.assert_allclose([bar[:2] for bar in zoomed], [(1.0, times[1])])


def test_runs_without_modes_or_changes_have_fewer_axes() -> None:
    run = sp.simulate(paper.manipulation(duration=1.2), dt=1e-3, record=(*ALL, "contact"))
    figures = [plot.run(run), plot.forces(run), plot.contact_models({"a": {"b": run}})]
    for figure in (*figures, plot.snapshots(run, [1.0])):
        assert not strips(figure)
        legends = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
        assert not set(timeline.LABELS.values()) & set(legends)
    with pytest.raises(ValueError, match=r"run\.scene\.contact = 'bilateral': must be 'unilat"):
        plot.contact(run)
    scene = sp.Scene(contact="unilateral", friction=1.0, duration=0.05)
    figure = plot.contact(sp.simulate(scene, record=("residuals",)))
    assert [axes.get_ylabel() for axes in figure.axes][1:] == ["slip [m/s]", ""]
    assert legend_below(figure) == ["tip sticks"]


def test_modes_differ_in_grey() -> None:
    lightness = sorted(np.dot(to_rgb(color), [0.2126, 0.7152, 0.0722])
                       for color in timeline.COLORS.values())  # fmt: skip
    assert np.diff(lightness).min() > 0.1
    assert set(timeline.COLORS) == set(sp.ContactMode)


def test_residuals_leave_out_constraints_that_do_not_act(run: sp.Run) -> None:
    figure = plot.residuals(run)
    # The left tip is free from 1 to 1.0017 s, and slips until 1.0022 s; the right tip sticks.
    away = (run.t > 1.0) & (run.t < 1.0017)
    for k in range(4):
        values = np.full(len(run.t), np.nan)
        line = figure.axes[k].get_lines()[0]
        rows = np.searchsorted(run.t, line.get_xdata())
        values[rows] = line.get_ydata()
        if k % 2 == 0:
            assert not np.isnan(values[rows]).any()
            continue
        off = np.isnan(values[rows])
        assert off.any() and (run.t[rows[off]] > 1.0).all() and (run.t[rows[off]] < 1.0023).all()
        assert off[away[rows]].all()
    assert np.abs(run.residuals[away, 1]).max() > 1e-4
    assert figure.axes[1].get_ylim()[1] == pytest.approx(5e-4)


def test_contact_draws_gaps_slip_and_forces(run: sp.Run) -> None:
    figure = plot.contact(run)
    axes = np.reshape(np.array(figure.axes, dtype=object), (4, 2))
    names = [each.get_ylabel() for each in axes[:, 0]]
    assert names == ["gap [mm]", "slip [m/s]", r"$\lambda^H$ [N]", ""]
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["finger 1 (right)", "finger 2 (left)"]
    gap, slip = (axes[row, 1].get_lines()[1] for row in (0, 1))
    first, closed, stuck = (change.time for change in run.contact_changes)
    np.testing.assert_allclose(gap.get_ydata(), 1e3 * run.residuals[:, 1], rtol=1e-12)
    t, values = run.t, np.asarray(slip.get_ydata())
    free = (t > first) & (t <= closed)
    assert (np.isnan(values) == free).all()
    sliding = (t > closed) & (t < stuck)
    assert sliding.any() and (np.abs(values[sliding]) > 1e-2).all()
    low, high = axes[3, 1].get_xlim()
    assert low < first and stuck < high < 2.0 * stuck - first


def test_the_overview_draws_the_losses_by_contact(run: sp.Run, overview: Figure) -> None:
    panels = {axes.get_title("left")[4:]: axes for axes in overview.axes}
    assert {"gaps", "slip", "by contact"} <= set(panels)
    lines = {line.get_label(): line for line in panels["by contact"].get_lines()}
    for label, values in (
        ("friction", run.energy.friction_loss),
        ("impacts", run.energy.impact_loss),
        ("relaxation", run.energy.relaxation_work),
    ):
        assert lines[label].get_ydata()[-1] == values[-1] != 0.0
    (lost,) = [line for line in panels["ledger"].get_lines() if line.get_label() == "lost"]
    taken = run.energy.friction_loss + run.energy.impact_loss + run.energy.viscous_loss
    assert lost.get_ydata()[-1] == pytest.approx(taken[-1], rel=1e-14)
    bare = sp.simulate(paper.manipulation(duration=0.1, **REAL), record=("residuals",))
    assert len([axes for axes in plot.run(bare).axes if axes.get_title("left")]) == 3


def test_the_window_ends_with_the_run(cases: dict[str, sp.Run]) -> None:
    lost = cases["i"]
    assert lost.status == "lost"
    assert strips(plot.contact(lost))[1].get_xlim()[1] == lost.t[-1]
    assert "grazes" in legend_below(plot.contact(lost))


def test_snapshots_colour_tips_by_their_modes(run: sp.Run) -> None:
    figure = plot.snapshots(run, [1.0, 1.001, 1.002])
    # Of each drawing: the base, the object, then eight parts of each finger, tip first.
    tips = [[to_hex(axes.patches[k].get_facecolor()) for k in (2, 10)] for axes in figure.axes]
    assert tips == [
        [colour(STICK), colour(STICK)],
        [colour(STICK), colour(FREE)],
        [colour(STICK), colour(SLIP)],
    ]
    assert legend_below(figure) == ["tip sticks", "slips", "free"]
    assert to_hex(outline.SKIN) == colour(STICK)


def test_disturbances_and_models_have_bands_for_each_run(cases: dict[str, sp.Run]) -> None:
    figure = plot.disturbances(cases)
    stays, passes = strips(figure)
    found = bands(passes)[colour(SLIP)]
    ends = [span[1] - 1.0 for side in (0, 1) for span in measures.contact_spans(cases["iii"], side)
            if span[2] is SLIP]  # fmt: skip
    np.testing.assert_allclose(sorted(bar[1] for bar in found), sorted(ends))
    assert colour(GRAZE) in bands(stays)
    # Each run that ended early ends in a cross, in all of its five panels.
    crosses = [
        each for axes in figure.axes for each in axes.get_lines() if each.get_marker() == "x"
    ]
    early = [case for case, run in cases.items() if not run.success]
    assert early and len(crosses) == 5 * len(early)
    bilateral = sp.simulate(paper.disturbance("iii"))
    models = {"the paper's": bilateral, "μ = 0.3": cases["iii"], "other": cases["iii"]}
    figure = plot.contact_models({"(i)": {"μ = 0.3": cases["i"]}, "(iii)": models})
    one, two = strips(figure)
    assert [text.get_text() for text in two.get_yticklabels()] == ["μ = 0.3", "other"]
    # A column with fewer runs has bands as high as the others.
    assert np.ptp(one.get_ylim()) == pytest.approx(np.ptp(two.get_ylim()))
    crosses = [line for line in figure.axes[0].get_lines() if line.get_marker() == "x"]
    assert len(crosses) == 1
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["μ = 0.3", "the paper's", "other"]
    (line,) = [li for li in figure.axes[5].get_lines() if li.get_label() == "the paper's"]
    assert figure.axes[5].get_ylabel() == r"$\Delta \theta_{\mathrm{obj}}$ [deg]"
    change = np.rad2deg(bilateral.q[:, 2] - bilateral.q[10000, 2])[10000:]
    assert np.abs(line.get_ydata()).max() == pytest.approx(np.abs(change).max(), rel=1e-12)


def test_a_run_that_ends_at_its_start_has_no_window_of_changes() -> None:
    scene, options = wild_contact(2633, 0.3)
    run = sp.simulate(scene, record=("state", "residuals", "contact"), **options)
    assert run.contact_changes and run.t[-1] == run.t[0]
    figure = plot.contact(run)
    figure.draw_without_rendering()
    assert len(figure.axes) == 2 + len(strips(figure))


# Drawing takes seconds: shrinking would take minutes.
WITHOUT_SHRINKING = [Phase.explicit, Phase.reuse, Phase.generate]


# The first example is the simplest scene, the second a random one.
@settings(max_examples=2, phases=WITHOUT_SHRINKING)
@given(strategies.scenes(spread=2.0, duration=0.05))
def test_any_run_can_be_drawn(scene: sp.Scene) -> None:
    friction = 0.3 if scene.friction is None else scene.friction
    real = replace(scene, contact="unilateral", friction=friction)
    run = sp.simulate(real, dt=1e-4, record=ALL)
    ends = plot.snapshots(run, [run.t[0], run.t[-1]])
    for figure in (plot.run(run), plot.contact(run), plot.forces(run), ends):
        # Without its layout a figure is drawn in a third of the time.
        figure.set_layout_engine("none")
        figure.draw_without_rendering()
