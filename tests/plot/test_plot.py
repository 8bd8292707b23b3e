"""Figures: what is drawn is what was recorded, every axis says what it shows and in which unit."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import softpinch as sp
from films import legend_of
from softpinch import paper, plot
from softpinch.plot import style
from softpinch.plot.style import LETTERS
from softpinch.run import measures
from softpinch.scene import outline

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

ALL = ("state", "multipliers", "residuals", "energy")
TURNED = sp.HandMotion.minimum_jerk([0.0, 0.1], [[0.0, 0.0], [0.3, -0.1]], [0.2, 0.9])
PUSH = sp.Pulse(time=0.05, duration=0.02, force=(5.0, 10.0))
CARRIED = sp.Scene(motion=TURNED, disturbances=[PUSH], duration=0.12)
MINUS = sp.Hand(tip=sp.Fingertip(tilt_coupling=-1.0))


@pytest.fixture(scope="module")
def run() -> sp.Run:
    """Two operations of the paper; short enough to be drawn whole."""
    return sp.simulate(paper.manipulation(duration=1.5), dt=1e-3, record=ALL)


@pytest.fixture(scope="module")
def cases() -> dict[str, sp.Run]:
    return {case: sp.simulate(paper.disturbance(case), dt=1e-3) for case in paper.CASES}


@pytest.fixture(scope="module")
def figures(run: sp.Run, cases: dict[str, sp.Run]) -> dict[str, Figure]:
    lost = sp.simulate(paper.disturbance("i", hand=MINUS), dt=1e-3, record=ALL)
    other = sp.simulate(paper.manipulation(duration=1.5, hand=MINUS), dt=1e-3)
    return {
        "snapshots": plot.snapshots(run, [0.0, 1.0, 1.5]),
        "motion": plot.motion(run),
        "residuals": plot.residuals(run),
        "disturbances": plot.disturbances(cases),
        "forces": plot.forces(run),
        "tilt_coupling": plot.tilt_coupling(run, other, cases["i"], lost, "disturbance (i)"),
        "run": plot.run(run),
        "lost": plot.run(lost),
        "carried": plot.run(sp.simulate(CARRIED, dt=1e-3, record=ALL)),
    }


def visible(figure: Figure) -> Iterator[Axes]:
    return (axes for axes in figure.axes if axes.get_visible())


def drawn(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    (line,) = [line for line in axes.get_lines() if line.get_label() == label]
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_every_axis_has_a_name_and_a_unit(figures: dict[str, Figure]) -> None:
    for name, figure in figures.items():
        for axes in visible(figure):
            below = [
                other for other in visible(figure) if axes.get_shared_x_axes().joined(axes, other)
            ]
            assert any("[" in other.get_xlabel() for other in below), name
            beside = [
                axes,
                *(o for o in visible(figure) if axes.get_shared_y_axes().joined(axes, o)),
            ]
            labels = [other.get_ylabel() for other in beside]
            assert any("[" in label or label == "residual" for label in labels), (name, labels)


def test_every_panel_has_its_letter(figures: dict[str, Figure]) -> None:
    counts = {"snapshots": 3, "motion": 5, "residuals": 4, "disturbances": 10, "forces": 4,
              "tilt_coupling": 6, "run": 8, "lost": 8}  # fmt: skip
    for name, count in counts.items():
        texts = [
            text
            for axes in visible(figures[name])
            for text in (axes.get_title("left"), *(t.get_text() for t in axes.texts))
        ]
        for letter in LETTERS[:count]:
            assert sum(text.startswith(f"({letter})") for text in texts) == 1, (name, letter)


def test_legends_tell_the_lines_apart(figures: dict[str, Figure]) -> None:
    assert legend_of(figures["motion"]) == ["simulated", "target"]
    assert legend_of(figures["disturbances"]) == ["(i)", "(ii)", "(iii)", "(iv)"]
    assert legend_of(figures["tilt_coupling"])[:2] == [r"$\kappa = +1$", r"$\kappa = -1$"]
    assert {"finger 1 (right)", "finger 2 (left)"} <= set(legend_of(figures["forces"]))
    for name in ("disturbances", "tilt_coupling", "forces"):
        for axes in visible(figures[name]):
            named = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
            lines = [line for line in named if line.get_marker() != "x"]
            looks = {(str(line.get_color()), str(line.get_linestyle())) for line in lines}
            dashes = {str(line._unscaled_dash_pattern) for line in lines}  # type: ignore[attr-defined]
            assert len(looks) == len(lines), name
            # In grey the colours are gone: the dashes alone must tell them apart.
            assert len(dashes) == len(lines), name


def test_motion_draws_the_run(run: sp.Run, figures: dict[str, Figure]) -> None:
    scales = [np.rad2deg(1.0), np.rad2deg(1.0), 1e3, 1e3, np.rad2deg(1.0)]
    for axes, column, scale in zip(figures["motion"].axes, (3, 4, 0, 1, 2), scales, strict=True):
        t, y = drawn(axes, "simulated")
        np.testing.assert_array_equal(t, run.t)
        np.testing.assert_array_equal(y, scale * run.q[:, column])
    t, y = drawn(figures["motion"].axes[0], "target")
    np.testing.assert_array_equal(y, np.rad2deg(1.0) * run.scene.schedule.target(run.t)[:, 0])


def test_residuals_draws_sizes_and_the_papers_levels(
    run: sp.Run, figures: dict[str, Figure]
) -> None:
    for k, (axes, level) in enumerate(
        zip(figures["residuals"].axes, (1e-8, 1e-8, 1e-6, 1e-6), strict=True)
    ):
        curve = axes.get_lines()[0]
        np.testing.assert_array_equal(
            curve.get_ydata(), np.maximum(np.abs(run.residuals[:, k]), 1e-16)
        )
        assert axes.get_yscale() == "log"
        assert (np.asarray(axes.get_lines()[1].get_ydata()) == level).all()
        assert any("paper" in text.get_text() for text in axes.texts)


def test_disturbances_draws_changes_since_the_onset(
    cases: dict[str, sp.Run], figures: dict[str, Figure]
) -> None:
    axes = np.reshape(np.array(figures["disturbances"].axes, dtype=object), (5, 2))
    assert axes[0, 0].get_title() == "forces that stay: (i)"
    t, y = drawn(axes[4, 0], "(i)")
    start = int(np.searchsorted(cases["i"].t, 1.0))
    np.testing.assert_array_equal(t, cases["i"].t[start:] - 1.0)
    q = cases["i"].q[start:]
    np.testing.assert_allclose(y, np.rad2deg(q[:, 2] - q[0, 2]), rtol=1e-14)
    # The passing ones are a hundred times smaller: thousandths of a degree.
    assert "[mdeg]" in axes[0, 1].get_ylabel()
    assert {line.get_label() for line in axes[0, 1].get_lines()} >= {"(ii)", "(iii)", "(iv)"}


def test_forces_marks_where_a_tip_pulls(run: sp.Run, figures: dict[str, Figure]) -> None:
    axes = np.reshape(np.array(figures["forces"].axes, dtype=object), (4, 2))
    pulls = [pull for side in (0, 1) for pull in measures.pulling_intervals(run, side)]
    assert pulls  # the switch at 1 s
    triangles = [line for line in axes[0, 0].get_lines() if line.get_marker() == "v"]
    assert sum(len(line.get_xdata()) for line in triangles) == len(pulls)
    # The zoom shades them.
    shaded = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes[0, 1].patches]
    np.testing.assert_allclose(shaded, pulls)
    labels = [label.get_text() for label in axes[1, 0].get_yticklabels()]
    assert r"$\infty$" in labels
    needed = drawn(axes[1, 0], r"$|\lambda_2^N| / \lambda_2^H$")[1]
    assert np.isnan(needed[run.multipliers[:, 1] < 0]).all()


def test_the_grasp_that_is_lost_ends_in_a_cross(figures: dict[str, Figure]) -> None:
    crosses = [
        line
        for axes in figures["tilt_coupling"].axes
        for line in axes.get_lines()
        if line.get_marker() == "x"
    ]
    assert len(crosses) == 3
    assert legend_of(figures["tilt_coupling"])[-1] == "separated"
    axes = figures["tilt_coupling"].axes[1]
    assert axes.get_title() == "under disturbance (i)"
    # Of the time before the onset no more than a glimpse is drawn: it would set the axis' limits.
    assert min(line.get_xdata()[0] for line in axes.get_lines()) > -0.03


def test_run_says_how_it_ended_and_whose_the_dotted_lines_are(figures: dict[str, Figure]) -> None:
    (legend,) = figures["lost"].legends
    assert legend.get_title().get_text() == "separated at 1.07 s"
    # The violation that ended the run has no line: the run's end shows it.
    (text,) = [text.get_text() for text in legend.get_texts()]
    assert text == "pulling first at 1.003 s, rim first at 1.063 s"
    for axes in visible(figures["lost"]):
        dotted = [line for line in axes.get_lines() if line.get_linestyle() == ":"]
        assert len([line for line in dotted if line.get_color() == style.RED]) == 2
    (legend,) = plot.run(sp.simulate(sp.Scene(duration=0.1), dt=1e-3)).legends
    assert (legend.get_title().get_text(), legend.get_texts()) == ("completed at 0.1 s", [])
    assert "loads" in legend_of(figures["lost"])


@pytest.mark.parametrize(
    ("recorded", "panels"),
    [(("state",), 4), (("multipliers",), 1), (("residuals",), 1), (("state", "energy"), 6)],
)
def test_run_draws_what_was_recorded(recorded: tuple[str, ...], panels: int) -> None:
    run = sp.simulate(paper.manipulation(duration=0.1), dt=1e-3, record=recorded)
    assert len(list(visible(plot.run(run)))) == panels


def test_run_draws_the_acceleration_along_the_axes_of_a_hand_that_moves(
    figures: dict[str, Figure],
) -> None:
    below, last = list(visible(figures["carried"]))[-2:]
    turns = np.exp(-1j * TURNED.at(drawn(below, "along its $x$")[0]).tilt)
    for part, label in ((np.real, "along its $x$"), (np.imag, "along its $y$")):
        t, values = drawn(below, label)
        assert (t[0], t[-1]) == (0.0, 0.12)
        along = (TURNED.at(t).acceleration @ [1.0, 1.0j]) * turns
        np.testing.assert_allclose(values, part(along), atol=1e-9)
    (tilt,) = last.get_lines()
    np.testing.assert_allclose(np.interp([0.0, 0.05, 0.12], *tilt.get_data()),
                               np.rad2deg([0.2, 0.55, 0.9]), atol=1e-3)  # fmt: skip
    ledger = next(axes for axes in figures["carried"].axes if "ledger" in axes.get_title("left"))
    run = sp.simulate(CARRIED, dt=1e-3, record=ALL)
    np.testing.assert_array_equal(drawn(ledger, "motion")[1], run.energy.motion_work)
    # The legend with the most entries ends before the title.
    legend = ledger.get_legend()
    assert legend is not None and len(legend.get_texts()) == 5
    with plot.styled():
        figures["carried"].set_dpi(300)  # as it is saved
        figures["carried"].draw_without_rendering()
        assert ledger._left_title.get_window_extent().x1 < legend.get_window_extent().x0


def test_run_draws_a_jump_of_the_acceleration_upright_however_few_rows_there_are() -> None:
    move = sp.HandMotion.trapezoid([0.01, 0.0523], [[0.0, 0.0], [0.0, 0.01]], 30.0)
    run = sp.simulate(sp.Scene(motion=move, duration=0.06), dt=1e-3, every=1000)
    last = list(visible(plot.run(run)))[-1]
    assert last.get_ylabel() == "acceleration [m/s$^2$]"
    t, values = drawn(last, "along its $y$")
    jumps = np.flatnonzero(np.diff(values))
    np.testing.assert_allclose(values[jumps + 1], [30.0, 0.0, -30.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(t[jumps], [0.01, *move.breakpoints(0.011, 0.05), 0.0523], atol=1e-9)
    assert (np.diff(t)[jumps] < 1e-12).all()


def test_run_of_a_hand_at_rest_has_no_acceleration(figures: dict[str, Figure]) -> None:
    names = [axes.get_ylabel() for axes in figures["run"].axes]
    assert names and not any("m/s$^2$" in name or "tilt" in name for name in names)
    assert "motion" not in [
        line.get_label() for axes in figures["run"].axes for line in axes.get_lines()
    ]
    with pytest.raises(sp.NotRecordedError, match="no quantity"):
        plot.run(sp.simulate(CARRIED, dt=1e-3, record=()))


def test_missing_recordings_and_titles_are_refused() -> None:
    run = sp.simulate(sp.Scene(duration=0.01), dt=1e-3, record=())
    for make in (plot.run, plot.motion, plot.residuals, plot.forces):
        with pytest.raises(sp.NotRecordedError, match="record="):
            make(run)
    with pytest.raises(ValueError, match="one for each"):
        plot.snapshots(run, [0.0], ["a", "b"])
    with pytest.raises(ValueError, match="runs is empty"):
        plot.disturbances({})


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_the_same_figure_gives_the_same_bytes(run: sp.Run, tmp_path: Path, suffix: str) -> None:
    first, second = (
        plot.save(plot.snapshots(run, [1.0]), tmp_path / f"{k}.{suffix}").read_bytes()
        for k in (1, 2)
    )
    assert first == second
    assert len(first) > 1000


def test_the_drawn_tip_is_a_hemisphere_flattened_by_d_n_and_sheared_by_d_t() -> None:
    scene = sp.Scene()
    tip = scene.hand.tip
    assert isinstance(tip, sp.Fingertip)
    free = scene.start().q
    for side, sign in ((0, -1.0), (1, 1.0)):
        finger = outline.finger_outline(scene, free, side)
        distances = np.linalg.norm(finger.tip - finger.centre, axis=1)
        np.testing.assert_allclose(distances, tip.radius)
        np.testing.assert_allclose(
            finger.centre, [-sign * (0.049 - 0.0045), 0.0762], atol=1e-15
        )  # (7, 8)
    state = sp.State.consistent(
        scene, x=2e-3, y=0.075, rotation=0.1, fingers=(0.12, 0.05), shear=(1e-3, -2e-3)
    )
    across, along = outline.object_axes(0.1)
    corners = outline.object_outline(scene, state.q)
    np.testing.assert_allclose(corners.mean(axis=0), state.q[:2])
    assert np.ptp(corners @ across) == pytest.approx(scene.grasped.width)
    assert np.ptp(corners @ along) == pytest.approx(outline.OBJECT_HEIGHT)
    for side, sign in ((0, -1.0), (1, 1.0)):
        finger = outline.finger_outline(scene, state.q, side)
        depth = (finger.tip - finger.centre) @ (sign * across)
        # It ends on the object's face, which is where (9) has it.
        assert depth.max() == pytest.approx(tip.radius - state.q[5 + side])
        face = (corners @ (sign * across)).min()
        assert (finger.tip @ (sign * across)).max() == pytest.approx(face)
        # The fibre that stands on the base's middle is glued to it, and sheared by all of d_t
        # where it meets the face.
        middle = finger.fibres[2]
        k = np.flatnonzero((middle - finger.centre) @ (sign * across) > depth.max() - 1e-9)[0]
        angle = state.q[3 + side]
        inward = np.array([sign * np.cos(angle), -np.sin(angle)])
        straight = np.linspace(0.0, tip.radius, len(middle))[k] * inward
        moved = (middle[k] - finger.centre - straight) @ along
        assert moved == pytest.approx(-state.q[7 + side])
        np.testing.assert_allclose(middle[0], finger.centre)


SYMMETRIC = sp.Scene(duration=0.05)


def linear_limits(figure: Figure) -> list[tuple[float, float]]:
    return [axes.get_ylim() for axes in visible(figure) if axes.get_yscale() == "linear"]


def test_round_off_looks_like_zero() -> None:
    run = sp.simulate(SYMMETRIC, dt=1e-3, record=(*ALL, "torque"))
    size = np.abs(np.rad2deg(run.q[:, 2])).max()
    assert 0.0 < size < 1e-12
    sticks = replace(SYMMETRIC, contact="unilateral", friction=1.0)
    both = {"b": run, "u": sp.simulate(sticks, dt=1e-3, record=ALL)}
    for figure in (plot.run(run), plot.motion(run), plot.disturbances(both), plot.forces(run),
                   plot.tilt_coupling(run, run), plot.contact(both["u"]),
                   plot.contact_models({"a": both})):  # fmt: skip
        assert all(high - low > 1e-9 for low, high in linear_limits(figure))
    low, high = drawn_axes(plot.motion(run), r"\theta_{\mathrm{obj}}").get_ylim()
    assert low < -0.01 and high > 0.01


def drawn_axes(figure: Figure, symbol: str) -> Axes:
    (axes,) = [axes for axes in figure.axes if symbol in axes.get_ylabel()]
    return axes
