"""The least-squares problem of a fit: weighted residuals of all experiments, and their Jacobian."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..run.options import Options
from ..scene.template import SceneTemplate
from ..support.arrays import Floats
from ..support.errors import StabilityWarning, SuspiciousValueWarning
from ..support.extras import require
from .experiment import Experiment, FailedRun, Motion
from .parameters import Parameter, slopes, values

LOSSES = ("linear", "soft_l1")
# A search ends at these relative changes of the cost and of u. That of the cost leaves an error of
# a ten-thousandth of the standard error; that of u is for data without noise, whose cost tends to
# zero.
_OF_COST, _OF_STEP = 1e-8, 1e-10
# The largest number of simulations in a search from one start, without those for the Jacobian.
MOST_EVALUATIONS = 100


class Minimum(NamedTuple):
    """The end of a search.

    Attributes:
        u: The coordinates of the parameters (p,).
        cost: Half the sum of the loss.
        converged: Whether the search ended because nothing changed any more.
    """

    u: Floats
    cost: float
    converged: bool


class Problem:
    """Residuals (model minus data, over noise) as functions of the coordinates u (p,).

    Attributes:
        experiments: The experiments, with the noise that weights them.
        parameters: The parameters.
        evaluations: The number of calls that simulated all experiments.
    """

    def __init__(
        self,
        experiments: Sequence[Experiment],
        parameters: Sequence[Parameter],
        options: Options,
        loss: str,
        report: Callable[[], object] = lambda: None,
    ) -> None:
        """Takes checked arguments; `report` is called after each evaluation."""
        self.experiments = tuple(experiments)
        self.parameters = tuple(parameters)
        self.evaluations = 0
        self._options = options
        self._loss = loss
        self._report = report
        paths = [each.path for each in parameters]
        self._templates = [SceneTemplate(each.scene, paths, 0) for each in experiments]

    @property
    def bounds(self) -> Floats:
        """The bounds of u (2, p)."""
        return np.array([each.bounds for each in self.parameters]).T

    def weighted(self, noise: Sequence[Floats]) -> Problem:
        """Returns this problem with other noise, (c,) for each experiment."""
        experiments = [
            replace(each, noise=own) for each, own in zip(self.experiments, noise, strict=True)
        ]
        other = Problem(experiments, self.parameters, self._options, self._loss, self._report)
        other.evaluations = self.evaluations
        return other

    def motions(self, u: Floats, derivatives: bool = False) -> list[Motion]:
        """Simulates all experiments; derivatives are by u.

        Raises:
            FailedRun: A run failed.
        """
        put = values(self.parameters, u)
        found: list[Motion] = []
        for each, template in zip(self.experiments, self._templates, strict=True):
            motion = each.simulated(template, put, self._options, derivatives)
            if motion.slope is not None:
                motion = motion._replace(slope=motion.slope * slopes(self.parameters, u))
            found.append(motion)
        self.evaluations += 1
        self._report()
        return found

    def residuals(self, motions: Sequence[Motion]) -> Floats:
        """Returns the weighted residuals of all measurements (N,)."""
        return np.concatenate(
            [
                ((motion.table - each.data) / each.noise)[each.known]
                for each, motion in zip(self.experiments, motions, strict=True)
            ]
        )

    def jacobian(self, motions: Sequence[Motion]) -> Floats:
        """Returns the derivatives of the weighted residuals by u (N, p)."""
        rows = []
        for each, motion in zip(self.experiments, motions, strict=True):
            assert motion.slope is not None
            rows.append((motion.slope / each.noise[:, None])[each.known])
        return np.concatenate(rows)

    def minimum(self, start: Floats, held: int | None = None, loss: str | None = None) -> Minimum:
        """Searches a minimum from a start (p,), at which the runs must succeed.

        A failed run on the way is a step that SciPy shortens and tries again.

        Args:
            start: The coordinates (p,).
            held: The index of a parameter that keeps its value.
            loss: Another loss than the problem's.

        Raises:
            FailedRun: A run at the start failed.
        """
        loss = loss or self._loss
        optimize = require("scipy.optimize", extra="study", purpose="fit")
        free = np.array([k for k in range(len(start)) if k != held], dtype=int)
        low, high = self.bounds[:, free]
        whole = start.copy()
        whole[free] = np.clip(start[free], low, high)
        # SciPy's first trust region is as large as its start, which shall not depend on the origin
        # of u: beside zero it would be tiny, and the search could take its start for its end.
        shift = whole[free] - 1.0 / np.sqrt(max(len(free), 1))

        def put(some: Floats) -> Floats:
            whole[free] = np.clip(some + shift, low, high)
            return whole

        def residuals(some: Floats) -> Floats:
            if np.array_equal(put(some), begin):
                return first
            try:
                return self.residuals(self.motions(put(some)))
            except FailedRun:
                return np.full(count, np.inf)

        def jacobian(some: Floats) -> Floats:
            return self.jacobian(self.motions(put(some), derivatives=True))[:, free]

        begin, first = whole.copy(), self.residuals(self.motions(whole))
        count = len(first)
        if not len(free):
            return Minimum(start.copy(), 0.5 * float(losses(first, loss).sum()), True)
        found: Any = optimize.least_squares(
            residuals,
            whole[free] - shift,
            jac=jacobian,
            bounds=(low - shift, high - shift),
            loss=loss,
            ftol=_OF_COST,
            xtol=_OF_STEP,
            gtol=_OF_STEP,
            max_nfev=MOST_EVALUATIONS,
        )
        return Minimum(put(found.x).copy(), float(found.cost), found.status > 0)


@contextmanager
def quiet() -> Iterator[None]:
    """Leaves out warnings about scenes that a search only passes through."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StabilityWarning)
        warnings.simplefilter("ignore", SuspiciousValueWarning)
        yield


def losses(residuals: Floats, loss: str) -> Floats:
    """Returns the loss of each residual r: r^2, or 2 (sqrt(1 + r^2) - 1) of "soft_l1"."""
    square = residuals * residuals
    return square if loss == "linear" else 2.0 * (np.sqrt(1.0 + square) - 1.0)


def influence(residuals: Floats, loss: str) -> tuple[Floats, Floats]:
    """Returns psi, half the derivative of the loss, and the derivative of psi."""
    if loss == "linear":
        return residuals, np.ones_like(residuals)
    root = np.sqrt(1.0 + residuals * residuals)
    return residuals / root, root**-3
