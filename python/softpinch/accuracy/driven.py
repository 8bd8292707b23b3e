"""What drives a scene, read from what its schedule and disturbances compile to, for `reference`."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..scene.piecewise import Piecewise
from ..scene.scene import Scene
from ..support import checks
from ..support.arrays import Floats

# t -> (theta_1^d, theta_2^d, F_x, F_y, moment).
Driven: TypeAlias = Callable[[float], tuple[float, ...]]

# Instants closer than this many units in the last place are one.
_ULPS = 4
_TARGET, _LOAD = 0, 2
_MOST_SAMPLES = 10_000_000


class _Wave(NamedTuple):
    """amplitude * sin(omega (t - start) + phase) from start until end."""

    start: float
    end: float
    omega: float
    phase: float
    amplitude: tuple[float, float, float]


class Inputs:
    """The inputs of a run, smooth between two of its `edges`.

    Attributes:
        edges: Start, every instant between where an input jumps or bends, and end, s; those that
            are one instant but for round-off are taken once.
        impulses: (J_x, J_y, J_theta) by the edge at which they act, N s and N m s.
    """

    def __init__(self, scene: Scene, begin: float, end: float) -> None:
        """Reads the scene's inputs for a run from `begin` to `end`, s.

        Raises:
            ValueError: A noise has more samples than a run can have.
        """
        self._near = _ULPS * float(np.spacing(max(abs(begin), abs(end))))
        # Of the channels from which on, the polynomials, on the breaks.
        self._pieces: list[tuple[int, Piecewise]] = [(_TARGET, scene.schedule.compile())]
        self._waves: list[_Wave] = []
        kicks: list[Floats] = []
        for place, disturbance in enumerate(scene.disturbances):
            compiled = disturbance.compile()
            self._pieces += [(_LOAD, force) for force in compiled.forces]
            self._pieces += [
                (_LOAD, _held_noise(row, (seed, run), place, begin, end))
                for row, seed, run in compiled.noises
            ]
            for start, stop, omega, phase, *amplitude in (row.tolist() for row in compiled.sines):
                self._waves.append(_Wave(start, stop, omega, phase, (*amplitude,)))
            kicks += compiled.impulses
        breaks = [float(t) for _, (times, _) in self._pieces for t in times]
        breaks += [t for wave in self._waves for t in (wave.start, wave.end)]
        breaks += [float(kick[0]) for kick in kicks]
        self.edges = [begin]
        for t in sorted(breaks):
            if self.edges[-1] + self._near < t < end - self._near:
                self.edges.append(t)
        self.edges.append(end)
        self.impulses: dict[float, tuple[float, ...]] = {}
        for time, *impulse in (kick.tolist() for kick in kicks):
            edge = self.snapped(time)
            # One at the end, which is no start of anything, does not act.
            if edge in self.edges:
                before = self.impulses.get(edge, (0.0, 0.0, 0.0))
                self.impulses[edge] = tuple(a + b for a, b in zip(before, impulse, strict=True))

    def snapped(self, t: float) -> float:
        """The edge that differs from `t` by round-off only, or `t` if there is none."""
        k = bisect_left(self.edges, t)
        closest = min(self.edges[max(k - 1, 0) : k + 1], key=lambda edge: abs(edge - t))
        return closest if abs(closest - t) <= self._near else t

    def instants(self, times: ArrayLike | None) -> tuple[Floats, list[float]]:
        """The wanted instants (n,), s; and the same, with those within round-off of an edge on it.

        Args:
            times: The wanted instants (n,), s, in any order; None takes every edge.

        Raises:
            ValueError: An instant is outside the run.
            TypeError: The instants are not numbers.
        """
        found = checks.array("times", self.edges if times is None else times, ("n",))
        wanted = [self.snapped(t) for t in found.tolist()]
        begin, end = self.edges[0], self.edges[-1]
        if min(wanted) < begin or max(wanted) > end:
            raise ValueError(f"times: must be from {begin} to {end} s, the time of the run")
        return found, wanted

    def between(self, left: float, right: float) -> Driven:
        """The inputs as they hold between two edges.

        At `right` they are the limits from the left: a stage there belongs to the step that ends.
        """
        inside = left + (right - left) / 2
        constant = [0.0] * 5
        moving: list[tuple[int, float, list[float]]] = []
        for first, (breaks, coefficients) in self._pieces:
            k = int(np.searchsorted(breaks, inside, side="right"))
            for channel, row in enumerate(coefficients[k].tolist(), first):
                constant[channel] += row[0]
                # What stands before the first break is constant.
                if k > 0 and any(row[1:]):
                    moving.append((channel, float(breaks[k - 1]), row[:0:-1]))
        waves = [wave for wave in self._waves if wave.start <= inside < wave.end]
        held = tuple(constant)
        if not moving and not waves:
            return lambda _: held

        def driven(t: float) -> tuple[float, ...]:
            values = list(held)
            for channel, origin, falling in moving:
                since, value = t - origin, 0.0
                for coefficient in falling:
                    value = (value + coefficient) * since
                values[channel] += value
            for start, _, omega, phase, amplitude in waves:
                swing = math.sin(omega * (t - start) + phase)
                for channel, size in enumerate(amplitude, _LOAD):
                    values[channel] += size * swing
            return tuple(values)

        return driven


def _held_noise(
    row: Floats, key: tuple[int, int], place: int, begin: float, end: float
) -> Piecewise:
    """The samples of a noise that a run meets, as a piecewise constant force."""
    *std, rate, start, stop = row.tolist()
    last = min(stop, end)
    if last <= max(start, begin):
        return np.zeros(0), np.zeros((1, 3, 1))
    # One to either side may hold where product and quotient round.
    first = max(0, math.floor((max(start, begin) - start) * rate) - 1)
    count = math.ceil((last - start) * rate) + 1 - first
    if count > _MOST_SAMPLES:
        raise ValueError(
            f"Noise.rate_hz = {rate}: {count} samples are too many, the limit is {_MOST_SAMPLES}"
        )
    times = np.arange(first, first + count) / rate + start
    loads: Sequence[Floats] = [_core.noise((std[0], std[1], std[2]), key, place, first, count)]
    kept = times < stop
    times, loads = times[kept], [loads[0][kept]]
    if stop <= end:
        times, loads = np.append(times, stop), [*loads, np.zeros((1, 3))]
    return times, np.concatenate([np.zeros((1, 3)), *loads])[..., None]
