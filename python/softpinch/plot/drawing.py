"""Hand and object in axes of Matplotlib: alone, with forces and modes of a run, and in frames.

`instants` reads a run at any time: the core computes it again, in less time than a drawing takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..run import ContactMode, Request, Run, evaluate, measures
from ..scene import HandMotion, Pid, Scene, outline, parts
from ..scene.fields import words
from ..scene.outline import SKIN
from ..support import Floats, require
from .style import BLACK, GREEN, MM, PURPLE, RED
from .timeline import COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon
    from matplotlib.transforms import Affine2D

# The longest arrow, as a share of the object's width, so that two tips' arrows do not meet; and its
# limits, as shares of the picture's width.
_LONGEST, _LEAST, _MOST = 0.45, 0.1, 0.25
# Impacts are brief and large; forces above this multiple of the 90 % quantile do not set the scale.
_TALL = 3.0
# Room around the moving parts, and above it for the arrows' key, as shares of the picture's width.
_MARGIN, _KEY = 0.04, 0.07
# The limits of a film take this many evenly spaced instants, and the extremes of every coordinate.
_SAMPLES = 200
# An impulse is shown for this share of the run's time.
_SHOWN = 0.05
# The outline of no arrow.
_NO_ARROW = np.full((7, 2), np.nan)


def polygon(axes: Axes, fill: str, edge: str, width: float, zorder: float) -> Polygon:
    """Adds a polygon, or without `fill` a line, without points at first."""
    from matplotlib.patches import Polygon

    patch = Polygon(
        _NO_ARROW, closed=bool(fill), facecolor=fill or "none", edgecolor=edge, linewidth=width,
        zorder=zorder,
    )  # fmt: skip
    axes.add_patch(patch)
    return patch


Limits = tuple[float, float, float, float]
Modes = tuple[ContactMode, ContactMode]


class HandDrawing:
    """Hand and object in axes in mm, which show one state after another."""

    def __init__(self, axes: Axes, scene: Scene, limits: Limits) -> None:
        axes.set(aspect="equal", xlim=limits[:2], ylim=limits[2:])
        self._scene = scene
        self.parts = [
            polygon(axes, fill, edge, width, 2.0 + 0.01 * layer)
            for layer, (_, fill, edge, width) in enumerate(outline.shapes(scene, np.zeros(9)))
        ]

    def show(self, q: Floats, modes: Modes | None = None) -> None:
        """Shows the coordinates q (9,), m and rad, with tips in the colours of their modes."""
        skins = (SKIN, SKIN) if modes is None else (COLORS[modes[0]], COLORS[modes[1]])
        for part, shape in zip(self.parts, outline.shapes(self._scene, q, skins), strict=True):
            part.set_xy(shape.points * MM.per_si)
            part.set_facecolor(shape.fill or "none")
            part.set_edgecolor(shape.edge)


class Instant(NamedTuple):
    """A run at one instant. Forces, along the hand's axes, are zero where they are not wanted."""

    time: float  # s
    place: Floats  # the hand's frame in that of the picture: position, m, and tilt, rad, (3,)
    q: Floats  # coordinates (9,), m and rad
    modes: Modes | None  # of the right and the left contact; None in bilateral contact
    contact: Floats  # forces of the right and the left tip on the object (2, 2), N
    external: Floats  # force and moment of the disturbances (3,), N and N m
    # The last impulse (3,), N s and N m s, if it was since the instant before, or less than
    # `_SHOWN` of the run's time ago; else zero.
    impulse: Floats
    status: tuple[str, ...]  # violations since the instant before; at the run's end its status


def instants(run: Run, times: Floats, forces: bool, fixed: bool = False) -> list[Instant]:
    """The run at instants (k,), s, of its duration, seen along the hand's axes, or `fixed` ones."""
    asked, place = np.unique(times, return_inverse=True)
    found = Request(run.scene, run._options).rows_at(asked, "multipliers", "contact")
    # Events at asked instants of the last step may end the repeated run there.
    place = np.minimum(place, len(found["t"]) - 1)
    q = found["q"][place]
    contact, external = np.zeros((len(times), 2, 2)), np.zeros((len(times), 3))
    pushes: dict[float, Floats] = {}
    if forces:
        # The rows of (25) for x and y.
        multipliers, across = found["multipliers"][place], outline.contacts(run.scene, q).normals
        along = np.stack([-across[..., 1], across[..., 0]], axis=-1)
        pressing = np.array(outline.SIGNS) * multipliers[:, :2]
        contact = pressing[..., None] * across + multipliers[:, 2:, None] * along
        # Disturbances do not depend on the state, nor on what moves the fingers and the hand.
        motion = run.scene.motion and HandMotion.constant()
        still = replace(run.scene, control=Pid(), initial=None, motion=motion)
        plain, at_rest = replace(still, contact="bilateral", fingers="pid"), np.zeros(9)
        each_forces = [evaluate(plain, t, at_rest, at_rest).forces for t in times.tolist()]
        external = np.array([each.external[:3] for each in each_forces])
        pushes = measures.impulses(run)
    modes: list[Any] = [None] * len(times)
    if run.scene.contact == "unilateral":
        modes = [(ContactMode(a), ContactMode(b)) for a, b in found["contact"][place].tolist()]
    hand = (run.scene.motion or HandMotion.constant()).at(times)
    places = np.column_stack([hand.position, hand.tilt]) * float(fixed)
    seen = []
    for k, time in enumerate(times.tolist()):
        since = times[k - 1] if k else time
        push, status = _impulse(run, pushes, since, time), _status(run, since, time)
        # Disturbances act along fixed axes.
        into_hand = np.eye(3)
        into_hand[:2, :2] = outline.object_axes(hand.tilt[k])
        loads = into_hand @ external[k], into_hand @ push
        seen.append(Instant(time, places[k], q[k], modes[k], contact[k], *loads, status))
    return seen


def _impulse(run: Run, pushes: dict[float, Floats], since: float, time: float) -> Floats:
    """The last impulse, if it is still shown."""
    begun = [each for each in pushes if each <= time]
    shown = _SHOWN * float(run.t[-1] - run.t[0])
    if begun and (begun[-1] > since or time - begun[-1] <= shown):
        return pushes[begun[-1]]
    return np.zeros(3)


def _status(run: Run, since: float, time: float) -> tuple[str, ...]:
    """The violations from `since` to `time`; at the run's end its status."""
    if time >= run.t[-1]:
        return (run.status,)
    return tuple(
        name
        for name, spans in run.violation_intervals.items()
        if ((spans[:, 1] >= since) & (spans[:, 0] <= time)).any()
    )


class Frame(NamedTuple):
    """Limits of the axes and scales that all pictures of a film share, mm."""

    left: float
    right: float
    bottom: float
    top: float
    longest: float  # length of the longest arrow
    newton: float  # length of the arrow of 1 N; 0 if there are no forces
    newton_second: float  # length of the arrow of an impulse of 1 N s; 0 if there are none

    @classmethod
    def of(cls, run: Run, shown: Sequence[Instant]) -> Frame:
        """Limits that contain the whole motion, and a scale for all forces."""
        q = np.array([each.q for each in shown])
        some = np.linspace(0, len(q) - 1, min(len(q), _SAMPLES)).astype(int)
        rows = np.unique(np.concatenate([some, q.argmin(axis=0), q.argmax(axis=0)]))
        left, right, bottom, top = outline.extent(run.scene, q[rows])
        longest = _LONGEST * parts.width(run.scene) * MM.per_si
        longest = np.clip(longest, _LEAST * (right - left), _MOST * (right - left))
        corners = [(x, y) for x in (left, right) for y in (bottom, top)]
        moved = np.concatenate([_placed(each.place).transform(corners) for each in shown])
        (left, bottom), (right, top) = moved.min(axis=0), moved.max(axis=0)
        pushing = [force for each in shown for force in (*each.contact, each.external[:2])]
        sizes = np.hypot(*np.transpose(pushing))
        sizes = sizes[sizes > 0.0]
        newton = longest / min(sizes.max(), _TALL * np.quantile(sizes, 0.9)) if sizes.size else 0.0
        pushes = measures.impulses(run).values()
        push = max((float(np.hypot(*each[:2])) for each in pushes), default=0.0)
        margin, key = _MARGIN * (right - left), _KEY * (right - left) if newton else 0.0
        limits = left - margin, right + margin, bottom - margin, top + margin + key
        return cls(*limits, longest, float(newton), longest / push if push else 0.0)


def _placed(place: Floats) -> Affine2D:
    """From the hand's frame, mm, to the picture's, for the hand's `place`."""
    from matplotlib.transforms import Affine2D

    x, y, tilt = place
    return Affine2D().rotate(tilt).translate(x * MM.per_si, y * MM.per_si)


class Picture:
    """Hand, object, forces, time and status of a run in axes, at one instant after another."""

    def __init__(self, axes: Axes, run: Run, frame: Frame) -> None:
        self._run, self._frame = run, frame
        axes.set(xlabel="$x$ [mm]", ylabel="$y$ [mm]")
        self._hand = HandDrawing(axes, run.scene, frame[:4])
        # The tips' forces, the disturbances', and an impulse, which has another unit.
        self._contact = [polygon(axes, BLACK, "white", 0.5, 5.0) for _ in (0, 1)]
        self._external = polygon(axes, PURPLE, "white", 0.5, 5.0)
        self._impulse = polygon(axes, "white", PURPLE, 1.0, 5.0)
        self._hands_place = _placed(np.zeros(3))
        for each in (*self._hand.parts, *self._contact, self._external, self._impulse):
            each.set_transform(self._hands_place + axes.transData)
        # The texts have letters until the layout is known, as an empty line has no height.
        self._time = axes.set_title("t", loc="left", pad=3.0, fontsize="medium")
        self._status = axes.set_title("g", loc="right", pad=3.0, fontsize="medium")
        width = frame.right - frame.left
        line = frame.top - 0.035 * width
        self._load_text = axes.text(
            frame.right - 0.02 * width, line, "",
            ha="right", va="center", color=PURPLE, fontsize="small",
        )  # fmt: skip
        if frame.newton:
            # The arrow of a round force in the upper left corner.
            largest = frame.longest / frame.newton
            power = 10.0 ** np.floor(np.log10(largest))
            force = power * max(k for k in (1.0, 2.0, 5.0) if k * power <= largest)
            start = np.array([frame.left + 0.02 * width, line])
            arrow = self._arrow(start, np.array([force, 0.0]), frame.newton)
            polygon(axes, BLACK, "white", 0.5, 1.0).set_xy(arrow)
            end = start[0] + frame.newton * force + 0.02 * width
            axes.text(end, line, f"{force:g} N", va="center", fontsize="small")
        span = float(run.t[-1] - run.t[0])
        # Decimals that tell a thousandth of the run's time.
        self._digits = int(np.clip(np.ceil(3.0 - np.log10(span)), 1, 9)) if span > 0.0 else 6

    def _arrow(self, start: Floats, force: Floats, unit: float) -> Floats:
        """The outline (7, 2) of an arrow from `start`, mm; `unit` is the length of 1 N or 1 N s."""
        size = float(np.hypot(*force))
        if size == 0.0:
            return _NO_ARROW
        longest = self._frame.longest
        return outline.arrow(start, force / size, min(unit * size, longest), longest)

    def show(self, shown: Instant) -> None:
        """Shows an instant."""
        frame, q = self._frame, shown.q
        self._hands_place.set_matrix(_placed(shown.place).get_matrix())
        self._hand.show(q, shown.modes)
        for side, (artist, force) in enumerate(zip(self._contact, shown.contact, strict=True)):
            at = outline.contact_point(self._run.scene, q, side) * MM.per_si
            artist.set_xy(self._arrow(at, force, frame.newton))
        centre = q[:2] * MM.per_si
        self._external.set_xy(self._arrow(centre, shown.external[:2], frame.newton))
        self._impulse.set_xy(self._arrow(centre, shown.impulse[:2], frame.newton_second))
        self._load_text.set_text(_load_text(shown.external, shown.impulse))
        self._time.set_text(f"t = {shown.time:.{self._digits}f} s")
        self._status.set_text(", ".join(map(words, shown.status)))
        self._status.set_color(GREEN if shown.status == ("completed",) else RED)


def _load_text(load: Floats, push: Floats) -> str:
    """The loads of the object beside the tips' forces: disturbance, moments, size of an impulse."""
    texts = ["disturbance"] if load.any() else []
    texts += [f"{load[2]:+.3g} N m"] if load[2] else []
    size = np.hypot(*push[:2])
    texts += [f"impulse {size:.3g} N s"] if size else []
    texts += [f"{'' if size else 'impulse '}{push[2]:+.3g} N m s"] if push[2] else []
    # The minus sign of figures is longer than a hyphen.
    return ", ".join(texts).replace("-", "\u2212")


# Length of a frame's arrow for 1 N, mm, its longest, and the length that its head belongs to.
_MM_PER_N, _LONGEST_PUSH, _HEADED = 6.0, 40.0, 12.0
_INCHES, _DPI = (4.8, 4.8), 100
# Shown beyond the hand and the object at their start, mm.
_AROUND = 14.0


class Frames:
    """Frames of a scene that is stepped from outside, as pixels or in Matplotlib's `window`."""

    def __init__(self, scene: Scene, window: bool = False) -> None:
        require("matplotlib", extra="plot", purpose="figures")
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

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
        self._axes = self._figure.add_axes((0.14, 0.1, 0.83, 0.83))
        self._axes.set(xlabel="x [mm]", ylabel="y [mm]")
        left, right, bottom, top = outline.extent(scene, np.asarray(scene.start().q)[None])
        limits = left - _AROUND, right + _AROUND, bottom - 4.0, top + 2.0 * _AROUND
        self._hand = HandDrawing(self._axes, scene, limits)
        (self._target,) = self._axes.plot(
            [], [], marker="+", color="#1B7F3B", markersize=11, markeredgewidth=1.5,
            linestyle="none", zorder=5.0, label="wanted position",
        )  # fmt: skip
        self._push = polygon(self._axes, "#B3202A", "#B3202A", 0.5, 6.0)
        self._axes.legend(loc="upper right", fontsize=8)

    def draw(self, q: Floats, target: Floats, force: Floats, title: str) -> None:
        """Draws q (9,), the wanted pose (3,), and the force and moment on the object (3,)."""
        self._hand.show(q)
        self._target.set_data(*(target[:2, None] * MM.per_si))
        size = float(np.hypot(force[0], force[1]))
        self._push.set_visible(size > 0.0)
        if size > 0.0:
            length = min(_MM_PER_N * size, _LONGEST_PUSH)
            start = q[:2] * MM.per_si
            self._push.set_xy(outline.arrow(start, force[:2] / size, length, _HEADED))
        push = f"push {size:.1f} N, {force[2]:+.2f} N m" if force.any() else "no push"
        self._axes.set_title(f"{title}, {push}", fontsize=10)
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
