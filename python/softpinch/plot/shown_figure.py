"""Figures that notebooks show. Importing this module imports matplotlib."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.figure import Figure

# Dots per inch of the picture; it is shown at half that size, sharp on fine screens too.
_DPI = 200


class ShownFigure(Figure):
    """A figure that is shown where it is the last value of a cell, without pyplot.

    IPython shows figures of matplotlib only once pyplot has been told to draw in the notebook.
    """

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        """The figure as PNG, and its size on the screen, for IPython."""
        from .style import styled

        drawn = io.BytesIO()
        with styled():
            self.savefig(drawn, format="png", dpi=_DPI)
        data = drawn.getvalue()
        # The size in pixels is at a fixed place of every PNG.
        width, height = (int.from_bytes(data[k : k + 4]) for k in (16, 20))
        return data, {"width": width // 2, "height": height // 2}
