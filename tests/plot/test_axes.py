"""Figures of one panel draw on given axes, and figures show themselves in notebooks."""

import inspect
import io
import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from ensembles import calm, pushed
from softpinch import plot

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402
from PIL import Image  # noqa: E402

from test_extras import SCENE, run  # noqa: E402


@cache
def rest() -> sp.Equilibrium:
    return sp.equilibrium(SCENE)


def panels(figure: Figure) -> list[Axes]:
    """The visible axes without the scales of colours."""
    return [each for each in figure.axes if each.get_visible() and each.get_label() != "<colorbar>"]


ROW = [[1.0, 0.0, 0.0]]
FORCE = ("disturbances.0.force.0", "disturbances.0.force.1")
# Draws a figure of one panel, on axes or as its own.
FIGURES = {
    "carry_limits": lambda ax=None: plot.carry_limits(sp.carry_limits(rest(), [[1.0, 0.0]]), ax=ax),
    "failure_times": lambda ax=None: plot.failure_times(pushed(), ax=ax),
    "histogram": lambda ax=None: plot.histogram(calm(), "peak_rotation", ax=ax),
    "snapshot": lambda ax=None: plot.snapshot(run(), ax=ax),
    "snapshots": lambda ax=None: plot.snapshots(run(), [0.0], ax=ax),
    "stability_map": lambda ax=None: plot.stability_map(stability(), ax=ax),
    "success_map": lambda ax=None: plot.success_map(pushed(), *FORCE, ax=ax),
    "wrench_limits": lambda ax=None: plot.wrench_limits(sp.wrench_limits(rest(), ROW), ax=ax),
}


@cache
def stability(*more: tuple[str, str]) -> sp.StabilityMap:
    pairs = (("csm", "rk4"), *more)
    return sp.stability_map(SCENE, "youngs_modulus", [3e5], dt=[1e-3, 2e-3], pairs=pairs,
                            progress=False)  # fmt: skip


def axes_for(name: str, figure: Any) -> Axes:
    polar = {"projection": "polar"} if name.endswith("_limits") else {}
    found: Axes = figure.add_subplot(**polar)
    return found


def test_these_are_all_figures_that_take_axes() -> None:
    taking = {name for name in plot.__all__
              if "ax" in inspect.signature(getattr(plot, name)).parameters}  # fmt: skip
    assert taking == set(FIGURES)


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_on_given_axes_shows_the_same_in_the_users_style(name: str) -> None:
    own = FIGURES[name]()
    whole = Figure()
    # A part of a figure, as many users arrange panels.
    part, other = whole.subfigures(1, 2)
    ax, second = axes_for(name, part), other.add_subplot()
    assert FIGURES[name](ax) is whole
    assert not second.has_data() and second.get_title() == ""
    (panel,) = panels(own)
    for get in ("get_xlabel", "get_ylabel", "get_xscale", "get_yscale"):
        assert getattr(ax, get)() == getattr(panel, get)()
    assert len(ax.texts) == len(panel.texts)
    for line, same in zip(ax.get_lines(), panel.get_lines(), strict=True):
        np.testing.assert_array_equal(line.get_xydata(), same.get_xydata())
    assert len(ax.collections) == len(panel.collections)
    assert len(ax.patches) == len(panel.patches)
    # A legend beside the panel of the own figure is inside the axes.
    named = [text.get_text() for legend in own.legends for text in legend.get_texts()]
    if named:
        assert [text.get_text() for text in ax.get_legend().get_texts()] == named
    assert not whole.legends
    assert ax.xaxis.label.get_fontfamily() == matplotlib.rcParams["font.family"]
    whole.draw_without_rendering()
    with pytest.raises(TypeError, match="ax = 1: must be axes of matplotlib"):
        FIGURES[name](1)


def test_axes_that_do_not_fit_are_refused() -> None:
    ax, polar = Figure().add_subplot(), axes_for("wrench_limits", Figure())
    limits = sp.wrench_limits(rest(), ROW)
    with pytest.raises(ValueError, match="must have projection=\"polar\", not 'rectilinear'"):
        plot.wrench_limits(limits, ax=ax)
    with pytest.raises(ValueError, match=r"^ax: must be None for a figure of 1 x 2 panels$"):
        plot.wrench_limits(limits, pushed(), ax=polar)
    with pytest.raises(ValueError, match="must be None for a figure of 2 x 2 panels"):
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
