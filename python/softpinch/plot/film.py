"""Snapshots and films of a run, public as `plot.snapshot` and `plot.animate`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..run.contact import ContactMode
from ..run.run import Run
from ..support import checks
from ..support.arrays import Floats
from ..support.extras import require
from ..support.progress import Report, reporting
from . import contact_bands
from .instants import Instant, instants
from .picture import Frame, Picture
from .style import COLUMN, new, one_panel, styled
from .writers import FASTEST, KINDS, SLOWEST, writing_film

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Width of a film and of a snapshot, inches; the height of the axes is within these shares of it.
_WIDTH, _SHAPES = 5.6, (0.4, 1.6)
# Room for title and labels, and for the legend of modes, inches.
_LABELS = 0.75
# The most frames of a film: more than eleven hours at 25 frames per second.
_MOST_FRAMES = 1_000_000
# Frames that are computed together, so that long films need little memory.
_BLOCK = 1000


def snapshot(
    run: Run, t: float | None = None, ax: Axes | None = None, *, forces: bool = True
) -> Figure:
    """Hand and object at one instant, in mm, with the forces on the object.

    Tips are drawn deformed. Black arrows are the forces of the tips on the object, at the point
    where they act; a purple one is the force of the disturbances. A white one is the last impulse,
    shown from its instant on for a twentieth of the run's time, in a film at least in one frame;
    its length is on a scale of its own, on which the scene's largest impulse has the longest arrow.
    In unilateral contact the colour of a tip is its mode. Above are the time and the violations at
    this instant, at the run's end its status; below them the length of a force, the moment of the
    disturbances, and the size of the impulse. Forces of more than three times the 90 % quantile, as
    of impacts, have the longest arrow too. An object without `height`, whose faces have no end, is
    drawn 49 mm high.

    Between recorded rows the state is interpolated by the cubic Hermite polynomial of q and p. If
    the multipliers were not recorded, they are computed from the recorded states.

    Args:
        run: A run with "state" recorded.
        t: The instant, s; None takes the last one.
        ax: The axes to draw on; None makes a figure.
        forces: Whether to draw the forces.

    Raises:
        ValueError: `t` is outside the recorded instants, or the run has no row.
        TypeError: An argument is of the wrong kind.
        NotRecordedError: The state was not recorded.
        ImportError: matplotlib is not installed.
    """
    checks.instance("run", run, Run)
    forces = checks.boolean("forces", forces)
    _require_rows(run)
    time = float(run.t[-1]) if t is None else checks.finite("t", t)
    if not run.t[0] <= time <= run.t[-1]:
        raise ValueError(f"t = {time:g}: must be from {run.t[0]:g} to {run.t[-1]:g} s")
    (shown,) = instants(run, np.array([time]), forces)
    frame = Frame.of(run, [shown])
    present = set(shown.modes or ())
    with one_panel(ax, COLUMN, _height(COLUMN, frame, present)) as (figure, axes):
        Picture(axes, run, frame).show(shown)
        contact_bands.legend_of_panel(figure, ax, present)
        return figure


def animate(
    run: Run,
    path: str | Path,
    *,
    fps: float = 25.0,
    speed: float = 1.0,
    forces: bool = True,
    progress: bool | Report = True,
    dpi: int = 100,
) -> Path:
    """Writes the film of a run: each frame is a `snapshot`, all with the same axes and scale.

    The frames are at equal times of the run, speed / fps apart, and the last one is at its end. The
    status of a frame has all violations since the frame before.

    Args:
        run: A run with "state" recorded.
        path: The file, which ends in .gif, .html or .mp4. An .html file is a page with a player; it
            contains its frames and needs no other file. An .mp4 file needs the program ffmpeg, or
            the package imageio-ffmpeg.
        fps: Frames per second of film, > 0; in a .gif at most 50.
        speed: Simulated seconds per second of film, > 0.
        forces: Whether to draw the forces.
        progress: True draws a bar if rich is installed and stderr is a terminal; or a function of
            (frames done, frames in total).
        dpi: Dots per inch: the film is 5.6 inches wide.

    Returns:
        The path.

    Raises:
        ValueError: An argument breaks its rule, the run has no row, or the film would have more
            than 1 000 000 frames.
        TypeError: An argument is of the wrong kind.
        NotRecordedError: The state was not recorded.
        OSError: The file cannot be written, or there is no ffmpeg for an .mp4 file; then no file is
            left.
        ImportError: matplotlib is not installed.
    """
    require("matplotlib", extra="plot", purpose="figures")
    checks.instance("run", run, Run)
    path = checks.path("path", path)
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise ValueError(f"path = {str(path)!r}: must end in {checks.quoted(KINDS)}")
    fps, speed = checks.positive("fps", fps), checks.positive("speed", speed)
    if kind == ".gif" and fps > FASTEST:
        raise ValueError(f"fps = {fps:g}: must be <= {FASTEST:g} in a .gif, whose unit is 10 ms")
    forces = checks.boolean("forces", forces)
    dpi = checks.integer("dpi", dpi, 20, 1000)
    _require_rows(run)
    if kind == ".gif" and fps < SLOWEST:
        raise ValueError(f"fps = {fps:g}: must be >= {SLOWEST:g} in a .gif")
    if not math.isfinite(speed / fps):
        raise ValueError(f"fps = {fps:g}: too few for speed = {speed:g}")
    times = _times(run, speed / fps)
    some = instants(run, times[_evenly(len(times), 400)], forces)
    frame = Frame.of(run, some)
    present = {mode for each in some for mode in each.modes or ()}
    if run.scene.contact == "unilateral":
        present |= set(contact_bands.occurring({"": run}))
    with reporting(progress, "film", "frames") as report, styled():
        film = Film(run, frame, present, dpi)
        sample = [film.pixels(each) for each in _varied(some)]
        with writing_film(path, kind, fps, sample) as write:
            for start in range(0, len(times), _BLOCK):
                # The instant before a block is the begin of its first frame's violations.
                first = max(start - 1, 0)
                shown = instants(run, times[first : start + _BLOCK], forces)[start - first :]
                for k, each in enumerate(shown, start + 1):
                    write(film.pixels(each))
                    report(k, len(times))
    return path


class Film:
    """Draws frames of the same size one after another.

    What does not move is drawn once and kept as pixels. For each frame these are copied, and only
    the artists that move are drawn on them ("blitting").
    """

    def __init__(self, run: Run, frame: Frame, present: set[ContactMode], dpi: int) -> None:
        """Makes the figure, and draws what does not move.

        Args:
            run: The run.
            frame: Limits of the axes and scale of the forces.
            present: The modes of contacts that occur.
            dpi: Dots per inch.
        """
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        # Video formats need even numbers of pixels.
        size = (_WIDTH, _height(_WIDTH, frame, present))
        width, height = (2 * round(0.5 * dpi * each) / dpi for each in size)
        figure = new(width, height)
        figure.set_dpi(dpi)
        canvas: Any = FigureCanvasAgg(figure)
        self._canvas = canvas
        self._axes = figure.add_subplot()
        self._picture = Picture(self._axes, run, frame)
        if present:
            contact_bands.legend_below(figure, present)
        self._canvas.draw()
        # From now on the layout stays, else the picture would jump.
        figure.set_layout_engine("none")
        for artist in self._picture.moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(figure.bbox)

    def pixels(self, shown: Instant) -> np.ndarray:
        """Draws a frame and returns a copy of its pixels (height, width, 4), red to alpha."""
        self._picture.show(shown)
        self._canvas.restore_region(self._background)
        for artist in self._picture.moving:
            self._axes.draw_artist(artist)
        return np.array(self._canvas.buffer_rgba())


def _require_rows(run: Run) -> None:
    if not len(run):
        raise ValueError("run: must have a recorded row")


def _times(run: Run, apart: float) -> Floats:
    """Times of the frames: equal steps from the first row, and the last row."""
    first, last = float(run.t[0]), float(run.t[-1])
    count = (last - first) / apart
    if not count < _MOST_FRAMES:
        raise ValueError(
            f"speed / fps = {apart:g} s: gives {count:.3g} frames, must be at most {_MOST_FRAMES}"
        )
    times = first + apart * np.arange(int(count) + 1)
    # A frame within round-off of the end is the end.
    times = times[times < last - 1e-6 * apart]
    return np.append(times, last)


def _evenly(n: int, most: int) -> list[int]:
    """At most so many evenly spaced indices of n, with the first and the last."""
    return [int(k) for k in np.unique(np.linspace(0, n - 1, min(n, most)).astype(int))]


def _varied(some: Sequence[Instant]) -> list[Instant]:
    """Instants with all colours of a film: some evenly spaced, and the first of each look."""
    looks: dict[object, Instant] = {}
    for each in some:
        looks.setdefault((each.modes, bool(each.status), each.impulse is None), each)
    return [some[k] for k in _evenly(len(some), 6)] + list(looks.values())


def _height(width: float, frame: Frame, present: set[ContactMode]) -> float:
    """Height of a figure, inches, for its width."""
    shape = (frame.top - frame.bottom) / (frame.right - frame.left)
    height = (width - _LABELS) * min(max(shape, _SHAPES[0]), _SHAPES[1]) + _LABELS
    return height + (contact_bands.LEGEND if present else 0.0)
