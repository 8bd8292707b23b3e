"""Draws docs/figures/equilibria.png: how heavy an object a light grasp holds, and how far off."""

from pathlib import Path

import numpy as np

import softpinch as sp

OUT = Path(__file__).resolve().parent.parent / "docs" / "figures" / "equilibria.png"


def main() -> None:
    """The map of docs/equilibria.md."""
    scene = sp.Scene(
        schedule=sp.Schedule.steps([0.0], np.deg2rad([[3.0, 3.0]])), friction=0.6, fingers="driven"
    )
    axes = {
        "grasped.com_offset": np.linspace(-0.012, 0.012, 49),
        "grasped.mass": np.linspace(0.1, 10.0, 45),
    }
    print("saved", sp.plot.save(sp.plot.equilibria(sp.equilibrium_map(scene, axes)), OUT))


if __name__ == "__main__":
    main()
