"""The picture of a run at an instant: hand, object, forces, modes, time and status.

`snapshot` draws one; `animate` shows one instant after another with the same artists.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..run.run import Run
from ..study.labels import words
from ..support.arrays import Floats
from . import contact_bands, drawing
from .instants import Instant
from .style import BLACK, GREEN, MM, PURPLE, RED

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

# The longest arrow, as a share of the picture's width.
_LONGEST = 0.3
# Impacts are brief and large; forces above this multiple of the 90 % quantile do not set the scale.
_TALL = 3.0
# Half of an arrow's shaft and of its head, and the head's length, as shares of the longest arrow.
_SHAFT, _WIDE, _HEAD = 0.022, 0.065, 0.15
# Room around what moves, and for the key of the arrows above it, as shares of the picture's width.
_MARGIN, _KEY = 0.04, 0.07
# The limits of a film take this many evenly spaced instants, and the extremes of every coordinate.
_SAMPLES = 200


class Frame(NamedTuple):
    """What all pictures of a film share.

    Attributes:
        left, right, bottom, top: Limits of the axes, mm.
        newton: Length of the arrow of 1 N, mm; 0 if there are no forces.
    """

    left: float
    right: float
    bottom: float
    top: float
    newton: float

    @classmethod
    def of(cls, run: Run, shown: Sequence[Instant]) -> Frame:
        """Limits that contain the whole motion, and a scale for all forces."""
        q = np.array([each.q for each in shown])
        q = q[np.isfinite(q).all(axis=1)]
        if not len(q):
            q = np.asarray(run.scene.start().q)[None]
        rows = np.unique(
            np.concatenate(
                [
                    np.linspace(0, len(q) - 1, min(len(q), _SAMPLES)).astype(int),
                    q.argmin(axis=0),
                    q.argmax(axis=0),
                ]
            )
        )
        left, right, bottom, top = drawing.extent(run.scene, q[rows])
        width = right - left
        margin = _MARGIN * width
        sizes = np.array([np.hypot(*force) for each in shown for force in _arrows(each)])
        sizes = sizes[np.isfinite(sizes) & (sizes > 0.0)]
        newton = 0.0
        if sizes.size:
            newton = _LONGEST * width / min(sizes.max(), _TALL * np.quantile(sizes, 0.9))
        return cls(
            left - margin,
            right + margin,
            bottom - margin,
            top + margin + (_KEY * width if newton else 0.0),
            float(newton),
        )


def _arrows(shown: Instant) -> list[Floats]:
    """The forces of an instant, (2,) each, N."""
    contact = [] if shown.contact is None else list(shown.contact)
    return contact + ([] if shown.external is None else [shown.external[:2]])


class Picture:
    """The artists of a picture in given axes."""

    def __init__(self, axes: Axes, run: Run, frame: Frame) -> None:
        """Adds the artists and sets limits and labels; the axes' scales are equal.

        Args:
            axes: The axes.
            run: The run.
            frame: Limits and scale.
        """
        from matplotlib.patches import Polygon

        self._run, self._frame = run, frame
        axes.set_aspect("equal")
        axes.set_xlim(frame.left, frame.right)
        axes.set_ylim(frame.bottom, frame.top)
        axes.set_xlabel("$x$ [mm]")
        axes.set_ylabel("$y$ [mm]")
        self._hand = drawing.HandDrawing(axes, run.scene)
        self._longest = _LONGEST * (frame.right - frame.left) / (1.0 + 2.0 * _MARGIN)
        self._forces: list[Polygon] = []
        for color in (BLACK, BLACK, PURPLE):
            arrow = Polygon(
                np.full((7, 2), np.nan),
                facecolor=color, edgecolor="white", linewidth=0.5, zorder=5.0,
            )  # fmt: skip
            self._forces.append(axes.add_patch(arrow))
        self._time = axes.set_title("t", loc="left", pad=3.0)
        self._status = axes.set_title("g", loc="right", pad=3.0)
        self._missing = axes.text(
            0.5, 0.5, "", transform=axes.transAxes, ha="center", va="center", color=RED
        )
        if frame.newton:
            self._key(axes)
        self._digits = _digits(run)
        texts: list[Artist] = [self._time, self._status, self._missing]
        # Whatever changes from picture to picture, in the order in which it is drawn.
        self.moving: list[Artist] = [*self._hand.moving, *self._forces, *texts]

    def _key(self, axes: Axes) -> None:
        """Draws the arrow of a round force in the upper left corner, and names the colours."""
        from matplotlib.patches import Polygon

        frame = self._frame
        largest = self._longest / frame.newton
        power = 10.0 ** np.floor(np.log10(0.5 * largest))
        force = power * max(k for k in (1.0, 2.0, 5.0) if k * power <= 0.5 * largest)
        width = frame.right - frame.left
        start = np.array([frame.left + 0.02 * width, frame.top - 0.035 * width])
        shape = self._arrow(start, np.array([force, 0.0]))
        axes.add_patch(Polygon(shape, facecolor=BLACK, edgecolor="white", linewidth=0.5))
        disturbed = bool(self._run.scene.disturbances)
        text = f"{force:g} N, of a tip" + (" (black) or a disturbance" if disturbed else "")
        end = start[0] + frame.newton * force + 0.02 * width
        axes.text(end, start[1], text, va="center", fontsize="small")

    def _arrow(self, start: Floats, force: Floats) -> Floats:
        """The outline (7, 2) of an arrow in mm; forces beyond the scale have the longest arrow."""
        size = float(np.hypot(*force))
        if not size > 0.0 or not np.isfinite(size):
            return np.full((7, 2), np.nan)
        length = min(self._frame.newton * size, self._longest)
        head = min(_HEAD * self._longest, length)
        # The head of a short arrow is smaller, and so is its shaft.
        small = head / (_HEAD * self._longest)
        thin, wide = small * _SHAFT * self._longest, small * _WIDE * self._longest
        along, up = force / size, np.array([-force[1], force[0]]) / size
        outline = [(0, thin), (length - head, thin), (length - head, wide), (length, 0)]
        outline += [(length - head, -wide), (length - head, -thin), (0, -thin)]
        return np.array([start + u * along + v * up for u, v in outline])

    def show(self, shown: Instant) -> None:
        """Shows an instant."""
        scene, mm = self._run.scene, MM.per_si
        finite = bool(np.isfinite(shown.q).all())
        for each in (*self._hand.moving, *self._forces):
            each.set_visible(finite)
        self._missing.set_text("" if finite else "the state is not finite")
        if finite:
            skins = (drawing.SKIN, drawing.SKIN)
            if shown.modes is not None:
                right, left = shown.modes
                skins = (contact_bands.COLORS[right], contact_bands.COLORS[left])
            self._hand.show(shown.q, skins)
            nothing = np.full((7, 2), np.nan)
            for side in (0, 1):
                at = drawing.contact_point(scene, shown.q, side) * mm
                force = None if shown.contact is None else shown.contact[side]
                self._forces[side].set_xy(nothing if force is None else self._arrow(at, force))
            load = shown.external
            self._forces[2].set_xy(
                nothing if load is None else self._arrow(shown.q[:2] * mm, load[:2])
            )
        self._time.set_text(self._caption(shown))
        self._status.set_text(", ".join(map(words, shown.status)))
        good = shown.status == ("completed",)
        self._status.set_color(GREEN if good else RED)

    def _caption(self, shown: Instant) -> str:
        """Time, and the moment of the disturbances."""
        text = f"t = {shown.time:.{self._digits}f} s"
        if shown.external is not None and shown.external[2] != 0.0:
            text += f", moment {shown.external[2]:+.3g} N m".replace("-", "\u2212")
        if shown.contact is not None and not np.isfinite(shown.contact).all():
            text += ", forces unknown"
        return text


def _digits(run: Run) -> int:
    """Decimals that tell a thousandth of the run's time."""
    span = float(run.t[-1] - run.t[0])
    return int(np.clip(np.ceil(3.0 - np.log10(span)), 1, 9)) if span > 0.0 else 6
