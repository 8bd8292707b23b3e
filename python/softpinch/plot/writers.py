"""Files of films: GIF and pages with Pillow, which matplotlib needs itself, MP4 with ffmpeg."""

from __future__ import annotations

import base64
import html
import io
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from string import Template
from typing import IO, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..support.disk import PARTIAL, remove_partial
from ..support.extras import load
from ..support.files import writing
from ..support.interrupt import ignoring_system

# Pixels of a frame (height, width, 4).
Pixels: TypeAlias = NDArray[np.uint8]
Write: TypeAlias = Callable[[Pixels], None]

# Browsers show frames of a GIF that last less than 20 ms for 100 ms.
FASTEST = 50.0
# A frame of a .gif file lasts 65 535 units of 10 ms at most.
SLOWEST = 100.0 / 65535.0


@contextmanager
def writing_film(path: Path, kind: str, fps: float, sample: Sequence[Pixels]) -> Iterator[Write]:
    """Yields a function that adds a frame. The file appears once all frames are written.

    Args:
        path: The file.
        kind: One of `KINDS`.
        fps: Frames per second.
        sample: Some frames, from which the colours of GIF and HTML are chosen.

    Raises:
        OSError: The file cannot be written, or there is no ffmpeg.
    """
    open_film = KINDS[kind]
    partial = path.with_name(f".{path.name}{PARTIAL}")
    try:
        with writing(path):
            remove_partial(partial)
            # Fails now, before any frame is drawn, if the folder is missing.
            with partial.open("xb"):
                pass
            with open_film(partial, path, fps, sample) as write:
                yield write
            os.replace(partial, path)
    finally:
        with ignoring_system():
            partial.unlink(missing_ok=True)


class _Palette:
    """Converts frames to images of 256 colours: those that are most frequent in some frames."""

    def __init__(self, sample: Sequence[Pixels]) -> None:
        packed = [np.ascontiguousarray(each).view(np.uint32).ravel() for each in sample]
        colors, counts = np.unique(np.concatenate(packed), return_counts=True)
        most = np.argsort(-counts, kind="stable")[:256]
        chosen = np.ascontiguousarray(colors[most]).view(np.uint8).reshape(-1, 4)[:, :3]
        self._image: Any = load("PIL.Image")
        self._colors = chosen.tobytes()
        # The nearest of these colours, for every colour with 5 bits each of red, green and blue.
        levels = np.rint(255.0 / 31.0 * np.arange(32)).astype(np.int32)
        red, green, blue = (chosen[:, k].astype(np.int32) - levels[:, None] for k in range(3))
        nearest = np.empty((32, 32, 32), np.uint8)
        for k in range(32):
            apart = red[k] ** 2 + (green[:, None] ** 2 + blue[None] ** 2)
            nearest[k] = apart.argmin(axis=2)
        self._nearest = nearest.ravel()

    def image(self, frame: Pixels) -> Any:
        red, green, blue = (frame[:, :, k].astype(np.uint16) >> 3 for k in range(3))
        image = self._image.fromarray(self._nearest.take(red << 10 | green << 5 | blue))
        image.putpalette(self._colors)
        return image


@contextmanager
def _gif(partial: Path, path: Path, fps: float, sample: Sequence[Pixels]) -> Iterator[Write]:
    """A GIF that repeats for ever. Its frames are kept, compressed, until all are known."""
    palette, frames = _Palette(sample), list[Any]()
    yield lambda frame: frames.append(palette.image(frame))
    # The unit is 10 ms. The sum of the rounded durations is right, not each of them.
    ends = np.round(100.0 / fps * np.arange(len(frames) + 1)).astype(int)
    frames[0].save(
        partial,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=(10 * np.diff(ends)).tolist(),
        loop=0,
        optimize=False,
    )


_PAGE = Template("""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>$title</title>
<style>
figure { display: inline-block; margin: 0; font: 14px sans-serif; }
figure img { display: block; max-width: 100%; height: auto; }
figcaption { display: flex; gap: 0.5em; align-items: center; }
figcaption input { flex: 1; }
</style></head><body><figure>
<img alt="$title" width="$width" height="$height">
<figcaption><button type="button">Pause</button>
<input type="range" min="0" max="$last" value="0" aria-label="frame"><output>1 / $count</output>
</figcaption></figure>
<script>
(function () {
  const frames = [$frames];
  const box = document.currentScript.previousElementSibling;
  const image = box.querySelector("img"), button = box.querySelector("button");
  const range = box.querySelector("input"), place = box.querySelector("output");
  let start = performance.now(), playing = true;
  function show(k) {
    image.src = "data:image/png;base64," + frames[k];
    range.value = k;
    place.value = (k + 1) + " / " + frames.length;
  }
  function tick(now) {
    if (!playing) return;
    // The last frame stays for a second.
    const k = Math.floor((now - start) * $fps / 1000);
    if (k >= frames.length + $fps) start = now;
    show(Math.max(0, Math.min(k, frames.length - 1)));
    requestAnimationFrame(tick);
  }
  function play(on) {
    playing = on;
    button.textContent = on ? "Pause" : "Play";
    start = performance.now() - 1000 * (range.value % (frames.length - 1 || 1)) / $fps;
    if (on) requestAnimationFrame(tick);
  }
  button.onclick = () => play(!playing);
  range.oninput = () => { play(false); show(+range.value); };
  show(0);
  play(true);
})();
</script></body></html>
""")


@contextmanager
def _page(partial: Path, path: Path, fps: float, sample: Sequence[Pixels]) -> Iterator[Write]:
    """A page with a player and the frames as PNG; it loads nothing."""
    palette, count = _Palette(sample), 0
    with tempfile.TemporaryFile("w+", encoding="ascii") as frames:

        def write(frame: Pixels) -> None:
            nonlocal count
            data = io.BytesIO()
            palette.image(frame).save(data, format="PNG", compress_level=6)
            frames.write(",\n" if count else "")
            frames.write(json.dumps(base64.b64encode(data.getvalue()).decode("ascii")))
            count += 1

        yield write
        height, width = sample[0].shape[:2]
        text = _PAGE.substitute(
            title=html.escape(path.stem), width=width, height=height, fps=repr(float(fps)),
            count=count, last=count - 1, frames="\0",
        )  # fmt: skip
        before, after = text.split("\0")
        frames.seek(0)
        with partial.open("w", encoding="utf-8") as file:
            file.write(before)
            shutil.copyfileobj(frames, file)
            file.write(after)


def ffmpeg() -> str:
    """The path of the program ffmpeg: matplotlib's own setting, or that of imageio-ffmpeg.

    Raises:
        FileNotFoundError: There is none; the message says how to install it.
    """
    named: str = load("matplotlib").rcParams["animation.ffmpeg_path"]
    found = shutil.which(named)
    if found is not None:
        return found
    try:
        return str(load("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise FileNotFoundError(
            "an .mp4 file needs the program ffmpeg: install it (apt install ffmpeg, or pip install "
            "imageio-ffmpeg), or write a .gif or an .html file"
        ) from None


@contextmanager
def _mp4(partial: Path, path: Path, fps: float, sample: Sequence[Pixels]) -> Iterator[Write]:
    """A film in H.264, which browsers and slides show."""
    height, width = sample[0].shape[:2]
    command = [ffmpeg(), "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgba"]
    command += ["-s", f"{width}x{height}", "-framerate", repr(float(fps)), "-i", "pipe:"]
    # Other formats of pixels are unknown to many players.
    command += ["-vcodec", "h264", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    command += ["-f", "mp4", str(partial)]
    with tempfile.TemporaryFile() as said:
        work = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said
        )
        pipe: IO[bytes] = work.stdin  # type: ignore[assignment]
        try:
            try:
                yield lambda frame: _send(pipe, frame)
                pipe.close()
            except BrokenPipeError:
                pass  # ffmpeg has ended and says why
            code = work.wait()
        except BaseException:
            work.kill()
            work.wait()
            raise
        finally:
            with ignoring_system():
                pipe.close()
        if code != 0:
            said.seek(0)
            lines = said.read().decode("utf-8", "replace").strip().splitlines()
            raise OSError(f"{path}: ffmpeg failed: {lines[-1] if lines else f'code {code}'}")


def _send(pipe: IO[bytes], frame: Pixels) -> None:
    pipe.write(np.ascontiguousarray(frame).data)


# Ending of a file -> what writes it.
KINDS: dict[str, Callable[[Path, Path, float, Sequence[Pixels]], Any]] = {
    ".gif": _gif,
    ".html": _page,
    ".mp4": _mp4,
}
