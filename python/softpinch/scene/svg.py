"""Drawings of hand and object as SVG, which need no package: for scenes and runs in notebooks."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..support.arrays import Floats
from .outline import extent, shapes

if TYPE_CHECKING:
    from .scene import Scene

# Pixels of one drawing's width, and of the line of text below it.
_WIDTH, _TEXT = 240.0, 18.0
_MARGIN = 3.0  # mm
# Width in the drawing, mm, of a line whose width in print is one point.
_MM_PER_POINT = 0.4


def drawings(scene: Scene, states: Sequence[Floats], texts: Sequence[str]) -> str:
    """An SVG of finite states (9,) of a scene side by side, at one scale, each with its text."""
    if not states or not np.isfinite(states).all():
        return ""
    left, right, bottom, top = extent(scene, np.array(states))
    width, height = right - left + 2.0 * _MARGIN, top - bottom + 2.0 * _MARGIN
    scale = _WIDTH / width
    panels = []
    for k, (q, text) in enumerate(zip(states, texts, strict=True)):
        x, y = scale * (k * width + _MARGIN - left), scale * (top + _MARGIN)
        # SVG counts y downwards.
        place = f"translate({x:.2f} {y:.2f}) scale({scale:.5f} {-scale:.5f})"
        panels.append(f'<g transform="{place}">')
        for points, fill, edge, thick in shapes(scene, q):
            corners = " ".join(f"{1e3 * x:.2f},{1e3 * y:.2f}" for x, y in points)
            line = f'stroke="{edge}" stroke-width="{_MM_PER_POINT * thick:.2f}"'
            kind = "polygon" if fill else "polyline"
            panels.append(f'<{kind} points="{corners}" fill="{fill or "none"}" {line}/>')
        panels.append("</g>")
        panels.append(
            f'<text x="{(k + 0.5) * _WIDTH:.1f}" y="{scale * height + 0.7 * _TEXT:.1f}" '
            'font-size="12" text-anchor="middle" fill="currentColor">'
            f"{html.escape(text)}</text>"
        )
    size = len(states) * _WIDTH, scale * height + _TEXT
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]:.0f}" height="{size[1]:.0f}" '
        f'viewBox="0 0 {size[0]:.2f} {size[1]:.2f}">{"".join(panels)}</svg>'
    )
