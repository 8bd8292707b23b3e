"""Drawings of hand and object as SVG, which need no package: for scenes and runs in notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

import numpy as np

from ..support.arrays import Floats
from .outline import SIGNS, Bodies, extent, finger_outline, object_axes, object_outline

# Pixels of one drawing's width, and of the line of text below it.
_WIDTH, _TEXT = 240.0, 18.0
_MARGIN = 3.0  # mm
_EDGE, _BODY, _OBJECT, _SKIN, _FIBRE = "#262626", "#9e9e9e", "#CFE3F2", "#F3C9A8", "#B5744A"


def drawings(scene: Bodies, states: Sequence[Floats], texts: Sequence[str]) -> str:
    """Drawings of some states side by side, at the same scale.

    Args:
        scene: The scene, which has the dimensions.
        states: Coordinates (9,) of each drawing, m and rad.
        texts: The line below each drawing.

    Returns:
        An SVG element; empty if a coordinate is not finite, or without states.
    """
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
        panels.append(f'<g transform="{place}">{"".join(_hand(scene, q))}</g>')
        panels.append(
            f'<text x="{(k + 0.5) * _WIDTH:.1f}" y="{scale * height + 0.7 * _TEXT:.1f}" '
            f'font-size="12" text-anchor="middle" fill="currentColor">{html.escape(text)}</text>'
        )
    size = len(states) * _WIDTH, scale * height + _TEXT
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]:.0f}" height="{size[1]:.0f}" '
        f'viewBox="0 0 {size[0]:.2f} {size[1]:.2f}">{"".join(panels)}</svg>'
    )


def _hand(scene: Bodies, q: Floats) -> Iterable[str]:
    """The parts of a drawing in mm, from back to front."""
    outlines = [finger_outline(scene, q, side) for side in range(len(SIGNS))]
    yield _line(np.array([outline.root for outline in outlines]), _EDGE, 0.5)
    yield _polygon(object_outline(scene, q), _OBJECT)
    for finger, outline in zip((scene.hand.right, scene.hand.left), outlines, strict=True):
        yield _polygon(outline.tip[::4], _SKIN)
        yield from (_line(fibre[::3], _FIBRE, 0.2) for fibre in outline.fibres)
        yield _polygon(outline.link, _BODY)
        yield _circle(outline.root, 1.25 * finger.half_thickness, "white")
    # The centre of gravity, and a line along the object's upright axis, which shows its rotation.
    yield _circle(q[:2], 5e-4, _EDGE)
    yield _line(np.array([q[:2], q[:2] + 0.02 * object_axes(float(q[2]))[1]]), _EDGE, 0.3)


def _points(points: Floats) -> str:
    return " ".join(f"{1e3 * x:.2f},{1e3 * y:.2f}" for x, y in points)


def _polygon(points: Floats, color: str) -> str:
    return (
        f'<polygon points="{_points(points)}" fill="{color}" stroke="{_EDGE}" stroke-width="0.25"/>'
    )


def _line(points: Floats, color: str, width: float) -> str:
    line = f'fill="none" stroke="{color}" stroke-width="{width}"'
    return f'<polyline points="{_points(points)}" {line}/>'


def _circle(centre: Floats, radius: float, color: str) -> str:
    x, y, r = 1e3 * centre[0], 1e3 * centre[1], 1e3 * radius
    edge = f'stroke="{_EDGE}" stroke-width="0.25"'
    return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{r:.2f}" fill="{color}" {edge}/>'
