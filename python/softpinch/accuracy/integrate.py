"""SciPy's ways through a scene, from break to break of its inputs: what `reference` is made of."""

from __future__ import annotations

import cmath
import warnings
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..scene.scene import Scene
from ..support import checks, extras
from ..support.arrays import Floats
from .driven import Driven, Inputs
from .null_space import PLAIN, STATES, jump, parameters, right_hand_side

# SciPy's methods, by whether they take a Jacobian.
METHODS = {
    **dict.fromkeys(("DOP853", "RK45", "RK23"), False),
    **dict.fromkeys(("Radau", "BDF", "LSODA"), True),
}
_ROWS = right_hand_side(np.sin, np.cos)
_COMPLEX = right_hand_side(cmath.sin, cmath.cos)
# A derivative by a step along the imaginary axis subtracts nothing, so this may be tiny.
_STEP = 1e-100
_FAILED = np.full(STATES, np.nan)
_METRES = np.array([1, 1, 0, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 0], dtype=bool)
# What is zero by symmetry has the round-off of its neighbours: a state's size is at least this
# share of the largest of its kind, a radian counted as a finger's length. For rates it is such that
# tolerances stay above round-off, which the implicit methods would take for stiffness; places only
# get a step's length of that.
_KINDS = ((slice(0, 7), 1e-3), (slice(7, 9), 1e-3), (slice(9, 14), 1.0))
# The absolute tolerance, as a share of the relative one times each state's size. What an implicit
# method solves has round-off of its own: asked for less, it would shorten its steps for ever.
_ABSOLUTE = dict.fromkeys(METHODS, 0.01) | {"LSODA": 0.1, "Radau": 1.0, "BDF": 1.0}
# Tolerances of a rough pass, the second where the motion runs away with the first.
_ROUGH = (1e-6, 1e-9)
# A motion runs away within a finite time, before which steps get ever shorter: where so many of
# them lead no further than this share of the run.
_CRAWL, _CRAWLED = 1000, 1e-10
# How many states of the rough pass are looked at for how stiff they are.
_PROBES = 64
# DOP853's stability region reaches to about -6, and a step takes 12 evaluations.
_EVALUATIONS_OF_STIFFNESS = 2.0


class Rough(NamedTuple):
    """What a rough pass has found.

    Attributes:
        sizes: Each state's along the run (14,), for absolute tolerances.
        explicit: About how many evaluations stability costs DOP853: 12 a step, each as long as the
            largest eigenvalue lets it be.
        evaluations: What it has cost itself.
    """

    sizes: Floats
    explicit: float
    evaluations: int


# Of its usual size no state is taken to be smaller than this share: what rests has the round-off of
# forces in its rates, and no tolerance below that can be met.
_AT_REST = 1e-2


class Problem:
    """A scene's numbers, inputs, start and wanted instants.

    Attributes:
        methods: `scipy.integrate`.
        scene: Whose they are.
        c: The parameters (35,).
        rates: (y, c, u) as tuples -> the rates of y.
        y: The states at the start (14,).
        inputs: What drives the run.
        t: The wanted instants (n,), s.
        wanted: The same, those at an edge of the inputs but for round-off on it.
        crawl: In so many steps as `_CRAWL` a motion that goes on gets further, s.
    """

    def __init__(
        self,
        scene: Scene,
        times: ArrayLike | None,
        tolerance: float,
        rates: Callable[..., Any] | None = None,
    ) -> None:
        """Reads and checks them, as `reference.solve` says."""
        checks.instance("scene", scene, Scene)
        if scene.fingers != "pid":
            raise ValueError(
                f'Scene.fingers = "{scene.fingers}": the reference has the equations of "pid" only'
            )
        if rates is not None:
            checks.function("rates", rates)
        self.methods: Any = extras.require("scipy.integrate", extra="study", purpose="references")
        self.scene = scene
        self.c, self.rates = parameters(scene), rates or PLAIN.rates
        self.y, begin = _start(scene, self.c, checks.positive("tolerance", tolerance))
        end = begin + scene.duration
        if not end > begin:
            raise ValueError(f"Scene.duration = {scene.duration}: ends no later than it starts")
        self.inputs, self.crawl = Inputs(scene, begin, end), _CRAWLED * (end - begin)
        instants = self.inputs.edges if times is None else times
        self.t = checks.array("times", instants, ("n",))
        self.wanted = [self.inputs.snapped(t) for t in self.t.tolist()]
        if min(self.wanted) < begin or max(self.wanted) > end:
            raise ValueError(f"times: must be from {begin} to {end} s, where the run is")

    def rough(self, most: int) -> Rough:
        """A first, cheap look at the run.

        Args:
            most: Evaluations allowed.
        """
        known = np.where(_METRES, max(self.c[0], self.c[15]), 1.0)
        evaluations = 0
        for rtol in _ROUGH:
            way, path = Way(self, "LSODA", rtol, known, most), []
            try:
                for at in way.walk(()):
                    path.append(at)
            except RuntimeError:
                # A loose tolerance may lose a grasp that holds.
                continue
            finally:
                evaluations += way.evaluations
            return self._read(path, known, evaluations)
        # It runs away, as whoever integrates will find out: the sizes before that tell nothing.
        return Rough(known, 0.0, evaluations)

    def _read(
        self, path: list[tuple[float, Floats, Driven]], known: Floats, evaluations: int
    ) -> Rough:
        sizes = np.abs([y for _, y, _ in path]).max(axis=0)
        for kind, least in _KINDS:
            # Where all of a kind are at rest, round-off is no size to go by.
            largest = max((sizes[kind] / known[kind]).max(), _AT_REST)
            sizes[kind] = np.maximum(sizes[kind], least * largest * known[kind])
        stiffness = 0.0
        for k, following in pairwise(np.unique(np.linspace(0, len(path) - 1, _PROBES).astype(int))):
            t, y, driven = path[k]
            jacobian = self.jacobian(y, driven(t))
            if np.isfinite(jacobian).all():
                fastest = np.abs(np.linalg.eigvals(jacobian)).max()
                stiffness += float(fastest * (path[following][0] - t))
        return Rough(sizes, _EVALUATIONS_OF_STIFFNESS * stiffness, evaluations)

    def jacobian(self, y: Floats, u: tuple[float, ...]) -> Floats:
        """The derivatives of the rates (14, 14), exact but for round-off."""
        columns = []
        for k in range(STATES):
            moved: list[complex] = y.tolist()
            moved[k] += 1j * _STEP
            columns.append([complex(rate).imag for rate in _COMPLEX.rates(moved, self.c, u)])
        return np.array(columns).T / _STEP

    def rows(self, y: Floats, u: Floats) -> dict[str, Floats]:
        """q (n, 9), p (n, 9), multipliers (n, 4) and integral (n, 2) of states and inputs."""
        states = list(y.T)
        d_n1, d_n2, *tips = _ROWS.followers(states, self.c)
        return {
            "q": np.stack([*states[:5], d_n1, d_n2, *states[5:7]], axis=1),
            "p": np.stack([*states[9:], *tips], axis=1),
            "multipliers": np.stack(_ROWS.multipliers(states, self.c, u.T), axis=1),
            "integral": y[:, 7:9].copy(),
        }


class Way:
    """One method's way through a problem.

    Attributes:
        name: Method and tolerance, in words.
        evaluations: Of the right-hand side so far, those of Jacobians included.
    """

    def __init__(
        self, problem: Problem, method: str, rtol: float, sizes: Floats, most: int
    ) -> None:
        """Nothing is computed yet.

        Args:
            problem: To be solved.
            method: Of `METHODS`.
            rtol: Relative tolerance.
            sizes: Of the states (14,), for the absolute one.
            most: Evaluations allowed.
        """
        self.name = f"SciPy {method} at rtol {rtol:.2g}"
        self.evaluations = 0
        self._problem, self._method, self._most = problem, method, most
        self._ends: deque[float] = deque(maxlen=_CRAWL)
        self._options: dict[str, Any] = {"rtol": rtol, "atol": _ABSOLUTE[method] * rtol * sizes}

    def walk(self, wanted: Sequence[float]) -> Iterator[tuple[float, Floats, Driven]]:
        """Time, states (14,) and inputs at the start, the ends of all steps and at wanted instants.

        At a break the states are those just before it and the inputs those just after; at the end
        both are from before. One-step methods end a step on each instant, LSODA's polynomial, which
        is what it integrates, is asked there.

        Args:
            wanted: Instants from start to end, increasing.

        Raises:
            RuntimeError: The method gave up, or took too many evaluations.
        """
        y, inputs = self._problem.y, self._problem.inputs
        for left, right in pairwise(inputs.edges):
            driven = inputs.between(left, right)
            yield left, y, driven
            if left in inputs.impulses:
                y = np.array(jump(y.tolist(), self._problem.c, inputs.impulses[left]))
            stops = wanted[bisect_right(wanted, left) : bisect_left(wanted, right)]
            for t, state in self._segment(left, right, y, driven, stops):
                y = state
                if t < right:
                    yield t, y, driven
        yield right, y, driven

    def _segment(
        self, left: float, right: float, y: Floats, driven: Driven, stops: Sequence[float]
    ) -> Iterator[tuple[float, Floats]]:
        """Times and states at the ends of steps and at `stops`, and last at `right`."""
        solver, before = self._solver(left, right, y, driven), self.evaluations
        for stop in [*stops, right]:
            if self._method != "LSODA":
                solver.t_bound, solver.status = stop - left, "running"
            while solver.status == "running" and solver.t < stop - left:
                proposed = getattr(solver, "h_abs", None)
                self._step(solver, left, before)
                if solver.t < stop - left:
                    yield left + solver.t, solver.y
            if self._method == "LSODA":
                yield stop, solver.y if stop == right else solver.dense_output()(stop - left)
                continue
            yield stop, solver.y
            if self._method != "BDF":
                # What cut the step short says nothing about the next one.
                solver.h_abs = max(solver.h_abs, proposed)
                # Radau's matrices are of the step's length.
                solver.LU_real = solver.LU_complex = None

    def _solver(self, left: float, right: float, y: Floats, driven: Driven) -> Any:
        """SciPy's, with a clock that starts at `left`: late in a run it resolves short steps."""
        rates, c = self._problem.rates, self._problem.c

        def slope(tau: float, y: Floats) -> Floats:
            try:
                return np.array(rates(tuple(y.tolist()), c, driven(left + tau)))
            except (ArithmeticError, ValueError):
                # A stage out of bounds: the step is refused, and a shorter one tried.
                return _FAILED

        options = dict(self._options)
        if METHODS[self._method]:
            options["jac"] = lambda tau, y: self._problem.jacobian(y, driven(left + tau))
        try:
            with _quiet():
                return getattr(self._problem.methods, self._method)(
                    slope, 0.0, y, right - left, **options
                )
        except (ArithmeticError, ValueError) as trouble:
            raise RuntimeError(f"reference: {self._method} gave up at t = {left} s") from trouble

    def _step(self, solver: Any, left: float, before: int) -> None:
        try:
            with _quiet():
                message = solver.step()
        except (ArithmeticError, ValueError) as trouble:
            message, solver.status = str(trouble), "failed"
        self.evaluations = before + int(solver.nfev) + STATES * int(solver.njev)
        t = left + solver.t
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            raise RuntimeError(
                f"reference: {self._method} gave up at t = {t} s, where the motion may run away: "
                f"{message}"
            )
        self._ends.append(t)
        crawled = len(self._ends) == _CRAWL and t - self._ends[0] < self._problem.crawl
        if crawled or self.evaluations > self._most:
            reason = "runs away" if crawled else f"takes more than {self._most} evaluations"
            raise RuntimeError(f"reference: the motion {reason} at t = {t} s, by {self._method}")


@contextmanager
def _quiet() -> Iterator[None]:
    """Without NumPy's warnings, LSODA's or LAPACK's: what they say shows in the result."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _start(scene: Scene, c: tuple[float, ...], tolerance: float) -> tuple[Floats, float]:
    """The fourteen states at the start, and its time.

    Raises:
        ValueError: It is off the constraints, which this form cannot be.
    """
    start = scene.start()
    y = np.array([*start.q[:5], *start.q[7:], *start.integral, *start.p[:5]])
    d_n1, d_n2, *tips = PLAIN.followers(y.tolist(), c)
    # What C^H and C^N are made of.
    length = float(np.abs([*start.q[:2], *c[:3], c[5], *c[15:18], c[20], c[30], c[33]]).sum())
    speed = float(np.abs(start.p[[0, 1, 5, 6, 7, 8]]).sum() + length * np.abs(start.p[2:5]).sum())
    gaps = (
        ("C^H = 0 (9)", "m", np.abs(start.q[5:7] - (d_n1, d_n2)).max(), tolerance * length),
        ("Phi p = 0 (25)", "m/s", np.abs(start.p[5:] - tips).max(), tolerance * speed),
    )
    for equation, unit, gap, allowed in gaps:
        if gap > allowed:
            raise ValueError(
                f"Scene.initial: {gap:.3e} {unit} off {equation}, more than {allowed:.3e} {unit}, "
                "and a reference is on the constraints; State.consistent gives a state that is"
            )
    return y, start.time
