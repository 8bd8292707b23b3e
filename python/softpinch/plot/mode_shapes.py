"""Figures of small motions about an equilibrium: the shapes of its modes, and its compliance."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..analysis import Equilibrium, linearize
from ..scene import Scene, State, outline
from ..scene.parts import lever, width
from ..support import Floats, checks
from .drawing import HandDrawing
from .style import DEG, GREY, LETTERS, LINES, MM, PAGE, panels, styled, tag

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The largest displacement of a drawn shape, as a share of a tip's radius: of the object, of a face
# that turns, of a tip that its finger moves, or inside a tip. Larger ones would tear a tip off.
_AWAY = 0.2
# A mode oscillates visibly if its damping ratio is below this.
_SWINGS = 0.99
_COLUMNS = 4
_HEIGHT = 1.9


class _Mode(NamedTuple):
    """One mode, or a conjugate pair: its eigenvalue, 1/s, its direction of q (9,), and its name."""

    rate: complex
    direction: Floats
    name: str


@styled()
def modes(found: Equilibrium, most: int = 8) -> Figure:
    """Draws the modes of an equilibrium: the hand, moved along each eigenvector.

    The grasp at rest is dashed. The neutral directions along the family of equilibria come first,
    both grips together and one against the other; then the modes from slow to fast. A mode that
    does not oscillate shrinks (or grows) by the factor e within its time constant. Displacements
    are enlarged: the largest is a fifth of a tip's radius in every panel, and the mode is linear,
    so its size has no meaning. Of an oscillation its instant of largest displacement is drawn. At
    most `most` shapes are drawn.
    """
    checks.instance("found", found, Equilibrium)
    most = checks.integer("most", most, 1)
    if found.state is None:
        raise ValueError(f"found: there are no modes, because {found.message}")
    shapes = _shapes(found)[:most]
    columns = min(_COLUMNS, len(shapes))
    rows = -(-len(shapes) // columns)
    figure, axes = panels(rows, columns, PAGE * columns / _COLUMNS, _HEIGHT * rows)
    moved = [_moved(found.scene, found.state.q, mode.direction) for mode in shapes]
    left, right, bottom, top = outline.extent(found.scene, np.array([found.state.q, *moved]))
    limits = left - 2.0, right + 2.0, bottom - 2.0, top + 2.0
    for panel, letter, mode, q in zip(axes.flat, LETTERS, shapes, moved, strict=False):
        HandDrawing(panel, found.scene, limits).show(q)
        _outline(panel, found.scene, found.state.q)
        tag(panel, letter, mode.name)
    for panel in axes.flat:
        panel.set_axis_off()
    return figure


def _shapes(found: Equilibrium) -> list[_Mode]:
    """The neutral directions, then the modes by the size of their eigenvalues."""
    outputs = ("pose", "fingers", "compressions", "shears")
    model = linearize(found.scene, found, inputs="force", outputs=outputs, reduced=True)
    rates, vectors = np.linalg.eig(model.A)
    # Both grips together, and one against the other: the second one turns the object.
    right, left = found.neutral
    shapes = [
        _Mode(0.0, right + left, "neutral: both grips"),
        _Mode(0.0, right - left, "neutral: grips opposite"),
    ]
    for k in np.argsort(np.abs(rates), kind="stable"):
        if rates[k].imag < 0.0:
            continue  # its conjugate is drawn
        direction = model.C @ vectors[:, k]
        if not direction.any():
            continue  # only integrals change, which nothing reads where K_I = 0
        # Turn the phase so that the largest component is real.
        largest = direction[np.argmax(np.abs(direction * _size(found.scene)))]
        rate = complex(rates[k])
        shapes.append(_Mode(rate, (direction / largest).real, _name(rate)))
    return shapes


def _size(scene: Scene) -> Floats:
    """The factors that turn changes of q into displacements in radii of a tip (9,)."""
    radius = max(tip.radius for tip in scene.hand.tips)
    arms = [lever(outline.finger_of(scene, side)) for side in (0, 1)]
    return np.array([1.0, 1.0, 0.5 * width(scene), *arms, *[1.0] * 4]) / radius


def _moved(scene: Scene, q: Floats, direction: Floats) -> Floats:
    """The coordinates that are drawn: moved along a direction, with the compressions of (9)."""
    step = _AWAY / np.abs(direction * _size(scene)).max()
    x, y, theta, right, left, _, _, *shear = q + step * direction
    return State.consistent(scene, x=x, y=y, rotation=theta, fingers=(right, left), shear=shear).q


def _outline(axes: Axes, scene: Scene, q: Floats) -> None:
    lines = [outline.object_outline(scene, q)]
    for side in (0, 1):
        finger = outline.finger_outline(scene, q, side)
        lines += [*finger.links, finger.tip]
    for line in lines:
        closed = np.concatenate([line, line[:1]]) * MM.per_si
        axes.plot(*closed.T, color=GREY, linewidth=0.6, linestyle=(0, (3, 2)), zorder=5.0)


def _name(rate: complex) -> str:
    """The eigenvalue in words."""
    size = abs(rate)
    if size == 0.0:
        return "neutral"
    damping = -rate.real / size
    if rate.imag != 0.0 and abs(damping) < _SWINGS:
        return f"{size / (2.0 * np.pi):.3g} Hz, damping {damping:.2f}"
    grows, fast = "grows, " if rate.real > 0.0 else "", abs(rate.real)
    factor, unit = (1.0, "s") if fast <= 1.0 else (1e3, "ms") if fast <= 1e3 else (1e6, "µs")
    return f"{grows}time constant {factor / fast:.3g} {unit}"


@styled()
def compliance(found: Equilibrium, frequency_hz: ArrayLike | None = None) -> Figure:
    """Draws the compliance of the object to a sinusoidal force, over its frequency.

    The curves are x over F_x, y over F_y and the rotation over the moment: magnitude and phase.
    The frequencies `frequency_hz` (n,), Hz, are by default 0.1 to 10 000 Hz. python-control draws
    the whole matrix: `control.bode_plot(model.to_control())` with
    `model = sp.linearize(scene, inputs="force")`.
    """
    checks.instance("found", found, Equilibrium)
    if found.state is None:
        raise ValueError(f"found: there is no compliance, because {found.message}")
    hertz = np.geomspace(0.1, 1e4, 400)
    if frequency_hz is not None:
        hertz = checks.array("frequency_hz", frequency_hz, ("n",))
        if (hertz <= 0.0).any():
            k = int(np.argmax(hertz <= 0.0))
            raise ValueError(f"frequency_hz[{k}] = {hertz[k]}: must be > 0")
    model = linearize(found.scene, found, inputs="force", outputs="pose", reduced=True)
    # The transfer function C (i omega - A)^-1 B at each frequency.
    poles = 2j * np.pi * hertz[:, None, None] * np.eye(len(model.A)) - model.A
    response = model.C @ np.linalg.solve(poles, model.B[None])
    from matplotlib.ticker import MultipleLocator

    figure, axes = panels(2, 2, PAGE, 3.6, sharex=True, height_ratios=[1.6, 1.0])
    plans = (
        ({0: "$x$ over $F_x$", 1: "$y$ over $F_y$"}, "mm/N", MM.per_si),
        ({2: r"$\theta$ over the moment"}, "deg/(N m)", DEG.per_si),
    )
    for column, (names, unit, scale) in enumerate(plans):
        upper, lower = axes[:, column]
        for k, name in names.items():
            own = response[:, k, k]
            upper.loglog(hertz, scale * np.abs(own), **LINES[k], label=name)
            lower.semilogx(hertz, DEG.per_si * np.unwrap(np.angle(own)), **LINES[k])
        upper.set_ylabel(f"compliance [{unit}]")
        upper.legend()
        lower.set_ylabel("phase [deg]")
        lower.yaxis.set_major_locator(MultipleLocator(90.0))
        lower.set_xlabel("frequency [Hz]")
        tag(upper, "ab"[column])
        tag(lower, "cd"[column])
    return figure
