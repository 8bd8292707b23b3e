"""The drawing of hand and object at one instant, of the outlines in `scene/outline.py`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..scene.outline import (
    SIGNS,
    finger_of,
    finger_outline,
    object_axes,
    object_height,
    object_outline,
)
from ..scene.scene import Scene
from . import style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]

# Colour of a tip, and of one that sticks in a drawing of modes.
SKIN = "#F3C9A8"


class HandDrawing:
    """The artists of a hand and its object in axes in mm, which show one state after another."""

    def __init__(self, axes: Axes, scene: Scene) -> None:
        """Adds the artists, at first without a state.

        Args:
            axes: The axes.
            scene: The scene, which has the dimensions.
        """
        from matplotlib.patches import Circle, Polygon

        self._scene = scene
        body, edge = "0.62", "0.15"
        mm = style.MM.per_si
        nowhere = np.full((4, 2), np.nan)

        def polygon(color: str, width: float, zorder: float, label: str = "") -> Polygon:
            made = Polygon(nowhere, facecolor=color, edgecolor=edge, linewidth=width, zorder=zorder)
            if label:
                made.set_label(label)
            axes.add_patch(made)
            return made

        roots = [-sign * finger_of(scene, k).root_offset * mm for k, sign in enumerate(SIGNS)]
        axes.plot(roots[::-1], [0.0, 0.0], color=edge, linewidth=1.2, zorder=1.0)
        self._object = polygon("#CFE3F2", 0.8, 2.0, "object")
        self._tips, self._links, self._fibres = [], [], []
        joints = []
        for side in (0, 1):
            self._tips.append(polygon(SKIN, 0.6, 3.0))
            self._fibres.append(axes.plot([], [], linewidth=0.4, zorder=3.1)[0])
            self._links.append(polygon(body, 0.6, 3.2))
            joint = Circle(
                (roots[side], 0.0),
                1.25 * finger_of(scene, side).half_thickness * mm,
                facecolor="white",
                edgecolor=edge,
                linewidth=0.8,
                zorder=3.3,
            )
            joints.append(axes.add_patch(joint))
        # A line along the object's upright axis makes its rotation visible.
        (self._centre,) = axes.plot(
            [], [], marker="o", color="black", markersize=2.2, linestyle="none", zorder=4.0
        )
        (self._axis,) = axes.plot([], [], color="black", linewidth=0.7, zorder=4.0)
        # Whatever moves, or is in front of what moves, in the order in which it is drawn.
        self.moving: list[Artist] = [self._object]
        for side in (0, 1):
            self.moving += [self._tips[side], self._fibres[side], self._links[side], joints[side]]
        self.moving += [self._centre, self._axis]

    def show(self, q: Floats, skins: Sequence[str] = (SKIN, SKIN)) -> None:
        """Shows a state.

        Args:
            q: Coordinates (9,), m and rad.
            skins: The colours of the right and the left tip.
        """
        mm = style.MM.per_si
        self._object.set_xy(object_outline(self._scene, q) * mm)
        gap = np.full((1, 2), np.nan)
        for side in (0, 1):
            outline = finger_outline(self._scene, q, side)
            self._tips[side].set_xy(outline.tip * mm)
            self._tips[side].set_facecolor(skins[side])
            lines = [part for fibre in outline.fibres for part in (fibre, gap)]
            self._fibres[side].set_data(*np.concatenate(lines[:-1]).T * mm)
            self._fibres[side].set_color("#B5744A" if skins[side] == SKIN else "white")
            self._links[side].set_xy(outline.link * mm)
        x, y = q[:2] * mm
        self._centre.set_data([x], [y])
        _, along = object_axes(q[2])
        top = q[:2] + 0.42 * object_height(self._scene) * along
        self._axis.set_data(*np.array([q[:2], top]).T * mm)


def draw(axes: Axes, scene: Scene, q: Floats, skins: Sequence[str] = (SKIN, SKIN)) -> None:
    """Draws hand and object into axes in mm.

    Args:
        axes: The axes.
        scene: The scene, which has the dimensions.
        q: Coordinates (9,), m and rad.
        skins: The colours of the right and the left tip.
    """
    HandDrawing(axes, scene).show(q, skins)
