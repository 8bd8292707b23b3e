"""Figures that notebooks show. Importing this module imports matplotlib."""

import io
from collections.abc import Mapping
from typing import Any

import matplotlib
from matplotlib.figure import Figure

# Dots per inch of the picture; it is shown at half that size, sharp on fine screens too.
_DPI = 200


class ShownFigure(Figure):
    """A figure that is shown where it is the last value of a notebook's cell, without pyplot."""

    rc: Mapping[str, Any] = {}  # settings of matplotlib with which the figure is drawn

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        """The figure as PNG, and its size on the screen in pixels, for IPython."""
        drawn = io.BytesIO()
        with matplotlib.rc_context():
            settings: Any = matplotlib.rcParams
            settings.update(self.rc)
            self.savefig(drawn, format="png", dpi=_DPI)
        data = drawn.getvalue()
        # The size in pixels is at a fixed place of every PNG.
        width, height = (int.from_bytes(data[k : k + 4], "big") for k in (16, 20))
        return data, {"width": width // 2, "height": height // 2}
