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
from softpinch.plot import drawing, film

matplotlib = pytest.importorskip("matplotlib")
from matplotlib.animation import AbstractMovieWriter  # noqa: E402
from PIL import Image  # noqa: E402


@pytest.fixture(scope="module")
def run() -> sp.Run:
    return operation()


@pytest.fixture(scope="module")
def slipping() -> sp.Run:
    return pushed_run()


def changed(run: sp.Run, **arrays: np.ndarray) -> sp.Run:
    """The run with other arrays in its result."""
    return sp.Run(run.scene, run._options, {**run._result, **arrays})


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


# A hand that moves.

MOVE = sp.HandMotion.minimum_jerk([0.0, 0.1], [[0.0, 0.0], [0.3, -0.1]], [0.2, 0.9])
PUSH = sp.Pulse(time=0.0, duration=0.2, force=(20.0, 0.0))
TAP = sp.Impulse(time=0.05, impulse=(0.0, 0.02))
CARRIED = sp.Scene(motion=MOVE, disturbances=[PUSH, TAP], duration=0.12)


def drawn(
    run: sp.Run, path: Path, monkeypatch: pytest.MonkeyPatch, **options: Any
) -> list[tuple[tuple[np.ndarray, ...], list[np.ndarray]]]:
    """Limits of the axes, and all outlines of hand, object and arrows in them, of each frame."""
    frames = []

    class Unrendered(AbstractMovieWriter):
        def setup(self, *given: Any) -> None:
            Path(given[1]).touch()

        def grab_frame(self, **given: Any) -> None:
            pass

        def finish(self) -> None:
            pass

    class Seen(film.Picture):
        def __init__(self, axes: Any, *rest: Any) -> None:
            super().__init__(axes, *rest)
            self.axes = axes

        def show(self, shown: Any) -> None:
            super().show(shown)
            limits = self.axes.get_xlim(), self.axes.get_ylim()
            into_data = self.axes.transData.inverted()
            frames.append(
                (
                    tuple(map(np.array, limits)),
                    [(each.get_data_transform() + into_data).transform(each.get_xy())
                     for each in self.axes.patches],
                )
            )  # fmt: skip

    with monkeypatch.context() as patch:
        patch.setattr(film, "Picture", Seen)
        patch.setattr(film, "_writer", lambda *given: Unrendered())
        animated(run, path, **options)
    return frames


def test_in_fixed_axes_hand_and_object_move_as_the_run_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = sp.simulate(CARRIED, 1e-3)
    rows = run.t.searchsorted(film._times(run, 25.0, 0.25) - 1e-9)
    frames = drawn(run, tmp_path / "a.gif", monkeypatch, speed=0.25, frame="world")
    right = sp.Scene().hand.right.root_offset
    roots = 1e3 * run.world(np.broadcast_to([[right, 0.0], [-right, 0.0]], (len(run), 2, 2)))
    centre = 1e3 * run.world(run.q[:, :2])
    assert len(frames) == len(rows) == 13
    for row, (_, outlines) in zip(rows, frames, strict=True):
        np.testing.assert_allclose(outlines[0][:2], roots[row], atol=1e-6)
        # The object turns by its own angle and the hand's tilt.
        corners = outlines[1][:4] - outlines[1][:4].mean(axis=0)
        angle = np.arctan2(*(corners[1] - corners[0])[::-1])
        assert angle == pytest.approx(run.q[row, 2] + run.hand.tilt[row], abs=1e-9)
        # The line along the object's upright axis begins at its centre of gravity.
        np.testing.assert_allclose(outlines[19][0], centre[row], atol=1e-6)


def test_the_axes_and_the_path_are_those_of_the_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures: list[Any] = []

    class Kept(film.Picture):
        def __init__(self, axes: Any, *rest: Any) -> None:
            pictures.append(axes)
            super().__init__(axes, *rest)

    monkeypatch.setattr(film, "Picture", Kept)
    run = sp.simulate(CARRIED, 1e-3)
    for frame in ("hand", "world"):
        animated(run, tmp_path / "a.gif", frame=frame)
    still, fixed = pictures
    assert (still.get_xlabel(), fixed.get_ylabel()) == ("$x$ [mm]", "$Y$ [mm]")
    (path,) = fixed.get_lines()
    places = 1e3 * MOVE.at(film._times(run, 25.0, 1.0)).position
    np.testing.assert_allclose(np.transpose(path.get_data()), places, atol=1e-9)
    assert not still.get_lines()


def test_disturbances_keep_their_direction_while_the_hand_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = sp.simulate(CARRIED, 1e-3)
    times = film._times(run, 25.0, 0.25)
    for frame in ("hand", "world"):
        tilts = MOVE.at(times).tilt if frame == "hand" else np.zeros(len(times))
        frames = drawn(run, tmp_path / "a.gif", monkeypatch, speed=0.25, frame=frame)
        for k, angle in ((22, 0.0), (23, 0.5 * np.pi)):
            arrows = [(arrow[k][3] - 0.5 * (arrow[k][0] + arrow[k][6]), tilt)
                      for (_, arrow), tilt in zip(frames, tilts, strict=True)
                      if np.isfinite(arrow[k]).all()]  # fmt: skip
            assert len(arrows) == {22: 13, 23: 1}[k]
            for (x, y), tilt in arrows:
                assert np.arctan2(y, x) == pytest.approx(angle - tilt, abs=1e-9)


@pytest.mark.parametrize("frame", ["hand", "world"])
@pytest.mark.parametrize(
    "motion",
    [
        sp.HandMotion.sine(0.03, 9.0, "x"),
        sp.HandMotion.sine(1.2, 8.0, "tilt"),
        sp.HandMotion.minimum_jerk([0.0, 0.2], [[0.0, 0.0], [-0.1, 2.0]], [0.0, -2.5]),
    ],
    ids=["shaken", "swung", "thrown"],
)
def test_the_axes_contain_the_whole_motion(
    motion: sp.HandMotion, frame: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = sp.simulate(sp.Scene(motion=motion, duration=0.2), 1e-3)
    frames = drawn(run, tmp_path / "a.gif", monkeypatch, frame=frame, speed=0.1, forces=False)
    seen = np.concatenate([points for _, outlines in frames for points in outlines])
    low, high = np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)
    for limits, _ in frames:
        (left, right), (bottom, top) = limits
        assert left < low[0] and high[0] < right and bottom < low[1] and high[1] < top
        # They are no wider than needed: a rectangle around the hand turns with it.
        assert (right - left) - (high[0] - low[0]) < 60.0
        assert (top - bottom) - (high[1] - low[1]) < 60.0 + 0.1 * (right - left)


def test_without_a_motion_both_frames_give_the_same_film(run: sp.Run, tmp_path: Path) -> None:
    paths = [animated(run, tmp_path / f"{frame}.gif", fps=5.0, frame=frame)
             for frame in ("hand", "world")]  # fmt: skip
    first, second = (path.read_bytes() for path in paths)
    assert first == second
    assert animated(run, tmp_path / "a.gif", fps=5.0).read_bytes() == first
    moved = sp.simulate(CARRIED, 1e-3)
    paths = [animated(moved, paths[k], frame=frame) for k, frame in enumerate(("hand", "world"))]
    assert paths[0].read_bytes() != paths[1].read_bytes()


def test_an_unknown_frame_is_refused_before_anything_is_computed(
    run: sp.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(film, "instants", lambda *args: pytest.fail("computed"))
    with pytest.raises(ValueError, match=r"frame = 'base': must be one of \"hand\", \"world\""):
        animated(run, tmp_path / "a.gif", frame="base")
    with pytest.raises(TypeError, match="frame = None: must be one of"):
        animated(run, tmp_path / "a.gif", frame=None)


@pytest.mark.parametrize("frame", ["hand", "world"])
def test_runs_with_a_shaken_base_are_drawn_with_their_forces(frame: Any, tmp_path: Path) -> None:
    shaking = (sp.Noise(acceleration_std=1.0, rate_hz=200), sp.Step(time=0.0, force=(0.5, 0.0)))
    scene = sp.Scene(motion=sp.HandMotion.constant(), duration=0.05, disturbances=shaking)
    run = sp.simulate(scene, dt=1e-3, method="rosenbrock")
    assert animated(run, tmp_path / "shaken.gif", frame=frame).stat().st_size
    plot.snapshot(run)
    seen = drawing.instants(run, np.array([0.01, 0.04]), True)
    # The acceleration of the base is no force on the object.
    np.testing.assert_array_equal([each.external for each in seen], [[0.5, 0.0, 0.0]] * 2)
