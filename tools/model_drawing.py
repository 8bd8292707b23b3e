"""Draws docs/figures/model.png: lengths, angles and signs of the model, in one posture."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc
from numpy.typing import NDArray

import softpinch as sp
from softpinch import plot
from softpinch.plot.drawing import HandDrawing
from softpinch.plot.style import MM, PAGE, new
from softpinch.scene import outline

Floats = NDArray[np.float64]
OUT = Path(__file__).resolve().parent.parent / "docs" / "figures" / "model.png"
BLUE, RED, GREEN = "#1F5FA8", "#B3202A", "#1B7F3B"
# A posture in which no two lines of the drawing coincide. The roots are farther apart than those of
# the default hand, so that fingers which lean that much compress the tips less.
FINGER = sp.Finger(root_offset=0.057)
SCENE = sp.Scene(hand=sp.Hand(right=FINGER, left=FINGER), grasped=sp.GraspedObject(com_offset=6e-3))
STATE = sp.State.consistent(
    SCENE, x=1.2e-3, y=0.0765, rotation=0.16, fingers=(0.27, 0.13), shear=(4e-3, -3e-3)
)


def span(axes: Axes, start: Floats, end: Floats, words: str, shift: tuple[float, float]) -> None:
    """A dimension line between two points, mm, with its symbol beside its middle."""
    arrow = {"arrowstyle": "<|-|>", "color": BLUE, "lw": 0.9, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(end), tuple(start), arrowprops={**arrow, "mutation_scale": 7})
    label(axes, 0.5 * (start + end) + np.array(shift), words, BLUE)


def vector(axes: Axes, start: Floats, end: Floats, words: str, shift: tuple[float, float]) -> None:
    """The positive direction of a force or a displacement, mm."""
    arrow = {"arrowstyle": "-|>", "color": RED, "lw": 1.3, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(end), tuple(start), arrowprops=arrow, zorder=6.0)
    label(axes, end + np.array(shift), words, RED)


def angle(
    axes: Axes, at: Floats, radius: float, start: float, turn: float, words: str, far: float = 1.3
) -> None:
    """An angle, degrees from the x axis, that is positive as its arrow goes."""
    low, high = sorted((start, start + turn))
    axes.add_patch(
        Arc(
            tuple(at),
            2 * radius,
            2 * radius,
            theta1=low,
            theta2=high,
            color=GREEN,
            lw=1.1,
            zorder=6,
        )
    )
    end = np.deg2rad(start + turn)
    tip = at + radius * np.array([np.cos(end), np.sin(end)])
    back = end - np.sign(turn) * 0.12
    tail = at + radius * np.array([np.cos(back), np.sin(back)])
    arrow = {"arrowstyle": "-|>", "color": GREEN, "lw": 0.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(tip), tuple(tail), arrowprops={**arrow, "mutation_scale": 8}, zorder=6)
    middle = np.deg2rad(start + 0.5 * turn)
    label(axes, at + far * radius * np.array([np.cos(middle), np.sin(middle)]), words, GREEN)


def label(axes: Axes, place: Floats, words: str, color: str) -> None:
    """A symbol on a white ground."""
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8}
    axes.text(*place, words, color=color, ha="center", va="center", fontsize=10, bbox=box, zorder=7)


def dashed(axes: Axes, start: Floats, end: Floats) -> None:
    """A line of reference."""
    axes.plot(*np.array([start, end]).T, color="0.35", lw=0.7, ls=(0, (5, 3)), zorder=5.0)


class Tip:
    """Points and directions at one finger, mm."""

    def __init__(self, side: int) -> None:
        """Takes them from the posture."""
        q, self.sign = STATE.q, outline.SIGNS[side]
        finger, tip = outline.finger_of(SCENE, side), outline.tip_of(SCENE, side)
        finger_outline = outline.finger_outline(SCENE, q, side)
        self.angle = float(q[3 + side])
        self.up = np.array([self.sign * np.sin(self.angle), np.cos(self.angle)])
        self.inward = np.array([self.sign * np.cos(self.angle), -np.sin(self.angle)])
        self.root, self.centre = finger_outline.root * 1e3, finger_outline.centre * 1e3
        self.length, self.half = finger.length * 1e3, finger.half_thickness * 1e3
        self.radius = tip.radius * 1e3
        self.d_n, self.d_t = float(q[5 + side]) * 1e3, float(q[7 + side]) * 1e3
        across, self.along = outline.object_axes(q[2])
        self.to_face = self.sign * across
        self.foot = self.centre + (self.radius - self.d_n) * self.to_face
        self.pole = self.centre + self.radius * self.to_face


def whole(axes: Axes) -> None:
    """The hand, with its lengths and the angles of fingers and object."""
    HandDrawing(axes, SCENE, outline.extent(SCENE, STATE.q[None])).show(STATE.q)
    q, theta = STATE.q, float(STATE.q[2])
    right, left = Tip(0), Tip(1)
    across, along = outline.object_axes(theta)
    origin, weight = np.zeros(2), q[:2] * MM.per_si
    for tip, number in ((right, 1), (left, 2)):
        dashed(axes, tip.root, tip.root + np.array([0.0, 33.0]))
        dashed(axes, tip.root, tip.root + tip.length * tip.up)
        start, turn = 90.0, -tip.sign * np.rad2deg(tip.angle)
        angle(axes, tip.root, 24.0, start, turn, rf"$\theta_{number}$", 1.22)
    axes.plot(0.0, 0.0, marker="|", color="black", ms=9)
    label(axes, np.array([-10.0, 4.5]), "origin", "0.25")
    low = np.array([0.0, -9.0])
    span(axes, low, np.array([right.root[0], -9.0]), "$W_f$", (0.0, -4.5))
    span(axes, low, np.array([left.root[0], -9.0]), "$W_f$", (0.0, -4.5))
    out = -16.0 * right.inward
    span(axes, right.root + out, right.root + right.length * right.up + out, "$L$", (5.0, 0.0))
    for end in (right.root, right.root + right.length * right.up):
        dashed(axes, end, end + 1.1 * out)
    base = left.root + 0.6 * left.length * left.up
    edge = base + left.half * left.inward
    dashed(axes, left.root + 0.32 * left.length * left.up, left.root + 1.1 * left.length * left.up)
    for start, end in ((base - 9.0 * left.inward, base), (edge + 9.0 * left.inward, edge)):
        arrow = {"arrowstyle": "-|>", "color": BLUE, "lw": 0.9, "shrinkA": 0, "shrinkB": 0}
        axes.annotate(
            "", tuple(end), tuple(start), arrowprops={**arrow, "mutation_scale": 7}, zorder=6
        )
    label(axes, edge + 12.5 * left.inward, "$d_f$", BLUE)
    # Width and offset, below and above the object.
    half = 0.5 * SCENE.grasped.width * MM.per_si * across
    middle = weight - SCENE.grasped.com_offset * MM.per_si * across
    below = -0.5 * outline.OBJECT_HEIGHT * MM.per_si * along - 5.0 * along
    span(axes, middle - half + below, middle + half + below, "$W$", (1.0, -5.0))
    above = 15.0 * along
    for point in (middle, weight):
        dashed(axes, point, point + 1.15 * above)
    span(axes, middle + above, weight + above, "$w$", (0.0, 5.0))
    label(axes, weight + np.array([3.0, -5.5]), "$(x, y)$", "black")
    dashed(axes, weight, weight + np.array([0.0, 44.0]))
    dashed(axes, weight, weight + 44.0 * along)
    angle(axes, weight, 40.0, 90.0, np.rad2deg(theta), r"$\theta$", 1.13)
    for name, way in (("x", np.array([16.0, 0.0])), ("y", np.array([0.0, 16.0]))):
        axes.annotate("", tuple(way), tuple(origin), arrowprops={"arrowstyle": "->", "lw": 0.9})
        lift = np.array([0.0, 4.0 if name == "x" else 0.0])
        label(axes, 1.25 * way + lift, f"${name}$", "black")
    left_most, right_most, _, top = outline.extent(SCENE, STATE.q[None])
    axes.set(xlim=(left_most - 8.0, right_most + 22.0), ylim=(-18.0, max(top, 125.0)))
    axes.text(right.root[0] + 8, -6, "finger 1, right", fontsize=8, ha="left")
    axes.text(left.root[0] - 8, -6, "finger 2, left", fontsize=8, ha="right")
    axes.set_xlim(left_most - 34.0, right_most + 34.0)


def close(axes: Axes) -> None:
    """The right tip, with its deformation, its tilt and the forces on it."""
    HandDrawing(axes, SCENE, outline.extent(SCENE, STATE.q[None])).show(STATE.q)
    tip = Tip(0)
    arc = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 91)
    ball = tip.centre + tip.radius * (
        np.outer(np.cos(arc), tip.inward) + np.outer(np.sin(arc), tip.up)
    )
    axes.plot(*ball.T, color="0.35", lw=0.8, ls=(0, (5, 3)), zorder=5.0)
    axes.plot(*tip.centre, "o", color="black", ms=3, zorder=6)
    label(axes, tip.centre + np.array([2.6, -2.2]), "$O_1$", "black")
    spoke = -np.sin(0.95) * tip.up + np.cos(0.95) * tip.inward
    span(axes, tip.centre, tip.centre + tip.radius * spoke, "$a$", (1.8, 0.0))
    dashed(axes, tip.foot, tip.pole)
    span(axes, tip.foot, tip.pole, "$d_n$", (-1.0, 2.6))
    # The point of the face that met the tip's pole, before and after the shear.
    axes.plot(*tip.foot, "o", color=RED, ms=3, zorder=6)
    start = tip.foot + 7.0 * tip.along
    vector(axes, start, start - 2.2 * tip.d_t * tip.along, "", (0.0, 0.0))
    label(axes, start + np.array([-10.0, 5.0]), "$d_t > 0$: the face\nhas moved down", RED)
    # Tilt: between the finger and the face.
    corner = tip.centre + 13.0 * tip.up - 0.0 * tip.inward
    base = tip.centre - 6.0 * tip.up
    dashed(axes, base, corner + 12.0 * tip.up)
    dashed(axes, tip.centre, tip.centre + 27.0 * tip.along)
    face_at = np.rad2deg(np.arctan2(tip.along[1], tip.along[0]))
    finger_at = np.rad2deg(np.arctan2(tip.up[1], tip.up[0]))
    angle(axes, tip.centre, 22.5, face_at, finger_at - face_at, r"$\theta_{p1}$", 1.16)
    # What the tip does to the object.
    press = tip.foot - 7.0 * tip.along
    vector(axes, press, press + 11.0 * tip.to_face, r"$\lambda^H > 0$ presses", (-2.0, -3.0))
    axes.set(
        xlim=(tip.centre[0] - 36.0, tip.centre[0] + 14.0),
        ylim=(tip.centre[1] - 27.0, tip.centre[1] + 30.0),
    )


def main() -> None:
    """Draws the picture."""
    with plot.styled():
        figure = new(1.25 * PAGE, 4.6)
        hand, tip = figure.subplots(1, 2, width_ratios=(1.45, 1.0))
        whole(hand)
        close(tip)
        for axes, title in ((hand, "the hand and its object"), (tip, "the right tip")):
            axes.set_aspect("equal")
            axes.axis("off")
            axes.set_title(title, fontsize=10)
        plot.save(figure, OUT)


if __name__ == "__main__":
    main()
