"""Draws docs/figures/architecture.png: the rooms of the package, and the way of the data."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import FancyBboxPatch

OUT = Path(__file__).resolve().parent.parent / "docs" / "figures" / "architecture.png"
# From the ground up, as tests/test_architecture.py has the order.
ROOMS = (
    ("_core (Rust)", "mechanics, integrators, ensemble kernel"),
    ("support/", "checked records, errors, TOML, tables, interrupts"),
    ("scene/", "hand, object, schedule, disturbances, state"),
    ("paper  stress  strategies", "ready scenes"),
    ("run/", "simulate, Run, evaluate, error estimate, explain"),
    ("analysis/", "equilibria, how hard they can be pushed, linear models"),
    ("study/", "StudySpec, distributions, draws, executor, results"),
    ("store/", "a study in a folder: parts, manifest, lock"),
    ("montecarlo", "monte_carlo, over study/ and store/"),
    ("rare", "rare_event, over study/ and store/"),
    ("fitting/", "numbers of a scene from measured motions"),
    ("simulator/", "stepping from outside, tasks for learning"),
    ("accuracy/", "reference, stability, work-precision, advise"),
    ("plot/", "every figure"),
    ("gym/", "Gymnasium environments"),
    ("jax/", "a differentiable layer"),
    ("reproduce/", "the paper's experiment and its verdicts"),
    ("cli/", "the shell commands"),
)
PALE = [*plt.get_cmap("Set3").colors, *plt.get_cmap("Pastel1").colors]
COLORS = ("#bbbbbb", *PALE[: len(ROOMS) - 1])
COLOR = {name: color for (name, _), color in zip(ROOMS, COLORS, strict=True)}
# (what, from which room)
SIMULATE = (
    ("Scene", "scene/"),
    ("Options: checked arguments", "run/"),
    ("parameters, inputs: arrays", "scene/"),
    ("_core.Simulation: one run", "_core (Rust)"),
    ("Run: rows, residuals, energies, status", "run/"),
    ("plot, save, check, replay", "plot/"),
)
MONTE_CARLO = (
    ("Scene, and vary: path → distribution", "scene/"),
    ("StudySpec: checked once", "study/"),
    ("Draws: numbers of 1024 runs a block", "study/"),
    ("threads, or an executor's workers", "study/"),
    ("_core.Batch: runs in SIMD lanes", "_core (Rust)"),
    ("Rows: one for each run", "study/"),
    ("Ensemble in memory, Study in a folder", "store/"),
)
TEXT = {"ha": "center", "va": "center", "fontsize": 8.5}


def box(axes: Axes, x: float, y: float, width: float, room: str, text: str) -> None:
    """Draws a box in the color of a room."""
    shape = FancyBboxPatch(
        (x, y), width, 0.72, boxstyle="round,pad=0.04", fc=COLOR[room], ec="black", lw=0.7
    )
    axes.add_patch(shape)
    axes.text(x + width / 2, y + 0.36, text, **TEXT)


def flow(axes: Axes, x: float, title: str, steps: tuple[tuple[str, str], ...]) -> None:
    """Draws boxes below each other, joined by arrows."""
    top = len(ROOMS) - 1
    axes.text(x + 1.9, top + 1.1, title, weight="bold", family="monospace", **TEXT)
    for k, (text, room) in enumerate(steps):
        y = top - 1.75 * k
        box(axes, x, y, 3.8, room, text)
        if k:
            axes.annotate(
                "", (x + 1.9, y + 0.78), (x + 1.9, y + 1.69), arrowprops={"arrowstyle": "->"}
            )


def main() -> None:
    """Draws the picture."""
    figure, axes = plt.subplots(figsize=(11, 6.2), layout="constrained")
    axes.text(2.75, len(ROOMS) + 0.1, "imports point down", weight="bold", **TEXT)
    for y, (name, words) in enumerate(ROOMS):
        box(axes, 0, y, 5.5, name, "")
        axes.text(0.1, y + 0.36, name, va="center", fontsize=8.5, family="monospace")
        axes.text(5.4, y + 0.36, words, va="center", ha="right", fontsize=7)
    flow(axes, 6.4, "sp.simulate", SIMULATE)
    flow(axes, 10.9, "sp.monte_carlo", MONTE_CARLO)
    axes.set(xlim=(-0.2, 15.0), ylim=(-0.3, len(ROOMS) + 0.5))
    axes.axis("off")
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, dpi=150)


if __name__ == "__main__":
    main()
