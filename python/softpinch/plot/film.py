"""Hand and object of a run at some instants: `snapshots`, `snapshot`, and the film of `animate`."""

from __future__ import annotations

import importlib
import math
import os
import re
import shutil
import tempfile
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..run import ContactMode, Run, measures
from ..scene import outline
from ..support import Floats, Report, checks, reporting, require
from .drawing import Frame, HandDrawing, Modes, Picture, instants
from .style import COLUMN, GREY, LETTERS, MM, PAGE, new, one_panel, panels_or_given, styled, tag
from .timeline import LEGEND, legend_of_modes, occurring

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Width of a film and of a snapshot, inches; the height of the axes is within these shares of it.
_WIDTH, _SHAPES = 5.6, (0.4, 1.6)
# Room for title and labels, inches.
_LABELS = 0.75
# The most frames of a film: more than an hour at 25 frames per second.
_MOST_FRAMES = 100_000
_KINDS = (".gif", ".html", ".mp4")
# Browsers show frames of a GIF that last less than 20 ms for 100 ms.
_FASTEST = 50.0
# The signs on the buttons of Matplotlib's player, which takes them from a font on the web.
_SIGNS = {
    "minus": "&minus;",
    "fast-backward": "|&laquo;",
    "step-backward": "&lsaquo;",
    "play fa-flip-horizontal": "&#9664;&#65038;",
    "pause": "| |",
    "play": "&#9654;&#65038;",
    "step-forward": "&rsaquo;",
    "fast-forward": "&raquo;|",
    "plus": "+",
}


def snapshots(
    run: Run,
    times: Sequence[float],
    titles: Sequence[str] = (),
    columns: int = 3,
    ax: Axes | None = None,
) -> Figure:
    """Hand and object at some instants, in mm, the tips drawn deformed (the paper's Fig. 4).

    In unilateral contact the colour of a tip is its mode; at the instant of a change, as at a
    switch of the targets, it is the mode before.

    Args:
        run: A run with "state" recorded; each instant shows the closest recorded row.
        times: The instants, s.
        titles: A title for each instant; by default the time.
        columns: Number of panels side by side.
        ax: The axes to draw a single instant on.
    """
    checks.instance("run", run, Run)
    shown = checks.array("times", times, ("k",)).tolist()
    columns = min(checks.integer("columns", columns, 1), len(shown))
    titles = checks.several("titles", titles, "texts, one for each time")
    titles = titles or [f"$t$ = {time:g} s" for time in shown]
    for title in titles:
        checks.instance("titles", title, str, "texts, one for each time")
    if len(shown) != len(titles):
        raise ValueError(f"{len(titles)} titles for {len(shown)} times: must be one for each")
    nearest = [int(np.argmin(np.abs(run.t - time))) for time in shown]
    q = run.q[nearest]
    modes: list[Modes | None] = [None] * len(shown)
    if run.scene.contact == "unilateral":
        codes = measures.contact_modes(run)[nearest]
        modes = [(ContactMode(a), ContactMode(b)) for a, b in codes]
    present = {mode for pair in modes for mode in pair or ()}
    rows = -(-len(shown) // columns)
    left, right, bottom, top = outline.extent(run.scene, q)
    margin = 0.04 * (right - left)
    limits = left - margin, right + margin, bottom - margin, top + margin
    width = PAGE if columns > 1 else COLUMN
    # Panels have the aspect ratio of the drawing, but within limits, because a hand may have any
    # shape. The constants leave room for a line of title above each panel.
    shape = min(max((limits[3] - limits[2]) / (limits[1] - limits[0]), 0.2), 4.0)
    height = rows * (width / columns * 0.9 * shape + 0.22) + 0.4
    height += LEGEND if present else 0.0
    grid = panels_or_given(ax, rows, columns, width, height, sharex=True, sharey=True)
    with grid as (figure, axes):
        for each in axes.flat[len(shown) :]:
            each.set_visible(False)
        for k, each in enumerate(axes.flat[: len(shown)]):
            HandDrawing(each, run.scene, limits).show(q[k], modes[k])
            if len(shown) > 1:
                tag(each, LETTERS[k % len(LETTERS)], titles[k])
            else:
                each.set_title(titles[k], loc="left", pad=3.0)
        for each in axes[-1]:
            each.set_xlabel("$x$ [mm]")
        for each in axes[:, 0]:
            each.set_ylabel("$y$ [mm]")
        legend_of_modes(figure, present, ax)
        return figure


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

    Args:
        run: The run, which is computed once more, with a row at the instant.
        t: The instant, s; None takes the last one.
    """
    checks.instance("run", run, Run)
    forces = checks.boolean("forces", forces)
    time = float(run.t[-1]) if t is None else checks.finite("t", t)
    if not run.t[0] <= time <= run.t[-1]:
        raise ValueError(f"t = {time:g}: must be from {run.t[0]:g} to {run.t[-1]:g} s")
    (shown,) = instants(run, np.array([time]), forces)
    frame = Frame.of(run, [shown])
    present = set(shown.modes or ())
    with one_panel(ax, COLUMN, _height(COLUMN, frame, present)) as (figure, axes):
        Picture(axes, run, frame).show(shown)
        legend_of_modes(figure, present, ax)
        return figure


def animate(
    run: Run,
    path: str | Path,
    *,
    frame: Literal["hand", "world"] = "hand",
    fps: float = 25.0,
    speed: float = 1.0,
    forces: bool = True,
    progress: bool | Report = True,
    dpi: int = 100,
) -> Path:
    """Writes the film of a run: each frame is a `snapshot`, all with the same axes and scale.

    It returns the path. The frames are at equal times of the run, speed / fps apart, and the last
    one is at its end. The status of a frame has all violations since the frame before.

    Args:
        run: The run; its instants are computed once more.
        path: The file, which ends in .gif, .html or .mp4. An .html file is a page with a player; it
            contains its frames and needs no other file. An .mp4 file needs the program ffmpeg, or
            the package imageio-ffmpeg. The frames of a .gif and an .html film are in memory until
            the last one is drawn, about a megabyte each in a .gif.
        frame: "hand" has the axes of the hand, "world" fixed ones, in which the hand moves as
            `Run.hand` says; a grey line is the path of the middle of its roots.
        fps: Frames per second of film, > 0; in a .gif at most 50, and its frames last whole
            hundredths of a second.
        speed: Simulated seconds per second of film, > 0.
        progress: As for `monte_carlo`; it counts frames.
        dpi: Dots per inch: the film is 5.6 inches wide.

    Raises:
        ValueError: An argument breaks its rule, or the film would have more than 100 000 frames.
        OSError: The file cannot be written, or there is no ffmpeg for an .mp4 file.
    """
    matplotlib = require("matplotlib", extra="plot", purpose="figures")
    from matplotlib.animation import FuncAnimation

    checks.instance("run", run, Run)
    path = checks.path("path", path)
    if path.suffix.lower() not in _KINDS:
        raise ValueError(f"path = {str(path)!r}: must end in {checks.quoted(_KINDS)}")
    fixed = checks.choice("frame", frame, ("hand", "world")) == "world"
    fps, speed = checks.positive("fps", fps), checks.positive("speed", speed)
    if path.suffix.lower() == ".gif" and fps > _FASTEST:
        raise ValueError(f"fps = {fps:g}: must be <= {_FASTEST:g} in a .gif, whose unit is 10 ms")
    forces = checks.boolean("forces", forces)
    dpi = checks.integer("dpi", dpi, 20, 1000)
    shown = instants(run, _times(run, fps, speed), forces, fixed)
    scales = Frame.of(run, shown)
    present = occurring([run])
    with (
        reporting(progress, "film", "frames") as report,
        styled(),
        # A film that fails leaves the file before, and no other.
        tempfile.TemporaryDirectory(prefix=".film", dir=path.parent) as folder,
    ):
        figure = new(_WIDTH, _height(_WIDTH, scales, present))
        figure.set_dpi(dpi)
        axes = figure.add_subplot()
        picture = Picture(axes, run, scales)
        if fixed and run.scene.motion is not None:
            path_of_hand = MM.per_si * np.array([each.place[:2] for each in shown])
            axes.plot(*path_of_hand.T, color=GREY, linewidth=0.6, zorder=1.0)
            axes.set(xlabel="$X$ [mm]", ylabel="$Y$ [mm]")
        legend_of_modes(figure, present)
        figure.draw_without_rendering()
        # From now on the layout stays, else the picture would jump.
        figure.set_layout_engine("none")
        part = Path(folder) / f"film{path.suffix.lower()}"
        writer = _writer(part.suffix, fps, matplotlib.rcParams)
        film = FuncAnimation(figure, picture.show, shown, init_func=lambda: None)
        film.save(part, writer, dpi=dpi, progress_callback=lambda k, n: report(k + 1, n))
        if part.suffix == ".html":
            # Signs on the buttons of Matplotlib's player that need no font from the web.
            page = re.sub(r"<link\b[^>]*>", "", part.read_text("utf-8"), count=1)
            sign = re.compile(r'<i class="fa fa-([^"]+)"></i>')
            page = sign.sub(lambda found: _SIGNS.get(found[1], found[1]), page)
            part.write_text(page, "utf-8")
        os.replace(part, path)
    return path


def _writer(kind: str, fps: Any, settings: Any) -> Any:
    from matplotlib.animation import FFMpegWriter, HTMLWriter, PillowWriter

    if kind == ".gif":
        return PillowWriter(fps)
    if kind == ".html":
        return HTMLWriter(fps, embed_frames=True, embed_limit=math.inf)
    if shutil.which(settings["animation.ffmpeg_path"]) is None:
        try:
            ffmpeg = importlib.import_module("imageio_ffmpeg")
            settings["animation.ffmpeg_path"] = ffmpeg.get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            how = "install it (apt install ffmpeg, or pip install imageio-ffmpeg)"
            rule = f"needs the program ffmpeg: {how}, or write a .gif or an .html file"
            raise FileNotFoundError(f"an .mp4 file {rule}") from None
    return FFMpegWriter(fps, "h264", extra_args=["-movflags", "+faststart"])


def _times(run: Run, fps: float, speed: float) -> Floats:
    """Times of the frames: equal steps from the first row, and the last row."""
    first, last, apart = float(run.t[0]), float(run.t[-1]), speed / fps
    if not (count := (last - first) / apart) < _MOST_FRAMES:
        rule = f"gives {count:.3g} frames, must be at most {_MOST_FRAMES}"
        raise ValueError(f"speed / fps = {apart:g} s: {rule}")
    times = first + apart * np.arange(int(count) + 1)
    # A frame within round-off of the end is the end.
    times = times[times < last - 1e-6 * apart]
    return np.append(times, last)


def _height(width: float, frame: Frame, present: Collection[ContactMode]) -> float:
    """Height of a figure, inches, for its width."""
    shape = (frame.top - frame.bottom) / (frame.right - frame.left)
    height = (width - _LABELS) * min(max(shape, _SHAPES[0]), _SHAPES[1]) + _LABELS
    return height + (LEGEND if present else 0.0)
