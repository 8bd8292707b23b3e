"""Figures of one panel draw on given axes, and figures show themselves in notebooks."""

import inspect
import io
import pickle
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

import softpinch as sp
from ensembles import calm, pushed
from softpinch import plot

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from PIL import Image  # noqa: E402

from test_extras import SCENE, fitted, measured, run  # noqa: E402


@cache
def slipping() -> sp.Run:
    push = sp.Pulse(time=0.01, duration=0.005, force=(0.0, 100.0))
    scene = sp.Scene(duration=0.02, contact="unilateral", friction=0.3, disturbances=(push,))
    return sp.simulate(scene, record=("state", "residuals"))


@cache
def rest() -> sp.Equilibrium:
    return sp.equilibrium(SCENE)


FIGURES: dict[str, Callable[[], object]] = {
    "compliance": lambda: plot.compliance(rest()),
    "contact": lambda: plot.contact(slipping()),
    "contact_models": lambda: plot.contact_models({"a push": {"0.5": slipping()}}),
    "disturbances": lambda: plot.disturbances({"i": run()}),
    "equilibria": lambda: plot.equilibria(
        sp.equilibrium_map(sp.Scene(), {"grasped.mass": [0.1, 0.2]}, progress=False)
    ),
    "failure_times": lambda: plot.failure_times(pushed()),
    "fit": lambda: plot.fit(fitted()),
    "forces": lambda: plot.forces(run()),
    "histogram": lambda: plot.histogram(calm(), "peak_rotation"),
    "importance": lambda: plot.importance(pushed(), "peak_rotation"),
    "modes": lambda: plot.modes(rest()),
    "motion": lambda: plot.motion(run()),
    "residuals": lambda: plot.residuals(run()),
    "run": lambda: plot.run(run()),
    "snapshot": lambda: plot.snapshot(run()),
    "snapshots": lambda: plot.snapshots(run(), [0.0]),
    "stability_map": lambda: plot.stability_map(
        sp.stability_map(
            SCENE, "youngs_modulus", [3e5], dt=[1e-3, 2e-3], pairs=(("csm", "rk4"),), progress=False
        )
    ),
    "stabilization_sweep": lambda: plot.stabilization_sweep(
        sp.stabilization_sweep(SCENE, products=[0.1, 1.0])
    ),
    "success_map": lambda: plot.success_map(
        pushed(), "disturbances.0.force.0", "disturbances.0.force.1"
    ),
    "tilt_coupling": lambda: plot.tilt_coupling(run(), run()),
    "work_precision": lambda: plot.work_precision(measured()),
    "wrench_limits": lambda: plot.wrench_limits(sp.wrench_limits(rest(), [[1.0, 0.0, 0.0]])),
}
POLAR = {"wrench_limits"}
# Draws on `ax` what the function of this name draws in `FIGURES`.
ON_AXES = {
    "failure_times": lambda ax: plot.failure_times(pushed(), ax=ax),
    "histogram": lambda ax: plot.histogram(calm(), "peak_rotation", ax=ax),
    "snapshot": lambda ax: plot.snapshot(run(), ax=ax),
    "snapshots": lambda ax: plot.snapshots(run(), [0.0], ax=ax),
    "stability_map": lambda ax: plot.stability_map(stability(), ax=ax),
    "success_map": lambda ax: plot.success_map(
        pushed(), "disturbances.0.force.0", "disturbances.0.force.1", ax=ax
    ),
    "wrench_limits": lambda ax: plot.wrench_limits(
        sp.wrench_limits(rest(), [[1.0, 0.0, 0.0]]), ax=ax
    ),
}


@cache
def stability(*more: tuple[str, str]) -> sp.StabilityMap:
    """The map in `FIGURES`, with more pairs."""
    pairs = (("csm", "rk4"), *more)
    return sp.stability_map(SCENE, "youngs_modulus", [3e5], dt=[1e-3, 2e-3], pairs=pairs,
                            progress=False)  # fmt: skip


def takes_axes(name: str) -> bool:
    return "ax" in inspect.signature(getattr(plot, name)).parameters


def panels(figure: Figure) -> list[Axes]:
    """The visible axes without the scales of colours."""
    return [each for each in figure.axes if each.get_visible() and each.get_label() != "<colorbar>"]


def test_every_figure_of_one_panel_takes_axes(
    tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(str(tmp_path))
    single = set()
    for name in plot.__all__:
        if inspect.signature(getattr(plot, name)).return_annotation != "Figure":
            continue
        figure = FIGURES[name]()
        assert isinstance(figure, Figure)
        if len(panels(figure)) == 1:
            single.add(name)
    assert single == {name for name in plot.__all__ if takes_axes(name)} == set(ON_AXES)


@pytest.mark.parametrize("name", ON_AXES)
def test_a_figure_on_given_axes_is_theirs_and_shows_the_same(name: str) -> None:
    own = FIGURES[name]()
    assert isinstance(own, Figure)
    projection = "polar" if name in POLAR else None
    whole = Figure()
    # A part of a figure, as many users arrange panels.
    part, other = whole.subfigures(1, 2)
    ax, second = part.add_subplot(projection=projection), other.add_subplot()
    assert ON_AXES[name](ax) is whole
    assert not second.has_data() and second.get_title() == ""
    (panel,) = panels(own)
    for get in ("get_xlabel", "get_ylabel", "get_xscale", "get_yscale"):
        assert getattr(ax, get)() == getattr(panel, get)()
    for lines, others in ((ax.get_lines(), panel.get_lines()), (ax.texts, panel.texts)):
        assert len(lines) == len(others)
    for line, same in zip(ax.get_lines(), panel.get_lines(), strict=True):
        np.testing.assert_array_equal(line.get_xydata(), same.get_xydata())
    assert len(ax.collections) == len(panel.collections)
    assert len(ax.patches) == len(panel.patches)
    # What a figure of its own says beside its panel is said inside the axes.
    named = [text.get_text() for legend in own.legends for text in legend.get_texts()]
    if named:
        legend = ax.get_legend()
        assert legend is not None
        assert [text.get_text() for text in legend.get_texts()] == named
    assert not whole.legends
    whole.draw_without_rendering()


@pytest.mark.parametrize("name", ON_AXES)
def test_axes_keep_the_users_style(name: str) -> None:
    ax = Figure().add_subplot(projection="polar" if name in POLAR else None)
    ON_AXES[name](ax)
    assert ax.xaxis.label.get_fontfamily() == matplotlib.rcParams["font.family"]
    with pytest.raises(TypeError, match="ax = 1: must be axes of matplotlib"):
        ON_AXES[name](1)


def test_wrench_limits_says_which_axes_it_needs() -> None:
    limits = sp.wrench_limits(rest(), [[1.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match="must have projection=\"polar\", not 'rectilinear'"):
        plot.wrench_limits(limits, ax=Figure().add_subplot())
    with pytest.raises(ValueError, match="must be None for a figure of 1 x 2 panels"):
        plot.wrench_limits(limits, pushed(), ax=Figure().add_subplot(projection="polar"))


def test_several_panels_have_no_place_on_axes() -> None:
    ax = Figure().add_subplot()
    with pytest.raises(ValueError, match=r"^ax: must be None for a figure of 1 x 2 panels$"):
        plot.snapshots(run(), [0.0, 0.01], ax=ax)
    with pytest.raises(ValueError, match=r"^ax: must be None for a figure of 2 x 2 panels$"):
        plot.stability_map(stability(("nullspace", "radau5")), ax=ax)
    assert not ax.has_data() and not ax.patches


# Notebooks.


def test_a_figure_has_its_picture_for_notebooks() -> None:
    figure = plot.snapshots(run(), [0.0])
    data, size = figure._repr_png_()  # type: ignore[attr-defined]
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    inches = figure.get_size_inches()
    assert size == {"width": round(100 * inches[0]), "height": round(100 * inches[1])}
    drawn = io.BytesIO()
    with plot.styled():
        plot.snapshots(run(), [0.0]).savefig(drawn, format="png", dpi=200)
    # As images, because pytest would take minutes to compare different bytes.
    shown, saved = (np.asarray(Image.open(each)) for each in (io.BytesIO(data), drawn))
    assert shown.shape == saved.shape and np.abs(shown.astype(int) - saved).max() == 0
    again = pickle.loads(pickle.dumps(figure))
    assert again._repr_png_()[1] == size


def test_ipython_shows_figures_without_pyplot() -> None:
    display = pytest.importorskip("IPython.core.formatters").DisplayFormatter()
    display.active_types = display.format_types
    found, metadata = display.format(plot.motion(run()))
    assert "image/png" in found and metadata["image/png"]["width"] > 100
