"""Figures of ensembles: what is drawn is what was computed, with units, and nothing is hidden."""

from dataclasses import replace

import numpy as np
import pytest

import softpinch as sp
from ensembles import calm, pushed
from films import legend_of
from softpinch import plot
from softpinch.scene import fields
from softpinch.study.tables import number

pytest.importorskip("scipy")

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.collections import QuadMesh  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.patches import StepPatch  # noqa: E402

FORCE = ("disturbances.0.force.0", "disturbances.0.force.1")


def said(figure: Figure) -> str:
    """Every text but the ticks'."""
    texts = [figure.get_suptitle(), *legend_of(figure)]
    for axes in figure.axes:
        titles = [axes.get_title(loc) for loc in ("left", "center", "right")]
        texts += [
            *titles,
            axes.get_xlabel(),
            axes.get_ylabel(),
            *(t.get_text() for t in axes.texts),
        ]
    return "\n".join(texts)


@pytest.mark.parametrize(
    "name",
    ["peak_rotation", "settling_time", "final_state.theta", FORCE[1], "failure_time"],
)
def test_a_histogram_has_every_finite_run_once(name: str) -> None:
    ensemble = pushed()
    figure = plot.histogram(ensemble, name)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    outline = [patch for patch in axes.patches if isinstance(patch, StepPatch)][-1]
    heights, edges, _ = outline.get_data()
    finite = np.isfinite(number(ensemble, name).values)
    assert heights.sum() == finite.sum()
    assert edges[0] == axes.get_xlim()[0] and edges[-1] == axes.get_xlim()[1]
    lost = finite & (ensemble.status != "completed")
    legend = " ".join(legend_of(figure))
    assert (f"ended early ({lost.sum()})" in legend) == bool(lost.any())
    assert (f"{(~finite).sum()} of 300 runs without" in said(figure)) == bool((~finite).any())
    assert axes.get_ylabel() == "runs in the bin"
    assert axes.get_xlabel().endswith("]")


def test_a_histogram_is_in_the_units_of_its_label() -> None:
    figure = plot.histogram(pushed(), "peak_rotation", bins=7)
    (axes,) = figure.axes
    assert axes.get_xlabel() == "peak rotation [deg]"
    edges = axes.patches[-1].get_data().edges
    assert len(edges) == 8
    assert edges[-1] == pytest.approx(np.rad2deg(pushed()["peak_rotation"].max()))
    nothing = plot.histogram(calm(), "failure_time")
    assert "no run has a finite value" in said(nothing)


def test_a_success_map_shows_the_share_of_each_bin_and_leaves_empty_ones_blank() -> None:
    ensemble = pushed()
    figure = plot.success_map(ensemble, *FORCE, bins=20)
    figure.draw_without_rendering()
    axes, bar = figure.axes
    (mesh,) = [each for each in axes.collections if isinstance(each, QuadMesh)]
    share = np.ma.asarray(mesh.get_array())
    force = ensemble["disturbances.0.force"]
    counts, left, bottom = np.histogram2d(force[:, 0], force[:, 1], 20)
    np.testing.assert_array_equal(np.ma.getmaskarray(share), counts.T == 0)
    assert share.mask.any()
    held = ensemble.status == "completed"
    x, y = 10, 4
    inside = (
        (left[x] <= force[:, 0]) & (force[:, 0] < left[x + 1])
        & (bottom[y] <= force[:, 1]) & (force[:, 1] < bottom[y + 1])
    )  # fmt: skip
    assert share[y, x] == held[inside].mean()
    assert axes.get_xlabel() == "force x (disturbance 0) [N]"
    assert axes.get_ylabel() == "force y (disturbance 0) [N]"
    assert bar.get_ylabel() == "share of runs: completed [1]"
    assert f"{share.mask.sum()} bins empty" in said(figure) and "300 runs" in said(figure)
    with pytest.raises(ValueError, match='did you mean "completed"'):
        plot.success_map(ensemble, *FORCE, what="complete")
    with pytest.raises(ValueError, match="several numbers"):
        plot.success_map(ensemble, "disturbances.0.force", "grasped.mass")


def test_failure_times_end_at_the_share_that_was_lost() -> None:
    ensemble = pushed()
    figure = plot.failure_times(ensemble)
    figure.draw_without_rendering()
    (axes,) = figure.axes
    count = ensemble.counts()["separated"]
    line = next(each for each in axes.get_lines() if "separated" in str(each.get_label()))
    assert np.asarray(line.get_ydata())[-1] == count / ensemble.runs
    first, last = np.nanmin(ensemble.failure_time), np.nanmax(ensemble.failure_time)
    assert axes.get_xlim()[0] < first and last < axes.get_xlim()[1]
    assert legend_of(figure) == [f"separated ({count})", f"never ({300 - count} of 300)"]
    assert "none of 20 runs ended early" in said(plot.failure_times(calm()))


def shove(**how: object) -> sp.Ensemble:
    """Grasps of which every other is pushed away at 0.1 s."""
    pushes = np.where(np.arange(8) % 2, 400.0, 0.0)
    scene = sp.Scene(
        initial="touching", disturbances=[sp.Step(time=0.1, force=(0.0, 0.0))], duration=0.2
    )
    scene = replace(scene, **how.pop("scene", {}))  # type: ignore[arg-type]
    vary = {"disturbances.0.force.0": pushes, **how.pop("vary", {})}  # type: ignore[dict-item]
    return sp.monte_carlo(scene, vary=vary, dt=1e-3, **{"progress": False, **how})


def test_failure_times_are_those_of_the_runs_not_of_the_scene_they_share() -> None:
    state = sp.State.consistent(sp.Scene(), fingers=(0.1, 0.1))
    apart: dict[str, dict[str, object]] = {
        "scene": {"initial": replace(state, time=50.0), "duration": 0.3},
        "vary": {"initial.time": np.linspace(-0.1, 0.05, 8)},
    }
    ensemble = shove(**apart)
    assert ensemble.counts() == {"completed": 4, "separated": 4}
    low, high = plot.failure_times(ensemble).axes[0].get_xlim()
    failed = ensemble.failure_time[1::2]
    assert 0.09 < low < failed.min() and failed.max() < high < 0.13
    # Where none was lost, from the first instant to the last.
    calm = shove(**apart, only=[0, 2, 4])
    assert plot.failure_times(calm).axes[0].get_xlim() == (-0.1, calm.end_time.max())


def test_failure_times_where_all_are_lost_at_once_or_there_is_no_run() -> None:
    lost = shove(only=[1])
    (axes,) = plot.failure_times(lost).axes
    low, high = axes.get_xlim()
    assert low < lost.failure_time[0] < high
    none = shove(progress=raise_ctrl_c)
    assert none.runs == 0
    assert plot.failure_times(none).axes[0].get_xlim() == (0.0, 0.2)


def raise_ctrl_c(done: int, runs: int) -> None:
    raise KeyboardInterrupt


def test_importance_shows_the_numbers_of_sensitivity_the_largest_on_top() -> None:
    ensemble = pushed()
    figure = plot.importance(ensemble, "peak_rotation")
    figure.draw_without_rendering()
    share, sign = figure.axes
    found = sp.sensitivity(ensemble, "peak_rotation")
    names = [each.get_text() for each in share.get_yticklabels()]
    assert names == [fields.label(path) for path in found]
    widths = [patch.get_width() for patch in share.patches[: len(found)]]
    np.testing.assert_allclose(widths, [max(0.0, effect.share) for effect in found.values()])
    assert share.get_ylim()[0] > share.get_ylim()[1]
    (line,) = [each for each in sign.get_lines() if each.get_marker() == "o"]
    np.testing.assert_array_equal(
        line.get_xdata(), [effect.rank_correlation for effect in found.values()]
    )
    assert "peak rotation (300 runs)" in said(figure)
    assert "it is the same in all runs" in said(plot.importance(calm()))
    happened = ensemble["peak_rotation"] > 0.1
    assert "what explains: the given event (300 runs)" in said(plot.importance(ensemble, happened))


def soft() -> sp.Ensemble:
    """Tips and masses whose orders of magnitude vary."""
    vary = {
        "hand.tip.youngs_modulus": sp.LogUniform(1e5, 1e7),
        "grasped.mass": sp.LogNormal(0.1, 0.3),
        "gravity": sp.Uniform(1.0, 10.0),
    }
    return sp.monte_carlo(sp.Scene(duration=0.002), 60, vary=vary, dt=1e-3, seed=3, progress=False)


def test_axes_of_numbers_drawn_by_magnitude_are_logarithmic() -> None:
    ensemble = soft()
    names = ("hand.tip.youngs_modulus", "grasped.mass", "gravity")
    for name, scale in zip(names, ("log", "log", "linear"), strict=True):
        assert plot.histogram(ensemble, name).axes[0].get_xscale() == scale
        axes = plot.success_map(ensemble, name, "gravity").axes[0]
        assert (axes.get_xscale(), axes.get_yscale()) == (scale, "linear")
    figure = plot.success_map(ensemble, "gravity", "hand.tip.youngs_modulus", bins=4)
    axes = figure.axes[0]
    assert axes.get_yscale() == "log"
    (mesh,) = [each for each in axes.collections if isinstance(each, QuadMesh)]
    edges = mesh.get_coordinates()[:, 0, 1]
    values = 1e-6 * ensemble["hand.tip.youngs_modulus"]
    np.testing.assert_allclose(edges[1:] / edges[:-1], (values.max() / values.min()) ** 0.25)
    # The edges are exact powers up to round-off, so count with some room.
    edges = edges * np.array([1 - 1e-9, 1, 1, 1, 1 + 1e-9])
    blank = np.ma.getmaskarray(np.ma.asarray(mesh.get_array()))
    counts = np.histogram2d(values, ensemble["gravity"], (edges, 4))[0]
    np.testing.assert_array_equal(blank, counts == 0)


def half_width(k: float, n: float) -> float:
    """Wilson's interval, as the quadratic equation (k/n - p)^2 = z^2 p (1 - p) / n."""
    if n == 0.0:
        return 0.5
    z2 = 1.959963984540054**2
    return 0.5 * float(np.ptp(np.roots([1.0 + z2 / n, -2.0 * k / n - z2 / n, (k / n) ** 2])))


def test_dots_mark_bins_with_few_runs() -> None:
    ensemble = pushed()
    happened = ensemble["peak_rotation"] > np.median(ensemble["peak_rotation"])
    figure = plot.success_map(ensemble, *FORCE, what=happened, bins=4)
    axes = figure.axes[0]
    force = ensemble["disturbances.0.force"]
    counts, left, bottom = np.histogram2d(force[:, 0], force[:, 1], 4)
    some = np.histogram2d(*force[happened].T, (left, bottom))[0]
    wanted = set()
    for i, j in np.ndindex(4, 4):
        if counts[i, j] and half_width(some[i, j], counts[i, j]) > 0.2:
            wanted.add((i, j))
    (dots,) = axes.get_lines()
    columns = np.searchsorted(left, dots.get_xdata()) - 1
    rows = np.searchsorted(bottom, dots.get_ydata()) - 1
    assert set(zip(columns.tolist(), rows.tolist(), strict=True)) == wanted
    assert 0 < len(wanted) < np.count_nonzero(counts)
    assert "wider than 0.4 at dots" in said(figure)
    assert "interval" not in said(plot.success_map(ensemble, *FORCE, bins=1))
