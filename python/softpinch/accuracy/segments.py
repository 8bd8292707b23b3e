"""The inputs of a scene as functions of time, and integration between their breaks with SciPy.

`Inputs` reads the compiled schedule and disturbances independently of the core. `integrate` takes
any equations of motion: the reference those of null_space.py, the tests those that SymPy derives.
"""

import math
import warnings
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from .. import _core
from ..scene.motion import CompiledMotion
from ..scene.piecewise import Piecewise, derivative, held
from ..scene.scene import Scene
from ..support import Floats, checks, extras

# A function from t to (theta_1^d, theta_2^d, F_x, F_y, moment); of a hand that moves also the
# acceleration of its frame along fixed axes, its tilt, and the two derivatives of the tilt.
Driven: TypeAlias = Callable[[float], tuple[float, ...]]

# The methods of SciPy that compute references -> whether they take a Jacobian.
METHODS = dict.fromkeys(("DOP853", "RK45", "RK23"), False)
METHODS |= dict.fromkeys(("Radau", "BDF", "LSODA"), True)
# The absolute tolerance as a share of the relative one times each state's size. An implicit method
# solves equations down to their round-off; with less its steps would get ever shorter.
_ABSOLUTE = dict.fromkeys(METHODS, 0.01) | {"LSODA": 0.1, "Radau": 1.0, "BDF": 1.0}
# The interpolating polynomials of these methods are as accurate as their steps. Those of one-step
# methods are up to a hundred times less accurate; from the step before a wanted instant, such a
# method takes another step that ends there.
_MULTISTEP = ("BDF", "LSODA")
# Give up after this many evaluations with less progress than this share of the run.
_MAX_EVALUATIONS, _PROGRESS = 12_000, 1e-10

# Instants closer than this many units in the last place are equal.
_ULPS = 4
_TARGET, _LOAD, _FRAME, _TILT = 0, 2, 5, 7
_NONE = np.zeros(3)
_MOST_SAMPLES = 10_000_000


class Inputs:
    """The inputs of a run, smooth between two of its `edges`.

    These are the start, every instant at which an input jumps or bends, and the end, s; `impulses`
    has edge -> the impulse (J_x, J_y, J_theta) that acts there, N s and N m s.
    """

    def __init__(self, scene: Scene, begin: float, end: float) -> None:
        self._near = _ULPS * float(np.spacing(max(abs(begin), abs(end))))
        # The first channel of each piecewise polynomial, and its coefficients per interval.
        self._pieces: list[tuple[int, Piecewise]] = [(_TARGET, scene.schedule.compile())]
        # Rows of `Compiled.sines`, and the first channel of their amplitudes.
        self._waves: list[tuple[int, list[float]]] = []
        self._still = [0.0] * _LOAD + _NONE.tolist()
        kicks: list[Floats] = []
        for place, disturbance in enumerate(scene.disturbances):
            compiled = disturbance.compile()
            self._pieces += [(_LOAD, force) for force in compiled.forces]
            for row, seed, run in compiled.noises:
                self._pieces.append((_LOAD, _noise(row, (seed, run), place, begin, end)))
            self._waves += [(_LOAD, sine.tolist()) for sine in compiled.sines]
            kicks += compiled.impulses
        if scene.motion is not None:
            self._add_motion(scene.motion.compile(), begin)
        breaks = [float(t) for _, (times, _) in self._pieces for t in times]
        breaks += [t for _, wave in self._waves for t in wave[:2]]
        breaks += [float(kick[0]) for kick in kicks]
        self.edges = [begin]
        for t in sorted(breaks):
            if self.edges[-1] + self._near < t < end - self._near:
                self.edges.append(t)
        self.edges.append(end)
        self.impulses: dict[float, tuple[float, ...]] = {}
        for time, *impulse in (kick.tolist() for kick in kicks):
            edge = self.snapped(time)
            # An impulse at the end does not act.
            if edge in self.edges:
                if scene.motion is not None:
                    phi = float(scene.motion.at(edge).tilt)
                    x, y = impulse[:2]
                    impulse[0] = x * math.cos(phi) + y * math.sin(phi)
                    impulse[1] = y * math.cos(phi) - x * math.sin(phi)
                before = self.impulses.get(edge, (0.0, 0.0, 0.0))
                self.impulses[edge] = tuple(a + b for a, b in zip(before, impulse, strict=True))

    def _add_motion(self, motion: CompiledMotion, begin: float) -> None:
        """Adds the channels of a hand that moves: X'', Y'', phi and its two derivatives."""
        turning = derivative(motion.tilt)
        self._pieces += [(_FRAME, motion.acceleration), (_TILT, motion.tilt)]
        self._pieces += [(_TILT + 1, turning), (_TILT + 2, derivative(turning))]
        self._still += [0.0] * 5
        for omega, phase, x, y, tilt in motion.sines:
            wave = [begin, math.inf, omega]
            phase, square, ahead = phase + omega * begin, -(omega**2), 0.5 * math.pi
            self._waves += [(_FRAME, [*wave, phase, square * x, square * y, tilt])]
            self._waves += [(_TILT + 1, [*wave, phase + ahead, omega * tilt])]
            self._waves += [(_TILT + 2, [*wave, phase, square * tilt])]

    def snapped(self, t: float) -> float:
        """The edge that differs from `t` by round-off only, or `t` if there is none."""
        k = bisect_left(self.edges, t)
        closest = min(self.edges[max(k - 1, 0) : k + 1], key=lambda edge: abs(edge - t))
        return closest if abs(closest - t) <= self._near else t

    def instants(self, times: ArrayLike | None) -> tuple[Floats, list[float]]:
        """The wanted instants (n,), s, as given and snapped to edges; None takes every edge."""
        found = checks.array("times", self.edges if times is None else times, ("n",))
        wanted = [self.snapped(t) for t in found.tolist()]
        begin, end = self.edges[0], self.edges[-1]
        if min(wanted) < begin or max(wanted) > end:
            raise ValueError(f"times: must be from {begin} to {end} s, the time of the run")
        return found, wanted

    def between(self, left: float, right: float) -> Driven:
        """The inputs between two edges as a function of time; at `right` their left limits."""
        inside = left + (right - left) / 2
        constant = list(self._still)
        moving: list[tuple[int, float, list[float]]] = []
        for first, (breaks, coefficients) in self._pieces:
            k = int(np.searchsorted(breaks, inside, side="right"))
            for channel, row in enumerate(coefficients[k].tolist(), first):
                constant[channel] += row[0]
                # Before the first break an input is constant.
                if k > 0 and any(row[1:]):
                    moving.append((channel, float(breaks[k - 1]), row[:0:-1]))
        waves = [(first, w) for first, w in self._waves if w[0] <= inside < w[1]]
        still = tuple(constant)
        if not moving and not waves:
            return lambda _: still

        def driven(t: float) -> tuple[float, ...]:
            values = list(still)
            for channel, origin, falling in moving:
                since, value = t - origin, 0.0
                for coefficient in falling:
                    value = (value + coefficient) * since
                values[channel] += value
            for first, (start, _, omega, phase, *amplitude) in waves:
                swing = math.sin(omega * (t - start) + phase)
                for channel, size in enumerate(amplitude, first):
                    values[channel] += size * swing
            return tuple(values)

        return driven


def _noise(row: Floats, key: tuple[int, int], place: int, begin: float, end: float) -> Piecewise:
    """The samples of a noise during a run, as a piecewise constant force."""
    *std, rate, start, stop = row[:6].tolist()
    last = min(stop, end)
    if last <= max(start, begin):
        return held(np.zeros(0), np.zeros((0, 3)), _NONE)
    # One more sample on either side, because product and quotient are rounded.
    first = max(0, math.floor((max(start, begin) - start) * rate) - 1)
    count = math.ceil((last - start) * rate) + 1 - first
    if count > _MOST_SAMPLES:
        why = f"{count} samples are too many, the limit is {_MOST_SAMPLES}"
        raise ValueError(f"Noise.rate_hz = {rate}: {why}")
    times = np.arange(first, first + count) / rate + start
    kept = times < stop
    loads = _core.noise((std[0], std[1], std[2]), key, place, first, count)[kept]
    times = times[kept]
    if stop <= end:
        times, loads = np.append(times, stop), np.vstack([loads, _NONE])
    return held(times, loads, _NONE)


@dataclass(frozen=True)
class System:
    """Equations of motion for `integrate`."""

    # (y, u) as tuples -> the rates of the states y; u is the value of `Driven`.
    rates: Callable[[tuple[float, ...], tuple[float, ...]], Any]
    # (y, impulse) -> the states just after an ideal impulse (J_x, J_y, J_theta).
    jump: Callable[[Floats, tuple[float, ...]], Floats]
    # (y, u) -> the derivatives of the rates (n, n). None takes SciPy's finite differences, which
    # cost implicit methods accuracy.
    jacobian: Callable[[Floats, tuple[float, ...]], Floats] | None = None


class Motion(NamedTuple):
    """An integrated motion, with rows at the ends of all steps and at the wanted instants.

    At a break the states are those before an impulse, and the inputs those after the break.
    """

    t: Floats  # instants (rows,), s, increasing
    y: Floats  # states (rows, n)
    u: Floats  # inputs (rows, 5), or (rows, 10) of a hand that moves
    evaluations: int  # number of evaluations of the rates; a Jacobian counts as one for each state


def integrate(
    system: System,
    inputs: Inputs,
    start: Floats,
    wanted: Sequence[float],
    *,
    method: str,
    rtol: float,
    sizes: Floats,
    most: int,
) -> Motion:
    """Integrates from the states `start` (n,) at the first edge of the inputs, from break to break.

    Raises RuntimeError with the time if the motion diverges, or needs over `most` evaluations.
    """
    solver = _Solver(system, inputs, method, rtol, sizes, most)
    instants = np.unique(wanted)
    rows: list[tuple[float, Floats, tuple[float, ...]]] = []
    y = start
    for left, right in pairwise(inputs.edges):
        driven = inputs.between(left, right)
        after = system.jump(y, inputs.impulses[left]) if left in inputs.impulses else y
        stops = instants[(left < instants) & (instants < right)]
        t, states = solver.segment(left, right, after, driven, stops)
        times = t[:-1].tolist()
        rows += zip(times, [y, *states[1:-1]], map(driven, times), strict=True)
        y = states[-1]
    rows.append((right, y, driven(right)))
    t, y, u = map(np.array, zip(*rows, strict=True))
    return Motion(t, y, u, solver.count)


class _Solver:
    """One of SciPy's methods with its tolerances; `count` counts evaluations."""

    def __init__(
        self, system: System, inputs: Inputs, method: str, rtol: float, sizes: Floats, most: int
    ) -> None:
        integrate: Any = extras.require("scipy.integrate", extra="study", purpose="references")
        self._solve_ivp = integrate.solve_ivp
        self._system, self._method, self._most = system, method, most
        self._tolerances = {"rtol": rtol, "atol": _ABSOLUTE[method] * rtol * sizes}
        self._least = _PROGRESS * (inputs.edges[-1] - inputs.edges[0])
        # The instant of the last progress, and the number of evaluations then.
        self._reached, self._before = inputs.edges[0], 0
        self.count = 0

    def segment(
        self, left: float, right: float, y: Floats, driven: Driven, stops: Floats
    ) -> tuple[Floats, Floats]:
        """Times and states at the ends of all steps and at the stops, (k,) and (k, n)."""
        done = self._solve(left, 0.0, right - left, y, driven, dense_output=True)
        t, rows = left + done.t, done.y.T
        t[-1] = right
        stops = stops[~np.isin(stops, t)]
        if not len(stops):
            return t, rows
        if self._method in _MULTISTEP:
            between = done.sol(stops - left).T
        else:
            between = []
            for stop, k in zip(stops.tolist(), np.searchsorted(t, stops) - 1, strict=True):
                begin, end = done.t[k], stop - left
                y = rows[k]
                if end > begin:  # they may be equal by round-off
                    y = self._solve(left, begin, end, y, driven, first_step=end - begin).y[:, -1]
                between.append(y)
        t, order = np.unique(np.concatenate([t, stops]), return_index=True)
        return t, np.concatenate([rows, between])[order]

    def _solve(
        self, left: float, begin: float, end: float, y: Floats, driven: Driven, **options: Any
    ) -> Any:
        """SciPy's result. Its clock starts at `left`: late in a run it resolves shorter steps."""
        options |= self._tolerances
        rates, jacobian = self._system.rates, self._system.jacobian
        failed = np.full(len(y), np.nan)

        def slope(tau: float, y: Floats) -> Floats:
            self._counted(left + tau)
            try:
                return np.array(rates(tuple(y.tolist()), driven(left + tau)))
            except (ArithmeticError, ValueError):
                return failed  # The method refuses the step and tries a shorter one.

        def derivatives(tau: float, y: Floats) -> Floats:
            assert jacobian is not None
            self.count += len(y)
            return jacobian(y, driven(left + tau))

        if METHODS[self._method] and jacobian is not None:
            options["jac"] = derivatives
        try:
            with np.errstate(all="ignore"), warnings.catch_warnings():
                # The result shows what these warnings say.
                warnings.simplefilter("ignore")
                done = self._solve_ivp(slope, (begin, end), y, self._method, **options)
        except (ArithmeticError, ValueError) as trouble:
            raise self._gave_up(self._reached, str(trouble)) from trouble
        finite = np.isfinite(done.y).all(axis=0)
        if not (done.success and finite.all()):
            message = "the states are not finite" if done.success else done.message
            raise self._gave_up(left + done.t[np.flatnonzero(finite)[-1]], message)
        return done

    def _counted(self, t: float) -> None:
        """Counts an evaluation at `t`, and refuses one that would lead nowhere."""
        self.count += 1
        if abs(t - self._reached) > self._least:
            self._reached, self._before = t, self.count
        runs_away = self.count - self._before > _MAX_EVALUATIONS
        if runs_away or self.count > self._most:
            reason = "runs away" if runs_away else f"takes more than {self._most} evaluations"
            where = f"at t = {self._reached} s, by {self._method}"
            raise RuntimeError(f"reference: the motion {reason} {where}")

    def _gave_up(self, t: float, message: str) -> RuntimeError:
        why = "where the motion may run away"
        return RuntimeError(f"reference: {self._method} gave up at t = {t} s, {why}: {message}")
