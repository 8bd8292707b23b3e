"""The figure of a fit: data, fitted motion and residuals are those of the fit, in shown units."""

from typing import Any

import numpy as np
import pytest

import softpinch as sp
from measured_motions import BOUNDS, DT, SCENE, TIMES, columns, motion
from softpinch import plot

pytest.importorskip("matplotlib")
pytest.importorskip("scipy")


def measured(*names: str) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    return {
        name: value + rng.normal(0.0, 2e-5, value.shape)
        for name, value in columns(motion(), *names).items()
    }


def test_data_motion_and_residuals() -> None:
    data = measured("rotation", "y")
    data["y"][3] = np.nan
    fit = sp.fit(SCENE, TIMES, data, BOUNDS, dt=DT, noise=2e-5)
    figure = plot.fit(fit)
    figure.draw_without_rendering()
    left, right, lower, residuals = figure.axes
    assert left.get_ylabel() == r"$\theta_{\mathrm{obj}}$ [deg]"
    assert lower.get_ylabel() == r"$y_{\mathrm{obj}}$ [mm]" and lower.get_xlabel() == "$t$ [s]"
    points, line = left.get_lines()[0], left.get_lines()[-1]
    np.testing.assert_allclose(np.asarray(points.get_ydata()), np.rad2deg(data["rotation"]))
    model = np.rad2deg(data["rotation"] - fit.residuals["rotation"])
    np.testing.assert_allclose(np.asarray(line.get_ydata()), model, rtol=1e-9, atol=1e-12)
    (bars,) = left.collections
    first = bars.get_segments()[0]  # type: ignore[attr-defined]
    assert np.ptp(first[:, 1]) == pytest.approx(2.0 * np.rad2deg(2e-5))
    rest = np.asarray(residuals.get_lines()[-1].get_ydata())
    np.testing.assert_allclose(rest, fit.residuals["y"] / 2e-5, rtol=1e-6)
    assert np.flatnonzero(np.isnan(rest)).tolist() == [3]
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sorted(texts) == ["fitted", "measured"]
    assert right.get_title() == "residual / noise"


def test_experiments_and_columns_have_their_panels() -> None:
    data = measured("y", "lambda_1H", "rate of x")
    fit = sp.fit([SCENE] * 2, [TIMES] * 2, [data] * 2, BOUNDS, dt=DT, noise=2e-5)
    names = [axes.get_ylabel() for axes in plot.fit(fit).axes[::2]]
    assert len(names) == 6
    assert [name.endswith(f"({k})") for k in (0, 1) for name in names[3 * k : 3 * k + 3]] == [
        True
    ] * 6
    assert r"\lambda_1" in names[1] and "[N]" in names[1] and "rate of" in names[2]


def test_the_first_twelve_columns_are_shown_and_counted() -> None:
    fit = sp.fit(SCENE, TIMES, measured("q", "p"), BOUNDS, dt=DT, noise=2e-5)
    figure = plot.fit(fit)
    assert len(figure.axes) == 24
    assert figure.axes[1].get_title() == "residual / noise, 12 of 18 columns"
