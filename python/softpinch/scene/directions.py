"""The directions in which a run is differentiated: one for each number at a path of a scene.

A direction consists of derivatives: of the parameters, of the inputs, of the start, and of the
times at which inputs jump. Derivatives of the inputs are computed with complex numbers: a schedule
or a disturbance compiles itself with a number that has a tiny imaginary part, whose share of the
results is the derivative, exact to round-off.
"""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.exceptions import ComplexWarning
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from .. import _core
from ..support import Floats, checks
from ..support.record import unchecked
from .disturbance import DISTURBANCES, Compiled, Disturbance
from .motion import MOTIONS
from .parts import branches
from .paths import locate
from .piecewise import Piecewise
from .scene import Scene, State
from .schedule import Schedule
from .template import SceneTemplate

# The imaginary part. Its square is zero beside any number, so that only first derivatives remain.
_TINY = 1e-200
# A jump of the hand's acceleration below this share of its largest coefficient is round-off.
_JUMP = 1e-9
# Fields of a `State` -> the columns of the start's derivative.
STARTS = {
    "q": slice(0, 9),
    "p": slice(9, 18),
    "integral": slice(18, 20),
    "relaxation": slice(20, 28),
}
# The inputs and parameters that a direction leaves alone, and why.
_REFUSED = {
    "duration": "rows at fixed times do not depend on the run's end",
    "initial.time": "it moves the clock of schedule and disturbances; vary their own times",
}

# The compiled schedule, as the force of a load, and then the disturbances.
_Compiled: TypeAlias = tuple[Compiled, ...]
# A number of a scene: a path, and the index in its value.
_Entry: TypeAlias = tuple[str, tuple[int, ...]]


def require_derivatives(scene: Scene) -> None:
    """Refuses a scene whose runs have no derivatives."""
    if scene.law == "sampled":
        why = "whose torques step from sample to sample"
        raise ValueError(f"sensitivities: control must not be a SampledController, {why}")


def listed(asked: object) -> list[str]:
    """Returns the paths of an argument `sensitivities`, which is one path or several."""
    found = [asked] if isinstance(asked, str) else asked
    if not isinstance(found, list | tuple) or not all(isinstance(path, str) for path in found):
        rule = 'must be paths such as "grasped.mass"'
        raise TypeError(f"sensitivities = {checks.shown(asked)}: {rule}")
    return list(found)


def shapes(
    scene: Scene, paths: Sequence[str], varied: Sequence[str] = ()
) -> dict[str, tuple[int, ...]]:
    """Checks paths, of which `varied` ones differ between runs; returns the shape at each."""
    if not paths:
        return {}
    for path in paths:
        if reason := _REFUSED.get(path):
            raise ValueError(f"sensitivities: {path!r}: there is no derivative by it: {reason}")
    with checks.reworded("sensitivities: ", drop="vary: "):
        template = _template(scene, paths, varied)
    for path in (path for path in paths if path not in varied):
        # A tip's own mass that is None is the object's, but an object without a height has no end.
        if locate(template.scene, path)[0] is None:
            numbers = template.scene.parameters()[template.slots[path]]
            if not np.isfinite(numbers).any():
                rule = "is None: give a number to differentiate by"
                raise ValueError(f"sensitivities: {path!r} {rule}")
        if path.endswith(".law.foot"):
            law = locate(template.scene, path.removesuffix(".foot"))[0]
            above = law.exponent > 2.0 and not any(p.endswith(".exponent") for p in varied)
            require_foot(path, law.foot or float(above))
    return {path: template.shapes[path] for path in paths}


def require_foot(path: str, foot: float | Floats) -> None:
    """Refuses a foot of zero: the derivative is infinite below n = 2, and the foot idle at 2."""
    if not np.all(foot):
        rule = "has a derivative only where n > 2 in all runs: give a foot above zero"
        raise ValueError(f"sensitivities: {path!r}: a foot of zero {rule}")


def count(shapes: Mapping[str, tuple[int, ...]]) -> int:
    """Returns the number of numbers at all paths together."""
    return sum(map(math.prod, shapes.values()))


def by_path(whole: Floats, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Floats]:
    """Divides the last axis, which has the directions of all paths: path -> (..., *shape)."""
    parts, first = {}, 0
    for path, shape in shapes.items():
        last = first + math.prod(shape)
        part = whole[..., first:last]
        parts[path] = part.reshape(*part.shape[:-1], *shape)
        first = last
    return parts


def _template(scene: Scene, paths: Sequence[str], varied: Sequence[str]) -> SceneTemplate:
    """Makes a template that tells which parameters each path sets, beside the varied ones."""
    # A path into the start needs it as a `State`.
    if not isinstance(scene.initial, State) and any(p.startswith("initial.") for p in paths):
        scene = replace(scene, initial=scene.start())
    return SceneTemplate(scene, dict.fromkeys([*paths, *varied]), 0)


def directions(
    scene: Scene,
    paths: Sequence[str],
    *,
    shared: Scene | None = None,
    varied: Sequence[str] = (),
    seeds: Floats | None = None,
) -> _core.Directions:
    """Makes the directions of all numbers at paths that `shapes` has checked.

    `shared` is the scene that all runs share, if it differs from the run's own in the paths
    `varied`. `seeds` are derivatives of the start (q, p, integral and relaxation), a column for
    each direction, in place of those that the paths give, for a run that goes on from another one.
    """
    if isinstance(scene.initial, State):
        start = "relaxed" if scene.initial.relaxation is None and branches(scene) else None
    else:
        derived = "contact" if scene._start_kind == "apart" else scene._start_kind
        start = "driven" if scene.fingers == "driven" else derived
    template = _template(scene if shared is None else shared, paths, varied)
    entries = _entries(template, paths)
    parameters = np.zeros((len(entries), len(_core.PARAMETERS)))
    initial = np.zeros((len(entries), 28))
    base = _compiled(scene)
    slopes = [_slopes(scene, base, path, index) for path, index in entries]
    motion, shifts = _motion_slopes(scene, entries)
    for k, (path, index) in enumerate(entries):
        parameters[k, template.slots.get(path, [])] = 1.0
        root, name, *inside = [*path.split("."), ""][:3]
        if root == "initial":
            places = (*map(int, filter(None, inside)), *index)
            initial[k, STARTS[name]][places] = 1.0
    if seeds is not None:
        initial[:, : len(seeds)] = seeds.T
    shifts += [row for k, slope in enumerate(slopes) for row in _shifts(scene, base, slope, k)]
    # Impulses follow in the order of their times.
    times = np.array([impulse[0] for load in base for impulse in load.impulses])
    moved = [[impulse[0] for load in slope for impulse in load.impulses] for slope in slopes]
    impulse_times = np.array(moved, dtype=np.float64).reshape(len(slopes), len(times))
    return _core.Directions(
        parameters,
        _inputs(scene, base, slopes, motion),
        initial=initial,
        shifts=np.array(shifts, dtype=np.float64).reshape(-1, 11),
        impulse_times=impulse_times[:, np.argsort(times, kind="stable")],
        start=start,
    )


def move_breakpoints(scene: Scene, paths: Sequence[str]) -> bool:
    """Returns whether a path moves an instant at which an input jumps or kinks."""
    base, entries = _compiled(scene), _entries(_template(scene, paths, ()), paths)
    for load in (load for entry in entries for load in _slopes(scene, base, *entry)):
        times = [breaks for breaks, _ in load.forces]
        times += [row[:2] for row in load.sines] + [row[:1] for row in load.impulses]
        if any(each.any() for each in times):
            return True
    return bool(_motion_slopes(scene, entries)[1])


def _entries(template: SceneTemplate, paths: Sequence[str]) -> list[_Entry]:
    return [(path, at) for path in paths for at in np.ndindex(*template.shapes[path])]


def _compiled(scene: Scene) -> _Compiled:
    return Compiled(forces=(scene.schedule.compile(),)), *scene.loads()


def _slopes(scene: Scene, base: _Compiled, path: str, index: tuple[int, ...]) -> _Compiled:
    """Returns the derivatives of the compiled inputs by one number."""
    found = [load.map(np.zeros_like) for load in base]
    root, *steps = path.split(".")
    if root == "schedule":
        found[0] = _derivative(scene.schedule, path, steps, index)
    elif root == "disturbances":
        place = int(steps[0])
        found[1 + place] = _derivative(scene.disturbances[place], path, steps[1:], index)
    return tuple(found)


def _seeded(record: Any, path: str, steps: list[str], index: tuple[int, ...]) -> Any:
    """Compiles a record with imaginary parts that have the derivatives by the number at a path."""
    name, *inside = steps
    place = (*map(int, inside), *index)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", ComplexWarning)
            compiled = _moved(record, name, place, 1j * _TINY).compile()
            if type(record) not in (Schedule, *DISTURBANCES.values(), *MOTIONS.values()):
                _require_analytic(record, name, place, compiled)
    except (AttributeError, TypeError, ComplexWarning) as error:
        owner = f"{type(record).__name__}.compile"
        rule = "must accept complex numbers in its fields, from which derivatives are computed"
        raise ValueError(f"sensitivities: {path!r}: {owner} {rule} ({error})") from None
    return compiled


def _derivative(
    record: Schedule | Disturbance, path: str, steps: list[str], index: tuple[int, ...]
) -> Compiled:
    """Returns the derivatives of a compiled schedule or disturbance, by the number at a path."""
    compiled = _seeded(record, path, steps, index)
    if isinstance(record, Schedule):
        compiled = Compiled(forces=(compiled,))
    derivative: Compiled = compiled.map(_imaginary_part)
    if any(row[3:6].any() for row, _, _ in derivative.noises):
        why = "by the rate or the times of a noise: its samples would change at random"
        raise ValueError(f"sensitivities: {path!r}: there is no derivative {why}")
    return derivative


def _moved(record: Any, name: str, place: tuple[int, ...], by: complex) -> Any:
    """Returns a copy of a record with a number added to one of its own, which is not checked."""
    value = np.array(getattr(record, name), dtype=type(by))
    value[place] += by
    return unchecked(record, {name: value if value.ndim else value[()]})


def _require_analytic(record: Any, name: str, place: tuple[int, ...], compiled: Compiled) -> None:
    """Refuses what loses the imaginary part, such as `abs`: it is compared with a difference."""
    size = 1e-5 * max(float(np.abs(np.asarray(getattr(record, name), float)[place])), 1e-5)
    up, down = (_moved(record, name, place, by).compile() for by in (size, -size))
    for found, after, before in zip(*map(_flat, (compiled, up, down)), strict=True):
        slope, difference = np.imag(found) / _TINY, (after - before) / (2.0 * size)
        if (np.abs(slope - difference) > 0.1 * np.abs(difference).max(initial=0.0)).any():
            raise TypeError("the result does not depend on the imaginary part as it should")


def _flat(compiled: Compiled) -> list[NDArray[Any]]:
    pieces = [array for force in compiled.forces for array in force]
    return [*pieces, *compiled.sines, *compiled.impulses, *(row for row, _, _ in compiled.noises)]


def _imaginary_part(array: NDArray[Any]) -> Floats:
    return np.asarray(np.imag(array) / _TINY)


def _held(of: Piecewise, slope: Piecewise) -> Piecewise:
    """Returns the derivatives of a piecewise polynomial at fixed times, on the breaks of `of`.

    A piece that starts later by db has, at a fixed time, the value that it had db before.
    """
    breaks, coefficients = of
    moved = np.zeros_like(coefficients)
    powers = np.arange(1.0, coefficients.shape[-1])
    rates = coefficients[1:, :, 1:] * powers
    moved[1:, :, :-1] = rates * slope[0][:, None, None]
    return breaks, slope[1] - moved


def _motion_slopes(
    scene: Scene, entries: Sequence[_Entry]
) -> tuple[tuple[Piecewise, Piecewise, Floats] | None, list[Floats]]:
    """Returns the derivatives of the hand's motion, as the motions of as many runs, and shifts."""
    shifts: list[Floats] = []
    if scene.motion is None:
        return None, shifts

    def one(array: Any) -> Any:
        return array[None]

    acceleration, tilt, sine = scene.motion.compile().map(one).core()
    base = [(breaks[0], rows[0]) for breaks, rows in (acceleration, tilt)]
    found: tuple[list[Floats], ...] = ([], [], [])
    for direction, (path, index) in enumerate(entries):
        root, *steps = path.split(".")
        slopes = [np.zeros_like(rows) for _, rows in base] + [np.zeros_like(sine[0])]
        if root == "motion":
            *moved, wave = _seeded(scene.motion, path, steps, index).map(one).core()
            slopes[2] = _imaginary_part(wave[0])
            for k, (own, pieces) in enumerate(zip(base, moved, strict=True)):
                slope = (_imaginary_part(pieces[0][0]), _imaginary_part(pieces[1][0]))
                least = _JUMP * float(np.abs(own[1]).max())
                for time, by, jump, _ in _jumps(own, slope) if k == 0 else ():
                    # A jump that is round-off is none.
                    if np.abs(jump).max() > least:
                        shifts.append(_shift(direction, time, 9, -by * jump))
                slopes[k] = _held(own, slope)[1]
        for rows, slope in zip(found, slopes, strict=True):
            rows.append(np.ascontiguousarray(slope))
    several = [np.tile(breaks, (len(entries), 1)) for breaks, _ in base]
    accelerations, tilts, sines = map(np.array, found)
    return ((several[0], accelerations), (several[1], tilts), sines), shifts


def _inputs(
    scene: Scene,
    base: _Compiled,
    slopes: Sequence[_Compiled],
    motion: tuple[Piecewise, Piecewise, Floats] | None,
) -> _core.Inputs:
    """Makes the derivatives of the inputs, as the inputs of as many runs."""

    def pieces(of: Piecewise, those: Iterator[Piecewise]) -> tuple[Floats, Floats]:
        found = np.array([_held(of, slope)[1] for slope in those])
        return np.tile(of[0], (len(found), 1)), np.ascontiguousarray(found)

    forces, sines, impulses, noises = [], [], [], []
    for place, (load, *own) in enumerate(zip(base, *slopes, strict=True)):
        for j, force in enumerate(load.forces):
            forces.append(pieces(force, (one.forces[j] for one in own)))
        for j, (start, end, omega, *_) in enumerate(load.sines):
            rows = np.array([one.sines[j] for one in own])
            # At a fixed time, a later start is an earlier phase.
            rows[:, 3] -= omega * rows[:, 0]
            rows[:, 0], rows[:, 1] = start, end
            sines.append(rows)
        for j, (time, *_) in enumerate(load.impulses):
            rows = np.array([one.impulses[j] for one in own])
            rows[:, 0] = time
            impulses.append(rows)
        for j, (row, seed, run) in enumerate(load.noises):
            rows = np.array([one.noises[j][0] for one in own])
            rows[:, 3:6] = row[3:6]
            rows = np.pad(rows, ((0, 0), (0, 8 - len(row))))
            noises.append((rows, seed, np.array([run], np.uint64), place - 1))
    return _core.Inputs(forces[0], forces[1:], sines, impulses, noises, scene.law, motion=motion)


def _shifts(scene: Scene, base: _Compiled, slope: _Compiled, direction: int) -> Iterator[Floats]:
    """Yields the shifts of one direction by schedule and disturbances."""
    for time, by, jump, bend in _jumps(base[0].forces[0], slope[0].forces[0]):
        # Driven fingers follow a schedule without jumps, but their accelerations jump.
        at, change = (4, bend) if scene.law == "driven" else (2, jump)
        yield _shift(direction, time, at, -by * change)
    for load, moved in zip(base[1:], slope[1:], strict=True):
        for force, own in zip(load.forces, moved.forces, strict=True):
            for time, by, jump, _ in _jumps(force, own):
                yield _shift(direction, time, 6, -by * jump)
        for sine, own_sine in zip(load.sines, moved.sines, strict=True):
            start, end, omega, phase = sine[:4]
            if own_sine[0]:
                jump = sine[4:] * np.sin(phase)
                yield _shift(direction, start, 6, -own_sine[0] * jump)
            if own_sine[1]:
                jump = -sine[4:] * np.sin(omega * (end - start) + phase)
                yield _shift(direction, end, 6, -own_sine[1] * jump)


def _shift(direction: int, time: float, at: int, by: Floats) -> Floats:
    """Returns a row of `Directions.shifts` with the numbers `by` from column `at` on."""
    row = np.zeros(11)
    row[:2], row[at : at + len(by)] = (direction, time), by
    return row


def _jumps(of: Piecewise, slope: Piecewise) -> Iterator[tuple[float, float, Floats, Floats]]:
    """Yields (time, its derivative, the jump, the jump of the second derivative) at each break."""
    breaks, coefficients = of
    for k in np.flatnonzero(slope[0]):
        tau = breaks[k] - breaks[k - 1] if k else 0.0
        pieces = ((coefficients[k], tau), (coefficients[k + 1], 0.0))
        # The values and the second derivatives of all channels on both sides of the break.
        values, bends = (
            [polynomial.polyval(at, polynomial.polyder(piece.T, order)) for piece, at in pieces]
            for order in (0, 2)
        )
        jump = np.subtract(values[1], values[0])
        yield float(breaks[k]), float(slope[0][k]), jump, np.subtract(bends[1], bends[0])
