"""Draws the figures of docs/equilibria.md: a map, the modes of a grasp, and its compliance."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import softpinch as sp

OUT = Path(__file__).resolve().parent.parent / "docs" / "figures"


def how_heavy() -> sp.EquilibriumMap:
    """How heavy an object a light grasp holds, and how far off its middle."""
    scene = sp.Scene(
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[3.0, 3.0]])), friction=0.6, fingers="driven"
    )
    axes = {
        "grasped.com_offset": np.linspace(-0.012, 0.012, 49),
        "grasped.mass": np.linspace(0.1, 10.0, 45),
    }
    return sp.equilibrium_map(scene, axes)


def drawn(map: sp.EquilibriumMap) -> Figure:
    """The figure of the map, whose axes have names that a page without the scene explains."""
    figure = sp.plot.equilibria(map)
    panels = figure.axes[:4]
    for axes in panels[2:]:
        axes.set_xlabel("offset of its centre of gravity [mm]")
    for axes in panels[::2]:
        axes.set_ylabel("mass of the object [kg]")
    return figure


def main() -> None:
    """Saves all figures."""
    rest = sp.equilibrium(sp.Scene())
    figures = {
        "equilibria": drawn(how_heavy()),
        "modes": sp.plot.modes(rest),
        "compliance": sp.plot.compliance(rest),
    }
    for name, figure in figures.items():
        print("saved", sp.plot.save(figure, OUT / f"{name}.png"))


if __name__ == "__main__":
    main()
