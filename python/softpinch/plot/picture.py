"""The picture of a run at an instant: hand, object, forces, modes, time and status.

`snapshot` draws one; `animate` shows one instant after another with the same artists.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..run.run import Run
from ..scene import outline
from ..study.labels import words
from ..support.arrays import Floats
from . import contact_bands, drawing
from .instants import Instant, impulses
from .style import BLACK, GREEN, MM, PURPLE, RED

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

# The longest arrow, as a share of the object's width, so that two tips' arrows do not meet; and its
# limits, as shares of the picture's width.
_LONGEST, _LEAST, _MOST = 0.45, 0.1, 0.25
# Impacts are brief and large; forces above this multiple of the 90 % quantile do not set the scale.
_TALL = 3.0
# Half of an arrow's shaft and of its head, and the head's length, as shares of the longest arrow.
_SHAFT, _WIDE, _HEAD = 0.04, 0.12, 0.3
# Room around what moves, and for the key of the arrows above it, as shares of the picture's width.
_MARGIN, _KEY = 0.04, 0.07
# The limits of a film take this many evenly spaced instants, and the extremes of every coordinate.
_SAMPLES = 200


class Frame(NamedTuple):
    """What all pictures of a film share.

    Attributes:
        left, right, bottom, top: Limits of the axes, mm.
        longest: Length of the longest arrow, mm.
        newton: Length of the arrow of 1 N, mm; 0 if there are no forces.
        newton_second: Length of the arrow of an impulse of 1 N s, mm; 0 if there are none.
    """

    left: float
    right: float
    bottom: float
    top: float
    longest: float
    newton: float
    newton_second: float

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
        left, right, bottom, top = outline.extent(run.scene, q[rows])
        width = right - left
        margin = _MARGIN * width
        sizes = np.array([np.hypot(*force) for each in shown for force in _arrows(each)])
        sizes = sizes[np.isfinite(sizes) & (sizes > 0.0)]
        longest = _LONGEST * run.scene.grasped.width * MM.per_si
        longest = min(max(longest, _LEAST * width), _MOST * width)
        newton = 0.0
        if sizes.size:
            newton = longest / min(sizes.max(), _TALL * np.quantile(sizes, 0.9))
        push = max((float(np.hypot(*each[:2])) for each in impulses(run).values()), default=0.0)
        return cls(
            left - margin,
            right + margin,
            bottom - margin,
            top + margin + (_KEY * width if newton else 0.0),
            longest,
            float(newton),
            longest / push if push else 0.0,
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
        self._forces: list[Polygon] = []
        # The tips' forces, the disturbances', and an impulse, which has another unit.
        for face, edge, width in (
            *[(BLACK, "white", 0.5)] * 2, (PURPLE, "white", 0.5), ("white", PURPLE, 1.0)
        ):  # fmt: skip
            arrow = Polygon(
                np.full((7, 2), np.nan), facecolor=face, edgecolor=edge, linewidth=width, zorder=5.0
            )
            axes.add_patch(arrow)
            self._forces.append(arrow)
        # The texts have letters until the layout is known, as an empty line has no height.
        self._time = axes.set_title("t", loc="left", pad=3.0, fontsize="medium")
        self._status = axes.set_title("g", loc="right", pad=3.0, fontsize="medium")
        width = frame.right - frame.left
        self._line = frame.top - 0.035 * width
        self._load = axes.text(
            frame.right - 0.02 * width, self._line, "",
            ha="right", va="center", color=PURPLE, fontsize="small",
        )  # fmt: skip
        self._missing = axes.text(
            0.5, 0.5, "", transform=axes.transAxes, ha="center", va="center", color=RED
        )
        if frame.newton:
            self._key(axes)
        self._digits = _digits(run)
        texts: list[Artist] = [self._time, self._status, self._load, self._missing]
        # Whatever changes from picture to picture, in the order in which it is drawn.
        self.moving: list[Artist] = [*self._hand.moving, *self._forces, *texts]

    def _key(self, axes: Axes) -> None:
        """Draws the arrow of a round force in the upper left corner."""
        from matplotlib.patches import Polygon

        frame = self._frame
        largest = frame.longest / frame.newton
        power = 10.0 ** np.floor(np.log10(largest))
        force = power * max(k for k in (1.0, 2.0, 5.0) if k * power <= largest)
        width = frame.right - frame.left
        start = np.array([frame.left + 0.02 * width, self._line])
        shape = self._arrow(start, np.array([force, 0.0]), frame.newton)
        axes.add_patch(Polygon(shape, facecolor=BLACK, edgecolor="white", linewidth=0.5))
        end = start[0] + frame.newton * force + 0.02 * width
        axes.text(end, start[1], f"{force:g} N", va="center", fontsize="small")

    def _arrow(self, start: Floats, force: Floats, unit: float) -> Floats:
        """The outline (7, 2) of an arrow in mm; forces beyond the scale have the longest arrow.

        Args:
            start: Its tail, mm.
            force: The force or impulse (2,), N or N s.
            unit: The length of the arrow of 1 N or 1 N s, mm.
        """
        size = float(np.hypot(*force))
        if not size > 0.0 or not np.isfinite(size):
            return np.full((7, 2), np.nan)
        longest = self._frame.longest
        length = min(unit * size, longest)
        # The head of a short arrow is smaller, and so is its shaft.
        head = min(_HEAD * longest, length)
        small = head / _HEAD
        thin, wide, neck = small * _SHAFT, small * _WIDE, length - head
        points = [(0.0, thin), (neck, thin), (neck, wide), (length, 0.0)]
        points += [(u, -v) for u, v in points[2::-1]]
        along, up = force / size, np.array([-force[1], force[0]]) / size
        return np.array([start + u * along + v * up for u, v in points])

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
            nothing, newton = np.full((7, 2), np.nan), self._frame.newton
            for side in (0, 1):
                at = outline.contact_point(scene, shown.q, side) * mm
                force = None if shown.contact is None else shown.contact[side]
                outlined = nothing if force is None else self._arrow(at, force, newton)
                self._forces[side].set_xy(outlined)
            centre, none = shown.q[:2] * mm, np.zeros(3)
            load = none if shown.external is None else shown.external
            push = none if shown.impulse is None else shown.impulse
            self._forces[2].set_xy(self._arrow(centre, load[:2], newton))
            self._forces[3].set_xy(self._arrow(centre, push[:2], self._frame.newton_second))
            self._load.set_text(_load(load, push))
        self._time.set_text(self._caption(shown))
        self._status.set_text(", ".join(map(words, shown.status)))
        good = shown.status == ("completed",)
        self._status.set_color(GREEN if good else RED)

    def _caption(self, shown: Instant) -> str:
        """The time, and whether forces are missing."""
        text = f"t = {shown.time:.{self._digits}f} s"
        if shown.contact is not None and not np.isfinite(shown.contact).all():
            text += ", forces unknown"
        return text


def _load(load: Floats, push: Floats) -> str:
    """What acts on the object beside the tips: arrows' names, moments, the size of an impulse."""
    texts = ["disturbance"] if load.any() else []
    texts += [f"{load[2]:+.3g} N m"] if load[2] else []
    size = np.hypot(*push[:2])
    texts += [f"impulse {size:.3g} N s"] if size else []
    texts += [f"{'' if size else 'impulse '}{push[2]:+.3g} N m s"] if push[2] else []
    # The minus sign of figures is longer than a hyphen.
    return ", ".join(texts).replace("-", "\u2212")


def _digits(run: Run) -> int:
    """Decimals that tell a thousandth of the run's time."""
    span = float(run.t[-1] - run.t[0])
    return int(np.clip(np.ceil(3.0 - np.log10(span)), 1, 9)) if span > 0.0 else 6
