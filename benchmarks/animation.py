"""What a frame of a film takes: drawing, and writing to a GIF, to a page and to a film by ffmpeg.

make bench-animation
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

import softpinch as sp
from command import parser
from machine import describe, median_time
from softpinch import paper, plot
from softpinch.plot import film, writers
from softpinch.plot.instants import Instant, instants
from softpinch.plot.picture import Frame

WIDTHS = (50, 100, 200)


def drawn(run: sp.Run, times: int, dpi: int, repeats: int) -> None:
    """Milliseconds to draw a frame: only what moves, and the whole figure again."""
    shown = instants(run, run.t[:: max(1, len(run) // times)][:times], True)
    made = film.Film(run, Frame.of(run, shown), set(), dpi)

    def each(work: Callable[[Instant], object]) -> float:
        return 1e3 * median_time(lambda: [work(one) for one in shown], repeats) / len(shown)

    def anew(one: Instant) -> None:
        made._picture.show(one)
        for artist in made._picture.moving:
            artist.set_animated(False)
        made._canvas.draw()

    moving = each(made.pixels)
    whole = each(anew)
    height, width = made.pixels(shown[0]).shape[:2]
    print(f"  {width:5d} x {height:<5d}  {moving:10.2f}  {whole:10.2f}")


def written(run: sp.Run, fps: float, repeats: int) -> None:
    """Milliseconds a frame of `animate` as a whole, and kilobytes a frame."""
    kinds = [".gif", ".html", ".mp4"]
    try:
        writers.ffmpeg()
    except FileNotFoundError:
        kinds.remove(".mp4")
        print("  left out: .mp4, there is no ffmpeg")
    frames = len(film._times(run, 1.0 / fps))
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
    run = sp.simulate(paper.manipulation(duration=0.2 if quick else 8.0), dt=1e-3)
    print(describe(libraries=["matplotlib", "pillow"]))
    print(f"scene      the paper's manipulation, {run.scene.duration:g} s, a row each ms\n")
    print(f"drawing a frame with forces, ms (median of {repeats}): what moves, everything")
    for dpi in WIDTHS[:1] if quick else WIDTHS:
        drawn(run, 3 if quick else 40, dpi, repeats)
    print("\na film, 560 pixels wide: time and size a frame, with the computing of forces")
    written(run, 20.0 if quick else 25.0, min(repeats, 3))


if __name__ == "__main__":
    main()
