"""The way through a run from break to break of its inputs, by `scipy.integrate.solve_ivp`.

A walker gets the equations of motion and the jump at an impulse. The reference walks with the
equations of null_space.py, the tests' oracle with those that SymPy derives.
"""

from __future__ import annotations

import warnings
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ..support import extras
from ..support.arrays import Floats
from ..support.interrupt import handlers_waiting
from .driven import Driven, Inputs

# The methods of SciPy that compute references -> whether they take a Jacobian.
METHODS = {
    **dict.fromkeys(("DOP853", "RK45", "RK23"), False),
    **dict.fromkeys(("Radau", "BDF", "LSODA"), True),
}
# The methods of several steps: they integrate a polynomial through them, which is as accurate as
# the steps themselves. The dense output of a one-step method is less accurate than its steps.
_MULTISTEP = ("BDF", "LSODA")
# The absolute tolerance, as a share of the relative one times each state's size. An implicit method
# solves equations up to their round-off: asked for less, it would shorten its steps for ever.
_ABSOLUTE = dict.fromkeys(METHODS, 0.01) | {"LSODA": 0.1, "Radau": 1.0, "BDF": 1.0}
# A motion runs away within a finite time, before which steps get ever shorter: so many evaluations
# lead no further than this share of the run.
_CRAWL, _CRAWLED = 12_000, 1e-10
# How much longer than a step the next one is tried: SciPy's steps have a safety of a tenth, and
# without any trial they would stay a little shorter than from stop to stop. No step gets ten times
# as long as the one before.
_LONGER, _LONGEST = 1.05, 10.0


@dataclass(frozen=True)
class System:
    """Equations of motion as a walker takes them.

    Attributes:
        rates: (y, u) -> the rates of the states y, all of them tuples; u is what `Driven` returns.
        jump: (y, impulse) -> the states just after an ideal impulse (J_x, J_y, J_theta).
        jacobian: (y, u) -> the derivatives of the rates (n, n); None leaves them to SciPy's finite
            differences, which costs an implicit method accuracy.
    """

    rates: Callable[[tuple[float, ...], tuple[float, ...]], Any]
    jump: Callable[[Floats, tuple[float, ...]], Floats]
    jacobian: Callable[[Floats, tuple[float, ...]], Floats] | None = None


class Walker:
    """One of SciPy's methods on its way through a run.

    Attributes:
        name: Method and tolerance, in words.
        evaluations: Of the rates so far; a Jacobian counts as one for each state.
    """

    def __init__(
        self,
        system: System,
        inputs: Inputs,
        start: Floats,
        *,
        method: str,
        rtol: float,
        sizes: Floats,
        most: int,
    ) -> None:
        """Computes nothing yet.

        Args:
            system: The equations of motion.
            inputs: What drives the run.
            start: The states at the first edge of the inputs (n,).
            method: Of `METHODS`.
            rtol: Relative tolerance.
            sizes: How large each state gets (n,), for the absolute tolerance.
            most: Evaluations allowed.

        Raises:
            ImportError: SciPy is not installed.
        """
        integrate: Any = extras.require("scipy.integrate", extra="study", purpose="references")
        self.name = f"SciPy {method} at rtol {rtol:.2g}"
        self.evaluations = 0
        self._solve_ivp = integrate.solve_ivp
        self._system, self._inputs, self._start = system, inputs, start
        self._method, self._most = method, most
        self._tolerances = {"rtol": rtol, "atol": _ABSOLUTE[method] * rtol * sizes}
        self._least = _CRAWLED * (inputs.edges[-1] - inputs.edges[0])
        # Where the evaluations have come to, but for so small a way, and how many there were then.
        self._mark, self._before = inputs.edges[0], 0

    def walk(self, wanted: Sequence[float]) -> Iterator[tuple[float, Floats, Driven]]:
        """Time, states (n,) and inputs at the start, the ends of all steps and at wanted instants.

        At a break the states are those just before it and the inputs those just after; at the end
        both are from before. One-step methods end a step on each wanted instant; multistep methods
        give the value of their polynomial there.

        Args:
            wanted: Instants from start to end, increasing.

        Raises:
            RuntimeError: The method gave up, the motion runs away, or it takes too many
                evaluations; the message has the time.
        """
        y, inputs = self._start, self._inputs
        for left, right in pairwise(inputs.edges):
            driven = inputs.between(left, right)
            yield left, y, driven
            if left in inputs.impulses:
                y = self._system.jump(y, inputs.impulses[left])
            stops = wanted[bisect_right(wanted, left) : bisect_left(wanted, right)]
            segment = self._by_polynomial if self._method in _MULTISTEP else self._by_steps
            for t, state in segment(left, right, y, driven, stops):
                y = state
                if t < right:
                    yield t, y, driven
        yield right, y, driven

    def _by_steps(
        self, left: float, right: float, y: Floats, driven: Driven, stops: Sequence[float]
    ) -> Iterator[tuple[float, Floats]]:
        """Times and states at the ends of steps, one of them at each stop, and last at `right`."""
        begin, step = left, 0.0
        for stop in [*stops, right]:
            # The length as SciPy forms it, which refuses a first step that is longer by round-off.
            first = min(step, (stop - left) - (begin - left)) or None
            times, states, _ = self._solve(left, begin, stop, y, driven, first_step=first)
            yield from zip(times[1:-1], states[1:-1], strict=True)
            begin, y = stop, states[-1]
            yield stop, y
            *_, before, last = step, *np.diff(times).tolist()
            # The last step was cut short at the stop, which says nothing about the next one; where
            # it was the only one, steps may be longer than from stop to stop.
            alone = len(times) == 2
            step = max(before, _LONGEST * last) if alone else _LONGER * max(before, last)

    def _by_polynomial(
        self, left: float, right: float, y: Floats, driven: Driven, stops: Sequence[float]
    ) -> Iterator[tuple[float, Floats]]:
        """Times and states at the ends of steps, between them at `stops`, and last at `right`."""
        times, states, polynomial = self._solve(left, left, right, y, driven, dense_output=True)
        rows = dict(zip(times[1:-1], states[1:-1], strict=True))
        rows.update((stop, polynomial(stop - left)) for stop in stops)
        yield from sorted(rows.items(), key=lambda row: row[0])
        yield right, states[-1]

    def _solve(
        self, left: float, begin: float, end: float, y: Floats, driven: Driven, **options: Any
    ) -> tuple[list[float], Floats, Any]:
        """Times and states (k, n) at the ends of all steps from `begin` to `end`, and dense output.

        The clock of SciPy, and of the dense output, starts at `left`: late in a run it resolves
        shorter steps.
        """
        rates, jacobian = self._system.rates, self._system.jacobian
        failed = np.full(len(y), np.nan)

        def slope(tau: float, y: Floats) -> Floats:
            deliver_signals()
            t = left + tau
            self._count(t)
            try:
                return np.array(rates(tuple(y.tolist()), driven(t)))
            except (ArithmeticError, ValueError):
                # A stage out of bounds: the step is refused, and a shorter one tried.
                return failed

        def derivatives(tau: float, y: Floats) -> Floats:
            assert jacobian is not None
            self.evaluations += len(y)
            return jacobian(y, driven(left + tau))

        if METHODS[self._method] and jacobian is not None:
            options["jac"] = derivatives
        span = begin - left, end - left
        try:
            # LSODA's compiled code may lose an exception that a handler raises there; the rates
            # raise it where it is passed on.
            with _quiet(), handlers_waiting() as deliver_signals:
                done = self._solve_ivp(slope, span, y, self._method, **self._tolerances, **options)
        except (ArithmeticError, ValueError) as trouble:
            raise self._gave_up(self._mark, str(trouble)) from trouble
        times, states = (left + done.t).tolist(), done.y.T.copy()
        finite = np.isfinite(states).all(axis=1)
        if not (done.success and finite.all()):
            message = "the states are not finite" if done.success else done.message
            raise self._gave_up(times[int(np.flatnonzero(finite)[-1])], message)
        return times, states, done.sol

    def _gave_up(self, t: float, message: str) -> RuntimeError:
        return RuntimeError(
            f"reference: {self._method} gave up at t = {t} s, where the motion may run away: "
            f"{message}"
        )

    def _count(self, t: float) -> None:
        """Counts an evaluation at `t`, and refuses one that would lead nowhere."""
        self.evaluations += 1
        if abs(t - self._mark) > self._least:
            self._mark, self._before = t, self.evaluations
        crawls = self.evaluations - self._before > _CRAWL
        if crawls or self.evaluations > self._most:
            reason = "runs away" if crawls else f"takes more than {self._most} evaluations"
            raise RuntimeError(
                f"reference: the motion {reason} at t = {self._mark} s, by {self._method}"
            )


@contextmanager
def _quiet() -> Iterator[None]:
    """Without NumPy's warnings, LSODA's or LAPACK's: the result shows what they say."""
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
