"""Draws docs/figures/contact_modes.png: the modes of unilateral contact, and what ends them."""

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

from softpinch import plot
from softpinch.plot.style import PAGE, new

OUT = Path(__file__).resolve().parent.parent / "docs" / "figures" / "contact_modes.png"
WIDTH, HEIGHT = 3.1, 1.35
# Name -> (left, bottom, colour, (held, multipliers, couple of the tip)).
MODES = {
    "stick": (
        (0.0, 3.6, "#cfe3f3"),
        ("held: $C^H$ and $C^N$", r"$|\lambda^N| \leq \mu\,\lambda^H$", "the couple acts"),
    ),
    "slip": (
        (6.3, 3.6, "#fbdcc8"),
        (
            "held: $C^H$",
            r"$\lambda^N = -\sigma\mu\,\lambda^H,\ \lambda^H \geq 0$",
            r"the couple acts; $\sigma$ = sign of $v$",
        ),
    ),
    "free": (
        (0.0, 0.0, "#ffffff"),
        (r"held: nothing, $g \geq 0$", r"$\lambda^H = \lambda^N = 0$", "no couple; tilt frozen"),
    ),
    "graze": (
        (6.3, 0.0, "#d5eee4"),
        (
            "held: $C^H$",
            r"$\lambda^H = \lambda^N = 0$",
            r"a part $\psi$ of the couple acts",
        ),
    ),
}
# (tail, head, words, their place, their alignment).
ARROWS = (
    (
        (3.1, 4.6),
        (6.3, 4.6),
        "border of the friction cone\n" r"$|\lambda^N| = \mu\,\lambda^H$",
        (4.7, 4.66),
        "cb",
    ),
    ((6.3, 4.25), (3.1, 4.25), "slip stops, $v = 0$", (4.7, 4.2), "ct"),
    (
        (8.7, 3.6),
        (8.7, 1.35),
        "$\\lambda^H = 0$; without\nthe couple the gap\nwould close",
        (8.8, 2.48),
        "lc",
    ),
    ((7.7, 1.35), (7.7, 3.6), "$\\psi = 1$\n(stick if $v = 0$)", (7.6, 2.48), "rc"),
    ((6.3, 3.7), (3.1, 1.05), "$\\lambda^H = 0$;\nthe gap opens", (4.6, 1.95), "lt"),
    ((6.3, 0.5), (3.1, 0.5), r"$\psi = 0$", (4.7, 0.56), "cb"),
    ((2.6, 1.35), (6.3, 3.98), "", (0.0, 0.0), "cc"),
    ((1.5, 1.35), (1.5, 3.6), "the tip meets\nthe face, $g = 0$:\nimpact law", (1.6, 2.62), "lc"),
)
SIDES = {"c": "center", "l": "left", "r": "right", "t": "top", "b": "bottom"}
NOTES = (
    "The modes of both tips are chosen anew at the start, where an input switches, after an\n"
    "impact or an impulse, and at every event of one of the tips; any change is possible there.\n"
    "A tip that sticks becomes free (dashed) only so, or where its surface has relaxed ($d_n = 0$)."
)


def box(axes: Axes, name: str) -> None:
    """Draws the box of a mode."""
    (x, y, color), lines = MODES[name]
    style = "round,pad=0.0,rounding_size=0.12"
    shape = FancyBboxPatch((x, y), WIDTH, HEIGHT, boxstyle=style, fc=color, ec="black", lw=0.8)
    axes.add_patch(shape)
    middle = x + WIDTH / 2
    axes.text(middle, y + HEIGHT - 0.2, name.upper(), ha="center", va="center", weight="bold")
    for k, line in enumerate(lines):
        axes.text(middle, y + HEIGHT - 0.52 - 0.29 * k, line, ha="center", va="center", fontsize=8)


def main() -> None:
    """Draws the picture."""
    with plot.styled():
        figure = new(PAGE, 4.2)
        axes = figure.subplots()
        for tail, head, words, (x, y), (across, up) in ARROWS:
            axes.annotate(
                "", head, tail, arrowprops={"arrowstyle": "-|>", "lw": 0.8, "fc": "black"}
            )
            axes.text(x, y, words, ha=SIDES[across], va=SIDES[up], fontsize=8, linespacing=1.1)
        dashed = {"arrowstyle": "-|>", "lw": 0.8, "fc": "black", "ls": (0, (4, 3))}
        axes.annotate("", (0.7, 1.35), (0.7, 3.6), arrowprops=dashed)
        for name in MODES:
            box(axes, name)
        axes.text(0.0, -0.3, NOTES, ha="left", va="top", fontsize=8, linespacing=1.25)
        axes.set(xlim=(-0.05, 10.3), ylim=(-1.25, 5.35))
        axes.axis("off")
        plot.save(figure, OUT)


if __name__ == "__main__":
    main()
