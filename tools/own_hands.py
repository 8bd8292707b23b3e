"""Draws docs/figures/own_hands.png: a hand of each kind, and an object of each, at rest."""

from pathlib import Path

import numpy as np

import softpinch as sp
from softpinch import plot
from softpinch.plot.drawing import HandDrawing
from softpinch.plot.style import PAGE, panels
from softpinch.scene import outline

OUT = Path(__file__).resolve().parent.parent / "docs" / "figures" / "own_hands.png"
JAWS = sp.Hand(right=sp.Jaw(), left=sp.Jaw())
PARALLELOGRAMS = sp.Hand(right=sp.Parallelogram(), left=sp.Parallelogram())
STIFF = sp.Pid(kp=2e4, kd=200.0, ki=2e5)
HANDS = {
    "Finger and box": sp.Scene(),
    "Jaw and box": sp.Scene(hand=JAWS, control=STIFF),
    "Parallelogram and box": sp.Scene(hand=PARALLELOGRAMS),
    "Finger and disc": sp.Scene(grasped=sp.GraspedObject.disc(0.05, 0.1)),
    "Jaw and wedge": sp.Scene(
        hand=JAWS, control=STIFF, grasped=sp.GraspedObject.wedge(0.05, 0.06, 0.1, 0.1)
    ),
    "Parallelogram, face and arc": sp.Scene(
        hand=PARALLELOGRAMS,
        grasped=sp.GraspedObject(right=sp.Face(height=0.04), left=sp.Arc(0.04, (0.014, 0.0), 1.1)),
    ),
}


@plot.styled()
def main() -> None:
    """Each hand presses with 10 N."""
    figure, axes = panels(2, 3, PAGE, 4.2)
    for panel, (name, scene) in zip(axes.flat, HANDS.items(), strict=True):
        rest = sp.grip(scene, force=10.0).equilibrium.state
        assert rest is not None
        q = np.asarray(rest.q)
        left, right, bottom, top = outline.extent(scene, q[None])
        HandDrawing(panel, scene, (left - 3.0, right + 3.0, bottom - 3.0, top + 3.0)).show(q)
        panel.set_title(name, fontsize="medium")
        panel.set_axis_off()
    plot.save(figure, OUT)


if __name__ == "__main__":
    main()
