"""Runs for films and pictures, and what a figure says."""

from functools import cache

from matplotlib.figure import Figure

import softpinch as sp
from softpinch import paper

DT = 1e-3
PUSHED = sp.Scene(
    duration=0.1,
    contact="unilateral",
    friction=0.3,
    disturbances=(sp.Pulse(time=0.02, duration=0.01, force=(0.0, 200.0), moment=0.1),),
)


@cache
def operation() -> sp.Run:
    """One operation of the paper, with a row for each step."""
    return sp.simulate(paper.manipulation(duration=1.2), DT, record=("state", "multipliers"))


@cache
def pushed_run() -> sp.Run:
    """A run in which tips slip and open."""
    return sp.simulate(PUSHED, 1e-4, record=("state", "multipliers"))


def legend_of(figure: Figure) -> list[str]:
    """The entries of all legends of a figure."""
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    return [text.get_text() for each in legends if each for text in each.get_texts()]


def texts(figure: Figure) -> list[str]:
    axes = figure.axes[0]
    return [*(axes.get_title(where) for where in ("left", "right")),
            *(text.get_text() for text in axes.texts)]  # fmt: skip
