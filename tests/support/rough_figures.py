"""Figures that are saved coarsely and without a layout, which takes most of the time of saving.

For tests of what is saved, and when; those of tests/plot are about what is drawn.
"""

from typing import Any

from matplotlib.figure import Figure

FINE = Figure.savefig


def coarse(figure: Figure, *arguments: Any, **options: Any) -> None:
    """`Figure.savefig` at 50 dots per inch; frames of films stay as they are."""
    if options.get("format") in ("png", "pdf", "svg"):
        # Not "none", which stands for an engine: Figure.savefig draws twice where there is one.
        figure.set_layout_engine(None)
        options["dpi"] = 50
    FINE(figure, *arguments, **options)


def use(rough: bool) -> None:
    """From now on this process saves coarse figures, or fine ones."""
    Figure.savefig = coarse if rough else FINE  # type: ignore
