"""Films: frames, files, and runs of every kind; what does not work is said."""

import base64
import io
import math
import re
import shutil
import stat
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from films import operation, pushed_run, texts
from softpinch import paper, plot
from softpinch.plot import film, writers
from softpinch.plot.contact_bands import COLORS
from softpinch.plot.instants import instants
from softpinch.plot.picture import Frame
from softpinch.run.run import restored

pytest.importorskip("matplotlib")
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image


@pytest.fixture(scope="module")
def run() -> sp.Run:
    return operation()


@pytest.fixture(scope="module")
def slipping() -> sp.Run:
    return pushed_run()


def changed(run: sp.Run, **arrays: np.ndarray) -> sp.Run:
    """The run with other arrays in its result."""
    return restored(run.scene, run._options, {**run._result, **arrays})


def test_a_frame_is_what_drawing_everything_anew_gives(slipping: sp.Run) -> None:
    times = np.array([0.0, 0.025, 0.1])
    shown = instants(slipping, times, True)
    frame = Frame.of(slipping, shown)
    present = set(COLORS)
    made = film.Film(slipping, frame, present, 60)
    frames = [made.pixels(each) for each in shown]
    assert not np.array_equal(frames[0], frames[1])
    for k in (2, 0, 1):
        # The order of the frames does not matter: nothing of a frame stays in the next.
        np.testing.assert_array_equal(made.pixels(shown[k]), frames[k])
    for artist in made._picture.moving:
        artist.set_animated(False)
    canvas = made._canvas
    assert isinstance(canvas, FigureCanvasAgg)
    for each, blitted in zip(shown, frames, strict=True):
        made._picture.show(each)
        canvas.draw()
        whole = np.array(canvas.buffer_rgba()).astype(int)
        assert (np.abs(whole - blitted).max(axis=2) > 8).mean() < 1e-4


def animated(run: sp.Run, path: Path, **options: Any) -> Path:
    return plot.animate(run, path, progress=False, dpi=30, **options)


def test_frames_are_at_equal_times_and_the_last_is_the_end(run: sp.Run) -> None:
    np.testing.assert_allclose(film._times(run, 0.5), [0.0, 0.5, 1.0, 1.2])
    np.testing.assert_allclose(film._times(run, 0.4), [0.0, 0.4, 0.8, 1.2])
    np.testing.assert_allclose(film._times(run, 0.1), np.linspace(0.0, 1.2, 13))
    np.testing.assert_allclose(film._times(run, 50.0), [0.0, 1.2])


@pytest.mark.parametrize("fps", [25.0, 30.0])
def test_a_gif_lasts_as_long_as_the_run_by_the_speed(
    run: sp.Run, tmp_path: Path, fps: float
) -> None:
    path = animated(run, tmp_path / "a.gif", fps=fps, speed=2.4)
    with Image.open(path) as image:
        durations = []
        for k in range(image.n_frames):
            image.seek(k)
            durations.append(image.info["duration"])
    # 1.2 s / 2.4, and one more frame for the end; equal frames are one that lasts longer.
    assert sum(durations) == pytest.approx(1e3 * (math.ceil(0.5 * fps) + 1) / fps, abs=10.0)
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_a_page_has_its_frames_and_loads_nothing(slipping: sp.Run, tmp_path: Path) -> None:
    path = animated(slipping, tmp_path / "a<b.html", fps=50.0)
    text = path.read_text("utf-8")
    assert "http" not in text and "src=" not in text and "<title>a&lt;b</title>" in text
    found = re.findall(r'"([A-Za-z0-9+/=]{200,})"', text)
    assert len(found) == 6
    frames = [np.array(Image.open(io.BytesIO(base64.b64decode(each))).convert("RGB"))
              for each in found]  # fmt: skip
    shown = instants(slipping, film._times(slipping, 0.02), True)
    made = film.Film(slipping, Frame.of(slipping, shown), set(), 30)
    # The colours are of 256: every pixel is near what was drawn, apart from smooth edges.
    assert {each.shape[1] for each in frames} == {made.pixels(shown[0]).shape[1]}
    assert any(not np.array_equal(frames[0], each) for each in frames[1:])
    orange = np.array([0xE6, 0x9F, 0x00])
    counts = [(np.abs(each.astype(int) - orange).max(axis=2) < 12).sum() for each in frames]
    # Tips slip in the push, but not at the start; the legend has a little of the colour.
    assert max(counts) > 3 * counts[0]


def fake_ffmpeg(folder: Path, body: str) -> Path:
    path = folder / "ffmpeg"
    path.write_text(f"#!{sys.executable}\nimport sys\n{body}\n", encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.mark.skipif(sys.platform == "win32", reason="a script is no program there")
def test_ffmpeg_has_every_pixel(
    slipping: sp.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import matplotlib

    program = fake_ffmpeg(
        tmp_path, "open(sys.argv[-1], 'wb').write(sys.stdin.buffer.read())\n"
        "open(__file__ + '.txt', 'w').write(' '.join(sys.argv))"
    )  # fmt: skip
    monkeypatch.setitem(matplotlib.rcParams, "animation.ffmpeg_path", str(program))
    (tmp_path / "out").mkdir()
    path = animated(slipping, tmp_path / "out" / "a.mp4", fps=100.0)
    said = (tmp_path / "ffmpeg.txt").read_text()
    found = re.search(r"-s (\d+)x(\d+) -framerate 100.0 ", said)
    assert found
    width, height = map(int, found.groups())
    assert width % 2 == height % 2 == 0
    pixels = np.frombuffer(path.read_bytes(), np.uint8).reshape(-1, height, width, 4)
    assert len(pixels) == 11
    assert not np.array_equal(pixels[0], pixels[3])
    assert [each.name for each in path.parent.iterdir()] == ["a.mp4"]


@pytest.mark.skipif(sys.platform == "win32", reason="a script is no program there")
def test_an_ffmpeg_that_fails_says_why_and_leaves_the_file_before(
    slipping: sp.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import matplotlib

    program = fake_ffmpeg(tmp_path, "sys.exit('no such codec')")
    monkeypatch.setitem(matplotlib.rcParams, "animation.ffmpeg_path", str(program))
    (tmp_path / "out").mkdir()
    path = tmp_path / "out" / "a.mp4"
    path.write_bytes(b"before")
    with pytest.raises(OSError, match=r"a\.mp4: ffmpeg failed: no such codec$"):
        animated(slipping, path)
    assert path.read_bytes() == b"before"
    assert [each.name for each in path.parent.iterdir()] == ["a.mp4"]


def test_without_ffmpeg_one_line_says_what_to_install(
    slipping: sp.Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    without: Callable[[str], None],
) -> None:
    without("imageio_ffmpeg")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(FileNotFoundError, match="pip install imageio-ffmpeg") as raised:
        animated(slipping, tmp_path / "a.mp4")
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.iterdir())


def test_a_real_ffmpeg_writes_a_film(slipping: sp.Run, tmp_path: Path) -> None:
    try:
        writers.ffmpeg()
    except FileNotFoundError:
        pytest.skip("there is no ffmpeg")
    path = animated(slipping, tmp_path / "a.mp4")
    assert path.read_bytes()[4:8] == b"ftyp"


# Runs of every kind.


def test_one_row_is_one_frame(tmp_path: Path) -> None:
    run = sp.simulate(sp.Scene(duration=1e-4), 1e-4)
    run = changed(run, **{name: run._result[name][:1] for name in ("t", "q", "p", "integral")})
    assert len(run) == 1
    with Image.open(animated(run, tmp_path / "a.gif")) as image:
        assert image.n_frames == 1
    assert texts(plot.snapshot(run))[0] == "t = 0.000000 s"


def test_a_run_that_ends_early_ends_with_its_status(tmp_path: Path) -> None:
    lost = sp.simulate(paper.disturbance("i", hand=sp.Hand(tip=sp.Fingertip(tilt_coupling=-1.0))))
    assert not lost.success
    animated(lost, tmp_path / "a.gif", fps=5.0)
    assert texts(plot.snapshot(lost))[1] == lost.status


def test_rows_that_are_not_finite_are_said(run: sp.Run, tmp_path: Path) -> None:
    q = run.q.copy()
    q[700:] = np.nan
    broken = changed(run, q=q)
    assert "the state is not finite" in texts(plot.snapshot(broken, 1.0))
    assert "the state is not finite" not in texts(plot.snapshot(broken, 0.5))
    animated(broken, tmp_path / "a.gif", fps=5.0)
    everywhere = changed(run, q=np.full_like(run.q, np.nan))
    animated(everywhere, tmp_path / "b.gif", fps=5.0)
    # Forces that are not finite, of a state that is.
    some = changed(run, multipliers=np.full_like(run.multipliers, np.nan))
    assert texts(plot.snapshot(some, 0.5))[0] == "t = 0.500 s, forces unknown"


class Counted:
    """An array that counts the rows which are read."""

    def __init__(self, array: np.ndarray) -> None:
        self.array, self.rows = array, 0

    def __getitem__(self, rows: Any) -> np.ndarray:
        found = self.array[rows]
        self.rows += len(np.atleast_2d(found))
        return found


def test_only_rows_next_to_frames_are_read(
    run: sp.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = {name: Counted(getattr(run, name)) for name in ("q", "p", "multipliers")}
    for name, counted in read.items():
        monkeypatch.setattr(sp.Run, name, property(lambda _, counted=counted: counted))
    animated(run, tmp_path / "a.gif", fps=5.0)
    # Seven frames: their limits, the frames, each with a row before and after.
    assert all(0 < counted.rows <= 4 * 7 for counted in read.values())


def test_progress_is_reported_in_frames(run: sp.Run, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    plot.animate(run, tmp_path / "a.gif", fps=5.0, dpi=30,
                 progress=lambda done, total: seen.append((done, total)))  # fmt: skip
    assert seen == [(k, 7) for k in range(1, 8)]


# What is refused.


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"fps": 0.0}, ValueError, "fps = 0"),
        ({"speed": -1.0}, ValueError, "speed = -1"),
        ({"fps": 60.0}, ValueError, r"fps = 60: must be <= 50 in a \.gif"),
        ({"dpi": 5}, ValueError, "dpi = 5"),
        ({"forces": 1}, TypeError, "forces = 1"),
        ({"speed": 1e-7}, ValueError, r"speed / fps = .* 1000000"),
    ],
)
def test_a_wrong_option_is_named(
    run: sp.Run, tmp_path: Path, options: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        plot.animate(run, tmp_path / "a.gif", **{"progress": False, **options})
    assert not list(tmp_path.iterdir())


def test_wrong_files_runs_and_times(run: sp.Run, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r'must end in "\.gif", "\.html", "\.mp4"'):
        plot.animate(run, tmp_path / "a.avi")
    with pytest.raises(OSError, match="nowhere"):
        plot.animate(run, tmp_path / "nowhere" / "a.gif")
    with pytest.raises(ValueError, match=r"t = 1\.3: must be from 0 to 1\.2 s"):
        plot.snapshot(run, 1.3)
    with pytest.raises(TypeError, match="ax = 'x': must be axes of matplotlib"):
        plot.snapshot(run, 1.0, "x")  # type: ignore[arg-type]
    bare = sp.simulate(sp.Scene(duration=0.01), record=("multipliers",))
    with pytest.raises(sp.NotRecordedError, match="q was not recorded"):
        plot.animate(bare, tmp_path / "a.gif")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("how", [{"fps": 1e-3}, {"fps": 1e-300, "speed": 1e300}], ids=str)
@pytest.mark.parametrize("kind", ["gif", "html"])
def test_too_few_frames_are_refused_by_name(
    run: sp.Run, tmp_path: Path, how: dict[str, float], kind: str
) -> None:
    if kind == "html" and how["fps"] == 1e-3:
        animated(run, tmp_path / "a.html", **how)
        return
    with pytest.raises(ValueError, match=r"^fps = "):
        animated(run, tmp_path / f"a.{kind}", **how)
