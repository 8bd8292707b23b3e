"""Frames of a scene that is stepped from outside: as arrays of pixels, or in a window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..scene import outline
from ..scene.scene import Scene
from ..support.arrays import Floats
from ..support.extras import require
from . import drawing, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Length of the arrow of a force of 1 N, mm, and its longest.
_MM_PER_N, _LONGEST = 6.0, 40.0
_INCHES, _DPI = (4.8, 4.8), 100
# Shown beyond the hand and the object at their start, mm.
_MARGIN = 14.0


class Frames:
    """Draws one frame after another on the same axes, with the same limits."""

    def __init__(self, scene: Scene, window: bool = False) -> None:
        """Makes a figure.

        Args:
            scene: The scene; the limits of the axes show hand and object at its start.
            window: Whether frames are shown in a window of Matplotlib's backend.

        Raises:
            ImportError: matplotlib is not installed.
        """
        require("matplotlib", extra="plot", purpose="figures")
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._scene = scene
        left, right, bottom, top = outline.extent(scene, np.asarray(scene.start().q)[None])
        self._limits = (left - _MARGIN, right + _MARGIN, bottom - 4.0, top + 2.0 * _MARGIN)
        self._plt: Any = None
        self.has_window = False
        if window:
            import matplotlib.pyplot as plt

            self._plt = plt
            self._figure: Any = plt.figure(figsize=_INCHES, dpi=_DPI)
            canvas = type(self._figure.canvas)
            self.has_window = getattr(canvas, "required_interactive_framework", None) is not None
            if self.has_window:
                plt.show(block=False)
        else:
            self._figure = Figure(figsize=_INCHES, dpi=_DPI)
            FigureCanvasAgg(self._figure)
        # A layout that adapts to each frame would make a film jump.
        self._axes: Axes = self._figure.add_axes((0.14, 0.1, 0.83, 0.83))

    def draw(self, q: Floats, target: Floats, force: Floats, title: str) -> None:
        """Draws one frame, and shows it if there is a window.

        Args:
            q: Coordinates (9,), m and rad.
            target: Wanted pose (3,), m and rad.
            force: Force and moment on the object (3,), N and N m.
            title: The text above the picture.
        """
        axes, mm = self._axes, style.MM.per_si
        axes.clear()
        drawing.draw(axes, self._scene, q)
        axes.plot(
            *(target[:2] * mm),
            marker="+",
            color="#1B7F3B",
            markersize=11,
            markeredgewidth=1.5,
            linestyle="none",
            zorder=5.0,
            label="wanted position",
        )
        size = float(np.hypot(force[0], force[1]))
        if size > 0.0:
            arrow = force[:2] / size * min(_MM_PER_N * size, _LONGEST)
            axes.annotate(
                "",
                xy=tuple(q[:2] * mm + arrow),
                xytext=tuple(q[:2] * mm),
                arrowprops={"arrowstyle": "-|>", "color": "#B3202A", "linewidth": 1.8},
                zorder=6.0,
            )
        axes.set_xlim(self._limits[:2])
        axes.set_ylim(self._limits[2:])
        axes.set_aspect("equal")
        axes.set_xlabel("x [mm]")
        axes.set_ylabel("y [mm]")
        push = f"push {size:.1f} N, {1e3 * force[2]:+.0f} N mm" if force.any() else "no push"
        axes.set_title(f"{title}, {push}", fontsize=10)
        axes.legend(loc="upper right", fontsize=8)
        if self.has_window:
            self._figure.canvas.draw_idle()
            self._figure.canvas.flush_events()

    def pixels(self) -> NDArray[np.uint8]:
        """Returns the last frame (height, width, 3), as a copy."""
        self._figure.canvas.draw()
        return np.array(self._figure.canvas.buffer_rgba(), dtype=np.uint8)[:, :, :3].copy()

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._plt is not None:
            self._plt.close(self._figure)
