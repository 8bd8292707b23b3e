"""Time and size of a frame of a film: as a GIF, as a page, and by ffmpeg.

make bench-animation
"""

import tempfile
from pathlib import Path

import matplotlib

import softpinch as sp
from command import parser
from machine import describe, median_time
from softpinch import paper, plot
from softpinch.plot import film


def written(run: sp.Run, fps: float, repeats: int) -> None:
    """Milliseconds a frame of `animate` as a whole, and kilobytes a frame."""
    kinds = [".gif", ".html", ".mp4"]
    try:
        film._writer(".mp4", fps, matplotlib.rcParams)
    except FileNotFoundError:
        kinds.remove(".mp4")
        print("  left out: .mp4, there is no ffmpeg")
    frames = len(film._times(run, fps, 1.0))
    with tempfile.TemporaryDirectory() as folder:
        for kind in kinds:
            path = Path(folder) / f"film{kind}"
            spent = median_time(
                lambda path=path: plot.animate(run, path, fps=fps, progress=False),  # type: ignore[misc]
                repeats,
            )
            size = path.stat().st_size / frames / 1e3
            print(
                f"  {kind:5s}  {frames:6d} frames  {1e3 * spent / frames:10.2f} ms {size:8.1f} kB"
            )


def main() -> None:
    quick = parser(__doc__).parse_args().quick
    repeats = 1 if quick else 7
    run = sp.simulate(paper.manipulation(duration=0.1 if quick else 8.0), dt=1e-3)
    print(describe(libraries=["matplotlib", "pillow"]))
    print(f"scene      the paper's manipulation, {run.scene.duration:g} s, a row each ms\n")
    print("a film, 560 pixels wide: time and size a frame, with the computing of forces")
    written(run, 20.0 if quick else 25.0, min(repeats, 3))


if __name__ == "__main__":
    main()
