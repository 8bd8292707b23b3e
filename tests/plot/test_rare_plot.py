"""The figure of a rare event: levels, estimate, and the runs with the event."""

from typing import Any

import numpy as np
import pytest

import softpinch as sp

pytest.importorskip("matplotlib")
pytest.importorskip("scipy")

HOW: dict[str, Any] = {"dt": 1e-3, "progress": False, "seed": 1}
SCENE = sp.Scene(duration=1e-3)


def test_levels_estimate_and_runs() -> None:
    vary = {
        "grasped.mass": sp.Normal(0.1, 0.01),
        "hand.tip.youngs_modulus": sp.LogNormal(3e5, 0.2),
    }

    def event(some: sp.Ensemble) -> Any:
        return some["grasped.mass"] - 0.1 + 0.08 * (np.log(some["hand.tip.youngs_modulus"] / 5e5))

    found = sp.rare_event(SCENE, vary, lambda some: -event(some) + 0.05, 5000, **HOW)
    figure = sp.plot.rare_event(found)
    figure.draw_without_rendering()
    left, right = figure.axes
    (levels,) = [line for line in left.get_lines() if len(line.get_xdata()) == len(found.levels)]
    values = np.cumprod([level.probability for level in found.levels])
    np.testing.assert_allclose(np.asarray(levels.get_ydata()), values)
    estimate = left.get_lines()[-1]
    assert tuple(np.asarray(estimate.get_ydata())) == found.interval
    runs, design = right.get_lines()
    # Ordered by importance: the modulus first, whose axis is logarithmic.
    assert next(iter(found.importance)) == "hand.tip.youngs_modulus"
    assert right.get_xscale() == "log" and right.get_yscale() == "linear"
    assert len(np.asarray(runs.get_xdata())) == found.events.runs
    mass = np.asarray(design.get_ydata())[0]
    assert right.get_ylabel().endswith("[kg]") and mass == found.design_point["grasped.mass"]


def test_an_event_that_was_not_found_has_its_upper_bound() -> None:
    found = sp.rare_event(
        SCENE, {"grasped.mass": sp.Uniform(0.1, 0.2)}, lambda some: some["grasped.mass"] - 0.09,
        2000, **HOW,
    )  # fmt: skip
    figure = sp.plot.rare_event(found)
    figure.draw_without_rendering()
    (left,) = figure.axes
    assert np.asarray(left.get_lines()[-1].get_ydata())[0] == found.interval[1]
    texts = [text.get_text() for text in left.get_legend().get_texts()]
    assert sorted(texts) == ["levels", "upper bound, 95 %"]


def test_other_arguments_are_refused() -> None:
    with pytest.raises(TypeError, match="found"):
        sp.plot.rare_event(0.1)  # type: ignore[arg-type]
