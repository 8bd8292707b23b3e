"""Draws docs/figures/own_hands.png: a hand of each kind, and an object of each, at rest.

And docs/figures/own_measures.png: the numbers of each kind, where a ruler finds them.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from model_drawing import angle, dashed, label, span

import softpinch as sp
from softpinch import plot
from softpinch.plot.drawing import HandDrawing
from softpinch.plot.style import BLACK, BLUE, PAGE, RED, panels
from softpinch.scene import outline

FIGURES = Path(__file__).resolve().parent.parent / "docs" / "figures"
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


# Hands that are no special case, so that no two lines of the drawings coincide.
RAIL = sp.Jaw(root_offset=0.056, half_thickness=0.005, height=0.07, direction=0.2, angle=0.15)
LINKS = sp.Parallelogram(root_offset=0.072, half_thickness=0.008, angle=0.15)
TAPER = sp.GraspedObject(
    width=0.05, right=sp.Face(tilt=0.2, height=0.05), left=sp.Arc(0.035, (0.008, 0.005), span=1.6)
)
POWER = sp.PowerLaw(coefficient=7.8e4, exponent=1.6, foot=1e-4)
CURVE = sp.MeasuredLaw.from_csv(FIGURES.parents[1] / "examples" / "data" / "silicone_tip.csv")


def points(*places: tuple[float, float]) -> list[np.ndarray]:
    """Points in mm as arrays."""
    return [np.array(place) for place in places]


def drawn(axes: Axes, scene: sp.Scene, q: np.ndarray, limits: tuple[float, ...]) -> None:
    """A scene within limits, mm."""
    HandDrawing(axes, scene, (limits[0], limits[1], limits[2], limits[3])).show(q)
    axes.set_axis_off()


def jaw(axes: Axes) -> None:
    """The right jaw of a hand that is about to touch."""
    scene = sp.Scene(hand=sp.Hand(right=RAIL, left=RAIL), control=STIFF)
    drawn(axes, scene, sp.State.consistent(scene).q, (-9.0, 94.0, -22.0, 122.0))
    offset, half, height = 56.0, 5.0, 70.0
    across = np.array([-np.cos(RAIL.direction), np.sin(RAIL.direction)])
    origin, centre = points((0.0, 0.0), (offset - half, height))
    dashed(axes, origin, np.array([0.0, 112.0]))
    dashed(axes, origin, np.array([88.0, 0.0]))
    span(axes, *points((0.0, -8.0), (offset, -8.0)), "root_offset", (0.0, -6.0))
    dashed(axes, *points((offset, -12.0), (offset, 118.0)))
    dashed(axes, centre, np.array([centre[0], 118.0]))
    span(axes, *points((centre[0], 115.0), (offset, 115.0)), "half_thickness", (24.0, 0.0))
    dashed(axes, centre, centre + np.array([34.0, 0.0]))
    span(axes, *points((80.0, 0.0), (80.0, height)), "height", (0.0, 0.0))
    dashed(axes, centre, centre - np.array([50.0, 0.0]))
    dashed(axes, centre, centre + 50.0 * across)
    turn = -np.rad2deg(RAIL.direction)
    angle(axes, centre, 40.0, 180.0, turn, "", 1.0)
    label(axes, centre + np.array([-38.0, 14.0]), "direction", "#1B7F3B")
    angle(axes, centre, 31.0, 90.0, np.rad2deg(RAIL.angle), "", 1.0)
    label(axes, centre + np.array([-14.0, 32.0]), "angle", "#1B7F3B")
    dashed(axes, centre, centre + 34.0 * np.array([-np.sin(RAIL.angle), np.cos(RAIL.angle)]))


def parallelogram(axes: Axes) -> None:
    """The right finger of two links."""
    scene = sp.Scene(hand=sp.Hand(right=LINKS, left=LINKS))
    swing = 0.25
    q = sp.State.consistent(scene, fingers=(swing, swing)).q
    drawn(axes, scene, q, (-9.0, 118.0, -22.0, 122.0))
    root = np.array([72.0, 0.0])
    end = root + 76.2 * np.array([-np.sin(swing), np.cos(swing)])
    dashed(axes, np.zeros(2), np.array([0.0, 112.0]))
    span(axes, *points((0.0, -8.0), (72.0, -8.0)), "root_offset", (0.0, -6.0))
    dashed(axes, root, root + np.array([0.0, 60.0]))
    dashed(axes, root, root + np.array([0.0, -12.0]))
    out = 36.0 * np.array([np.cos(swing), np.sin(swing)])
    span(axes, root + out, end + out, "length", (0.0, 0.0))
    for foot in (root, end):
        dashed(axes, foot, foot + 1.05 * out)
    angle(axes, root, 44.0, 90.0, np.rad2deg(swing), r"coordinate $\theta_1$", 1.12)
    centre = end - np.array([8.0, 0.0])
    dashed(axes, end, np.array([end[0], 118.0]))
    dashed(axes, centre, np.array([centre[0], 118.0]))
    span(axes, *points((centre[0], 115.0), (end[0], 115.0)), "half_thickness", (25.0, 0.0))
    base = np.array([-np.sin(LINKS.angle), np.cos(LINKS.angle)])
    dashed(axes, centre, centre + 34.0 * base)
    angle(axes, centre, 31.0, 90.0, np.rad2deg(LINKS.angle), "", 1.0)
    label(axes, centre + np.array([-15.0, 31.0]), "angle", "#1B7F3B")


def sides(axes: Axes) -> None:
    """An object with a face and an arc."""
    scene = sp.Scene(grasped=TAPER)
    outline_of = 1e3 * outline.object_outline(scene, np.zeros(9))
    axes.fill(*outline_of.T, facecolor=outline.OBJECT, edgecolor=outline.EDGE, linewidth=0.8)
    axes.plot(0.0, 0.0, "o", color="black", markersize=3.0)
    label(axes, np.array([2.0, -4.0]), "centre of gravity", "black")
    centre, face = points((8.0, 5.0), (25.0, 0.0))
    axes.plot(*centre, "+", color="black", markersize=6.0)
    label(axes, centre + np.array([6.0, 4.0]), "center", "#1F5FA8")
    end = centre + 35.0 * np.array([-np.cos(0.45), np.sin(0.45)])
    span(axes, centre, end, "radius", (0.0, 3.0))
    for turn in (-0.8, 0.8):
        dashed(axes, centre, centre + 42.0 * np.array([-np.cos(turn), np.sin(turn)]))
    angle(axes, centre, 40.0, 180.0 + np.rad2deg(0.8), -np.rad2deg(1.6), "span", 1.12)
    up = np.array([np.sin(0.2), np.cos(0.2)])
    along = np.array([7.0, -1.5])
    span(axes, face - 25.0 * up + along, face + 25.0 * up + along, "height", (6.0, 0.0))
    dashed(axes, face, face + np.array([0.0, 40.0]))
    dashed(axes, face, face + 42.0 * up)
    angle(axes, face, 36.0, 90.0, -np.rad2deg(0.2), "tilt", 1.16)
    axes.set(aspect="equal", xlim=(-48.0, 52.0), ylim=(-44.0, 56.0))
    axes.set_axis_off()


def laws(axes: Axes) -> None:
    """The force of the tips of the page over their compression."""
    depth = np.linspace(0.0, CURVE.compression[-1], 101)
    springs, n, foot = np.pi * 3e5 * depth**2, POWER.exponent, POWER.foot or 0.0
    bent = (depth + foot) ** n - foot**n - n * foot ** (n - 1.0) * depth
    axes.plot(1e3 * depth, springs, color=BLACK, label="youngs_modulus = 0.3 MPa")
    axes.plot(1e3 * depth, POWER.coefficient * bent, color=BLUE, linestyle="--", label="PowerLaw")
    axes.plot(1e3 * depth, CURVE.predicted(depth), color=RED, linestyle="-.", label="MeasuredLaw")
    axes.plot(1e3 * CURVE.compression, CURVE.force, "o", color=RED, markersize=2.0)
    axes.set(xlabel="compression $d_n$ [mm]", ylabel="force on a flat plate [N]", xlim=(0.0, 9.0))
    axes.set_ylim(0.0, 80.0)
    axes.legend(loc="upper left")


def measures() -> None:
    """The numbers of each kind."""
    figure, axes = panels(2, 2, PAGE, 6.6)
    drawings = {"Jaw": jaw, "Parallelogram": parallelogram, "Face and Arc": sides, "Tips": laws}
    for panel, (name, draw) in zip(axes.flat, drawings.items(), strict=True):
        draw(panel)
        panel.set_title(name, fontsize="medium")
    plot.save(figure, FIGURES / "own_measures.png")


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
    plot.save(figure, FIGURES / "own_hands.png")
    measures()


if __name__ == "__main__":
    main()
