"""Drawings of hand and object as SVG, which need no package: for scenes and runs in notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..support.arrays import Floats
from .disturbance import Disturbance
from .outline import arrow, extent, shapes

if TYPE_CHECKING:
    from .scene import Scene

# Pixels of one drawing's width, and of the line of text below it.
_WIDTH, _TEXT = 240.0, 18.0
_MARGIN = 3.0  # mm
# Width in the drawing, mm, of a line whose width in print is one point.
_MM_PER_POINT = 0.4
_LOAD = "#CC79A7"
# The largest moment is an arc of this angle, rad; the smallest arcs and arrows are this share of
# the largest, else they would not be seen.
_SWEEP, _LEAST = 1.5 * np.pi, 0.15


def drawings(
    scene: Scene,
    states: Sequence[Floats],
    texts: Sequence[str],
    disturbances: Sequence[Disturbance] = (),
) -> str:
    """An SVG of some states side by side, at the same scale; empty without finite states.

    Args:
        scene: The scene, which has the dimensions.
        states: Coordinates (9,) of each drawing, m and rad.
        texts: The line below each drawing.
        disturbances: Drawn at the centre of gravity: an arrow for the largest force of each and an
            arc for its largest moment, white ones for impulses. Lines below have the largest of
            all, whose arrow is the longest. Noise is not drawn.
    """
    if not states or not np.isfinite(states).all():
        return ""
    left, right, bottom, top = extent(scene, np.array(states))
    longest = min(0.45e3 * scene.grasped.width, 0.25 * (right - left))
    places = 1e3 * np.array(states)[:, :2]
    loads = [_loads(disturbances, place, longest) for place in places]
    lines = loads[0][1]
    if lines:
        left, bottom = np.minimum([left, bottom], places.min(axis=0) - longest)
        right, top = np.maximum([right, top], places.max(axis=0) + longest)
    width, height = right - left + 2.0 * _MARGIN, top - bottom + 2.0 * _MARGIN
    scale = _WIDTH / width
    panels = []
    for k, (q, text) in enumerate(zip(states, texts, strict=True)):
        x, y = scale * (k * width + _MARGIN - left), scale * (top + _MARGIN)
        # SVG counts y downwards.
        place = f"translate({x:.2f} {y:.2f}) scale({scale:.5f} {-scale:.5f})"
        panels.append(f'<g transform="{place}">{"".join([*_hand(scene, q), *loads[k][0]])}</g>')
        for n, line in enumerate([text, *lines]):
            panels.append(
                f'<text x="{(k + 0.5) * _WIDTH:.1f}" y="{scale * height + (n + 0.7) * _TEXT:.1f}" '
                'font-size="12" text-anchor="middle" fill="currentColor">'
                f"{html.escape(line)}</text>"
            )
    size = len(states) * _WIDTH, scale * height + (1 + len(lines)) * _TEXT
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]:.0f}" height="{size[1]:.0f}" '
        f'viewBox="0 0 {size[0]:.2f} {size[1]:.2f}">{"".join(panels)}</svg>'
    )


def _loads(
    disturbances: Sequence[Disturbance], place: Floats, longest: float
) -> tuple[list[str], list[str]]:
    """Arrows and arcs of disturbances at `place`, mm, and a line of text for each kind."""
    compiled = [each.compile() for each in disturbances]
    forces = [_largest(values[..., 0]) for each in compiled for _, values in each.forces]
    forces += [sine[4:] for each in compiled for sine in each.sines]
    impulses = [impulse[1:] for each in compiled for impulse in each.impulses]
    shapes: list[str] = []
    lines: list[str] = []
    for loads, (along, about), unit, fill, radii in (
        (forces, ("force", "moment"), "N", _LOAD, (0.5, 0.7)),
        (impulses, ("impulse", "angular impulse"), "N s", "white", (0.85, 1.0)),
    ):
        rows = np.reshape(loads, (-1, 3))
        with np.errstate(over="ignore"):
            sizes = np.hypot(rows[:, 0], rows[:, 1])
        if 0.0 < (largest := sizes.max(initial=0.0)) < np.inf:
            lines.append(f"largest {along} {largest:.6g} {unit}")
            for row, size in zip(rows[sizes > 0.0, :2], sizes[sizes > 0.0], strict=True):
                length = longest * max(size / largest, _LEAST)
                shapes.append(_path(arrow(place, row / size, length, longest), fill))
        turns = rows[rows[:, 2] != 0.0, 2]
        if turns.size:
            most = np.abs(turns).max()
            lines.append(f"largest {about} {most:.6g} {unit.replace('N', 'N m')}")
            for turn, out in zip(turns, np.linspace(*radii, len(turns)), strict=True):
                angle = np.sign(turn) * _SWEEP * max(abs(turn) / most, _LEAST)
                shapes += _arc(place, out * longest, angle, 0.04 * longest, fill)
    return shapes, lines


def _largest(rows: Floats) -> Floats:
    """The largest force and the largest moment of rows (k, 3), as one row (3,)."""
    with np.errstate(over="ignore"):
        force = rows[np.hypot(rows[:, 0], rows[:, 1]).argmax(), :2]
    return np.append(force, rows[np.abs(rows[:, 2]).argmax(), 2])


def _arc(place: Floats, radius: float, angle: float, thick: float, fill: str) -> Iterable[str]:
    """An arc around a place, with a head at its end."""
    head = min(7.5 * thick / radius, abs(angle))
    angles = -0.25 * np.pi + np.linspace(0.0, angle - np.sign(angle) * head, 40)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    for color, width in ((_LOAD, 2.0 * thick), (fill, thick)):
        line = f'fill="none" stroke="{color}" stroke-width="{width:.2f}"'
        yield f'<path d="{_way(place + radius * circle)}" {line}/>'
    across = circle[-1]
    tip = place + radius * (across + np.sign(angle) * head * np.array([-across[1], across[0]]))
    end, side = place + radius * across, 3.0 * thick * across
    yield _path(np.array([end - side, end + side, tip]), fill)


def _path(points: Floats, fill: str) -> str:
    return f'<path d="{_way(points)}Z" fill="{fill}" stroke="{_LOAD}" stroke-width="0.4"/>'


def _way(points: Floats) -> str:
    return "M" + " ".join(f"{x:.2f},{y:.2f}" for x, y in points)


def _hand(scene: Scene, q: Floats) -> Iterable[str]:
    """The parts of a drawing in mm, from back to front."""
    for points, fill, edge, width in shapes(scene, q):
        places = " ".join(f"{1e3 * x:.2f},{1e3 * y:.2f}" for x, y in points)
        line = f'stroke="{edge}" stroke-width="{_MM_PER_POINT * width:.2f}"'
        kind = "polygon" if fill else "polyline"
        yield f'<{kind} points="{places}" fill="{fill or "none"}" {line}/>'
