"""Films: frames, files, and runs of every kind; what does not work is said."""

import base64
import io
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import softpinch as sp
from films import operation, pushed_run, texts
from softpinch import plot
from softpinch.plot import film
from softpinch.run.run import restored

matplotlib = pytest.importorskip("matplotlib")
from PIL import Image  # noqa: E402


@pytest.fixture(scope="module")
def run() -> sp.Run:
    return operation()


@pytest.fixture(scope="module")
def slipping() -> sp.Run:
    return pushed_run()


def changed(run: sp.Run, **arrays: np.ndarray) -> sp.Run:
    """The run with other arrays in its result."""
    return restored(run.scene, run._options, {**run._result, **arrays})


def animated(run: sp.Run, path: Path, **options: Any) -> Path:
    return plot.animate(run, path, progress=False, dpi=30, **options)


def test_frames_are_at_equal_times_and_the_last_is_the_end(run: sp.Run) -> None:
    np.testing.assert_allclose(film._times(run, 2.0, 1.0), [0.0, 0.5, 1.0, 1.2])
    np.testing.assert_allclose(film._times(run, 5.0, 2.0), [0.0, 0.4, 0.8, 1.2])
    np.testing.assert_allclose(film._times(run, 10.0, 1.0), np.linspace(0.0, 1.2, 13))
    np.testing.assert_allclose(film._times(run, 1.0, 50.0), [0.0, 1.2])


def test_a_gif_lasts_as_long_as_the_run_by_the_speed(run: sp.Run, tmp_path: Path) -> None:
    path = animated(run, tmp_path / "a.gif", fps=25.0, speed=2.4)
    with Image.open(path) as image:
        durations = []
        for k in range(image.n_frames):
            image.seek(k)
            durations.append(image.info["duration"])
    # 1.2 s / 2.4 are 12.5 frames, and one more is at the end.
    assert sum(durations) == 14 * 40
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_a_page_has_its_frames_and_loads_nothing(slipping: sp.Run, tmp_path: Path) -> None:
    path = animated(slipping, tmp_path / "a<b.html", fps=50.0)
    text = path.read_text("utf-8")
    assert "http" not in text and "<link" not in text and "fa-" not in text
    found = re.findall(r'frames\[\d+\] = "data:image/png;base64,([^"]+)"', text)
    assert len(found) == 6
    frames = [np.array(Image.open(io.BytesIO(base64.b64decode(each))).convert("RGB"))
              for each in found]  # fmt: skip
    assert any(not np.array_equal(frames[0], each) for each in frames[1:])
    orange = np.array([0xE6, 0x9F, 0x00])
    counts = [(np.abs(each.astype(int) - orange).max(axis=2) < 12).sum() for each in frames]
    # Tips slip in the push, but not at the start; the legend has a little of the colour.
    assert max(counts) > 3 * counts[0]


def test_without_ffmpeg_one_line_names_the_package_to_install(
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


# Runs of every kind.


def test_one_row_is_one_frame(tmp_path: Path) -> None:
    run = sp.simulate(sp.Scene(duration=1e-4), 1e-4)
    run = changed(run, **{name: run._result[name][:1] for name in ("t", "q", "p", "integral")})
    assert len(run) == 1
    with Image.open(animated(run, tmp_path / "a.gif")) as image:
        assert image.n_frames == 1
    assert texts(plot.snapshot(run))[0] == "t = 0.000000 s"


def test_progress_is_reported_in_frames(run: sp.Run, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    plot.animate(run, tmp_path / "a.gif", fps=5.0, dpi=30,
                 progress=lambda done, total: seen.append((done, total)))  # fmt: skip
    assert seen == [(k, 7) for k in range(1, 8)]


# What is refused.


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"fps": 60.0}, ValueError, r"fps = 60: must be <= 50 in a \.gif"),
        ({"forces": 1}, TypeError, "forces = 1"),
        ({"speed": 1e-7}, ValueError, r"speed / fps = .* 100000"),
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
    assert not list(tmp_path.iterdir())


def test_a_snapshot_does_not_depend_on_the_recorded_quantities() -> None:
    scene = sp.Scene(duration=0.01)
    bare, full = sp.simulate(scene, record=("torque",), every=7), sp.simulate(scene)
    assert texts(plot.snapshot(bare, 0.0043)) == texts(plot.snapshot(full, 0.0043))
